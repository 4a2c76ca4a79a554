//! Everything about the environment that can be chosen, as the `[environment]` table of a training file.

use serde::{Deserialize, Serialize};

use crate::EnvironmentError;

/// The environment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EnvironmentSettings {
    /// Length of an episode in s. Its end is a truncation: what would come after still counts.
    pub episode_s: f64,
    /// First seconds of an episode that are flown without corrections and nobody learns from, at the longest; drawn anew
    /// for each episode, a tenth of it at least; contract 2 only. In flight, too, a policy mostly meets integral and play
    /// that have settled, and sometimes the first seconds after arming.
    pub warm_up_s: f64,
    /// Noise of the converter in V RMS.
    pub noise_v_rms: f64,
    /// Lowest duty that a policy under the paper's contract can choose.
    pub duty_low: f64,
    /// Highest duty that a policy under the paper's contract can choose.
    pub duty_high: f64,
    /// The most that a policy under the second contract adds to or takes from the fallback's duty.
    pub correction_duty: f64,
    /// The reward.
    pub reward: RewardSettings,
    /// Range to which parameters are drawn from the rig's own.
    pub spread: DomainRandomization,
    /// Mechanisms that are drawn.
    pub mechanisms: Vec<MechanismDraw>,
}

impl Default for EnvironmentSettings {
    fn default() -> Self {
        EnvironmentSettings {
            episode_s: 20.0,
            warm_up_s: 0.0,
            noise_v_rms: proto::emulator::Sensors::ADC_NOISE_V_RMS,
            duty_low: 0.0,
            duty_high: 1.0,
            correction_duty: 0.1,
            reward: RewardSettings::default(),
            spread: DomainRandomization::default(),
            mechanisms: Vec::new(),
        }
    }
}

/// Weights of the reward, per kPa (paper, Table IV).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RewardSettings {
    /// w₀: of the error now.
    pub now: f64,
    /// w₁ … w_{n_a−1}: of the errors predicted for the next four ticks.
    pub between: f64,
    /// w_{n_a}: of the error predicted for the fifth tick.
    pub last: f64,
    /// Factors of the positive and the negative channel's errors; the paper has 1 and 1.
    pub channels: [f64; 2],
    /// Errors, in kPa, beyond which only a tenth counts: a rig that is on its way cannot do better, and its large errors would
    /// drown the small ones in the critics' scale. The paper has no such limit.
    pub most_kpa: [f64; 2],
    /// Factor of the whole; the paper has 1.
    pub scale: f64,
    /// True where the errors paid for are those of the readings before noise, which a simulation knows; the paper pays for
    /// what is measured. The noise is the same whatever the policy does, and only blurs what the critics learn from.
    pub noise_free: bool,
    /// Prices of the positive and the negative valve's correction, per square of its share of the range it may have;
    /// contract 2 only, the paper has 0. What does not help the tracking is then left alone instead of wandering.
    pub correction: [f64; 2],
    /// Price of leaving the safety envelope, which ends an episode (reward_value once, times `scale`).
    pub tripped: f64,
}

impl Default for RewardSettings {
    fn default() -> Self {
        RewardSettings {
            now: -0.3,
            between: -0.01,
            last: -0.25,
            channels: [1.0, 1.0],
            most_kpa: [1000.0, 1000.0],
            scale: 1.0,
            noise_free: false,
            correction: [0.0; 2],
            tripped: -300.0,
        }
    }
}

/// Range to which parameters are drawn from the rig's own: uniformly within ± so many percent, each by itself.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DomainRandomization {
    /// Chamber volumes.
    pub volumes_percent: f64,
    /// The valves' input, pressure and spring coefficients.
    pub valves_percent: f64,
    /// The pump's check valves.
    pub check_valves_percent: f64,
    /// Mechanisms that stand in the rig's file: each number's distance from where the mechanism does nothing. Residual terms
    /// stay as they are.
    pub mechanisms_percent: f64,
    /// Mechanisms that stand in the rig's file and are drawn as well ([`EnvironmentSettings::mechanisms`]): how far from
    /// where they stand, as a share of half the width of the range they are drawn from elsewhere.
    pub known_percent: f64,
}

impl DomainRandomization {
    /// Tells whether anything is spread.
    pub fn is_any(&self) -> bool {
        *self != DomainRandomization::default()
    }
}

/// A mechanism that is drawn for every rig: each parameter uniformly within its range.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MechanismDraw {
    /// The mechanism's id, as in rig files.
    pub id: String,
    /// Component that it is attached to. Where the rig has no component of that name, `valve_pos`, `valve_neg`, `positive` and
    /// `negative` mean the valve that `u_pos` or `u_neg` commands and the chamber that `p_pos_kpa` or `p_neg_kpa` is read in.
    pub component: String,
    /// Share of rigs in which every parameter stands at its lowest (no backlash, no lag, no delay). Each mechanism is drawn
    /// independently of the others, so that some valves have a delay alone, some a lag alone, some nothing at all, as in the
    /// paper's simulation. Ranges alone hardly ever draw that.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub none: f64,
    /// Each parameter's lowest and highest value, under the name that rig files use.
    #[serde(flatten)]
    pub ranges: std::collections::BTreeMap<String, [f64; 2]>,
}

fn is_zero(share: &f64) -> bool {
    *share == 0.0
}

impl EnvironmentSettings {
    /// Checks every number.
    ///
    /// # Errors
    /// [`EnvironmentError::Setting`] names the key, the value and the range.
    pub fn check(&self) -> Result<(), EnvironmentError> {
        let within = |key: &str, value: f64, low: f64, high: f64, hint: &str| {
            if value.is_finite() && (low..=high).contains(&value) {
                return Ok(());
            }
            let problem = format!("{value} is not within {low} … {high}{hint}");
            Err(EnvironmentError::Setting { key: format!("environment.{key}"), problem })
        };
        within("episode_s", self.episode_s, 1.0, 600.0, " s")?;
        within("warm_up_s", self.warm_up_s, 0.0, self.episode_s - 0.5, " s; it must leave something of the episode")?;
        within("noise_v_rms", self.noise_v_rms, 0.0, 0.1, " V")?;
        within("duty_low", self.duty_low, 0.0, 0.95, "")?;
        within("duty_high", self.duty_high, self.duty_low + 0.05, 1.0, "; it must lie above duty_low")?;
        within("correction_duty", self.correction_duty, 0.001, model::observation::CORRECTION_LIMIT, "")?;
        let r = &self.reward;
        for (key, weight) in [
            ("now", r.now),
            ("between", r.between),
            ("last", r.last),
            ("correction", r.correction[0]),
            ("correction", r.correction[1]),
            ("tripped", r.tripped),
        ] {
            within(&format!("reward.{key}"), weight, -1e4, 0.0, "; errors are paid for")?;
        }
        within("reward.scale", r.scale, 1e-3, 1e3, "")?;
        for (weight, most) in r.channels.into_iter().zip(r.most_kpa) {
            within("reward.channels", weight, 0.0, 100.0, "")?;
            within("reward.most_kpa", most, 0.01, 1000.0, " kPa")?;
        }
        let s = &self.spread;
        for (key, percent) in [
            ("volumes_percent", s.volumes_percent),
            ("valves_percent", s.valves_percent),
            ("check_valves_percent", s.check_valves_percent),
            ("mechanisms_percent", s.mechanisms_percent),
        ] {
            within(&format!("spread.{key}"), percent, 0.0, 50.0, " %")?;
        }
        within("spread.known_percent", s.known_percent, 0.0, 100.0, " %")?;
        for (n, mechanism) in self.mechanisms.iter().enumerate() {
            within(&format!("mechanisms[{n}].none"), mechanism.none, 0.0, 1.0, "")?;
            for (name, [low, high]) in &mechanism.ranges {
                if !(low.is_finite() && high.is_finite() && low <= high) {
                    return Err(EnvironmentError::Setting {
                        key: format!("environment.mechanisms[{n}].{name}"),
                        problem: format!("[{low}, {high}] is no range; give the lowest and the highest value"),
                    });
                }
            }
        }
        Ok(())
    }
}
