//! Settings of a learner: sizes and Table IV of the paper.

use std::ops::Range;

use crate::kernel::LANES;

/// Sizes of the problem.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Shape {
    /// Entries of a raw observation.
    pub observations: usize,
    /// Those of them that are goals; CAPS' temporal term (9) holds them, its spatial term (10) leaves them alone.
    pub goal: Range<usize>,
    /// Entries of an action, each in (-1, 1).
    pub actions: usize,
}

/// The temperature α, the weight of entropy against reward.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TemperatureRule {
    /// Learned so that the entropy meets its target, from this value on.
    Learned(f32),
    /// Held.
    Fixed(f32),
}

/// Everything that shapes the learning.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Widths of the hidden layers of actor and critics; multiples of 32.
    pub hidden: Vec<usize>,
    /// Transitions in a batch; a multiple of 32.
    pub batch: usize,
    /// Adam's η for actor, critics and temperature.
    pub learning_rate: f32,
    /// γ, 0 to 1.
    pub discount: f32,
    /// τ, the part of the way that the slow critics go at each update, 0 to 1.
    pub soft_update: f32,
    /// λ_T of (9); 0 skips the pass.
    pub lambda_temporal: f32,
    /// λ_S of (10); 0 skips the pass.
    pub lambda_spatial: f32,
    /// σ of (10) for each entry of the raw observation, in its unit; 0 on goals.
    pub spatial_sigma: Vec<f32>,
    /// Target of the entropy, nats; the paper's is minus the number of actions.
    pub target_entropy: f32,
    /// The temperature.
    pub temperature: TemperatureRule,
    /// Smallest and largest logarithm of the actor's standard deviation (before tanh).
    pub log_std: [f32; 2],
    /// Transitions remembered; older ones are overwritten.
    pub replay_capacity: usize,
    /// Seed of weights, batches and noise.
    pub seed: u64,
    /// Factor on the initial weights of the actor's last layer; 0.01 starts a correction near zero.
    pub last_layer_scale: f32,
    /// Initial logarithm of the actor's standard deviation.
    pub initial_log_std: f32,
}

impl Settings {
    /// Table IV of the paper: both CAPS terms, σ = 1.5 kPa on every entry that is no goal.
    pub fn paper(shape: &Shape) -> Self {
        let sigma = |entry: usize| if shape.goal.contains(&entry) { 0.0 } else { 1.5 };
        Self {
            hidden: vec![256, 256],
            batch: 128,
            learning_rate: 3e-4,
            discount: 0.9,
            soft_update: 0.005,
            lambda_temporal: 1.0,
            lambda_spatial: 0.4,
            spatial_sigma: (0..shape.observations).map(sigma).collect(),
            target_entropy: -(shape.actions as f32),
            temperature: TemperatureRule::Learned(1.0),
            log_std: [-20.0, 2.0],
            replay_capacity: 500_000,
            seed: 0,
            last_layer_scale: 1.0,
            initial_log_std: 0.0,
        }
    }

    /// Refuses what the learner cannot run.
    ///
    /// # Errors
    /// Names the first setting that is out of its range.
    pub fn check(&self, shape: &Shape) -> Result<(), SettingsError> {
        let fault = |key: &'static str, rule: &'static str| Err(SettingsError { key, rule });
        if shape.observations == 0 || shape.actions == 0 || shape.observations > 4096 || shape.actions > 256 {
            return fault("shape", "needs 1 to 4096 observations and 1 to 256 actions");
        }
        if shape.goal.start > shape.goal.end || shape.goal.end > shape.observations {
            return fault("shape.goal", "must lie within the observation");
        }
        if self.hidden.is_empty() || self.hidden.iter().any(|w| *w == 0 || w % LANES != 0 || *w > 4096) {
            return fault("hidden", "needs at least one width, all multiples of 32 up to 4096");
        }
        if self.batch == 0 || !self.batch.is_multiple_of(LANES) || self.batch > 1 << 16 {
            return fault("batch", "must be a multiple of 32 up to 65536");
        }
        if self.replay_capacity < self.batch || u32::try_from(self.replay_capacity).is_err() {
            return fault("replay_capacity", "must be at least the batch and fit 32 bits");
        }
        if self.spatial_sigma.len() != shape.observations {
            return fault("spatial_sigma", "needs one value for each entry of the observation");
        }
        let not_negative = |x: f32| x.is_finite() && x >= 0.0;
        let positive = |x: f32| x.is_finite() && x > 0.0;
        let (TemperatureRule::Learned(temperature) | TemperatureRule::Fixed(temperature)) = self.temperature;
        let temperature_fits = match self.temperature {
            TemperatureRule::Learned(x) => positive(x),
            TemperatureRule::Fixed(_) => not_negative(temperature),
        };
        for (fits, key, rule) in [
            (self.spatial_sigma.iter().all(|&x| not_negative(x)), "spatial_sigma", "must be finite and not negative"),
            (positive(self.learning_rate), "learning_rate", "must be finite and positive"),
            ((0.0..=1.0).contains(&self.discount), "discount", "must be within 0 and 1"),
            ((0.0..=1.0).contains(&self.soft_update), "soft_update", "must be within 0 and 1"),
            (not_negative(self.lambda_temporal), "lambda_temporal", "must be finite and not negative"),
            (not_negative(self.lambda_spatial), "lambda_spatial", "must be finite and not negative"),
            (self.target_entropy.is_finite(), "target_entropy", "must be finite"),
            (temperature_fits, "temperature", "must be finite and positive (0 only where it is fixed)"),
            (self.log_std.iter().all(|x| x.abs() <= 40.0), "log_std", "bounds must lie within -40 and 40"),
            (self.log_std[0] <= self.log_std[1], "log_std", "the lower bound must not exceed the upper"),
            (not_negative(self.last_layer_scale), "last_layer_scale", "must be finite and not negative"),
            (self.initial_log_std.is_finite(), "initial_log_std", "must be finite"),
        ] {
            if !fits {
                return fault(key, rule);
            }
        }
        Ok(())
    }
}

/// A setting out of its range.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("learner setting '{key}' {rule}")]
pub struct SettingsError {
    /// Which one.
    pub key: &'static str,
    /// Rule that it breaks.
    pub rule: &'static str,
}
