//! The signal that asked a program to end, and the exit status that tells of it: 128 and the signal's number, as shells have it.
//!
//! Scripts that chain the two programs read that status, and `trainer adapt` that of the programs it starts: like all of this crate, a
//! form in which processes speak to each other. Handlers are each program's own; they only put a number here.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Exit status of a program that a signal ended, less the signal's number.
const BY_SIGNAL: u8 = 128;

/// First of the signals that asked a program to end. Those that come between two looks count as one, the last of them.
#[derive(Debug, Clone, Default)]
pub struct FirstSignal {
    newest: Arc<AtomicUsize>,
    seen: Arc<Mutex<Seen>>,
}

/// Signals that a look has found.
#[derive(Debug, Clone, Copy, Default)]
struct Seen {
    first: Option<usize>,
    another: Option<usize>,
}

impl FirstSignal {
    /// Place where a handler puts the number of a signal that came; 0 where none came since the last look.
    pub fn newest(&self) -> &Arc<AtomicUsize> {
        &self.newest
    }

    /// Number of the first that came; `None` before. A look.
    pub fn number(&self) -> Option<usize> {
        self.look().first
    }

    /// Number of the last that came after the first; `None` before. A look.
    pub fn another(&self) -> Option<usize> {
        self.look().another
    }

    /// Exit status of work that was stopped before it was done; `None` where no signal came. A look.
    pub fn exit_status(&self) -> Option<u8> {
        self.number().map(exit_status)
    }

    fn look(&self) -> Seen {
        // Held from the taking to the noting: at no moment does none seem to have come.
        let mut seen = self.seen.lock().unwrap_or_else(PoisonError::into_inner);
        let newest = self.newest.swap(0, Ordering::AcqRel);
        if newest != 0 {
            let place = if seen.first.is_none() { &mut seen.first } else { &mut seen.another };
            *place = Some(newest);
        }
        *seen
    }
}

/// Exit status of work that this signal stopped before it was done.
pub fn exit_status(signal: usize) -> u8 {
    BY_SIGNAL.saturating_add(u8::try_from(signal).unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_signal_gives_the_status_whatever_comes_after_it() {
        let signals = FirstSignal::default();
        assert_eq!((signals.number(), signals.another(), signals.exit_status()), (None, None, None));
        for (number, another) in [(2, None), (15, Some(15)), (2, Some(2))] {
            // As a handler does; the clone is what another thread has.
            signals.clone().newest().store(number, Ordering::Release);
            // A shell says 130 where SIGINT ended a program.
            assert_eq!((signals.exit_status(), signals.another()), (Some(130), another));
        }
        assert_eq!((exit_status(15), exit_status(usize::MAX)), (143, 128));
    }
}
