//! Sensors that stick, drift, jump, or show too little from the start, on the built daemon over a real socket.
//!
//! In lockstep, so that nothing hangs on how busy the machine is: SENSE goes out, the answer comes, the plant moves on.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
#![allow(clippy::type_complexity)] // tables of cases say their shape where they stand

use model::rig::Rig;
use proto::emulator::SensorFault;
use proto::wire::{CrioState, Mode};
use tests::Stream::Err;
use tests::scene::Scene;

#[test]
fn a_stuck_or_wrong_sensor_is_caught_before_the_true_pressure_has_moved_by_15_kpa() {
    // Offsets by tick: a jump, drifts fast and slow.
    let ramp = |kpa_per_s: f64| move |tick: u32| vec![SensorFault::Offset(kpa_per_s * 0.02 * f64::from(tick))];
    type Course = Box<dyn Fn(u32) -> Vec<SensorFault>>;
    let cases: Vec<(&str, usize, Course)> = vec![
        ("frozen", 0, Box::new(|_| vec![SensorFault::Stuck])),
        ("frozen at 60 kPa", 0, Box::new(|_| vec![SensorFault::Reading(60.0)])),
        ("0.85 V", 0, Box::new(|_| vec![SensorFault::Reading(-37.5)])),
        ("60 kPa low", 0, Box::new(|_| vec![SensorFault::Offset(-60.0)])),
        ("60 kPa high", 0, Box::new(|_| vec![SensorFault::Offset(60.0)])),
        ("falls by 20 kPa/s", 0, Box::new(ramp(-20.0))),
        ("falls by 5 kPa/s", 0, Box::new(ramp(-5.0))),
        ("rises by 10 kPa/s", 0, Box::new(ramp(10.0))),
        ("frozen", 1, Box::new(|_| vec![SensorFault::Stuck])),
        ("frozen at -40 kPa", 1, Box::new(|_| vec![SensorFault::Reading(-40.0)])),
        ("0.85 V", 1, Box::new(|_| vec![SensorFault::Reading(3.8)])),
        ("rises by 10 kPa/s", 1, Box::new(ramp(10.0))),
        ("falls by 5 kPa/s", 1, Box::new(ramp(-5.0))),
    ];
    for rig in ["dual_pressure", "bench"] {
        for (name, channel, course) in &cases {
            let mut scene = Scene::under_control(rig);
            let before = scene.crio.true_kpa()[*channel];
            let mut moved: f64 = 0.0;
            let mut vented = None;
            for tick in 0..500 {
                scene.crio.faults[*channel] = course(tick);
                let mode = scene.step();
                if mode == Some(Mode::Vent) {
                    vented = Some(tick);
                    break;
                }
                moved = moved.max((scene.crio.true_kpa()[*channel] - before).abs());
            }
            let context = format!("{rig}, channel {channel}, {name}: {vented:?}, moved by {moved:.1} kPa");
            println!("{context}");
            assert!(vented.is_some() && moved < 15.0, "{context}: {}", scene.daemon.said(Err));
            scene.check_latched();
            scene.told("VENTED");
            scene.end();
        }
    }
}

/// The pump couples the chambers: a negative reading that is off shows in the positive channel too, whose limits are the narrower.
#[test]
fn a_drift_is_told_as_that_of_the_sensor_that_drifts() {
    const TOLD: [&str; 2] = ["positive reading and model disagree", "negative reading and model disagree"];
    for rig in ["dual_pressure", "bench"] {
        for (channel, kpa_per_s) in [(0, -3.0), (0, 3.0), (1, -3.0), (1, 3.0)] {
            let mut scene = Scene::under_control(rig);
            let vented = (0..500).find(|tick| {
                scene.crio.faults[channel] = vec![SensorFault::Offset(kpa_per_s * 0.02 * f64::from(*tick))];
                scene.step() == Some(Mode::Vent)
            });
            let context = format!("{rig}, channel {channel}, {kpa_per_s} kPa/s: {vented:?}");
            println!("{context}");
            assert!(vented.is_some(), "{context}: {}", scene.daemon.said(Err));
            scene.told(TOLD[channel]);
            scene.silent_about(TOLD[1 - channel]);
            scene.end();
        }
    }
}

/// A step of the references behind half a minute's rest, and true pressures for eight seconds from then on; the sensor's fault begins with it.
fn stepped(rig: &str, channel: usize, course: &dyn Fn(u32) -> Vec<SensorFault>) -> (Vec<[f64; 2]>, Option<u32>, Scene) {
    let mut scene = Scene::under_control(rig);
    scene.control(1_500);
    let file = scene.folder.write("step.csv", "time_s,ref_pos_kpa,ref_neg_kpa\n0,80,-66\n");
    let changed = scene.ask_at_length(&["reference", &file.to_string_lossy()]);
    assert_eq!(changed.status, Some(0), "{changed:?}");
    let mut truth = Vec::new();
    let vented = (0..400).find(|tick| {
        scene.crio.faults[channel] = course(*tick);
        let mode = scene.step();
        truth.push(scene.crio.true_kpa());
        mode == Some(Mode::Vent)
    });
    (truth, vented, scene)
}

#[test]
fn a_reading_in_doubt_is_held_over_the_wire_as_well() {
    let mut scene = Scene::under_control("dual_pressure");
    scene.crio.faults[0] = vec![SensorFault::Offset(-40.0)];
    assert_eq!(scene.step(), Some(Mode::Hold), "{}", scene.daemon.said(Err));
    scene.crio.faults[0].clear();
    let modes: Vec<_> = (0..8).map(|_| scene.step()).collect();
    let held = modes.iter().take_while(|mode| **mode == Some(Mode::Hold)).count();
    assert!((3..=5).contains(&held) && modes[held..].iter().all(|m| *m == Some(Mode::Run)), "{modes:?}");
    assert_eq!(scene.crio.reported_state(), CrioState::Running);
    scene.told("holding");
    scene.silent_about("VENTED");
    scene.end();
}

#[test]
fn another_model_is_put_in_while_it_flies_and_wrong_sensors_are_caught_with_it() {
    let mut scene = Scene::under_control("bench");
    scene.control(700);
    let changed = scene.ask_at_length(&["model", "bench"]);
    assert!(changed.status == Some(0) && changed.stdout.contains("model bench is in force"), "{changed:?}");
    scene.control(300);
    scene.silent_about("VENTED");
    let before = scene.crio.true_kpa()[0];
    let mut moved: f64 = 0.0;
    for tick in 0..500 {
        scene.crio.faults[0] = vec![SensorFault::Offset(-0.1 * f64::from(tick))];
        if scene.step() == Some(Mode::Vent) {
            break;
        }
        moved = moved.max((scene.crio.true_kpa()[0] - before).abs());
    }
    assert!(moved < 15.0, "moved by {moved:.1} kPa: {}", scene.daemon.said(Err));
    scene.told("reading and model disagree");
    scene.end();
}

/// A model that foresees worse is refused, unless it is the one that was in force before: whoever exchanged it may go back.
#[test]
fn the_model_before_may_always_be_had_back_and_no_other_that_foresees_worse() {
    let mut scene = Scene::under_control("bench");
    scene.control(900);
    let mut other = Rig::builtin("dual_pressure").unwrap();
    // On a hold only what is far off is refused.
    other.valves.values_mut().for_each(|valve| {
        valve.input_area_mm2 *= 10.0;
        valve.pressure_area_mm2_per_n *= 10.0;
        valve.spring_area_mm2 *= 10.0;
    });
    let other = scene.folder.write("other.toml", other.to_toml().unwrap());
    assert_eq!(scene.ask_at_length(&["model", "bench"]).status, Some(0));
    scene.control(900);
    let refused = scene.ask_at_length(&["model", &other.to_string_lossy()]);
    assert!(refused.status == Some(1) && refused.stderr.contains("worse than the model in force"), "{refused:?}");
    let back = scene.ask_at_length(&["model", &scene.folder.join("dual_pressure.toml").to_string_lossy()]);
    assert!(back.status == Some(0) && back.stdout.contains("dual_pressure is in force again"), "{back:?}");
    scene.control(100);
    scene.silent_about("VENTED");
    scene.end();
}

/// Faults of a sensor that shows this share of the pressure.
fn gain(share: f64, true_kpa: f64) -> Vec<SensorFault> {
    vec![SensorFault::Offset((share - 1.0) * true_kpa)]
}

/// It fills as a rig does that is half as quick, and comes to rest where no rig of this model rests.
#[test]
fn a_gain_that_was_wrong_from_the_start_is_found_before_the_pressure_is_far_from_its_reference() {
    for rig in ["dual_pressure", "bench"] {
        for (channel, share) in [(0, 0.5), (0, 0.6), (1, 0.5), (1, 0.6)] {
            let mut scene = Scene::start(rig, "");
            let mut most: f64 = 0.0;
            let mut run = 0;
            let vented = (0..500).find(|_| {
                let true_kpa = scene.crio.true_kpa()[channel];
                most = most.max(true_kpa.abs());
                scene.crio.faults[channel] = gain(share, true_kpa);
                let mode = scene.step();
                run += u32::from(mode == Some(Mode::Run));
                run > 0 && mode == Some(Mode::Vent)
            });
            let context =
                format!("{rig}, channel {channel} shows {share}: {vented:?}, {run} ticks, true {most:.1} kPa");
            println!("{context}");
            // 90 and -70 kPa are asked for. What shows more than half may come to where the duty that holds it tells.
            let limit = if share <= 0.5 { [105.0, 85.0] } else { [140.0, 90.0] }[channel];
            assert!(vented.is_some() && most < limit, "{context}: {}", scene.daemon.said(Err));
            scene.told("reading and model disagree");
            scene.check_latched();
            scene.end();
        }
    }
}

/// Noise goes on, so that no reading repeats itself, and the pressure is not in it any more.
#[test]
fn a_sensor_that_sticks_and_still_scatters_while_the_chambers_fill_is_found() {
    for (channel, after) in [(0, 1), (0, 15), (0, 40), (1, 1), (1, 15), (1, 40)] {
        let mut scene = Scene::start("dual_pressure", "");
        let (mut run, mut stuck, mut most, mut ticks) = (0u32, None, 0.0_f64, 0u32);
        let vented = (0..500).find(|_| {
            let true_kpa = scene.crio.true_kpa()[channel];
            if run >= after {
                let at = *stuck.get_or_insert(true_kpa);
                ticks += 1;
                most = most.max(true_kpa.abs());
                scene.crio.faults[channel] = vec![SensorFault::Offset(at - true_kpa)];
            }
            let mode = scene.step();
            run += u32::from(mode == Some(Mode::Run));
            run > 0 && mode == Some(Mode::Vent)
        });
        let context = format!(
            "channel {channel}, stuck {after} ticks after arming at {stuck:.1?} kPa: {ticks} ticks, true {most:.1} kPa"
        );
        println!("{context}");
        // Where it sticks late the chamber is nearly full, and only a valve that shuts against it tells.
        let limit = if after < 40 { [105.0, 85.0] } else { [120.0, 85.0] }[channel];
        assert!(vented.is_some() && ticks <= 150 && most < limit, "{context}: {}", scene.daemon.said(Err));
        scene.end();
    }
}

/// Reading that a channel's sensor is made to show, by tick since it went wrong, true pressures, and what it last showed.
type Shown = Box<dyn FnMut(u32, [f64; 2], f64) -> f64>;

/// Sensors that are half right: they follow up to a limit, only now and then, only one way, or show the other chamber.
#[test]
fn a_sensor_that_is_half_right_never_lets_the_pressure_run_away() {
    let cases: Vec<(&str, usize, fn() -> Shown)> = vec![
        ("never above 85 kPa", 0, || Box::new(|_, [p, _], _| p.min(85.0))),
        ("never below -66 kPa", 1, || Box::new(|_, [_, n], _| n.max(-66.0))),
        ("every 14th tick", 0, || Box::new(|k, [p, _], last| if k % 14 == 0 { p } else { last })),
        ("every 14th tick", 1, || Box::new(|k, [_, n], last| if k % 14 == 0 { n } else { last })),
        ("only falls", 0, || Box::new(|_, [p, _], last| p.min(last))),
        ("a gain that sinks", 0, || Box::new(|k, [p, _], _| p * (1.0 - 0.002 * f64::from(k)))),
        ("a gain that sinks", 1, || Box::new(|k, [_, n], _| n * (1.0 - 0.002 * f64::from(k)))),
        ("drifts and comes back", 0, || Box::new(|k, [p, _], _| p - 12.0 * (f64::from(k) / 60.0).sin())),
        ("half of it, as of now", 0, || Box::new(|_, [p, _], _| 0.5 * p)),
        ("the other chamber, turned round", 0, || Box::new(|_, [_, n], _| -n)),
        ("the other chamber, turned round", 1, || Box::new(|_, [p, _], _| -p)),
    ];
    for rig in ["dual_pressure", "bench"] {
        for (name, channel, shown) in &cases {
            let (mut scene, mut shown) = (Scene::under_control(rig), shown());
            let before = scene.crio.true_kpa()[*channel];
            let (mut last, mut most) = (before, 0.0_f64);
            let vented = (0..1_000).find(|tick| {
                let true_kpa = scene.crio.true_kpa();
                most = most.max((true_kpa[*channel] - before).abs());
                last = shown(*tick, true_kpa, last);
                scene.crio.faults[*channel] = vec![SensorFault::Offset(last - true_kpa[*channel])];
                scene.step() == Some(Mode::Vent)
            });
            let context = format!("{rig}, channel {channel}, {name}: {vented:?}, moved by {most:.1} kPa");
            println!("{context}");
            assert!(most < 15.0, "{context}: {}", scene.daemon.said(Err));
            scene.end();
        }
    }
}

/// Tests of the thorough tier (docs/testing.md).
mod thorough {
    use super::*;

    /// Limits are wider in a step, for the model leaves more of it; a wrong sensor is found all the same.
    #[test]
    #[ignore = "thorough: docs/testing.md"]
    fn a_sensor_that_goes_wrong_in_a_step_is_caught_before_the_true_pressure_has_left_its_course_by_15_kpa() {
        let ramp = |kpa_per_s: f64| move |tick: u32| vec![SensorFault::Offset(kpa_per_s * 0.02 * f64::from(tick))];
        type Course = Box<dyn Fn(u32) -> Vec<SensorFault>>;
        let cases: Vec<(&str, usize, Course)> = vec![
            ("frozen", 0, Box::new(|_| vec![SensorFault::Stuck])),
            ("60 kPa low", 0, Box::new(|_| vec![SensorFault::Offset(-60.0)])),
            ("falls by 10 kPa/s", 0, Box::new(ramp(-10.0))),
            ("falls by 5 kPa/s", 0, Box::new(ramp(-5.0))),
            ("rises by 10 kPa/s", 0, Box::new(ramp(10.0))),
            ("frozen", 1, Box::new(|_| vec![SensorFault::Stuck])),
            ("rises by 10 kPa/s", 1, Box::new(ramp(10.0))),
            ("falls by 5 kPa/s", 1, Box::new(ramp(-5.0))),
        ];
        for rig in ["dual_pressure", "bench"] {
            let (sound, never, scene) = stepped(rig, 0, &|_| Vec::new());
            assert_eq!(never, None, "{}", scene.daemon.said(Err));
            scene.end();
            for (name, channel, course) in &cases {
                let (truth, vented, scene) = stepped(rig, *channel, course);
                let moved = truth.iter().zip(&sound).take(vented.unwrap_or(400) as usize);
                let moved = moved.map(|(now, sound)| (now[*channel] - sound[*channel]).abs()).fold(0.0_f64, f64::max);
                let context = format!("{rig}, channel {channel}, {name}: {vented:?}, {moved:.1} kPa off its course");
                println!("{context}");
                assert!(vented.is_some() && moved < 15.0, "{context}: {}", scene.daemon.said(Err));
                scene.told("VENTED");
                scene.end();
            }
        }
    }
}
