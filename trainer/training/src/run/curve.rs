//! Points of the learning curve, and the figures of a run.

use std::sync::Arc;
use std::time::Instant;

use environment::closed_loop::{FlightPlan, PolicyController};
use environment::{SIDE_BY_SIDE, Score, fly};
use law::PolicyLaw;
use model::observation::CHANNELS;
use proto::reference::Reference;
use sac::UpdateReport;

use super::{Run, Summary, unix_s};
use crate::TrainingError;
use crate::checkpoint::Position;
use crate::metrics::{Evaluated, Point};
use crate::trained_policy::TrainedPolicy;

/// Length of the paper's reference in s.
const EVALUATED_S: f64 = 60.0;
/// The evaluations' noise, the same at every point of the curve.
const EVALUATION_SEED: u64 = 1;

/// Sums since the last point of the learning curve.
#[derive(Debug, Clone, Default)]
pub(super) struct Window {
    pub(super) began: Option<Instant>,
    environment_s: f64,
    steps: u64,
    reward: f64,
    squares: [f64; CHANNELS],
    pub(super) tripped: u64,
    updates: f64,
    losses: [f64; 7],
}

impl Window {
    /// Adds the means of some updates.
    pub(super) fn add_updates(&mut self, report: &UpdateReport) {
        self.updates += 1.0;
        let losses = [
            report.critic_loss,
            report.actor_loss,
            report.mean_q,
            report.temperature,
            report.entropy,
            report.caps_t,
            report.caps_s,
        ];
        for (sum, loss) in self.losses.iter_mut().zip(losses) {
            *sum += loss;
        }
    }

    /// Adds an episode: its steps, the seconds that the environment took, and per turn its summed reward and squared errors in kPa².
    pub(super) fn add_steps(&mut self, steps: u64, environment_s: f64, reward: f64, squares: [f64; CHANNELS]) {
        self.environment_s += environment_s;
        self.steps += steps;
        self.reward += reward * SIDE_BY_SIDE as f64;
        for (sum, s) in self.squares.iter_mut().zip(squares) {
            *sum += s * SIDE_BY_SIDE as f64;
        }
    }
}

impl Run {
    /// Flights with the mean action on the paper's reference, on every rig of the list.
    fn flown(&self, policy: &TrainedPolicy) -> Result<Vec<Evaluated>, TrainingError> {
        let predicts = self.settings.policy.variant.predicts();
        let reference = Reference::paper();
        let mut evaluated = Vec::with_capacity(self.evaluated_on.len());
        for (name, rig) in &self.evaluated_on {
            let plan = FlightPlan {
                rig,
                model: predicts.then_some(&self.model),
                reference: &reference,
                seconds: EVALUATED_S,
                noise_v_rms: self.settings.environment.noise_v_rms,
                seed: EVALUATION_SEED,
            };
            let law = PolicyLaw::new(Arc::clone(&self.map), self.settings.contract());
            let mut runner = policy.runner();
            let flown = fly(&plan, &mut PolicyController::new(law, |observation: &[f32]| runner.outputs(observation)))?;
            evaluated.push(Evaluated::of(name, &Score::of(&flown.ticks)));
        }
        Ok(evaluated)
    }

    /// A point of the learning curve, of the policy as it stands.
    pub(super) fn evaluate(&mut self, selects: bool) -> Result<(), TrainingError> {
        let window = std::mem::take(&mut self.window);
        let took_s = window.began.map_or(0.0, |began| began.elapsed().as_secs_f64());
        let last = self.last();
        let selection = self.selection.as_mut().filter(|_| selects);
        let selection = selection.map(|s| s.judge(self.position.steps, last.clone()));
        let selection_kpa = selection.transpose()?;
        let evaluated = self.flown(&self.trained(last))?;
        let whole_s = window.began.map_or(0.0, |began| began.elapsed().as_secs_f64());
        self.position.wall_s += whole_s;
        self.position.environment_s += window.environment_s;
        let (steps, updates) = (window.steps.max(1) as f64, window.updates.max(1.0));
        let [critic_loss, actor_loss, mean_q, temperature, entropy, caps_temporal, caps_spatial] =
            window.losses.map(|sum| sum / updates);
        let point = Point {
            step: self.position.steps,
            wall_s: self.position.wall_s,
            steps_per_s: steps / took_s.max(1e-9),
            environment_share: window.environment_s / took_s.max(1e-9),
            reward: window.reward / steps,
            acting_rmse_kpa: window.squares.map(|s| (s / steps).sqrt()),
            tripped: window.tripped,
            critic_loss,
            actor_loss,
            mean_q,
            temperature,
            entropy,
            caps_temporal,
            caps_spatial,
            selection_kpa,
            evaluated,
        };
        self.metrics.add(unix_s(), &point)?;
        self.points.push(point);
        Ok(())
    }

    /// Figures of the run so far.
    ///
    /// # Errors
    /// If the policy that is kept cannot be flown.
    pub fn summary(&self) -> Result<Summary, TrainingError> {
        let Position { steps, wall_s, environment_s, .. } = self.position;
        let best = self.selection.as_ref().and_then(|selection| selection.best());
        let evaluated = match best {
            Some((_, network)) => self.flown(&self.trained(network.clone()))?,
            None => self.points.last().map_or_else(Vec::new, |p| p.evaluated.clone()),
        };
        Ok(Summary {
            steps,
            steps_planned: self.settings.run.steps,
            seed: self.settings.run.seed,
            variant: self.settings.policy.variant.name().into(),
            wall_s,
            steps_per_s: steps as f64 / wall_s.max(1e-9),
            environment_share: environment_s / wall_s.max(1e-9),
            threads: self.threads,
            memory_mib: peak_memory_mib(),
            kept: best.map(|(kept, _)| *kept),
            evaluated,
        })
    }
}

/// What the kernel has counted as the most memory of this process.
fn peak_memory_mib() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    peak.and_then(|line| line.trim().trim_end_matches("kB").trim().parse::<f64>().ok()).map_or(0.0, |kib| kib / 1024.0)
}
