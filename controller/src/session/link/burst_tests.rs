//! Frames that queued, and garbage that keeps coming, over a real socket: what is waited for, and what counts.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::mpsc::channel;
use std::thread::JoinHandle;
use std::time::Duration;

use model::rig::Rig;
use monitor::Pacing;
use proto::recording::{TickInput, TickRecord};
use proto::reference::Reference;
use proto::wire::{Bye, ByeReason, CrioState, Hello, SENSE_LENGTH, Sense, TripBits};
use supervisor::{Arming, Condition, State};

use super::tests::greeted;
use super::{Incoming, Link, Misplaced};
use crate::config::Safety;
use crate::cycle::Cycle;
use crate::cycle::tests::sense;
use crate::machine::clock::now_ns;
use crate::operator::notice::{Notice, sentence};

/// Session with a cRIO that does what it is given with its end of the link.
fn session_with(pacing: Pacing, crio: impl FnOnce(TcpStream, Hello) + Send + 'static) -> (Link, JoinHandle<()>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let at = listener.local_addr().unwrap();
    let crio = std::thread::spawn(move || {
        let (mut stream, hello) = greeted(&listener);
        stream.set_nodelay(true).unwrap();
        stream.write_all(&hello.encode()).unwrap();
        crio(stream, hello);
    });
    (Link::open(&at.to_string(), &[at], pacing).unwrap(), crio)
}

/// A reading of this tick, at rest but for the positive sensor's volts.
fn frame(hello: Hello, tick: u32, volts: f32) -> [u8; SENSE_LENGTH] {
    let sense = Sense {
        sequence: 2 + tick,
        session: hello.session,
        command_in_force: 0,
        pump_running: false,
        ..sense(tick, [volts, 1.002], CrioState::Idle, TripBits::NONE)
    };
    sense.encode()
}

/// A frame of the right kind whose CRC does not fit.
fn spoilt(hello: Hello) -> [u8; SENSE_LENGTH] {
    let mut bytes = frame(hello, 0, 1.002);
    bytes[SENSE_LENGTH - 1] ^= 1;
    bytes
}

/// Fails the test: a frame was overtaken.
fn alone(sense: &Sense) {
    panic!("{sense:?} was overtaken");
}

/// Each reading that is taken brings the next, and garbage with it: there is something to read whenever the link looks.
#[test]
fn what_keeps_coming_after_the_deadline_is_not_waited_for() {
    let (sender, receiver) = channel();
    let (mut link, crio) = session_with(Pacing::Lockstep, move |stream, hello| sender.send((stream, hello)).unwrap());
    crio.join().unwrap();
    let (mut stream, hello) = receiver.recv().unwrap();
    let mut ticks = 0;
    let mut supply = || {
        let bytes = [frame(hello, ticks, 1.002), spoilt(hello)].concat();
        stream.write_all(&bytes).unwrap();
        ticks += 1;
    };
    (0..3).for_each(|_| supply());
    std::thread::sleep(Duration::from_millis(200));
    let mut overtaken = Vec::new();
    let incoming = link.receive(Some(now_ns()), &mut |sense| {
        overtaken.push(sense.tick);
        supply();
    });
    // One that read on would come to the limit of a flood, a thousand frames away.
    assert!(matches!(incoming, Incoming::Sense { sense, .. } if sense.tick == 2), "{incoming:?}");
    assert_eq!((overtaken, link.damaged()), (vec![0, 1], 3));
    // The rest is not lost.
    let incoming = link.receive(Some(now_ns()), &mut |_| ());
    assert!(matches!(incoming, Incoming::Sense { sense, .. } if sense.tick == 4), "{incoming:?}");
    assert!(matches!(link.receive(Some(now_ns()), &mut alone), Incoming::Timeout));
}

/// A damaged frame every ms: none of them begins a wait anew.
#[test]
fn damaged_frames_now_and_then_do_not_move_the_deadline() {
    let (mut link, crio) = session_with(Pacing::RealTime, |mut stream, hello| {
        while stream.write_all(&spoilt(hello)).is_ok() {
            std::thread::sleep(Duration::from_millis(1));
        }
    });
    let late_ms = (0..20).map(|_| {
        let until = now_ns() + 20_000_000;
        let incoming = link.receive(Some(until), &mut alone);
        assert!(matches!(incoming, Incoming::Timeout) && now_ns() >= until, "{incoming:?}");
        (now_ns() - until) as f64 * 1e-6
    });
    // The best of them shows what the link does; the others show what else the machine has to do.
    let least_ms = late_ms.fold(f64::INFINITY, f64::min);
    assert!(least_ms < 5.0, "{least_ms} ms late");
    assert!(link.damaged() >= 20, "{}", link.damaged());
    drop(link);
    crio.join().unwrap();
}

#[test]
fn a_sound_frame_among_garbage_is_found_also_after_the_deadline() {
    let (mut link, crio) = session_with(Pacing::RealTime, |mut stream, hello| {
        let bytes = [spoilt(hello), frame(hello, 0, 1.002), spoilt(hello), spoilt(hello)].concat();
        stream.write_all(&bytes).unwrap();
        let _ = stream.read(&mut [0]);
    });
    // This thread comes late: the deadline is over, and all has come.
    std::thread::sleep(Duration::from_millis(200));
    let incoming = link.receive(Some(now_ns() - 1), &mut alone);
    assert!(matches!(incoming, Incoming::Sense { sense, .. } if sense.tick == 0), "{incoming:?}");
    assert_eq!(link.damaged(), 3);
    drop(link);
    crio.join().unwrap();
}

/// Answer of a cycle to a burst that came while the daemon was held up: readings of these volts, and perhaps a BYE behind them.
fn answered(volts: &'static [f32], ends: Ends) -> (Cycle, TickRecord, Incoming) {
    let (mut link, crio) = session_with(Pacing::RealTime, move |mut stream, hello| {
        let mut bytes: Vec<u8> = volts.iter().zip(0..).flat_map(|(volts, tick)| frame(hello, tick, *volts)).collect();
        if ends == Ends::WithBye {
            let sequence = 2 + volts.len() as u32;
            let bye = Bye { sequence, clock_ns: 0, session: hello.session, reason: ByeReason::Fault };
            bytes.extend(bye.encode());
        }
        stream.write_all(&bytes).unwrap();
        let _ = stream.read(&mut [0]);
    });
    std::thread::sleep(Duration::from_millis(200));
    let rig = Rig::builtin("dual_pressure").unwrap();
    let reference = Reference::constant(85.0, -72.0);
    let mut cycle = Cycle::new(&rig, None, reference, Safety::default(), Arming::Manual).unwrap();
    cycle.session_opened();
    let incoming = link.receive(Some(now_ns() + 1_000_000), &mut |sense| cycle.overtaken(sense));
    let Incoming::Sense { sense, raw, .. } = incoming else { panic!("{incoming:?}") };
    assert_eq!(sense.tick as usize, volts.len() - 1, "the newest");
    let mut record = TickRecord { session: link.session(), sense_present: true, ..TickRecord::default() };
    record.sense.copy_from_slice(raw.as_bytes());
    TickInput::SessionOpened.append(&mut record.inputs);
    cycle.observe(&sense, &mut record, &mut |_| ());
    cycle.predict(&mut record);
    cycle.decide(&mut record, &mut |_| ());
    let next = link.receive(Some(now_ns()), &mut alone);
    drop(link);
    crio.join().unwrap();
    (cycle, record, next)
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Ends {
    WithBye,
    Open,
}

/// 1.65 V are 162 kPa, beyond the limit of 160.
#[test]
fn a_limit_that_only_an_older_frame_of_a_burst_passed_vents_in_the_tick_of_the_newest() {
    for (volts, condition) in [
        (&[1.65, 1.002][..], Condition::OverPressure),
        (&[1.002, 1.65, 1.6, 1.002], Condition::OverPressure),
        (&[0.5, 1.002], Condition::SensorPositive),
        (&[0.97, 1.002], Condition::RangePositive),
    ] {
        let (cycle, record, next) = answered(volts, Ends::Open);
        assert_eq!((cycle.state(), cycle.memory().cause), (State::Vent, Some(condition)), "{volts:?}");
        assert!(cycle.memory().latched.contains(condition), "a person looks first");
        assert!(record.findings & 1 << condition.code() != 0, "{:x}", record.findings);
        assert!(record.p_pos_kpa.abs() < 1.0, "the newest reading is what is controlled: {}", record.p_pos_kpa);
        assert!(matches!(next, Incoming::Timeout), "{next:?}");
    }
    let (cycle, record, _) = answered(&[1.003, 1.001, 1.002], Ends::Open);
    assert_eq!((cycle.state(), record.findings), (State::Standby, 0), "a sound burst is no reason");
}

/// A cRIO that trips or reads too much, says so, and closes: what it said last is not lost with the link.
#[test]
fn a_reading_right_before_a_bye_is_answered() {
    let (cycle, _, next) = answered(&[1.002, 1.65], Ends::WithBye);
    assert_eq!(cycle.memory().cause, Some(Condition::OverPressure));
    assert!(matches!(next, Incoming::Lost(broken) if broken.condition == Condition::PeerLeft), "{next:?}");
}

/// The SENSE of docs/protocol.md in a state that the protocol does not name, with the CRC of its bytes: nothing was damaged on
/// the way, so whoever writes the cRIO's program is not sent to look at cables.
#[test]
fn a_code_that_the_protocol_does_not_name_is_told_as_such() {
    const IN_STATE_7: [u8; SENSE_LENGTH] = [
        0x50, 0x4e, 0x45, 0x55, 0x01, 0x02, 0x00, 0x40, 0x00, 0x00, 0x00, 0x08, 0x00, 0x00, 0x00, 0x00, 0x3b, 0x9a,
        0xca, 0x00, 0x12, 0x34, 0x56, 0x78, 0x00, 0x00, 0x00, 0x07, 0x00, 0x00, 0x00, 0x08, 0x3f, 0xae, 0x14, 0x7b,
        0x40, 0x73, 0x33, 0x33, 0x7f, 0xc0, 0x00, 0x00, 0x7f, 0xc0, 0x00, 0x00, 0x3f, 0x40, 0x00, 0x00, 0x3f, 0x00,
        0x00, 0x00, 0x87, 0x00, 0x00, 0x00, 0x0f, 0x39, 0x4c, 0xc1,
    ];
    let (mut link, crio) = session_with(Pacing::Lockstep, |mut stream, hello| {
        stream.write_all(&[&IN_STATE_7[..], &spoilt(hello), &frame(hello, 0, 1.002)].concat()).unwrap();
        let _ = stream.read(&mut [0]);
    });
    let incoming = link.receive(None, &mut alone);
    assert!(matches!(incoming, Incoming::Sense { sense, .. } if sense.tick == 0), "{incoming:?}");
    assert_eq!(link.damaged(), 2, "either counts");
    let what = link.take_misplaced().unwrap();
    assert_eq!(what, Misplaced::UnknownCode { offset: 56, code: 7 });
    let said = sentence(&Notice::FrameMisplaced { count: 2, what }.event(0));
    assert!(said.contains("the code 7 at byte 56, which the protocol does not name there"), "{said}");
    drop(link);
    crio.join().unwrap();
}
