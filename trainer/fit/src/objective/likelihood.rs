//! Chi-square, log-likelihoods and errors of a trace, whole and block by block.
//!
//! Three noise models, for three questions:
//!
//! ```text
//! stated      ln L = −½ Σ (r²/σ² + ln 2πσ²)                         does the model reach the noise floor?
//! estimated   ln L = −n/2 (ln 2π s² + 1),  s² = Σ r²/n by channel     which model is better, σ not trusted?
//! drifting    white noise σ plus an AR(1) part: variance D², correlation time τ    the same, when both models are a little
//!             wrong: slow error is cheap, so that only what it cannot imitate counts
//! ```
//!
//! The last is the exact Gaussian likelihood of white noise on top of a slow first-order drift, by a scalar Kalman
//! filter along each segment (a residual's innovations, Harvey 1989 §3.1). Blocks of 10 s are what differences
//! between models are bootstrapped from: rows next to each other are no independent evidence, blocks nearly are.

use crate::data::{Records, Role, Split, Stretch};

/// Model of the residuals.
#[derive(Debug, Clone, PartialEq)]
pub enum NoiseModel {
    /// White, standard deviation by channel in kPa.
    Stated {
        /// σ by channel.
        sigma_kpa: Vec<f64>,
    },
    /// White, standard deviation estimated from the residuals themselves.
    Estimated,
    /// White noise and a slow drift.
    Drifting {
        /// σ of the white part by channel, in kPa.
        sigma_kpa: Vec<f64>,
        /// Standard deviation of the drift by channel, in kPa.
        drift_kpa: Vec<f64>,
        /// Correlation time of the drift in s.
        time_s: f64,
        /// True where errors have heavier tails than a normal distribution.
        heavy: bool,
    },
}

/// Rows of a recording and what they contribute.
#[derive(Debug, Clone, PartialEq)]
pub struct BlockScore {
    /// The rows.
    pub block: Stretch,
    /// Log-likelihood by channel.
    pub log_likelihood: Vec<f64>,
    /// Sum of squared errors by channel, in kPa².
    pub squares: Vec<f64>,
    /// Readings by channel that count.
    pub rows: Vec<usize>,
}

/// Score of how well a trace explains readings.
#[derive(Debug, Clone, PartialEq)]
pub struct Score {
    /// Contributions by block, in order.
    pub blocks: Vec<BlockScore>,
}

/// The name most callers look for.
pub type Likelihood = Score;

impl Score {
    /// Log-likelihood of everything.
    pub fn log_likelihood(&self) -> f64 {
        self.blocks.iter().flat_map(|b| &b.log_likelihood).sum()
    }

    /// Root of the mean squared error by channel, in kPa.
    pub fn rmse_kpa(&self) -> Vec<f64> {
        let channels = self.blocks.first().map_or(0, |b| b.squares.len());
        (0..channels)
            .map(|c| {
                let sum = |f: &dyn Fn(&BlockScore) -> f64| self.blocks.iter().map(f).sum::<f64>();
                let rows = sum(&|b| b.rows.get(c).copied().unwrap_or(0) as f64);
                (sum(&|b| b.squares.get(c).copied().unwrap_or(0.0)) / rows.max(1.0)).sqrt()
            })
            .collect()
    }

    /// By how much the log-likelihood of `self` exceeds that of `other` (same blocks), and the standard error of that
    /// difference from the scatter of blocks.
    pub fn gain_over(&self, other: &Score) -> (f64, f64) {
        let differences: Vec<f64> = self
            .blocks
            .iter()
            .zip(&other.blocks)
            .map(|(a, b)| a.log_likelihood.iter().sum::<f64>() - b.log_likelihood.iter().sum::<f64>())
            .collect();
        let n = differences.len() as f64;
        let total: f64 = differences.iter().sum();
        let mean = total / n.max(1.0);
        let variance = differences.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
        (total, (n * variance).sqrt())
    }
}

/// Blocks of 10 s of a role.
pub fn blocks_of(split: &Split, role: Role) -> Vec<Stretch> {
    split.blocks(role, 500)
}

/// Scores a trace on blocks; readings whose weight is zero do not count.
///
/// `weights` and `trace` are of the recordings' layout.
pub fn score(records: &Records, trace: &[f64], weights: &[f64], blocks: &[Stretch], noise: &NoiseModel) -> Score {
    let layout = records.layout();
    let channels = layout.channels();
    let mut scores: Vec<BlockScore> = blocks
        .iter()
        .map(|block| BlockScore {
            block: block.clone(),
            log_likelihood: vec![0.0; channels],
            squares: vec![0.0; channels],
            rows: vec![0; channels],
        })
        .collect();
    // Residuals of a block and channel, `None` where a reading does not count.
    let residuals = |block: &Stretch, channel: usize| -> Vec<Option<f64>> {
        layout
            .stretch(block.record, channel, block.rows.clone())
            .map(|index| {
                let at = |vector: &[f64]| vector.get(index).copied().unwrap_or(0.0);
                (at(weights) != 0.0).then(|| at(trace) - at(records.readings_kpa()))
            })
            .collect()
    };
    for score in &mut scores {
        for channel in 0..channels {
            let squares: Vec<f64> = residuals(&score.block, channel).iter().flatten().map(|r| r * r).collect();
            score.squares[channel] = squares.iter().sum();
            score.rows[channel] = squares.len();
        }
    }
    for channel in 0..channels {
        let rows: usize = scores.iter().map(|s| s.rows[channel]).sum();
        let squares: f64 = scores.iter().map(|s| s.squares[channel]).sum();
        let of = |by_channel: &[f64]| by_channel.get(channel).copied().unwrap_or(f64::NAN);
        let white = match noise {
            NoiseModel::Stated { sigma_kpa } | NoiseModel::Drifting { sigma_kpa, .. } => of(sigma_kpa),
            NoiseModel::Estimated => (squares / rows.max(1) as f64).sqrt(),
        };
        // A residual of exactly zero (a channel that drives itself) has no likelihood of its own.
        let variance = (white * white).max(1e-12);
        for score in &mut scores {
            score.log_likelihood[channel] = match noise {
                NoiseModel::Drifting { drift_kpa, time_s, heavy, .. } => {
                    drifting(&residuals(&score.block, channel), variance, of(drift_kpa).powi(2), *time_s, *heavy)
                }
                _ => {
                    -0.5 * (score.squares[channel] / variance
                        + score.rows[channel] as f64 * (std::f64::consts::TAU * variance).ln())
                }
            };
        }
    }
    Score { blocks: scores }
}

/// Log-likelihood of residuals as white noise over a stationary AR(1) drift.
///
/// With `heavy` the innovations have Student's distribution with four degrees of freedom instead of the normal one, and one
/// that is far out moves the drift less: edges of a signal that come a few milliseconds early or late are far out, and must
/// not decide alone.
fn drifting(residuals: &[Option<f64>], white: f64, drift: f64, time_s: f64, heavy: bool) -> f64 {
    const FREEDOM: f64 = 4.0;
    /// Logarithm of that density at its middle, 3/8.
    const MIDDLE: f64 = -0.980_829_253_011_726_2;
    let keep = (-proto::recording::PERIOD_S / time_s.max(1e-6)).exp();
    let (mut mean, mut variance, mut sum) = (0.0, drift, 0.0);
    for residual in residuals {
        if let Some(residual) = residual {
            let innovation = residual - mean;
            let total = variance + white;
            let square = innovation * innovation / total;
            let trust = if heavy {
                sum += MIDDLE - 0.5 * total.ln() - 0.5 * (FREEDOM + 1.0) * (square / FREEDOM).ln_1p();
                (FREEDOM + 1.0) / (FREEDOM + square)
            } else {
                sum -= 0.5 * (square + (std::f64::consts::TAU * total).ln());
                1.0
            };
            let gain = variance / (variance + white / trust);
            mean += gain * innovation;
            variance *= 1.0 - gain;
        }
        mean *= keep;
        variance = keep * keep * variance + (1.0 - keep * keep) * drift;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    /// The filter against the density of a multivariate normal written down as a matrix.
    #[test]
    fn drift_likelihood_is_that_of_the_full_covariance() {
        let (white, drift, time_s) = (0.04, 0.5, 0.07);
        let r = [0.3, -0.2, 0.9, 0.1, -0.6, 0.2];
        let times = [0.0, 1.0, 2.0, 4.0, 5.0, 6.0];
        let covariance = DMatrix::from_fn(6, 6, |i, k| {
            let apart: f64 = (times[i] - times[k]) * 0.02;
            drift * (-apart.abs() / time_s).exp() + if i == k { white } else { 0.0 }
        });
        let vector = DVector::from_column_slice(&r);
        let exact = -0.5
            * ((vector.transpose() * covariance.clone().try_inverse().unwrap() * &vector)[0]
                + covariance.determinant().ln()
                + 6.0 * std::f64::consts::TAU.ln());
        // The reading of row 3 does not count.
        let rows: Vec<Option<f64>> = [Some(0), Some(1), Some(2), None, Some(3), Some(4), Some(5)]
            .map(|i: Option<usize>| i.map(|i| r[i]))
            .to_vec();
        assert!((drifting(&rows, white, drift, time_s, false) - exact).abs() < 1e-10);
    }
}
