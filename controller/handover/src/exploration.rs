//! Exploration: bounded, seeded noise on the active policy's answer, as it was trained with.
//!
//! ```text
//! a' = clamp(a + clamp(σ ε, −b, b), low, high),   ε ~ N(0, 1),   b = min(2 σ, exploration_max_duty)
//! ```
//!
//! per output and tick, within the outputs' own range, which a policy's own distribution never leaves. It is that distribution
//! where the policy's file states the deviations (`exploration_std`, in the unit of its outputs, duty), and a share of its range
//! on the answers for now where not. Noise on the plan is for those alone that state it: their plan was learned as a part of
//! the answer, and whoever learns on must see it tried; any other plan follows from the answer, and noise would make it false.
//!
//! All that comes after the policy (its law's limits, the slew limit, the safety filter) takes the sum as it takes the answer
//! alone.

use model::observation::{ACTION_LEN, CHANNELS, Pair};
use policy::{Channel, Policy};
use proto::policy_metadata::{EXPLORATION_STD_KEY, exploration_std};
use proto::recording::PLANNED_OUTPUTS;
use proto::split_mix::SplitMix64;
use serde::{Deserialize, Serialize};

/// Noise beyond this many standard deviations is cut off there (chosen: one draw in 22).
const MOST_DEVIATIONS: f64 = 2.0;

/// Rules of exploration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExplorationRules {
    /// Seed of the noise.
    pub seed: u32,
    /// Standard deviation as a share of the outputs' range, for a policy that states none.
    pub std_share: f64,
    /// The most that is ever added, in duty.
    pub most_duty: f64,
}

/// Origin of a standard deviation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StdOrigin {
    /// The policy's file states it.
    Policy,
    /// The configuration, for a policy that states none.
    Configuration,
}

/// Exploration as the tick shows it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ExplorationShown {
    /// Seed of the noise.
    pub seed: u32,
    /// Standard deviation per channel, in duty.
    pub std_duty: Pair,
    /// Origin.
    pub std_from: StdOrigin,
    /// The most that is added per channel, in duty.
    pub most_duty: Pair,
}

/// Spread that a policy's file states of its own distribution.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PolicySpread {
    /// Spread of each output; 0 where none is stated.
    stated: Option<[f64; ACTION_LEN]>,
    range_duty: Pair,
}

impl PolicySpread {
    /// The spread of a policy; a statement that is none counts as not made.
    ///
    /// # Real-time
    /// Reads text; not for the tick.
    pub fn of(policy: &Policy) -> Self {
        let range = |c: usize| policy.contract().outputs.get(c).map_or(0.0, |o| f64::from(o.high) - f64::from(o.low));
        let stated = policy.metadata().get(EXPLORATION_STD_KEY).and_then(exploration_std).map(|stated| {
            let mut of_all = [0.0; ACTION_LEN];
            of_all.iter_mut().zip(stated).for_each(|(std, stated)| *std = stated);
            of_all
        });
        PolicySpread { stated, range_duty: std::array::from_fn(range) }
    }
}

/// Noise of a tick that exploration adds to an answer, in duty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
    /// To the answers for now.
    pub now: Pair,
    /// To the plan, in the order of the outputs behind these.
    pub plan: [f32; PLANNED_OUTPUTS],
}

impl Noise {
    /// Nothing added.
    pub const NONE: Self = Noise { now: [0.0; CHANNELS], plan: [0.0; PLANNED_OUTPUTS] };

    /// A policy's answer with this noise, in the bits in which the law is told it.
    ///
    /// # Real-time
    /// Bounded and allocation-free: runs in the tick.
    pub fn added_to(&self, outputs: &mut [f32; ACTION_LEN]) {
        if *self == Self::NONE {
            return;
        }
        let later = self.plan.iter().map(|noise| f64::from(*noise));
        for (output, noise) in outputs.iter_mut().zip(self.now.into_iter().chain(later)) {
            *output = (f64::from(*output) + noise) as f32;
        }
    }

    /// Cuts this noise so that no output leaves its range.
    ///
    /// # Real-time
    /// Bounded and allocation-free: runs in the tick.
    #[must_use]
    pub fn within(&self, outputs: &[f32; ACTION_LEN], ranges: &[Channel]) -> Self {
        let room = |i: usize, noise: f64| {
            let Some((output, range)) = outputs.get(i).zip(ranges.get(i)) else { return noise };
            // An answer beyond the range by itself is not brought back: that is no noise.
            let [low, high] = [range.low, range.high].map(|bound| f64::from(bound) - f64::from(*output));
            noise.clamp(low.min(0.0), high.max(0.0))
        };
        Noise {
            now: std::array::from_fn(|c| room(c, self.now[c])),
            plan: std::array::from_fn(|j| room(CHANNELS + j, f64::from(self.plan[j])) as f32),
        }
    }
}

/// Exploration that is on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exploration {
    shown: ExplorationShown,
    plan_std: [f64; PLANNED_OUTPUTS],
    most_duty: f64,
    draws: SplitMix64,
}

impl Exploration {
    /// Exploration around a policy.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn new(rules: ExplorationRules, spread: &PolicySpread) -> Self {
        let (stated, std_from) = match spread.stated {
            Some(stated) => (stated, StdOrigin::Policy),
            None => {
                let share = |i: usize| spread.range_duty.get(i).map_or(0.0, |range| rules.std_share * range);
                (std::array::from_fn(share), StdOrigin::Configuration)
            }
        };
        let std_duty = std::array::from_fn(|c| stated[c]);
        let most_duty = std_duty.map(|std| most(std, rules.most_duty));
        let shown = ExplorationShown { seed: rules.seed, std_duty, std_from, most_duty };
        let plan_std = std::array::from_fn(|j| stated[CHANNELS + j]);
        Exploration { shown, plan_std, most_duty: rules.most_duty, draws: SplitMix64::new(u64::from(rules.seed)) }
    }

    /// Exploration as it is shown.
    pub fn shown(&self) -> ExplorationShown {
        self.shown
    }

    /// The noise of the next tick.
    ///
    /// # Real-time
    /// Bounded and allocation-free: runs in the tick.
    pub fn draw(&mut self) -> Noise {
        let unit = self.two_normal();
        let ExplorationShown { std_duty, most_duty, .. } = self.shown;
        let now = std::array::from_fn(|c: usize| (std_duty[c] * unit[c]).clamp(-most_duty[c], most_duty[c]));
        let mut plan = [0.0; PLANNED_OUTPUTS];
        if self.plan_std != [0.0; PLANNED_OUTPUTS] {
            for j in (0..PLANNED_OUTPUTS).step_by(CHANNELS) {
                let unit = self.two_normal();
                for c in 0..CHANNELS {
                    let std = self.plan_std[j + c];
                    let bound = most(std, self.most_duty);
                    plan[j + c] = (std * unit[c]).clamp(-bound, bound) as f32;
                }
            }
        }
        Noise { now, plan }
    }

    /// Two draws from N(0, 1), by Box and Muller.
    fn two_normal(&mut self) -> Pair {
        let [radius, angle] = [(); 2].map(|()| self.draws.unit());
        // 1 − u is in (0, 1], so the logarithm stays finite.
        let radius = (-2.0 * (1.0 - radius).ln()).sqrt();
        let (sine, cosine) = (std::f64::consts::TAU * angle).sin_cos();
        [radius * cosine, radius * sine]
    }
}

/// The most that is added where a deviation is `std`.
fn most(std: f64, most_duty: f64) -> f64 {
    (MOST_DEVIATIONS * std).min(most_duty)
}

#[cfg(test)]
mod tests {
    use super::*;
    use policy::PolicySignature;

    /// These deviations and 0 for all outputs behind.
    fn stated(first: &[f64]) -> [f64; ACTION_LEN] {
        std::array::from_fn(|i| first.get(i).copied().unwrap_or_default())
    }

    fn exploration(spread: PolicySpread) -> Exploration {
        Exploration::new(ExplorationRules { seed: 7, std_share: 0.02, most_duty: 0.02 }, &spread)
    }

    #[test]
    fn noise_is_gaussian_bounded_and_follows_from_its_seed() {
        let spread = PolicySpread { stated: Some(stated(&[0.004, 0.03])), range_duty: [0.5; 2] };
        let (mut first, mut again) = (exploration(spread), exploration(spread));
        let drawn: Vec<Noise> = (0..20_000).map(|_| first.draw()).collect();
        assert!(drawn.iter().all(|noise| *noise == again.draw() && noise.plan == Noise::NONE.plan));
        let draws: Vec<Pair> = drawn.iter().map(|noise| noise.now).collect();
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

    #[test]
    fn a_learned_plan_is_tried_too_each_of_its_numbers_by_itself() {
        let spread = PolicySpread { stated: Some([0.01; ACTION_LEN]), range_duty: [1.0; 2] };
        let mut exploration = exploration(spread);
        let drawn: Vec<Noise> = (0..20_000).map(|_| exploration.draw()).collect();
        let of = |i: usize| -> Vec<f64> { drawn.iter().map(|noise| f64::from(noise.plan[i])).collect() };
        let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>() / a.len() as f64;
        for i in 0..PLANNED_OUTPUTS {
            let deviation = product(&of(i), &of(i)).sqrt();
            assert!((deviation / 0.01 - 0.9594).abs() < 0.02, "{i}: {deviation}");
            for j in 0..i {
                // Standard error of a correlation of 20,000 draws: 0.007.
                assert!(product(&of(i), &of(j)).abs() < 0.035 * 0.01 * 0.01, "{i} and {j} are drawn apart");
            }
        }
    }

    #[test]
    fn noise_stays_within_the_range_of_the_outputs() {
        let ranges = PolicySignature::pressures_to_duties(1, 84, ACTION_LEN).outputs;
        let noise = Noise { now: [0.3, -0.3], plan: [0.3; PLANNED_OUTPUTS] };
        let mut outputs = [0.9; ACTION_LEN];
        let left = noise.within(&outputs, &ranges);
        left.added_to(&mut outputs);
        assert!((outputs[0] - 1.0).abs() < 1e-6 && (outputs[1] - 0.6).abs() < 1e-6, "{outputs:?}");
        assert!(outputs[2..].iter().all(|planned| (planned - 1.0).abs() < 1e-6), "{outputs:?}");
        assert_eq!(left.within(&[0.9; ACTION_LEN], &ranges), left, "a recorded noise comes to itself");
        // A policy that answers beyond what it states is not mended by exploring.
        assert_eq!(noise.within(&[1.5; ACTION_LEN], &ranges).now, [0.0, -0.3]);
    }
}
