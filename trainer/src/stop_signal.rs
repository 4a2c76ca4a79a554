//! Ctrl-C and SIGTERM in work that keeps what it has done: the first one asks it to stop, a second one ends it at once.
//!
//! One rule for all commands: what a signal stopped before it was done ends with 128 and the signal's number, as shells have it, whether
//! or not it can be gone on with; a command that has no end of its own (`trainer rig`) is done when it is stopped.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

use proto::atomic_file;
use signal_hook::consts::{SIGINT, SIGTERM};

use crate::failure::Failure;

/// Time between two looks at the signals.
const LOOK: Duration = Duration::from_millis(20);
/// Exit status of a program that a signal ended, less the signal's number.
const BY_SIGNAL: u8 = 128;

/// Number of the last SIGINT or SIGTERM that came; 0 before.
pub(crate) fn caught() -> Result<Arc<AtomicUsize>, Failure> {
    let caught = Arc::new(AtomicUsize::new(0));
    for signal in [SIGINT, SIGTERM] {
        let number = usize::try_from(signal).unwrap_or_default();
        signal_hook::flag::register_usize(signal, Arc::clone(&caught), number).map_err(Failure::Signals)?;
    }
    Ok(caught)
}

/// Exit status of work that this signal stopped.
pub(crate) fn status(signal: usize) -> u8 {
    BY_SIGNAL.saturating_add(u8::try_from(signal).unwrap_or_default())
}

/// Signals that ask work to stop; two of one kind within one look count as one.
#[derive(Debug, Clone)]
pub(crate) struct StopSignal {
    /// The last that came and was not looked at yet; 0 where there is none.
    caught: Arc<AtomicUsize>,
    /// The first that came; 0 before.
    first: Arc<AtomicUsize>,
    may_end: Arc<AtomicBool>,
}

impl StopSignal {
    /// Begins to listen.
    pub(crate) fn listen() -> Result<Self, Failure> {
        let this = StopSignal { caught: caught()?, first: Arc::default(), may_end: Arc::default() };
        let StopSignal { caught, first, may_end } = this.clone();
        std::thread::spawn(move || {
            let mut second = 0;
            loop {
                std::thread::sleep(LOOK);
                // The first is noted before it is taken: there is no moment in which none seems to have come.
                let signal = caught.load(Ordering::Acquire);
                if signal != 0 {
                    if first.load(Ordering::Relaxed) == 0 {
                        first.store(signal, Ordering::Release);
                    } else {
                        second = signal;
                    }
                    // Another that came meanwhile stays, for the next look.
                    let _ = caught.compare_exchange(signal, 0, Ordering::AcqRel, Ordering::Relaxed);
                }
                if second != 0 && may_end.load(Ordering::Relaxed) {
                    atomic_file::abandon();
                    std::process::exit(status(second).into());
                }
            }
        });
        Ok(this)
    }

    /// Tells whether one has come.
    pub(crate) fn has_come(&self) -> bool {
        self.came() != 0
    }

    /// From here on nothing can be lost, and a second signal ends the program; one that has come already does.
    pub(crate) fn may_end(&self) {
        self.may_end.store(true, Ordering::Relaxed);
    }

    /// The end of work that was stopped, in these words.
    pub(crate) fn stopped(&self, said: impl Into<String>) -> Failure {
        Failure::Stopped { said: said.into(), status: status(self.came()) }
    }

    /// The first that came, seen at once; 0 before.
    fn came(&self) -> usize {
        let caught = self.caught.load(Ordering::Acquire);
        match self.first.load(Ordering::Acquire) {
            0 => caught,
            first => first,
        }
    }
}
