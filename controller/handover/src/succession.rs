//! Policies that control, are on their way or controlled before, by tags; what an order makes of them.
//!
//! The tick carries orders out by these rules ([`crate::arbiter`]). Whoever gives an order foresees by the same ones what it
//! will do behind those that still wait.

use serde::{Deserialize, Serialize};

use crate::channel::PolicyTag;

/// The policies that a loop holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Succession {
    /// The incumbent.
    pub incumbent: PolicyTag,
    /// The candidate, if one is on its way.
    pub candidate: Option<PolicyTag>,
    /// Predecessor of the incumbent, if it can be gone back to; while it is the candidate, it is named here as well.
    pub before: Option<PolicyTag>,
}

/// Meaning of going back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WayBack {
    /// The candidate is withdrawn; the incumbent controls on.
    Withdraws(PolicyTag),
    /// The incumbent's predecessor becomes a candidate, straight into all of the command.
    Returns(PolicyTag),
    /// There is nothing to go back to.
    Nowhere,
}

impl Succession {
    /// Meaning of going back now.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn way_back(&self) -> WayBack {
        match (self.candidate, self.before) {
            (Some(candidate), _) => WayBack::Withdraws(candidate),
            (None, Some(before)) => WayBack::Returns(before),
            (None, None) => WayBack::Nowhere,
        }
    }

    /// The succession once it was gone back.
    #[must_use]
    pub fn gone_back(self) -> Self {
        match self.way_back() {
            WayBack::Withdraws(_) => Succession { candidate: None, ..self },
            WayBack::Returns(before) => Succession { candidate: Some(before), ..self },
            WayBack::Nowhere => self,
        }
    }

    /// The succession once a policy was tried: what controls already goes on alone.
    #[must_use]
    pub fn tried(self, tag: PolicyTag) -> Self {
        Succession { candidate: Some(tag).filter(|tag| *tag != self.incumbent), ..self }
    }

    /// Tells whether a policy is one of them.
    pub fn holds(&self, tag: PolicyTag) -> bool {
        self.incumbent == tag || self.candidate == Some(tag) || self.before == Some(tag)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn going_back_takes_a_candidate_back_first_and_then_the_incumbent() {
        let [a, b, c] = [1, 2, 3].map(PolicyTag);
        let alone = Succession { incumbent: a, ..Succession::default() };
        assert_eq!((alone.way_back(), alone.gone_back()), (WayBack::Nowhere, alone));
        let tried = alone.tried(b);
        assert_eq!((tried.way_back(), tried.gone_back()), (WayBack::Withdraws(b), alone));
        assert_eq!(tried.tried(a), alone, "what controls already goes on alone");
        let followed = Succession { incumbent: b, candidate: None, before: Some(a) };
        let back = followed.gone_back();
        assert_eq!((followed.way_back(), back.candidate), (WayBack::Returns(a), Some(a)));
        assert_eq!(back.gone_back(), followed, "and what was withdrawn can be gone back to again");
        assert!(back.holds(a) && back.holds(b) && !back.holds(c));
    }
}
