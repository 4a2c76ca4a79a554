//! A training run: acting and learning in turns, until it is over, stopped or diverged.
//!
//! In each turn eight rigs take one step, and eight updates follow, so there is one update for every step, as in the
//! paper. Between two episodes nothing of the environment is left but the number of the next, so that is where
//! checkpoints are written, where the run can stop, and where it goes on from as if it had never stopped.

mod callback;
mod curve;
mod episode;

use std::path::Path;
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};

use environment::{RigDraw, VectorEnv};
use model::rig::Rig;
use model::steady::SteadyMap;
use proto::rig_file::{self, RigFileError};
use sac::{Learner, Machine, Network};

use crate::TrainingError;
use crate::average::Average;
use crate::checkpoint::{self, Checkpoint, Position};
use crate::checkpoint_selection::{BestCheckpoint, CheckpointSelection, SELECTION_SEED};
use crate::metrics::{Metrics, Point};
use crate::run_files::RunFiles;
use crate::run_report;
use crate::settings::TrainingSettings;
use crate::trained_policy::{Origin, TrainedPolicy};

pub use callback::{Progress, RunStatus, Summary, TrainingCallback};
use curve::Window;

/// A training run.
pub struct Run {
    settings: TrainingSettings,
    files: RunFiles,
    threads: usize,
    origin: Origin,
    model: Rig,
    map: Arc<SteadyMap>,
    evaluated_on: Vec<(String, Rig)>,
    env: VectorEnv,
    learner: Learner,
    average: Average,
    selection: Option<CheckpointSelection>,
    metrics: Metrics,
    points: Vec<Point>,
    position: Position,
    window: Window,
}

impl Run {
    /// Begins a run in a new folder.
    ///
    /// # Errors
    /// Settings, rigs or folder that do not do; nothing is left half-written.
    pub fn begin(settings: TrainingSettings, folder: &Path, threads: usize) -> Result<Self, TrainingError> {
        settings.check().map_err(|problem| TrainingError::Settings { file: "settings".into(), line: None, problem })?;
        let trained_on = rig_file::load(&settings.rig.trained_on)?;
        let model = rig_file::load(&settings.rig.model)?;
        // Everything that can be refused is made before the folder is.
        let origin = Origin::of(&trained_on)?;
        let learner = Learner::new(
            settings.shape(),
            settings.feature_map()?,
            settings.learner_settings(),
            Machine::with_threads(threads),
        )
        .map_err(|error| TrainingError::learner("settings", &error))?;
        let (average, position, points) = (Average::default(), Position::default(), Vec::new());
        let parts = Parts { trained_on, model, learner, average, best: None, position, points, origin };
        let env = parts.env(&settings, settings.run.seed)?;
        let evaluated_on = evaluated_on(&settings)?;
        let files = RunFiles::create(folder)?;
        RunFiles::write(&files.settings(), settings.to_toml()?.as_bytes())?;
        rig_file::save(&files.rig(), &parts.trained_on)?;
        rig_file::save(&files.model(), &parts.model)?;
        Self::assemble(settings, files, threads, parts, env, evaluated_on)
    }

    /// Goes on with a run; `steps` plans another length.
    ///
    /// # Errors
    /// If the folder holds no run, or its files are damaged.
    pub fn resume(folder: &Path, steps: Option<u64>, threads: usize) -> Result<Self, TrainingError> {
        let files = RunFiles::open(folder)?;
        let mut settings = files.read_settings()?;
        settings.run.steps = steps.unwrap_or(settings.run.steps);
        let load = |path: std::path::PathBuf| rig_file::load(&path.display().to_string());
        let (trained_on, model) = (load(files.rig())?, load(files.model())?);
        let origin = Origin::of(&trained_on)?;
        let Checkpoint { position, average, best, learner } = checkpoint::read(&files, &settings, threads)?;
        // Points after the checkpoint belong to work that was lost; they will be made again.
        let points =
            if files.metrics().exists() { crate::metrics::read(&files.metrics(), position.steps)? } else { Vec::new() };
        let parts = Parts { trained_on, model, learner, average, best, position, points, origin };
        let env = parts.env(&settings, settings.run.seed)?;
        let evaluated_on = evaluated_on(&settings)?;
        let mut lines = String::new();
        for point in &parts.points {
            lines += &serde_json::to_string(point)
                .map_err(|error| TrainingError::file(&files.metrics(), &format!("cannot be written: {error}")))?;
            lines.push('\n');
        }
        RunFiles::write(&files.metrics(), lines.as_bytes())?;
        Self::assemble(settings, files, threads, parts, env, evaluated_on)
    }

    fn assemble(
        settings: TrainingSettings,
        files: RunFiles,
        threads: usize,
        parts: Parts,
        env: VectorEnv,
        evaluated_on: Vec<(String, Rig)>,
    ) -> Result<Self, TrainingError> {
        let aside = settings.run.keep_best.then(|| parts.env(&settings, SELECTION_SEED)).transpose()?;
        let Parts { model, learner, average, best, position, points, origin, .. } = parts;
        let selection = aside.map(|env| CheckpointSelection::new(env, best));
        let map = SteadyMap::new(&model)
            .map_err(|problem| RigFileError::Rig { file: settings.rig.model.clone(), problem })?;
        let metrics = Metrics::open(&files.metrics(), &files.events(), unix_s())?;
        Ok(Run {
            settings,
            files,
            threads,
            origin,
            model,
            map: Arc::new(map),
            evaluated_on,
            env,
            learner,
            average,
            selection,
            metrics,
            points,
            position,
            window: Window::default(),
        })
    }

    /// The run's folder.
    pub fn files(&self) -> &RunFiles {
        &self.files
    }

    /// The policy that is kept: the best so far, or the last, as the settings say.
    pub fn policy(&self) -> TrainedPolicy {
        let best = self.selection.as_ref().and_then(|selection| selection.best());
        self.trained(best.map_or_else(|| self.last(), |(_, network)| network.clone()))
    }

    fn trained(&self, network: Network) -> TrainedPolicy {
        TrainedPolicy::new(self.settings.clone(), self.origin.clone(), self.position.steps, network)
    }

    /// The policy as it stands.
    fn last(&self) -> Network {
        self.average.get().cloned().unwrap_or_else(|| self.learner.policy())
    }

    /// Acts and learns until all steps are done or the observer wants to stop.
    ///
    /// # Errors
    /// A loss that is not finite, or a file that cannot be written; the last checkpoint is kept.
    pub fn go(&mut self, observer: &mut dyn TrainingCallback) -> Result<RunStatus, TrainingError> {
        let mut ended = RunStatus::Finished;
        while self.position.steps < self.settings.run.steps {
            self.episode(observer)?;
            let run = &self.settings.run;
            let over = self.position.steps >= run.steps;
            let passed = |every: u64| self.position.steps / every > self.position.steps_before / every;
            let (evaluate, keep) = (passed(run.evaluate_every_steps), passed(run.checkpoint_every_steps));
            if evaluate || over {
                self.evaluate(true)?;
            }
            if keep && !over {
                self.checkpoint()?;
            }
            if !over && observer.stop() {
                ended = RunStatus::Stopped;
                break;
            }
        }
        if self.points.last().is_none_or(|p| p.step != self.position.steps) {
            // Where a run is stopped must not tell on what it keeps, or going on would not end where going through does.
            self.evaluate(false)?;
        }
        self.checkpoint()?;
        if ended == RunStatus::Finished {
            let policy = self.policy();
            RunFiles::write(&self.files.onnx(), &policy.to_onnx(&[])?)?;
        }
        let figures = self.summary()?;
        let summary = serde_json::to_string_pretty(&figures)
            .map_err(|error| TrainingError::file(&self.files.summary(), &error.to_string()))?;
        RunFiles::write(&self.files.summary(), format!("{summary}\n").as_bytes())?;
        RunFiles::write(&self.files.report(), run_report::page(&self.settings, &figures, &self.points).as_bytes())?;
        Ok(ended)
    }

    fn checkpoint(&mut self) -> Result<(), TrainingError> {
        let best = self.selection.as_ref().and_then(|selection| selection.best());
        checkpoint::write(&self.files, &self.position, &self.average, best, &self.learner)?;
        RunFiles::write(&self.files.policy(), &self.policy().to_bytes()?)
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

/// What a run is made of, new or gone on with.
struct Parts {
    trained_on: Rig,
    model: Rig,
    learner: Learner,
    average: Average,
    best: Option<(BestCheckpoint, Network)>,
    position: Position,
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

fn evaluated_on(settings: &TrainingSettings) -> Result<Vec<(String, Rig)>, TrainingError> {
    let load = |name: &String| Ok((name.clone(), rig_file::load(name)?));
    settings.rig.evaluated_on.iter().map(load).collect()
}

fn unix_s() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |d| d.as_secs_f64())
}
