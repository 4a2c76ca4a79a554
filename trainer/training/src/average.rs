//! The actor's weights averaged over the last updates.
//!
//! ```text
//! w̄ ← w̄ + (w − w̄) · k/n      every k steps, over about n
//! ```
//!
//! Single updates keep moving the policy about its mean; the mean tracks better and more evenly than any one of them
//! (Polyak and Juditsky, SIAM J. Control Optim. 30, 1992).

use sac::{Dense, Network};

/// Steps between two contributions; each takes a copy of the weights.
pub const EVERY_STEPS: u64 = 64;

/// A running average of policies.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Average {
    mean: Option<Network>,
}

impl Average {
    /// Goes on with an average that was kept.
    pub fn from(mean: Option<Network>) -> Self {
        Average { mean }
    }

    /// Takes in the policy as it stands.
    pub fn add(&mut self, policy: Network, over_steps: u64) {
        let share = (EVERY_STEPS as f32 / over_steps.max(EVERY_STEPS) as f32).min(1.0);
        match &mut self.mean {
            Some(mean) => {
                let layers = mean.layers.iter_mut().chain(&mut mean.log_std);
                for (mean, new) in layers.zip(policy.layers.iter().chain(&policy.log_std)) {
                    blend(mean, new, share);
                }
            }
            None => self.mean = Some(policy),
        }
    }

    /// The average, once there is one.
    pub fn get(&self) -> Option<&Network> {
        self.mean.as_ref()
    }
}

fn blend(mean: &mut Dense, new: &Dense, share: f32) {
    for (mean, new) in mean.weights.iter_mut().zip(&new.weights).chain(mean.bias.iter_mut().zip(&new.bias)) {
        *mean += share * (new - *mean);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn constant(value: f32) -> Network {
        let dense = |inputs, outputs| Dense {
            inputs,
            outputs,
            weights: vec![value; inputs * outputs],
            bias: vec![value; outputs],
        };
        Network {
            features: sac::FeatureMap::identity(3).unwrap(),
            layers: vec![dense(3, 4), dense(4, 2)],
            log_std: Some(dense(4, 2)),
        }
    }

    #[test]
    fn settles_on_the_mean_of_what_alternates() {
        let mut average = Average::default();
        for n in 0..4000 {
            average.add(constant(if n % 2 == 0 { 1.0 } else { 3.0 }), 6400);
        }
        let mean = average.get().unwrap();
        for dense in mean.layers.iter().chain(&mean.log_std) {
            // One contribution is a hundredth, so the mean wanders by half of that about 2.
            assert!(dense.weights.iter().chain(&dense.bias).all(|w| (w - 2.0).abs() < 0.011), "{:?}", dense.bias);
        }
    }
}
