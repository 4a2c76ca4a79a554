//! One turn: eight rigs take a step, eight updates follow. Episodes go on over checkpoints.
//!
//! An episode follows from its number and the actions taken in it, so a checkpoint in its midst holds these actions, and
//! going on takes them again: the rigs then stand where they stood.

use std::time::Instant;

use environment::draws::{Purpose, stream};
use environment::{SIDE_BY_SIDE, Step};
use model::observation::{ACTION_LEN, CHANNELS};
use rand::RngExt as _;
use rand_pcg::Pcg64Mcg;
use sac::Transition;

use super::{Phase, Run, TrainingCallback};
use crate::TrainingError;
use crate::average::EVERY_STEPS;
use crate::plan_fit::{self, whole_plans};

/// Numbers of the actions of one turn.
const TURN_ACTIONS: usize = SIDE_BY_SIDE * ACTION_LEN;

/// An episode under way.
pub(super) struct EpisodeUnderWay {
    /// Where the actions before learning begins come from.
    random: Pcg64Mcg,
    /// Every action taken, `[turns × 8 rigs × 12]`.
    pub(super) actions: Vec<f32>,
    /// Mean reward of each turn, summed.
    reward: f64,
    /// Mean squared error of each turn, summed, in kPa².
    squares: [f64; CHANNELS],
}

impl EpisodeUnderWay {
    /// Turns taken.
    fn turns(&self) -> usize {
        self.actions.len() / TURN_ACTIONS
    }

    fn take_in(&mut self, actions: &[f32], step: &Step) {
        self.actions.extend_from_slice(actions);
        self.reward += mean_reward(step);
        for (sum, s) in self.squares.iter_mut().zip(mean_squares(step)) {
            *sum += s;
        }
    }

    /// Mean reward so far.
    pub(super) fn mean_reward(&self) -> f64 {
        self.reward / self.turns().max(1) as f64
    }

    /// Root mean squared error so far, in kPa.
    pub(super) fn rmse_kpa(&self) -> [f64; CHANNELS] {
        self.squares.map(|s| (s / self.turns().max(1) as f64).sqrt())
    }
}

/// Stage of a run: what chooses the actions of a step, and what learns from it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    /// Actions at random, nothing learns.
    Random,
    /// The policy that the run started from acts, critics learn.
    WarmUp,
    /// Everything learns.
    Learning,
}

impl Run {
    /// Numbers of an answer of the actor.
    fn acting_len(&self) -> usize {
        plan_fit::acting_len(self.settings.policy.plan)
    }

    fn stage(&self, steps: u64) -> Stage {
        let run = &self.settings.run;
        match run.from {
            None if steps < run.random_steps => Stage::Random,
            Some(_) if steps < run.critic_warm_up_steps => Stage::WarmUp,
            _ => Stage::Learning,
        }
    }

    fn begin_episode(&mut self) -> Result<EpisodeUnderWay, TrainingError> {
        let number = self.position.episode;
        let began = Instant::now();
        self.env.begin(number)?;
        self.window.add_environment(began.elapsed());
        let random = stream(self.settings.run.seed, Purpose::Start, number, SIDE_BY_SIDE);
        Ok(EpisodeUnderWay { random, actions: Vec::new(), reward: 0.0, squares: [0.0; CHANNELS] })
    }

    /// Takes the actions of a checkpoint's episode again; answers whether it came to its end, or was asked to stop.
    pub(super) fn redo(&mut self, actions: &[f32], callback: &mut dyn TrainingCallback) -> Result<bool, TrainingError> {
        if actions.is_empty() {
            return Ok(true);
        }
        // The time that this takes was counted when it was taken first.
        let window = self.window.clone();
        let mut episode = self.begin_episode()?;
        let turns = actions.len() / TURN_ACTIONS;
        let first_step = self.position.steps - (turns * SIDE_BY_SIDE) as u64;
        for (turn, taken) in actions.chunks_exact(TURN_ACTIONS).enumerate() {
            if callback.stop() {
                return Ok(false);
            }
            if self.stage(first_step + (turn * SIDE_BY_SIDE) as u64) == Stage::Random {
                for _ in 0..SIDE_BY_SIDE * self.acting_len() {
                    let _: f32 = episode.random.random_range(-1.0f32..1.0);
                }
            }
            let step = self.env.step(taken);
            episode.take_in(taken, &step);
            self.tell(callback, Phase::GoingOn, Some(&episode));
        }
        self.window = window;
        self.end_if_over(episode);
        Ok(true)
    }

    /// One turn of eight steps and eight updates.
    pub(super) fn turn(&mut self, callback: &mut dyn TrainingCallback) -> Result<(), TrainingError> {
        let began = Instant::now();
        let mut episode = match self.episode.take() {
            Some(episode) => episode,
            None => self.begin_episode()?,
        };
        let stage = self.stage(self.position.steps);
        let before = self.env.observations().to_vec();
        let answers = self.actions(stage, &before, &mut episode)?;
        let actions = whole_plans(answers.clone(), self.settings.policy.plan);
        let simulating = Instant::now();
        let step = self.env.step(&actions);
        self.window.add_environment(simulating.elapsed());
        self.remember(&before, &answers, &step)?;
        self.position.steps += SIDE_BY_SIDE as u64;
        episode.take_in(&actions, &step);
        self.window.add_turn(mean_reward(&step), mean_squares(&step), step.terminal.iter().filter(|t| **t).count());
        self.learn(self.stage(self.position.steps))?;
        self.replay.keep_full(&self.learner)?;
        self.window.add_work(began.elapsed());
        self.pace.add_turn(began.elapsed());
        self.tell(callback, Phase::Learning, Some(&episode));
        self.end_if_over(episode);
        Ok(())
    }

    fn end_if_over(&mut self, episode: EpisodeUnderWay) {
        if self.env.is_truncated() {
            self.position.episode += 1;
        } else {
            self.episode = Some(episode);
        }
    }

    fn actions(
        &mut self,
        stage: Stage,
        observations: &[f32],
        episode: &mut EpisodeUnderWay,
    ) -> Result<Vec<f32>, TrainingError> {
        if stage == Stage::Random {
            let count = SIDE_BY_SIDE * self.acting_len();
            return Ok((0..count).map(|_| episode.random.random_range(-1.0f32..1.0)).collect());
        }
        let actions = self.learner.act(observations, true).map_err(|error| TrainingError::learner("act", &error))?;
        if actions.iter().all(|a| a.is_finite()) { Ok(actions) } else { Err(self.diverged("an action")) }
    }

    fn remember(&mut self, before: &[f32], answers: &[f32], step: &Step) -> Result<(), TrainingError> {
        let length = self.settings.contract().observation_len();
        let rows = before.chunks_exact(length).zip(self.env.next_observation().chunks_exact(length));
        for (lane, ((observation, next), action)) in rows.zip(answers.chunks_exact(self.acting_len())).enumerate() {
            let transition = Transition {
                observation,
                action,
                reward: step.rewards.get(lane).copied().unwrap_or(0.0),
                next_observation: next,
                terminal: step.terminal.get(lane).copied().unwrap_or(false),
            };
            self.learner.push(&transition).map_err(|error| TrainingError::learner("remember", &error))?;
        }
        Ok(())
    }

    fn learn(&mut self, stage: Stage) -> Result<(), TrainingError> {
        if stage == Stage::Random || self.learner.replay_len() < self.settings.sac.batch {
            return Ok(());
        }
        let steps = self.position.steps;
        self.learner
            .set_learning_rate(self.settings.learning_rate(steps))
            .map_err(|error| TrainingError::learner("sac.learning_rate", &error))?;
        let report = match stage {
            Stage::WarmUp => self.learner.update_critics(SIDE_BY_SIDE as u64),
            _ => self.learner.update(SIDE_BY_SIDE as u64),
        };
        if !report.finite {
            return Err(self.diverged("a loss or a weight"));
        }
        let over = self.settings.run.average_over_steps;
        if over > 0 && steps.is_multiple_of(EVERY_STEPS) {
            self.average.add(self.learner.policy(), over);
        }
        self.window.add_updates(&report);
        Ok(())
    }
}

fn mean_reward(step: &Step) -> f64 {
    step.rewards.iter().map(|r| f64::from(*r)).sum::<f64>() / SIDE_BY_SIDE as f64
}

fn mean_squares(step: &Step) -> [f64; CHANNELS] {
    std::array::from_fn(|c| step.error_kpa.iter().map(|e| e[c] * e[c]).sum::<f64>() / SIDE_BY_SIDE as f64)
}
