//! The supply of the valves' drivers, undone: the duties to send for those that are to act.
//!
//! ```text
//! yᵢ = uᵢ (1 − k S),  S = Σⱼ uⱼ      gives      Σ y = S − k S²,      S = 2 Σ y / (1 + √(1 − 4 k Σ y)),      uᵢ = yᵢ/(1 − k S)
//! ```

use crate::mechanism::Mechanism;
use crate::observation::Pair;
use crate::rig::Rig;

/// A supply that sags under the current of both valves (`supply_sag`); one that does not loses nothing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Supply {
    /// k, in 1/duty.
    loss_per_duty: f64,
}

impl Supply {
    /// Supply of a rig.
    pub(super) fn of(rig: &Rig) -> Self {
        let losses = rig.mechanisms.iter().filter(|m| m.enabled).map(|m| match &m.mechanism {
            Mechanism::SupplySag(sag) => sag.loss_per_duty,
            _ => 0.0,
        });
        Supply { loss_per_duty: losses.sum() }
    }

    /// Duties that act where these are sent.
    pub(super) fn acting(self, sent: Pair) -> Pair {
        let left = 1.0 - self.loss_per_duty * (sent[0] + sent[1]);
        sent.map(|duty| duty * left)
    }

    /// By how much the duty that acts at each valve grows with its own that is sent, around those that are sent. Where more
    /// current would give less, it is answered as if a quarter was left.
    pub(super) fn acting_per_sent(self, sent: Pair) -> Pair {
        let left = 1.0 - self.loss_per_duty * (sent[0] + sent[1]);
        sent.map(|duty| (left - self.loss_per_duty * duty).max(0.25))
    }

    /// Duties to send for those that are to act, both beyond 0 … 1 where no duty does. More than the supply can give is
    /// answered as if it lost no more than at the most that it gives.
    pub(super) fn sent(self, acting: Pair) -> Pair {
        let sum = acting[0] + acting[1];
        let all = 2.0 * sum / (1.0 + (1.0 - 4.0 * self.loss_per_duty * sum).max(0.0).sqrt());
        let left = 1.0 - self.loss_per_duty * all;
        acting.map(|duty| duty / left.max(0.5))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_sent_acts_as_it_is_to() {
        for loss_per_duty in [0.0, 0.03, 0.12] {
            let supply = Supply { loss_per_duty };
            for acting in [[0.8, 0.75], [0.0, 0.9], [0.3, -0.1], [0.0, 0.0]] {
                let again = supply.acting(supply.sent(acting));
                let close = |c: usize| (again[c] - acting[c]).abs() < 1e-12;
                assert!(close(0) && close(1), "{loss_per_duty}: {again:?} for {acting:?}");
            }
        }
        assert_eq!(Supply { loss_per_duty: 0.0 }.sent([0.8, 0.7]), [0.8, 0.7]);
        // Half of the voltage is lost where it gives the most.
        assert!(Supply { loss_per_duty: 0.5 }.sent([1.0, 1.0]).iter().all(|duty| duty.is_finite()));
    }
}
