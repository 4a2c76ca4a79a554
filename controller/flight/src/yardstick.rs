//! Yardsticks of a run: the feed-forward PI on the same rig and reference and, where it is known, the clairvoyant
//! optimum (rig and reference known in advance).

use serde::Serialize;

/// The rig that the yardstick was taken on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum OnWhichRig {
    /// The rig of the run, simulated.
    TheRig,
    /// The model of it: a rig that conceals nothing, on which everything is easier.
    TheModel,
}

/// RMSE that others reach; positive, negative (kPa).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RunYardstick {
    /// The feed-forward PI; `None` where it did not run for longer than the settling time.
    pub fallback_kpa: [Option<f64>; 2],
    /// The clairvoyant optimum.
    pub optimum_kpa: Option<[f64; 2]>,
    /// Place where that was.
    pub on: OnWhichRig,
}

/// Judgement of a channel's error by the yardstick.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Standing {
    /// No worse, within what noise and a real clock do.
    Fair,
    /// Worse, and worth a look.
    Worse,
    /// Worse by so much that the run cannot be called good.
    FarWorse,
}

/// Multiples of the fallback's RMSE, and the least difference that counts (kPa): from here on an error is worse.
struct Margin {
    times: f64,
    kpa: f64,
}

impl OnWhichRig {
    // Chosen. On the rig itself the fallback's own error scatters by 5 % over seeds and real time adds up to a tenth of it;
    // the differences are half of what the converter's steps leave. A real rig is two to ten times harder than its model
    // (`bench` against `dual_pressure`: 1.7 and 9.4), so there only a multiple of that says anything.
    const fn worse(self) -> Margin {
        match self {
            Self::TheRig => Margin { times: 1.2, kpa: 0.02 },
            Self::TheModel => Margin { times: 10.0, kpa: 0.2 },
        }
    }

    const fn far_worse(self) -> Margin {
        match self {
            Self::TheRig => Margin { times: 2.0, kpa: 0.05 },
            Self::TheModel => Margin { times: 20.0, kpa: 1.0 },
        }
    }

    /// A few words for tables and sentences.
    pub(crate) const fn words(self) -> &'static str {
        match self {
            Self::TheRig => "on the same rig and reference",
            Self::TheModel => "on the model of this rig, same reference",
        }
    }
}

impl RunYardstick {
    /// Judges an RMSE (kPa) by what the fallback reaches on a channel.
    pub(crate) fn standing(&self, channel: usize, rmse_kpa: f64) -> Standing {
        let Some(fallback_kpa) = self.fallback_kpa.get(channel).copied().flatten() else { return Standing::Fair };
        let beyond = |margin: Margin| rmse_kpa > margin.times * fallback_kpa && rmse_kpa - fallback_kpa > margin.kpa;
        match (beyond(self.on.far_worse()), beyond(self.on.worse())) {
            (true, _) => Standing::FarWorse,
            (false, true) => Standing::Worse,
            (false, false) => Standing::Fair,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_is_judged_by_the_fallback_and_not_by_a_number_of_kpa() {
        let on_bench = RunYardstick {
            fallback_kpa: [Some(0.215), Some(0.217)],
            optimum_kpa: Some([0.079, 0.017]),
            on: OnWhichRig::TheRig,
        };
        let standing = |yardstick: &RunYardstick, pos, neg| [yardstick.standing(0, pos), yardstick.standing(1, neg)];
        assert_eq!(standing(&on_bench, 0.125, 0.116), [Standing::Fair; 2], "the shipped policy");
        assert_eq!(standing(&on_bench, 0.22, 0.22), [Standing::Fair; 2], "the fallback itself");
        assert_eq!(standing(&on_bench, 5.11, 2.73), [Standing::FarWorse; 2], "a policy that answers 0.5 always");
        assert_eq!(standing(&on_bench, 0.3, 0.5), [Standing::Worse, Standing::FarWorse]);
        let on_model = RunYardstick { on: OnWhichRig::TheModel, fallback_kpa: [Some(0.127), Some(0.023)], ..on_bench };
        assert_eq!(standing(&on_model, 0.6, 0.22), [Standing::Fair; 2], "a real rig is harder than its model");
        assert_eq!(standing(&on_model, 5.11, 2.73), [Standing::FarWorse; 2]);
    }
}
