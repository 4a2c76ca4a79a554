//! Answers to operators are true: of the vents, of the model in force, of what would be refused.
//!
//! In lockstep, so that nothing hangs on how busy the machine is.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::cell::Cell;
use std::process::Command;
use std::time::{Duration, Instant};

use controller::reach::beyond_reach;
use controller::state::State;
use model::steady::SteadyMap;
use proto::reference::Reference;
use proto::wire::{Mode, Sense, TripBits};
use tests::Stream::{Err, Out};
use tests::coarse_rigs::coarse;
use tests::laboratory::{Plan, SOON};
use tests::programme::{csv, programme};
use tests::scene::Scene;
use tests::{Folder, RunStatus, Running, program};

/// Disarms while the cRIO goes on until that is answered, every SENSE spoilt on its way by what was commanded last.
fn disarm(scene: &mut Scene, spoil: impl Fn(Option<Mode>, &mut Sense)) -> RunStatus {
    let mut command = Command::new(program("controller"));
    let asking = Running::start(command.args(["disarm", "--config"]).arg(&scene.config));
    let (until, mut commanded) = (Instant::now() + SOON, None);
    while asking.said(Err).is_empty() && asking.said(Out).is_empty() && Instant::now() < until {
        commanded = scene.spoilt(|sense| spoil(commanded, sense));
        std::thread::sleep(Duration::from_millis(1));
    }
    asking.wait(SOON)
}

#[test]
fn a_disarming_says_that_the_vents_are_open_where_the_crio_reports_it() {
    let mut scene = Scene::under_control("dual_pressure");
    let ended = disarm(&mut scene, |_, _| ());
    assert_eq!(ended.status, Some(0), "{ended:?}");
    assert!(ended.stdout.contains("the cRIO reports them open") && ended.stdout.contains(" kPa"), "{ended:?}");
    // Also where the rig is vented for something else, and the reading that is broken is none.
    let armed = scene.ask_while_stepping("arm");
    assert_eq!(armed.status, Some(0), "{armed:?}");
    scene.control(20);
    assert_eq!(scene.spoilt(|sense| sense.volts[0] = 0.5), Some(Mode::Vent));
    (0..5).for_each(|_| _ = scene.step());
    let ended = disarm(&mut scene, |_, sense| sense.volts[0] = 0.5);
    assert_eq!(ended.status, Some(0), "{ended:?}");
    assert!(ended.stdout.contains("no sound reading") && ended.stdout.contains("acknowledge"), "{ended:?}");
    scene.end();
}

#[test]
fn a_disarming_that_the_crio_does_not_report_is_not_good() {
    let mut scene = Scene::under_control("dual_pressure");
    // Only from the first command to vent on: before it the request has to find a rig under control.
    let ended = disarm(&mut scene, |commanded, sense| {
        if commanded == Some(Mode::Vent) {
            sense.duty[0] = 0.2;
        }
    });
    assert_eq!(ended.status, Some(1), "{ended:?}");
    for words in ["in doubt", "0.200", " kPa", "pump"] {
        assert!(ended.stderr.contains(words) && ended.stdout.is_empty(), "`{words}` is not in {ended:?}");
    }
    // It is recorded as what it is, not as done.
    let said = scene.daemon.line(Err, "disarm by", SOON);
    assert!(said.contains("in doubt") && !said.contains("done"), "{said}");
    scene.end();
}

/// Volts of the positive sensor in a chamber that is shut, whose gas cools from `from_kpa` to four fifths of it; no two readings in a
/// row are alike, as of a sensor that works.
fn cooling_volts(from_kpa: f64, ticks: u32) -> f32 {
    let kpa = from_kpa * (0.8 + 0.2 * (-f64::from(ticks) / 40.0).exp());
    // The sensor's data sheet: 0 … 1000 kPa are 1 … 5 V.
    (1.0 + kpa / 250.0 + 1e-4 * f64::from(ticks % 7)) as f32
}

/// Gas that cools loses more in the first half second than a narrow vent would take off, and then stands.
#[test]
fn a_vent_that_stays_shut_is_told_although_the_pressure_falls_at_first() {
    let mut scene = Scene::under_control("dual_pressure");
    let (held_kpa, ticks) = (scene.crio.true_kpa()[0], Cell::new(0));
    // Only from the first command to vent on.
    let shut = |commanded, sense: &mut Sense| {
        if commanded == Some(Mode::Vent) {
            ticks.set(ticks.get() + 1);
            sense.volts[0] = cooling_volts(held_kpa, ticks.get());
        }
    };
    let ended = disarm(&mut scene, shut);
    assert_eq!(ended.status, Some(0), "the cRIO reports open vents, and no more is known yet: {ended:?}");
    assert!(ended.stdout.contains("that they fall is watched"), "{ended:?}");
    for _ in 0..250 {
        assert_eq!(scene.spoilt(|sense| shut(Some(Mode::Vent), sense)), Some(Mode::Vent));
    }
    scene.wait_for_state(State::Fault);
    scene.told("a pressure stays at");
    // It stays in doubt, and whoever asks once more is told so.
    let ended = disarm(&mut scene, |_, sense| shut(Some(Mode::Vent), sense));
    assert_eq!(ended.status, Some(1), "{ended:?}");
    assert!(ended.stderr.contains("in doubt (vent without effect)"), "{ended:?}");
    scene.end();
}

/// Arms, and breaks a sensor from the first command under control on.
fn arm_and_break(scene: &mut Scene) -> RunStatus {
    let mut command = Command::new(program("controller"));
    let asking = Running::start(command.args(["arm", "--config"]).arg(&scene.config));
    let (until, mut broken) = (Instant::now() + SOON, false);
    while asking.said(Err).is_empty() && asking.said(Out).is_empty() && Instant::now() < until {
        let mode = scene.spoilt(|sense| {
            if broken {
                sense.volts[0] = 0.5;
            }
        });
        if mode == Some(Mode::Run) {
            // The next frame at once, before anybody has seen it run.
            broken = true;
        } else {
            std::thread::sleep(Duration::from_millis(1));
        }
    }
    asking.wait(SOON)
}

#[test]
fn an_arming_that_is_vented_in_the_next_tick_says_so() {
    let mut scene = Scene::on(&coarse("dual_pressure"), "");
    let mut refused = 0;
    // Where the desk has looked between the two frames it has seen the rig run, and says so: once in ten times.
    for _ in 0..5 {
        (0..60).for_each(|_| _ = scene.step());
        scene.wait_for_state(State::Standby);
        let ended = arm_and_break(&mut scene);
        if ended.status != Some(0) {
            refused += 1;
            for words in ["vented as soon as it was armed (positive sensor broken)", "acknowledge"] {
                assert!(ended.stderr.contains(words), "`{words}` is not in {ended:?}");
            }
        }
        (0..5).for_each(|_| _ = scene.step());
        let acknowledged = scene.ask_while_stepping("acknowledge");
        assert_eq!(acknowledged.status, Some(0), "{acknowledged:?}");
    }
    assert!(refused > 0, "{}", scene.daemon.said(Err));
    scene.end();
}

/// A stop at the cRIO while a sensor is broken: the acknowledgement releases the one and not the other, and a new session follows.
#[test]
fn an_acknowledgement_tells_what_it_released_and_what_waits_on() {
    let mut scene = Scene::under_control("dual_pressure");
    let broken = |sense: &mut Sense| sense.volts[1] = f32::NAN;
    scene.spoilt(broken);
    scene.crio.trip(TripBits::OPERATOR_STOP);
    (0..5).for_each(|_| _ = scene.spoilt(broken));
    let ask_broken = |scene: &mut Scene, arguments: &[&str]| {
        let mut command = Command::new(program("controller"));
        let asking = Running::start(command.args(arguments).arg("--config").arg(&scene.config));
        let until = Instant::now() + SOON;
        while asking.said(Err).is_empty() && asking.said(Out).is_empty() && Instant::now() < until {
            scene.spoilt(broken);
            std::thread::sleep(Duration::from_millis(1));
        }
        asking.wait(SOON)
    };
    let text = ask_broken(&mut scene, &["status"]);
    assert!(text.stdout.contains("waiting    cRIO tripped, negative sensor broken: "), "{text:?}");
    let json = ask_broken(&mut scene, &["status", "--json"]);
    assert!(json.stdout.contains(r#""waiting":["crio_tripped","sensor_negative"]"#), "{json:?}");
    let hellos = scene.crio.hellos;
    let done = ask_broken(&mut scene, &["acknowledge"]);
    assert_eq!(done.status, Some(0), "{done:?}");
    let told = "acknowledged: cRIO tripped; still waits: negative sensor broken";
    assert!(done.stdout.starts_with(told), "{done:?}");
    assert!(scene.daemon.line(Err, "acknowledge by", SOON).contains(told));
    scene.told("acknowledged at tick ");
    // What it released has an effect: a new session.
    scene.crio.open();
    assert_eq!(scene.crio.hellos, hellos + 1);
    (0..5).for_each(|_| _ = scene.spoilt(broken));
    // What still holds cannot be acknowledged: there nothing was done.
    let refused = ask_broken(&mut scene, &["acknowledge"]);
    assert_eq!(refused.status, Some(1), "{refused:?}");
    assert!(refused.stderr.contains("negative sensor broken") && refused.stderr.contains("still holds"), "{refused:?}");
    scene.end();
}

/// An answer that says "arm when you are ready" is followed by an arming that is asked for at once.
#[test]
fn what_is_acknowledged_is_armed_at_once() {
    let mut scene = Scene::under_control("dual_pressure");
    assert_eq!(scene.spoilt(|sense| sense.volts[0] = f32::NAN), Some(Mode::Vent));
    for _ in 0..100 {
        scene.step();
    }
    for (question, answer) in [("acknowledge", "arm when you are ready"), ("arm", "armed")] {
        let done = scene.ask_at_length(&[question]);
        assert!(done.status == Some(0) && done.stdout.contains(answer), "{done:?}");
    }
    scene.control(20);
    scene.end();
}

#[test]
fn a_disarming_without_a_crio_says_that_nothing_is_known() {
    let folder = Folder::new();
    let config = folder.write(
        "c.toml",
        "link.address = \"127.0.0.1:9\"\ncontrol.socket = \"s\"\nrealtime.enforce = false\nrecord.min_free_mib = 16\n",
    );
    let controller = |command: &str| {
        let mut controller = Command::new(program("controller"));
        Running::start(controller.args([command, "--config"]).arg(&config))
    };
    let daemon = controller("run");
    daemon.line(Err, "trying again", SOON);
    let ended = controller("disarm").wait(SOON);
    assert_eq!(ended.status, Some(1), "{ended:?}");
    assert!(ended.stderr.contains("not known") && ended.stderr.contains("no session"), "{ended:?}");
    daemon.terminate();
    assert_eq!(daemon.wait(SOON).status, Some(0));
}

#[test]
fn what_an_experiment_bars_is_not_offered() {
    let laboratory = Plan::new("policy.active = \"fallback\"").start();
    laboratory.stand_by();
    let file = laboratory.folder.write("e.csv", csv(&programme(6000)));
    let _client = Running::start(&mut laboratory.command(&["experiment", file.to_str().unwrap()]));
    let status = laboratory.wait_for("an experiment", |reply| reply["status"]["experiment"].is_object());
    assert_eq!(status["status"]["can_arm"], false, "{status}");
    assert!(!laboratory.ask(&["status"]).stdout.contains("can be armed"));
    laboratory.close();
}

#[test]
fn the_model_in_force_is_named_by_its_file_and_by_what_it_is() {
    let plan = Plan::new("policy.active = \"fallback\"");
    let mut edited = coarse("dual_pressure");
    edited.integrator.step_ms = 0.2;
    let file = plan.folder.write("m.toml", edited.to_toml().unwrap());
    let laboratory = plan.start();
    laboratory.stand_by();
    let before = laboratory.status()["running"].clone();
    assert_eq!(before["model"], "dual_pressure");
    assert!(before["model_file"].as_str().unwrap().ends_with("/dual_pressure.toml"), "{before}");
    assert!(before["configured_model"].is_null(), "{before}");
    let done = laboratory.ask(&["model", file.to_str().unwrap()]);
    assert_eq!(done.status, Some(0), "{done:?}");
    let after = laboratory.status()["running"].clone();
    assert_eq!((&after["model"], &after["model_file"]), (&"dual_pressure".into(), &file.to_str().unwrap().into()));
    let (was, is) = (before["model_sha256"].as_str().unwrap(), after["model_sha256"].as_str().unwrap());
    assert!(was != is && was.len() == 64 && is.len() == 64, "{was} {is}");
    assert_eq!(after["configured_model"]["sha256"], was, "{after}");
    let text = laboratory.ask(&["status"]).stdout;
    assert!(text.contains(&format!("sha256 {}, from {}", &is[..8], file.display())), "{text}");
    assert!(text.contains(&was[..8]) && text.contains("a restart takes"), "{text}");
    laboratory.close();
}

/// Nothing is refused for it: the place may be one to pass through, and the model may be wrong.
#[test]
fn a_reference_out_of_reach_is_told_to_whoever_follows_it_and_to_whoever_arms() {
    let plan = Plan::new("policy.active = \"fallback\"");
    // 5 kPa lower than the model goes, which is not enough for the watch to give it up.
    let low = plan.folder.write("low.csv", "time_s,ref_pos_kpa,ref_neg_kpa\n0,78,-62\n1,78,-62\n");
    let laboratory = plan.start();
    laboratory.stand_by();
    let reach = laboratory.status()["running"]["reach"].clone();
    let kpa = |key: &str, channel: usize| reach[key][channel].as_f64().unwrap();
    assert!((81.0..84.0).contains(&kpa("open_kpa", 0)) && (-64.0..-60.0).contains(&kpa("open_kpa", 1)), "{reach}");
    assert!(kpa("shut_kpa", 0) > 160.0 && kpa("shut_kpa", 1) < -90.0, "{reach}");
    let text = laboratory.ask(&["status"]).stdout;
    assert!(text.contains("with both vents wide open"), "{text}");
    let followed = laboratory.ask(&["reference", low.to_str().unwrap()]);
    laboratory.stand_by();
    let armed = laboratory.ask(&["arm"]);
    for ended in [followed, armed] {
        assert_eq!(ended.status, Some(0), "{ended:?}");
        for words in ["out of the rig's reach", "positive one asks for 78.0 kPa", "vent wide open", "kPa away"] {
            assert!(ended.stderr.contains(words), "`{words}` is not in {ended:?}");
        }
    }
    let high = laboratory.folder.write("high.csv", "time_s,ref_pos_kpa,ref_neg_kpa\n0,88,-70\n1,88,-70\n");
    let followed = laboratory.ask(&["reference", high.to_str().unwrap()]);
    assert!(followed.status == Some(0) && followed.stderr.is_empty(), "{followed:?}");
    laboratory.close();
}

/// In a chamber fifty times as large a pressure takes minutes to come to rest, and what the rig keeps at many places takes long to work
/// out. Worked out by whoever answers operators, it would hold a disarming for most of that.
#[test]
fn a_disarming_does_not_wait_behind_the_reach_of_a_reference() {
    let plan = Plan::new("policy.active = \"fallback\"\nrig.file = \"large.toml\"");
    let mut large = coarse("dual_pressure");
    large.volumes.values_mut().for_each(|volume| volume.volume_l *= 50.0);
    plan.folder.write("large.toml", large.to_toml().unwrap());
    let laboratory = plan.start();
    laboratory.stand_by();
    let low = laboratory.folder.write("low.csv", slow_reference(&SteadyMap::new(&large).unwrap()));
    let begun = Instant::now();
    let asking = Running::start(&mut laboratory.command(&["reference", low.to_str().unwrap()]));
    // A disarming in the tick that takes the reference would end it.
    while !laboratory.status()["running"]["reference"].as_str().is_some_and(|name| name.contains("low.csv")) {
        assert!(begun.elapsed() < SOON, "{}", laboratory.status());
    }
    let mut longest = Duration::ZERO;
    while asking.said(Out).is_empty() && asking.said(Err).is_empty() {
        let asked = Instant::now();
        let ended = laboratory.ask(&["disarm"]);
        longest = longest.max(asked.elapsed());
        assert_eq!(ended.status, Some(0), "{ended:?}");
        // The daemon prints 20 lines in a row and then two a second: the one about the reach is waited for below.
        std::thread::sleep(Duration::from_millis(100));
    }
    let took = begun.elapsed();
    let followed = asking.wait(SOON);
    assert!(followed.status == Some(0) && followed.stderr.contains("reach"), "{followed:?}");
    println!("the reference took {took:?}, a disarming at most {longest:?}");
    // Behind the reach it would take all but the little that reading the reference takes.
    assert!(longest < took / 2, "{longest:?} of {took:?}");
    // Also where its answer could not wait for it.
    laboratory.daemon.line(Err, "out of the rig's reach", SOON);
    laboratory.close();
}

/// The reference out of reach whose reach takes longest to work out here: of how many places it asks for hangs on how they fall into
/// the cells of which one is followed each.
fn slow_reference(map: &SteadyMap) -> String {
    let place = |n: u32| {
        let (pos_kpa, neg_kpa) = (5.0 + 7.0 * f64::from(n / 10), -5.0 - 5.5 * f64::from(n % 10));
        format!("{},{pos_kpa},{neg_kpa}\n", 0.25 * f64::from(n))
    };
    let reference = |places: u32| {
        let rows: String = (0..places).map(place).collect();
        let csv = format!("time_s,ref_pos_kpa,ref_neg_kpa\n{rows}");
        let reference = Reference::parse("low.csv", csv.as_bytes()).unwrap();
        let begun = Instant::now();
        assert!(beyond_reach(map, &reference).is_some());
        (begun.elapsed(), csv)
    };
    [25, 50, 75, 100].map(reference).into_iter().max().unwrap().1
}
