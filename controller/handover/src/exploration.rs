//! Exploration: bounded, seeded noise on the active policy's answer, as it was trained with.
//!
//! ```text
//! a' = a + clamp(σ ε, −b, b),   ε ~ N(0, 1),   b = min(2 σ, exploration_max_duty)
//! ```
//!
//! per channel and tick, on the answer for now and not on the plan. It is the policy's own distribution where its file
//! states the deviation (`exploration_std`: two numbers in the unit of its outputs, duty), and a share of its range where not.
//! All that comes after the policy (its law's limits, the slew limit, the safety filter) takes the sum as it takes the answer
//! alone.

use model::observation::{CHANNELS, Pair};
use policy::Policy;
use proto::policy_metadata::{EXPLORATION_STD_KEY, exploration_std};
use serde::{Deserialize, Serialize};

/// Noise beyond this many standard deviations is cut off there (chosen: one draw in 22).
const MOST_DEVIATIONS: f64 = 2.0;

/// How exploration is asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExplorationRules {
    /// Seed of the noise.
    pub seed: u32,
    /// Standard deviation as a share of the outputs' range, for a policy that states none.
    pub std_share: f64,
    /// The most that is ever added, in duty.
    pub most_duty: f64,
}

/// Where a standard deviation comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StdOrigin {
    /// The policy's file states it.
    Policy,
    /// The configuration, for a policy that states none.
    Configuration,
}

/// What the tick shows of exploration.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ExplorationShown {
    /// Seed of the noise.
    pub seed: u32,
    /// Standard deviation per channel, in duty.
    pub std_duty: Pair,
    /// Where it comes from.
    pub std_from: StdOrigin,
    /// The most that is added per channel, in duty.
    pub most_duty: Pair,
}

/// What a policy's file says about its own distribution.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PolicySpread {
    stated: Option<Pair>,
    range_duty: Pair,
}

impl PolicySpread {
    /// The spread of a policy; a statement that is none counts as not made.
    ///
    /// # Real-time
    /// Reads text; not for the tick.
    pub fn of(policy: &Policy) -> Self {
        let range = |c: usize| policy.contract().outputs.get(c).map_or(0.0, |o| f64::from(o.high) - f64::from(o.low));
        let stated = policy.metadata().get(EXPLORATION_STD_KEY).and_then(exploration_std);
        PolicySpread { stated, range_duty: std::array::from_fn(range) }
    }
}

/// Exploration that is on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exploration {
    shown: ExplorationShown,
    state: u64,
}

impl Exploration {
    /// Exploration around a policy.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn new(rules: ExplorationRules, spread: &PolicySpread) -> Self {
        let (std_duty, std_from) = match spread.stated {
            Some(stated) => (stated, StdOrigin::Policy),
            None => (spread.range_duty.map(|range| rules.std_share * range), StdOrigin::Configuration),
        };
        let most_duty = std_duty.map(|std| (MOST_DEVIATIONS * std).min(rules.most_duty));
        let shown = ExplorationShown { seed: rules.seed, std_duty, std_from, most_duty };
        Exploration { shown, state: u64::from(rules.seed) }
    }

    /// What is shown of it.
    pub fn shown(&self) -> ExplorationShown {
        self.shown
    }

    /// The noise of the next tick, in duty.
    ///
    /// # Real-time
    /// Bounded and allocation-free: runs in the tick.
    pub fn draw(&mut self) -> Pair {
        let [radius, angle] = [(); 2].map(|()| self.unit());
        // Box and Muller; 1 − u is in (0, 1], so the logarithm stays finite.
        let radius = (-2.0 * (1.0 - radius).ln()).sqrt();
        let (sine, cosine) = (std::f64::consts::TAU * angle).sin_cos();
        let ExplorationShown { std_duty, most_duty, .. } = self.shown;
        let unit = [radius * cosine, radius * sine];
        std::array::from_fn(|c: usize| (std_duty[c] * unit[c]).clamp(-most_duty[c], most_duty[c]))
    }

    /// Uniform in \[0, 1): SplitMix64 (Steele, Lea, Flood, OOPSLA 2014), 53 bits of it.
    fn unit(&mut self) -> f64 {
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mixed = (self.state ^ (self.state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((mixed ^ (mixed >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// Nothing added.
pub(crate) const NO_NOISE: Pair = [0.0; CHANNELS];

#[cfg(test)]
mod tests {
    use super::*;

    fn exploration(spread: PolicySpread) -> Exploration {
        Exploration::new(ExplorationRules { seed: 7, std_share: 0.02, most_duty: 0.02 }, &spread)
    }

    #[test]
    fn noise_is_gaussian_bounded_and_follows_from_its_seed() {
        let spread = PolicySpread { stated: Some([0.004, 0.03]), range_duty: [0.5; 2] };
        let (mut first, mut again) = (exploration(spread), exploration(spread));
        let draws: Vec<Pair> = (0..20_000).map(|_| first.draw()).collect();
        assert!(draws.iter().all(|noise| *noise == again.draw()));
        assert_eq!(first.shown().most_duty, [0.008, 0.02]);
        let moments = |c: usize| {
            let n = draws.len() as f64;
            let mean = draws.iter().map(|d| d[c]).sum::<f64>() / n;
            (mean, (draws.iter().map(|d| (d[c] - mean).powi(2)).sum::<f64>() / n).sqrt())
        };
        // Cut off at two deviations a Gaussian keeps 0.9594 of its deviation: the integral, worked out apart.
        let (mean, deviation) = moments(0);
        assert!(mean.abs() < 0.0001 && (deviation / 0.004 - 0.9594).abs() < 0.01, "{mean} {deviation}");
        assert!(draws.iter().all(|d| d[0].abs() <= 0.008 && d[1].abs() <= 0.02));
        let together = draws.iter().map(|d| d[0] * d[1]).sum::<f64>() / draws.len() as f64;
        assert!(together.abs() < 0.05 * 0.004 * 0.02, "channels are drawn apart: {together}");
    }

    #[test]
    fn a_policy_that_states_nothing_has_a_share_of_its_range() {
        let shown = exploration(PolicySpread { stated: None, range_duty: [0.5, 0.1] }).shown();
        assert_eq!((shown.std_duty, shown.std_from), ([0.01, 0.002], StdOrigin::Configuration));
        assert_eq!(shown.most_duty, [0.02, 0.004]);
    }
}
