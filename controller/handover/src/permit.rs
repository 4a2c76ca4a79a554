//! Until when a request counts that takes work before it can be handed to the tick.
//!
//! Whoever asked and whoever works for it hold the same permit. It is used once, right before the hand-over, or withdrawn,
//! and never both: an answer "not done" stays true, however long the work goes on.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::{Duration, Instant};

const OPEN: u8 = 0;
const USED: u8 = 1;
const WITHDRAWN: u8 = 2;

/// A request whose time is over, or whose asker has left.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NoLongerWanted;

impl std::fmt::Display for NoLongerWanted {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("its time was over, or whoever asked had left, before it was ready; nothing has changed")
    }
}

/// The right to hand something over to the tick, once.
#[derive(Debug, Clone)]
pub struct Permit {
    state: Arc<AtomicU8>,
    until: Option<Instant>,
}

impl Permit {
    /// A permit that counts for so long from now.
    pub fn lasting(time: Duration) -> Self {
        Permit { state: Arc::new(AtomicU8::new(OPEN)), until: Some(Instant::now() + time) }
    }

    /// A permit without an end, for what nobody waits for.
    pub fn unlimited() -> Self {
        Permit { state: Arc::new(AtomicU8::new(OPEN)), until: None }
    }

    /// Uses it; to be called right before the hand-over.
    ///
    /// # Errors
    /// It was withdrawn or used before, or its time is over: nothing may be handed over.
    pub fn redeem(&self) -> Result<(), NoLongerWanted> {
        if self.until.is_some_and(|until| Instant::now() >= until) {
            self.settle(WITHDRAWN);
        }
        if self.settle(USED) { Ok(()) } else { Err(NoLongerWanted) }
    }

    /// Withdraws it; `false` where it has been used.
    pub fn withdraw(&self) -> bool {
        self.settle(WITHDRAWN) || self.state.load(Ordering::Acquire) == WITHDRAWN
    }

    fn settle(&self, to: u8) -> bool {
        self.state.compare_exchange(OPEN, to, Ordering::AcqRel, Ordering::Acquire).is_ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LONG: Duration = Duration::from_secs(3600);

    #[test]
    fn a_permit_is_used_once_or_withdrawn() {
        let used = Permit::lasting(LONG);
        assert_eq!((used.redeem(), used.redeem()), (Ok(()), Err(NoLongerWanted)));
        assert!(!used.withdraw(), "it cannot be had back");
        let withdrawn = Permit::unlimited();
        assert!(withdrawn.withdraw() && withdrawn.clone().withdraw());
        assert_eq!(withdrawn.redeem(), Err(NoLongerWanted));
    }

    #[test]
    fn after_its_time_it_counts_for_nothing_and_the_answer_stays_true() {
        let late = Permit::lasting(Duration::ZERO);
        assert_eq!(late.redeem(), Err(NoLongerWanted));
        assert!(late.withdraw(), "nothing was handed over, and nothing will be");
    }
}
