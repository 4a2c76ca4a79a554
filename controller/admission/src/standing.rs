//! Worth of a policy that controls, on a model: held against the fallback in the trial on that very model.
//!
//! The trial's other rigs stand for what a model leaves out, and decide whether a policy may fly at all
//! ([`crate::trial::judge`]). This asks another question: a model that was told the truth about its rig makes the
//! feed-forward good, and a policy that was trained on another one may then only be in the way.

use model::observation::Pair;
use serde::{Deserialize, Serialize};

use crate::trial::Tally;

/// Most that a policy's error over both channels may be of the fallback's (chosen: twice what another seed of the noise
/// makes of either).
pub const MOST_OF_FALLBACK: f64 = 1.1;

/// Errors on a model, root mean square over the trial's course, in kPa.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Standing {
    /// The policy's, positive and negative pressure.
    pub policy_kpa: Pair,
    /// The fallback's.
    pub fallback_kpa: Pair,
}

impl Standing {
    /// The standing on the model itself, which is the first rig of a trial; `None` where a trial has no rigs.
    pub fn of(flown: &[Tally], fallback: &[Tally]) -> Option<Self> {
        Some(Standing { policy_kpa: flown.first()?.rmse_kpa, fallback_kpa: fallback.first()?.rmse_kpa })
    }

    /// Error of both channels together, root mean square in kPa, as a multiple of the fallback's: a few hundredths of a kPa
    /// on a channel that has hardly any error weigh as little as they do at the actuator.
    pub fn ratio(&self) -> f64 {
        let both = |[positive, negative]: Pair| positive.hypot(negative);
        both(self.policy_kpa) / both(self.fallback_kpa)
    }

    /// True where the policy tracks clearly worse than the fallback; also where its error is no number.
    pub fn is_behind(&self) -> bool {
        self.ratio().is_nan() || self.ratio() > MOST_OF_FALLBACK
    }
}

impl std::fmt::Display for Standing {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let ([pos, neg], [base_pos, base_neg]) = (self.policy_kpa, self.fallback_kpa);
        write!(f, "{pos:.3}/{neg:.3} against {base_pos:.3}/{base_neg:.3} kPa")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn behind_is_a_tenth_more_error_over_both_channels() {
        let standing = |policy_kpa| Standing { policy_kpa, fallback_kpa: [0.08, 0.016] };
        assert!(!standing([0.08, 0.016]).is_behind());
        // Twice the error where there is next to none, and a tenth less where there is some.
        assert!(!standing([0.072, 0.032]).is_behind());
        assert!(standing([0.12, 0.008]).is_behind());
        assert!(standing([0.110, 0.095]).is_behind());
        assert!(standing([f64::NAN, 0.016]).is_behind() && standing([f64::INFINITY, 0.016]).is_behind());
        assert_eq!(standing([0.110, 0.095]).to_string(), "0.110/0.095 against 0.080/0.016 kPa");
    }
}
