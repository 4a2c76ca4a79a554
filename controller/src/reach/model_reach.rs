//! Reach of one model, with the last answer about a reference: working one out takes long, and each arming asks again.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use model::steady::SteadyMap;
use proto::reference::Reference;

use super::{Reach, beyond_reach};

/// Answer about a reference, as far as it is known.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum KnownReach {
    /// The line about it; `None` where the rig reaches it.
    Known(Option<String>),
    /// It has not been worked out.
    Unknown,
}

/// Reach of a rig by one model.
pub struct ModelReach {
    map: Arc<SteadyMap>,
    range: Option<Reach>,
    /// Identity of the reference that was asked about last, and the line about it; held for a moment only.
    last: Mutex<Option<(u64, Option<String>)>>,
}

impl ModelReach {
    /// Reach of the rig that a map was made of.
    ///
    /// # Real-time
    /// Some milliseconds; not for the tick.
    pub fn of(map: Arc<SteadyMap>) -> Self {
        ModelReach { range: Reach::of(&map), map, last: Mutex::default() }
    }

    /// Range of what the rig can hold; `None` where its numbers are none.
    pub fn range(&self) -> Option<Reach> {
        self.range
    }

    /// One line about a reference that asks for more than the rig gives ([`beyond_reach`]).
    ///
    /// # Real-time
    /// Up to some tenths of a second, on slow rigs some seconds, where it is another reference than the last time: neither for the
    /// tick nor for the thread that answers operators.
    pub fn beyond(&self, reference: &Reference) -> Option<String> {
        if let KnownReach::Known(line) = self.known(reference) {
            return line;
        }
        let line = beyond_reach(&self.map, reference);
        *self.last() = Some((reference.identity(), line.clone()));
        line
    }

    /// Answer of [`ModelReach::beyond`] where it has been worked out; does not wait.
    pub fn known(&self, reference: &Reference) -> KnownReach {
        match &*self.last() {
            Some((identity, line)) if *identity == reference.identity() => KnownReach::Known(line.clone()),
            _ => KnownReach::Unknown,
        }
    }

    fn last(&self) -> MutexGuard<'_, Option<(u64, Option<String>)>> {
        self.last.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use model::rig::Rig;

    #[test]
    fn what_was_worked_out_last_is_known_and_no_other() {
        let map = SteadyMap::new(&Rig::builtin("dual_pressure").unwrap()).unwrap();
        let reach = ModelReach::of(Arc::new(map));
        let (low, held) = (Reference::constant(12.0, -70.0), Reference::constant(90.0, -70.0));
        assert_eq!(reach.known(&low), KnownReach::Unknown);
        let line = reach.beyond(&low);
        assert!(line.as_ref().is_some_and(|line| line.contains("asks for 12.0 kPa")), "{line:?}");
        assert_eq!((reach.known(&low), reach.known(&held)), (KnownReach::Known(line), KnownReach::Unknown));
        assert_eq!(reach.beyond(&held), None);
        assert_eq!((reach.known(&held), reach.known(&low)), (KnownReach::Known(None), KnownReach::Unknown));
    }
}
