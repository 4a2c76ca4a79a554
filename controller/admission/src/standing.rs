//! Worth of a policy that controls, on a model: held against the fallback in the trial on that very model.
//!
//! The trial's other rigs stand for what a model leaves out, and decide whether a policy may fly at all
//! ([`crate::trial::judge`]). This asks another question: a model that was told the truth about its rig makes the
//! feed-forward good, and a policy that was trained on another one may then only be in the way.
//!
//! Both channels are judged together, and each by itself. Together, in kPa, the channel with the larger error counts, and
//! that is the positive one nearly everywhere: a policy whose negative channel errs several times as much as the fallback's
//! would pass for a hundredth less in the positive. By itself a channel is behind only where it is clearly so, for a
//! policy may trade a little of one for more of the other, and where there is hardly any error a ratio says nothing.

use model::observation::{CHANNELS, Pair};
use serde::{Deserialize, Serialize};

use crate::trial::Tally;

/// Most that a policy's error over both channels may be of the fallback's (chosen: twice what another seed of the noise
/// makes of either).
pub const MOST_OF_FALLBACK: f64 = 1.1;
/// Most that its error on one channel may be of the fallback's, unless it is within the converter's noise of it (chosen: the
/// policies that are kept, on the models that they are good on, have up to 1.4 on one channel with less on the other).
pub const MOST_ON_ONE_CHANNEL: f64 = 1.5;

/// Errors on a model, root mean square over the trial's course, in kPa.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Standing {
    /// The policy's, positive and negative pressure.
    pub policy_kpa: Pair,
    /// The fallback's.
    pub fallback_kpa: Pair,
    /// Noise of the converter in the trial: differences within it are none.
    #[serde(default)]
    pub noise_kpa: Pair,
}

/// Ground on which a policy is behind the fallback.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Behind {
    /// By the error over both channels.
    BothChannels,
    /// By that on one channel alone, 0 for the positive, 1 for the negative.
    OneChannel(usize),
}

impl Standing {
    /// The standing on the model itself, which is the first rig of a trial, at a converter with so much noise; `None` where a
    /// trial has no rigs.
    pub fn of(flown: &[Tally], fallback: &[Tally], noise_kpa: Pair) -> Option<Self> {
        Some(Standing { policy_kpa: flown.first()?.rmse_kpa, fallback_kpa: fallback.first()?.rmse_kpa, noise_kpa })
    }

    /// Error of both channels together, root mean square in kPa, as a multiple of the fallback's: a few hundredths of a kPa
    /// on a channel that has hardly any error weigh as little as they do at the actuator.
    pub fn ratio(&self) -> f64 {
        let both = |[positive, negative]: Pair| positive.hypot(negative);
        both(self.policy_kpa) / both(self.fallback_kpa)
    }

    /// Ground on which the policy tracks clearly worse than the fallback, if it does; an error that is no number is one over
    /// both channels.
    pub fn behind(&self) -> Option<Behind> {
        if self.ratio().is_nan() || self.ratio() > MOST_OF_FALLBACK {
            return Some(Behind::BothChannels);
        }
        let is_behind = |c: usize| {
            let (policy_kpa, fallback_kpa) = (self.policy_kpa[c], self.fallback_kpa[c]);
            policy_kpa > MOST_ON_ONE_CHANNEL * fallback_kpa && policy_kpa - fallback_kpa > self.noise_kpa[c]
        };
        (0..CHANNELS).find(|c| is_behind(*c)).map(Behind::OneChannel)
    }

    /// True where the policy tracks clearly worse than the fallback.
    pub fn is_behind(&self) -> bool {
        self.behind().is_some()
    }
}

/// Both channels' errors, and the one channel that decided where it was one.
impl std::fmt::Display for Standing {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let ([pos, neg], [base_pos, base_neg]) = (self.policy_kpa, self.fallback_kpa);
        write!(f, "{pos:.3}/{neg:.3} against {base_pos:.3}/{base_neg:.3} kPa")?;
        let Some(Behind::OneChannel(c)) = self.behind() else { return Ok(()) };
        let channel = if c == 0 { "positive" } else { "negative" };
        let (policy_kpa, fallback_kpa) = (self.policy_kpa[c], self.fallback_kpa[c]);
        write!(f, ", behind on the {channel} channel: {policy_kpa:.3} against {fallback_kpa:.3} kPa")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn standing(policy_kpa: Pair, fallback_kpa: Pair) -> Standing {
        Standing { policy_kpa, fallback_kpa, noise_kpa: [0.06, 0.006] }
    }

    #[test]
    fn behind_is_a_tenth_more_error_over_both_channels() {
        let standing = |policy_kpa| standing(policy_kpa, [0.08, 0.016]);
        assert_eq!(standing([0.08, 0.016]).behind(), None);
        assert_eq!(standing([0.12, 0.008]).behind(), Some(Behind::BothChannels));
        assert_eq!(standing([0.110, 0.095]).behind(), Some(Behind::BothChannels));
        for nothing in [[f64::NAN, 0.016], [0.08, f64::NAN], [f64::INFINITY, 0.016]] {
            assert_eq!(standing(nothing).behind(), Some(Behind::BothChannels));
        }
        assert_eq!(standing([0.110, 0.095]).to_string(), "0.110/0.095 against 0.080/0.016 kPa");
    }

    /// 4.8 times the error on the negative channel, with less over both because the positive one is so much larger.
    #[test]
    fn a_channel_that_is_far_worse_is_not_hidden_by_the_other() {
        let hidden = standing([0.290, 0.095], [0.310, 0.020]);
        assert!(hidden.ratio() < 1.0 && hidden.behind() == Some(Behind::OneChannel(1)), "{hidden:?}");
        assert_eq!(
            hidden.to_string(),
            "0.290/0.095 against 0.310/0.020 kPa, behind on the negative channel: 0.095 against 0.020 kPa"
        );
        // The other way round, where the negative channel is the larger.
        let hidden = standing([0.20, 0.40], [0.10, 0.46]);
        assert!(hidden.ratio() < 1.0 && hidden.behind() == Some(Behind::OneChannel(0)), "{hidden:?}");
        assert!(hidden.to_string().ends_with("behind on the positive channel: 0.200 against 0.100 kPa"));
    }

    #[test]
    fn a_little_more_and_next_to_nothing_are_not_behind() {
        assert_eq!(standing([0.082, 0.019], [0.078, 0.015]).behind(), None);
        assert_eq!(standing([0.078, 0.027], [0.080, 0.019]).behind(), None);
        // Twice the fallback's, and within the noise of it.
        assert_eq!(standing([0.080, 0.010], [0.080, 0.005]).behind(), None);
        assert_eq!(standing([0.080, 0.012], [0.080, 0.005]).behind(), Some(Behind::OneChannel(1)));
        assert_eq!(standing([0.100, 0.300], [0.045, 0.310]).behind(), None, "the positive channel's noise is larger");
    }
}
