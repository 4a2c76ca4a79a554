//! Frames that come late or not at all, in every state: `docs/safety.md` says what follows, and in real time it does.
//!
//! The test keeps the time of the cRIO, on a machine that has other things to do. So what a flight did is read from its recording,
//! and one that was disturbed before its fault began, or came out otherwise, is flown again: a machine that stalls does so now and
//! then, a daemon that does the wrong thing does it every time.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use controller::operator::socket::{Ask, ask};
use controller::state::State;
use model::rig::Rig;
use proto::emulator::SensorFault;
use proto::recording::{TickRecord, read_mcap};
use proto::wire::Sense;
use rustix::process::{Pid, Signal, kill_process};
use tests::Stream;
use tests::alone;
use tests::fault_table::{BEGINNINGS, End, FaultRow, Return, WHAT_IS_LATE, fault_rows};
use tests::scene::{LEAK, SOON, Scene};

const TICK: Duration = Duration::from_millis(20);
/// Time for which the daemon is held up, so that its command is late (14 ms after the frame was due) and still comes within the tick.
const HELD_UP: Duration = Duration::from_millis(16);
/// Time in which all threads of a stopped process stand: the one that ticks would else answer first.
const STOPS: Duration = Duration::from_millis(1);
/// Ticks before a fault: half a second to be armed, and one under control.
const BEFORE: u32 = 80;
/// Ticks before the fault where the fallback is to have taken over: three seconds to fill, five to be given up.
const BEFORE_REVERT: u32 = 430;
/// Ticks after it: what was counted over a hundred ticks is over, and half a second has passed, and another.
const AFTER: u32 = 160;
/// Recorded ticks after a fault in which its state counts.
const LOOKED: u32 = 3;
/// Flights that may be disturbed by the machine.
const TRIES: u32 = 6;
/// Flights at a time.
const THREADS: usize = 4;

/// Fate of a tick's frame.
enum Sent {
    Sound,
    Spoilt(fn(&mut Sense)),
    Nothing,
    /// It comes twice as fast as it should.
    Early,
    /// It is sound, and whoever should answer is held up.
    ToASleeper,
}

/// Faults of the table, each with the function that makes it, given how many ticks of it there were before.
const FAULTS: [(&str, fn(u32) -> Sent); 10] = [
    ("a frame missing", |_| Sent::Nothing),
    ("two frames missing in a row", |_| Sent::Nothing),
    ("one frame in three missing", |k| if k % 3 == 0 { Sent::Nothing } else { Sent::Sound }),
    ("nothing comes", |_| Sent::Nothing),
    ("a frame 1,500 ticks ahead", |_| Sent::Spoilt(|sense| sense.tick += 1_500)),
    ("the cRIO's clock stands still", |_| Sent::Spoilt(|sense| sense.clock_ns = 1_000_000)),
    ("the sequence goes back", |_| Sent::Spoilt(|sense| sense.sequence -= 50)),
    ("100 frames a second", |_| Sent::Early),
    ("a command late", |_| Sent::ToASleeper),
    ("three commands late in a row", |_| Sent::ToASleeper),
];

/// A scene whose cRIO keeps time.
struct Flight {
    scene: Scene,
    next: Instant,
}

impl Flight {
    fn begin(state: State) -> Self {
        let leak = if state == State::Revert { LEAK } else { "" };
        let rig = Rig::from_toml(&format!("{}{leak}", model::rig::DUAL_PRESSURE)).unwrap();
        let auto_arm = state != State::Standby;
        let scene = Scene::in_real_time(&rig, &format!("control.auto_arm = {auto_arm}\nrig.file = \"rig.toml\""));
        let mut flight = Flight { scene, next: Instant::now() };
        let before = if state == State::Revert { BEFORE_REVERT } else { BEFORE };
        (0..before).for_each(|_| flight.tick(&Sent::Sound));
        if state == State::Hold {
            flight.scene.crio.faults[1] = vec![SensorFault::Offset(-15.0)];
            flight.tick(&Sent::Sound);
            flight.scene.crio.faults[1].clear();
            flight.tick(&Sent::Sound);
        }
        flight
    }

    /// A tick of the cRIO: what came by now counts, the reading goes out, the rig moves on.
    fn tick(&mut self, sent: &Sent) {
        std::thread::sleep(self.next.saturating_duration_since(Instant::now()));
        self.next += if matches!(sent, Sent::Early) { TICK / 2 } else { TICK };
        let crio = &mut self.scene.crio;
        crio.take_what_came();
        if let Some(mut sense) = crio.sense() {
            if let Sent::Spoilt(spoil) = sent {
                spoil(&mut sense);
            }
            let daemon = Pid::from_raw(self.scene.daemon.pid() as i32).unwrap();
            if matches!(sent, Sent::ToASleeper) {
                kill_process(daemon, Signal::STOP).unwrap();
                std::thread::sleep(STOPS);
            }
            if !matches!(sent, Sent::Nothing) {
                crio.write(&sense.encode());
            }
            if matches!(sent, Sent::ToASleeper) {
                std::thread::sleep(HELD_UP);
                kill_process(daemon, Signal::CONT).unwrap();
            }
        }
        crio.advance();
    }

    fn shown(&self) -> State {
        ask(&self.scene.folder.join("s"), &Ask::Status {}).map_or(State::Init, |reply| reply.state)
    }

    /// Ends it; all ticks that were recorded.
    fn end(self) -> Vec<TickRecord> {
        let Scene { crio, daemon, folder, .. } = self.scene;
        daemon.terminate();
        let ended = daemon.wait(SOON);
        assert_eq!(ended.status, Some(0), "{ended:?}");
        drop(crio);
        let files = folder.names("runs");
        files.iter().flat_map(|name| read_mcap(&folder.join("runs").join(name)).unwrap().ticks).collect()
    }
}

/// One flight; why it is not as the table says.
fn fly(row: &FaultRow, index: usize, sent: fn(u32) -> Sent) -> Result<(), String> {
    let beginning = BEGINNINGS[index];
    let End::In(end) = row.ends[index] else { return Err("nothing of this kind stops it".to_owned()) };
    let mut flight = Flight::begin(beginning);
    let first = flight.scene.crio.clock_ticks as u32;
    (0..row.ticks).for_each(|k| flight.tick(&sent(k)));
    let last = flight.scene.crio.clock_ticks as u32;
    if end == State::Connect {
        // Nothing is recorded without a session.
        if flight.shown() != State::Connect {
            return Err(format!("shown as {:?}", flight.shown()));
        }
        flight.scene.crio.cut();
        flight.scene.crio.open();
        flight.next = Instant::now();
    }
    (0..AFTER).for_each(|_| flight.tick(&Sent::Sound));
    let after = flight.shown();
    let said = flight.scene.daemon.said(Stream::Err);
    let ticks = flight.end();
    let states = |from: u32, to: u32| -> Vec<State> {
        // The first session's, for a second one counts anew.
        let session = ticks.first().map_or(0, |tick| tick.session);
        let within = ticks.iter().filter(|tick| tick.session == session && (from..to).contains(&tick.tick));
        within.filter_map(|tick| State::from_code(tick.state)).collect()
    };
    if states(first - 1, first) != [beginning] {
        return Err(format!("disturbed: {:?} before it; {said}", states(first - 1, first)));
    }
    let seen = states(first, last + LOOKED);
    let is_there = match end {
        State::Hold | State::Vent => seen.contains(&end),
        State::Connect => true,
        _ => seen.iter().all(|state| *state == end),
    };
    let goes_on = match (row.afterwards, beginning) {
        (Return::ByAPerson, _) => after == State::Vent,
        (Return::ByItself, State::Standby) => after == State::Standby,
        (Return::ByItself, _) => after.is_controlling(),
    };
    if is_there && goes_on {
        return Ok(());
    }
    let frame = |tick: &TickRecord| {
        let is = if tick.sense_present { "came" } else { "missing" };
        let late = if tick.deadline_missed { ", command late" } else { "" };
        format!("{} {is}{late}", tick.tick)
    };
    let within = ticks.iter().filter(|tick| (first..last + LOOKED).contains(&tick.tick));
    let frames: Vec<String> = within.map(frame).collect();
    Err(format!("{seen:?}, {after:?} afterwards; {}; {said}", frames.join("; ")))
}

#[test]
#[ignore = "in real time: two minutes on a machine that has time for it"]
fn what_is_late_in_every_state_ends_where_the_table_says() {
    let _alone = alone();
    let rows = fault_rows(WHAT_IS_LATE);
    let only = std::env::var("FAULT").unwrap_or_default();
    let (next, failed) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    let all: Vec<(&FaultRow, usize)> = rows
        .iter()
        .filter(|row| row.fault.contains(&only))
        .flat_map(|row| (0..BEGINNINGS.len()).map(move |index| (row, index)))
        .collect();
    std::thread::scope(|scope| {
        for _ in 0..THREADS {
            scope.spawn(|| {
                while let Some((row, index)) = all.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let (_, sent) = FAULTS.iter().find(|(fault, _)| *fault == row.fault).expect("a fault that is made");
                    let tries: Vec<String> = (0..TRIES).map_while(|_| fly(row, *index, *sent).err()).collect();
                    if tries.len() == TRIES as usize {
                        let last = tries.last().cloned().unwrap_or_default();
                        failed.lock().unwrap().push(format!("{}, {:?}: {last}", row.fault, BEGINNINGS[*index]));
                    } else if !tries.is_empty() {
                        println!("{}, {:?}: flown again after {tries:?}", row.fault, BEGINNINGS[*index]);
                    }
                }
            });
        }
    });
    let failed = failed.into_inner().unwrap();
    assert!(failed.is_empty(), "{} of {}: {failed:#?}", failed.len(), all.len());
    if only.is_empty() {
        assert_eq!(rows.len(), FAULTS.len(), "every fault that is made has a row");
    }
}
