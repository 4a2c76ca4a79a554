//! Errors that a model is allowed to have when it is compared with another, and how likely a trace is with them.

use fit::cores::side_by_side;
use fit::data::{Role, Stretch};
use fit::objective::{BlockScore, NoiseModel, Score, score};

use super::Bench;

/// Slow errors that a model is allowed to have when it is compared with another: no formula is exact, no build sheet
/// complete. How large they are is estimated from the better of the two, out of these, in kPa.
const DRIFTS_KPA: [f64; 7] = [0.005, 0.01, 0.02, 0.04, 0.08, 0.16, 0.32];
/// Correlation times of that error in s.
const DRIFT_S: [f64; 2] = [1.0, 0.1];
/// And fast errors, as multiples of the noise: edges that come a few milliseconds early, a meter's own noise that drives the
/// rig. Where a model is right to the noise, 1 is the likeliest.
const ROUGHER: [f64; 4] = [1.0, 2.0, 4.0, 8.0];

/// Rows of a fine block: 4 s.
const FINE_ROWS: usize = 200;

/// Errors that a model is allowed to have, by channel.
#[derive(Debug, Clone, PartialEq)]
pub struct Allowed {
    /// Slow ones, in kPa.
    pub drift_kpa: Vec<f64>,
    /// Correlation time of the slow ones, in s; one for all channels.
    pub time_s: f64,
    /// True where single errors far out are as likely as Student's distribution has them.
    pub heavy: bool,
    /// From row to row, noise included, in kPa.
    pub sigma_kpa: Vec<f64>,
}

impl Bench<'_> {
    /// Log-likelihood of a trace on the blocks of a role, some errors allowed for.
    pub fn score(&self, trace: &[f64], role: Role, allowed: &Allowed) -> Score {
        self.score_on(trace, &self.blocks(role), allowed)
    }

    /// As [`Bench::score`] on the rows that choose, in blocks of 4 s.
    pub fn score_finely(&self, trace: &[f64], allowed: &Allowed) -> Score {
        self.score_on(trace, &self.split.blocks(Role::Select, FINE_ROWS), allowed)
    }

    fn score_on(&self, trace: &[f64], blocks: &[Stretch], allowed: &Allowed) -> Score {
        let Allowed { drift_kpa, time_s, heavy, sigma_kpa } = allowed.clone();
        score(self.records, trace, &self.counted, blocks, &NoiseModel::Drifting { sigma_kpa, drift_kpa, time_s, heavy })
    }

    /// The errors that a trace has: the sizes at which they are likeliest on the fitted rows.
    ///
    /// Estimated from plateaus they would be the noise's own colour, estimated from a model that lacks something they would
    /// explain away what is to be found; so they are asked of the better of two explanations alone.
    pub fn drift_of(&self, trace: &[f64]) -> Allowed {
        let [slow, fast] = DRIFT_S;
        let kinds = [(slow, false), (fast, false), (slow, true), (fast, true)];
        let all = side_by_side(&kinds, |(time_s, heavy)| self.errors_of(trace, *time_s, *heavy));
        // The first of equals.
        let likeliest = all.into_iter().reduce(|best, other| if other.0 > best.0 { other } else { best });
        likeliest.map_or_else(|| self.errors_of(trace, slow, false).1, |(_, allowed)| allowed)
    }

    /// The likeliest sizes of errors of a given correlation time, with their log-likelihood.
    fn errors_of(&self, trace: &[f64], time_s: f64, heavy: bool) -> (f64, Allowed) {
        let noise = self.sigma_kpa();
        let mut best: Vec<(f64, f64, f64)> = noise.iter().map(|s| (f64::NEG_INFINITY, DRIFTS_KPA[0], *s)).collect();
        for rougher in ROUGHER {
            let sigma_kpa: Vec<f64> = noise.iter().map(|s| rougher * s).collect();
            for drift in DRIFTS_KPA {
                let drift_kpa = vec![drift; noise.len()];
                let allowed = Allowed { drift_kpa, time_s, heavy, sigma_kpa: sigma_kpa.clone() };
                let score = self.score(trace, Role::Fit, &allowed);
                for (channel, best) in best.iter_mut().enumerate() {
                    let of = |b: &BlockScore| b.log_likelihood.get(channel).copied().unwrap_or(0.0);
                    let sum: f64 = score.blocks.iter().map(of).sum();
                    if sum > best.0 {
                        *best = (sum, drift, sigma_kpa.get(channel).copied().unwrap_or(0.0));
                    }
                }
            }
        }
        let (drift_kpa, sigma_kpa) = (best.iter().map(|b| b.1).collect(), best.iter().map(|b| b.2).collect());
        (best.iter().map(|b| b.0).sum(), Allowed { drift_kpa, time_s, heavy, sigma_kpa })
    }
}
