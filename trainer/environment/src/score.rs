//! Score of a flight: tracking error, action change, hunting.

use law::TICK_S;
use model::observation::{CHANNELS, Pair};
use serde::Serialize;

use crate::closed_loop::FlownTick;

/// The first seconds of a flight, which are not counted: the rig comes from rest.
pub const SKIPPED_S: f64 = 5.0;

/// Skipped time in ticks.
pub(crate) fn skipped_ticks() -> usize {
    (SKIPPED_S / TICK_S) as usize
}

/// Figures of one flight, positive and negative channel. Errors are of the readings less what the rig's sensors show of chambers
/// on the reference, which is the reference itself where none of them is late ([`model::shown_reference`]).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Score {
    /// Root of the mean squared error of the measured pressures, in kPa.
    pub rmse_kpa: Pair,
    /// Mean error, in kPa.
    pub offset_kpa: Pair,
    /// Largest error, in kPa.
    pub worst_kpa: Pair,
    /// Root of the mean squared change of the duty from tick to tick.
    pub duty_change_rms: Pair,
}

impl Score {
    /// Scores a flight from [`SKIPPED_S`] on; NaN everywhere if it is shorter.
    pub fn of(ticks: &[FlownTick]) -> Self {
        let skipped = skipped_ticks();
        let mut score = Score {
            rmse_kpa: [0.0; CHANNELS],
            offset_kpa: [0.0; CHANNELS],
            worst_kpa: [0.0; CHANNELS],
            duty_change_rms: [0.0; CHANNELS],
        };
        let counted = ticks.get(skipped..).unwrap_or_default();
        let count = counted.len() as f64;
        for c in 0..CHANNELS {
            let errors = || counted.iter().map(|t| t.measured_kpa[c] - t.shown_goal_kpa[c]);
            let changes = counted.windows(2).map(|pair| match pair {
                [before, after] => after.duty[c] - before.duty[c],
                _ => 0.0,
            });
            score.rmse_kpa[c] = (errors().map(|e| e * e).sum::<f64>() / count).sqrt();
            score.offset_kpa[c] = errors().sum::<f64>() / count;
            score.worst_kpa[c] = errors().fold(0.0, |worst: f64, e| worst.max(e.abs()));
            score.duty_change_rms[c] = (changes.map(|d| d * d).sum::<f64>() / (count - 1.0)).sqrt();
        }
        score
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scores_what_comes_after_the_first_seconds() {
        let ticks: Vec<FlownTick> = (0..500)
            .map(|t| FlownTick {
                measured_kpa: if t < 250 { [500.0, 0.0] } else { [80.0 + if t % 2 == 0 { 0.3 } else { -0.3 }, -69.0] },
                true_kpa: [80.0, -70.0],
                goal_kpa: [80.0, -70.0],
                shown_goal_kpa: [80.0, -70.0],
                duty: [0.5 + 0.01 * f64::from(t % 2), 0.5],
            })
            .collect();
        let score = Score::of(&ticks);
        assert!((score.rmse_kpa[0] - 0.3).abs() < 1e-12 && (score.rmse_kpa[1] - 1.0).abs() < 1e-12);
        assert!(score.offset_kpa[0].abs() < 1e-12 && (score.offset_kpa[1] - 1.0).abs() < 1e-12);
        assert!((score.duty_change_rms[0] - 0.01).abs() < 1e-12 && score.duty_change_rms[1] == 0.0);
    }
}
