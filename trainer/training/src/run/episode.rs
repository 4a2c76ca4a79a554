//! One episode: eight rigs take a step, eight updates follow.

use std::time::Instant;

use environment::SIDE_BY_SIDE;
use environment::draws::{Purpose, stream};
use model::observation::{ACTION_LEN, CHANNELS};
use rand::RngExt as _;
use sac::Transition;

use super::{Progress, Run, TrainingCallback};
use crate::TrainingError;
use crate::average::EVERY_STEPS;

impl Run {
    /// One episode, or what is left of the run.
    pub(super) fn episode(&mut self, observer: &mut dyn TrainingCallback) -> Result<(), TrainingError> {
        let number = self.position.episode;
        let began = Instant::now();
        self.env.begin(number)?;
        let mut environment_s = began.elapsed().as_secs_f64();
        self.window.began.get_or_insert(began);
        self.position.steps_before = self.position.steps;
        let mut random = stream(self.settings.run.seed, Purpose::Start, number, SIDE_BY_SIDE);
        let length = self.settings.contract().observation_len();
        let mut actions = vec![0.0f32; SIDE_BY_SIDE * ACTION_LEN];
        let mut before = vec![0.0f32; SIDE_BY_SIDE * length];
        let (mut reward, mut squares, mut turns) = (0.0, [0.0; CHANNELS], 0.0);
        while !self.env.is_truncated() && self.position.steps < self.settings.run.steps {
            before.copy_from_slice(self.env.observations());
            if self.position.steps < self.settings.run.random_steps {
                actions.fill_with(|| random.random_range(-1.0f32..1.0));
            } else {
                actions = self.learner.act(&before, true).map_err(|error| TrainingError::learner("act", &error))?;
                if !actions.iter().all(|a| a.is_finite()) {
                    return Err(self.diverged("an action"));
                }
            }
            let simulating = Instant::now();
            let step = self.env.step(&actions);
            environment_s += simulating.elapsed().as_secs_f64();
            let rows = before.chunks_exact(length).zip(self.env.next_observation().chunks_exact(length));
            for (lane, ((observation, next), action)) in rows.zip(actions.chunks_exact(ACTION_LEN)).enumerate() {
                let transition = Transition {
                    observation,
                    action,
                    reward: step.rewards.get(lane).copied().unwrap_or(0.0),
                    next_observation: next,
                    terminal: step.terminal.get(lane).copied().unwrap_or(false),
                };
                self.learner.push(&transition).map_err(|error| TrainingError::learner("remember", &error))?;
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
                self.window.add_updates(&report);
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
        self.window.add_steps(self.position.steps - self.position.steps_before, environment_s, reward, squares);
        self.position.episode += 1;
        Ok(())
    }
}
