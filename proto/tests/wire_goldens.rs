//! The codec against frames that Python's `struct` and `zlib` made from the protocol's tables
//! (`wire_goldens/make_goldens.py`): same bytes out, same values in.

// A test may stop at the first thing that is not as it must be; helpers here are part of tests.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use proto::wire::{Bye, ByeReason, Command, CrioState, Frame, Hello, Mode, Sense, TripBits};

fn golden(name: &str) -> Vec<u8> {
    let line = include_str!("wire_goldens/goldens.txt")
        .lines()
        .find_map(|line| line.strip_prefix(name)?.strip_prefix(' '))
        .unwrap_or_else(|| panic!("no golden named {name}"));
    assert_eq!(line.len() % 2, 0);
    (0..line.len() / 2).map(|at| u8::from_str_radix(&line[2 * at..2 * at + 2], 16).unwrap()).collect()
}

fn check(name: &str, frame: Frame) {
    let bytes = golden(name);
    assert_eq!(frame.encode().as_bytes(), bytes, "{name}: encoded bytes differ");
    let decoded = Frame::decode(&bytes).unwrap_or_else(|error| panic!("{name}: {error}"));
    // Through the debug text, for NaN is not equal to NaN.
    assert_eq!(format!("{decoded:?}"), format!("{frame:?}"), "{name}: decoded values differ");
    assert_eq!(decoded.encode().as_bytes(), bytes, "{name}: not the same after a round trip");
}

#[test]
fn hello() {
    check(
        "hello_daemon",
        Frame::Hello(Hello {
            sequence: 1,
            clock_ns: 123_456_789,
            session: 0xDEAD_BEEF,
            rate_millihertz: 50_000,
            sensors: 2,
            valves: 2,
            min_version: 1,
            max_version: 1,
            name: *b"controller\0\0\0\0\0\0",
        }),
    );
    check("hello_daemon", Frame::Hello(Hello::new(1, 123_456_789, 0xDEAD_BEEF, "controller")));
    check(
        "hello_full_name",
        Frame::Hello(Hello {
            sequence: 0xFFFF_FFFF,
            clock_ns: u64::MAX,
            session: 1,
            rate_millihertz: 50_000,
            sensors: 4,
            valves: 3,
            min_version: 1,
            max_version: 7,
            name: *b"sixteen-letters!",
        }),
    );
}

#[test]
fn sense() {
    check(
        "sense_first",
        Frame::Sense(Sense {
            sequence: 2,
            clock_ns: 20_000_000,
            session: 0xDEAD_BEEF,
            tick: 0,
            command_in_force: 0,
            volts: [1.0, 1.0, f32::NAN, f32::NAN],
            duty: [1.0, 1.0],
            state: CrioState::Idle,
            pump_running: false,
            trips: TripBits::NONE,
            commands_missed: 0,
        }),
    );
    check(
        "sense_running",
        Frame::Sense(Sense {
            sequence: 3002,
            clock_ns: 60_020_000_001,
            session: 0xDEAD_BEEF,
            tick: 3000,
            command_in_force: 2999,
            volts: [1.399_902_3, 4.029_541, f32::NAN, f32::NAN],
            duty: [0.75, 0.8125],
            state: CrioState::Running,
            pump_running: true,
            trips: TripBits::NONE,
            commands_missed: 3,
        }),
    );
    check(
        "sense_tripped",
        Frame::Sense(Sense {
            sequence: 7,
            clock_ns: 8,
            session: 9,
            tick: 10,
            command_in_force: 11,
            volts: [5.2, 0.8, 0.0, -0.5],
            duty: [1.0, 1.0],
            state: CrioState::Tripped,
            pump_running: false,
            trips: TripBits::OVER_PRESSURE
                .with(TripBits::COMMAND_LOST)
                .with(TripBits::SENSOR)
                .with(TripBits::OPERATOR_STOP),
            commands_missed: 65535,
        }),
    );
}

#[test]
fn command() {
    check(
        "command_run",
        Frame::Command(Command {
            sequence: 2,
            clock_ns: 20_100_000,
            session: 0xDEAD_BEEF,
            tick: 0,
            duty: [0.75, 0.1],
            mode: Mode::Run,
            ttl_ticks: 2,
            digital_outputs: Command::PUMP_ON,
        }),
    );
    check(
        "command_vent",
        Frame::Command(Command {
            sequence: 0x0102_0304,
            clock_ns: 0x0102_0304_0506_0708,
            session: 0x1112_1314,
            tick: 0x2122_2324,
            duty: [1.0, 1.0],
            mode: Mode::Vent,
            ttl_ticks: 5,
            digital_outputs: 0,
        }),
    );
    check(
        "command_nan",
        Frame::Command(Command {
            sequence: 5,
            clock_ns: 6,
            session: 7,
            tick: 8,
            duty: [f32::NAN, 2.5],
            mode: Mode::Hold,
            ttl_ticks: 255,
            digital_outputs: 255,
        }),
    );
}

#[test]
fn bye() {
    check(
        "bye_normal",
        Frame::Bye(Bye { sequence: 3003, clock_ns: 60_030_000_000, session: 0xDEAD_BEEF, reason: ByeReason::Normal }),
    );
    check("bye_fault", Frame::Bye(Bye { sequence: 1, clock_ns: 0, session: 0, reason: ByeReason::Fault }));
}

/// Offsets straight from the protocol's page, one byte pattern each, so that no two fields can be
/// swapped in encoder and decoder alike.
#[test]
fn every_field_stands_at_its_offset() {
    let command = golden("command_vent");
    assert_eq!(command[8..12], [1, 2, 3, 4], "sequence");
    assert_eq!(command[12..20], [1, 2, 3, 4, 5, 6, 7, 8], "clock");
    assert_eq!(command[20..24], [0x11, 0x12, 0x13, 0x14], "session");
    assert_eq!(command[24..28], [0x21, 0x22, 0x23, 0x24], "tick");
    assert_eq!(command[28..36], [0x3F, 0x80, 0, 0, 0x3F, 0x80, 0, 0], "duty 1.0, 1.0");
    assert_eq!(command[36..40], [0, 5, 0, 0], "mode, ttl, outputs, zero");
    let sense = golden("sense_running");
    assert_eq!(sense[6..8], [0, 64], "length");
    assert_eq!(sense[56..60], [0x81, 0, 0, 3], "state with pump bit, trips, missed");
}
