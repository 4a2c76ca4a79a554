//! Orders of operators while there is no session count in the run, so it counts in its replay: an acknowledgement before the next
//! session leaves nothing to wait for, a disarming keeps the rig from arming itself.
//!
//! In lockstep, so that nothing hangs on how busy the machine is.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::path::PathBuf;
use std::process::Command;
use std::time::{Duration, Instant};

use controller::operator::socket::{Ask, ask};
use controller::state::State;
use proto::emulator::PSE540A_R06;
use proto::recording::{TickInput, read_mcap};
use proto::wire::{CrioState, Mode, TripBits};
use serde_json::Value;
use tests::raw_crio::Answer;
use tests::scene::{SOON, Scene};
use tests::{Folder, finish, program};

/// Ticks of the next session that are compared: ten times as many as it takes until the rig can be armed.
const NEXT_SESSION: u32 = 250;
/// Longer than the daemon waits for the answer to a HELLO, and the pause behind it, in which it takes what was asked for.
const NO_ANSWER: Duration = Duration::from_millis(1_500);
/// Long enough for the pauses between the daemon's attempts to grow to 2 s, in which it takes more requests than a record holds.
const PRESSED: Duration = Duration::from_secs(9);
/// Far longer than the 20 ms between two looks for requests, so that each is taken by itself.
const BETWEEN_PRESSES: Duration = Duration::from_millis(200);

/// Asks the daemon, without the program that does so for a person: the pause between two sessions is short.
fn asked(scene: &Scene, what: &Ask) {
    let reply = ask(&scene.folder.join("s"), what).unwrap();
    assert!(reply.ok, "{reply:?}");
}

/// Opens the next session; HELLOs that the daemon has given up meanwhile lie before its own.
fn next_session(scene: &mut Scene) -> Mode {
    for _ in 0..20 {
        scene.crio.open();
        if let Some(mode) = scene.step() {
            return mode;
        }
    }
    panic!("no session");
}

/// Ends the daemon and replays its run: each bit as it was, and this was asked for before the second session.
fn check_replay(mut scene: Scene, before_session: &[TickInput]) {
    let kept = std::mem::replace(&mut scene.folder, Folder::new());
    scene.end();
    let runs = std::fs::read_dir(kept.join("runs")).unwrap().map(|entry| entry.unwrap().path());
    let runs: Vec<PathBuf> = runs.filter(|path| path.extension().is_some_and(|ending| ending == "mcap")).collect();
    let [run] = &runs[..] else { panic!("{runs:?}") };
    let ticks = read_mcap(run).unwrap().ticks;
    let opened = |inputs: &Vec<TickInput>| inputs.contains(&TickInput::SessionOpened);
    let sessions: Vec<Vec<TickInput>> =
        ticks.iter().map(|tick| TickInput::of(tick.inputs).collect()).filter(opened).collect();
    assert!(sessions.len() == 2 && sessions[1] == before_session, "{sessions:?}");
    let ended = finish(Command::new(program("controller")).args(["replay", "--json"]).arg(run));
    let found: Value = serde_json::from_str(&ended.stdout).unwrap_or_else(|e| panic!("{e}: {ended:?}"));
    assert_eq!((&found["ticks"], &found["ticks_differing"]), (&ticks.len().into(), &0.into()), "{found}");
}

#[test]
fn an_acknowledgement_before_the_session_that_follows_a_trip_is_replayed() {
    let mut scene = Scene::under_control("dual_pressure");
    // 170 kPa in one frame, beyond the limit of 160.
    let over = scene.spoilt(|sense| sense.volts[0] = PSE540A_R06.volts(170.0) as f32);
    assert_eq!(over, Some(Mode::Vent));
    (0..10).for_each(|_| assert_eq!(scene.step(), Some(Mode::Vent)));
    scene.spoilt(|sense| (sense.state, sense.trips) = (CrioState::Tripped, TripBits::COMMAND_LOST));
    let bye = scene.crio.answer(SOON);
    assert!(matches!(bye, Answer::Bye(_)), "{bye:?}");
    asked(&scene, &Ask::Acknowledge {});
    next_session(&mut scene);
    (0..NEXT_SESSION).for_each(|_| assert_eq!(scene.step(), Some(Mode::Vent), "never armed by itself again"));
    scene.wait_for_state(State::Standby);
    check_replay(scene, &[TickInput::Acknowledge, TickInput::SessionOpened]);
}

#[test]
fn a_disarming_without_a_session_is_replayed() {
    let mut scene = Scene::under_control("dual_pressure");
    scene.crio.cut();
    scene.wait_for_state(State::Connect);
    // Pressed again and again, which is as good as once: a record has no room for each.
    let until = Instant::now() + PRESSED;
    while Instant::now() < until {
        asked(&scene, &Ask::Disarm {});
        std::thread::sleep(BETWEEN_PRESSES);
    }
    std::thread::sleep(NO_ANSWER);
    next_session(&mut scene);
    (0..NEXT_SESSION).for_each(|_| assert_eq!(scene.step(), Some(Mode::Vent), "armed although it was disarmed"));
    check_replay(scene, &[TickInput::LinkLost, TickInput::Disarm, TickInput::SessionOpened]);
}
