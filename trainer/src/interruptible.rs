//! Ctrl-C and SIGTERM in work that writes its results at the end: over at once, and nothing half-written.
//!
//! Until the results are written there is nothing to save, so the program ends within a tenth of a second. While they are
//! written (some milliseconds) it waits for that, and says so.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use crate::failure::{Failure, tell};
use crate::stop_signal::caught;

/// Time between two looks at the signals.
const LOOK: Duration = Duration::from_millis(50);

/// Work that may be interrupted at any time but while it writes.
pub(crate) struct Interruptible {
    /// Held while results are written; whether they are.
    written: Arc<Mutex<bool>>,
}

impl Interruptible {
    /// Begins to listen for Ctrl-C and SIGTERM.
    pub(crate) fn begin() -> Result<Self, Failure> {
        let caught = caught()?;
        let written = Arc::new(Mutex::new(false));
        let seen = Arc::clone(&written);
        std::thread::spawn(move || {
            loop {
                std::thread::sleep(LOOK);
                if let Some(status) = caught.exit_status() {
                    let done = *seen.lock().unwrap_or_else(PoisonError::into_inner);
                    tell(if done { "stopped; the results are written" } else { STOPPED });
                    std::process::exit(status.into());
                }
            }
        });
        Ok(Interruptible { written })
    }

    /// Does what must not be interrupted: a check that leaves a file for a moment.
    pub(crate) fn undisturbed<T>(&self, work: impl FnOnce() -> T) -> T {
        let _held = self.hold();
        work()
    }

    /// Writes results.
    pub(crate) fn write<E>(&self, work: impl FnOnce() -> Result<(), E>) -> Result<(), E> {
        let mut held = self.hold();
        work()?;
        *held = true;
        Ok(())
    }

    fn hold(&self) -> MutexGuard<'_, bool> {
        self.written.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

const STOPPED: &str = "stopped; nothing was written, and older results are as they were";
