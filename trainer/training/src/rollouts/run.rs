//! A run of rollouts: rounds of flying and moving, which policy is kept, going on after a stop.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use environment::vector_env::Pumps;
use environment::{RigDraw, VectorEnv};
use model::observation::{ObservationLayout, Pair};
use model::rig::Rig;
use model::steady::SteadyMap;
use proto::emulator::load_for_loop;
use proto::rig_file::{self, RigFileError};
use sac::{Learner, Machine, Moments, Network};

use super::files::{self, Position, Standing};
use super::lessons::learn;
use super::outcome::Round;
use super::probe::{Episode, Probe};
use crate::checkpoint_selection::{SELECTION_SEED, rmse_kpa};
use crate::plan_fit;
use crate::policy_start::PolicyStart;
use crate::run::{RunStatus, evaluated_on, rigs_of};
use crate::run_files::RunFiles;
use crate::settings::{Plan, RolloutSettings, TrainingSettings};
use crate::trained_policy::{Origin, TrainedPolicy};
use crate::{Done, TrainingError};

/// Between two looks at whether to stop.
const LOOK: Duration = Duration::from_millis(20);
/// Learning rate of the last round beside the first's.
const LAST_RATE: f64 = 0.1;

/// Who watches a run.
pub trait RolloutCallback {
    /// An episode was flown.
    fn episode(&mut self);
    /// A round is over, or the beginning was scored.
    fn round(&mut self, round: &Round, of: u64);
    /// Tells whether the run is to stop: what the rounds before have left is kept.
    fn stop(&self) -> bool;
}

/// A run of rollouts.
pub struct RolloutRun {
    pub(super) settings: TrainingSettings,
    pub(super) rollouts: RolloutSettings,
    pub(super) files: RunFiles,
    trained_on: Rig,
    pub(super) model: Rig,
    pub(super) map: Arc<SteadyMap>,
    pub(super) origin: Origin,
    /// The policy that was given to begin with, as it was given.
    pub(super) given: Option<TrainedPolicy>,
    probes: Vec<Probe>,
    aside: VectorEnv,
    pub(super) standing: Standing,
}

impl RolloutRun {
    /// Begins a run from the policy at `from` in a new folder, or from corrections of nothing. A plan is left behind: at the end one
    /// is fitted.
    ///
    /// # Errors
    /// Settings, rigs, policy or folder that do not do; nothing is left half-written.
    pub fn begin(
        settings: TrainingSettings,
        from: Option<&Path>,
        folder: &Path,
        threads: usize,
    ) -> Result<Self, TrainingError> {
        let mut settings = settings;
        settings.policy.plan = Plan::Fitted;
        settings.rig.model.get_or_insert_with(|| settings.rig.trained_on.clone());
        let start = from.map(PolicyStart::load).transpose()?;
        if let Some(start) = &start {
            start.adopt_into(&mut settings)?;
        }
        settings.run.critics_from = None;
        settings.rollouts.get_or_insert_with(RolloutSettings::default);
        settings.check().map_err(|problem| TrainingError::Settings { file: "settings".into(), line: None, problem })?;
        let network = match &start {
            Some(start) => start.network(Plan::Fitted),
            None => fresh(&settings)?,
        };
        let network = Network { log_std: None, ..network };
        let standing =
            Standing { position: Position::default(), moments: Moments::of(&network), best: network.clone(), network };
        let (trained_on, model) = rigs_of(&settings)?;
        // Everything that can be refused is made before the folder is.
        let mut run = Self::assemble(settings, RunFiles::at(folder), trained_on, model, standing, threads)?;
        run.given = from.map(TrainedPolicy::load).transpose()?;
        RunFiles::create(folder)?;
        RunFiles::write(&run.files.settings(), run.settings.to_toml()?.as_bytes())?;
        rig_file::save(&run.files.rig(), &run.trained_on)?;
        rig_file::save(&run.files.model(), &run.model)?;
        if let Some(given) = &run.given {
            RunFiles::write(&run.files.start(), &given.to_bytes()?)?;
        }
        files::write(&run.files, &run.standing)?;
        Ok(run)
    }

    /// Goes on with a run; `rounds` plans another length.
    ///
    /// # Errors
    /// If the folder holds no run of rollouts, or its files are damaged; fewer rounds than it has done.
    pub fn resume(folder: &Path, rounds: Option<u64>, threads: usize) -> Result<Self, TrainingError> {
        let files = RunFiles::open(folder)?;
        let standing = files::read(&files.checkpoint())?;
        let mut settings = files.read_settings()?;
        let planned = settings.rollouts.get_or_insert_with(RolloutSettings::default);
        if let Some(rounds) = rounds {
            let done = standing.position.rounds;
            if rounds < done {
                let done = Done { count: done, what: "rounds are done" };
                return Err(TrainingError::ends_before(folder, done, "--rounds", rounds));
            }
            planned.rounds = rounds;
        }
        let load = |path: std::path::PathBuf| load_for_loop(&path.display().to_string(), None);
        let (trained_on, model) = (load(files.rig())?, load(files.model())?);
        let given = files.start().exists().then(|| TrainedPolicy::load(&files.start())).transpose()?;
        let mut run = Self::assemble(settings, files, trained_on, model, standing, threads)?;
        run.given = given;
        RunFiles::write(&run.files.settings(), run.settings.to_toml()?.as_bytes())?;
        Ok(run)
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
        // They are flown at the end, and refused before anything is.
        evaluated_on(&settings)?;
        let origin = Origin::of(&trained_on)?;
        let map = SteadyMap::new(&model)
            .map_err(|problem| RigFileError::Rig { file: settings.rig.model().to_owned(), problem })?;
        let env = |episode_s: f64, seed| {
            let environment = environment::EnvironmentSettings { episode_s, ..settings.environment.clone() };
            let draw = RigDraw::new(&trained_on, &environment)?;
            let predicts = settings.policy.variant.predicts();
            let pumps = Pumps::Averaged { step_ms: rollouts.averaged_step_ms };
            VectorEnv::with_pumps(draw, (&model, pumps), settings.contract(), predicts, &environment, seed)
        };
        let seed = settings.run.seed;
        let warm_up_s = settings.environment.warm_up_s;
        let flown = env(warm_up_s + rollouts.episode_s, seed)?;
        let aside = env(settings.environment.episode_s, SELECTION_SEED)?;
        let threads = threads.clamp(1, usize::try_from(rollouts.episodes).unwrap_or(1));
        let probes = (0..threads).map(|_| Probe::new(&flown, &rollouts, seed)).collect();
        Ok(RolloutRun {
            given: None,
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

    /// Tells whether the policy that it begins with has been scored: before that there are no figures.
    pub fn has_begun(&self) -> bool {
        !self.standing.position.curve.is_empty()
    }

    /// Episodes of a round.
    pub fn episodes(&self) -> u64 {
        self.rollouts.episodes
    }

    /// Flies and moves until all rounds are done or the callback wants to stop. A stop loses the round under way; [`Self::leave`] writes
    /// what the rounds before have left.
    ///
    /// # Errors
    /// A weight that is not finite, or a file that cannot be written; the last checkpoint is kept.
    pub fn go(&mut self, callback: &mut dyn RolloutCallback) -> Result<RunStatus, TrainingError> {
        let mut counted_from = Instant::now();
        if !self.has_begun() && !self.choose_start(callback)? {
            return Ok(RunStatus::Stopped);
        }
        self.tell(callback);
        while self.standing.position.rounds < self.rollouts.rounds {
            let Some(round) = self.fly_round(callback)? else { break };
            let position = &self.standing.position;
            let done = position.rounds as f64 / self.rollouts.rounds.max(2).saturating_sub(1) as f64;
            let rate = self.rollouts.learning_rate * (1.0 - (1.0 - LAST_RATE) * done.min(1.0));
            let key = [self.settings.run.seed, position.rounds];
            let before = self.standing.clone();
            let Standing { network, moments, .. } = &mut self.standing;
            (*network, *moments) = learn(network, moments, &round, &self.rollouts, key, rate as f32)
                .map_err(|error| TrainingError::learner("policy", &sac::LearnerError::from(error)))?;
            self.check_finite()?;
            self.standing.position.rounds += 1;
            let branches = round.iter().map(|episode| episode.branches.len() as u64).sum();
            let Some(rmse_kpa) = self.aside_kpa(&self.standing.network.clone(), callback)? else {
                self.standing = before;
                break;
            };
            self.keep(rmse_kpa, branches, counted_from)?;
            self.tell(callback);
            counted_from = Instant::now();
        }
        let is_over = self.standing.position.rounds >= self.rollouts.rounds;
        Ok(if is_over { RunStatus::Finished } else { RunStatus::Stopped })
    }

    fn tell(&self, callback: &mut dyn RolloutCallback) {
        if let Some(round) = self.standing.position.curve.last() {
            callback.round(round, self.rollouts.rounds);
        }
    }

    /// Begins with corrections of nothing where these track better than the policy that was given, and keeps where it begins; answers
    /// false where a stop is asked for.
    fn choose_start(&mut self, callback: &dyn RolloutCallback) -> Result<bool, TrainingError> {
        let began = Instant::now();
        let given = self.standing.network.clone();
        let Some(mut start_kpa) = self.aside_kpa(&given, callback)? else { return Ok(false) };
        if self.settings.contract() == ObservationLayout::Correction {
            let nothing = silent(&given);
            let Some(fallback_kpa) = self.aside_kpa(&nothing, callback)? else { return Ok(false) };
            self.standing.position.fallback_kpa = Some(fallback_kpa);
            if score_kpa(fallback_kpa) < score_kpa(start_kpa) {
                self.standing.network = nothing;
                start_kpa = fallback_kpa;
            }
        }
        self.keep(start_kpa, 0, began)?;
        Ok(true)
    }

    /// RMSE on the rigs set aside, positive and negative, in kPa; nothing where a stop is asked for.
    fn aside_kpa(&mut self, network: &Network, callback: &dyn RolloutCallback) -> Result<Option<Pair>, TrainingError> {
        rmse_kpa(&mut self.aside, &plan_fit::held(network), &mut || callback.stop())
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

    /// Keeps the policy as it stands where it is the best, and writes a checkpoint.
    fn keep(&mut self, rmse_kpa: Pair, branches: u64, since: Instant) -> Result<(), TrainingError> {
        let score_kpa = score_kpa(rmse_kpa);
        let position = &mut self.standing.position;
        position.wall_s += since.elapsed().as_secs_f64();
        let round = Round { round: position.rounds, wall_s: position.wall_s, rmse_kpa, score_kpa, branches };
        position.curve.push(round);
        if round.round == 0 || score_kpa < position.kept.score_kpa {
            position.kept = round;
            self.standing.best = self.standing.network.clone();
        }
        files::write(&self.files, &self.standing)
    }

    fn check_finite(&self) -> Result<(), TrainingError> {
        self.standing.network.check().map_err(|_| TrainingError::Diverged {
            step: self.standing.position.rounds,
            what: "a weight".into(),
            kept: format!("{} is kept; lower rollouts.learning_rate and begin anew", self.files.checkpoint().display()),
        })
    }
}

/// Score of both channels: their geometric mean.
fn score_kpa([pos, neg]: Pair) -> f64 {
    (pos * neg).sqrt()
}

/// A network of fresh weights that answers next to nothing.
fn fresh(settings: &TrainingSettings) -> Result<Network, TrainingError> {
    if settings.contract() != ObservationLayout::Correction {
        let problem = "learns duties, which cannot begin from the fallback; give --from POLICY, or --config adaptation";
        return Err(TrainingError::Settings { file: "policy.contract".into(), line: None, problem: problem.into() });
    }
    let learner =
        Learner::new(settings.shape(), settings.feature_map()?, settings.learner_settings(), Machine::with_threads(1))
            .map_err(|error| TrainingError::learner("settings", &error))?;
    Ok(learner.policy())
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
