//! Plant behind the emulated cRIO: a rig that two duties and a pump switch drive.
//!
//! [`EmulatedPlant`] is all the emulator asks for; [`model::predict::DualPressureRig`] is the rig that
//! files describe. The pressures it hands over are what its sensors show before the converter, so
//! mechanisms of the sensors (lag, for one) are in them; noise and steps come from
//! [`Sensors`](super::Sensors).

use model::plant::Plant;
use model::predict::{DualPressurePorts, DualPressureRig};
use model::rig::{Rig, RigError, Sensor};

use super::crio::CrioConfig;
use super::pace::TICK;
use super::sensors::SensorScale;
use crate::rig_file::{self, RigFileError};

/// Voltages (V) that a sensor of the wire gives while it and its wire are sound, both ends included; its range is 1 … 5 V.
pub const WIRE_V: [f64; 2] = [0.8, 5.2];

/// A rig advanced by one 20 ms tick per call.
pub trait EmulatedPlant: Send {
    /// Advances by one tick with these duties, 0 (closed) to 1 (open), positive and negative valve.
    fn tick(&mut self, duty: [f64; 2], pump_on: bool);

    /// The true pressures at the current edge: positive and negative chamber, kPa gauge.
    fn pressures_gauge_kpa(&self) -> [f64; 2];
}

impl<R: EmulatedPlant + ?Sized> EmulatedPlant for Box<R> {
    fn tick(&mut self, duty: [f64; 2], pump_on: bool) {
        (**self).tick(duty, pump_on);
    }

    fn pressures_gauge_kpa(&self) -> [f64; 2] {
        (**self).pressures_gauge_kpa()
    }
}

impl EmulatedPlant for DualPressureRig {
    fn tick(&mut self, duty: [f64; 2], pump_on: bool) {
        Self::tick(self, duty, pump_on);
    }

    fn pressures_gauge_kpa(&self) -> [f64; 2] {
        self.readings_kpa()
    }
}

/// A rig as its file describes it, at rest, and the cRIO that goes with it.
///
/// The cRIO has a pump relay where the rig's pump is switched by `pump_on`, and sensors of the
/// ranges that the rig states.
///
/// # Errors
/// The rig is unsound, lacks a duty or a sensor of the wire's (see [`DualPressurePorts::of`]), or has
/// another tick than the wire's 20 ms.
pub fn rig_and_crio(rig: &Rig) -> Result<(DualPressureRig, CrioConfig), RigError> {
    let behind = DualPressureRig::new(rig)?;
    check_tick(rig)?;
    let mut crio = CrioConfig::default();
    for (scale, column) in crio.scales.iter_mut().zip(DualPressurePorts::READING) {
        if let Some((_, sensor)) = rig.sensor_of(column) {
            *scale = scale_of(sensor);
        }
    }
    let inputs = Plant::<f64>::new(rig)?;
    crio.pump_relay = inputs.inputs().iter().any(|input| input.column == DualPressurePorts::PUMP_ON);
    Ok((behind, crio))
}

/// Refuses a rig that a loop cannot be closed over: its tick is not that of the control, the wire's 20 ms, so that it would
/// pass through another time than its controller.
///
/// # Errors
/// The tick, by its key.
pub fn check_tick(rig: &Rig) -> Result<(), RigError> {
    let tick_ms = TICK.as_secs_f64() * 1e3;
    // A tick is written in ms with a few digits; one part in a million is far below what moves a pressure.
    if (rig.integrator.tick_ms / tick_ms - 1.0).abs() > 1e-6 {
        return Err(RigError::at(
            "integrator.tick_ms",
            format!("a tick of {} ms; the cRIO samples every {tick_ms} ms", rig.integrator.tick_ms),
        ));
    }
    Ok(())
}

/// Refuses a rig whose sensors leave the wire's voltages ([`WIRE_V`]) somewhere between the atmosphere and the end of their range: a
/// daemon takes such a sensor for a broken one, at rest or on the way.
///
/// # Errors
/// The range in volts, by its key.
fn check_volts(rig: &Rig) -> Result<(), RigError> {
    let [least_v, most_v] = WIRE_V;
    let far_ends: [fn(f64, f64) -> f64; 2] = [f64::max, f64::min];
    for (column, far) in DualPressurePorts::READING.into_iter().zip(far_ends) {
        let Some((name, sensor)) = rig.sensor_of(column) else { continue };
        let ([low_kpa, high_kpa], [low_v, high_v]) = (sensor.range_kpa_gauge, sensor.range_v);
        let volts = |kpa: f64| low_v + (kpa - low_kpa) / (high_kpa - low_kpa) * (high_v - low_v);
        // A straight line is inside where both its ends are.
        for kpa in [0.0, far(far(low_kpa, high_kpa), 0.0)] {
            // A range is written with a few digits: what is a millionth of a volt outside is at the limit.
            if !(least_v - 1e-6..=most_v + 1e-6).contains(&volts(kpa)) {
                return Err(RigError::at(
                    format!("sensors.{name}.range_v"),
                    format!(
                        "[{low_v}, {high_v}] V puts {kpa} kPa at {} V; from the atmosphere to the end of its range a sensor of the wire gives {least_v} … {most_v} V: take one of 1 … 5 V, or convert its voltage",
                        (volts(kpa) * 1e3).round() / 1e3
                    ),
                ));
            }
        }
    }
    Ok(())
}

/// Reads a rig that a loop is to be closed over, as plant or as model: a built-in one or a file, refused where it could not stand
/// behind the wire. `given_as` says in errors how it was asked for (`--model`), where it was.
///
/// # Errors
/// As [`rig_file::load`], or as [`rig_and_crio`] with the file.
pub fn load_for_loop(file: &str, given_as: Option<&str>) -> Result<Rig, RigFileError> {
    let rig = rig_file::load(file)?;
    match rig_and_crio(&rig).and_then(|_| check_volts(&rig)) {
        Ok(()) => Ok(rig),
        Err(problem) => {
            let file = given_as.map_or_else(|| file.to_owned(), |given_as| format!("{file} ({given_as})"));
            Err(RigFileError::Rig { file, problem })
        }
    }
}

/// The straight line through both ends of a sensor's range, at 1 V and 5 V.
fn scale_of(sensor: &Sensor) -> SensorScale {
    let [low_kpa, high_kpa] = sensor.range_kpa_gauge;
    let [low_v, high_v] = sensor.range_v;
    let at = |volts: f64| low_kpa + (volts - low_v) / (high_v - low_v) * (high_kpa - low_kpa);
    SensorScale { at_1v_kpa: at(1.0), at_5v_kpa: at(5.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn paper(edit: impl Fn(&mut Rig)) -> Rig {
        let mut rig = Rig::builtin("dual_pressure").unwrap();
        edit(&mut rig);
        rig
    }

    #[test]
    fn built_in_rigs_stand_at_rest_behind_the_protocols_crio() {
        for name in Rig::BUILTIN {
            let (behind, crio) = rig_and_crio(&Rig::builtin(name).unwrap()).unwrap();
            assert_eq!(behind.pressures_gauge_kpa(), [0.0, 0.0], "{name}");
            // The protocol's page names the sensors; both built-in rigs state the same.
            assert_eq!(crio, CrioConfig::default(), "{name}");
        }
    }

    #[test]
    fn a_tick_moves_both_pressures_the_way_the_pump_does() {
        let (mut behind, _) = rig_and_crio(&paper(|_| {})).unwrap();
        EmulatedPlant::tick(&mut behind, [0.0, 0.0], true);
        let [pos, neg] = behind.pressures_gauge_kpa();
        // First row of a converged trace made elsewhere: 4.7116 and -19.6512 kPa, and RK4 at 0.1 ms is
        // within 0.01 kPa of it.
        assert!((pos - 4.7116).abs() < 0.01 && (neg + 19.6512).abs() < 0.01, "{pos} {neg}");
    }

    #[test]
    fn a_rig_without_a_relay_has_a_crio_without_one() {
        let rig = paper(|rig| {
            if let Some(model::rig::Pump::Piston(pump)) = rig.pumps.get_mut("pump") {
                pump.relay = None;
            }
        });
        assert!(!rig_and_crio(&rig).unwrap().1.pump_relay);
    }

    #[test]
    fn sensors_are_those_of_the_rig() {
        let rig = paper(|rig| {
            if let Some(sensor) = rig.sensors.get_mut("sensor_neg") {
                (sensor.range_kpa_gauge, sensor.range_v) = ([-100.0, 100.0], [0.0, 10.0]);
            }
        });
        // 20 kPa per volt from -100 kPa at 0 V.
        assert_eq!(rig_and_crio(&rig).unwrap().1.scales[1], SensorScale { at_1v_kpa: -80.0, at_5v_kpa: 0.0 });
    }

    /// 0 … 10 V and 0.5 … 4.5 V, as sensors are sold, are outside at rest already; what only ends outside is so on the way.
    #[test]
    fn sensors_whose_volts_the_wire_does_not_take_are_refused_by_name() {
        let refused = |name: &str, kpa: [f64; 2], volts: [f64; 2]| {
            let rig = paper(|rig| {
                if let Some(sensor) = rig.sensors.get_mut(name) {
                    (sensor.range_kpa_gauge, sensor.range_v) = (kpa, volts);
                }
            });
            check_volts(&rig).err().map(|error| error.to_string())
        };
        for (name, kpa, volts, words) in [
            ("sensor_pos", [0.0, 1000.0], [0.0, 10.0], "puts 0 kPa at 0 V"),
            ("sensor_neg", [0.0, -101.0], [0.5, 4.5], "puts 0 kPa at 0.5 V"),
            ("sensor_neg", [-100.0, 100.0], [0.0, 10.0], "puts -100 kPa at 0 V"),
            ("sensor_pos", [-100.0, 100.0], [0.0, 10.0], "puts 100 kPa at 10 V"),
            ("sensor_pos", [1000.0, 0.0], [1.0, 5.5], "puts 0 kPa at 5.5 V"),
        ] {
            let told = refused(name, kpa, volts).unwrap();
            let key = format!("sensors.{name}.range_v: ");
            assert!(told.starts_with(&key) && told.contains(words) && told.contains("0.8 … 5.2 V"), "{told}");
        }
        for (name, kpa, volts) in [
            ("sensor_pos", [0.0, 1000.0], [1.0, 5.0]),
            ("sensor_neg", [-101.0, 0.0], [5.0, 1.0]),
            ("sensor_pos", [0.0, 500.0], [0.8, 5.2]),
            // Of a compound sensor only the half that its chamber uses.
            ("sensor_pos", [-100.0, 100.0], [0.0, 5.0]),
        ] {
            assert_eq!(refused(name, kpa, volts), None, "{name} {kpa:?} {volts:?}");
        }
    }

    #[test]
    fn a_rig_with_another_tick_is_refused_by_name() {
        let error = rig_and_crio(&paper(|rig| rig.integrator.tick_ms = 10.0)).err().unwrap();
        assert_eq!(error.to_string(), "integrator.tick_ms: a tick of 10 ms; the cRIO samples every 20 ms");
        let path = std::env::temp_dir().join(format!("loop-rig-{}.toml", std::process::id()));
        rig_file::save(&path, &paper(|rig| rig.integrator.tick_ms = 40.0)).unwrap();
        let file = path.to_str().unwrap();
        let said = |given_as| load_for_loop(file, given_as).unwrap_err().to_string();
        let problem = "integrator.tick_ms: a tick of 40 ms; the cRIO samples every 20 ms";
        assert_eq!(said(None), format!("{file}: {problem}"));
        assert_eq!(said(Some("--model")), format!("{file} (--model): {problem}"));
        for name in Rig::BUILTIN {
            assert_eq!(load_for_loop(name, None).unwrap(), Rig::builtin(name).unwrap());
        }
        rig_file::save(&path, &paper(|rig| rig.sensors["sensor_pos"].range_v = [0.0, 10.0])).unwrap();
        let problem = load_for_loop(file, Some("rig.file")).unwrap_err().to_string();
        assert!(problem.starts_with(&format!("{file} (rig.file): sensors.sensor_pos.range_v: ")), "{problem}");
        std::fs::remove_file(path).unwrap();
    }
}
