//! The daemon in real time beside an oracle: misses of the tick that the machine itself does not excuse.
//!
//! The daemon's whole loop runs against an emulated cRIO over TCP, and on each CPU two threads of higher priority that do no work.
//! One wakes every millisecond and sends what time it is over a TCP connection of its own on this machine; the other waits for
//! that. So a stall of this machine's clock, of a processor or of its network is seen from two milliseconds on, a third of what a
//! frame may be late by.
//!
//! A tick is a miss where its command left too late or its frame was given up. It is excused by the *clock* where a thread woke
//! at least as late during that tick, by the *cRIO* where that emulated hardware itself had its frame ready as late, and by the
//! *link* where such a message came as late. Then no program could have been on time.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use controller::config::Realtime;
use controller::machine::clock::now_ns;
use controller::machine::realtime::{lock_memory, make_realtime, with_priority};
use controller::operator::socket::Ask;
use controller::session::pacing::{COMMAND_DEADLINE_NS, FRAME_GRACE_NS, PERIOD_NS};
use controller::state::State;
use model::rig::Rig;
use proto::emulator::{EmulatedPlant, Emulator, EmulatorConfig, Pace, rig_and_crio};
use proto::recording::{Arrival, TickRecord};

use crate::in_process::Daemon;

/// SCHED_FIFO priority of the oracles, above tick and guard.
const PRIORITY: u8 = 90;
/// Between two wakes of an oracle.
const WAKE_NS: u64 = 1_000_000;
/// Lateness of an oracle that is worth keeping: it could excuse something.
const KEPT_NS: u64 = 1_000_000;
/// Latenesses that an oracle has room for; what comes beyond is no excuse.
const ROOM: usize = 1 << 20;
/// Ticks to either side whose edges tell where an edge was due: a second, within which a cRIO that has fallen behind has not yet come to
/// another grid.
const NEIGHBOURS: usize = 50;
/// Beginning of the line that names the cRIO's address.
const LISTENS: &str = "the cRIO listens on ";
/// Beginning of a line about one of its ticks.
const WAS_READY: &str = "the cRIO was ready at ";

/// A time at which something should have happened, and how late it did.
type Late = (u64, u64);

/// Oracles of all CPUs at work.
pub struct Oracles {
    threads: Vec<Oracle>,
    stop: Arc<AtomicBool>,
}

/// The two threads of one CPU.
struct Oracle {
    wakes: JoinHandle<(Vec<Late>, Vec<String>)>,
    messages: JoinHandle<Vec<Late>>,
}

impl Oracles {
    /// Starts two threads on each CPU.
    pub fn start() -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let cpus = std::thread::available_parallelism().map_or(1, usize::from);
        Oracles { threads: (0..cpus).map(|cpu| Oracle::start(cpu, Arc::clone(&stop))).collect(), stop }
    }

    /// Ends them; what they saw.
    fn end(self) -> Seen {
        self.stop.store(true, Ordering::Relaxed);
        let mut seen = Seen::default();
        for oracle in self.threads {
            let (wakes, refused) = oracle.wakes.join().expect("no panic");
            seen.wakes.extend(wakes);
            seen.refused.extend(refused);
            seen.messages.extend(oracle.messages.join().expect("no panic"));
        }
        seen
    }
}

impl Oracle {
    fn start(cpu: usize, stop: Arc<AtomicBool>) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = listener.local_addr().expect("an address");
        let mine = move || make_realtime(&Realtime { cpu: Some(cpu), priority: PRIORITY, ..Realtime::default() });
        let messages = std::thread::spawn(move || {
            mine();
            let (mut stream, _) = listener.accept().expect("the other thread");
            let (mut late, mut sent) = (Vec::with_capacity(ROOM), [0; 8]);
            // It ends when the sender does.
            while stream.read_exact(&mut sent).is_ok() {
                keep(&mut late, u64::from_le_bytes(sent), now_ns());
            }
            late
        });
        let wakes = std::thread::spawn(move || {
            let refused = mine();
            let mut stream = TcpStream::connect(address).expect("the other thread");
            stream.set_nodelay(true).expect("a socket");
            let mut late = Vec::with_capacity(ROOM);
            let mut due_ns = now_ns() + WAKE_NS;
            while !stop.load(Ordering::Relaxed) {
                std::thread::sleep(Duration::from_nanos(due_ns.saturating_sub(now_ns())));
                let now_ns = now_ns();
                keep(&mut late, due_ns, now_ns);
                stream.write_all(&due_ns.to_le_bytes()).expect("the other thread");
                due_ns += WAKE_NS * (1 + now_ns.saturating_sub(due_ns) / WAKE_NS);
            }
            (late, refused)
        });
        Oracle { wakes, messages }
    }
}

fn keep(late: &mut Vec<Late>, due_ns: u64, now_ns: u64) {
    let by_ns = now_ns.saturating_sub(due_ns);
    if by_ns >= KEPT_NS && late.len() < ROOM {
        late.push((due_ns, by_ns));
    }
}

/// Wakes and messages that oracles saw come late, and the priority or pinning that they were refused.
#[derive(Default)]
struct Seen {
    wakes: Vec<Late>,
    messages: Vec<Late>,
    refused: Vec<String>,
}

/// The emulated cRIO, in a process of its own. It stands in for hardware that is never late: it waits for no lock of the daemon's,
/// has a higher priority, and its memory is locked.
pub struct CrioProcess {
    child: Child,
    output: BufReader<ChildStdout>,
    address: String,
}

impl CrioProcess {
    /// Starts it: a command in which [`be_the_crio`] is called.
    ///
    /// # Panics
    /// If it does not listen.
    pub fn start(command: &mut Command) -> Self {
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("the cRIO's process");
        let mut output = BufReader::new(child.stdout.take().expect("piped"));
        let mut line = String::new();
        while !line.contains(LISTENS) {
            line.clear();
            assert!(output.read_line(&mut line).expect("a line") > 0, "the cRIO listens nowhere");
        }
        let address = line.rsplit(' ').next().unwrap_or_default().trim().to_owned();
        CrioProcess { child, output, address }
    }

    /// Address at which it listens.
    pub fn address(&self) -> &str {
        &self.address
    }

    /// Ends it; its ticks: when each began, and when its frame was ready.
    fn end(mut self) -> Vec<(u64, u64)> {
        drop(self.child.stdin.take());
        let ticks = self.output.lines().map_while(Result::ok).filter_map(|line| {
            let (began_ns, ready_ns) = line.strip_prefix(WAS_READY)?.split_once(' ')?;
            Some((began_ns.parse().ok()?, ready_ns.parse().ok()?))
        });
        let ticks = ticks.collect();
        let _ = self.child.wait();
        ticks
    }
}

/// A plant that notes when each of its ticks began and how long it took.
struct Noted {
    plant: Box<dyn EmulatedPlant>,
    ticks: Arc<Mutex<Vec<(u64, u64)>>>,
}

impl EmulatedPlant for Noted {
    fn tick(&mut self, duty: [f64; 2], pump_on: bool) {
        let began_ns = now_ns();
        self.plant.tick(duty, pump_on);
        let mut ticks = self.ticks.lock().expect("no panic");
        if ticks.len() < ROOM {
            ticks.push((began_ns, now_ns()));
        }
    }

    fn pressures_gauge_kpa(&self) -> [f64; 2] {
        self.plant.pressures_gauge_kpa()
    }
}

/// The emulated cRIO, until standard input ends; then it says when it was ready.
///
/// # Panics
/// If it cannot listen.
pub fn be_the_crio() {
    let rig = Rig::builtin("bench").expect("a built-in rig");
    let (plant, crio) = rig_and_crio(&rig).expect("a sound rig");
    let config = EmulatorConfig { crio, pace: Pace::RealTime, ..EmulatorConfig::default() };
    let ticks = Arc::new(Mutex::new(Vec::with_capacity(ROOM)));
    let plant = Noted { plant: Box::new(plant), ticks: Arc::clone(&ticks) };
    let emulator = Emulator::bind("127.0.0.1:0", config, Box::new(plant)).expect("a port");
    println!("{LISTENS}{}", emulator.local_addr());
    lock_memory();
    let emulator = with_priority(PRIORITY - 5, || emulator.start()).expect("no panic").expect("threads");
    let _ = std::io::stdin().read_to_end(&mut Vec::new());
    emulator.stop();
    let _ = emulator.join();
    for (began_ns, ready_ns) in ticks.lock().expect("no panic").iter() {
        println!("{WAS_READY}{began_ns} {ready_ns}");
    }
}

/// Edges at which the cRIO itself had its frame ready late: when it was due, and by how much. Its grid is that of the edge that was
/// earliest in its period within a second; where more than a period has passed since the edge before, it is late by what is more.
fn late_edges(ticks: &[(u64, u64)]) -> Vec<Late> {
    let mut late = Vec::new();
    for (k, (began_ns, ready_ns)) in ticks.iter().enumerate() {
        let near = &ticks[k.saturating_sub(NEIGHBOURS)..ticks.len().min(k + NEIGHBOURS)];
        // How much earlier in its period another edge was, within half a period.
        let earlier = |other_ns: u64| {
            let apart = (*began_ns as i64 - other_ns as i64).rem_euclid(PERIOD_NS as i64) as u64;
            if apart < PERIOD_NS / 2 { apart } else { 0 }
        };
        let in_period_ns = near.iter().map(|(other_ns, _)| earlier(*other_ns)).max().unwrap_or(0);
        let gap_ns = k.checked_sub(1).map_or(0, |k| (began_ns - ticks[k].0).saturating_sub(PERIOD_NS));
        keep(&mut late, began_ns - in_period_ns.max(gap_ns), *ready_ns);
    }
    late
}

/// A tick that was missed.
#[derive(Debug, Clone, Copy)]
struct Miss {
    due_ns: u64,
    /// Time at which its frame was in hand or given up.
    taken_ns: u64,
    /// Time from then until its command had left.
    answered_ns: u64,
    /// Time by which it was later than it may be.
    over_ns: u64,
    by: By,
}

/// Part of a missed tick that took its time, as far as its own record tells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum By {
    /// The frame had not come when it was given up.
    FrameGivenUp,
    /// The frame came too late to be answered in time.
    FrameLate,
    /// The frame was there in time, and the answer took too long.
    Answer,
    /// There is no record of it: frames of several ticks came at once, the newest in time.
    Skipped,
}

impl Miss {
    /// The miss that a record tells of, where it does.
    fn of(tick: &TickRecord) -> Option<Self> {
        let given_up = tick.arrival == Arrival::Missing;
        if !tick.deadline_missed && !given_up {
            return None;
        }
        let (arrival_ns, answered_ns) = (tick.arrival_lateness_ns.max(0) as u64, u64::from(tick.compute_ns));
        // A frame that was given up was at least as late as its limit.
        let (since_due_ns, over_ns, by) = if given_up {
            (FRAME_GRACE_NS, FRAME_GRACE_NS, By::FrameGivenUp)
        } else {
            let by = if arrival_ns > answered_ns { By::FrameLate } else { By::Answer };
            (arrival_ns, (arrival_ns + answered_ns).saturating_sub(COMMAND_DEADLINE_NS), by)
        };
        let due_ns = tick.receive_ns.saturating_sub(since_due_ns);
        Some(Miss { due_ns, taken_ns: tick.receive_ns, answered_ns, over_ns, by })
    }

    /// The miss of ticks that have no record before this one, where there are any: their frames lay there for so long.
    fn before(tick: &TickRecord, skipped: u32) -> Option<Self> {
        let over_ns = (u64::from(skipped) * PERIOD_NS).checked_sub(COMMAND_DEADLINE_NS)?;
        let due_ns = tick.receive_ns.saturating_sub(u64::from(skipped) * PERIOD_NS);
        let (taken_ns, answered_ns) = (tick.receive_ns, u64::from(tick.compute_ns));
        Some(Miss { due_ns, taken_ns, answered_ns, over_ns, by: By::Skipped })
    }

    /// Tells whether something was as late as the tick exceeded its time, in the time of that tick.
    fn is_excused_by(&self, late: &[Late]) -> bool {
        let (from, to) = (self.due_ns.saturating_sub(PERIOD_NS), self.due_ns + PERIOD_NS + self.over_ns);
        late.iter().any(|(due_ns, by_ns)| due_ns + by_ns >= from && *due_ns <= to && *by_ns >= self.over_ns)
    }

    /// One line about it, with what the cRIO says of its frame.
    fn text(&self, ticks: &[(u64, u64)]) -> String {
        let ms = |ns: u64| ns as f64 * 1e-6;
        let newest = ticks.partition_point(|(_, ready_ns)| *ready_ns <= self.taken_ns).checked_sub(1);
        let held = newest.map_or("before any was ready".to_owned(), |at| {
            format!("{:.1} ms after the newest was ready", ms(self.taken_ns - ticks[at].1))
        });
        let what = if self.by == By::FrameGivenUp { "given up" } else { "in hand" };
        format!(
            "{:?}, over its time by {:.1} ms: its frame was {what} {held} and {:.1} ms after it was due; answered within {:.1} ms",
            self.by,
            ms(self.over_ns),
            ms(self.taken_ns.saturating_sub(self.due_ns)),
            ms(self.answered_ns)
        )
    }
}

/// Ticks as the daemon's recorder sees them.
#[derive(Debug, Default)]
pub struct Witness {
    misses: Vec<Miss>,
    ticks: u64,
    controlled: u64,
    /// Session and number of the newest tick.
    newest: Option<(u32, u32)>,
}

impl Witness {
    /// Takes a tick in.
    pub fn see(&mut self, tick: &TickRecord) {
        self.ticks += 1;
        self.controlled += u64::from(tick.mode != 0);
        let before = self.newest.replace((tick.session, tick.tick)).filter(|(session, _)| *session == tick.session);
        let skipped = before.map_or(0, |(_, number)| tick.tick.saturating_sub(number).saturating_sub(1));
        self.misses.extend(Miss::before(tick, skipped));
        self.misses.extend(Miss::of(tick));
    }
}

/// An operator who looks at what was wrong and arms again, at each call; the state that was found. A miss may vent the rig, as it
/// should.
pub fn attend(daemon: &Daemon) -> Option<State> {
    let state = daemon.ask(&Ask::Status {})?.state;
    match state {
        State::Vent | State::Fault => drop(daemon.ask(&Ask::Acknowledge {})),
        State::Standby => drop(daemon.ask(&Ask::Arm {})),
        _ => {}
    }
    Some(state)
}

/// Verdict on a run beside the oracle.
#[derive(Debug)]
pub struct Verdict {
    /// Ticks under control.
    pub controlled: u64,
    /// Account of it, in lines.
    pub text: String,
    /// Gaps in the numbers of ticks that something excuses.
    pub excused_gaps: usize,
    /// Misses that nothing excuses, a line each.
    pub unexcused: Vec<String>,
    /// Rights that the system refused the oracle, without which it tells nothing.
    pub refused: Vec<String>,
}

impl Verdict {
    /// Ends oracles and cRIO, and judges what the witness saw.
    pub fn of(witness: &Witness, oracles: Oracles, crio: CrioProcess) -> Self {
        let (seen, ticks) = (oracles.end(), crio.end());
        let edges = late_edges(&ticks);
        let excuses = [("clock", &seen.wakes), ("cRIO", &edges), ("link", &seen.messages)];
        let (mut excused, mut excused_gaps) = ([0; 3], 0);
        let mut unexcused = Vec::new();
        for miss in &witness.misses {
            match excuses.iter().position(|(_, late)| miss.is_excused_by(late)) {
                Some(excuse) => {
                    excused[excuse] += 1;
                    excused_gaps += usize::from(miss.by == By::Skipped);
                }
                None => unexcused.push(miss.text(&ticks)),
            }
        }
        let count = |by: By| witness.misses.iter().filter(|miss| miss.by == by).count();
        let mut text = format!(
            "of the misses {} frames were given up, {} frames came late, {} answers took too long, {} have no record\n",
            count(By::FrameGivenUp),
            count(By::FrameLate),
            count(By::Answer),
            count(By::Skipped)
        );
        for (what, late) in
            [("oracle's wakes", &seen.wakes), ("oracle's messages", &seen.messages), ("cRIO's frames", &edges)]
        {
            let worst_ms = late.iter().map(|(_, by_ns)| *by_ns).max().unwrap_or(0) as f64 * 1e-6;
            text += &format!("the {what} were late by over 1 ms {} times, {worst_ms:.1} ms at most\n", late.len());
        }
        let [by_clock, by_crio, by_link] = excused;
        text += &format!(
            "{} ticks, {} of them under control: {} missed, {by_clock} of them excused by the clock, {by_crio} by the cRIO's own lateness, \
             {by_link} by the link, {} by nothing",
            witness.ticks,
            witness.controlled,
            witness.misses.len(),
            unexcused.len()
        );
        Verdict { controlled: witness.controlled, text, excused_gaps, unexcused, refused: seen.refused }
    }
}
