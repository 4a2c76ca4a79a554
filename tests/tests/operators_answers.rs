//! What operators are answered is so: of the vents, of the model in force, of what would be refused.
//!
//! In lockstep, so that nothing hangs on how busy the machine is.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::process::Command;
use std::time::{Duration, Instant};

use proto::wire::{Mode, Sense};
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
