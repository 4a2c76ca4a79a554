//! The emulated cRIO beside an oracle, and what it says of its own lateness.

use std::io::{BufRead as _, BufReader, Read as _};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::{Arc, Mutex};

use controller::machine::clock::now_ns;
use controller::machine::realtime::{lock_memory, with_priority};
use controller::session::pacing::PERIOD_NS;
use model::rig::Rig;
use proto::emulator::{EmulatedPlant, Emulator, EmulatorConfig, Pace, rig_and_crio};

use super::{Late, PRIORITY, ROOM, keep};

/// Ticks to either side whose edges tell where an edge was due: a second, within which a cRIO that has fallen behind has not yet come to
/// another grid.
const NEIGHBOURS: usize = 50;
/// Beginning of the line that names the cRIO's address.
const LISTENS: &str = "the cRIO listens on ";
/// Beginning of a line about one of its ticks.
const WAS_READY: &str = "the cRIO was ready at ";

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
    pub(super) fn end(mut self) -> Vec<(u64, u64)> {
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
pub(super) fn late_edges(ticks: &[(u64, u64)]) -> Vec<Late> {
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
