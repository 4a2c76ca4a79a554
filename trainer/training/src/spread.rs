//! The spread of a policy's own distribution in duty, for whoever explores with it on a rig.
//!
//! The actor answers `tanh(μ + σ ε)` with `ε ~ N(0, 1)` (Haarnoja et al., Soft Actor-Critic, 2018, appendix C); what is
//! published answers `tanh(μ)`. Its standard deviation, in the unit of the outputs, is
//!
//! ```text
//! s = L √ mean_τ Var_ε[tanh(μ_τ + σ_τ ε)]
//! ```
//!
//! over the ticks `τ` of runs on the model, with `L` the scale of an output.

use sac::{Dense, Network};

/// Bounds of the logarithm of a deviation, as the learner keeps them.
const LOG_STD: [f64; 2] = [-20.0, 2.0];
/// Points and weights of the Gauss–Hermite rule of seven points for N(0, 1) (Abramowitz and Stegun, table 25.10): exact up to
/// the thirteenth power.
const POINTS: [(f64, f64); 7] = [
    (-3.750_439_717_725_742, 5.482_688_559_722_179e-4),
    (-2.366_759_410_734_541, 3.075_712_396_758_64e-2),
    (-1.154_405_394_739_968, 2.401_231_786_050_127e-1),
    (0.0, 4.571_428_571_428_572e-1),
    (1.154_405_394_739_968, 2.401_231_786_050_127e-1),
    (2.366_759_410_734_541, 3.075_712_396_758_64e-2),
    (3.750_439_717_725_742, 5.482_688_559_722_179e-4),
];

/// Standard deviations in duty of the answers that have a distribution, over last hidden layers; nothing for a policy without
/// one. That is the answers for now, and the plan where it was learned as a part of the answer.
pub(crate) fn exploration_std<'a>(
    network: &Network,
    hidden: impl Iterator<Item = &'a [f32]>,
    scale: f64,
) -> Option<Vec<f64>> {
    let (mean, log_std) = (network.layers.last()?, network.log_std.as_ref()?);
    let (mut sums, mut count) = (vec![0.0; log_std.outputs], 0.0);
    for hidden in hidden {
        for (c, sum) in sums.iter_mut().enumerate() {
            let std = output(log_std, hidden, c).clamp(LOG_STD[0], LOG_STD[1]).exp();
            *sum += squashed_variance(output(mean, hidden, c), std);
        }
        count += 1.0;
    }
    (count > 0.0).then(|| sums.iter().map(|sum| scale.abs() * (sum / count).sqrt()).collect())
}

/// One output of a layer before it is squashed.
fn output(layer: &Dense, inputs: &[f32], of: usize) -> f64 {
    let weights = layer.weights.chunks_exact(layer.outputs).filter_map(|row| row.get(of));
    let sum: f64 = inputs.iter().zip(weights).map(|(x, w)| f64::from(*x) * f64::from(*w)).sum();
    sum + layer.bias.get(of).map_or(0.0, |b| f64::from(*b))
}

/// Variance of `tanh(mean + std ε)`.
fn squashed_variance(mean: f64, std: f64) -> f64 {
    let moment =
        |power: i32| -> f64 { POINTS.iter().map(|(at, weight)| weight * (mean + std * at).tanh().powi(power)).sum() };
    (moment(2) - moment(1).powi(2)).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_small_deviation_is_scaled_by_the_slope_and_a_large_one_saturates() {
        // d tanh/dx at 0.5 is 1 − tanh² = 0.7864.
        assert!((squashed_variance(0.5, 0.01).sqrt() / (0.01 * 0.786_448) - 1.0).abs() < 1e-3);
        // A fair coin of ±1 has a variance of one; e² is as wide as a deviation may be.
        let wide = squashed_variance(0.0, std::f64::consts::E.powi(2));
        assert!((0.4..=1.0).contains(&wide), "{wide}");
        // ∫ tanh² over N(0, 0.5²), by the trapezoid rule on a fine grid.
        let step = 1e-3;
        let by_hand: f64 = (-8000..=8000)
            .map(|k| {
                let e = f64::from(k) * step;
                (0.5 * e).tanh().powi(2) * (-0.5 * e * e).exp() / (2.0 * std::f64::consts::PI).sqrt() * step
            })
            .sum();
        assert!((squashed_variance(0.0, 0.5) / by_hand - 1.0).abs() < 1e-3, "{by_hand}");
    }

    #[test]
    fn a_policy_without_a_distribution_states_none() {
        let dense =
            |weight: f32, bias: f32| Dense { inputs: 1, outputs: 2, weights: vec![weight; 2], bias: vec![bias; 2] };
        let feature = sac::Feature { plus: 0, minus: None, offset: 0.0, scale: 1.0 };
        let features = sac::FeatureMap::new(1, vec![feature]).unwrap();
        let mut network = Network { features, layers: vec![dense(0.0, 0.0)], log_std: None };
        let hidden = [[1.0_f32], [2.0]];
        let of = |network: &Network| exploration_std(network, hidden.iter().map(|h| h.as_slice()), 0.06);
        assert_eq!(of(&network), None);
        network.log_std = Some(dense(0.0, (0.1_f32).ln()));
        let std = of(&network).unwrap();
        let [one, other] = std[..] else { panic!("one for each of two outputs: {std:?}") };
        // tanh shrinks a deviation of 0.1 by σ² = 1 %.
        assert!(one == other && (one / 0.006 - 0.99).abs() < 2e-3, "{one}");
    }
}
