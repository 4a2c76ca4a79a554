//! A training run: acting and learning in turns, until it is over, stopped or diverged.
//!
//! In each turn eight rigs take one step, and eight updates follow, so there is one update for every step, as in the
//! paper. Between two episodes nothing of the environment is left but the number of the next, so that is where
//! checkpoints are written, where the run can stop, and where it goes on from as if it had never stopped.

use std::path::Path;
use std::sync::Arc;
use std::time::{Instant, SystemTime, UNIX_EPOCH};

use environment::closed_loop::{FlightPlan, PolicyController};
use environment::draws::{Purpose, stream};
use environment::{Fleet, RigDraw, SIDE_BY_SIDE, Score, fly};
use law::PolicyLaw;
use model::contract::{ACTION_LEN, CHANNELS};
use model::rig::Rig;
use model::steady::SteadyMap;
use proto::reference::Reference;
use proto::rig_file::{self, RigFileError};
use rand::RngExt as _;
use sac::{Learner, Machine, Network, Transition};
use serde::{Deserialize, Serialize};

use crate::TrainingError;
use crate::average::{Average, EVERY_STEPS};
use crate::checkpoint::{self, Checkpoint, Position};
use crate::metrics::{Evaluated, Metrics, Point};
use crate::run_files::RunFiles;
use crate::run_report;
use crate::selection::{Kept, SELECTION_SEED, Selection};
use crate::settings::TrainingSettings;
use crate::trained_policy::{Origin, TrainedPolicy};

/// Length of the paper's reference in s.
const EVALUATED_S: f64 = 60.0;
/// The evaluations' noise, the same at every point of the curve.
const EVALUATION_SEED: u64 = 1;

/// Where a run stands.
#[derive(Debug, Clone, PartialEq)]
pub struct Progress {
    /// Steps done.
    pub steps: u64,
    /// Steps planned.
    pub steps_planned: u64,
    /// Steps per second over the last episodes.
    pub steps_per_s: f64,
    /// Mean reward per step of this episode.
    pub reward: f64,
    /// RMSE while acting in this episode, in kPa.
    pub acting_rmse_kpa: [f64; CHANNELS],
    /// The last evaluation on the last rig of the list.
    pub last_evaluation: Option<Evaluated>,
}

/// Who watches a run.
pub trait Observer {
    /// Called some times a second.
    fn progress(&mut self, progress: &Progress);
    /// Whether the run is to stop after this episode.
    fn stop(&self) -> bool;
}

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ended {
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
    pub kept: Option<Kept>,
    /// Evaluations of the policy that is kept.
    pub evaluated: Vec<Evaluated>,
}

/// A training run.
pub struct Run {
    settings: TrainingSettings,
    files: RunFiles,
    threads: usize,
    origin: Origin,
    model: Rig,
    map: Arc<SteadyMap>,
    evaluated_on: Vec<(String, Rig)>,
    fleet: Fleet,
    learner: Learner,
    average: Average,
    selection: Option<Selection>,
    metrics: Metrics,
    points: Vec<Point>,
    position: Position,
    window: Window,
}

/// Sums since the last point of the learning curve.
#[derive(Debug, Clone, Default)]
struct Window {
    began: Option<Instant>,
    environment_s: f64,
    steps: u64,
    reward: f64,
    squares: [f64; CHANNELS],
    tripped: u64,
    updates: f64,
    losses: [f64; 7],
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
        let fleet = parts.fleet(&settings, settings.run.seed)?;
        let evaluated_on = evaluated_on(&settings)?;
        let files = RunFiles::create(folder)?;
        RunFiles::write(&files.settings(), settings.to_toml()?.as_bytes())?;
        rig_file::save(&files.rig(), &parts.trained_on)?;
        rig_file::save(&files.model(), &parts.model)?;
        Self::assemble(settings, files, threads, parts, fleet, evaluated_on)
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
        let fleet = parts.fleet(&settings, settings.run.seed)?;
        let evaluated_on = evaluated_on(&settings)?;
        let mut lines = String::new();
        for point in &parts.points {
            lines += &serde_json::to_string(point)
                .map_err(|error| TrainingError::file(&files.metrics(), &format!("cannot be written: {error}")))?;
            lines.push('\n');
        }
        RunFiles::write(&files.metrics(), lines.as_bytes())?;
        Self::assemble(settings, files, threads, parts, fleet, evaluated_on)
    }

    fn assemble(
        settings: TrainingSettings,
        files: RunFiles,
        threads: usize,
        parts: Parts,
        fleet: Fleet,
        evaluated_on: Vec<(String, Rig)>,
    ) -> Result<Self, TrainingError> {
        let aside = settings.run.keep_best.then(|| parts.fleet(&settings, SELECTION_SEED)).transpose()?;
        let Parts { model, learner, average, best, position, points, origin, .. } = parts;
        let selection = aside.map(|fleet| Selection::new(fleet, best));
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
            fleet,
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
    pub fn go(&mut self, observer: &mut dyn Observer) -> Result<Ended, TrainingError> {
        let mut ended = Ended::Finished;
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
                ended = Ended::Stopped;
                break;
            }
        }
        if self.points.last().is_none_or(|p| p.step != self.position.steps) {
            // Where a run is stopped must not tell on what it keeps, or going on would not end where going through does.
            self.evaluate(false)?;
        }
        self.checkpoint()?;
        if ended == Ended::Finished {
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

    /// One episode, or what is left of the run.
    fn episode(&mut self, observer: &mut dyn Observer) -> Result<(), TrainingError> {
        let number = self.position.episode;
        let began = Instant::now();
        self.fleet.begin(number)?;
        let mut environment_s = began.elapsed().as_secs_f64();
        self.window.began.get_or_insert(began);
        self.position.steps_before = self.position.steps;
        let mut random = stream(self.settings.run.seed, Purpose::Start, number, SIDE_BY_SIDE);
        let length = self.settings.contract().observation_len();
        let mut actions = vec![0.0f32; SIDE_BY_SIDE * ACTION_LEN];
        let mut before = vec![0.0f32; SIDE_BY_SIDE * length];
        let (mut reward, mut squares, mut turns) = (0.0, [0.0; CHANNELS], 0.0);
        while !self.fleet.is_over() && self.position.steps < self.settings.run.steps {
            before.copy_from_slice(self.fleet.observations());
            if self.position.steps < self.settings.run.random_steps {
                actions.fill_with(|| random.random_range(-1.0f32..1.0));
            } else {
                actions = self.learner.act(&before, true).map_err(|error| TrainingError::learner("act", &error))?;
                if !actions.iter().all(|a| a.is_finite()) {
                    return Err(self.diverged("an action"));
                }
            }
            let simulating = Instant::now();
            let step = self.fleet.step(&actions);
            environment_s += simulating.elapsed().as_secs_f64();
            let rows = before.chunks_exact(length).zip(self.fleet.reached().chunks_exact(length));
            for (lane, ((observation, next), action)) in rows.zip(actions.chunks_exact(ACTION_LEN)).enumerate() {
                let transition = Transition {
                    observation,
                    action,
                    reward: step.rewards.get(lane).copied().unwrap_or(0.0),
                    next_observation: next,
                    terminal: step.terminal.get(lane).copied().unwrap_or(false),
                };
                self.learner.remember(&transition).map_err(|error| TrainingError::learner("remember", &error))?;
            }
            self.position.steps += SIDE_BY_SIDE as u64;
            turns += 1.0;
            for (r, e) in step.rewards.iter().zip(&step.error_kpa) {
                reward += f64::from(*r) / SIDE_BY_SIDE as f64;
                for (sum, e) in squares.iter_mut().zip(e) {
                    *sum += e * e / SIDE_BY_SIDE as f64;
                }
            }
            self.window.tripped += step.terminal.iter().map(|t| u64::from(*t)).sum::<u64>();
            if self.position.steps >= self.settings.run.random_steps {
                self.learner
                    .set_learning_rate(self.settings.learning_rate(self.position.steps))
                    .map_err(|error| TrainingError::learner("sac.learning_rate", &error))?;
                let report = self.learner.update(SIDE_BY_SIDE as u64);
                if !report.finite {
                    return Err(self.diverged("a loss or a weight"));
                }
                let over = self.settings.run.average_over_steps;
                if over > 0 && self.position.steps.is_multiple_of(EVERY_STEPS) {
                    self.average.add(self.learner.policy(), over);
                }
                self.window.updates += 1.0;
                let losses = [
                    report.critic_loss,
                    report.actor_loss,
                    report.mean_q,
                    report.temperature,
                    report.entropy,
                    report.caps_t,
                    report.caps_s,
                ];
                for (sum, loss) in self.window.losses.iter_mut().zip(losses) {
                    *sum += loss;
                }
            }
            observer.progress(&Progress {
                steps: self.position.steps,
                steps_planned: self.settings.run.steps,
                steps_per_s: turns * SIDE_BY_SIDE as f64 / began.elapsed().as_secs_f64(),
                reward: reward / turns,
                acting_rmse_kpa: squares.map(|s: f64| (s / turns).sqrt()),
                last_evaluation: self.points.last().and_then(|p| p.evaluated.last().cloned()),
            });
        }
        self.window.environment_s += environment_s;
        self.window.steps += self.position.steps - self.position.steps_before;
        self.window.reward += reward * SIDE_BY_SIDE as f64;
        for (sum, s) in self.window.squares.iter_mut().zip(squares) {
            *sum += s * SIDE_BY_SIDE as f64;
        }
        self.position.episode += 1;
        Ok(())
    }

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
    fn evaluate(&mut self, selects: bool) -> Result<(), TrainingError> {
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

/// What a run is made of, new or gone on with.
struct Parts {
    trained_on: Rig,
    model: Rig,
    learner: Learner,
    average: Average,
    best: Option<(Kept, Network)>,
    position: Position,
    points: Vec<Point>,
    origin: Origin,
}

impl Parts {
    fn fleet(&self, settings: &TrainingSettings, seed: u64) -> Result<Fleet, TrainingError> {
        let draw = RigDraw::new(&self.trained_on, &settings.environment)?;
        let predicts = settings.policy.variant.predicts();
        Ok(Fleet::new(draw, &self.model, settings.contract(), predicts, &settings.environment, seed)?)
    }
}

fn evaluated_on(settings: &TrainingSettings) -> Result<Vec<(String, Rig)>, TrainingError> {
    let load = |name: &String| Ok((name.clone(), rig_file::load(name)?));
    settings.rig.evaluated_on.iter().map(load).collect()
}

fn unix_s() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |d| d.as_secs_f64())
}

/// What the kernel has counted as the most memory of this process.
fn peak_memory_mib() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    peak.and_then(|line| line.trim().trim_end_matches("kB").trim().parse::<f64>().ok()).map_or(0.0, |kib| kib / 1024.0)
}
