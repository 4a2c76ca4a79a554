//! The tanh-Gaussian policy (Haarnoja et al. 2018, appendix C).
//!
//! ```text
//! u = μ + e^s ε,  a = tanh u,  ln π(a) = Σ_j −ε_j²/2 − s_j − ln √(2π) − ln(1 − tanh² u_j)
//! ```
//! with `s = ln σ` limited to its bounds.

use crate::elementary::{exp, ln_tanh_slope, tanh};
use crate::kernel::{Line, Vector, WIDTH, Work};

use crate::batch::{Lanes, NO_LANES};

/// `ln √(2π)`
const LN_ROOT_TAU: f32 = 0.918_938_5;

/// Draws actions from the actor's output.
pub(crate) struct Sample<'a> {
    /// The actor's output: means, then logarithms of standard deviations, two lines each.
    pub(crate) head: &'a [Line],
    /// ε, two lines an action.
    pub(crate) noise: &'a [Line],
    pub(crate) log_std: [f32; 2],
    /// `a`, two lines each.
    pub(crate) action: &'a mut [Line],
    /// `e^s ε = ∂u/∂s`, two lines an action.
    pub(crate) stretch: &'a mut [Line],
}

impl Work for Sample<'_> {
    /// `ln π(a)`
    type Output = Lanes;
    #[inline(always)]
    fn run<V: Vector>(self) -> Lanes {
        let mut log_probability = NO_LANES;
        let count = self.action.len();
        let (mean, log_std) = self.head[..2 * count].split_at(count);
        let outputs = self.action.iter_mut().zip(self.stretch.iter_mut());
        for (n, ((mean, log_std), (action, stretch))) in mean.iter().zip(log_std).zip(outputs).enumerate() {
            let (noise, sum) = (&self.noise[n], &mut log_probability[n % 2]);
            for l in 0..WIDTH {
                let noise = noise.0[l];
                let log_std = log_std.0[l].clamp(self.log_std[0], self.log_std[1]);
                stretch.0[l] = exp(log_std) * noise;
                let u = mean.0[l] + stretch.0[l];
                action.0[l] = tanh(u);
                sum.0[l] += (-0.5 * noise).mul_add(noise, -log_std - LN_ROOT_TAU) - ln_tanh_slope(u);
            }
        }
        log_probability
    }
}

/// The mean actions `tanh μ`, two lines each.
pub(crate) struct MeanAction<'a> {
    pub(crate) head: &'a [Line],
    pub(crate) action: &'a mut [Line],
}

impl Work for MeanAction<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(self) {
        for (mean, action) in self.head.iter().zip(self.action) {
            for l in 0..WIDTH {
                action.0[l] = tanh(mean.0[l]);
            }
        }
    }
}
