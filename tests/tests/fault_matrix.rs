//! Every fault in every state: what `docs/safety.md` says that follows does follow, on the built daemon over a real socket.
//!
//! The states come from the document, none from the program. In lockstep, so that nothing hangs on how busy the machine is;
//! what is a matter of time has a table of its own (`late_frames.rs`).
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::io::Write;
use std::os::unix::net::UnixStream;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use controller::state::State;
use model::rig::Rig;
use proto::emulator::SensorFault;
use proto::wire::{Bye, ByeReason, CrioState, Hello, Mode, Sense, TripBits};
use tests::Stream::Err;
use tests::fault_table::{BEGINNINGS, EVERY_FAULT, End, FaultRow, Return, fault_rows};
use tests::raw_crio::Answer;
use tests::scene::{LEAK, SOON, Scene};

/// Ticks within which REVERT must be there on that rig: half a second to be armed, three to fill, five to be given up.
const MOST_TICKS_TO_REVERT: u32 = 700;
/// Frames by which a daemon whose commands are not read must have given up.
const MOST_UNREAD: u32 = 1_000;
/// Ticks under control before a fault begins.
const BEFORE: u32 = 60;
/// Sound ticks after a fault: half a second has passed, and half a second more.
const AFTER: u32 = 60;
/// As many more after what was counted over a hundred ticks.
const WINDOW: u32 = 100;

/// A tick of a fault, given how many there were before.
type Tick = fn(&mut Scene, u32);

/// Spoils a tick's frame.
macro_rules! frame {
    (|$sense:ident, $tick:ident| $spoil:expr) => {
        |scene: &mut Scene, $tick: u32| {
            let _ = $tick;
            scene.spoilt(|$sense: &mut Sense| $spoil);
        }
    };
}

/// Faults of the table, each with the function that makes it.
const FAULTS: [(&str, Tick); 42] = [
    ("positive sensor reads NaN", frame!(|s, _k| s.volts[0] = f32::NAN)),
    ("negative sensor reads NaN", frame!(|s, _k| s.volts[1] = f32::NAN)),
    ("positive sensor below 0.8 V", frame!(|s, _k| s.volts[0] = 0.3)),
    ("negative sensor above 5.2 V", frame!(|s, _k| s.volts[1] = 5.4)),
    ("positive pressure above its limit", |scene, _| shows(scene, 0, 165.0)),
    ("negative pressure below its limit", |scene, _| shows(scene, 1, -97.0)),
    ("positive sensor shows a vacuum", |scene, _| shows(scene, 0, -8.0)),
    ("negative sensor shows a pressure", |scene, _| shows(scene, 1, 8.0)),
    ("positive reading stands still", |scene, _| sticks(scene, 0)),
    ("negative reading stands still", |scene, _| sticks(scene, 1)),
    ("a reading jumps by 40 kPa and back", |scene, _| jumps(scene)),
    ("a reading jumps by 40 kPa and stays", |scene, _| jumps(scene)),
    ("a reading jumps by 40 kPa, one tick in four", |scene, k| if k % 4 == 0 { jumps(scene) } else { sound(scene) }),
    ("duty echo is another", frame!(|s, _k| s.duty = [0.5, 0.5])),
    ("duty echo is another, for good", frame!(|s, _k| s.duty = [0.5, 0.5])),
    ("duty echo is NaN", frame!(|s, _k| s.duty[1] = f32::NAN)),
    (
        "duty echo is another, one tick in three",
        frame!(|s, k| s.duty[0] -= if k.is_multiple_of(3) { 0.2 } else { 0.0 }),
    ),
    ("no command in force", frame!(|s, _k| s.command_in_force = 0)),
    ("an old command in force", frame!(|s, _k| s.command_in_force = s.command_in_force.saturating_sub(20))),
    ("cRIO idle", frame!(|s, _k| s.state = CrioState::Idle)),
    ("pump off", frame!(|s, _k| s.pump_running = false)),
    ("trip bits without a trip", frame!(|s, _k| s.trips = TripBits::OVER_PRESSURE)),
    ("operator's stop at the cRIO", |scene, k| trips(scene, k, TripBits::OPERATOR_STOP)),
    ("cRIO trips for a pressure", |scene, k| trips(scene, k, TripBits::OVER_PRESSURE)),
    ("cRIO trips for lost commands", |scene, k| trips(scene, k, TripBits::COMMAND_LOST)),
    ("cRIO misses one command in three", frame!(|s, k| s.commands_missed = (k / 3) as u16)),
    ("vents do not open when they must", |scene, k| vents_stay_shut(scene, k)),
    ("one frame with a wrong CRC", |scene, _| damaged(scene)),
    ("three frames with a wrong CRC", |scene, _| damaged(scene)),
    ("three HELLOs within the session", |scene, _| misplaced(scene)),
    ("wrong magic", |scene, _| raw(scene, |bytes| bytes[0] ^= 0xFF)),
    ("wrong length", |scene, _| raw(scene, |bytes| bytes[7] ^= 0x3F)),
    ("another protocol version", |scene, _| raw(scene, |bytes| bytes[4] = 9)),
    ("a flood of frames", |scene, _| flood(scene)),
    ("cRIO says BYE", |scene, _| bye(scene)),
    ("link cut", |scene, _| scene.crio.cut()),
    ("cRIO no longer reads", |scene, _| unread(scene)),
    ("pressure does not reach its reference", |scene, _| sound(scene)),
    ("a wrong configuration is read again", |scene, _| wrong_configuration(scene)),
    ("a policy file that is none", |scene, _| no_policy(scene)),
    ("nonsense on the operator's socket", |scene, _| nonsense(scene)),
    ("SIGTERM", |_, _| ()),
];

fn sound(scene: &mut Scene) {
    scene.step();
}

fn shows(scene: &mut Scene, channel: usize, kpa: f64) {
    scene.crio.faults[channel] = vec![SensorFault::Reading(kpa)];
    scene.step();
}

fn sticks(scene: &mut Scene, channel: usize) {
    scene.crio.faults[channel] = vec![SensorFault::Stuck];
    scene.step();
}

fn jumps(scene: &mut Scene) {
    scene.crio.faults[0] = vec![SensorFault::Offset(40.0)];
    scene.step();
    scene.crio.faults[0].clear();
}

fn trips(scene: &mut Scene, tick: u32, bits: TripBits) {
    if tick == 0 {
        scene.crio.trip(bits);
    }
    scene.step();
}

/// The first tick vents for another reason; the valves stay where they were.
fn vents_stay_shut(scene: &mut Scene, tick: u32) {
    scene.crio.stuck_duty = [Some(0.0), Some(0.0)];
    scene.spoilt(|sense| sense.trips = if tick == 0 { TripBits::OVER_PRESSURE } else { TripBits::NONE });
}

/// A damaged frame before the tick's own.
fn damaged(scene: &mut Scene) {
    let mut bytes = scene.crio.sense().unwrap().encode();
    bytes[40] ^= 0x10;
    scene.crio.write(&bytes);
    scene.step();
}

fn misplaced(scene: &mut Scene) {
    let sense = scene.crio.sense().unwrap();
    scene.crio.write(&Hello::new(sense.sequence, sense.clock_ns, sense.session, "again").encode());
    scene.step();
}

/// The tick's frame with other bytes; the vent command and the BYE come at once.
fn raw(scene: &mut Scene, spoil: fn(&mut [u8])) {
    let mut bytes = scene.crio.sense().unwrap().encode();
    spoil(&mut bytes);
    scene.crio.write(&bytes);
    parted(scene);
}

/// The daemon vents, says BYE and closes.
fn parted(scene: &mut Scene) {
    let vent = scene.crio.answer(SOON);
    assert!(matches!(vent, Answer::Command(c) if c.mode == Mode::Vent && c.duty == [1.0, 1.0]), "{vent:?}");
    let bye = scene.crio.answer(SOON);
    assert!(matches!(bye, Answer::Bye(_)), "{bye:?}");
}

fn flood(scene: &mut Scene) {
    let bytes = scene.crio.sense().unwrap().encode();
    let flood: Vec<u8> = bytes.iter().copied().cycle().take(2 << 20).collect();
    scene.crio.write(&flood);
    scene.told("bytes came in one tick");
    scene.crio.cut();
}

fn bye(scene: &mut Scene) {
    let sense = scene.crio.sense().unwrap();
    let (sequence, clock_ns, session) = (sense.sequence, sense.clock_ns, sense.session);
    scene.crio.write(&Bye { sequence, clock_ns, session, reason: ByeReason::Normal }.encode());
    while !matches!(scene.crio.answer(SOON), Answer::Bye(_) | Answer::Closed) {}
}

/// Commands are obeyed and left lying in the socket until there is no room in it; then frames go on that know of no further one,
/// of a cRIO that does not miss them either.
fn unread(scene: &mut Scene) {
    while scene.crio.step_without_reading() {}
    for _ in 0..MOST_UNREAD {
        if let Some(sense) = scene.crio.sense() {
            let blind = Sense { state: CrioState::Running, trips: TripBits::NONE, ..sense };
            scene.crio.write(&blind.encode());
        }
        scene.crio.advance();
        std::thread::sleep(Duration::from_millis(2));
        if scene.daemon.said(Err).contains("commands not read") {
            break;
        }
    }
    scene.told("commands not read");
    scene.crio.cut();
}

fn wrong_configuration(scene: &mut Scene) {
    let sound = std::fs::read_to_string(&scene.config).unwrap();
    std::fs::write(&scene.config, sound.clone() + "safety.max_pos_kpa = \"high\"\n").unwrap();
    scene.daemon.signal("HUP");
    scene.told("max_pos_kpa");
    std::fs::write(&scene.config, sound).unwrap();
    scene.step();
}

fn no_policy(scene: &mut Scene) {
    scene.folder.write("policies/none.onnx", "no policy at all");
    scene.told("policy none: refused");
    scene.step();
}

fn nonsense(scene: &mut Scene) {
    let mut socket = UnixStream::connect(scene.folder.join("s")).unwrap();
    socket.write_all(b"\xFF\x00{\"ask\":\"fly\"}\n").unwrap();
    scene.step();
}

/// A daemon in a state, its fault about to begin.
fn begin(state: State, fault: &str) -> Scene {
    let leaky = state == State::Revert || fault == "pressure does not reach its reference";
    let leak = if leaky { LEAK } else { "" };
    let rig = Rig::from_toml(&format!("{}{leak}", model::rig::DUAL_PRESSURE)).unwrap();
    let auto_arm = state != State::Standby;
    let lines = format!("control.auto_arm = {auto_arm}\nrig.file = \"rig.toml\"\npolicy.directory = \"policies\"");
    let mut scene = Scene::on(&rig, &lines);
    std::fs::create_dir_all(scene.folder.join("policies")).unwrap();
    match state {
        State::Standby => (0..BEFORE).for_each(|_| sound(&mut scene)),
        State::Revert => {
            let reverted = (0..MOST_TICKS_TO_REVERT).any(|k| {
                scene.step();
                k % 20 == 19 && scene.daemon.said(Err).contains("the fallback alone controls")
            });
            assert!(reverted, "never reverted: {}", scene.daemon.said(Err));
        }
        _ => scene.control(BEFORE),
    }
    if state == State::Hold {
        scene.crio.faults[1] = vec![SensorFault::Offset(-15.0)];
        assert_eq!(scene.step(), Some(Mode::Hold), "{}", scene.daemon.said(Err));
        scene.crio.faults[1].clear();
        // A sensor that sticks from here on sticks where it belongs.
        assert_eq!(scene.step(), Some(Mode::Hold), "{}", scene.daemon.said(Err));
    }
    scene.wait_for_state(state);
    scene
}

/// The fault is over: what follows by itself, and what does not.
fn recover(scene: &mut Scene, beginning: State, end: State, row: &FaultRow) {
    let after = AFTER + if row.ticks > AFTER { WINDOW } else { 0 };
    scene.crio.faults = [Vec::new(), Vec::new()];
    scene.crio.stuck_duty = [None; 2];
    if end == State::Connect {
        scene.crio.open();
    }
    let last: Vec<_> = (0..after).map(|_| scene.step()).collect();
    let vented = end.is_vented() || end == State::Connect;
    match (beginning, row.afterwards) {
        (_, Return::ByAPerson) if vented => {
            assert!(last.iter().all(|mode| *mode == Some(Mode::Vent)), "armed again by itself: {last:?}");
            // What was in doubt is in doubt until somebody has looked.
            scene.wait_for_state(if end == State::Fault { State::Fault } else { State::Vent });
        }
        (State::Standby, _) => scene.wait_for_state(State::Standby),
        _ => assert!(
            last.iter().rev().take(20).all(|mode| *mode == Some(Mode::Run)),
            "it does not go on: {last:?} {}",
            scene.daemon.said(Err)
        ),
    }
}

/// Both vents open and a BYE, whatever it was doing.
fn stops(mut scene: Scene) {
    scene.daemon.terminate();
    let mut last = None;
    loop {
        match scene.crio.step(|_| ()) {
            Answer::Command(command) => last = Some(command.mode),
            Answer::Bye(reason) => break assert_eq!((last, reason), (Some(Mode::Vent), ByeReason::Normal)),
            other => panic!("{other:?} after {last:?}"),
        }
    }
    let ended = scene.daemon.wait(SOON);
    assert_eq!(ended.status, Some(0), "{ended:?}");
}

fn fly(row: &FaultRow, index: usize, tick: Tick) {
    let mut scene = begin(BEGINNINGS[index], &row.fault);
    match row.ends[index] {
        End::Stopped => stops(scene),
        End::In(end) => {
            (0..row.ticks).for_each(|k| tick(&mut scene, k));
            scene.wait_for_state(end);
            recover(&mut scene, BEGINNINGS[index], end, row);
            scene.end();
        }
    }
}

#[test]
fn the_table_has_every_fault_and_nothing_else() {
    let mut written: Vec<String> = fault_rows(EVERY_FAULT).into_iter().map(|row| row.fault).collect();
    let mut made: Vec<String> = FAULTS.iter().map(|(fault, _)| (*fault).to_owned()).collect();
    written.sort();
    made.sort();
    assert_eq!(written, made);
    assert!(written.len() >= 24, "{}", written.len());
}

#[test]
fn every_fault_under_control_ends_where_the_table_says() {
    every_fault_ends_where_the_table_says(&[State::Run]);
}

/// Every fault, begun in each of some states.
fn every_fault_ends_where_the_table_says(begun_in: &[State]) {
    let rows = fault_rows(EVERY_FAULT);
    let only = std::env::var("FAULT").unwrap_or_default();
    let begun = |index: &usize| begun_in.contains(&BEGINNINGS[*index]);
    let all: Vec<(&FaultRow, usize)> = rows
        .iter()
        .filter(|row| row.fault.contains(&only))
        .flat_map(|row| (0..BEGINNINGS.len()).filter(begun).map(move |index| (row, index)))
        .collect();
    let (next, failed) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    std::thread::scope(|scope| {
        for _ in 0..3 {
            scope.spawn(|| {
                while let Some((row, index)) = all.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let tick = FAULTS.iter().find(|(fault, _)| *fault == row.fault).map(|(_, tick)| *tick).unwrap();
                    if std::panic::catch_unwind(|| fly(row, *index, tick)).is_err() {
                        failed.lock().unwrap().push(format!("{}, begun in {:?}", row.fault, BEGINNINGS[*index]));
                    }
                }
            });
        }
    });
    let failed = failed.into_inner().unwrap();
    println!("{} flights", all.len());
    assert!(failed.is_empty(), "{} of {}: {failed:#?}", failed.len(), all.len());
}

/// Tests of the thorough tier (docs/testing.md).
mod thorough {
    use super::*;

    #[test]
    #[ignore = "thorough: docs/testing.md"]
    fn every_fault_in_every_state_ends_where_the_table_says() {
        every_fault_ends_where_the_table_says(&BEGINNINGS);
    }
}
