//! The emulated cRIO over a real loopback socket, in lockstep: sessions, and what does not count.

// A test may stop at the first thing that is not as it must be; helpers here are part of tests.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod emulator_client;

use std::io::Write;
use std::time::{Duration, Instant};

use emulator_client::{Client, FirstOrderRig, Nothing, SESSION, lockstep, start};
use proto::emulator::{
    CrioConfig, EmulatedPlant, Emulator, EmulatorConfig, EmulatorError, Event, PSE540A_R06, PSE541A_R06, Pace, Watched,
    channel_watcher,
};
use proto::wire::{ByeReason, Command, CrioState, Frame, Hello, Mode, TripBits};

/// Half a step of the converter in kPa, and its rounding: what a noiseless reading may be off by.
const READING_KPA: f64 = 0.5 * 20.0 / 65536.0 / 4.0 * 1000.0 + 1e-6;

#[test]
fn shakes_hands_and_starts_idle_at_tick_zero() {
    let emulator = start(lockstep());
    let mut client = Client::connect(emulator.local_addr());
    let answer = client.shake();
    assert_eq!((answer.session, answer.sequence), (SESSION, 1));
    assert_eq!((answer.sensors, answer.valves, answer.min_version, answer.max_version), (2, 2, 1, 1));
    assert_eq!(answer.name_text(), "emulated cRIO");
    let sense = client.sense();
    assert_eq!((sense.session, sense.tick, sense.sequence, sense.clock_ns), (SESSION, 0, 2, 0));
    assert_eq!((sense.command_in_force, sense.duty, sense.state), (0, [1.0, 1.0], CrioState::Idle));
    // 1 V, rounded to the converter's step.
    assert!(sense.volts[..2].iter().all(|volts| (volts - 1.0).abs() < 0.000_16));
    assert!(sense.volts[2].is_nan() && sense.volts[3].is_nan());
}

/// 60 s of plant time: every answer drives the rig over the whole tick after it, and every SENSE
/// reports the answer before it.
#[test]
fn a_minute_in_lockstep_follows_the_rig_step_by_step_and_takes_seconds() {
    let emulator = start(lockstep());
    let mut client = Client::open(emulator.local_addr());
    let mut rig = FirstOrderRig::default();
    let begin = Instant::now();
    let mut last = None;
    for tick in 0..3000_u32 {
        let sense = client.sense();
        assert_eq!((sense.tick, sense.clock_ns), (tick, u64::from(tick) * 20_000_000));
        assert_eq!(sense.commands_missed, 0);
        for (channel, scale) in [PSE540A_R06, PSE541A_R06].into_iter().enumerate() {
            let read = scale.gauge_kpa(f64::from(sense.volts[channel]));
            assert!((read - rig.kpa[channel]).abs() < READING_KPA, "tick {tick}: {read} and {:?}", rig.kpa);
        }
        if let Some(Command { sequence, duty, .. }) = last {
            assert_eq!((sense.command_in_force, sense.duty, sense.state), (sequence, duty, CrioState::Running));
        }
        let duty = [(tick % 97) as f32 / 96.0, (tick % 31) as f32 / 30.0];
        last = Some(client.run(tick, duty));
        rig.tick(duty.map(f64::from), true);
    }
    // A second or two in practice; the limit only tells lockstep from real time's 60 s.
    assert!(begin.elapsed() < Duration::from_secs(20), "{:?}", begin.elapsed());
    client.sense();
    let statistics = emulator.statistics();
    assert_eq!((statistics.commands_taken, statistics.missed, statistics.rejected()), (3000, 0, 0));
    assert_eq!((statistics.senses, statistics.sessions), (3001, 1));
}

#[test]
fn what_does_not_count_is_counted_and_changes_nothing() {
    let emulator = start(lockstep());
    let mut client = Client::open(emulator.local_addr());
    client.sense();
    client.run(0, [0.5, 0.25]);
    let in_force = client.sense();
    assert_eq!(in_force.duty, [0.5, 0.25]);
    // Three commands that do not count, then the sound one for the same tick.
    let wrong_session = Command { session: SESSION + 1, ..client.run_command(1, [0.0, 0.0]) };
    client.send(&wrong_session.encode());
    let repeated = Command { sequence: in_force.command_in_force, ..client.run_command(999, [0.0, 0.0]) };
    client.send(&repeated.encode());
    let not_a_number = client.run_command(999, [f32::NAN, 0.0]);
    client.send(&not_a_number.encode());
    let sound = client.run(1, [0.125, 0.75]);
    let sense = client.sense();
    assert_eq!((sense.tick, sense.duty, sense.command_in_force), (2, [0.125, 0.75], sound.sequence));
    // Alone, a NaN ends the tick in lockstep, but does not count.
    let not_a_number = client.run_command(2, [f32::NAN, 0.0]);
    client.send(&not_a_number.encode());
    let sense = client.sense();
    assert_eq!((sense.tick, sense.duty, sense.commands_missed), (3, [0.125, 0.75], 1));
    let statistics = emulator.statistics();
    assert_eq!((statistics.rejected_session, statistics.rejected_sequence, statistics.rejected_duty), (1, 1, 2));
    assert_eq!((statistics.commands_taken, statistics.missed), (2, 1));
}

#[test]
fn a_damaged_command_is_dropped_and_the_link_goes_on() {
    let emulator = start(lockstep());
    let mut client = Client::open(emulator.local_addr());
    client.sense();
    let mut bytes = client.run_command(0, [0.5, 0.5]).encode();
    bytes[30] ^= 1;
    client.send(&bytes);
    assert_eq!(client.sense().commands_missed, 1);
    client.run(1, [0.5, 0.5]);
    assert_eq!(client.sense().state, CrioState::Running);
    let statistics = emulator.statistics();
    assert_eq!((statistics.damaged, statistics.waits_over), (1, 0), "a damaged answer is not waited for again");
}

#[test]
fn frames_split_and_joined_in_any_way_arrive() {
    let emulator = start(lockstep());
    let mut client = Client::open(emulator.local_addr());
    client.sense();
    let command = client.run_command(0, [0.5, 0.5]).encode();
    for byte in command {
        client.stream.write_all(&[byte]).unwrap();
    }
    assert_eq!(client.sense().duty, [0.5, 0.5]);
    // Two commands in one write: both count, the second is in force.
    let mut joined = client.run_command(0, [0.1, 0.1]).encode().to_vec();
    joined.extend(client.run_command(1, [0.2, 0.2]).encode());
    client.send(&joined);
    assert_eq!(client.sense().duty, [0.2, 0.2]);
    assert_eq!(emulator.statistics().commands_taken, 3);
}

#[test]
fn a_daemon_without_answers_is_vented_after_its_time_to_live_and_a_new_hello_starts_again() {
    let wait = Duration::from_millis(30);
    let emulator = start(EmulatorConfig { pace: Pace::Lockstep { wait }, ..lockstep() });
    let mut client = Client::open(emulator.local_addr());
    client.sense();
    client.run(0, [0.0, 0.0]);
    let states: Vec<_> = (0..4)
        .map(|_| client.sense())
        .map(|sense| (sense.tick, sense.state, sense.duty[0], sense.trips, sense.pump_running))
        .collect();
    assert_eq!(
        states,
        [
            (1, CrioState::Running, 0.0, TripBits::NONE, true),
            (2, CrioState::Running, 0.0, TripBits::NONE, true),
            (3, CrioState::Tripped, 1.0, TripBits::COMMAND_LOST, false),
            (4, CrioState::Tripped, 1.0, TripBits::COMMAND_LOST, false),
        ]
    );
    assert_eq!(emulator.statistics().trips_command_lost, 1);
    // A new HELLO on the same link; a SENSE of the old session may still be on its way.
    client.session = SESSION + 1;
    let hello = Hello::new(client.sequence.advance(), 1, client.session, "again");
    client.send(&hello.encode());
    let answer = loop {
        if let Frame::Hello(answer) = client.frame().unwrap() {
            break answer;
        }
    };
    assert_eq!(answer.session, SESSION + 1);
    let sense = client.sense();
    assert_eq!((sense.session, sense.tick, sense.state), (SESSION + 1, 0, CrioState::Idle));
    client.run(0, [0.5, 0.5]);
    assert_eq!(client.sense().state, CrioState::Running);
}

#[test]
fn over_pressure_is_the_crios_own_trip() {
    let crio = CrioConfig { over_pressure_kpa: 100.0, ..CrioConfig::default() };
    let emulator = start(EmulatorConfig { crio, ..lockstep() });
    let mut client = Client::open(emulator.local_addr());
    let mut rig = FirstOrderRig::default();
    for tick in 0..100 {
        let sense = client.sense();
        let tripped = rig.kpa[0] >= 100.0;
        assert_eq!(sense.state == CrioState::Tripped, tripped, "tick {tick} at {} kPa", rig.kpa[0]);
        if tripped {
            assert_eq!((sense.trips, sense.duty), (TripBits::OVER_PRESSURE, [1.0, 1.0]));
            // Half of 200 kPa at 0.25 s: after ln 2 × 12.5 ticks.
            assert_eq!(tick, 9);
            return;
        }
        client.run(tick, [0.0, 0.0]);
        rig.tick([0.0, 0.0], true);
    }
    panic!("it never tripped");
}

#[test]
fn hellos_that_cannot_be_are_answered_with_bye() {
    let emulator = start(lockstep());
    let sound = Hello::new(1, 0, SESSION, "test");
    let refused = [
        (Hello { min_version: 2, max_version: 9, ..sound }, ByeReason::Version),
        (Hello { rate_millihertz: 100_000, ..sound }, ByeReason::ProtocolError),
        (Hello { sensors: 1, ..sound }, ByeReason::ProtocolError),
        (Hello { valves: 1, ..sound }, ByeReason::ProtocolError),
        (Hello { session: 0, ..sound }, ByeReason::ProtocolError),
    ];
    for (hello, reason) in refused {
        let mut client = Client::connect(emulator.local_addr());
        client.send(&hello.encode());
        let bye = client.bye();
        assert_eq!((bye.reason, bye.session), (reason, hello.session));
        assert_eq!(client.frame(), Err(Nothing::Closed));
    }
    assert_eq!(emulator.statistics().hellos_refused, 5);
    // And the next one is served.
    Client::open(emulator.local_addr()).sense();
}

#[test]
fn a_broken_stream_is_answered_with_bye() {
    let emulator = start(lockstep());
    let mut other_version = Hello::new(1, 0, SESSION, "test").encode();
    other_version[4] = 2;
    for (bytes, reason) in [
        (other_version.as_slice(), ByeReason::Version),
        (b"GET / HTTP/1.1\r\n\r\n".as_slice(), ByeReason::ProtocolError),
        (
            &proto::wire::Bye { sequence: 1, clock_ns: 0, session: 0, reason: ByeReason::Normal }.encode()[..7],
            ByeReason::Normal,
        ),
    ] {
        let mut client = Client::connect(emulator.local_addr());
        client.send(bytes);
        if reason == ByeReason::Normal {
            // Seven bytes of a sound frame are no damage: it waits for the rest.
            client.stream.set_read_timeout(Some(Duration::from_millis(200))).unwrap();
            assert_eq!(client.frame(), Err(Nothing::Silence));
        } else {
            assert_eq!(client.bye().reason, reason);
            assert_eq!(client.frame(), Err(Nothing::Closed));
        }
    }
    assert_eq!(emulator.statistics().damaged, 2);
}

#[test]
fn hellos_within_a_session() {
    let emulator = start(lockstep());
    let mut client = Client::connect(emulator.local_addr());
    let hello = Hello::new(client.sequence.advance(), 1, SESSION, "test");
    client.send(&hello.encode());
    client.send(&hello.encode());
    assert!(matches!(client.frame(), Ok(Frame::Hello(_))));
    client.sense();
    client.run(0, [0.5, 0.5]);
    assert_eq!(client.sense().tick, 1, "the same HELLO again was ignored");
    let again = Hello::new(client.sequence.advance(), 1, SESSION, "test");
    client.send(&again.encode());
    assert_eq!(client.bye().reason, ByeReason::ProtocolError);
}

#[test]
fn a_sense_from_the_daemon_is_an_error() {
    let emulator = start(lockstep());
    let mut client = Client::open(emulator.local_addr());
    let sense = client.sense();
    client.send(&sense.encode());
    assert_eq!(client.bye().reason, ByeReason::ProtocolError);
}

#[test]
fn bye_and_link_loss_end_the_session_and_time_stands_still_until_the_next() {
    let (watcher, watched, dropped) = channel_watcher(1000);
    let emulator = Emulator::bind("127.0.0.1:0", lockstep(), Box::new(FirstOrderRig::default()))
        .unwrap()
        .watched_by(watcher)
        .start()
        .unwrap();
    let mut client = Client::open(emulator.local_addr());
    for tick in 0..10 {
        client.sense();
        client.run(tick, [0.0, 0.0]);
    }
    let reached = client.sense();
    let bye = proto::wire::Bye {
        sequence: client.sequence.advance(),
        clock_ns: 0,
        session: SESSION,
        reason: ByeReason::Operator,
    };
    client.send(&bye.encode());
    assert_eq!(client.frame(), Err(Nothing::Closed));
    let mut client = Client::open_session(emulator.local_addr(), SESSION + 1);
    let sense = client.sense();
    assert_eq!((sense.tick, sense.state, sense.duty, sense.sequence), (0, CrioState::Idle, [1.0, 1.0], 2));
    assert_eq!(sense.volts[..2], reached.volts[..2], "no time passed");
    drop(client);
    let mut client = Client::open_session(emulator.local_addr(), SESSION + 2);
    assert_eq!(client.sense().volts[..2], reached.volts[..2]);
    emulator.stop();
    assert_eq!(client.bye().reason, ByeReason::Normal);
    let statistics = emulator.join().unwrap();
    assert_eq!((statistics.sessions, statistics.links_lost), (3, 1));
    // The watcher saw every edge and every event, in order, with the truth behind the readings.
    assert_eq!(dropped.load(std::sync::atomic::Ordering::Relaxed), 0);
    let watched: Vec<_> = watched.iter().collect();
    let mut rig = FirstOrderRig::default();
    let truths: Vec<_> =
        watched.iter().filter_map(|w| if let Watched::Tick(truth) = w { Some(*truth) } else { None }).collect();
    assert_eq!(truths.len(), 13);
    for (edge, truth) in truths.iter().take(11).enumerate() {
        assert_eq!((truth.edge, truth.session_tick), (edge as u64, Some((SESSION, edge as u32))));
        assert_eq!(truth.pressures_kpa, rig.kpa);
        assert_eq!(truth.duty, if edge == 0 { [1.0, 1.0] } else { [0.0, 0.0] });
        rig.tick([0.0, 0.0], true);
    }
    assert!(watched.contains(&Watched::Event(Event::Bye(ByeReason::Operator))));
    assert!(
        watched
            .contains(&Watched::Event(Event::SessionOpened { session: SESSION + 2, name: "test client".to_owned() }))
    );
}

#[test]
fn mode_vent_and_hold_reach_the_rig() {
    let emulator = start(lockstep());
    let mut client = Client::open(emulator.local_addr());
    client.sense();
    let hold = Command { mode: Mode::Hold, ..client.run_command(0, [0.0, 0.0]) };
    client.send(&hold.encode());
    let held = client.sense();
    assert_eq!(held.state, CrioState::Holding);
    let vent = Command { mode: Mode::Vent, ..client.run_command(1, [0.0, 0.0]) };
    client.send(&vent.encode());
    let vented = client.sense();
    assert_eq!((vented.state, vented.duty), (CrioState::Idle, [1.0, 1.0]));
    assert!(vented.volts[0] < held.volts[0], "the positive pressure falls");
}

#[test]
fn one_client_at_a_time_but_a_silent_one_makes_room() {
    let emulator = start(lockstep());
    let mut first = Client::open(emulator.local_addr());
    first.sense();
    let mut second = Client::connect(emulator.local_addr());
    assert_eq!(second.bye().reason, ByeReason::ProtocolError);
    assert_eq!(second.frame(), Err(Nothing::Closed));
    first.run(0, [0.5, 0.5]);
    assert_eq!(first.sense().state, CrioState::Running, "the first one was not disturbed");
    std::thread::sleep(Duration::from_millis(1100));
    let mut third = Client::open_session(emulator.local_addr(), SESSION + 1);
    assert_eq!(third.sense().session, SESSION + 1);
    assert_eq!(emulator.statistics().turned_away, 1);
}

#[test]
fn an_address_that_cannot_be_had_is_named() {
    let emulator = start(lockstep());
    let taken = emulator.local_addr().to_string();
    let error = Emulator::bind(&taken, lockstep(), Box::new(FirstOrderRig::default())).err().unwrap();
    assert!(matches!(error, EmulatorError::Bind { .. }));
    assert!(error.to_string().starts_with(&format!("cannot listen on {taken}: ")), "{error}");
    assert!(Emulator::bind("nowhere", lockstep(), Box::new(FirstOrderRig::default())).is_err());
}

#[test]
fn a_rig_that_panics_is_an_error_not_a_hang() {
    struct Broken;
    impl EmulatedPlant for Broken {
        fn tick(&mut self, _duty: [f64; 2], _pump_on: bool) {
            panic!("on purpose");
        }
        fn pressures_gauge_kpa(&self) -> [f64; 2] {
            [0.0; 2]
        }
    }
    let emulator = Emulator::bind("127.0.0.1:0", lockstep(), Box::new(Broken)).unwrap().start().unwrap();
    let mut client = Client::open(emulator.local_addr());
    client.sense();
    client.run(0, [0.5, 0.5]);
    assert_eq!(client.frame(), Err(Nothing::Closed));
    assert!(matches!(emulator.join(), Err(EmulatorError::Panicked)));
}
