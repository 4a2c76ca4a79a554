//! Bound on how far two correct f32 programs differ on one input.
//!
//! A policy that is told small changes of large pressures (1 kPa scaled to 1, say) amplifies rounding: on a probe whose
//! pressures jump from tick to tick two sound programs then differ by more than 1e-5. The scatter of a value `z`, for
//! the unit roundoff `u = 2^-24` and with rounding errors taken as independent (Higham & Mary, "A new approach to
//! probabilistic rounding error analysis", 2019, model 1.1), follows the layers:
//!
//! ```text
//! z = Σ w_i x_i + b     σ_z² = Σ w_i² σ_i² + u² (Σ (w_i x_i)² + Σ s_k² + z²),   s_k the partial sums
//! z = x · c             σ_z² = c² σ_x² + u² z²
//! z = f(x)              σ_z² = L² σ_x² + u² z²,   L the steepest slope of f
//! ```
//!
//! Only what programs do differently counts: the order of a sum of three or more terms, products fused or not, a
//! division or a product with the reciprocal. Products with a power of two and sums of two terms are the same
//! everywhere.

use crate::activation::Activation;
use crate::kernel::{Arithmetic, Dense, Layer};

/// Unit roundoff of f32.
const ROUNDOFF: f64 = 1.0 / (1u32 << 24) as f64;

/// A value and the variance of its rounding error.
#[derive(Debug, Clone, Copy)]
struct Rounded {
    value: f64,
    variance: f64,
}

/// Standard deviation of each output's rounding error for this input.
pub(crate) fn scatter(layers: &[Layer], input: &[f32]) -> Vec<f64> {
    let mut values: Vec<Rounded> = input.iter().map(|&x| Rounded { value: f64::from(x), variance: 0.0 }).collect();
    for layer in layers {
        match layer {
            Layer::Dense(layer) => values = dense(layer, &values),
            Layer::Constant(arithmetic, constant) => {
                for (x, &c) in values.iter_mut().zip(constant) {
                    *x = elementwise(*arithmetic, *x, f64::from(c));
                }
            }
            Layer::Activation(function) => values.iter_mut().for_each(|x| *x = activation(*function, *x)),
        }
    }
    values.iter().map(|x| x.variance.sqrt()).collect()
}

fn squared_roundoff(value: f64) -> f64 {
    (ROUNDOFF * value).powi(2)
}

fn dense(layer: &Dense, x: &[Rounded]) -> Vec<Rounded> {
    let row = |output| {
        let (mut sum, mut variance, mut terms) = (0.0, 0.0, 0);
        for (input, x) in x.iter().enumerate() {
            let weight = layer.weight(input, output);
            if weight == 0.0 {
                continue;
            }
            let product = f64::from(weight) * x.value;
            sum += product;
            terms += 1;
            variance += f64::from(weight).powi(2) * x.variance;
            if weight.to_bits() << 9 != 0 {
                variance += squared_roundoff(product);
            }
            if terms > 2 {
                variance += squared_roundoff(sum);
            }
        }
        let value = sum + f64::from(layer.bias(output));
        Rounded { value, variance: variance + if terms > 1 { squared_roundoff(value) } else { 0.0 } }
    };
    (0..layer.width().1).map(row).collect()
}

fn elementwise(arithmetic: Arithmetic, x: Rounded, c: f64) -> Rounded {
    let (value, slope) = match arithmetic {
        Arithmetic::Add => (x.value + c, 1.0),
        Arithmetic::Subtract => (x.value - c, 1.0),
        Arithmetic::SubtractFrom => (c - x.value, 1.0),
        Arithmetic::Multiply => (x.value * c, c),
        Arithmetic::Divide => (x.value / c, 1.0 / c),
        Arithmetic::DivideInto => (c / x.value, c / x.value.powi(2)),
    };
    let own = match arithmetic {
        Arithmetic::Add | Arithmetic::Subtract | Arithmetic::SubtractFrom => 0.0,
        Arithmetic::Multiply | Arithmetic::Divide | Arithmetic::DivideInto => squared_roundoff(value),
    };
    Rounded { value, variance: slope * slope * x.variance + own }
}

fn activation(function: Activation, x: Rounded) -> Rounded {
    let mut value = [x.value as f32];
    function.apply(&mut value);
    let value = f64::from(value[0]);
    let (steepest, own) = match function {
        Activation::Relu | Activation::Clip { .. } => (1.0, 0.0),
        Activation::LeakyRelu { slope } => (f64::from(slope).abs().max(1.0), squared_roundoff(value)),
        Activation::Elu { alpha } => (f64::from(alpha).abs().max(1.0), squared_roundoff(value)),
        Activation::Tanh | Activation::Softplus => (1.0, squared_roundoff(value)),
        Activation::Sigmoid => (0.25, squared_roundoff(value)),
    };
    Rounded { value, variance: steepest * steepest * x.variance + own }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::Kernel;

    /// Changes of 0.1 kPa scaled to 1, among pressures that jump by tens of kPa: 40 inputs, 64 hidden neurons, 6 tanhs.
    fn sharp(seed: u32) -> (Vec<Layer>, Vec<f32>, impl FnMut() -> f32) {
        let mut state = seed;
        let mut draw = move || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / 8_388_608.0 - 1.0
        };
        let pick = |i: usize, k: usize| if i == k { -1.0 } else { f32::from(u8::from(i == k + 1)) };
        let picked: Vec<f32> = (0..40 * 39).map(|place| pick(place / 39, place % 39)).collect();
        let mut many = |count: usize, scale: f32| -> Vec<f32> { (0..count).map(|_| scale * draw()).collect() };
        let (hidden, last) = (many(39 * 64, 0.2), many(64 * 6, 0.01));
        let layers = vec![
            Layer::Dense(Dense::new(40, 39, &picked, &[0.0; 39])),
            Layer::Constant(Arithmetic::Multiply, vec![10.0; 39].into()),
            Layer::Dense(Dense::new(39, 64, &hidden, &many(64, 0.1))),
            Layer::Activation(Activation::Relu),
            Layer::Dense(Dense::new(64, 6, &last, &[0.0; 6])),
            Layer::Activation(Activation::Tanh),
        ];
        (layers, hidden, draw)
    }

    /// The network in f64: weights as the f32 that they are, nothing rounded on the way.
    fn exact(layers: &[Layer], input: &[f32]) -> Vec<f64> {
        let mut x: Vec<f64> = input.iter().map(|&x| f64::from(x)).collect();
        for layer in layers {
            match layer {
                Layer::Dense(layer) => {
                    let sum = |j| {
                        let products = x.iter().enumerate().map(|(i, x)| f64::from(layer.weight(i, j)) * x);
                        products.sum::<f64>() + f64::from(layer.bias(j))
                    };
                    x = (0..layer.width().1).map(sum).collect();
                }
                Layer::Constant(_, constant) => x.iter_mut().zip(constant).for_each(|(x, &c)| *x *= f64::from(c)),
                Layer::Activation(Activation::Relu) => x.iter_mut().for_each(|x| *x = x.max(0.0)),
                Layer::Activation(_) => x.iter_mut().for_each(|x| *x = x.tanh()),
            }
        }
        x
    }

    /// Over 1200 answers the kernel's error stays within four scatters, as the comparison with tract asks. And the
    /// scatter is no empty bound: on the steep part of the tanh, where nothing hides errors, it is a few times the root
    /// mean square of the error (it counts each rounding at its largest, √3 of its deviation, and rectified sums too).
    #[test]
    fn the_scatter_is_that_of_the_kernel() {
        let (mut squares, mut count, mut worst) = (0.0, 0, 0.0f64);
        for seed in 0..4 {
            let (layers, _, mut draw) = sharp(seed);
            let mut kernel = Kernel::new(40, sharp(seed).0);
            for _ in 0..50 {
                let input: Vec<f32> = (0..40).map(|_| 80.0 + 10.0 * draw()).collect();
                let mut ours = [0.0; 6];
                kernel.run(&input, &mut ours).unwrap();
                let exact = exact(&layers, &input);
                for ((ours, exact), scatter) in ours.iter().zip(exact).zip(scatter(&layers, &input)) {
                    let ratio = (f64::from(*ours) - exact) / scatter;
                    worst = worst.max(ratio.abs());
                    if exact.abs() < 0.3 {
                        squares += ratio * ratio;
                        count += 1;
                    }
                }
            }
        }
        let rms = (squares / f64::from(count)).sqrt();
        assert!(count > 100 && worst < 4.0, "{count} {worst}");
        assert!((0.2..1.0).contains(&rms), "{rms}");
    }

    /// One weight of one hidden neuron off by a hundredth: far outside the scatter on some answer.
    #[test]
    fn a_wrong_weight_is_no_rounding() {
        let (layers, hidden, mut draw) = sharp(9);
        let mut wrong = hidden;
        let largest = (0..wrong.len()).max_by(|&a, &b| wrong[a].abs().total_cmp(&wrong[b].abs())).unwrap();
        wrong[largest] *= 1.01;
        let bias: Vec<f32> = match &layers[2] {
            Layer::Dense(layer) => (0..64).map(|j| layer.bias(j)).collect(),
            _ => unreachable!(),
        };
        let mut other = sharp(9).0;
        other[2] = Layer::Dense(Dense::new(39, 64, &wrong, &bias));
        let farthest = (0..50).map(|_| {
            let input: Vec<f32> = (0..40).map(|_| 80.0 + 10.0 * draw()).collect();
            let offs = exact(&layers, &input).into_iter().zip(exact(&other, &input)).map(|(a, b)| (a - b).abs());
            offs.zip(scatter(&layers, &input)).map(|(off, scatter)| off / scatter).fold(0.0, f64::max)
        });
        let farthest = farthest.fold(0.0, f64::max);
        assert!(farthest > 100.0, "{farthest}");
    }
}
