//! Points of the learning curve, and the figures of a run.

use std::sync::Arc;
use std::time::{Duration, Instant};

use environment::closed_loop::{FlightPlan, PolicyController};
use environment::{SIDE_BY_SIDE, Score, fly_while};
use law::{Fallback, FallbackSettings, PolicyLaw};
use model::observation::CHANNELS;
use model::rig::Rig;
use model::steady::SteadyMap;
use proto::reference::Reference;
use sac::UpdateReport;
use serde::{Deserialize, Serialize};

use super::{Phase, Run, Summary, TrainingCallback, unix_s};
use crate::TrainingError;
use crate::checkpoint::Position;
use crate::checkpoint_selection::{Best, BestCheckpoint, is_better};
use crate::metrics::{Evaluated, Point};
use crate::settings::TrainingSettings;
use crate::trained_policy::TrainedPolicy;

/// Length of the paper's reference in s.
const EVALUATED_S: f64 = 60.0;
/// The evaluations' noise, the same at every point of the curve.
const EVALUATION_SEED: u64 = 1;

/// Sums since the last point of the learning curve.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Window {
    work_s: f64,
    environment_s: f64,
    steps: u64,
    reward: f64,
    squares: [f64; CHANNELS],
    tripped: u64,
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

    /// Adds a turn: its mean reward, its mean squared errors in kPa², and how many rigs left their envelope.
    pub(super) fn add_turn(&mut self, reward: f64, squares: [f64; CHANNELS], tripped: usize) {
        self.steps += SIDE_BY_SIDE as u64;
        self.reward += reward * SIDE_BY_SIDE as f64;
        self.tripped += tripped as u64;
        for (sum, s) in self.squares.iter_mut().zip(squares) {
            *sum += s * SIDE_BY_SIDE as f64;
        }
    }

    /// Adds time in the environment.
    pub(super) fn add_environment(&mut self, took: Duration) {
        self.environment_s += took.as_secs_f64();
    }

    /// Adds time of acting and learning, environment included.
    pub(super) fn add_work(&mut self, took: Duration) {
        self.work_s += took.as_secs_f64();
    }
}

/// Why a point of the curve is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Occasion {
    /// The settings plan it: it belongs to the run, however the run is parted.
    Planned,
    /// The run ends here, between two planned points: going on must lead to where going through does.
    End,
}

impl Run {
    /// A flight on the paper's reference, of a policy or of the fallback; nothing where a stop is asked for.
    fn flight(
        &self,
        rig: (&str, &Rig),
        policy: Option<&TrainedPolicy>,
        callback: &dyn TrainingCallback,
    ) -> Result<Option<Evaluated>, TrainingError> {
        reference_flight(&self.settings, rig, (&self.model, &self.map), policy, &mut || !callback.stop())
    }

    /// Flights with the mean action on every rig of the list; nothing where a stop is asked for.
    fn flown(
        &self,
        policy: &TrainedPolicy,
        callback: &dyn TrainingCallback,
    ) -> Result<Option<Vec<Evaluated>>, TrainingError> {
        let mut evaluated = Vec::with_capacity(self.evaluated_on.len());
        for (name, rig) in &self.evaluated_on {
            match self.flight((name, rig), Some(policy), callback)? {
                Some(figures) => evaluated.push(figures),
                None => return Ok(None),
            }
        }
        Ok(Some(evaluated))
    }

    /// The fallback's flights, once for a sitting; answers whether they are there.
    fn fallback_is_flown(&mut self, callback: &dyn TrainingCallback) -> Result<bool, TrainingError> {
        while let Some((name, rig)) = self.evaluated_on.get(self.fallback.len()) {
            match self.flight((name, rig), None, callback)? {
                Some(figures) => self.fallback.push(figures),
                None => return Ok(false),
            }
        }
        Ok(true)
    }

    /// A point of the learning curve, of the policy as it stands; answers whether it was made, or a stop asked for.
    pub(super) fn evaluate(
        &mut self,
        occasion: Occasion,
        callback: &mut dyn TrainingCallback,
    ) -> Result<bool, TrainingError> {
        let began = Instant::now();
        self.tell(callback, Phase::Evaluating, None);
        if !self.fallback_is_flown(callback)? {
            return Ok(false);
        }
        let last = self.last();
        let Some(evaluated) = self.flown(&self.trained(last.clone()), callback)? else { return Ok(false) };
        let mut selection_kpa = None;
        if let Some(selection) = &mut self.selection {
            let Some(score_kpa) = selection.score_kpa(&last, &mut || callback.stop())? else { return Ok(false) };
            selection_kpa = Some(score_kpa);
            let kept = BestCheckpoint { step: self.position.steps, score_kpa };
            let candidate = Best { kept, network: last, evaluated: evaluated.clone() };
            match occasion {
                Occasion::Planned => selection.consider(candidate),
                // Where a run ends must not tell on what going on keeps.
                Occasion::End => self.end_best = is_better(&candidate, selection.best()).then_some(candidate),
            }
        }
        self.pace.add_evaluation(began.elapsed());
        self.account();
        let point = self.point(selection_kpa, evaluated);
        if occasion == Occasion::Planned {
            self.position.environment_s += self.window.environment_s;
            self.window = Window::default();
        }
        self.metrics.add(unix_s(), &point)?;
        self.points.push(point);
        Ok(true)
    }

    /// The sums since the last point as means, with these evaluations.
    fn point(&self, selection_kpa: Option<f64>, evaluated: Vec<Evaluated>) -> Point {
        let window = &self.window;
        let (steps, updates) = (window.steps.max(1) as f64, window.updates.max(1.0));
        let [critic_loss, actor_loss, mean_q, temperature, entropy, caps_temporal, caps_spatial] =
            window.losses.map(|sum| sum / updates);
        Point {
            step: self.position.steps,
            wall_s: self.position.wall_s,
            steps_per_s: window.steps as f64 / window.work_s.max(1e-9),
            environment_share: window.environment_s / window.work_s.max(1e-9),
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
        }
    }

    /// The best policy so far, where the settings keep it: of the planned points, and of the end.
    pub(super) fn best(&self) -> Option<&Best> {
        self.end_best.as_ref().or(self.selection.as_ref().and_then(|selection| selection.best()))
    }

    /// Figures of the run so far.
    pub fn summary(&self) -> Summary {
        let Position { steps, wall_s, environment_s, .. } = self.position;
        let best = self.best();
        Summary {
            steps,
            steps_planned: self.settings.run.steps,
            seed: self.settings.run.seed,
            variant: self.settings.policy.variant.name().into(),
            taken: self.taken(),
            wall_s,
            steps_per_s: steps as f64 / wall_s.max(1e-9),
            environment_share: (environment_s + self.window.environment_s) / wall_s.max(1e-9),
            threads: self.threads,
            memory_mib: peak_memory_mib(),
            kept: best.map(|best| best.kept),
            evaluated: match best {
                Some(best) => best.evaluated.clone(),
                None => self.points.last().map_or_else(Vec::new, |p| p.evaluated.clone()),
            },
            fallback: self.fallback.clone(),
        }
    }
}

/// A flight on the paper's reference, of a policy with its mean action or of the fallback, with `model` behind MPObs and
/// feed-forward; nothing where `goes_on` ends it.
pub(crate) fn reference_flight(
    settings: &TrainingSettings,
    (name, rig): (&str, &Rig),
    (model, map): (&Rig, &Arc<SteadyMap>),
    policy: Option<&TrainedPolicy>,
    goes_on: &mut dyn FnMut() -> bool,
) -> Result<Option<Evaluated>, TrainingError> {
    let reference = Reference::paper();
    let plan = FlightPlan {
        rig,
        model: settings.policy.variant.predicts().then_some(model),
        reference: &reference,
        seconds: EVALUATED_S,
        noise_v_rms: settings.environment.noise_v_rms,
        seed: EVALUATION_SEED,
    };
    let flown = match policy {
        Some(policy) => {
            let law = PolicyLaw::new(Arc::clone(map), settings.contract());
            let mut runner = policy.runner();
            let mut controller = PolicyController::new(law, |observation: &[f32]| runner.outputs(observation));
            fly_while(&plan, &mut controller, goes_on)?
        }
        None => fly_while(&plan, &mut Fallback::new(Arc::clone(map), FallbackSettings::default()), goes_on)?,
    };
    Ok(flown.map(|flown| Evaluated::of(name, &Score::of(&flown.ticks))))
}

/// Most memory of this process, as the kernel has counted it.
fn peak_memory_mib() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    peak.and_then(|line| line.trim().trim_end_matches("kB").trim().parse::<f64>().ok()).map_or(0.0, |kib| kib / 1024.0)
}
