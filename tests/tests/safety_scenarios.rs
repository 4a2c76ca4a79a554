//! Scenarios of what must never happen, on the built daemon over a real socket: a cRIO that lies, falls silent, or has a rig behind
//! it that does not do what it is told. Sensors have a file of their own (`sensor_scenarios.rs`).
//!
//! In lockstep, so that nothing hangs on how busy the machine is: SENSE goes out, the answer comes, the plant moves on.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
#![allow(clippy::type_complexity, clippy::unnecessary_find_map)] // tables of cases say their shape where they stand

use std::process::Command;
use std::time::Duration;

use proto::emulator::SensorFault;
use proto::wire::{ByeReason, CrioState, Hello, Mode, Sense, TripBits};
use tests::Stream::Err;
use tests::raw_crio::Answer;
use tests::scene::{SOON, Scene};
use tests::{finish, program};

#[test]
fn what_the_crio_reports_is_checked_and_vents_within_three_ticks() {
    let cases: [(&str, fn(&mut Sense), &str); 8] = [
        ("echo", |s| s.duty = [0.5, 0.5], "reports a duty of 0.500"),
        ("one echo", |s| s.duty[1] = (s.duty[1] - 0.2).max(0.0), "that was not commanded"),
        ("NaN echo", |s| s.duty[0] = f32::NAN, "reports a duty of NaN"),
        ("no command in force", |s| s.command_in_force = 0, "reports command 0 in force"),
        ("an old command", |s| s.command_in_force -= 20, "which is none of the last"),
        ("idle", |s| s.state = CrioState::Idle, "reports state 0 although it is told to run"),
        ("pump off", |s| s.pump_running = false, "reports the pump off"),
        ("trip bits", |s| s.trips = TripBits::OVER_PRESSURE, "without having tripped"),
    ];
    for (name, spoil, words) in cases {
        let mut scene = Scene::under_control("dual_pressure");
        let ticks = scene.ticks_to_vent(10, |_, sense| spoil(sense));
        assert!(ticks <= 2, "{name}: {ticks}");
        scene.told("VENTED");
        scene.told(words);
        scene.check_latched();
        scene.end();
    }
}

#[test]
fn one_frame_that_disagrees_is_no_reason() {
    let mut scene = Scene::under_control("dual_pressure");
    for k in 0..60 {
        let mode = scene.spoilt(|sense| {
            if k % 10 < 2 {
                sense.duty = [0.5, 0.5];
            }
        });
        assert_eq!(mode, Some(Mode::Run), "tick {k}: {}", scene.daemon.said(Err));
    }
    scene.silent_about("VENTED");
    scene.end();
}

/// Never three frames in a row: a relay or a wire that makes contact now and then.
#[test]
fn what_is_wrong_off_and_on_vents_as_well() {
    let cases: [(&str, fn(u32, &mut Sense), &str); 5] = [
        ("echo, one of three", |k, s| s.duty[0] -= if k % 3 == 0 { 0.2 } else { 0.0 }, "that was not commanded"),
        ("pump, two of four", |k, s| s.pump_running = k % 4 > 1, "reports the pump off"),
        (
            "force, one of four",
            |k, s| s.command_in_force -= if k % 4 == 0 { 20 } else { 0 },
            "which is none of the last",
        ),
        ("reading, one of four", |k, s| s.volts[0] += if k % 4 == 0 { 0.2 } else { 0.0 }, "and model disagree"),
        ("commands missed, one of three", |k, s| s.commands_missed = (k / 3) as u16, "did not get 26 of the last 100"),
    ];
    for (name, spoil, words) in cases {
        let mut scene = Scene::under_control("dual_pressure");
        let ticks = scene.ticks_to_vent(110, spoil);
        println!("{name}: {ticks}");
        scene.told("VENTED");
        scene.told(words);
        scene.end();
    }
}

#[test]
fn an_operators_stop_is_never_undone_by_a_hello() {
    let mut scene = Scene::under_control("dual_pressure");
    scene.crio.trip(TripBits::OPERATOR_STOP);
    assert_eq!(scene.step(), Some(Mode::Vent));
    scene.told("operator stop");
    scene.check_latched();
    assert_eq!(scene.crio.hellos, 1, "{}", scene.daemon.said(Err));
    // Not even when the link is lost.
    scene.crio.cut();
    assert!(!scene.crio.open_within(Duration::from_secs(2)), "a HELLO came: {}", scene.daemon.said(Err));
    let status = scene.ask("status");
    assert!(status.stdout.contains("connecting") && status.stdout.contains("acknowledge"), "{status:?}");
    let acknowledged = scene.ask("acknowledge");
    assert_eq!(acknowledged.status, Some(0), "{acknowledged:?}");
    scene.crio.open();
    for _ in 0..100 {
        assert_eq!(scene.step(), Some(Mode::Vent), "acknowledged, and still a person arms");
    }
    let armed = scene.ask_while_stepping("arm");
    assert_eq!(armed.status, Some(0), "{armed:?} {}", scene.daemon.said(Err));
    scene.control(20);
    scene.end();
}

#[test]
fn a_stop_that_is_acknowledged_within_the_session_is_acknowledged_once() {
    let mut scene = Scene::under_control("dual_pressure");
    scene.crio.trip(TripBits::OPERATOR_STOP);
    assert_eq!(scene.step(), Some(Mode::Vent));
    let acknowledged = scene.ask_while_stepping("acknowledge");
    assert_eq!(acknowledged.status, Some(0), "{acknowledged:?}");
    scene.crio.open();
    for _ in 0..60 {
        assert_eq!(scene.step(), Some(Mode::Vent), "and still a person arms");
    }
    scene.silent_about("would undo that");
    let armed = scene.ask_while_stepping("arm");
    assert_eq!(armed.status, Some(0), "{armed:?} {}", scene.daemon.said(Err));
    scene.control(20);
    scene.end();
}

#[test]
fn lost_commands_alone_open_a_new_session() {
    let mut scene = Scene::under_control("dual_pressure");
    scene.crio.trip(TripBits::COMMAND_LOST);
    assert_eq!(scene.step(), Some(Mode::Vent));
    scene.crio.open();
    scene.control(20);
    assert_eq!(scene.crio.hellos, 2);
    scene.end();
}

#[test]
fn a_worse_cause_replaces_a_lesser_one_is_told_and_bars_arming() {
    let mut scene = Scene::under_control("dual_pressure");
    // A cause that clears by itself: the cRIO got no command.
    scene.crio.trip(TripBits::COMMAND_LOST);
    scene.step();
    scene.crio.open();
    for _ in 0..10 {
        scene.step();
    }
    // While it stands by with the vents open a sensor breaks.
    scene.crio.faults[1] = vec![SensorFault::NotANumber];
    scene.step();
    scene.crio.faults[1].clear();
    scene.told("negative sensor reads NaN V");
    // And while that is shown, somebody presses stop.
    for _ in 0..5 {
        scene.step();
    }
    scene.crio.trip(TripBits::OPERATOR_STOP);
    scene.step();
    scene.told("operator stop");
    scene.check_waits_for_a_person();
    scene.end();
}

#[test]
fn a_valve_that_sticks_is_a_fault_that_is_told_again_and_again() {
    let mut scene = Scene::under_control("dual_pressure");
    // The positive vent shuts for good, whatever is commanded.
    scene.crio.stuck_duty[0] = Some(0.0);
    let ticks = scene.ticks_to_vent(200, |_, _| ());
    // The pump is still on at the cRIO's side: a relay that sticks as well would be told by the pump bit.
    for _ in 0..700 {
        assert_eq!(scene.step(), Some(Mode::Vent), "it goes on venting");
    }
    scene.told("FAULT");
    scene.daemon.lines(Err, "STILL A FAULT", 2, SOON);
    println!("stuck vent: vented after {ticks} ticks");
    let status = scene.ask("status");
    assert!(status.stdout.contains("state      fault"), "{status:?}");
    scene.end();
}

#[test]
fn one_tick_far_ahead_moves_nothing_and_a_numbering_that_stays_wrong_vents() {
    let mut scene = Scene::under_control("dual_pressure");
    let duty = |answer: Answer| match answer {
        Answer::Command(command) => command.duty,
        other => panic!("{other:?}"),
    };
    let before = duty(scene.crio.step(|_| ()));
    // The frame is no frame: nothing answers it, and the next one is answered as if it had not been.
    let mut jumped = scene.crio.sense().unwrap();
    jumped.tick += 1_500;
    scene.crio.write(&jumped.encode());
    scene.crio.advance();
    let after = duty(scene.crio.step(|_| ()));
    assert!((0..2).all(|c| (before[c] - after[c]).abs() < 0.1), "{before:?} {after:?}");
    scene.control(5);
    scene.end();
}

#[test]
fn a_broken_stream_is_vented_said_bye_to_and_named() {
    let cases: [(&str, fn(&mut Vec<u8>), &str, ByeReason); 3] = [
        ("magic", |b| b[0] = 0x55, "wrong magic, type or length", ByeReason::ProtocolError),
        ("length", |b| b[7] = 63, "wrong magic, type or length", ByeReason::ProtocolError),
        ("version", |b| b[4] = 9, "protocol version 9", ByeReason::Version),
    ];
    for (name, spoil, words, reason) in cases {
        let mut scene = Scene::under_control("dual_pressure");
        let mut bytes = scene.crio.sense().unwrap().encode().to_vec();
        spoil(&mut bytes);
        scene.crio.write(&bytes);
        let vent = scene.crio.answer(SOON);
        assert!(matches!(vent, Answer::Command(c) if c.mode == Mode::Vent && c.duty == [1.0, 1.0]), "{name}: {vent:?}");
        assert_eq!(scene.crio.answer(SOON), Answer::Bye(reason), "{name}");
        scene.told(words);
        scene.crio.open();
        scene.end();
    }
}

#[test]
fn three_wrong_crcs_of_a_hundred_vent_and_close() {
    let mut scene = Scene::under_control("dual_pressure");
    let mut sent = 0;
    let closed = (0..100).find_map(|k| {
        if k % 20 == 10 {
            let mut bytes = scene.crio.sense().unwrap().encode();
            bytes[40] ^= 0x10;
            scene.crio.write(&bytes);
            scene.crio.advance();
            sent += 1;
        }
        match scene.crio.step(|_| ()) {
            Answer::Command(command) if command.mode == Mode::Run => None,
            _ => Some(k),
        }
    });
    assert_eq!((closed.is_some(), sent), (true, 3), "{}", scene.daemon.said(Err));
    scene.told("had a wrong CRC");
    scene.crio.cut();
    scene.crio.open();
    scene.end();
}

#[test]
fn a_flood_is_closed_and_named() {
    let mut scene = Scene::under_control("dual_pressure");
    // The same frame over and over: each is sound, none is new.
    let bytes = scene.crio.sense().unwrap().encode();
    let flood: Vec<u8> = bytes.iter().copied().cycle().take(64 * 64 * 64).collect();
    for _ in 0..8 {
        scene.crio.write(&flood);
    }
    scene.told("bytes came in one tick");
    scene.crio.cut();
    scene.crio.open();
    scene.end();
}

#[test]
fn status_without_a_link_says_so() {
    let mut scene = Scene::under_control("dual_pressure");
    scene.crio.cut();
    scene.told("the link to the cRIO is lost");
    let status = scene.ask("status");
    assert!(status.stdout.contains("connecting") && !status.stdout.contains("state      run"), "{status:?}");
    let json = finish(Command::new(program("controller")).args(["status", "--json", "--config"]).arg(&scene.config));
    assert!(json.stdout.contains("\"duty\":[1.0,1.0]") && json.stdout.contains("received_ns"), "{json:?}");
    scene.crio.open();
    scene.control(5);
    scene.end();
}

#[test]
fn what_would_not_be_recorded_does_not_arm_itself_and_says_so() {
    let mut scene = Scene::under_control("dual_pressure");
    // From now on no disk has room enough.
    let text = std::fs::read_to_string(&scene.config).unwrap();
    std::fs::write(&scene.config, text.clone() + "record.min_free_mib = 1048576\n").unwrap();
    scene.daemon.signal("HUP");
    scene.told("configuration read again");
    scene.wait_for_status("recording ", "shown");
    // A cause that clears by itself, after which it would arm itself again.
    scene.crio.trip(TripBits::COMMAND_LOST);
    scene.step();
    scene.crio.open();
    for tick in 0..150 {
        assert_eq!(scene.step(), Some(Mode::Vent), "tick {tick}: {}", scene.daemon.said(Err));
    }
    scene.told("not armed by itself");
    let refused = scene.ask_while_stepping("arm");
    assert!(refused.status == Some(1) && refused.stderr.contains("would not be recorded"), "{refused:?}");
    // There is room again.
    std::fs::write(&scene.config, text).unwrap();
    scene.daemon.signal("HUP");
    scene.daemon.lines(Err, "configuration read again", 2, SOON);
    for _ in 0..100 {
        if scene.step() == Some(Mode::Run) {
            break;
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    scene.control(20);
    scene.end();
}

/// Frames that a cRIO has no reason to send within a session: told for what it is, dropped, and a third within two seconds ends it.
#[test]
fn frames_that_have_no_place_in_a_session_are_told_and_dropped() {
    let mut scene = Scene::under_control("dual_pressure");
    let sense = scene.crio.sense().unwrap();
    let hello = Hello::new(sense.sequence, sense.clock_ns, sense.session, "somebody").encode();
    let command = proto::wire::Command {
        sequence: sense.sequence,
        clock_ns: sense.clock_ns,
        session: sense.session,
        tick: sense.tick,
        duty: [0.0, 0.0],
        mode: Mode::Run,
        ttl_ticks: 2,
        digital_outputs: 0,
    }
    .encode();
    let other = Sense { session: sense.session ^ 1, ..sense }.encode();
    scene.crio.write(&sense.encode());
    scene.crio.answer(SOON);
    scene.crio.advance();
    let misplaced: [(&[u8], &str); 2] = [(&hello, "sent a HELLO in the middle"), (&command, "sent a COMMAND")];
    for (bytes, words) in misplaced {
        scene.crio.write(bytes);
        for tick in 0..20 {
            assert_eq!(scene.step(), Some(Mode::Run), "{words} {tick}: {}", scene.daemon.said(Err));
        }
        scene.told(words);
    }
    scene.silent_about("came damaged");
    scene.crio.write(&other);
    scene.crio.step(|_| ());
    scene.told("which is not this one");
    scene.told("no place in the session; the link is closed");
    scene.crio.cut();
    scene.crio.open();
    scene.control(5);
    scene.end();
}
