//! The cRIO's rules one by one, on the state machine alone.

// A test may stop at the first thing that is not as it must be; helpers here are part of tests.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use proto::emulator::{Crio, CrioConfig, PSE540A_R06, Rejection};
use proto::wire::{Command, CrioState, Hello, HelloRefusal, Mode, Sense, TripBits};

const SESSION: u32 = 77;
const AMBIENT: [f32; 4] = [1.0, 1.0, f32::NAN, f32::NAN];

fn open() -> Crio {
    let mut crio = Crio::new(CrioConfig::default());
    crio.hello(&Hello::new(1, 0, SESSION, "test"), 1, 0).unwrap();
    crio
}

fn command(sequence: u32) -> Command {
    Command {
        sequence,
        clock_ns: 0,
        session: SESSION,
        tick: 0,
        duty: [0.25, 0.5],
        mode: Mode::Run,
        ttl_ticks: 2,
        digital_outputs: Command::PUMP_ON,
    }
}

fn edge(crio: &mut Crio) -> Sense {
    crio.edge(AMBIENT, 1, 0).unwrap()
}

#[track_caller]
fn vented(sense: &Sense, state: CrioState, trips: TripBits) {
    assert_eq!((sense.duty, sense.state, sense.trips), ([1.0, 1.0], state, trips));
    assert_eq!((sense.pump_running, sense.command_in_force), (false, 0));
}

#[test]
fn without_a_session_it_is_vented_and_silent() {
    let mut crio = Crio::new(CrioConfig::default());
    assert_eq!(crio.actuation().duty, [1.0, 1.0]);
    assert!(!crio.actuation().pump_on);
    assert_eq!(crio.edge(AMBIENT, 1, 0), None);
    assert_eq!(crio.command(&command(2)), Err(Rejection::Session { found: SESSION, open: None }));
}

#[test]
fn hello_is_answered_with_its_session_and_the_crios_own_channels() {
    let mut crio = Crio::new(CrioConfig { sensors: 4, name: "bench".to_owned(), ..CrioConfig::default() });
    let answer = crio.hello(&Hello::new(9, 0, SESSION, "test"), 5, 6).unwrap();
    assert_eq!((answer.sequence, answer.clock_ns, answer.session), (5, 6, SESSION));
    assert_eq!((answer.sensors, answer.valves, answer.rate_millihertz), (4, 2, 50_000));
    assert_eq!(answer.name_text(), "bench");
}

#[test]
fn a_refused_hello_opens_nothing_and_ends_what_was_open() {
    let mut crio = open();
    let refused = Hello { max_version: 3, min_version: 2, ..Hello::new(2, 0, 78, "test") };
    assert_eq!(crio.hello(&refused, 1, 0), Err(HelloRefusal::NoCommonVersion { min: 2, max: 3 }));
    assert_eq!(crio.session(), None);
}

#[test]
fn a_session_starts_idle_at_tick_zero_and_waits_for_its_first_command_without_a_trip() {
    let mut crio = open();
    for tick in 0..20 {
        let sense = edge(&mut crio);
        assert_eq!((sense.tick, u32::from(sense.commands_missed)), (tick, tick));
        vented(&sense, CrioState::Idle, TripBits::NONE);
    }
}

#[test]
fn a_command_is_in_force_from_its_receipt_on() {
    let mut crio = open();
    edge(&mut crio);
    crio.command(&command(2)).unwrap();
    assert_eq!(crio.actuation().duty, [0.25, 0.5]);
    assert!(crio.actuation().pump_on);
    let sense = edge(&mut crio);
    assert_eq!((sense.duty, sense.state, sense.command_in_force), ([0.25, 0.5], CrioState::Running, 2));
    assert!(sense.pump_running);
    assert_eq!(sense.commands_missed, 0);
    crio.command(&Command { mode: Mode::Hold, digital_outputs: 0, ..command(3) }).unwrap();
    let sense = edge(&mut crio);
    assert_eq!((sense.duty, sense.state, sense.pump_running), ([0.25, 0.5], CrioState::Holding, false));
    // Vent opens both vents whatever duty it carries, and is idle, with that command in force.
    crio.command(&Command { mode: Mode::Vent, ..command(4) }).unwrap();
    let sense = edge(&mut crio);
    assert_eq!((sense.duty, sense.state, sense.command_in_force), ([1.0, 1.0], CrioState::Idle, 4));
}

#[test]
fn without_a_relay_the_pump_always_runs() {
    let mut crio = Crio::new(CrioConfig { pump_relay: false, ..CrioConfig::default() });
    assert!(crio.actuation().pump_on);
    crio.hello(&Hello::new(1, 0, SESSION, "test"), 1, 0).unwrap();
    crio.command(&Command { digital_outputs: 0, ..command(2) }).unwrap();
    assert!(edge(&mut crio).pump_running);
    crio.trip(TripBits::OPERATOR_STOP);
    assert!(crio.actuation().pump_on);
}

#[test]
fn what_does_not_count_changes_nothing() {
    let mut crio = open();
    edge(&mut crio);
    crio.command(&command(10)).unwrap();
    let before = edge(&mut crio);
    let wrong_session = Command { session: SESSION + 1, ..command(11) };
    assert_eq!(crio.command(&wrong_session), Err(Rejection::Session { found: SESSION + 1, open: Some(SESSION) }));
    for old in [10, 9, 1, 0] {
        assert_eq!(crio.command(&command(old)), Err(Rejection::Sequence { found: old, last: 10 }));
    }
    let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -0.000_1, 1.000_1, 2.0];
    for duty in bad.iter().flat_map(|bad| [[*bad, 0.5], [0.5, *bad]]) {
        assert!(matches!(crio.command(&Command { duty, ..command(11) }), Err(Rejection::Duty { .. })), "{duty:?}");
    }
    let after = edge(&mut crio);
    assert_eq!((after.duty, after.state, after.command_in_force), (before.duty, before.state, 10));
    assert_eq!(after.commands_missed, 1, "none of them counted");
    // The ends of the range are in it, and so is -0.
    crio.command(&Command { duty: [0.0, 1.0], ..command(11) }).unwrap();
    crio.command(&Command { duty: [-0.0, 1.0], ..command(12) }).unwrap();
}

#[test]
fn sequence_numbers_wrap() {
    let mut crio = Crio::new(CrioConfig::default());
    crio.hello(&Hello::new(0xFFFF_FFFE, 0, SESSION, "test"), 1, 0).unwrap();
    for sequence in [0xFFFF_FFFF, 1, 2] {
        crio.command(&command(sequence)).unwrap();
    }
    assert!(crio.command(&command(0xFFFF_FFFF)).is_err());
}

/// The command answers SENSE 0; `ttl` whole ticks without one must pass, tick 0 had one.
#[test]
fn a_lost_daemon_trips_after_its_time_to_live() {
    // Out of range: 0 is taken as 1, above 5 as 5.
    for (ttl, lives) in [(1, 1), (2, 2), (5, 5), (0, 1), (6, 5), (255, 5)] {
        let mut crio = open();
        edge(&mut crio);
        crio.command(&Command { ttl_ticks: ttl, ..command(2) }).unwrap();
        for tick in 1..=lives {
            let sense = edge(&mut crio);
            assert_eq!((sense.tick, sense.state, sense.duty), (tick, CrioState::Running, [0.25, 0.5]));
        }
        let sense = edge(&mut crio);
        vented(&sense, CrioState::Tripped, TripBits::COMMAND_LOST);
        assert_eq!(u32::from(sense.commands_missed), lives);
        // It stays there, whatever comes, until a new HELLO.
        assert_eq!(crio.command(&command(3)), Err(Rejection::Tripped { trips: TripBits::COMMAND_LOST }));
        let sense = edge(&mut crio);
        vented(&sense, CrioState::Tripped, TripBits::COMMAND_LOST);
        assert_eq!(u32::from(sense.commands_missed), lives, "a command that came is not missed");
        crio.hello(&Hello::new(4, 0, SESSION + 1, "test"), 2, 0).unwrap();
        let sense = edge(&mut crio);
        vented(&sense, CrioState::Idle, TripBits::NONE);
        assert_eq!((sense.tick, sense.commands_missed, sense.session), (0, 0, SESSION + 1));
        assert!(crio.command(&Command { session: SESSION + 1, ..command(5) }).is_ok());
    }
}

#[test]
fn single_gaps_within_the_time_to_live_never_trip() {
    let mut crio = open();
    edge(&mut crio);
    for sequence in 2..50 {
        crio.command(&command(sequence)).unwrap();
        edge(&mut crio);
        let sense = edge(&mut crio);
        assert_eq!((sense.state, u32::from(sense.commands_missed)), (CrioState::Running, sequence - 1));
    }
}

#[test]
fn over_pressure_trips_in_the_sense_that_shows_it() {
    let volts = |kpa: f64| [PSE540A_R06.volts(kpa) as f32, 1.0, f32::NAN, f32::NAN];
    let mut crio = open();
    crio.command(&command(2)).unwrap();
    assert_eq!(crio.edge(volts(299.9), 1, 0).unwrap().state, CrioState::Running);
    crio.command(&command(3)).unwrap();
    vented(&crio.edge(volts(300.1), 1, 0).unwrap(), CrioState::Tripped, TripBits::OVER_PRESSURE);
    // Latched, though the pressure is gone.
    vented(&edge(&mut crio), CrioState::Tripped, TripBits::OVER_PRESSURE);
}

#[test]
fn a_broken_sensor_trips_at_its_third_tick_in_a_row() {
    let broken = [[0.79, 1.0], [5.21, 1.0], [1.0, 0.0], [1.0, f32::NAN], [f32::NAN, 1.0]];
    for [positive, negative] in broken {
        // 5.21 V is over-pressure too, at once: only the others are judged here without that limit.
        let config = CrioConfig { over_pressure_kpa: f64::INFINITY, ..CrioConfig::default() };
        let mut crio = Crio::new(config);
        crio.hello(&Hello::new(1, 0, SESSION, "test"), 1, 0).unwrap();
        let volts = [positive, negative, f32::NAN, f32::NAN];
        for _ in 0..2 {
            assert_eq!(crio.edge(volts, 1, 0).unwrap().trips, TripBits::NONE);
            assert_eq!(crio.edge(volts, 1, 0).unwrap().trips, TripBits::NONE);
            assert_eq!(edge(&mut crio).trips, TripBits::NONE, "a sound reading starts the count again");
        }
        crio.edge(volts, 1, 0);
        crio.edge(volts, 1, 0);
        vented(&crio.edge(volts, 1, 0).unwrap(), CrioState::Tripped, TripBits::SENSOR);
    }
    let mut crio = Crio::new(CrioConfig { broken_sensor_ticks: None, ..CrioConfig::default() });
    crio.hello(&Hello::new(1, 0, SESSION, "test"), 1, 0).unwrap();
    for _ in 0..100 {
        assert_eq!(crio.edge([0.0; 4], 1, 0).unwrap().trips, TripBits::NONE);
    }
}

#[test]
fn trips_add_up() {
    let mut crio = open();
    edge(&mut crio);
    crio.trip(TripBits::OPERATOR_STOP);
    let sense = crio.edge([2.5, 1.0, f32::NAN, f32::NAN], 1, 0).unwrap();
    vented(&sense, CrioState::Tripped, TripBits::OPERATOR_STOP.with(TripBits::OVER_PRESSURE));
}

#[test]
fn missed_commands_stay_at_their_most() {
    let mut crio = open();
    for _ in 0..70_000 {
        edge(&mut crio);
    }
    assert_eq!(edge(&mut crio).commands_missed, 65_535);
    assert_eq!(crio.commands_missed(), 70_000);
}
