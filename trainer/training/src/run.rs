//! A training run: acting and learning in turns, until it is over, stopped or diverged.
//!
//! In each turn eight rigs take one step, and eight updates follow, so there is one update for every step, as in the
//! paper. After every turn the run can write a checkpoint and stop, and it goes on from there as if it had never stopped;
//! where it is parted, and how far it was planned at first, changes no bit of it.

mod callback;
mod curve;
mod episode;
mod pace;
mod taken;

use std::path::Path;
use std::sync::Arc;
use std::time::{Instant, SystemTime, UNIX_EPOCH};

use environment::{RigDraw, SIDE_BY_SIDE, VectorEnv};
use model::rig::Rig;
use model::steady::SteadyMap;
use proto::emulator::load_for_loop;
use proto::rig_file::{self, RigFileError};
use sac::{Learner, Machine, Network};

use crate::average::Average;
use crate::checkpoint::{self, Position, Standing};
use crate::checkpoint_selection::{Best, CheckpointSelection, SELECTION_SEED};
use crate::metrics::{Evaluated, Metrics, Point};
use crate::plan_fit::{self, PlanModel};
use crate::policy_start::PolicyStart;
use crate::replay_files::ReplayFiles;
use crate::run_files::RunFiles;
use crate::run_report;
use crate::settings::{Plan, TrainingSettings};
use crate::trained_policy::{Origin, TrainedPolicy};
use crate::{Done, TrainingError};

pub use callback::{Phase, Progress, RunStatus, Summary, TrainingCallback};
use curve::Occasion;
pub(crate) use curve::{Window, reference_flight};
use episode::EpisodeUnderWay;
use pace::Pace;
pub(crate) use taken::taken;

/// A training run.
pub struct Run {
    settings: TrainingSettings,
    files: RunFiles,
    replay: ReplayFiles,
    threads: usize,
    origin: Origin,
    trained_on: Rig,
    model: Rig,
    map: Arc<SteadyMap>,
    evaluated_on: Vec<(String, Rig)>,
    env: VectorEnv,
    learner: Learner,
    average: Average,
    selection: Option<CheckpointSelection>,
    /// The last policy, where the run ended between two planned points and it is better than the best of those.
    end_best: Option<Best>,
    metrics: Metrics,
    points: Vec<Point>,
    fallback: Vec<Evaluated>,
    position: Position,
    window: Window,
    /// The episode under way.
    episode: Option<EpisodeUnderWay>,
    /// Actions of a checkpoint's episode, which are taken again first.
    to_redo: Vec<f32>,
    pace: Pace,
    /// Until when the time of this sitting is counted.
    counted_until: Instant,
}

impl Run {
    /// Begins a run in a new folder, from nothing or from a policy.
    ///
    /// # Errors
    /// Settings, rigs, policy or folder that do not do; nothing is left half-written.
    pub fn begin(
        settings: TrainingSettings,
        start: Option<&PolicyStart>,
        folder: &Path,
        threads: usize,
    ) -> Result<Self, TrainingError> {
        let mut settings = settings;
        settings.rig.model.get_or_insert_with(|| settings.rig.trained_on.clone());
        if let Some(start) = start {
            start.adopt_into(&mut settings)?;
        }
        settings.check().map_err(|problem| TrainingError::Settings { file: "settings".into(), line: None, problem })?;
        let (trained_on, model) = rigs_of(&settings)?;
        // Everything that can be refused is made before the folder is.
        let origin = Origin::of(&trained_on)?;
        let mut learner = Learner::new(
            settings.shape(),
            settings.feature_map()?,
            settings.learner_settings(),
            Machine::with_threads(threads),
        )
        .map_err(|error| TrainingError::learner("settings", &error))?;
        if let Some(start) = start {
            start.warm_start(&mut learner, &settings, threads)?;
        }
        let parts = Parts { trained_on, model, learner, standing: Standing::default(), points: Vec::new(), origin };
        let env = parts.env(&settings, settings.run.seed)?;
        let evaluated_on = evaluated_on(&settings)?;
        let files = RunFiles::create(folder)?;
        RunFiles::write(&files.settings(), settings.to_toml()?.as_bytes())?;
        rig_file::save(&files.rig(), &parts.trained_on)?;
        rig_file::save(&files.model(), &parts.model)?;
        let replay = ReplayFiles::new(files.replay(), settings.sac.replay, 0);
        Self::assemble(settings, files, replay, threads, parts, env, evaluated_on)
    }

    /// Goes on with a run; `steps` plans another length.
    ///
    /// # Errors
    /// If the folder holds no run, or its files are damaged; fewer steps than it has done.
    pub fn resume(folder: &Path, steps: Option<u64>, threads: usize) -> Result<Self, TrainingError> {
        let files = RunFiles::open(folder)?;
        let mut settings = files.read_settings()?;
        let load = |path: std::path::PathBuf| load_for_loop(&path.display().to_string(), None);
        let (trained_on, model) = (load(files.rig())?, load(files.model())?);
        let origin = Origin::of(&trained_on)?;
        let (standing, replay, learner) = checkpoint::read(&files, &settings, threads)?;
        if let Some(steps) = steps {
            let done = standing.position.steps;
            // Steps come eight at a time: a run of 1,001 ends after 1,008.
            if steps.div_ceil(SIDE_BY_SIDE as u64) < done.div_ceil(SIDE_BY_SIDE as u64) {
                let done = Done { count: done, what: "steps are done" };
                return Err(TrainingError::ends_before(folder, done, "--steps", steps));
            }
            settings.run.steps = steps;
        }
        // Points after the checkpoint belong to work that was lost and will be made again; points that are not planned
        // stand where the run once ended.
        let mut points = match files.metrics().exists() {
            true => crate::metrics::read(&files.metrics(), standing.position.steps)?,
            false => Vec::new(),
        };
        points.retain(|point| settings.is_evaluated_at(point.step));
        let parts = Parts { trained_on, model, learner, standing, points, origin };
        let env = parts.env(&settings, settings.run.seed)?;
        let evaluated_on = evaluated_on(&settings)?;
        let mut lines = String::new();
        for point in &parts.points {
            lines += &serde_json::to_string(point)
                .map_err(|error| TrainingError::file(&files.metrics(), &format!("cannot be written: {error}")))?;
            lines.push('\n');
        }
        RunFiles::write(&files.metrics(), lines.as_bytes())?;
        RunFiles::write(&files.settings(), settings.to_toml()?.as_bytes())?;
        let mut run = Self::assemble(settings, files, replay, threads, parts, env, evaluated_on)?;
        run.fallback = run.earlier_fallback();
        Ok(run)
    }

    /// The fallback's flights of an earlier sitting, so that a page that is written before the next point has its line; none where
    /// other rigs were flown.
    fn earlier_fallback(&self) -> Vec<Evaluated> {
        let earlier =
            std::fs::read(self.files.summary()).ok().and_then(|text| serde_json::from_slice::<Summary>(&text).ok());
        let flown = earlier.map_or_else(Vec::new, |summary| summary.fallback);
        let same = flown.len() <= self.evaluated_on.len()
            && flown.iter().zip(&self.evaluated_on).all(|(flown, (name, _))| flown.rig == *name);
        if same { flown } else { Vec::new() }
    }

    fn assemble(
        settings: TrainingSettings,
        files: RunFiles,
        replay: ReplayFiles,
        threads: usize,
        parts: Parts,
        env: VectorEnv,
        evaluated_on: Vec<(String, Rig)>,
    ) -> Result<Self, TrainingError> {
        let aside = settings.run.keep_best.then(|| parts.env(&settings, SELECTION_SEED)).transpose()?;
        let Parts { trained_on, model, learner, standing, points, origin } = parts;
        let Standing { position, window, actions, average, best } = standing;
        let selection = aside.map(|env| CheckpointSelection::new(env, best));
        let map = SteadyMap::new(&model)
            .map_err(|problem| RigFileError::Rig { file: settings.rig.model().to_owned(), problem })?;
        let metrics = Metrics::open(&files.metrics(), &files.events(), unix_s())?;
        Ok(Run {
            settings,
            files,
            replay,
            threads,
            origin,
            trained_on,
            model,
            map: Arc::new(map),
            evaluated_on,
            env,
            learner,
            average,
            selection,
            end_best: None,
            metrics,
            points,
            fallback: Vec::new(),
            position,
            window,
            episode: None,
            to_redo: actions,
            pace: Pace::default(),
            counted_until: Instant::now(),
        })
    }

    /// The run's folder.
    pub fn files(&self) -> &RunFiles {
        &self.files
    }

    /// The policy that is kept: the best so far, or the last, as the settings say.
    pub fn policy(&self) -> TrainedPolicy {
        self.trained(self.best().map_or_else(|| self.last(), |best| best.network.clone()))
    }

    fn trained(&self, network: Network) -> TrainedPolicy {
        TrainedPolicy::new(self.settings.clone(), self.origin.clone(), self.position.steps, network)
    }

    /// The policy as it stands.
    fn last(&self) -> Network {
        let last = self.average.get().cloned().unwrap_or_else(|| self.learner.policy());
        match self.settings.policy.plan {
            Plan::Learned => last,
            Plan::Fitted => plan_fit::held(&last),
        }
    }

    /// The policy that is kept, with the spread of its distribution, and its plan fitted where the settings say so.
    fn with_plan(&self) -> Result<TrainedPolicy, TrainingError> {
        let model = PlanModel { rig: &self.model, map: &self.map };
        let policy = self.policy().with_spread(&model)?;
        match self.settings.policy.plan {
            Plan::Learned => Ok(policy),
            Plan::Fitted => Ok(policy.with_network(plan_fit::fitted(policy.network(), &self.settings, &model)?)),
        }
    }

    /// Acts and learns until all steps are done or the callback wants to stop.
    ///
    /// # Errors
    /// A loss that is not finite, or a file that cannot be written; the last checkpoint is kept.
    pub fn go(&mut self, callback: &mut dyn TrainingCallback) -> Result<RunStatus, TrainingError> {
        self.counted_until = Instant::now();
        let to_redo = std::mem::take(&mut self.to_redo);
        if !self.redo(&to_redo, callback)? {
            // The checkpoint that the run was to go on from is still the newest.
            return Ok(RunStatus::Stopped);
        }
        if !self.files.checkpoint().exists() {
            self.checkpoint()?;
        }
        let status = self.work(callback)?;
        self.checkpoint()?;
        callback.is_kept();
        match status {
            RunStatus::Stopped => {}
            RunStatus::Finished => {
                self.tell(callback, Phase::FittingPlan, None);
                let policy = self.with_plan()?;
                RunFiles::write(&self.files.policy(), &policy.to_bytes()?)?;
                RunFiles::write(&self.files.onnx(), &policy.to_onnx(&[])?)?;
            }
        }
        let figures = self.summary();
        let summary = serde_json::to_string_pretty(&figures)
            .map_err(|error| TrainingError::file(&self.files.summary(), &error.to_string()))?;
        RunFiles::write(&self.files.summary(), format!("{summary}\n").as_bytes())?;
        RunFiles::write(&self.files.report(), run_report::page(&self.settings, &figures, &self.points).as_bytes())?;
        Ok(status)
    }

    /// Turns, evaluations and checkpoints, up to the end or a stop.
    fn work(&mut self, callback: &mut dyn TrainingCallback) -> Result<RunStatus, TrainingError> {
        loop {
            if callback.stop() {
                return Ok(RunStatus::Stopped);
            }
            let steps = self.position.steps;
            let is_made = self.points.last().is_some_and(|point| point.step == steps);
            let is_over = steps >= self.settings.run.steps;
            if self.settings.is_evaluated_at(steps) && !is_made {
                if !self.evaluate(Occasion::Planned, callback)? {
                    return Ok(RunStatus::Stopped);
                }
            } else if is_over && !is_made && !self.evaluate(Occasion::End, callback)? {
                return Ok(RunStatus::Stopped);
            }
            if is_over {
                return Ok(RunStatus::Finished);
            }
            let every = self.settings.run.checkpoint_every_steps;
            if steps > 0 && passes(steps, every) {
                self.checkpoint()?;
            }
            self.turn(callback)?;
        }
    }

    fn checkpoint(&mut self) -> Result<(), TrainingError> {
        self.account();
        let standing = Standing {
            position: self.position.clone(),
            window: self.window.clone(),
            actions: self.episode.as_ref().map_or_else(Vec::new, |episode| episode.actions.clone()),
            average: self.average.clone(),
            best: self.selection.as_ref().and_then(|selection| selection.best()).cloned(),
        };
        checkpoint::write(&self.files, &mut self.replay, &standing, &self.learner)?;
        RunFiles::write(&self.files.policy(), &self.policy().to_bytes()?)
    }

    /// Counts the time since the last call.
    fn account(&mut self) {
        self.position.wall_s += self.counted_until.elapsed().as_secs_f64();
        self.counted_until = Instant::now();
    }

    /// Tells the callback where the run stands.
    fn tell(&self, callback: &mut dyn TrainingCallback, phase: Phase, episode: Option<&EpisodeUnderWay>) {
        let (steps, planned) = (self.position.steps, self.settings.run.steps);
        callback.progress(&Progress {
            phase,
            steps,
            steps_planned: planned,
            steps_per_s: self.pace.steps_per_s(),
            left_s: self.pace.left_s(planned.saturating_sub(steps), self.settings.evaluations_between(steps, planned)),
            reward: episode.map(EpisodeUnderWay::mean_reward),
            acting_rmse_kpa: episode.map_or([0.0; 2], EpisodeUnderWay::rmse_kpa),
            last_evaluation: self.points.last().and_then(|p| p.evaluated.last().cloned()),
        });
    }

    fn diverged(&self, what: &str) -> TrainingError {
        let kept = if self.files.checkpoint().exists() {
            format!("{} is kept; lower sac.learning_rate and go on from it", self.files.checkpoint().display())
        } else {
            "no checkpoint had been written; lower sac.learning_rate".into()
        };
        TrainingError::Diverged { step: self.position.steps, what: what.into(), kept }
    }
}

/// Tells whether the turn that ended at `steps` passed a multiple of `every`.
fn passes(steps: u64, every: u64) -> bool {
    steps / every > steps.saturating_sub(SIDE_BY_SIDE as u64) / every
}

/// Parts of a run, new or gone on with.
struct Parts {
    trained_on: Rig,
    model: Rig,
    learner: Learner,
    standing: Standing,
    points: Vec<Point>,
    origin: Origin,
}

impl Parts {
    fn env(&self, settings: &TrainingSettings, seed: u64) -> Result<VectorEnv, TrainingError> {
        let draw = RigDraw::new(&self.trained_on, &settings.environment)?;
        let predicts = settings.policy.variant.predicts();
        Ok(VectorEnv::new(draw, &self.model, settings.contract(), predicts, &settings.environment, seed)?)
    }
}

/// The plant and the model that the settings name.
pub(crate) fn rigs_of(settings: &TrainingSettings) -> Result<(Rig, Rig), TrainingError> {
    let trained_on = load_for_loop(&settings.rig.trained_on, Some("--rig, rig.trained_on"))?;
    // Where no model is named it is the plant, which is refused as such.
    let model = load_for_loop(settings.rig.model(), Some("--model, rig.model"))?;
    Ok((trained_on, model))
}

pub(crate) fn evaluated_on(settings: &TrainingSettings) -> Result<Vec<(String, Rig)>, TrainingError> {
    let load = |name: &String| Ok((name.clone(), load_for_loop(name, Some("rig.evaluated_on"))?));
    settings.rig.evaluated_on.iter().map(load).collect()
}

fn unix_s() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |d| d.as_secs_f64())
}
