//! A run: transitions come in, so many updates follow each, policies go out.

use std::path::Path;
use std::time::{Duration, Instant};

use sac::{Learner, Machine};
use training::average::{Average, EVERY_STEPS};
use training::replay_files::ReplayFiles;
use training::{Done, PolicyStart, RunFiles, TrainingError, TrainingSettings};

use crate::FinetuneError;
use crate::callback::{FinetuneCallback, Progress, Source, Status, Summary};
use crate::checkpoint::{self, Position, Restored};
use crate::recent_error::RecentError;
use crate::settings::FinetuneSettings;
use crate::transitions::{Transition, Transitions};

/// Between two looks at a recording that grows: it is flushed once a second.
pub(crate) const LOOK: Duration = Duration::from_millis(200);
/// Between two checkpoints; a crash loses no more work than this.
const CHECKPOINT: Duration = Duration::from_secs(60);
/// Ticks that wait, and time since none did, from which learning is behind the rig: 10 s of it, for more than a minute.
const BEHIND_TICKS: usize = 500;
const BEHIND: Duration = Duration::from_secs(60);
/// In a run's folder: its settings.
const SETTINGS: &str = "finetune.toml";

/// A run of fine-tuning.
pub struct FinetuneRun {
    pub(crate) settings: FinetuneSettings,
    pub(crate) training: TrainingSettings,
    pub(crate) files: RunFiles,
    pub(crate) transitions: Transitions,
    pub(crate) learner: Learner,
    pub(crate) average: Average,
    replay: ReplayFiles,
    pub(crate) position: Position,
    /// Not in the checkpoint: whoever goes on passes over the same transitions again.
    recent: RecentError,
    sitting: Sitting,
}

/// Times of this sitting.
struct Sitting {
    counted_until: Instant,
    kept: Instant,
    caught_up: Instant,
    told_behind: Option<Instant>,
    updates: u64,
    updating: Duration,
}

impl Sitting {
    fn begin() -> Self {
        let now = Instant::now();
        Sitting {
            counted_until: now,
            kept: now,
            caught_up: now,
            told_behind: None,
            updates: 0,
            updating: Duration::ZERO,
        }
    }

    fn updates_per_s(&self) -> f64 {
        self.updates as f64 / self.updating.as_secs_f64().max(1e-3)
    }
}

impl FinetuneRun {
    /// Begins a run in a new folder.
    ///
    /// # Errors
    /// A policy that training cannot go on from, or a folder that holds a run.
    pub fn begin(
        settings: FinetuneSettings,
        start: &PolicyStart,
        folder: &Path,
        threads: usize,
    ) -> Result<Self, FinetuneError> {
        let mut training = start.settings()?;
        training.run.seed = settings.seed;
        training.run.steps = settings.steps;
        start.adopt_into(&mut training)?;
        training.check().map_err(|problem| TrainingError::Settings { file: "settings".into(), line: None, problem })?;
        let mut learner = Learner::new(
            training.shape(),
            training.feature_map()?,
            training.learner_settings(),
            Machine::with_threads(threads),
        )
        .map_err(|error| TrainingError::learner("settings", &error))?;
        start.warm_start(&mut learner, &training, threads)?;
        start.remember(&mut learner, &training, settings.remembered)?;
        let files = RunFiles::create(folder)?;
        RunFiles::write(&files.settings(), training.to_toml()?.as_bytes())?;
        write_settings(&files, &settings)?;
        let replay = ReplayFiles::new(files.replay(), training.sac.replay, 0);
        let start = Restored { position: Position::default(), average: Average::default(), learner, replay };
        Ok(Self::assemble(settings, training, files, start))
    }

    /// Goes on with a run; `steps` plans another length.
    ///
    /// # Errors
    /// A folder that holds no run of fine-tuning, or whose files are damaged; fewer steps than it has done.
    pub fn resume(folder: &Path, steps: Option<u64>, threads: usize) -> Result<Self, FinetuneError> {
        let files = RunFiles::open(folder)?;
        let mut training = files.read_settings()?;
        let path = folder.join(SETTINGS);
        let text = std::fs::read_to_string(&path).map_err(|error| {
            TrainingError::file(&path, &format!("cannot be read: {error}; --resume takes the folder of a fine-tuning"))
        })?;
        let mut settings: FinetuneSettings =
            toml::from_str(&text).map_err(|error| TrainingError::file(&path, error.message()))?;
        let restored = checkpoint::read(&files, &training, threads)?;
        if let Some(steps) = steps {
            let done = restored.position.steps;
            if steps < done {
                let done = Done { count: done, what: "ticks have been learned from" };
                return Err(TrainingError::ends_before(folder, done, "--steps", steps).into());
            }
            settings.steps = steps;
            training.run.steps = steps;
            RunFiles::write(&files.settings(), training.to_toml()?.as_bytes())?;
            write_settings(&files, &settings)?;
        }
        Ok(Self::assemble(settings, training, files, restored))
    }

    fn assemble(settings: FinetuneSettings, training: TrainingSettings, files: RunFiles, from: Restored) -> Self {
        let Restored { position, average, learner, replay } = from;
        FinetuneRun {
            transitions: Transitions::new(&settings.recordings, &training),
            settings,
            training,
            files,
            learner,
            average,
            replay,
            position,
            recent: RecentError::default(),
            sitting: Sitting::begin(),
        }
    }

    /// The run's settings.
    pub fn settings(&self) -> &FinetuneSettings {
        &self.settings
    }

    /// The run's folder.
    pub fn files(&self) -> &RunFiles {
        &self.files
    }

    /// Learns until all steps are done, the recordings are used up, or the callback wants to stop.
    ///
    /// # Errors
    /// Recordings that cannot be read or hold nothing to learn from, a loss that is not finite, a full disk.
    pub fn go(&mut self, source: Source, callback: &mut dyn FinetuneCallback) -> Result<Status, FinetuneError> {
        self.sitting = Sitting::begin();
        let status = self.work(source, callback)?;
        self.keep()?;
        let is_empty = self.position.steps == 0 && status == Status::UsedUp;
        // Whoever stops the run a second time once it is kept finds a summary all the same.
        if !is_empty {
            self.sum_up()?;
        }
        callback.is_kept();
        if is_empty {
            return Err(self.nothing_to_learn());
        }
        let ended = match status {
            Status::Stopped => status,
            _ if self.position.published_at != self.position.steps && !self.publish(callback)? => Status::Stopped,
            _ => status,
        };
        self.sum_up()?;
        Ok(ended)
    }

    /// Writes the summary.
    fn sum_up(&self) -> Result<(), FinetuneError> {
        let path = self.files.summary();
        let text = serde_json::to_string_pretty(&self.summary())
            .map_err(|error| TrainingError::file(&path, &error.to_string()))?;
        Ok(RunFiles::write(&path, format!("{text}\n").as_bytes())?)
    }

    fn work(&mut self, source: Source, callback: &mut dyn FinetuneCallback) -> Result<Status, FinetuneError> {
        let (mut passed_over, mut is_given_up) = (0, false);
        loop {
            if callback.stop() {
                return Ok(Status::Stopped);
            }
            let is_caught_up = passed_over == self.position.steps;
            if is_caught_up && self.is_to_be_published() && !self.publish(callback)? {
                return Ok(Status::Stopped);
            }
            if is_caught_up && self.position.steps >= self.settings.steps {
                return Ok(Status::Finished);
            }
            let transition = self.transitions.next_transition()?;
            self.transitions.take_notes().iter().for_each(|note| callback.say(note));
            match transition {
                Some(transition) if !is_caught_up => {
                    self.recent.push(&transition);
                    passed_over += 1;
                    self.tell(callback, "going on");
                }
                Some(transition) => {
                    self.learn(&transition)?;
                    passed_over += 1;
                    self.tell(callback, "learning");
                    self.tell_behind(source, callback);
                }
                None if source == Source::Daemon => {
                    self.sitting.caught_up = Instant::now();
                    self.tell(callback, "waiting for the rig");
                    std::thread::sleep(LOOK);
                }
                None if is_given_up => return Ok(Status::UsedUp),
                None => {
                    self.transitions.give_up()?;
                    is_given_up = true;
                }
            }
            if self.sitting.kept.elapsed() >= CHECKPOINT {
                self.keep()?;
            }
        }
    }

    /// Takes in a transition, and makes its updates.
    fn learn(&mut self, transition: &Transition) -> Result<(), FinetuneError> {
        let pushed = self.learner.push(&sac::Transition {
            observation: &transition.observation,
            action: &transition.action,
            reward: transition.reward,
            next_observation: &transition.next_observation,
            terminal: transition.terminal,
        });
        pushed.map_err(|error| TrainingError::learner("remember", &error))?;
        self.replay.keep_full(&self.learner)?;
        self.position.steps += 1;
        self.recent.push(transition);
        if self.learner.replay_len() < self.training.sac.batch {
            return Ok(());
        }
        let steps = self.position.steps;
        let rate = self.training.learning_rate(steps);
        self.learner.set_learning_rate(rate).map_err(|error| TrainingError::learner("sac.learning_rate", &error))?;
        self.learner
            .set_lambda_temporal(self.lambda_now())
            .map_err(|error| TrainingError::learner("lambda_temporal", &error))?;
        let (times, began) = (self.settings.updates_per_tick, Instant::now());
        let report = match steps <= self.settings.critic_warm_up_steps {
            true => self.learner.update_critics(times),
            false => self.learner.update(times),
        };
        self.sitting.updating += began.elapsed();
        self.sitting.updates += times;
        self.position.updates += times;
        if !report.finite {
            let kept = format!("{} is kept as it was", self.files.checkpoint().display());
            let what = "a loss or a weight".to_owned();
            return Err(TrainingError::Diverged { step: steps, what, kept }.into());
        }
        let over = self.training.run.average_over_steps;
        if over > 0 && steps.is_multiple_of(EVERY_STEPS) {
            self.average.add(self.learner.policy(), over);
        }
        Ok(())
    }

    /// Writes a checkpoint.
    pub(crate) fn keep(&mut self) -> Result<(), FinetuneError> {
        self.position.wall_s += self.sitting.counted_until.elapsed().as_secs_f64();
        self.sitting.counted_until = Instant::now();
        checkpoint::write(&self.files, &mut self.replay, &self.position, &self.average, &self.learner)?;
        self.sitting.kept = Instant::now();
        Ok(())
    }

    pub(crate) fn tell(&self, callback: &mut dyn FinetuneCallback, doing: &'static str) {
        callback.progress(&Progress {
            steps: self.position.steps,
            steps_planned: self.settings.steps,
            updates_per_s: self.sitting.updates_per_s(),
            rmse_kpa: self.rmse_kpa(),
            doing,
        });
    }

    /// Says once a minute that learning does not keep up with the rig.
    fn tell_behind(&mut self, source: Source, callback: &mut dyn FinetuneCallback) {
        let waiting = self.transitions.waiting();
        let sitting = &mut self.sitting;
        let is_behind = source == Source::Daemon && waiting >= BEHIND_TICKS && sitting.caught_up.elapsed() >= BEHIND;
        if !is_behind || sitting.told_behind.is_some_and(|told| told.elapsed() < BEHIND) {
            return;
        }
        sitting.told_behind = Some(Instant::now());
        let (asked, made) = (50 * self.settings.updates_per_tick, sitting.updates_per_s());
        let behind_s = waiting as f64 / 50.0;
        if made >= asked as f64 {
            callback.say(&format!(
                "behind the rig by {behind_s:.0} s or more, which is quicker than real time: what it has recorded is learned from all the same"
            ));
        } else {
            callback.say(&format!(
                "behind the rig by {behind_s:.0} s or more: {made:.0} updates a second of the {asked} that it takes to keep up; begin anew with fewer --updates-per-tick, or give it more cores"
            ));
        }
    }

    fn nothing_to_learn(&self) -> FinetuneError {
        let tally = self.transitions.tally();
        let told: Vec<String> = tally.left_out.iter().map(|(reason, count)| format!("{count} {reason}")).collect();
        FinetuneError::NothingToLearn {
            folder: self.settings.recordings.display().to_string(),
            ticks: tally.ticks,
            reasons: if told.is_empty() { String::new() } else { format!(": {}", told.join(", ")) },
        }
    }

    /// The error that is shown; nothing while a run that is gone on with has not come to where it stands.
    fn rmse_kpa(&self) -> Option<[f64; 2]> {
        if self.recent.taken() == self.position.steps { self.recent.rmse_kpa() } else { None }
    }

    /// λ_T as far as the run has come.
    pub(crate) fn lambda_now(&self) -> f32 {
        self.settings.lambda_at(self.training.policy.variant, self.position.steps)
    }

    /// Figures of the run so far.
    pub fn summary(&self) -> Summary {
        let rmse_kpa = self.rmse_kpa();
        Summary {
            steps: self.position.steps,
            steps_planned: self.settings.steps,
            updates: self.position.updates,
            lambda_temporal: f64::from(self.lambda_now()),
            published: self.position.published,
            last_published: self.position.last_published.clone(),
            rmse_kpa,
            rmse_over_s: rmse_kpa.map_or(0.0, |_| self.recent.over_s()),
            wall_s: self.position.wall_s,
            tally: self.transitions.tally().clone(),
            joined: self.transitions.joined(),
        }
    }
}

fn write_settings(files: &RunFiles, settings: &FinetuneSettings) -> Result<(), FinetuneError> {
    let path = files.folder().join(SETTINGS);
    let text = toml::to_string(settings).map_err(|error| TrainingError::file(&path, &error.to_string()))?;
    Ok(RunFiles::write(&path, text.as_bytes())?)
}
