//! Ctrl-C and SIGTERM in work that keeps what it has done: the first one asks it to stop, a second one ends it at once.
//!
//! One rule for all commands: what a signal stopped before it was done ends with 128 and the signal's number, as shells have it, whether
//! or not it can be gone on with; a command that has no end of its own (`trainer rig`) is done when it is stopped.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use proto::atomic_file;
use proto::first_signal::{FirstSignal, exit_status};
use signal_hook::consts::{SIGINT, SIGTERM};

use crate::failure::{FAILED, Failure};

/// Time between two looks at the signals.
const LOOK: Duration = Duration::from_millis(20);
/// Catches SIGINT and SIGTERM from here on.
pub(crate) fn caught() -> Result<FirstSignal, Failure> {
    let caught = FirstSignal::default();
    for signal in [SIGINT, SIGTERM] {
        let number = usize::try_from(signal).unwrap_or_default();
        signal_hook::flag::register_usize(signal, Arc::clone(caught.newest()), number).map_err(Failure::Signals)?;
    }
    Ok(caught)
}

/// Signals that ask work to stop.
#[derive(Debug, Clone)]
pub(crate) struct StopSignal {
    caught: FirstSignal,
    may_end: Arc<AtomicBool>,
}

impl StopSignal {
    /// Begins to listen.
    pub(crate) fn listen() -> Result<Self, Failure> {
        let this = StopSignal { caught: caught()?, may_end: Arc::default() };
        let StopSignal { caught, may_end } = this.clone();
        std::thread::spawn(move || {
            loop {
                std::thread::sleep(LOOK);
                if let Some(second) = caught.another()
                    && may_end.load(Ordering::Relaxed)
                {
                    atomic_file::abandon();
                    std::process::exit(exit_status(second).into());
                }
            }
        });
        Ok(this)
    }

    /// Tells whether one has come.
    pub(crate) fn has_come(&self) -> bool {
        self.caught.number().is_some()
    }

    /// From here on nothing can be lost, and a second signal ends the program; one that has come already does.
    pub(crate) fn may_end(&self) {
        self.may_end.store(true, Ordering::Relaxed);
    }

    /// The end of work that was stopped, in these words.
    pub(crate) fn stopped(&self, said: impl Into<String>) -> Failure {
        Failure::Stopped { said: said.into(), status: self.caught.exit_status().unwrap_or(FAILED) }
    }
}
