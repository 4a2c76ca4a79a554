//! Each kind of fault, over a real loopback socket.

// A test may stop at the first thing that is not as it must be; helpers here are part of tests.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod emulator_client;

use std::time::{Duration, Instant};

use emulator_client::{Client, Nothing, lockstep, real_time, start, with_faults};
use proto::emulator::{EmulatorHandle, PSE540A_R06};
use proto::wire::{CrioState, Frame, Sense, TripBits};

fn scripted(toml: &str) -> (EmulatorHandle, Client) {
    let emulator = start(with_faults(lockstep(), toml));
    let client = Client::open(emulator.local_addr());
    (emulator, client)
}

/// Takes SENSE frames and answers each, until this tick has come.
fn senses_to(client: &mut Client, last: u32) -> Vec<Sense> {
    let mut senses = Vec::new();
    loop {
        let sense = client.sense();
        client.run(sense.tick, [0.5, 0.5]);
        senses.push(sense);
        if sense.tick >= last {
            return senses;
        }
    }
}

fn ticks(senses: &[Sense]) -> Vec<u32> {
    senses.iter().map(|sense| sense.tick).collect()
}

#[test]
fn lost_senses_leave_a_gap_in_ticks_and_sequence() {
    let (emulator, mut client) = scripted("[[fault]]\nkind = \"lose\"\nframe = \"sense\"\nticks = [2]");
    let senses = senses_to(&mut client, 5);
    assert_eq!(ticks(&senses), [0, 1, 3, 4, 5]);
    assert_eq!(senses[2].sequence, senses[1].sequence + 2);
    assert_eq!((senses[2].commands_missed, senses[2].state), (1, CrioState::Running));
    assert_eq!(emulator.statistics().frames_spoilt, 1);
    assert_eq!(emulator.statistics().waits_over, 0, "lockstep does not wait for an answer that cannot come");
}

#[test]
fn lost_commands_trip_after_their_time_to_live() {
    let (emulator, mut client) = scripted("[[fault]]\nkind = \"lose\"\nframe = \"command\"\nfirst = 3\nlast = 4");
    let senses = senses_to(&mut client, 6);
    let states: Vec<_> = senses.iter().map(|sense| sense.state).collect();
    use CrioState::{Idle, Running, Tripped};
    assert_eq!(states, [Idle, Running, Running, Running, Running, Tripped, Tripped]);
    assert_eq!(senses[6].trips, TripBits::COMMAND_LOST);
    let statistics = emulator.statistics();
    assert_eq!((statistics.waits_over, statistics.trips_command_lost), (0, 1));
}

#[test]
fn a_delayed_sense_comes_ticks_later_behind_newer_ones() {
    let (_emulator, mut client) = scripted("[[fault]]\nkind = \"delay\"\nframe = \"sense\"\nby_ticks = 2\nticks = [3]");
    let senses = senses_to(&mut client, 7);
    assert_eq!(ticks(&senses), [0, 1, 2, 4, 3, 5, 6, 7]);
    let late = senses[4];
    assert_eq!(late.sequence + 1, senses[3].sequence);
}

#[test]
fn frames_due_at_the_same_time_keep_their_order() {
    let (_emulator, mut client) = scripted(
        "[[fault]]\nkind = \"delay\"\nframe = \"sense\"\nby_ticks = 2\nticks = [3]\n\
         [[fault]]\nkind = \"delay\"\nframe = \"sense\"\nby_ticks = 1\nticks = [4]",
    );
    assert_eq!(ticks(&senses_to(&mut client, 6)), [0, 1, 2, 3, 4, 5, 6]);
}

#[test]
fn a_delayed_command_comes_too_late_to_count() {
    let (emulator, mut client) =
        scripted("[[fault]]\nkind = \"delay\"\nframe = \"command\"\nby_ms = 30.0\nticks = [3]");
    let senses = senses_to(&mut client, 6);
    assert_eq!(ticks(&senses), [0, 1, 2, 3, 4, 5, 6]);
    // The answer to SENSE 3 came in tick 4, before that tick's own answer: it counted there.
    let missed: Vec<_> = senses.iter().map(|sense| sense.commands_missed).collect();
    assert_eq!(missed, [0, 0, 0, 0, 1, 1, 1]);
    assert_eq!(emulator.statistics().waits_over, 0);
    assert_eq!(senses[4].command_in_force, senses[3].command_in_force, "SENSE 4 still has the old one");
}

#[test]
fn in_real_time_a_delay_is_in_milliseconds() {
    let config = with_faults(real_time(), "[[fault]]\nkind = \"delay\"\nframe = \"sense\"\nby_ms = 70.0\nticks = [10]");
    // Where the host stalls between edge and release, the order can differ: ten tries.
    let found = (0..10).any(|_| {
        let emulator = start(config.clone());
        let mut client = Client::open(emulator.local_addr());
        let mut order = Vec::new();
        while order.len() < 20 {
            let sense = client.sense();
            client.run(sense.tick, [0.5, 0.5]);
            order.push(sense.tick);
        }
        // 70 ms after edge 10: between edges 13 and 14.
        let place = |tick| order.iter().position(|other| *other == tick);
        place(13) < place(10) && place(10) < place(14)
    });
    assert!(found);
}

#[test]
fn corrupt_frames_are_caught_by_the_crc_on_either_side() {
    let (emulator, mut client) = scripted(
        "[[fault]]\nkind = \"corrupt\"\nframe = \"sense\"\nbyte = 33\nticks = [2]\n\
         [[fault]]\nkind = \"corrupt\"\nframe = \"command\"\nbyte = 30\nxor = 1\nticks = [4]",
    );
    let mut seen = Vec::new();
    while seen.len() < 7 {
        match client.frame() {
            Ok(Frame::Sense(sense)) => {
                client.run(sense.tick, [0.5, 0.5]);
                seen.push(Some(sense.tick));
            }
            Err(Nothing::Damaged) => seen.push(None),
            other => panic!("{other:?}"),
        }
    }
    assert_eq!(seen, [Some(0), Some(1), None, Some(3), Some(4), Some(5), Some(6)]);
    assert_eq!(client.reader.dropped(), 1);
    client.sense();
    let statistics = emulator.statistics();
    assert_eq!((statistics.damaged, statistics.missed, statistics.frames_spoilt), (1, 2, 2));
}

#[test]
fn a_corrupt_header_ends_the_link_with_bye() {
    let (_emulator, mut client) = scripted("[[fault]]\nkind = \"corrupt\"\nframe = \"command\"\nbyte = 0\nticks = [2]");
    for tick in 0..=2 {
        assert_eq!(client.sense().tick, tick);
        client.run(tick, [0.5, 0.5]);
    }
    assert_eq!(client.bye().reason, proto::wire::ByeReason::ProtocolError);
}

#[test]
fn repeated_frames_come_again_and_repeated_commands_do_not_count_again() {
    let (emulator, mut client) = scripted(
        "[[fault]]\nkind = \"repeat\"\nframe = \"sense\"\nticks = [1]\ntimes = 2\n\
         [[fault]]\nkind = \"repeat\"\nframe = \"command\"\nticks = [4]",
    );
    let mut order = Vec::new();
    loop {
        let sense = client.sense();
        if order.last() != Some(&sense.tick) {
            client.run(sense.tick, [0.5, 0.5]);
        }
        order.push(sense.tick);
        if sense.tick == 6 {
            break;
        }
    }
    assert_eq!(order, [0, 1, 1, 1, 2, 3, 4, 5, 6]);
    let statistics = emulator.statistics();
    assert_eq!((statistics.rejected_sequence, statistics.missed), (1, 0));
}

#[test]
fn the_link_drops_once_and_new_ones_are_reset_for_a_while() {
    let (emulator, mut client) = scripted("[[fault]]\nkind = \"drop_link\"\nticks = [3]\nrefuse_s = 0.4");
    for tick in 0..3 {
        assert_eq!(client.sense().tick, tick);
        client.run(tick, [0.5, 0.5]);
    }
    assert_eq!(client.frame(), Err(Nothing::Closed));
    let dropped = Instant::now();
    let mut refused = 0;
    let mut client = loop {
        let mut client = Client::connect(emulator.local_addr());
        client.session = 5;
        let hello = proto::wire::Hello::new(client.sequence.advance(), 1, client.session, "again");
        // Writing to a connection that was reset in between is an error too.
        let sent = std::io::Write::write(&mut client.stream, &hello.encode());
        if sent.is_ok() && matches!(client.frame(), Ok(Frame::Hello(_))) {
            break client;
        }
        refused += 1;
        std::thread::sleep(Duration::from_millis(20));
        assert!(dropped.elapsed() < Duration::from_secs(5));
    };
    assert!(dropped.elapsed() >= Duration::from_millis(390), "{:?}", dropped.elapsed());
    // Ticks of the script go on over sessions: tick 3 of the new session is not dropped again.
    assert_eq!(ticks(&senses_to(&mut client, 6)), [0, 1, 2, 3, 4, 5, 6]);
    let statistics = emulator.statistics();
    assert!(refused >= 1 && statistics.turned_away == refused, "{refused} {statistics:?}");
    assert_eq!(statistics.links_lost, 1);
}

#[test]
fn sensor_faults_show_in_the_volts_and_trip_as_they_must() {
    let (emulator, mut client) = scripted(
        "[[fault]]\nkind = \"sensor\"\nsensor = \"positive\"\neffect = \"broken_wire\"\nticks = [2]\n\
         [[fault]]\nkind = \"sensor\"\nsensor = \"negative\"\neffect = \"nan\"\nticks = [3]\n\
         [[fault]]\nkind = \"sensor\"\nsensor = \"positive\"\neffect = \"stuck\"\nfirst = 6\nlast = 7\n\
         [[fault]]\nkind = \"sensor\"\nsensor = \"positive\"\neffect = \"offset\"\nkpa = 50.0\nticks = [8]\n\
         [[fault]]\nkind = \"sensor\"\nsensor = \"positive\"\neffect = \"reading\"\nkpa = 320.0\nticks = [10]",
    );
    let senses = senses_to(&mut client, 11);
    assert_eq!(senses[2].volts[0], 0.0);
    assert!(senses[3].volts[1].is_nan() && !senses[2].volts[1].is_nan());
    assert_eq!((senses[6].volts[0], senses[7].volts[0]), (senses[5].volts[0], senses[5].volts[0]));
    let kpa = |sense: &Sense| PSE540A_R06.gauge_kpa(f64::from(sense.volts[0]));
    // On the way up to 100 kPa with 0.25 s: one tick adds less than 8 kPa.
    assert!((kpa(&senses[8]) - kpa(&senses[9]) - 50.0).abs() < 8.0);
    assert!((kpa(&senses[10]) - 320.0).abs() < 0.05);
    assert_eq!((senses[9].trips, senses[10].trips), (TripBits::NONE, TripBits::OVER_PRESSURE));
    assert_eq!((senses[11].state, senses[11].duty), (CrioState::Tripped, [1.0, 1.0]));
    assert_eq!(emulator.statistics().trips_over_pressure, 1);
}

#[test]
fn a_broken_wire_trips_at_its_third_tick() {
    let (emulator, mut client) =
        scripted("[[fault]]\nkind = \"sensor\"\nsensor = \"negative\"\neffect = \"broken_wire\"\nfirst = 4");
    let senses = senses_to(&mut client, 7);
    let trips: Vec<_> = senses.iter().map(|sense| sense.trips).collect();
    assert_eq!(trips[..6], [TripBits::NONE; 6]);
    assert_eq!(trips[6..], [TripBits::SENSOR; 2]);
    assert_eq!(emulator.statistics().trips_sensor, 1);
}

#[test]
fn an_operators_stop_trips() {
    let (emulator, mut client) = scripted("[[fault]]\nkind = \"trip\"\nreason = \"operator_stop\"\nticks = [3]");
    let senses = senses_to(&mut client, 4);
    assert_eq!((senses[2].state, senses[3].state), (CrioState::Running, CrioState::Tripped));
    assert_eq!((senses[3].trips, senses[3].duty), (TripBits::OPERATOR_STOP, [1.0, 1.0]));
    client.sense();
    let statistics = emulator.statistics();
    assert_eq!((statistics.trips_operator, statistics.rejected_tripped), (1, 2));
}

#[test]
fn a_hello_whose_answer_is_lost_is_silence() {
    let emulator = start(with_faults(lockstep(), "[[fault]]\nkind = \"lose\"\nframe = \"hello_in\"\nticks = [0]"));
    let mut client = Client::connect(emulator.local_addr());
    client.stream.set_read_timeout(Some(Duration::from_millis(150))).unwrap();
    let hello = proto::wire::Hello::new(1, 1, client.session, "test");
    client.send(&hello.encode());
    assert_eq!(client.frame(), Err(Nothing::Silence));
}

/// Every kind at once, by the dice, for 2000 ticks: the emulator goes on, and its counts add up.
#[test]
fn a_storm_of_faults_leaves_the_emulator_alive() {
    let (emulator, mut client) = scripted(
        "seed = 11\n\
         [[fault]]\nkind = \"lose\"\nframe = \"sense\"\nprobability = 0.05\n\
         [[fault]]\nkind = \"lose\"\nframe = \"command\"\nprobability = 0.05\n\
         [[fault]]\nkind = \"delay\"\nframe = \"command\"\nprobability = 0.05\nby_ticks = 3\n\
         [[fault]]\nkind = \"delay\"\nframe = \"sense\"\nprobability = 0.05\nby_ticks = 2\n\
         [[fault]]\nkind = \"corrupt\"\nframe = \"command\"\nprobability = 0.05\nbyte = 29\n\
         [[fault]]\nkind = \"corrupt\"\nframe = \"sense\"\nprobability = 0.05\nbyte = 40\n\
         [[fault]]\nkind = \"repeat\"\nframe = \"command\"\nprobability = 0.05\n\
         [[fault]]\nkind = \"repeat\"\nframe = \"sense\"\nprobability = 0.05",
    );
    let mut last = 0;
    while last < 2000 {
        match client.frame() {
            Ok(Frame::Sense(sense)) => {
                client.run(sense.tick, [0.5, 0.5]);
                last = last.max(sense.tick);
            }
            Err(Nothing::Damaged) => {}
            other => panic!("{other:?}"),
        }
    }
    let statistics = emulator.statistics();
    assert_eq!((statistics.waits_over, statistics.links_lost, statistics.sessions), (0, 0, 1));
    // Eight kinds at 5 % of 2000 ticks each: 800, less those that fell together or on lost frames.
    assert!((500..900).contains(&statistics.frames_spoilt), "{statistics:?}");
    assert!(statistics.damaged > 50 && statistics.missed > 200, "{statistics:?}");
}
