//! Test whether a candidate's part in the commands of a stage is large enough to explain the errors of that stage.

use model::observation::{CHANNELS, Pair};

/// Settled pressures (rows: positive, negative) by a share of either duty, in kPa per duty: the most that
/// `conduct::tests::a_blameless_share_moves_no_pressure_far` finds on `dual_pressure`. The controllers work against a share, so what it
/// really does is less.
const SETTLED_KPA_PER_DUTY: [Pair; CHANNELS] = [[170.0, 100.0], [4.0, 55.0]];
/// A share whose effect is below this part of the errors, root mean squares of both, does not explain them.
const EXPLAINS: f64 = 0.5;

/// Sums of squares over a stage.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Share {
    effect_kpa: Pair,
    error_kpa: Pair,
}

impl Share {
    /// Takes in a tick: the candidate's part of the duties, and errors in kPa.
    ///
    /// # Real-time
    /// May run in the tick.
    pub(crate) fn add(&mut self, part_duty: Pair, error_kpa: Pair) {
        for c in 0..CHANNELS {
            let by_duty = SETTLED_KPA_PER_DUTY[c].iter().zip(part_duty);
            self.effect_kpa[c] += by_duty.map(|(kpa, part)| kpa * part).sum::<f64>().powi(2);
            self.error_kpa[c] += error_kpa[c].powi(2);
        }
    }

    /// Tells whether it may have caused the errors of either channel.
    pub(crate) fn explains_errors(&self) -> bool {
        // Not below, rather than beyond: errors that are no numbers are blamed.
        (0..CHANNELS).any(|c| {
            let is_below = self.effect_kpa[c] < EXPLAINS * EXPLAINS * self.error_kpa[c];
            !is_below
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_small_share_explains_small_errors_alone() {
        let explains = |part: f64, error_kpa: f64| {
            let mut share = Share::default();
            (0..100).for_each(|_| share.add([part, 0.0], [error_kpa; CHANNELS]));
            share.explains_errors()
        };
        // 0.17 kPa at most.
        assert!(!explains(0.001, 0.5));
        assert!(explains(0.001, 0.2));
        assert!(explains(0.01, 2.0));
        assert!(explains(0.0, f64::NAN));
    }
}
