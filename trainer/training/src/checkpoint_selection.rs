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
use model::observation::{ACTION_LEN, CHANNELS, Pair};
use sac::{Network, Workspace};
use serde::{Deserialize, Serialize};

use crate::TrainingError;
use crate::metrics::Evaluated;

/// Seed of the rigs, references and noise that select; training counts its seeds from 1 up.
pub(crate) const SELECTION_SEED: u64 = 0x005E_1EC7_1046_0000;
/// Episodes of eight rigs each.
const EPISODES: u64 = 3;

/// Figures of the kept policy, and when it had them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct BestCheckpoint {
    /// Steps after which it was what it is.
    pub step: u64,
    /// Score in kPa.
    pub score_kpa: f64,
}

/// The best policy so far.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Best {
    /// Figures, and when it had them.
    pub(crate) kept: BestCheckpoint,
    /// The policy.
    pub(crate) network: Network,
    /// Flights on the rigs of the learning curve.
    pub(crate) evaluated: Vec<Evaluated>,
}

impl Best {
    /// Everything but the network. The score keeps all its bits: another would decide another tie.
    pub(crate) fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = self.kept.step.to_le_bytes().to_vec();
        bytes.extend(self.kept.score_kpa.to_bits().to_le_bytes());
        // Only a summary's figures; without them the flights are missing there, nothing else.
        bytes.extend(serde_json::to_vec(&self.evaluated).unwrap_or_default());
        bytes
    }

    /// Selection as [`Self::to_bytes`] wrote it.
    pub(crate) fn from_bytes(bytes: &[u8], network: Network) -> Option<Self> {
        let (step, rest) = bytes.split_first_chunk::<8>()?;
        let (score, evaluated) = rest.split_first_chunk::<8>()?;
        let score_kpa = f64::from_bits(u64::from_le_bytes(*score));
        let kept = BestCheckpoint { step: u64::from_le_bytes(*step), score_kpa };
        Some(Best { kept, network, evaluated: serde_json::from_slice(evaluated).ok()? })
    }
}

/// Judges policies, and keeps the best.
pub(crate) struct CheckpointSelection {
    env: VectorEnv,
    best: Option<Best>,
}

impl CheckpointSelection {
    /// A selection by flights of `env`, going on with the best so far.
    pub(crate) fn new(env: VectorEnv, best: Option<Best>) -> Self {
        CheckpointSelection { env, best }
    }

    /// The best so far.
    pub(crate) fn best(&self) -> Option<&Best> {
        self.best.as_ref()
    }

    /// Keeps a policy if it is better than the best so far.
    pub(crate) fn consider(&mut self, candidate: Best) {
        if is_better(&candidate, self.best.as_ref()) {
            self.best = Some(candidate);
        }
    }

    /// The score of a policy in kPa; nothing where `stop` asks to leave it.
    pub(crate) fn score_kpa(
        &mut self,
        policy: &Network,
        stop: &mut dyn FnMut() -> bool,
    ) -> Result<Option<f64>, TrainingError> {
        Ok(rmse_kpa(&mut self.env, policy, stop)?.map(|rmse| (rmse[0] * rmse[1]).sqrt()))
    }
}

/// Tells whether a policy is to be kept instead of the best so far; one without a finite score never is.
pub(crate) fn is_better(candidate: &Best, best: Option<&Best>) -> bool {
    candidate.kept.score_kpa.is_finite() && best.is_none_or(|best| candidate.kept.score_kpa < best.kept.score_kpa)
}

/// RMSE of each channel on the rigs set aside, in kPa, as the geometric mean over them; nothing where `stop` asks to leave it.
pub(crate) fn rmse_kpa(
    env: &mut VectorEnv,
    policy: &Network,
    stop: &mut dyn FnMut() -> bool,
) -> Result<Option<Pair>, TrainingError> {
    let mut workspace = Workspace::default();
    let length = env.observations().len() / SIDE_BY_SIDE;
    let (mut logarithms, mut count) = ([0.0; CHANNELS], 0.0);
    for episode in 0..EPISODES {
        env.begin(episode)?;
        let (mut squares, mut ticks) = ([[0.0; CHANNELS]; SIDE_BY_SIDE], 0.0);
        let mut actions = Vec::with_capacity(SIDE_BY_SIDE * ACTION_LEN);
        while !env.is_truncated() {
            if stop() {
                return Ok(None);
            }
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
        for of_rig in squares {
            for (sum, square) in logarithms.iter_mut().zip(of_rig) {
                *sum += 0.5 * (square / ticks).ln();
            }
            count += 1.0;
        }
    }
    Ok(Some(logarithms.map(|sum| (sum / count).exp())))
}
