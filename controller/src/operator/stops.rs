//! Count of the rig's stops. A request notes the count when it is made, and is refused if the count has grown.
//!
//! The state alone does not tell: a rig that was disarmed, or vented and acknowledged, stands by as it did before.

use std::sync::atomic::{AtomicU16, AtomicU64, Ordering};

use supervisor::Condition;

use crate::operator::mailbox::Status;

/// All that has stopped the rig so far, as somebody notes it who asks for something.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Stops {
    pub(super) disarmings: u64,
    /// Count of vented statuses by then.
    pub(super) vented_looks: u64,
}

/// A stop of the rig.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stop {
    /// Somebody disarmed it.
    Disarmed,
    /// It was vented, for this where that is known.
    Vented(Option<Condition>),
}

/// Count of the statuses of a rig that was vented, waited for a person, or had no session. A venting is many of them, so that one is
/// seen by who comes in the middle of it, too. Only the tick counts.
#[derive(Debug, Default)]
pub(super) struct VentedLooks {
    looks: AtomicU64,
    /// Code of the condition at the last of them, 0 where none is known.
    cause: AtomicU16,
}

impl VentedLooks {
    /// Counts a status of a rig that is stopped; to be called before it is shown, so that whoever sees it finds it counted.
    ///
    /// # Real-time
    /// Runs in the tick: lock-free, allocation-free.
    pub(super) fn count(&self, status: &Status) {
        if status.state.is_vented() || status.latched.is_some() || status.session == 0 {
            let cause = status.latched.or(status.fault);
            self.cause.store(cause.map_or(0, Condition::code), Ordering::Release);
            self.looks.fetch_add(1, Ordering::AcqRel);
        }
    }

    pub(super) fn looks(&self) -> u64 {
        self.looks.load(Ordering::Acquire)
    }

    /// The venting that came after these, where one did.
    pub(super) fn since(&self, since: Stops) -> Option<Stop> {
        (self.looks() != since.vented_looks)
            .then(|| Stop::Vented(Condition::from_code(self.cause.load(Ordering::Acquire))))
    }
}
