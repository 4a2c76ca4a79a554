//! Threads that wake every millisecond and do nothing: how late they are is what the machine does to a tick.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

use rustix::thread::clock_nanosleep_absolute;
use rustix::time::{ClockId, Timespec};

use super::lateness::Lateness;
use crate::config::Realtime;
use crate::machine::clock::now_ns;
use crate::machine::realtime::make_realtime;

/// Between two wakes: twenty in the time of a tick, so that a few seconds show a rare stall.
const PERIOD_NS: u64 = 1_000_000;

/// A probe at work.
pub(super) struct Probe {
    thread: JoinHandle<(Lateness, Vec<String>)>,
    stop: Arc<AtomicBool>,
}

impl Probe {
    /// Starts a probe with the priority and CPU that the tick would have; `None`: with none, as any program.
    pub(super) fn start(settings: Option<Realtime>) -> std::io::Result<Self> {
        let stop = Arc::new(AtomicBool::new(false));
        let flag = Arc::clone(&stop);
        let thread = std::thread::Builder::new().name("probe".to_owned()).spawn(move || {
            let refused = settings.as_ref().map(make_realtime).unwrap_or_default();
            (watch(&flag), refused)
        })?;
        Ok(Probe { thread, stop })
    }

    /// Ends it; its lateness, and what the system refused it.
    pub(super) fn end(self) -> (Lateness, Vec<String>) {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.join().unwrap_or_default()
    }
}

fn watch(stop: &AtomicBool) -> Lateness {
    let mut lateness = Lateness::new();
    let mut due_ns = now_ns() + PERIOD_NS;
    while !stop.load(Ordering::Relaxed) {
        let due = Timespec { tv_sec: (due_ns / 1_000_000_000) as i64, tv_nsec: (due_ns % 1_000_000_000) as _ };
        if clock_nanosleep_absolute(ClockId::Monotonic, &due).is_err() {
            continue;
        }
        let now = now_ns();
        lateness.add(now.saturating_sub(due_ns));
        // What was slept through is not caught up: one stall is one late wake, as it is one late tick.
        due_ns += PERIOD_NS * (1 + now.saturating_sub(due_ns) / PERIOD_NS);
    }
    lateness
}
