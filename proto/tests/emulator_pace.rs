//! Real time and lockstep: the grid, and the same plant behind both.

// A test may stop at the first thing that is not as it must be; helpers here are part of tests.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod emulator_client;

use std::time::{Duration, Instant};

use emulator_client::{Client, lockstep, real_time, start, with_faults};
use proto::emulator::{EmulatorConfig, Pace, Sensors};
use proto::wire::{CrioState, Sense, TripBits};

/// Drives so many ticks by a rule that hangs on the tick alone.
fn drive(config: EmulatorConfig, ticks: u32) -> Vec<Sense> {
    let emulator = start(config);
    let mut client = Client::open(emulator.local_addr());
    (0..ticks)
        .map(|tick| {
            let sense = client.sense();
            client.run(sense.tick, [(tick % 13) as f32 / 12.0, (tick % 7) as f32 / 6.0]);
            sense
        })
        .collect()
}

/// A stalled host makes an answer late, which is another run; ten tries make that no excuse.
fn undisturbed<T>(run: impl Fn() -> Option<T>) -> T {
    (0..10).find_map(|_| run()).expect("this machine stalled for a tick in each of ten runs")
}

#[test]
fn both_paces_give_the_same_volts_for_the_same_answers() {
    let noisy = |config| EmulatorConfig { noise_v_rms: Sensors::ADC_NOISE_V_RMS, seed: 5, ..config };
    let fast = drive(noisy(lockstep()), 30);
    // Each answer within its tick: then no command is missed.
    let slow = undisturbed(|| {
        let slow = drive(noisy(real_time()), 30);
        (slow.last()?.commands_missed == 0).then_some(slow)
    });
    assert_eq!(fast.len(), slow.len());
    for (fast, slow) in fast.iter().zip(&slow) {
        assert_eq!(fast.volts.map(f32::to_bits), slow.volts.map(f32::to_bits), "tick {}", fast.tick);
        assert_eq!(
            (fast.tick, fast.duty, fast.state, fast.command_in_force),
            (slow.tick, slow.duty, slow.state, slow.command_in_force)
        );
    }
    // In lockstep every byte is the same, run after run, the clock's too.
    let again = drive(noisy(lockstep()), 30);
    assert!(fast.iter().zip(&again).all(|(one, other)| one.encode() == other.encode()));
}

#[test]
fn real_time_keeps_the_absolute_grid() {
    let run = drive(real_time(), 120);
    // How late each edge is against the first one's phase of the grid; whole ticks that a stalled
    // host left out do not count. The lower quartile looks past single late wake-ups.
    let quartile_ns = |part: &[Sense]| {
        let mut late: Vec<i64> = part
            .iter()
            .map(|sense| (sense.clock_ns - run[0].clock_ns + 10_000_000) as i64 % 20_000_000 - 10_000_000)
            .collect();
        late.sort_unstable();
        late[late.len() / 4]
    };
    let drift_ns = quartile_ns(&run[80..]) - quartile_ns(&run[..40]);
    // Sleeps of 20 ms one after the other would add up each wake-up's lateness, 80 times.
    assert!(drift_ns.abs() < 3_000_000, "{drift_ns} ns over 80 ticks");
}

/// Drives full pressure until the tick, or gives up where the host stalled and an answer was late.
fn full_pressure(client: &mut Client, last: u32) -> Option<Sense> {
    loop {
        let sense = client.sense();
        client.run(sense.tick, [0.0, 0.0]);
        if sense.commands_missed > 0 {
            return None;
        }
        if sense.tick == last {
            return Some(sense);
        }
    }
}

#[test]
fn in_real_time_a_lost_link_vents_and_the_rig_goes_on() {
    let (emulator, reached) = undisturbed(|| {
        let emulator = start(real_time());
        let reached = full_pressure(&mut Client::open(emulator.local_addr()), 40)?;
        Some((emulator, reached))
    });
    assert!(reached.volts[0] > 1.5, "over 125 kPa: {}", reached.volts[0]);
    // The client is dropped by now.
    std::thread::sleep(Duration::from_millis(1000));
    let mut client = Client::open_session(emulator.local_addr(), 7);
    let sense = client.sense();
    // Vented for a second, four time constants: below a tenth of what it was.
    assert!(sense.volts[0] - 1.0 < 0.1 * (reached.volts[0] - 1.0), "{}", sense.volts[0]);
    assert_eq!((sense.tick, sense.state), (0, CrioState::Idle));
}

#[test]
fn in_real_time_a_daemon_that_falls_silent_is_tripped_within_its_time_to_live() {
    let tripped = undisturbed(|| {
        let emulator = start(real_time());
        let mut client = Client::open(emulator.local_addr());
        full_pressure(&mut client, 10)?;
        let silent_since = Instant::now();
        loop {
            let sense = client.sense();
            if sense.tick == 11 && sense.commands_missed > 0 {
                return None;
            }
            if sense.state == CrioState::Tripped {
                return Some(sense);
            }
            assert!(silent_since.elapsed() < Duration::from_secs(1), "never tripped");
        }
    });
    assert_eq!((tripped.trips, tripped.duty), (TripBits::COMMAND_LOST, [1.0, 1.0]));
    assert_eq!(tripped.tick, 13, "the answer to SENSE 10 was the last; ticks 11 and 12 had none");
}

#[test]
fn a_client_that_does_not_read_is_dropped_and_does_not_stall_the_edge() {
    // A fast stand-in for minutes of real time: every SENSE a hundred times, an edge a millisecond.
    let config = EmulatorConfig { pace: Pace::Lockstep { wait: Duration::from_millis(1) }, ..lockstep() };
    let emulator = start(with_faults(config, "[[fault]]\nkind = \"repeat\"\nframe = \"sense\"\ntimes = 99\nfirst = 0"));
    let mut client = Client::connect(emulator.local_addr());
    socket2::SockRef::from(&client.stream).set_recv_buffer_size(4096).unwrap();
    client.shake();
    let begin = Instant::now();
    while emulator.statistics().links_lost == 0 {
        assert!(begin.elapsed() < Duration::from_secs(30), "never dropped: {:?}", emulator.statistics());
        std::thread::sleep(Duration::from_millis(5));
    }
    // The next one is served, for as long as it reads.
    Client::open_session(emulator.local_addr(), 9).sense();
}
