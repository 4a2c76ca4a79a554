//! How well a run tracked, with the readings' noise beside it.

use proto::recording::TickRecord;
use serde::{Deserialize, Serialize};

use crate::recorded::RUN;

/// Ticks at the start of a run that do not count: the way to where the reference begins.
pub(crate) const SKIPPED: usize = 250;

/// Figures of a run along the reference.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Tracking {
    /// Root mean square of reading less reference, positive and negative, in kPa.
    pub rmse_kpa: [f64; 2],
    /// Standard deviation of the readings' noise, from their second differences, in kPa: no controller takes it off.
    pub noise_kpa: [f64; 2],
    /// Ticks that count.
    pub ticks: usize,
    /// Highest positive and lowest negative pressure, in kPa gauge.
    pub extremes_kpa: [f64; 2],
}

impl Tracking {
    /// Figures of the ticks of a run; nothing where too few count.
    pub fn of(ticks: &[TickRecord]) -> Option<Self> {
        let all: Vec<[f64; 2]> = ticks.iter().map(|t| [t.p_pos_kpa, t.p_neg_kpa]).collect();
        let counted: Vec<&TickRecord> = ticks.iter().skip(SKIPPED).filter(|tick| tick.state == RUN).collect();
        let errors: Vec<[f64; 2]> = counted
            .iter()
            .map(|t| [t.p_pos_kpa - t.ref_pos_kpa, t.p_neg_kpa - t.ref_neg_kpa])
            .filter(|error| error.iter().all(|e| e.is_finite()))
            .collect();
        if errors.len() < SKIPPED {
            return None;
        }
        let rms = |values: &dyn Fn(usize) -> Vec<f64>| -> [f64; 2] {
            std::array::from_fn(|c| {
                let values = values(c);
                (values.iter().map(|v| v * v).sum::<f64>() / values.len().max(1) as f64).sqrt()
            })
        };
        // The second difference of white noise has six times its variance; a pressure's own is far below.
        let second = |c: usize| -> Vec<f64> {
            let differences = all.windows(3).skip(SKIPPED).map(|w| w[0][c] - 2.0 * w[1][c] + w[2][c]);
            differences.filter(|d| d.is_finite()).collect()
        };
        let finite = |c: usize| all.iter().map(move |p| p[c]).filter(|p| p.is_finite());
        Some(Tracking {
            rmse_kpa: rms(&|c| errors.iter().map(|e| e[c]).collect()),
            noise_kpa: rms(&second).map(|rms| rms / 6f64.sqrt()),
            ticks: errors.len(),
            extremes_kpa: [finite(0).fold(f64::MIN, f64::max), finite(1).fold(f64::MAX, f64::min)],
        })
    }

    /// Error of both channels together (root mean square) as a multiple of another run's: as the daemon weighs a policy against the
    /// fallback.
    pub fn over(&self, other: &Tracking) -> f64 {
        self.both_kpa() / other.both_kpa().max(1e-6)
    }

    /// Root mean square of both channels together, in kPa.
    pub fn both_kpa(&self) -> f64 {
        let [pos, neg] = self.rmse_kpa;
        pos.hypot(neg)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_and_noise_are_told_apart() {
        let ticks: Vec<TickRecord> = (0..2000)
            .map(|n: u32| {
                // Noise of ±0.1 that alternates in pairs, and an error that lasts.
                let noise = if (n / 2).is_multiple_of(2) { 0.1 } else { -0.1 };
                let (ref_pos_kpa, ref_neg_kpa) = (80.0, -70.0);
                let (p_pos_kpa, p_neg_kpa) = (ref_pos_kpa + 0.5 + noise, ref_neg_kpa);
                TickRecord {
                    state: RUN,
                    tick: n,
                    p_pos_kpa,
                    p_neg_kpa,
                    ref_pos_kpa,
                    ref_neg_kpa,
                    ..TickRecord::default()
                }
            })
            .collect();
        let tracking = Tracking::of(&ticks).unwrap();
        assert!((tracking.rmse_kpa[0] - (0.25f64 + 0.01).sqrt()).abs() < 1e-3, "{tracking:?}");
        assert_eq!(tracking.rmse_kpa[1], 0.0);
        // Second differences of this pattern are ±0.2: 0.2/√6.
        assert!((tracking.noise_kpa[0] - 0.2 / 6f64.sqrt()).abs() < 1e-9, "{tracking:?}");
        assert_eq!(tracking.extremes_kpa[1], -70.0);
        assert_eq!(Tracking::of(&ticks[..400]), None);
        let twice = Tracking { rmse_kpa: tracking.rmse_kpa.map(|rmse_kpa| 2.0 * rmse_kpa), ..tracking };
        assert!((tracking.over(&twice) - 0.5).abs() < 1e-12);
    }
}
