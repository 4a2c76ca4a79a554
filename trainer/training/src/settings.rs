//! A training run as data: what is trained on what, by what, for how long.
//!
//! One TOML file; every key has a default, which is the paper's (Table IV) where the paper has one. Presets are
//! such files built in.

mod learner;
mod policy;
mod rollouts;

use environment::{EnvironmentSettings, SIDE_BY_SIDE};
use model::observation::{GOAL_LEN, OBSERVATION_LEN, ObservationLayout, STATE_LEN};
use serde::{Deserialize, Serialize};

pub use learner::{CapsSettings, SacSettings};
pub use policy::{Features, Plan, PolicySettings, Variant};
pub use rollouts::RolloutSettings;

use crate::{TrainingError, features, plan_fit};

/// A training run.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrainingSettings {
    /// Length, seed and what is written when.
    pub run: RunSettings,
    /// Rigs, by name or file.
    pub rig: RigSettings,
    /// Contract of the policy.
    pub policy: PolicySettings,
    /// Soft Actor-Critic.
    pub sac: SacSettings,
    /// Conditioning for action policy smoothness.
    pub caps: CapsSettings,
    /// The environment.
    pub environment: EnvironmentSettings,
    /// Settings by which a policy is improved by rollouts (`trainer improve`); left out, the defaults.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rollouts: Option<RolloutSettings>,
}

/// Length, seed and what is written when.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RunSettings {
    /// Environment steps; each is followed by one update.
    pub steps: u64,
    /// Seed of everything.
    pub seed: u64,
    /// Steps with random actions before learning begins.
    pub random_steps: u64,
    /// Policy that the run started from; left out, it started from nothing. Command lines set it (`--from`).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<String>,
    /// Checkpoint whose critics and temperature the run begins with: that of the run that `from` is the folder of. Without
    /// one they begin fresh.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub critics_from: Option<String>,
    /// Steps in which the policy that a run starts from acts and stays as it is while the critics learn what it is worth;
    /// there are no steps with random actions then.
    pub critic_warm_up_steps: u64,
    /// Steps between evaluations, which are also the points of the learning curve.
    pub evaluate_every_steps: u64,
    /// Steps between checkpoints.
    pub checkpoint_every_steps: u64,
    /// Steps over which the actor's weights are averaged (exponentially) for what is evaluated and exported; 0, the
    /// paper's, takes the last. Averaging takes out the wander of single updates (Polyak and Juditsky, 1992).
    pub average_over_steps: u64,
    /// True where the policy is kept that tracked best on drawn rigs set aside for that, instead of the last (the paper's).
    pub keep_best: bool,
}

impl Default for RunSettings {
    fn default() -> Self {
        RunSettings {
            steps: 512_000,
            seed: 1,
            random_steps: 4_000,
            from: None,
            critics_from: None,
            critic_warm_up_steps: 4_000,
            evaluate_every_steps: 32_000,
            checkpoint_every_steps: 128_000,
            average_over_steps: 0,
            keep_best: false,
        }
    }
}

/// Rigs, by name or file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RigSettings {
    /// Rig that is flown in training, or drawn around.
    pub trained_on: String,
    /// The model behind MPObs and the fallback's feed-forward; left out, it is the rig that is trained on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model: Option<String>,
    /// Rigs that are flown in evaluations.
    pub evaluated_on: Vec<String>,
}

impl RigSettings {
    /// The model, by name or file.
    pub fn model(&self) -> &str {
        self.model.as_deref().unwrap_or(&self.trained_on)
    }
}

impl Default for RigSettings {
    fn default() -> Self {
        RigSettings {
            trained_on: "dual_pressure".into(),
            model: None,
            evaluated_on: vec!["dual_pressure".into(), "bench".into()],
        }
    }
}

/// Steps from the policy's first change to the first evaluation after it (chosen: a tenth of a minute's run).
pub const FIRST_INTERVAL_STEPS: u64 = 4_000;

/// Built-in presets: name and text.
pub const PRESETS: [(&str, &str); 4] = [
    ("paper", include_str!("../presets/paper.toml")),
    ("paper-drawn", include_str!("../presets/paper-drawn.toml")),
    ("correction", include_str!("../presets/correction.toml")),
    ("adaptation", include_str!("../presets/adaptation.toml")),
];

impl TrainingSettings {
    /// A built-in preset.
    ///
    /// # Errors
    /// Names the presets that there are.
    pub fn preset(name: &str) -> Result<Self, TrainingError> {
        let (_, text) = PRESETS.iter().find(|(known, _)| *known == name).ok_or_else(|| {
            let known: Vec<&str> = PRESETS.iter().map(|(name, _)| *name).collect();
            TrainingError::Preset { name: name.to_owned(), known: known.join(", ") }
        })?;
        Self::parse(name, text)
    }

    /// Reads a TOML text; `file` names it in errors.
    ///
    /// # Errors
    /// The line, the key and the mend, on one line.
    pub fn parse(file: &str, text: &str) -> Result<Self, TrainingError> {
        let settings: TrainingSettings = toml::from_str(text).map_err(|error| {
            let line = error.span().map_or(1, |span| 1 + text.bytes().take(span.start).filter(|b| *b == b'\n').count());
            let problem = error.message().lines().map(str::trim).collect::<Vec<_>>().join(" ");
            TrainingError::Settings { file: file.to_owned(), line: Some(line), problem }
        })?;
        settings.check().map_err(|problem| TrainingError::Settings { file: file.to_owned(), line: None, problem })?;
        Ok(settings)
    }

    /// The effective settings, as a file.
    ///
    /// # Errors
    /// If they cannot be written as TOML, which no settings that came from TOML do.
    pub fn to_toml(&self) -> Result<String, TrainingError> {
        toml::to_string(self).map_err(|error| TrainingError::Settings {
            file: "settings".into(),
            line: None,
            problem: error.to_string(),
        })
    }

    /// The observation contract.
    pub fn contract(&self) -> ObservationLayout {
        ObservationLayout::of_version(self.policy.contract).unwrap_or(ObservationLayout::Paper)
    }

    /// Sizes of the learning problem.
    pub fn shape(&self) -> sac::Shape {
        let observations = self.contract().observation_len();
        sac::Shape {
            observations,
            goal: STATE_LEN..STATE_LEN + GOAL_LEN,
            actions: plan_fit::acting_len(self.policy.plan),
        }
    }

    /// Map by which observations are put to the network.
    ///
    /// # Errors
    /// Never for the two maps that there are.
    pub fn feature_map(&self) -> Result<sac::FeatureMap, TrainingError> {
        let feature = |t: features::Term| sac::Feature {
            plus: t.plus,
            minus: t.minus,
            offset: t.offset as f32,
            scale: t.scale as f32,
        };
        let features = features::terms(&self.policy).into_iter().map(feature).collect();
        sac::FeatureMap::new(self.contract().observation_len(), features)
            .map_err(|error| TrainingError::learner("features", &error))
    }

    /// The learning rate after so many steps.
    pub fn learning_rate(&self, steps: u64) -> f32 {
        let done = (steps as f64 / self.sac.annealed_over_steps.max(1) as f64).min(1.0);
        (self.sac.learning_rate * (1.0 - (1.0 - self.sac.annealed_to) * done)) as f32
    }

    /// Steps before the policy changes for the first time.
    fn first_change(&self) -> u64 {
        if self.run.from.is_some() { self.run.critic_warm_up_steps } else { self.run.random_steps }
    }

    /// Tells whether the learning curve has a point after so many steps: before the first, at intervals that double from
    /// [`FIRST_INTERVAL_STEPS`] once the policy changes, and every `run.evaluate_every_steps`. Steps come eight at a time;
    /// a point belongs to the first that reaches it. Nothing of this depends on the run's length.
    pub fn is_evaluated_at(&self, steps: u64) -> bool {
        steps == 0 || self.planned_between(steps.saturating_sub(SIDE_BY_SIDE as u64), steps) > 0
    }

    /// Points of the learning curve after `steps`, up to the end of a run of `end` steps.
    pub fn evaluations_between(&self, steps: u64, end: u64) -> u64 {
        self.planned_between(steps, end) + u64::from(!self.is_evaluated_at(end))
    }

    /// Planned points after `from`, up to `until`.
    fn planned_between(&self, from: u64, until: u64) -> u64 {
        let every = self.run.evaluate_every_steps;
        let early = (0..32).map(|k| self.first_change() + (FIRST_INTERVAL_STEPS << k)).take_while(|at| *at < every);
        early.filter(|at| (from + 1..=until).contains(at)).count() as u64 + (until / every).saturating_sub(from / every)
    }

    /// Settings of the learner.
    pub fn learner_settings(&self) -> sac::Settings {
        let observations = self.contract().observation_len();
        let smooths = if self.policy.variant.smooths() { 1.0 } else { 0.0 };
        let sigma = |at: usize| match at {
            0..STATE_LEN => self.caps.sigma_kpa,
            at if at < OBSERVATION_LEN => 0.0,
            _ => self.caps.sigma_duty,
        };
        sac::Settings {
            hidden: self.policy.hidden.to_vec(),
            batch: self.sac.batch,
            learning_rate: self.sac.learning_rate as f32,
            discount: self.sac.discount as f32,
            soft_update: self.sac.soft_update as f32,
            lambda_temporal: (smooths * self.caps.temporal) as f32,
            lambda_spatial: (smooths * self.caps.spatial) as f32,
            spatial_sigma: (0..observations).map(|at| sigma(at) as f32).collect(),
            target_entropy: self.sac.target_entropy as f32,
            temperature: sac::TemperatureRule::Learned(self.sac.first_temperature as f32),
            replay_capacity: self.sac.replay,
            seed: self.run.seed,
            last_layer_scale: self.policy.first_output_scale as f32,
            initial_log_std: self.policy.first_log_std as f32,
            ..sac::Settings::paper(&self.shape())
        }
    }

    /// Checks every number; the text names key, value and range.
    ///
    /// # Errors
    /// Values or keys that are wrong.
    pub fn check(&self) -> Result<(), String> {
        let within = |key: &str, value: f64, low: f64, high: f64| {
            if value.is_finite() && (low..=high).contains(&value) {
                return Ok(());
            }
            Err(format!("{key} = {value} is not within {low} … {high}"))
        };
        let run = &self.run;
        within("run.steps", run.steps as f64, 1.0, 1e10)?;
        within("run.evaluate_every_steps", run.evaluate_every_steps as f64, 1.0, 1e10)?;
        within("run.checkpoint_every_steps", run.checkpoint_every_steps as f64, 1.0, 1e10)?;
        if ObservationLayout::of_version(self.policy.contract).is_none() {
            return Err(format!(
                "policy.contract = {} is none; 1 is the paper's, 2 corrects the fallback",
                self.policy.contract
            ));
        }
        for units in self.policy.hidden {
            if !(32..=1024).contains(&units) || !units.is_multiple_of(32) {
                return Err(format!("policy.hidden: {units} units are not a multiple of 32 within 32 … 1024"));
            }
        }
        within("policy.first_output_scale", self.policy.first_output_scale, 0.0, 1.0)?;
        within("policy.first_log_std", self.policy.first_log_std, -10.0, 2.0)?;
        let sac = &self.sac;
        within("sac.learning_rate", sac.learning_rate, 1e-7, 0.1)?;
        within("sac.annealed_over_steps", sac.annealed_over_steps as f64, 1.0, 1e10)?;
        within("sac.annealed_to", sac.annealed_to, 1e-3, 1.0)?;
        within("sac.discount", sac.discount, 0.0, 0.9999)?;
        within("sac.soft_update", sac.soft_update, 1e-6, 1.0)?;
        within("sac.batch", sac.batch as f64, 32.0, 4096.0)?;
        if !sac.batch.is_multiple_of(32) {
            return Err(format!("sac.batch = {} is no multiple of 32", sac.batch));
        }
        within("sac.replay", sac.replay as f64, sac.batch as f64, 1e8)?;
        within("sac.target_entropy", sac.target_entropy, -1000.0, 100.0)?;
        within("sac.first_temperature", sac.first_temperature, 1e-6, 100.0)?;
        within("caps.temporal", self.caps.temporal, 0.0, 1e4)?;
        within("caps.spatial", self.caps.spatial, 0.0, 1e4)?;
        within("caps.sigma_kpa", self.caps.sigma_kpa, 0.0, 100.0)?;
        within("caps.sigma_duty", self.caps.sigma_duty, 0.0, 1.0)?;
        if self.run.random_steps < sac.batch as u64 {
            return Err(format!(
                "run.random_steps = {} is less than one batch of {}",
                self.run.random_steps, sac.batch
            ));
        }
        if self.rig.evaluated_on.is_empty() {
            return Err("rig.evaluated_on names no rig; a learning curve needs one".into());
        }
        if let Some(rollouts) = &self.rollouts {
            rollouts.check()?;
        }
        self.environment.check().map_err(|error| error.to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_are_the_papers() {
        let paper = TrainingSettings::preset("paper").unwrap();
        assert_eq!(paper, TrainingSettings::default());
    }

    #[test]
    fn the_learning_rate_falls_in_a_line_or_stays() {
        let paper = TrainingSettings::preset("paper").unwrap();
        assert_eq!([0, 256_000, 512_000].map(|steps| paper.learning_rate(steps)), [3e-4; 3]);
        let mut settings = paper;
        settings.sac.annealed_to = 0.1;
        settings.sac.annealed_over_steps = 100;
        assert_eq!([0, 50, 100, 200].map(|steps| settings.learning_rate(steps)), [3e-4, 1.65e-4, 3e-5, 3e-5]);
    }

    #[test]
    fn the_curve_has_early_points_whatever_the_length() {
        let settings = TrainingSettings::preset("correction").unwrap();
        let at: Vec<u64> = (0..=6000).map(|turn| 8 * turn).filter(|steps| settings.is_evaluated_at(*steps)).collect();
        assert_eq!(at, [0, 8_000, 12_000, 16_000, 32_000, 48_000]);
        assert_eq!(settings.evaluations_between(0, 20_000), 4);
        assert_eq!(settings.evaluations_between(8_000, 32_000), 3);
        assert_eq!(settings.evaluations_between(32_000, 32_000), 0);
    }

    #[test]
    fn every_preset_reads_and_survives_a_round_trip() {
        for (name, _) in PRESETS {
            let settings = TrainingSettings::preset(name).unwrap();
            let again = TrainingSettings::parse(name, &settings.to_toml().unwrap()).unwrap();
            assert_eq!(settings, again, "{name}");
        }
    }

    #[test]
    fn mistakes_are_told_with_line_or_key() {
        for (text, words) in [
            ("[sac]\nlearning_rat = 1.0\n", vec!["line 2", "learning_rat"]),
            ("[sac]\ndiscount = nan\n", vec!["sac.discount"]),
            ("[policy]\ncontract = 7\n", vec!["policy.contract", "7"]),
            ("[run]\nsteps = \"many\"\n", vec!["line 2"]),
            ("[environment.reward]\nnow = 0.3\n", vec!["environment.reward.now"]),
        ] {
            let message = TrainingSettings::parse("run.toml", text).unwrap_err().to_string();
            assert!(message.starts_with("run.toml") && message.lines().count() == 1, "{message}");
            for word in words {
                assert!(message.contains(word), "{message}");
            }
        }
    }
}
