//! A daemon that is killed, with no time for a last word, in the middle of an experiment: the cRIO vents by itself, who asked is
//! told, what was recorded can be read, and the next daemon stands by.
//!
//! In lockstep, so that nothing hangs on how busy the machine is.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::process::Command;
use std::time::Duration;

use controller::operator::socket::{Ask, ask};
use controller::state::State;
use model::rig::Rig;
use proto::recording::read_mcap;
use proto::wire::Mode;
use tests::Stream::Err;
use tests::programme::{csv, programme};
use tests::scene::{SOON, Scene};
use tests::{Running, program};

/// Ticks of a cRIO without a command after which its vents are open, by the wire protocol.
const VENTS_WITHIN: usize = 3;
/// Rows that are played before the daemon is killed.
const PLAYED: usize = 100;
/// Time after which what was recorded is on the disk (a second), for a machine that does other things as well; below the time after
/// which a silent cRIO counts as gone in lockstep.
const SYNCED: Duration = Duration::from_millis(2500);

fn controller(arguments: &[&str], scene: &Scene) -> Running {
    Running::start(Command::new(program("controller")).args(arguments).arg("--config").arg(&scene.config))
}

/// Recordings of a stem, finished or not.
fn recordings(scene: &Scene, stem: &str) -> Vec<String> {
    scene.folder.names("runs").into_iter().filter(|name| name.starts_with(stem)).collect()
}

/// Tests of the thorough tier (docs/testing.md).
mod thorough {
    use super::*;

    #[test]
    #[ignore = "thorough: docs/testing.md"]
    fn a_daemon_that_is_killed_within_an_experiment_leaves_a_vented_rig_and_a_recording() {
        let mut scene = Scene::on(&Rig::builtin("dual_pressure").unwrap(), "control.auto_arm = false");
        (0..30).for_each(|_| _ = scene.step());
        let file = scene.folder.write("e.csv", csv(&programme(3000)));
        let asking = controller(&["experiment", file.to_str().unwrap()], &scene);
        // The model simulates it first, and the rig comes to rest: both take their time.
        let mut played = 0;
        for _ in 0..100_000 {
            played += usize::from(scene.step() == Some(Mode::Run));
            if played == PLAYED {
                break;
            }
            if played == 0 {
                std::thread::sleep(Duration::from_millis(1));
            }
        }
        assert_eq!(played, PLAYED, "{} {}", scene.daemon.said(Err), asking.said(Err));
        let (duty, pump_on) = scene.crio.applied();
        assert!(pump_on && duty != [1.0, 1.0], "{duty:?}");

        std::thread::sleep(SYNCED);
        scene.daemon.signal("KILL");
        // As if nobody told the cRIO that the link is gone: it counts the commands that do not come.
        let vented = (1..=VENTS_WITHIN).find(|_| {
            scene.crio.sense();
            scene.crio.advance();
            scene.crio.applied() == ([1.0, 1.0], false)
        });
        assert!(vented.is_some(), "{:?}", scene.crio.applied());

        let asked = asking.wait(SOON);
        let line = asked.stderr.lines().last().unwrap_or_default();
        assert_eq!(asked.status, Some(1), "{asked:?}");
        assert!(line.contains("controller"), "who asked is told in one line: {asked:?}");

        for stem in ["run-", "experiment-"] {
            let [unfinished] = &recordings(&scene, stem)[..] else { panic!("{:?}", scene.folder.names("runs")) };
            assert!(unfinished.ends_with(".partial.mcap"), "{unfinished}");
            let content = read_mcap(&scene.folder.join("runs").join(unfinished)).unwrap();
            let rows = content.ticks.iter().filter(|tick| tick.experiment == 2).count();
            assert!(!content.complete && rows >= PLAYED, "{unfinished}: {rows} rows, {:?}", content.notes);
        }

        // The next one: nothing is armed, nothing is played, a recording of its own.
        scene.crio.cut();
        scene.daemon = controller(&["run"], &scene);
        scene.crio.open();
        for _ in 0..150 {
            assert_eq!(scene.step(), Some(Mode::Vent), "{}", scene.daemon.said(Err));
        }
        scene.wait_for_state(State::Standby);
        let reply = ask(&scene.folder.join("s"), &Ask::Status {}).unwrap();
        assert!(reply.experiment.is_none(), "{:?}", reply.experiment);
        assert_eq!(recordings(&scene, "run-").len(), 2, "{:?}", scene.folder.names("runs"));
        let armed = scene.ask_while_stepping("arm");
        assert_eq!(armed.status, Some(0), "{armed:?}");
        scene.control(20);
        scene.end();
    }
}
