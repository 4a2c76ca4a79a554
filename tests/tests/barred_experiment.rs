//! Experiments that nobody stands beside any more: what is barred is not made up for later, and what was broken off is not
//! followed by arming.
//!
//! In lockstep, on a cRIO that steps when the test says so.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::process::Command;
use std::time::{Duration, Instant};

use controller::operator::socket::{Ask, Reply, ask};
use controller::state::{Condition, State};
use proto::wire::{Mode, Sense};
use tests::Stream::Err;
use tests::coarse_rigs::coarse;
use tests::program;
use tests::programme::{csv, programme};
use tests::scene::{SOON, Scene};

/// Ticks in which a rig that is at rest must have been found so: three means of half a second, and as much again.
const AT_REST: u32 = 150;

/// A positive reading that comes to no rest: a saw of 5 kPa, three of the means by which rest is known to a tooth.
fn restless(tick: u32, sense: &mut Sense) {
    sense.volts[0] = 1.0 + 0.02 * (tick % 75) as f32 / 75.0;
}

/// Asks while the cRIO goes on, each frame spoilt.
fn ask_while(scene: &mut Scene, question: Ask, mut spoil: impl FnMut(&mut Sense)) -> Reply {
    let socket = scene.folder.join("s");
    let asking = std::thread::spawn(move || ask(&socket, &question));
    while !asking.is_finished() {
        scene.spoilt(&mut spoil);
        std::thread::sleep(Duration::from_millis(1));
    }
    asking.join().unwrap().unwrap_or_else(|e| panic!("{e}: {}", scene.daemon.said(Err)))
}

/// Goes on until the status is as wanted, each frame spoilt.
fn wait_while(
    scene: &mut Scene,
    what: &str,
    wanted: impl Fn(&Reply) -> bool,
    mut spoil: impl FnMut(&mut Sense),
) -> Reply {
    let until = Instant::now() + SOON;
    loop {
        let reply = ask_while(scene, Ask::Status {}, &mut spoil);
        if wanted(&reply) {
            return reply;
        }
        assert!(Instant::now() < until, "not {what}: {reply:?}");
    }
}

/// Text of `controller status`, asked for while the cRIO goes on, each frame spoilt.
fn status_while(scene: &mut Scene, mut spoil: impl FnMut(&mut Sense)) -> String {
    let mut command = Command::new(program("controller"));
    command.args(["status", "--config"]).arg(&scene.config);
    let asking = std::thread::spawn(move || command.output());
    while !asking.is_finished() {
        scene.spoilt(&mut spoil);
        std::thread::sleep(Duration::from_millis(1));
    }
    let output = asking.join().unwrap().unwrap();
    format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
}

fn experiment(scene: &Scene) -> Ask {
    Ask::Experiment { file: scene.folder.join("e.csv"), csv: csv(&programme(300)) }
}

#[test]
fn an_experiment_that_is_barred_at_rest_ends_and_nothing_starts_once_the_bar_goes() {
    let mut scene = Scene::on(&coarse("dual_pressure"), "");
    (0..60).for_each(|_| _ = scene.step());
    let mut tick = 0;
    let mut saw = move |sense: &mut Sense| {
        tick += 1;
        restless(tick, sense);
    };
    let question = experiment(&scene);
    let begun = ask_while(&mut scene, question, &mut saw);
    assert!(begun.error.is_none(), "{begun:?}");
    // While it waits for rest the disk runs full.
    let text = std::fs::read_to_string(&scene.config).unwrap();
    std::fs::write(&scene.config, text.clone() + "record.min_free_mib = 1048576\n").unwrap();
    scene.daemon.signal("HUP");
    let barred = |reply: &Reply| reply.status.is_some_and(|s| s.bars_arming == Some(Condition::NotRecorded));
    wait_while(&mut scene, "barred", barred, &mut saw);
    let told = status_while(&mut scene, &mut saw);
    assert!(told.contains("waiting for rest") && told.contains("not be armed (not recorded)"), "{told}");
    for _ in 0..AT_REST {
        assert_eq!(scene.step(), Some(Mode::Vent), "{}", scene.daemon.said(Err));
    }
    let over = |reply: &Reply| reply.experiment.as_ref().is_some_and(|view| view.outcome.is_some());
    let reply = wait_while(&mut scene, "over", over, |_| ());
    let view = reply.experiment.unwrap();
    let why = view.outcome.and_then(|outcome| outcome.aborted).unwrap_or_default();
    assert!(why.contains("could not be armed") && why.contains("nothing would be recorded"), "{why}");
    assert_eq!(view.reached, 0);
    // There is room again, and nobody has asked for anything since.
    std::fs::write(&scene.config, text).unwrap();
    scene.daemon.signal("HUP");
    wait_while(&mut scene, "free to be armed", |reply| reply.status.is_some_and(|s| s.can_arm), |_| ());
    for _ in 0..2 * AT_REST {
        assert_eq!(scene.step(), Some(Mode::Vent), "started by itself: {}", scene.daemon.said(Err));
    }
    scene.end();
}

#[test]
fn auto_arm_does_not_follow_an_experiment_that_a_cut_link_broke_off() {
    let mut scene = Scene::start("dual_pressure", "");
    scene.control(60);
    let disarmed = scene.ask_while_stepping("disarm");
    assert_eq!(disarmed.status, Some(0), "{disarmed:?}");
    let question = experiment(&scene);
    let begun = ask_while(&mut scene, question, |_| ());
    assert!(begun.error.is_none(), "{begun:?}");
    let plays = (0..2 * AT_REST).any(|_| scene.step() == Some(Mode::Run));
    assert!(plays, "never played: {}", scene.daemon.said(Err));
    scene.crio.cut();
    scene.crio.open();
    for _ in 0..AT_REST {
        assert_eq!(scene.step(), Some(Mode::Vent), "armed by itself: {}", scene.daemon.said(Err));
    }
    scene.wait_for_state(State::Standby);
    scene.end();
}
