//! Outcome of a run of rollouts: its figures, and the policy that is kept.

use environment::SIDE_BY_SIDE;
use model::observation::Pair;
use proto::emulator::load_for_loop;
use sac::Network;
use serde::{Deserialize, Serialize};

use super::report;
use super::run::RolloutRun;
use crate::TrainingError;
use crate::metrics::Evaluated;
use crate::plan_fit::{self, PlanModel};
use crate::run::reference_flight;
use crate::run_files::RunFiles;
use crate::trained_policy::TrainedPolicy;

/// Outcome of a round.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Round {
    /// Number; 0 is the policy that the run began with.
    pub round: u64,
    /// Seconds of work so far.
    pub wall_s: f64,
    /// Geometric mean of the RMSE on rigs set aside, positive and negative, in kPa.
    pub rmse_kpa: Pair,
    /// Geometric mean of both channels, which the policy is kept by.
    pub score_kpa: f64,
    /// Branches that it was learned from.
    pub branches: u64,
}

/// Figures of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RolloutSummary {
    /// Plant, model and start, in one line.
    pub taken: String,
    /// Rounds done.
    pub rounds: u64,
    /// Rounds planned.
    pub rounds_planned: u64,
    /// Seed.
    pub seed: u64,
    /// Seconds of work, over all sittings.
    pub wall_s: f64,
    /// The round whose policy is kept; 0 is the policy that the run began with.
    pub kept: Round,
    /// Every round.
    pub curve: Vec<Round>,
    /// The fallback on the rigs set aside, positive and negative, in kPa; of policies that correct it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fallback_kpa: Option<Pair>,
    /// The policy that is kept on the paper's reference; nothing is run there by a run that was stopped.
    pub evaluated: Vec<Evaluated>,
    /// The policy that was given to begin with, with the plan that it had; empty where none was.
    pub given: Vec<Evaluated>,
    /// The fallback.
    pub fallback: Vec<Evaluated>,
}

impl RolloutSummary {
    /// Flights on the paper's reference, rig by rig: whose they are, and their figures.
    pub fn by_rig(&self) -> impl Iterator<Item = (&'static str, &Evaluated)> {
        (0..self.evaluated.len()).flat_map(|n| {
            [("policy", &self.evaluated), ("given", &self.given), ("fallback", &self.fallback)]
                .into_iter()
                .filter_map(move |(who, flown)| Some((who, flown.get(n)?)))
        })
    }
}

impl RolloutRun {
    fn trained(&self, network: Network) -> TrainedPolicy {
        let ticks = ((self.settings.environment.warm_up_s + self.rollouts.episode_s) / law::TICK_S).round() as u64;
        let flown = self.standing.position.rounds * self.rollouts.episodes * ticks * SIDE_BY_SIDE as u64;
        TrainedPolicy::new(self.settings.clone(), self.origin.clone(), flown, network)
            .with_stated_spread(self.given.as_ref().and_then(|given| given.exploration_std().map(<[f64]>::to_vec)))
    }

    /// Fits the plan of the policy that is kept, runs it on the paper's reference, and writes policy, page and figures.
    ///
    /// # Errors
    /// If a rig cannot be run, or a file cannot be written.
    pub fn finish(&self) -> Result<RolloutSummary, TrainingError> {
        let policy = self.kept_policy()?;
        let summary = self.with_reference_runs(&policy)?;
        self.write(&policy, &summary)?;
        Ok(summary)
    }

    /// Writes the same of a run that was stopped, without the runs on the paper's reference, which nobody waits for then. The plan is
    /// fitted all the same: without it no policy could be run.
    ///
    /// # Errors
    /// If the model cannot be run, or a file cannot be written.
    pub fn leave(&self) -> Result<RolloutSummary, TrainingError> {
        let summary = self.summary();
        self.write(&self.kept_policy()?, &summary)?;
        Ok(summary)
    }

    /// The policy that is kept, its plan fitted.
    fn kept_policy(&self) -> Result<TrainedPolicy, TrainingError> {
        let model = PlanModel { rig: &self.model, map: &self.map };
        Ok(self.trained(plan_fit::fitted(&self.standing.best, &self.settings, &model)?))
    }

    fn write(&self, policy: &TrainedPolicy, summary: &RolloutSummary) -> Result<(), TrainingError> {
        RunFiles::write(&self.files.policy(), &policy.to_bytes()?)?;
        RunFiles::write(&self.files.onnx(), &policy.to_onnx(&[])?)?;
        let text = serde_json::to_string_pretty(summary)
            .map_err(|error| TrainingError::file(&self.files.summary(), &error.to_string()))?;
        RunFiles::write(&self.files.report(), report::page(&self.settings, summary).as_bytes())?;
        RunFiles::write(&self.files.summary(), format!("{text}\n").as_bytes())
    }

    fn summary(&self) -> RolloutSummary {
        let position = &self.standing.position;
        RolloutSummary {
            taken: self.taken(),
            rounds: position.rounds,
            rounds_planned: self.rollouts.rounds,
            seed: self.settings.run.seed,
            wall_s: position.wall_s,
            kept: position.kept,
            curve: position.curve.clone(),
            fallback_kpa: position.fallback_kpa,
            evaluated: Vec::new(),
            given: Vec::new(),
            fallback: Vec::new(),
        }
    }

    /// Figures with runs of policy, given policy and fallback on the paper's reference.
    fn with_reference_runs(&self, policy: &TrainedPolicy) -> Result<RolloutSummary, TrainingError> {
        let mut summary = self.summary();
        for name in &self.settings.rig.evaluated_on {
            let rig = load_for_loop(name, Some("rig.evaluated_on"))?;
            let flown = |who: Option<&TrainedPolicy>| {
                reference_flight(&self.settings, (name, &rig), (&self.model, &self.map), who, &mut || true)
            };
            summary.evaluated.extend(flown(Some(policy))?);
            if let Some(given) = &self.given {
                summary.given.extend(flown(Some(given))?);
            }
            summary.fallback.extend(flown(None)?);
        }
        Ok(summary)
    }
}
