//! Comparison of two flights, with what flights of one controller differ by as its yardstick.

use serde::{Deserialize, Serialize};

use crate::guard::WORSE;
use crate::optimum::NEAR;
use crate::tracking::Tracking;

/// Ratio up to which the errors of two flights of one controller differ (geometric mean of both channels). Chosen: six runs of the shipped policy and of the
/// fallback on `bench`, told and not, differ by 0.5 to 2.3 % in the mean of pairs; half of what ends a flight ([`WORSE`]).
const ALIKE: f64 = 1.0 + (WORSE - 1.0) / 2.0;

/// Verdict on a flight beside another.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Comparison {
    /// It errs by less, beyond what flights of one controller differ by.
    Better,
    /// Neither: they differ by no more than flights of one controller do, or one channel pays for the other.
    NoDifferent,
    /// It errs by more, beyond that.
    Worse,
}

impl Comparison {
    /// Comparison of a flight with one before it. What is gained on one channel at the other's cost (more than 5 %) is no gain.
    pub fn of(after: &Tracking, before: &Tracking) -> Self {
        Ratios::of(after, before).comparison()
    }
}

/// Errors of a flight over those of another.
struct Ratios {
    /// Geometric mean of both channels.
    mean: f64,
    by_channel: [f64; 2],
}

impl Ratios {
    fn of(after: &Tracking, before: &Tracking) -> Self {
        Ratios { mean: after.over(before), by_channel: after.over_by_channel(before) }
    }

    /// Tells whether the mean of both channels is less by more than flights of one controller differ by.
    fn is_less(&self) -> bool {
        self.mean * ALIKE < 1.0
    }

    fn comparison(&self) -> Comparison {
        let [pos, neg] = self.by_channel;
        if self.is_less() && pos.max(neg) <= WORSE {
            Comparison::Better
        } else if self.mean <= ALIKE {
            Comparison::NoDifferent
        } else {
            // What is no number is no gain.
            Comparison::Worse
        }
    }
}

/// Tells whether a trained policy is kept beside the best without it: not where it tracks worse, and not where the best
/// is better than what was there before and the policy is not.
pub(crate) fn is_kept(policy: &Tracking, best: &Tracking, before: Option<&Tracking>) -> bool {
    let is_better =
        |flight: &Tracking| before.is_none_or(|before| Comparison::of(flight, before) == Comparison::Better);
    Comparison::of(policy, best) != Comparison::Worse && (is_better(policy) || !is_better(best))
}

/// Sentence on how the rig tracks now beside before, with what was to be gained where the optimum is known.
pub(crate) fn headline(after: &Tracking, before: &Tracking, optimum_kpa: Option<[f64; 2]>) -> String {
    let ratios = Ratios::of(after, before);
    match ratios.comparison() {
        Comparison::Better => {
            format!(
                "tracks better than before: {:.0} % less error (geometric mean of both channels)",
                100.0 * (1.0 - ratios.mean)
            )
        }
        Comparison::NoDifferent if ratios.is_less() => {
            let [pos, neg] = ratios.by_channel.map(|times| 100.0 * (times - 1.0));
            format!(
                "tracks better on one channel and worse on the other ({pos:+.0} % and {neg:+.0} % error), which is no gain"
            )
        }
        Comparison::NoDifferent => match optimum_kpa.map(|optimum_kpa| after.times(optimum_kpa)) {
            Some(times) if times <= NEAR => {
                format!("tracks as well as before; little was to gain: {times:.2} times the optimum")
            }
            Some(times) => {
                format!("tracks as well as before; nothing was gained: {times:.2} times the optimum")
            }
            None => "tracks as well as before".to_owned(),
        },
        Comparison::Worse => {
            format!(
                "tracks worse than before: {:.0} % more error (geometric mean of both channels)",
                100.0 * (ratios.mean - 1.0)
            )
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A flight that errs by so much, 3 : 4 between the channels.
    fn flight(both_kpa: f64) -> Tracking {
        let rmse_kpa = [0.6 * both_kpa, 0.8 * both_kpa];
        Tracking { rmse_kpa, late_rmse_kpa: None, noise_kpa: [0.06, 0.006], ticks: 2500 }
    }

    #[test]
    fn flights_that_differ_as_those_of_one_controller_do_are_no_different() {
        let before = flight(0.08);
        for (both_kpa, expected) in [
            (0.040, Comparison::Better),
            (0.077, Comparison::Better),
            (0.0795, Comparison::NoDifferent),
            (0.080, Comparison::NoDifferent),
            (0.0815, Comparison::NoDifferent),
            (0.083, Comparison::Worse),
            (f64::NAN, Comparison::Worse),
        ] {
            assert_eq!(Comparison::of(&flight(both_kpa), &before), expected, "{both_kpa}");
        }
        // Whichever of the two comes first.
        assert_eq!(Comparison::of(&flight(0.1), &flight(0.1024)), Comparison::NoDifferent);
        assert_eq!(Comparison::of(&flight(0.1024), &flight(0.1)), Comparison::NoDifferent);
    }

    /// A gain on the negative channel counts where the reference is out of reach of the positive one; a channel that gets clearly worse is
    /// not made up for by the other.
    #[test]
    fn each_channel_counts_by_its_own_measure() {
        let both = |rmse_kpa| Tracking { rmse_kpa, ..flight(1.0) };
        let before = both([0.227, 0.049]);
        assert_eq!(Comparison::of(&both([0.232, 0.017]), &before), Comparison::Better);
        assert_eq!(Comparison::of(&before, &both([0.232, 0.017])), Comparison::Worse);
        let paid_for = both([0.245, 0.017]);
        assert_eq!(Comparison::of(&paid_for, &before), Comparison::NoDifferent);
        let said = headline(&paid_for, &before, Some([0.22, 0.01]));
        assert_eq!(
            said,
            "tracks better on one channel and worse on the other (+8 % and -65 % error), which is no gain"
        );
    }

    #[test]
    fn a_policy_is_kept_unless_it_tracks_worse_or_gives_away_what_was_gained() {
        let kept = |policy, best, before| is_kept(&flight(policy), &flight(best), Some(&flight(before)));
        assert!(kept(0.05, 0.08, 0.5) && kept(0.0815, 0.08, 0.5), "better, and as good");
        assert!(!kept(0.083, 0.08, 0.5), "a twenty-seventh worse than without it");
        assert!(!kept(0.0985, 0.097, 0.1), "the best without it is better than before, it is not");
        assert!(kept(0.1, 0.0999, 0.1), "neither is");
    }

    #[test]
    fn the_headline_says_by_how_much_and_what_was_to_gain() {
        let said = |after, optimum_kpa| headline(&flight(after), &flight(0.08), optimum_kpa);
        assert!(said(0.02, None).starts_with("tracks better than before: 75 % less"));
        assert!(said(0.12, None).starts_with("tracks worse than before: 50 % more"));
        // An optimum of 0.078 kPa, then of 0.04.
        let near = said(0.08, Some([0.0468, 0.0624]));
        assert_eq!(near, "tracks as well as before; little was to gain: 1.03 times the optimum");
        let far = said(0.08, Some([0.024, 0.032]));
        assert_eq!(far, "tracks as well as before; nothing was gained: 2.00 times the optimum");
        assert_eq!(said(0.08, None), "tracks as well as before");
    }
}
