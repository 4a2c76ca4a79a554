//! Adam (Kingma & Ba 2015) and the slow copy of a parameter.
//!
//! ```text
//! m ← β₁ m + (1 − β₁) g            v ← β₂ v + (1 − β₂) g²
//! w ← w − η / (1 − β₁ᵗ) · m / (√v / √(1 − β₂ᵗ) + ε)
//! w̄ ← w̄ + τ (w − w̄)                                     (critics only)
//! ```
//! with β₁ = 0.9, β₂ = 0.999 and ε = 10⁻⁸, the defaults of every peer.

use crate::kernel::{Line, zeroed};

const BETA_1: f64 = 0.9;
const BETA_2: f64 = 0.999;
const EPSILON: f32 = 1e-8;

/// Parameters with what their optimiser remembers.
#[derive(Debug, Clone)]
pub(crate) struct Learned {
    pub(crate) value: Vec<Line>,
    pub(crate) mean: Vec<Line>,
    pub(crate) square: Vec<Line>,
    /// The slow copy; empty where none is kept.
    pub(crate) target: Vec<Line>,
}

impl Learned {
    pub(crate) fn zeroed(lines: usize, with_target: bool) -> Self {
        let target = zeroed(if with_target { lines } else { 0 });
        Self { value: zeroed(lines), mean: zeroed(lines), square: zeroed(lines), target }
    }
}

/// The constants of one step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct AdamStep {
    /// `η / (1 − β₁ᵗ)`
    rate: f32,
    /// `1 / √(1 − β₂ᵗ)`
    square_scale: f32,
    /// `τ` of the slow copy.
    follow: f32,
}

impl AdamStep {
    /// The step with number `count`, from 1.
    pub(crate) fn new(count: u64, learning_rate: f32, follow: f32) -> Self {
        let t = count as f64;
        let rate = f64::from(learning_rate) / (1.0 - BETA_1.powf(t));
        let square_scale = 1.0 / (1.0 - BETA_2.powf(t)).sqrt();
        Self { rate: rate as f32, square_scale: square_scale as f32, follow }
    }

    /// One parameter: its new value, mean and square.
    #[inline(always)]
    pub(crate) fn apply(self, value: f32, mean: f32, square: f32, gradient: f32) -> (f32, f32, f32) {
        const KEEP_1: f32 = BETA_1 as f32;
        const TAKE_1: f32 = (1.0 - BETA_1) as f32;
        const KEEP_2: f32 = BETA_2 as f32;
        const TAKE_2: f32 = (1.0 - BETA_2) as f32;
        let mean = TAKE_1.mul_add(gradient, KEEP_1 * mean);
        let square = (TAKE_2 * gradient).mul_add(gradient, KEEP_2 * square);
        let value = value - self.rate * mean / square.sqrt().mul_add(self.square_scale, EPSILON);
        (value, mean, square)
    }

    /// One line of parameters.
    #[inline(always)]
    pub(crate) fn line(self, learned: &mut Learned, at: usize, gradient: &Line) {
        let [value, mean, square] = [&mut learned.value[at].0, &mut learned.mean[at].0, &mut learned.square[at].0];
        for l in 0..gradient.0.len() {
            (value[l], mean[l], square[l]) = self.apply(value[l], mean[l], square[l], gradient.0[l]);
        }
        if let Some(target) = learned.target.get_mut(at) {
            for (target, value) in target.0.iter_mut().zip(value) {
                *target = self.follow.mul_add(*value - *target, *target);
            }
        }
    }
}
