//! The daemon in real time beside an oracle: misses of the tick that the machine itself does not excuse.
//!
//! `oracle_hour [SECONDS]` (3600): the daemon's whole loop against an emulated cRIO over TCP, and on each CPU a thread of higher
//! priority that wakes every millisecond and does no work. A tick is a miss where its command left too late or its frame was
//! given up. It is excused where an oracle was itself at least as late during that tick: then no program could have been on
//! time. Run it on a machine that does nothing else, or beside `stress-ng`. Exit status 1: a miss that nothing excuses.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use controller::clock::now_ns;
use controller::config::Realtime;
use controller::pacing::{COMMAND_DEADLINE_NS, FRAME_GRACE_NS, PERIOD_NS};
use controller::realtime::{make_realtime, with_priority};
use controller::socket::Ask;
use controller::state::State;
use flight::Recorded;
use model::rig::Rig;
use proto::emulator::{Emulator, EmulatorConfig, Pace, rig_and_crio};
use proto::recording::Arrival;
use tests::Folder;
use tests::in_process::Daemon;

/// SCHED_FIFO priority of the oracles, above tick and guard.
const PRIORITY: u8 = 90;
/// Between two wakes of an oracle.
const WAKE_NS: u64 = 1_000_000;
/// Lateness of an oracle that is worth keeping: it could excuse something.
const KEPT_NS: u64 = 1_000_000;
/// Latenesses that an oracle has room for; what comes beyond is no excuse.
const ROOM: usize = 1 << 20;

/// A time at which an oracle should have woken, and how late it did.
type Late = (u64, u64);

fn oracle(cpu: usize, stop: Arc<AtomicBool>) -> JoinHandle<(Vec<Late>, Vec<String>)> {
    std::thread::spawn(move || {
        let refused = make_realtime(&Realtime { cpu: Some(cpu), priority: PRIORITY, ..Realtime::default() });
        let mut late = Vec::with_capacity(ROOM);
        let mut due_ns = now_ns() + WAKE_NS;
        while !stop.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_nanos(due_ns.saturating_sub(now_ns())));
            let by_ns = now_ns().saturating_sub(due_ns);
            if by_ns >= KEPT_NS && late.len() < ROOM {
                late.push((due_ns, by_ns));
            }
            due_ns += WAKE_NS * (1 + by_ns / WAKE_NS);
        }
        (late, refused)
    })
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

fn main() -> ExitCode {
    let argument = std::env::args().nth(1).unwrap_or_else(|| "3600".to_owned());
    let Ok(seconds) = argument.parse::<f64>() else {
        println!("oracle_hour [SECONDS]: the daemon in real time beside an oracle, an hour by default");
        return if argument == "--help" { ExitCode::SUCCESS } else { ExitCode::from(2) };
    };
    let folder = Folder::new();
    let (plant, crio) = rig_and_crio(&Rig::builtin("bench").unwrap()).unwrap();
    let config = EmulatorConfig { crio, pace: Pace::RealTime, ..EmulatorConfig::default() };
    let emulator = Emulator::bind("127.0.0.1:0", config, Box::new(plant)).unwrap();
    // It stands in for hardware that is never late.
    let emulator = with_priority(PRIORITY - 5, || emulator.start()).unwrap().unwrap();
    let text = format!(
        "[link]\naddress = \"{}\"\n[policy]\nactive = \"default\"\n[record]\ndirectory = \"runs\"\nmin_free_mib = 16\n[control]\n\
         socket = \"s\"\nauto_arm = true\n",
        emulator.local_addr()
    );
    let file = folder.write("controller.toml", text);
    let (misses, ticks) = (Arc::new(Mutex::new(Vec::new())), Arc::new(Mutex::new([0u64; 2])));
    let (found, counted) = (Arc::clone(&misses), Arc::clone(&ticks));
    let daemon = Daemon::start(&file, move |recorded| {
        let Recorded::Tick(tick) = recorded else { return };
        let mut counted = counted.lock().unwrap();
        counted[0] += 1;
        counted[1] += u64::from(tick.mode != 0);
        let given_up = tick.arrival == Arrival::Missing;
        if tick.deadline_missed || given_up {
            let late_ns = tick.arrival_lateness_ns.max(0) as u64 + u64::from(tick.compute_ns);
            let (due_ns, limit_ns) = match given_up {
                true => (tick.receive_ns.saturating_sub(FRAME_GRACE_NS), FRAME_GRACE_NS),
                false => (tick.receive_ns.saturating_sub(tick.arrival_lateness_ns.max(0) as u64), COMMAND_DEADLINE_NS),
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
    let oracles: Vec<_> = (0..cpus).map(|cpu| oracle(cpu, Arc::clone(&stop))).collect();
    let until = Instant::now() + Duration::from_secs_f64(seconds);
    let mut vented = 0;
    while Instant::now() < until {
        std::thread::sleep(Duration::from_secs(1));
        // A miss may vent the rig, as it should; the operator of this run looks and arms again.
        let state = daemon.ask(&Ask::Status {}).map(|reply| reply.state);
        if state.is_some_and(|state| matches!(state, State::Vent | State::Fault)) {
            vented += 1;
            daemon.ask(&Ask::Acknowledge {});
        }
    }
    stop.store(true, Ordering::Relaxed);
    let (late, refused): (Vec<_>, Vec<_>) = oracles.into_iter().map(|o| o.join().unwrap()).unzip();
    daemon.end();
    emulator.stop();
    let _ = emulator.join();
    let (late, refused) = (late.concat(), refused.concat());
    if !refused.is_empty() {
        println!("SKIPPED: the oracle has no priority here: {}", refused.join("; "));
        return ExitCode::SUCCESS;
    }
    let (misses, [ticks, controlled]) = (misses.lock().unwrap().clone(), *ticks.lock().unwrap());
    let unexcused = misses.iter().filter(|miss| !excused(miss, &late)).count();
    let count = |by: By| misses.iter().filter(|miss| miss.by == by).count();
    println!(
        "of the misses {} frames were given up, {} frames came late, {} answers took too long; the rig was vented {vented} times",
        count(By::FrameGivenUp),
        count(By::FrameLate),
        count(By::Answer)
    );
    let worst_ms = late.iter().map(|(_, by_ns)| *by_ns).max().unwrap_or(0) as f64 * 1e-6;
    println!(
        "{ticks} ticks, {controlled} of them under control: {} missed, {unexcused} of them not excused by the oracle, which was \
         late by over 1 ms {} times, {worst_ms:.1} ms at most",
        misses.len(),
        late.len()
    );
    if unexcused == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
