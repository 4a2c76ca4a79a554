//! Tests of the change of models: refused and put in by what the rig does.

use super::*;

/// Four times the volumes: what it foresees would vent the rig within moments.
fn far_off() -> std::path::PathBuf {
    let mut rig = Rig::builtin("dual_pressure").unwrap();
    rig.volumes.values_mut().for_each(|volume| volume.volume_l *= 4.0);
    let file = std::env::temp_dir().join(format!("far-off-{}.toml", std::process::id()));
    std::fs::write(&file, rig.to_toml().unwrap()).unwrap();
    file
}

fn flown(tick: u32) -> Sample {
    Sample { tick, measured_kpa: [90.0, -70.0], duty: [0.88, 0.87], pump_on: true }
}

/// Changes the model while ticks come in a state.
fn change(tick: &ModelTickEnd, desk: &ModelDesk, file: &Path, state: State) -> Result<String, String> {
    let changing = {
        let (desk, file) = (desk.clone(), file.to_owned());
        std::thread::spawn(move || desk.change(&file, Safety::default(), &Permit::unlimited()))
    };
    while !changing.is_finished() {
        if let Some(change) = tick.take(state) {
            tick.retire(change);
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    changing.join().unwrap().map(|changed| changed.line)
}

#[test]
fn what_cannot_be_compared_yet_is_put_in_only_while_disarmed() {
    let nominal = Rig::builtin("dual_pressure").unwrap();
    let file = far_off();
    let (mut tick, desk) = ends(&nominal, Arc::new(SteadyMap::new(&nominal).unwrap()));
    (0..200).for_each(|number| tick.keep(flown(number)));
    // In HOLD, too, although no tick is kept there. Of 500 ticks that count there are 170.
    for state in [State::Run, State::Hold] {
        let refused = change(&tick, &desk, &file, state).unwrap_err();
        assert!(refused.contains("armed for 7 s more, or put it in while disarmed"), "{refused}");
        assert_eq!((desk.rig(), desk.put_in()), (nominal.clone(), None), "nothing has changed");
    }
    let line = change(&tick, &desk, &file, State::Standby).unwrap();
    assert!(line.contains("is in force; too little was run to compare it"), "{line}");
    let put_in = desk.put_in().unwrap();
    assert!(desk.rig() != nominal && put_in.file.as_deref() == file.to_str());
    assert_eq!(put_in, ModelIdentity::of(&desk.rig(), &file.to_string_lossy()));
    std::fs::remove_file(file).unwrap();
}

/// On a hold another model may be put in, and the answer says how little that tells.
#[test]
fn at_rest_only_what_is_far_off_is_refused() {
    let nominal = Rig::builtin("dual_pressure").unwrap();
    let mut edited = nominal.clone();
    edited.integrator.step_ms = 0.25;
    let file = std::env::temp_dir().join(format!("at-rest-{}.toml", std::process::id()));
    std::fs::write(&file, edited.to_toml().unwrap()).unwrap();
    let (mut tick, desk) = ends(&nominal, Arc::new(SteadyMap::new(&nominal).unwrap()));
    (0..700).for_each(|number| tick.keep(flown(number)));
    let line = change(&tick, &desk, &file, State::Run).unwrap();
    assert!(line.contains("hardly moved"), "{line}");
    std::fs::remove_file(file).unwrap();
}

/// A pressure beyond a limit vents in the same tick only where the sensor shows it.
#[test]
fn a_model_whose_sensor_ends_before_a_limit_is_refused() {
    let nominal = Rig::builtin("dual_pressure").unwrap();
    let mut short = nominal.clone();
    // The same volts at each pressure, up to 110 kPa.
    let sensor = &mut short.sensors["sensor_pos"];
    (sensor.range_kpa_gauge, sensor.range_v) = ([0.0, 110.0], [1.0, 1.44]);
    let file = std::env::temp_dir().join(format!("short-range-{}.toml", std::process::id()));
    std::fs::write(&file, short.to_toml().unwrap()).unwrap();
    let (tick, desk) = ends(&nominal, Arc::new(SteadyMap::new(&nominal).unwrap()));
    let refused = change(&tick, &desk, &file, State::Standby).unwrap_err();
    assert!(refused.contains("safety.max_pos_kpa = 160 kPa") && refused.contains("ends at 110 kPa"), "{refused}");
    assert_eq!(desk.put_in(), None);
    std::fs::remove_file(file).unwrap();
}
