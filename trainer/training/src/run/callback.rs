//! Reports of a run: where it stands, how it ended, its figures.

use model::observation::CHANNELS;
use serde::{Deserialize, Serialize};

use crate::checkpoint_selection::BestCheckpoint;
use crate::metrics::Evaluated;

/// Phase that a run is in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// The episode that a checkpoint was in the midst of is taken again.
    GoingOn,
    /// Acting and learning.
    Learning,
    /// The policy is run with its mean action.
    Evaluating,
    /// All steps are done and kept; the plan is fitted and the policy exported.
    FittingPlan,
}

/// Where a run stands.
#[derive(Debug, Clone, PartialEq)]
pub struct Progress {
    /// Phase.
    pub phase: Phase,
    /// Steps done.
    pub steps: u64,
    /// Steps planned.
    pub steps_planned: u64,
    /// Steps per second while learning, in this sitting; 0 until it is known.
    pub steps_per_s: f64,
    /// Seconds that learning and evaluations will still take; nothing until a pace is known.
    pub left_s: Option<f64>,
    /// Mean reward per step of this episode; nothing before its first step.
    pub reward: Option<f64>,
    /// RMSE while acting in this episode, in kPa.
    pub acting_rmse_kpa: [f64; CHANNELS],
    /// The last evaluation on the last rig of the list.
    pub last_evaluation: Option<Evaluated>,
}

/// Who watches a run.
pub trait TrainingCallback {
    /// Called some times a second.
    fn progress(&mut self, progress: &Progress);
    /// Tells whether the run is to stop: it writes a checkpoint and ends.
    fn stop(&self) -> bool;
    /// Called when the last checkpoint is written, of a stop or of the end: from here on nothing can be lost.
    fn is_kept(&mut self) {}
}

/// End of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RunStatus {
    /// All steps are done.
    Finished,
    /// It was asked to stop; a checkpoint is written.
    Stopped,
}

/// Figures of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Steps done.
    pub steps: u64,
    /// Steps planned.
    pub steps_planned: u64,
    /// Seed.
    pub seed: u64,
    /// Variant.
    pub variant: String,
    /// Plant, model and start of the run, in one line.
    #[serde(default)]
    pub taken: String,
    /// Seconds of work, over all sittings.
    pub wall_s: f64,
    /// Steps per second over all.
    pub steps_per_s: f64,
    /// Share of the time that went into the environment: plant, predictions, law, observations.
    pub environment_share: f64,
    /// Threads that learned.
    pub threads: usize,
    /// The most memory that the program held in this sitting, in MiB; 0 where the system does not tell.
    pub memory_mib: f64,
    /// Which policy is kept as the best; nothing where the last is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kept: Option<BestCheckpoint>,
    /// Evaluations of the policy that is kept.
    pub evaluated: Vec<Evaluated>,
    /// The fallback on the same rigs under the same noise: what a policy must beat.
    #[serde(default)]
    pub fallback: Vec<Evaluated>,
}
