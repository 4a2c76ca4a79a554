//! Which of a run's policies is kept: the one that tracks best on rigs and references of its own.
//!
//! ```text
//! score = exp( mean over rigs and channels of ln RMSE )       kPa, mean action
//! ```
//!
//! The rigs are drawn as in training, from a seed that no training uses, and are the same for every policy and every
//! run: rigs that a policy is judged on later, `bench` above all, take no part. Logarithms weigh every rig and both
//! channels alike, whatever their size.

use environment::{SIDE_BY_SIDE, VectorEnv};
use model::observation::{ACTION_LEN, CHANNELS};
use sac::{Network, Workspace};
use serde::{Deserialize, Serialize};

use crate::TrainingError;

/// Seed of the rigs, references and noise that select; training counts its seeds from 1 up.
pub(crate) const SELECTION_SEED: u64 = 0x005E_1EC7_1046_0000;
/// Episodes of eight rigs each.
const EPISODES: u64 = 3;

/// How good the kept policy was, and when.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct BestCheckpoint {
    /// Steps after which it was what it is.
    pub step: u64,
    /// Its score in kPa.
    pub score_kpa: f64,
}

/// Judges policies, and keeps the best.
pub(crate) struct CheckpointSelection {
    env: VectorEnv,
    best: Option<(BestCheckpoint, Network)>,
}

impl CheckpointSelection {
    /// A selection by flights of `env`, going on with the best so far.
    pub(crate) fn new(env: VectorEnv, best: Option<(BestCheckpoint, Network)>) -> Self {
        CheckpointSelection { env, best }
    }

    /// The best so far.
    pub(crate) fn best(&self) -> Option<&(BestCheckpoint, Network)> {
        self.best.as_ref()
    }

    /// Takes in the policy after so many steps, and answers its score.
    pub(crate) fn judge(&mut self, step: u64, policy: Network) -> Result<f64, TrainingError> {
        let score_kpa = score_kpa(&mut self.env, &policy)?;
        // Written so that a NaN is never kept.
        if score_kpa.is_finite() && self.best.as_ref().is_none_or(|(kept, _)| score_kpa < kept.score_kpa) {
            self.best = Some((BestCheckpoint { step, score_kpa }, policy));
        }
        Ok(score_kpa)
    }
}

fn score_kpa(env: &mut VectorEnv, policy: &Network) -> Result<f64, TrainingError> {
    let mut workspace = Workspace::default();
    let length = env.observations().len() / SIDE_BY_SIDE;
    let (mut logarithms, mut count) = (0.0, 0.0);
    for episode in 0..EPISODES {
        env.begin(episode)?;
        let (mut squares, mut ticks) = ([[0.0; CHANNELS]; SIDE_BY_SIDE], 0.0);
        let mut actions = Vec::with_capacity(SIDE_BY_SIDE * ACTION_LEN);
        while !env.is_truncated() {
            actions.clear();
            for told in env.observations().chunks_exact(length) {
                actions.extend_from_slice(policy.mean_action_with(&mut workspace, told));
            }
            for (sums, error) in squares.iter_mut().zip(env.step(&actions).error_kpa) {
                for (sum, e) in sums.iter_mut().zip(error) {
                    *sum += e * e;
                }
            }
            ticks += 1.0;
        }
        for square in squares.as_flattened() {
            logarithms += 0.5 * (square / ticks).ln();
            count += 1.0;
        }
    }
    Ok((logarithms / count).exp())
}
