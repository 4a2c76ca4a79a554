//! The guard: a thread above the tick's priority that checks that the tick goes on, and beats systemd's watchdog only then.
//!
//! It looks 14 ms after each grid point. A tick that does not advance in a session is told after a fifth of a second; after
//! a second the process ends itself. By then the cRIO has long vented by its time to live; what ends is a program that
//! nobody could control any more, and systemd starts it again, into STANDBY.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI32, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use crate::machine::clock::now_ns;
use crate::machine::realtime::raise;
use crate::machine::systemd::Notifier;
use crate::session::attribution::StolenTime;
use crate::session::pacing::{COMMAND_DEADLINE_NS, PERIOD_NS};

/// SCHED_FIFO priority of the guard, above the tick's default of 80.
const PRIORITY: u8 = 85;
/// Looks without a tick after which a person is told: 0.2 s (study of the daemon, §3.1).
const SILENT_TO_TELL: u32 = 10;
/// Looks without a tick after which the process ends itself: 1 s. Looks, not time: where the whole machine stood still,
/// the guard stood still as well.
const SILENT_TO_ABORT: u32 = 50;
/// Looks without a beat outside of sessions after which the watchdog is no longer beaten: 15 s, above connecting, which
/// takes two seconds at the most.
const SILENT_OUTSIDE: u32 = 750;

/// Pulse that the tick's thread leaves for the guard, and the guard for it.
#[derive(Debug)]
pub struct Pulse {
    beats: AtomicU64,
    in_session: AtomicBool,
    thread: AtomicI32,
    run_delay_ns: AtomicU64,
    /// The largest number until the guard has looked: nothing is later than that.
    stolen_ns: AtomicU64,
}

impl Default for Pulse {
    fn default() -> Self {
        Pulse {
            beats: AtomicU64::new(0),
            in_session: AtomicBool::new(false),
            thread: AtomicI32::new(0),
            run_delay_ns: AtomicU64::new(0),
            stolen_ns: AtomicU64::new(u64::MAX),
        }
    }
}

impl Pulse {
    /// Says which thread is the tick's; called in it.
    pub fn begin(&self) {
        self.thread.store(rustix::thread::gettid().as_raw_nonzero().get(), Ordering::Release);
    }

    /// A tick was answered, or a wait went on.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn beat(&self) {
        self.beats.fetch_add(1, Ordering::Release);
    }

    /// Ticks are due from now on.
    pub fn enter_session(&self) {
        self.in_session.store(true, Ordering::Release);
    }

    /// No ticks are due from now on.
    pub fn leave_session(&self) {
        self.in_session.store(false, Ordering::Release);
    }

    /// Time that the tick's thread lately waited for a CPU, in ns, between the guard's last two looks but one and now.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn run_delay_ns(&self) -> u64 {
        self.run_delay_ns.load(Ordering::Acquire)
    }

    /// Time stolen from all CPUs since the machine started, in ns, as of one of the guard's last looks: 0.2 to 0.4 s old.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn stolen_ns(&self) -> u64 {
        self.stolen_ns.load(Ordering::Acquire)
    }
}

/// Action of the guard on a tick that hangs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OnSilence {
    /// It tells, then ends the process.
    Abort,
    /// It tells only: simulation, where nobody is in danger.
    Tell,
    /// Nothing: in lockstep no tick is due.
    Wait,
}

/// Starts the guard; it ends once `stop` is set.
///
/// # Errors
/// If the thread cannot be started.
pub fn start(
    pulse: Arc<Pulse>,
    on_silence: OnSilence,
    stop: Arc<AtomicBool>,
    say: Box<dyn Fn(String) + Send>,
) -> std::io::Result<JoinHandle<()>> {
    std::thread::Builder::new().name("guard".to_owned()).spawn(move || {
        // Without the right the guard is as late as the rest; the tick's own refusal has told why.
        let _ = raise(PRIORITY);
        let notifier = Notifier::from_environment();
        notifier.ready();
        let mut watched = Watched::new();
        let due = || on_silence != OnSilence::Wait && pulse.in_session.load(Ordering::Acquire);
        while !stop.load(Ordering::Relaxed) {
            std::thread::sleep(until_next_look());
            match watched.look(&pulse) {
                Look::Alive => notifier.beat(),
                Look::Silent(looks) if looks == SILENT_TO_TELL && due() => {
                    say("the tick has been silent for 0.2 s; the cRIO vents by its time to live".to_owned());
                }
                Look::Silent(looks) if looks >= SILENT_TO_ABORT && on_silence == OnSilence::Abort && due() => {
                    say("the tick has been silent for 1 s: ending; the cRIO has vented".to_owned());
                    // Time for the line to reach the recording and the terminal.
                    std::thread::sleep(Duration::from_millis(100));
                    std::process::abort();
                }
                Look::Silent(looks) => {
                    let patience = if due() { SILENT_TO_TELL } else { SILENT_OUTSIDE };
                    if looks < patience && looks.is_multiple_of(SILENT_TO_TELL / 2) {
                        notifier.beat();
                    }
                }
            }
        }
        notifier.stopping();
    })
}

/// Looks between two of the kernel's count of stolen time: it is made anew from all CPUs' whenever it is read.
const STOLEN_EVERY: u32 = 10;

/// Finding of a look.
enum Look {
    /// The tick went on.
    Alive,
    /// It did not, for so many looks.
    Silent(u32),
}

struct Watched {
    beats: u64,
    silent: u32,
    schedule: Option<File>,
    run_delay_ns: u64,
    looks: u32,
    stolen: StolenTime,
    /// Stolen time as of the look before the last.
    earlier_ns: Option<u64>,
}

impl Watched {
    fn new() -> Self {
        Watched {
            beats: 0,
            silent: 0,
            schedule: None,
            run_delay_ns: 0,
            looks: 0,
            stolen: StolenTime::open(),
            earlier_ns: None,
        }
    }

    fn look(&mut self, pulse: &Pulse) -> Look {
        self.read_run_delay(pulse);
        if self.looks.is_multiple_of(STOLEN_EVERY)
            && let Some(total_ns) = self.stolen.total_ns()
        {
            // One look old at least: the last may have come behind what a late tick is about to ask for.
            pulse.stolen_ns.store(self.earlier_ns.replace(total_ns).unwrap_or(total_ns), Ordering::Release);
        }
        self.looks = self.looks.wrapping_add(1);
        let beats = pulse.beats.load(Ordering::Acquire);
        if beats != self.beats {
            (self.beats, self.silent) = (beats, 0);
            return Look::Alive;
        }
        self.silent = self.silent.saturating_add(1);
        Look::Silent(self.silent)
    }

    /// Time waited for a CPU, the second number of the thread's `schedstat`.
    fn read_run_delay(&mut self, pulse: &Pulse) {
        if self.schedule.is_none() {
            let thread = pulse.thread.load(Ordering::Acquire);
            self.schedule =
                (thread > 0).then(|| File::open(format!("/proc/self/task/{thread}/schedstat")).ok()).flatten();
        }
        let Some(file) = self.schedule.as_mut() else { return };
        let mut text = [0; 96];
        let read = file.seek(SeekFrom::Start(0)).and_then(|_| file.read(&mut text));
        let Ok(length) = read else { return };
        let words = String::from_utf8_lossy(text.get(..length).unwrap_or_default()).into_owned();
        if let Some(total) = words.split_whitespace().nth(1).and_then(|word| word.parse::<u64>().ok()) {
            let lately = total.saturating_sub(self.run_delay_ns);
            pulse.run_delay_ns.store(lately, Ordering::Release);
            self.run_delay_ns = total;
        }
    }
}

/// Sleep to the next look: 14 ms after the next point of a 20 ms grid.
fn until_next_look() -> Duration {
    let now = now_ns();
    let mut next = now / PERIOD_NS * PERIOD_NS + COMMAND_DEADLINE_NS;
    // At least half a period between looks, so that a tick can have come.
    while next < now + PERIOD_NS / 2 {
        next += PERIOD_NS;
    }
    Duration::from_nanos(next - now)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tick_that_goes_on_is_alive_and_one_that_hangs_is_counted() {
        let (pulse, mut watched) = (Pulse::default(), Watched::new());
        pulse.begin();
        for _ in 0..5 {
            pulse.beat();
            assert!(matches!(watched.look(&pulse), Look::Alive));
        }
        for looks in 1..20 {
            assert!(matches!(watched.look(&pulse), Look::Silent(n) if n == looks));
        }
    }

    #[test]
    fn looks_are_a_period_apart() {
        for _ in 0..100 {
            let sleep = until_next_look();
            assert!(sleep >= Duration::from_millis(10) && sleep <= Duration::from_millis(30), "{sleep:?}");
        }
    }
}
