//! The daemon in real time beside an oracle: misses of the tick that the machine itself does not excuse.
//!
//! `oracle_hour [SECONDS] [--beside COMMAND…]` (3600): the daemon's whole loop against an emulated cRIO over TCP, and on each CPU two threads of higher
//! priority that do no work. One wakes every millisecond and sends what time it is over a TCP connection of its own on this
//! machine; the other waits for that. A tick is a miss where its command left too late or its frame was given up. It is excused by
//! the *clock* where a thread woke at least as late during that tick, by the *cRIO* where that emulated hardware itself had its frame
//! ready as late, and by the *link* where such a message came as late: the kernel
//! carries messages in a thread without priority once there are many (`ksoftirqd`), and the emulated cRIO's frames go the same
//! way, as no wire's do. Then no program could have been on time. Run it on a machine that does nothing else, or beside
//! `stress-ng`. Exit status 1: a miss that nothing excuses.
//!
//! A `COMMAND` is run in the daemon's folder once the rig is under control, such as `trainer finetune --recordings recordings --publish
//! policies --from policies/default.onnx --out tuned`: the reference repeats, the newest policy is taken, and the operator switches
//! exploration on whenever it is off. At the end the command is told to stop, and what it printed is shown.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::path::PathBuf;
use std::process::{Command, ExitCode, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use controller::config::Realtime;
use controller::machine::clock::now_ns;
use controller::machine::realtime::{lock_memory, make_realtime, with_priority};
use controller::operator::operator_protocol::Switch;
use controller::operator::socket::Ask;
use controller::session::pacing::{COMMAND_DEADLINE_NS, FRAME_GRACE_NS, PERIOD_NS};
use controller::state::State;
use flight::Recorded;
use model::rig::Rig;
use proto::emulator::{EmulatedPlant, Emulator, EmulatorConfig, Pace, rig_and_crio};
use proto::recording::{Arrival, EventLevel};
use tests::in_process::Daemon;
use tests::{Folder, RunStatus, Running};

/// SCHED_FIFO priority of the oracles, above tick and guard.
const PRIORITY: u8 = 90;
/// Between two wakes of an oracle.
const WAKE_NS: u64 = 1_000_000;
/// Lateness of an oracle that is worth keeping: it could excuse something.
const KEPT_NS: u64 = 1_000_000;
/// Time that a command beside the daemon has to end in.
const ENDS: Duration = Duration::from_secs(60);
/// Latenesses that an oracle has room for; what comes beyond is no excuse.
const ROOM: usize = 1 << 20;

/// A time at which an oracle should have woken, and how late it did.
type Late = (u64, u64);

/// What an oracle saw: wakes and messages that were late, and what priority or pinning was refused.
#[derive(Default)]
struct Seen {
    wakes: Vec<Late>,
    messages: Vec<Late>,
    refused: Vec<String>,
}

/// The two threads of one CPU.
struct Oracle {
    wakes: JoinHandle<(Vec<Late>, Vec<String>)>,
    messages: JoinHandle<Vec<Late>>,
}

impl Oracle {
    fn start(cpu: usize, stop: Arc<AtomicBool>) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let mine = move || make_realtime(&Realtime { cpu: Some(cpu), priority: PRIORITY, ..Realtime::default() });
        let messages = std::thread::spawn(move || {
            mine();
            let (mut stream, _) = listener.accept().unwrap();
            let (mut late, mut sent) = (Vec::with_capacity(ROOM), [0; 8]);
            // It ends when the sender does.
            while stream.read_exact(&mut sent).is_ok() {
                keep(&mut late, u64::from_le_bytes(sent), now_ns());
            }
            late
        });
        let wakes = std::thread::spawn(move || {
            let refused = mine();
            let mut stream = TcpStream::connect(address).unwrap();
            stream.set_nodelay(true).unwrap();
            let mut late = Vec::with_capacity(ROOM);
            let mut due_ns = now_ns() + WAKE_NS;
            while !stop.load(Ordering::Relaxed) {
                std::thread::sleep(Duration::from_nanos(due_ns.saturating_sub(now_ns())));
                let now_ns = now_ns();
                keep(&mut late, due_ns, now_ns);
                stream.write_all(&due_ns.to_le_bytes()).unwrap();
                due_ns += WAKE_NS * (1 + now_ns.saturating_sub(due_ns) / WAKE_NS);
            }
            (late, refused)
        });
        Oracle { wakes, messages }
    }

    fn end(self) -> Seen {
        let (wakes, refused) = self.wakes.join().unwrap();
        Seen { wakes, messages: self.messages.join().unwrap(), refused }
    }
}

fn keep(late: &mut Vec<Late>, due_ns: u64, now_ns: u64) {
    let by_ns = now_ns.saturating_sub(due_ns);
    if by_ns >= KEPT_NS && late.len() < ROOM {
        late.push((due_ns, by_ns));
    }
}

/// A tick that was missed: when it was due, by when it should have been over, and by how much it was later.
#[derive(Debug, Clone, Copy)]
struct Miss {
    due_ns: u64,
    over_ns: u64,
    by: By,
}

/// Where the time of a missed tick went, as far as its own record tells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum By {
    /// The frame had not come when it was given up.
    FrameGivenUp,
    /// The frame came too late to be answered in time.
    FrameLate,
    /// The frame was there in time, and the answer took too long.
    Answer,
}

/// Whether an oracle was as late as the tick exceeded its time, in the time of that tick.
fn excused(miss: &Miss, late: &[Late]) -> bool {
    let (from, to) = (miss.due_ns.saturating_sub(PERIOD_NS), miss.due_ns + PERIOD_NS + miss.over_ns);
    late.iter().any(|(due_ns, by_ns)| due_ns + by_ns >= from && *due_ns <= to && *by_ns >= miss.over_ns)
}

/// First argument of the process that is the cRIO.
const CRIO: &str = "--crio";

/// A plant that notes when each of its ticks began and how long it took.
struct Noted {
    plant: Box<dyn EmulatedPlant>,
    ticks: Arc<Mutex<Vec<(u64, u64)>>>,
}

impl EmulatedPlant for Noted {
    fn tick(&mut self, duty: [f64; 2], pump_on: bool) {
        let began_ns = now_ns();
        self.plant.tick(duty, pump_on);
        let mut ticks = self.ticks.lock().unwrap();
        if ticks.len() < ROOM {
            ticks.push((began_ns, now_ns()));
        }
    }

    fn pressures_gauge_kpa(&self) -> [f64; 2] {
        self.plant.pressures_gauge_kpa()
    }
}

/// Ticks to either side whose edges tell where an edge was due: a second, within which a cRIO that has fallen behind has not yet come to
/// another grid.
const NEIGHBOURS: usize = 50;

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

/// The emulated cRIO, until standard input ends. It stands in for hardware that is never late: a process of its own, which waits for
/// no lock of the daemon's, of higher priority, its memory locked.
fn crio() -> ExitCode {
    let (plant, crio) = rig_and_crio(&Rig::builtin("bench").unwrap()).unwrap();
    let config = EmulatorConfig { crio, pace: Pace::RealTime, ..EmulatorConfig::default() };
    let ticks = Arc::new(Mutex::new(Vec::with_capacity(ROOM)));
    let plant = Noted { plant: Box::new(plant), ticks: Arc::clone(&ticks) };
    let emulator = Emulator::bind("127.0.0.1:0", config, Box::new(plant)).unwrap();
    println!("{}", emulator.local_addr());
    lock_memory();
    let emulator = with_priority(PRIORITY - 5, || emulator.start()).unwrap().unwrap();
    let _ = std::io::stdin().read_to_end(&mut Vec::new());
    emulator.stop();
    let _ = emulator.join();
    for (due_ns, by_ns) in late_edges(&ticks.lock().unwrap()) {
        println!("{due_ns} {by_ns}");
    }
    ExitCode::SUCCESS
}

/// A command that is run beside the daemon, in its folder.
struct Beside(Vec<String>);

impl Beside {
    /// The command behind `--beside`; `None` without it.
    fn of(arguments: &[String]) -> Option<Self> {
        let place = arguments.iter().position(|argument| argument == "--beside")?;
        Some(Beside(arguments[place + 1..].to_vec()))
    }

    fn start(&self, folder: &Folder) -> Running {
        let (program, arguments) = self.0.split_first().expect("--beside needs a command");
        // Relative to where this was called from: it runs elsewhere.
        let program = std::fs::canonicalize(program).unwrap_or_else(|_| PathBuf::from(program));
        Running::start(Command::new(program).args(arguments).current_dir(folder.join(".")))
    }
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let argument = arguments.first().map_or("3600", String::as_str);
    if argument == CRIO {
        return crio();
    }
    let Ok(seconds) = argument.parse::<f64>() else {
        println!(
            "oracle_hour [SECONDS] [--beside COMMAND…]: the daemon in real time beside an oracle, an hour by default"
        );
        return if argument == "--help" { ExitCode::SUCCESS } else { ExitCode::from(2) };
    };
    let beside = Beside::of(&arguments);
    let folder = Folder::new();
    let mut crio = Command::new(std::env::current_exe().unwrap());
    let mut crio = crio.arg(CRIO).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
    let mut address = String::new();
    let mut from_crio = BufReader::new(crio.stdout.take().unwrap());
    from_crio.read_line(&mut address).unwrap();
    let address = address.trim();
    let mut text = format!(
        "[link]\naddress = \"{address}\"\n[record]\ndirectory = \"recordings\"\nmin_free_mib = 16\n[control]\n\
         socket = \"s\"\nauto_arm = true\n[policy]\nactive = \"default\"\n"
    );
    if beside.is_some() {
        text += "directory = \"policies\"\nfollow = \"newest\"\n[reference]\nrepeat = true\n";
        let shipped = tests::root().join("controller/policies/default.onnx");
        std::fs::create_dir(folder.join("policies")).unwrap();
        std::fs::copy(shipped, folder.join("policies/default.onnx")).unwrap();
    }
    let file = folder.write("controller.toml", text);
    let (misses, ticks) = (Arc::new(Mutex::new(Vec::new())), Arc::new(Mutex::new([0u64; 2])));
    let (found, counted) = (Arc::clone(&misses), Arc::clone(&ticks));
    let daemon = Daemon::start(&file, move |recorded| {
        let tick = match recorded {
            Recorded::Tick(tick) => tick,
            Recorded::Event { level, message, .. } => {
                // What this operator asks for in vain is no news.
                let is_news = level != EventLevel::Info && !message.starts_with("explore");
                if is_news || message.starts_with("policy") {
                    println!("the daemon: {message}");
                }
                return;
            }
        };
        let mut counted = counted.lock().unwrap();
        counted[0] += 1;
        counted[1] += u64::from(tick.mode != 0);
        let given_up = tick.arrival == Arrival::Missing;
        if tick.deadline_missed || given_up {
            let late_ns = tick.arrival_lateness_ns.max(0) as u64 + u64::from(tick.compute_ns);
            let (due_ns, limit_ns) = if given_up {
                (tick.receive_ns.saturating_sub(FRAME_GRACE_NS), FRAME_GRACE_NS)
            } else {
                (tick.receive_ns.saturating_sub(tick.arrival_lateness_ns.max(0) as u64), COMMAND_DEADLINE_NS)
            };
            // A frame that was given up was at least as late as its limit.
            let over_ns = if given_up { FRAME_GRACE_NS } else { late_ns.saturating_sub(limit_ns) };
            let by = match tick.arrival_lateness_ns.max(0) as u64 {
                _ if given_up => By::FrameGivenUp,
                arrival_ns if arrival_ns > u64::from(tick.compute_ns) => By::FrameLate,
                _ => By::Answer,
            };
            found.lock().unwrap().push(Miss { due_ns, over_ns, by });
        }
    });
    let stop = Arc::new(AtomicBool::new(false));
    let cpus = std::thread::available_parallelism().map_or(1, usize::from);
    let oracles: Vec<_> = (0..cpus).map(|cpu| Oracle::start(cpu, Arc::clone(&stop))).collect();
    let until = Instant::now() + Duration::from_secs_f64(seconds);
    let (mut vented, mut running) = (0, None);
    while Instant::now() < until {
        std::thread::sleep(Duration::from_secs(1));
        // A miss may vent the rig, as it should; the operator of this run looks and arms again.
        match daemon.ask(&Ask::Status {}).map(|reply| reply.state) {
            Some(State::Vent | State::Fault) => {
                vented += 1;
                daemon.ask(&Ask::Acknowledge {});
            }
            Some(State::Standby) => drop(daemon.ask(&Ask::Arm {})),
            Some(State::Run) => {
                if let (None, Some(command)) = (&running, &beside) {
                    running = Some(command.start(&folder));
                }
                if running.is_some() {
                    // Refused while it is on, and while a candidate is examined.
                    drop(daemon.ask(&Ask::Explore { switch: Switch::On, seed: None }));
                }
            }
            _ => {}
        }
    }
    if let Some(command) = running {
        command.terminate();
        let RunStatus { status, stdout, stderr } = command.wait(ENDS);
        println!("beside it, exit status {status:?}:\n{stdout}{stderr}");
    }
    stop.store(true, Ordering::Relaxed);
    let mut seen = Seen::default();
    for oracle in oracles {
        let of_one = oracle.end();
        seen.wakes.extend(of_one.wakes);
        seen.messages.extend(of_one.messages);
        seen.refused.extend(of_one.refused);
    }
    daemon.end();
    drop(crio.stdin.take());
    let edges = from_crio.lines().map_while(Result::ok).filter_map(|line| {
        let (due_ns, by_ns) = line.split_once(' ')?;
        Some((due_ns.parse().ok()?, by_ns.parse().ok()?))
    });
    let edges: Vec<Late> = edges.collect();
    let _ = crio.wait();
    if !seen.refused.is_empty() {
        println!("SKIPPED: the oracle has no priority here: {}", seen.refused.join("; "));
        return ExitCode::SUCCESS;
    }
    let (misses, [ticks, controlled]) = (misses.lock().unwrap().clone(), *ticks.lock().unwrap());
    let excuses = [("clock", &seen.wakes), ("cRIO", &edges), ("link", &seen.messages)];
    let mut excused_by = [0; 3];
    let mut unexcused = Vec::new();
    for miss in &misses {
        match excuses.iter().position(|(_, late)| excused(miss, late)) {
            Some(excuse) => excused_by[excuse] += 1,
            None => unexcused.push(*miss),
        }
    }
    let count = |by: By| misses.iter().filter(|miss| miss.by == by).count();
    println!(
        "of the misses {} frames were given up, {} frames came late, {} answers took too long; the rig was vented {vented} times",
        count(By::FrameGivenUp),
        count(By::FrameLate),
        count(By::Answer)
    );
    let lateness = |what: &str, late: &[Late]| {
        let worst_ms = late.iter().map(|(_, by_ns)| *by_ns).max().unwrap_or(0) as f64 * 1e-6;
        println!("the {what} were late by over 1 ms {} times, {worst_ms:.1} ms at most", late.len());
    };
    for miss in &unexcused {
        println!("not excused: {:?}, over its time by {:.1} ms", miss.by, miss.over_ns as f64 * 1e-6);
    }
    lateness("oracle's wakes", &seen.wakes);
    lateness("oracle's messages", &seen.messages);
    lateness("cRIO's frames", &edges);
    let [by_clock, by_crio, by_link] = excused_by;
    println!(
        "{ticks} ticks, {controlled} of them under control: {} missed, {by_clock} of them excused by the clock, {by_crio} by the cRIO's own \
         lateness, {by_link} by the link, {} by nothing",
        misses.len(),
        unexcused.len()
    );
    if unexcused.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
