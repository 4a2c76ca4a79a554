//! A run of rollouts: rounds of flying and moving, which policy is kept, going on after a stop.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use environment::{RigDraw, VectorEnv};
use model::observation::Pair;
use model::rig::Rig;
use model::steady::SteadyMap;
use proto::rig_file::{self, RigFileError};
use sac::Network;
use serde::{Deserialize, Serialize};

use super::files::{self, Position, Standing};
use super::probe::{Episode, Probe};
use super::regression::{self, Moments};
use super::report;
use crate::TrainingError;
use crate::checkpoint_selection::{SELECTION_SEED, rmse_kpa};
use crate::metrics::Evaluated;
use crate::plan_fit::{self, PlanModel};
use crate::policy_start::PolicyStart;
use crate::run::{RunStatus, reference_flight};
use crate::run_files::RunFiles;
use crate::settings::{Plan, RolloutSettings, TrainingSettings};
use crate::trained_policy::{Origin, TrainedPolicy};

/// Between two looks at whether to stop.
const LOOK: Duration = Duration::from_millis(20);
/// Learning rate of the last round beside the first's.
const LAST_RATE: f64 = 0.1;

/// What a round left.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Round {
    /// Its number; 0 is the policy that the run began with.
    pub round: u64,
    /// Seconds of work so far.
    pub wall_s: f64,
    /// Geometric mean of the RMSE on rigs set aside, positive and negative, in kPa.
    pub rmse_kpa: Pair,
    /// Of both channels: what the policy is kept by.
    pub score_kpa: f64,
    /// Branches that it was learned from.
    pub branches: u64,
}

/// Who watches a run.
pub trait RolloutCallback {
    /// An episode was flown.
    fn episode(&mut self);
    /// A round is over, or the beginning was scored.
    fn round(&mut self, round: &Round, of: u64);
    /// Whether the run is to stop: what the rounds before have left is kept.
    fn stop(&self) -> bool;
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
    /// The fallback on the rigs set aside, positive and negative, in kPa.
    pub fallback_kpa: Pair,
    /// The policy that is kept on the paper's reference.
    pub evaluated: Vec<Evaluated>,
    /// The policy that the run began with.
    pub began: Vec<Evaluated>,
    /// The fallback.
    pub fallback: Vec<Evaluated>,
}

/// A run of rollouts.
pub struct RolloutRun {
    settings: TrainingSettings,
    rollouts: RolloutSettings,
    files: RunFiles,
    trained_on: Rig,
    model: Rig,
    map: Arc<SteadyMap>,
    origin: Origin,
    exploration_std: Option<Vec<f64>>,
    began: Network,
    probes: Vec<Probe>,
    aside: VectorEnv,
    standing: Standing,
}

impl RolloutRun {
    /// Begins a run from the policy at `from` in a new folder. Its plan is left behind: at the end one is fitted.
    ///
    /// # Errors
    /// Settings, rigs, policy or folder that do not do; nothing is left half-written.
    pub fn begin(
        settings: TrainingSettings,
        from: &Path,
        folder: &Path,
        threads: usize,
    ) -> Result<Self, TrainingError> {
        let mut settings = settings;
        settings.policy.plan = Plan::Fitted;
        settings.rig.model.get_or_insert_with(|| settings.rig.trained_on.clone());
        let start = PolicyStart::load(from)?;
        start.adopt_into(&mut settings)?;
        settings.run.critics_from = None;
        settings.rollouts.get_or_insert_with(RolloutSettings::default);
        settings.check().map_err(|problem| TrainingError::Settings { file: "settings".into(), line: None, problem })?;
        let network = start.network(Plan::Fitted);
        let standing = Standing {
            position: Position::default(),
            moments: Moments::of(&network),
            network: Network { log_std: None, ..network },
            best: None,
        };
        let trained_on = rig_file::load(&settings.rig.trained_on)?;
        let model = rig_file::load(settings.rig.model())?;
        // Everything that can be refused is made before the folder is.
        let mut run = Self::assemble(settings, RunFiles::at(folder), trained_on, model, standing, threads)?;
        run.exploration_std = TrainedPolicy::load(from)?.exploration_std().map(<[f64]>::to_vec);
        RunFiles::create(folder)?;
        RunFiles::write(&run.files.settings(), run.settings.to_toml()?.as_bytes())?;
        rig_file::save(&run.files.rig(), &run.trained_on)?;
        rig_file::save(&run.files.model(), &run.model)?;
        RunFiles::write(&run.files.start(), &run.trained(run.began.clone()).to_bytes()?)?;
        files::write(&run.files, &run.standing)?;
        Ok(run)
    }

    /// Goes on with a run; `rounds` plans another length.
    ///
    /// # Errors
    /// If the folder holds no run of rollouts, or its files are damaged.
    pub fn resume(folder: &Path, rounds: Option<u64>, threads: usize) -> Result<Self, TrainingError> {
        let files = RunFiles::open(folder)?;
        let standing = files::read(&files.checkpoint())?;
        let mut settings = files.read_settings()?;
        let planned = settings.rollouts.get_or_insert_with(RolloutSettings::default);
        planned.rounds = rounds.unwrap_or(planned.rounds);
        let load = |path: std::path::PathBuf| rig_file::load(&path.display().to_string());
        let (trained_on, model) = (load(files.rig())?, load(files.model())?);
        let began = TrainedPolicy::load(&files.start())?;
        let mut run = Self::assemble(settings, files, trained_on, model, standing, threads)?;
        run.began = began.network().clone();
        run.exploration_std = began.exploration_std().map(<[f64]>::to_vec);
        RunFiles::write(&run.files.settings(), run.settings.to_toml()?.as_bytes())?;
        Ok(run)
    }

    /// Whether a folder holds a run of rollouts.
    pub fn is_in(folder: &Path) -> bool {
        RunFiles::open(folder).is_ok_and(|files| files::is_one(&files))
    }

    fn assemble(
        settings: TrainingSettings,
        files: RunFiles,
        trained_on: Rig,
        model: Rig,
        standing: Standing,
        threads: usize,
    ) -> Result<Self, TrainingError> {
        let rollouts = settings.rollouts.clone().unwrap_or_default();
        let origin = Origin::of(&trained_on)?;
        let map = SteadyMap::new(&model)
            .map_err(|problem| RigFileError::Rig { file: settings.rig.model().to_owned(), problem })?;
        let env = |episode_s: f64, seed| {
            let environment = environment::EnvironmentSettings { episode_s, ..settings.environment.clone() };
            let draw = RigDraw::new(&trained_on, &environment)?;
            let predicts = settings.policy.variant.predicts();
            VectorEnv::new(draw, &model, settings.contract(), predicts, &environment, seed)?
                .averaged(&model, rollouts.averaged_step_ms)
        };
        let seed = settings.run.seed;
        let warm_up_s = settings.environment.warm_up_s;
        let flown = env(warm_up_s + rollouts.episode_s, seed)?;
        let aside = env(settings.environment.episode_s, SELECTION_SEED)?;
        let threads = threads.clamp(1, usize::try_from(rollouts.episodes).unwrap_or(1));
        let probes = (0..threads).map(|_| Probe::new(&flown, &rollouts, seed)).collect();
        Ok(RolloutRun {
            began: standing.network.clone(),
            exploration_std: None,
            settings,
            rollouts,
            files,
            trained_on,
            model,
            map: Arc::new(map),
            origin,
            probes,
            aside,
            standing,
        })
    }

    /// The run's folder.
    pub fn files(&self) -> &RunFiles {
        &self.files
    }

    /// Plant, model behind MPObs and feed-forward, and where the policy starts, in one line.
    pub fn taken(&self) -> String {
        crate::run::taken(&self.settings, &self.trained_on, &self.model)
    }

    /// Rounds that are planned.
    pub fn rounds(&self) -> u64 {
        self.rollouts.rounds
    }

    /// Rounds that are done.
    pub fn rounds_done(&self) -> u64 {
        self.standing.position.rounds
    }

    /// Episodes of a round.
    pub fn episodes(&self) -> u64 {
        self.rollouts.episodes
    }

    /// Flies and moves until all rounds are done or the callback wants to stop. A stop loses the round under way, and leaves a
    /// policy and a page as the end does.
    ///
    /// # Errors
    /// A weight that is not finite, or a file that cannot be written; the last checkpoint is kept.
    pub fn go(&mut self, callback: &mut dyn RolloutCallback) -> Result<RunStatus, TrainingError> {
        let mut counted_from = Instant::now();
        if self.standing.position.curve.is_empty() {
            self.score(0, counted_from, callback)?;
            counted_from = Instant::now();
        }
        while self.standing.position.rounds < self.rollouts.rounds {
            let Some(round) = self.fly_round(callback)? else { break };
            let position = &self.standing.position;
            let done = position.rounds as f64 / self.rollouts.rounds.max(2).saturating_sub(1) as f64;
            let rate = self.rollouts.learning_rate * (1.0 - (1.0 - LAST_RATE) * done.min(1.0));
            let key = [self.settings.run.seed, position.rounds];
            let Standing { network, moments, .. } = &mut self.standing;
            regression::learn(network, moments, &round, &self.rollouts, key, rate as f32);
            self.check_finite()?;
            self.standing.position.rounds += 1;
            self.standing.position.steps = self.standing.moments.steps;
            let branches = round.iter().map(|episode| episode.branches.len() as u64).sum();
            self.score(branches, counted_from, callback)?;
            counted_from = Instant::now();
        }
        let is_over = self.standing.position.rounds >= self.rollouts.rounds;
        Ok(if is_over { RunStatus::Finished } else { RunStatus::Stopped })
    }

    /// All episodes of the next round, in their order; nothing where a stop is asked for.
    fn fly_round(&mut self, callback: &mut dyn RolloutCallback) -> Result<Option<Vec<Episode>>, TrainingError> {
        let first = self.standing.position.rounds * self.rollouts.episodes;
        let (network, rollouts) = (&self.standing.network, &self.rollouts);
        let mut round = Vec::new();
        let numbers: Vec<u64> = (first..first + rollouts.episodes).collect();
        for some in numbers.chunks(self.probes.len()) {
            if callback.stop() {
                return Ok(None);
            }
            let stopped = AtomicBool::new(false);
            let flown = std::thread::scope(|scope| {
                let stop = || stopped.load(Ordering::Relaxed);
                let flights: Vec<_> = some
                    .iter()
                    .zip(&mut self.probes)
                    .map(|(number, probe)| scope.spawn(move || probe.episode(network, rollouts, *number, &stop)))
                    .collect();
                while flights.iter().any(|flight| !flight.is_finished()) {
                    if callback.stop() {
                        stopped.store(true, Ordering::Relaxed);
                    }
                    std::thread::sleep(LOOK);
                }
                flights.into_iter().map(std::thread::ScopedJoinHandle::join).collect::<Vec<_>>()
            });
            for episode in flown {
                // A panic of a flight is this program's fault, and goes on as one.
                match episode.unwrap_or_else(|panic| std::panic::resume_unwind(panic))? {
                    Some(episode) => round.push(episode),
                    None => return Ok(None),
                }
                callback.episode();
            }
        }
        Ok(Some(round))
    }

    /// Scores the policy as it stands, keeps it where it is the best, and writes a checkpoint.
    fn score(
        &mut self,
        branches: u64,
        since: Instant,
        callback: &mut dyn RolloutCallback,
    ) -> Result<(), TrainingError> {
        // A score takes some seconds; a stop waits for it, as what the round has learned is lost without it.
        let held = plan_fit::held(&self.standing.network);
        let Some(rmse_kpa) = rmse_kpa(&mut self.aside, &held, &mut || false)? else { return Ok(()) };
        let score_kpa = (rmse_kpa[0] * rmse_kpa[1]).sqrt();
        let position = &mut self.standing.position;
        position.wall_s += since.elapsed().as_secs_f64();
        let round = Round { round: position.rounds, wall_s: position.wall_s, rmse_kpa, score_kpa, branches };
        position.curve.push(round);
        if score_kpa.is_finite() && position.best.is_none_or(|(_, best)| score_kpa < best) {
            position.best = Some((round.round, score_kpa));
            self.standing.best = Some(self.standing.network.clone());
        }
        files::write(&self.files, &self.standing)?;
        callback.round(&round, self.rollouts.rounds);
        Ok(())
    }

    fn check_finite(&self) -> Result<(), TrainingError> {
        self.standing.network.check().map_err(|_| TrainingError::Diverged {
            step: self.standing.position.rounds,
            what: "a weight".into(),
            kept: format!("{} is kept; lower rollouts.learning_rate and begin anew", self.files.checkpoint().display()),
        })
    }

    fn trained(&self, network: Network) -> TrainedPolicy {
        let ticks = ((self.settings.environment.warm_up_s + self.rollouts.episode_s) / law::TICK_S).round() as u64;
        let flown = self.standing.position.rounds * self.rollouts.episodes * ticks * environment::SIDE_BY_SIDE as u64;
        TrainedPolicy::new(self.settings.clone(), self.origin.clone(), flown, network)
            .with_stated_spread(self.exploration_std.clone())
    }

    /// Fits the plan of the policy that is kept, and writes policy, page and figures.
    ///
    /// # Errors
    /// If a rig cannot be run, or a file cannot be written.
    pub fn finish(&self) -> Result<RolloutSummary, TrainingError> {
        let model = PlanModel { rig: &self.model, map: &self.map };
        let best = self.standing.best.as_ref().unwrap_or(&self.began);
        let fitted = |network: &Network| plan_fit::fitted(network, &self.settings, &model);
        let policy = self.trained(fitted(best)?);
        let began = self.trained(fitted(&self.began)?);
        let summary = self.summary(&policy, &began)?;
        RunFiles::write(&self.files.policy(), &policy.to_bytes()?)?;
        RunFiles::write(&self.files.onnx(), &policy.to_onnx(&[])?)?;
        let text = serde_json::to_string_pretty(&summary)
            .map_err(|error| TrainingError::file(&self.files.summary(), &error.to_string()))?;
        RunFiles::write(&self.files.report(), report::page(&self.settings, &summary).as_bytes())?;
        RunFiles::write(&self.files.summary(), format!("{text}\n").as_bytes())?;
        Ok(summary)
    }

    fn summary(&self, policy: &TrainedPolicy, began: &TrainedPolicy) -> Result<RolloutSummary, TrainingError> {
        let mut summary = RolloutSummary {
            taken: self.taken(),
            rounds: self.standing.position.rounds,
            rounds_planned: self.rollouts.rounds,
            seed: self.settings.run.seed,
            wall_s: self.standing.position.wall_s,
            kept: self.kept(),
            curve: self.standing.position.curve.clone(),
            fallback_kpa: [f64::NAN; 2],
            evaluated: Vec::new(),
            began: Vec::new(),
            fallback: Vec::new(),
        };
        let mut aside = self.aside.clone();
        let nothing = silent(&self.began);
        if let Some(fallback) = rmse_kpa(&mut aside, &plan_fit::held(&nothing), &mut || false)? {
            summary.fallback_kpa = fallback;
        }
        for name in &self.settings.rig.evaluated_on {
            let rig = rig_file::load(name)?;
            let flown = |who: Option<&TrainedPolicy>| {
                reference_flight(&self.settings, (name, &rig), (&self.model, &self.map), who, &mut || true)
            };
            summary.evaluated.extend(flown(Some(policy))?);
            summary.began.extend(flown(Some(began))?);
            summary.fallback.extend(flown(None)?);
        }
        Ok(summary)
    }

    /// The round whose policy is kept.
    fn kept(&self) -> Round {
        let Position { curve, best, .. } = &self.standing.position;
        let round = best.map_or(0, |(round, _)| round);
        let nothing = Round { round, wall_s: 0.0, rmse_kpa: [f64::NAN; 2], score_kpa: f64::NAN, branches: 0 };
        curve.iter().find(|r| r.round == round).copied().unwrap_or(nothing)
    }
}

/// A network that always answers zero: in the layout of corrections, the fallback.
fn silent(network: &Network) -> Network {
    let mut silent = network.clone();
    if let Some(last) = silent.layers.last_mut() {
        last.weights.fill(0.0);
        last.bias.fill(0.0);
    }
    silent
}
