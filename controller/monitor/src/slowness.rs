//! Ratio by which a chamber is slower than its model: a larger volume than the file states, found while it moves.
//!
//! ```text
//! k = Σ m a / Σ m²        a: way of the reading in a tick, m: way that the model foresaw
//! ```

use crate::hypothesis::Way;

/// The slowest rig, as a share of the model's quickness: twenty times its volume (chosen).
const SLOWEST: f64 = 0.05;
/// Share from which on a rig counts as quick as its model: what lies above is a model's usual error (chosen).
const QUICK: f64 = 0.5;
/// Weight of "as quick as the model" at the beginning, in kPa²: a chamber's first ticks, some kPa each, are to decide (chosen).
const BEGINNING: f64 = 9.0;

/// Weight for a model that was compared with the rig, in kPa²: that of a rig's whole way from the atmosphere to its
/// reference (chosen; on `dual_pressure` it is 200 to 900).
const COMPARED: f64 = 900.0;

/// Sums over all ticks under control, under both commands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Slowness {
    squares: [f64; 2],
    products: [f64; 2],
}

impl Slowness {
    /// As quick as the model, until it shows otherwise.
    pub(crate) const NONE: Slowness = Slowness { squares: [BEGINNING; 2], products: [BEGINNING; 2] };

    /// As quick as a model that was compared with the rig before it was put in: it takes much to show otherwise.
    pub(crate) const COMPARED: Slowness = Slowness { squares: [COMPARED; 2], products: [COMPARED; 2] };

    /// Takes a tick; answers the share of the model's quickness, 1 where it is no slow rig.
    ///
    /// # Real-time
    /// May run in the tick.
    pub(crate) fn follow(&mut self, ways: [Way; 2]) -> f64 {
        let mut share: f64 = 0.0;
        for (n, way) in ways.iter().enumerate() {
            if way.actual_kpa.is_finite() && way.foreseen_kpa.is_finite() {
                self.squares[n] += way.foreseen_kpa * way.foreseen_kpa;
                self.products[n] += way.foreseen_kpa * way.actual_kpa;
            }
            share = share.max(self.products[n] / self.squares[n]);
        }
        if share < QUICK { share.max(SLOWEST) } else { 1.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settled(share: f64) -> f64 {
        let mut slowness = Slowness::NONE;
        let mut found = 1.0;
        for tick in 0..40 {
            let foreseen_kpa = 4.0 * (-f64::from(tick) / 10.0).exp();
            found = slowness.follow([Way { actual_kpa: share * foreseen_kpa, foreseen_kpa }; 2]);
        }
        found
    }

    #[test]
    fn a_slow_rig_is_found_and_a_quick_one_left_alone() {
        assert!((settled(0.1) - 0.17).abs() < 0.05, "{}", settled(0.1));
        assert_eq!(settled(0.9), 1.0);
        assert_eq!(settled(1.4), 1.0);
        assert!(settled(0.0) < 0.15);
    }
}
