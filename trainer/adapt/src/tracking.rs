//! Figures of how well a run tracked, with the readings' noise beside them.

use proto::recording::TickRecord;
use serde::{Deserialize, Serialize};

use crate::recorded::RUN;
use crate::yardstick::Yardstick;

/// Ticks at the start of a run that do not count: the way to where the reference begins.
pub(crate) const SKIPPED: usize = 250;

/// Errors below this count as this much, in kPa, so that a channel without any has a ratio.
const LEAST_KPA: f64 = 1e-6;

/// Figures of a run along the reference.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Tracking {
    /// Root mean square of reading less reference, positive and negative, in kPa.
    pub rmse_kpa: [f64; 2],
    /// Root mean square of reading less what the found rig's late sensors would read with the chambers on the reference, in kPa; nothing
    /// where no sensor is late, and before a model was found.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub late_rmse_kpa: Option<[f64; 2]>,
    /// Standard deviation of the readings' noise, from their second differences, in kPa: no controller takes it off.
    pub noise_kpa: [f64; 2],
    /// Ticks that count.
    pub ticks: usize,
}

impl Tracking {
    /// Figures of the ticks of a run; nothing where too few count.
    pub fn of(ticks: &[TickRecord], yardstick: &Yardstick) -> Option<Self> {
        let all: Vec<[f64; 2]> = ticks.iter().map(|t| [t.p_pos_kpa, t.p_neg_kpa]).collect();
        let counted = |yardstick: &Yardstick| -> Vec<[f64; 2]> {
            let errors = yardstick.errors_kpa(ticks).into_iter().zip(ticks).skip(SKIPPED);
            let is_counted =
                |(error, tick): &([f64; 2], &TickRecord)| tick.state == RUN && error.iter().all(|e| e.is_finite());
            errors.filter(is_counted).map(|(error, _)| error).collect()
        };
        let errors = counted(&Yardstick::default());
        if errors.len() < SKIPPED {
            return None;
        }
        let rms_of = |errors: &[[f64; 2]]| [0, 1].map(|c| rms(errors.iter().map(|error| error[c])));
        // The second difference of white noise has six times its variance; a pressure's own is far below.
        let second = |c: usize| {
            let differences = all.windows(3).skip(SKIPPED).map(move |w| w[0][c] - 2.0 * w[1][c] + w[2][c]);
            differences.filter(|d| d.is_finite())
        };
        Some(Tracking {
            rmse_kpa: rms_of(&errors),
            late_rmse_kpa: yardstick.has_late_sensors().then(|| rms_of(&counted(yardstick))),
            noise_kpa: [0, 1].map(|c| rms(second(c)) / 6f64.sqrt()),
            ticks: errors.len(),
        })
    }

    /// Figures by which runs are compared: with late sensors where the found rig has any.
    pub fn judged_kpa(&self) -> [f64; 2] {
        self.late_rmse_kpa.unwrap_or(self.rmse_kpa)
    }

    /// Errors of both channels as multiples of another run's.
    pub(crate) fn over_by_channel(&self, other: &Tracking) -> [f64; 2] {
        self.times_by_channel(other.judged_kpa())
    }

    /// Error as a multiple of another run's: geometric mean of both channels. Of a root mean square over both, the channel that errs less by
    /// its nature would be next to nothing: where the positive one cannot follow the reference, a third as much on the negative one is a
    /// hundredth of the sum.
    pub fn over(&self, other: &Tracking) -> f64 {
        self.times(other.judged_kpa())
    }

    /// Error as a multiple of these errors in kPa: geometric mean of both channels.
    pub(crate) fn times(&self, other_kpa: [f64; 2]) -> f64 {
        let [pos, neg] = self.times_by_channel(other_kpa);
        (pos * neg).sqrt()
    }

    fn times_by_channel(&self, other_kpa: [f64; 2]) -> [f64; 2] {
        let mine_kpa = self.judged_kpa();
        // Unlike `max`, this leaves what is no number as it is.
        let at_least = |kpa: f64| kpa.clamp(LEAST_KPA, f64::INFINITY);
        std::array::from_fn(|c| at_least(mine_kpa[c]) / at_least(other_kpa[c]))
    }

    /// Root mean square of both channels together, by which a flight is ended early, in kPa.
    pub fn both_kpa(&self) -> f64 {
        let [pos, neg] = self.judged_kpa();
        pos.hypot(neg)
    }
}

/// Root mean square; 0 of no values.
fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (count, sum) = values.fold((0_usize, 0.0), |(count, sum), value| (count + 1, sum + value * value));
    (sum / count.max(1) as f64).sqrt()
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
        let of = |ticks: &[TickRecord]| Tracking::of(ticks, &Yardstick::default());
        let tracking = of(&ticks).unwrap();
        assert!((tracking.rmse_kpa[0] - (0.25f64 + 0.01).sqrt()).abs() < 1e-3, "{tracking:?}");
        assert_eq!(tracking.rmse_kpa[1], 0.0);
        // Second differences of this pattern are ±0.2: 0.2/√6.
        assert!((tracking.noise_kpa[0] - 0.2 / 6f64.sqrt()).abs() < 1e-9, "{tracking:?}");
        assert_eq!(of(&ticks[..400]), None);
        let twice = Tracking { rmse_kpa: tracking.rmse_kpa.map(|rmse_kpa| 2.0 * rmse_kpa), ..tracking };
        assert!((tracking.over_by_channel(&twice)[0] - 0.5).abs() < 1e-12);
        let half = Tracking { rmse_kpa: [0.2, 0.05], ..tracking };
        assert!((half.over(&Tracking { rmse_kpa: [0.1, 0.4], ..tracking }) - 0.5).abs() < 1e-12, "√(2 · 1/8)");
    }
}
