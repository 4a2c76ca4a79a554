//! A cRIO that is odd without being plainly wrong, on the built daemon over a real socket: it repeats itself, runs a tick
//! behind, counts past the end of its numbers, swaps its outputs, changes its mind.
//!
//! In lockstep, so that nothing hangs on how busy the machine is: SENSE goes out, the answer comes, the plant moves on.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use proto::wire::{CrioState, Mode, Sense, TripBits};
use tests::Stream::Err;
use tests::scene::Scene;

/// Numbers a session's frames from here on instead.
fn renumbered(sense: &mut Sense, tick: u32, sequence: u32) {
    sense.tick = sense.tick.wrapping_add(tick);
    // Past the last number comes 1.
    sense.sequence = match sense.sequence.wrapping_add(sequence) {
        wrapped if wrapped < sense.sequence => wrapped + 1,
        number => number,
    };
}

#[test]
fn numbers_that_wrap_are_no_reason_to_vent() {
    let mut scene = Scene::start("dual_pressure", "");
    // The ends of both numbers come within the first hundred frames, under control.
    let first = scene.crio.sense().unwrap();
    let (tick, sequence) = (u32::MAX - 60 - first.tick, u32::MAX - 80 - first.sequence);
    let mut run = 0;
    for k in 0..300 {
        let mode = scene.spoilt(|sense| renumbered(sense, tick, sequence));
        run += u32::from(mode == Some(Mode::Run));
        assert!(run == 0 || mode == Some(Mode::Run), "frame {k}: {mode:?} {}", scene.daemon.said(Err));
    }
    assert!(run > 200, "{run}: {}", scene.daemon.said(Err));
    scene.silent_about("VENTED");
    scene.end();
}

#[test]
fn outputs_that_are_swapped_are_found_within_three_ticks_of_a_difference() {
    let mut scene = Scene::start("dual_pressure", "");
    let mut differing = 0;
    let mut run = 0;
    for _ in 0..400 {
        let mode = scene.spoilt(|sense| {
            differing += u32::from((sense.duty[0] - sense.duty[1]).abs() > 0.01);
            sense.duty.reverse();
        });
        run += u32::from(mode == Some(Mode::Run));
        if run > 0 && mode == Some(Mode::Vent) {
            break;
        }
    }
    assert!((1..=4).contains(&differing), "{differing} frames with swapped duties: {}", scene.daemon.said(Err));
    scene.told("that was not commanded");
    scene.end();
}

#[test]
fn a_frame_that_is_sent_twice_is_answered_once() {
    let mut scene = Scene::under_control("dual_pressure");
    for tick in 0..100 {
        let sense = scene.crio.sense().unwrap().encode();
        scene.crio.write(&sense);
        scene.crio.write(&sense);
        let answer = scene.crio.answer(tests::scene::SOON);
        assert!(matches!(answer, tests::raw_crio::Answer::Command(c) if c.mode == Mode::Run), "{tick}: {answer:?}");
        scene.crio.advance();
    }
    scene.silent_about("VENTED");
    scene.end();
}

#[test]
fn a_trip_bit_that_flickers_once_waits_for_a_person() {
    for (bits, state) in [
        (TripBits::OVER_PRESSURE, CrioState::Tripped),
        (TripBits::SENSOR, CrioState::Tripped),
        (TripBits::OPERATOR_STOP, CrioState::Running),
    ] {
        let mut scene = Scene::under_control("dual_pressure");
        let vented = scene.spoilt(|sense| (sense.trips, sense.state) = (bits, state));
        assert_eq!(vented, Some(Mode::Vent), "in the same tick");
        scene.check_waits_for_a_person();
        scene.end();
    }
}

#[test]
fn many_operators_at_once_end_disarmed_and_every_one_is_answered() {
    let mut scene = Scene::under_control("dual_pressure");
    let config = scene.config.clone();
    let asking: Vec<_> = (0..24)
        .map(|n| {
            let question = ["arm", "disarm", "status", "acknowledge"][n % 4];
            let mut command = std::process::Command::new(tests::program("controller"));
            command.args([question, "--config"]).arg(&config);
            std::thread::spawn(move || (question, tests::finish(&mut command)))
        })
        .collect();
    while asking.iter().any(|thread| !thread.is_finished()) {
        scene.step();
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    for thread in asking {
        let (question, ended) = thread.join().unwrap();
        assert!(matches!(ended.status, Some(0 | 1)), "{question}: {ended:?}");
        // Somebody else may have armed it again before the cRIO reported the vents open.
        let is_done = ended.status == Some(0) || ended.stderr.contains("armed again since");
        assert!(question != "disarm" || is_done, "a disarm is never refused: {ended:?}");
        assert!(ended.status == Some(0) || !ended.stderr.trim().is_empty(), "{question}: {ended:?}");
    }
    let disarmed = scene.ask_while_stepping("disarm");
    assert_eq!(disarmed.status, Some(0), "{disarmed:?}");
    for tick in 0..200 {
        assert_eq!(scene.step(), Some(Mode::Vent), "armed late at {tick}: {}", scene.daemon.said(Err));
    }
    scene.end();
}
