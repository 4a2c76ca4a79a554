//! Adam (Kingma & Ba 2015) and the slow copy of a parameter.
//!
//! ```text
//! m ← β₁ m + (1 − β₁) g            v ← β₂ v + (1 − β₂) g²
//! w ← w − η / (1 − β₁ᵗ) · m / (√v / √(1 − β₂ᵗ) + ε)
//! w̄ ← w̄ + τ (w − w̄)                                     (critics only)
//! ```
//! with β₁ = 0.9, β₂ = 0.999 and ε = 10⁻⁸, the defaults of every peer.

use crate::kernel::{Line, Lines, zeroed};

const BETA_1: f64 = 0.9;
const BETA_2: f64 = 0.999;
const EPSILON: f32 = 1e-8;
/// Means and squares below this are zero: neither moves a weight by a bit, its root being 1e-7 of ε. Weights of units that
/// no sample opens any more would keep theirs shrinking until they are subnormal, and a processor takes a hundred cycles
/// for a product with one of those: late in a run that was half of the time of an update.
const TINY: f32 = 1e-30;

/// Parameters with what their optimiser remembers.
#[derive(Debug, Clone)]
pub(crate) struct Learned {
    pub(crate) value: Lines,
    pub(crate) mean: Lines,
    pub(crate) square: Lines,
    /// The slow copy; empty where none is kept.
    pub(crate) target: Lines,
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
        let (mean, square) = (without_tiny(mean), without_tiny(square));
        let size = root(square).mul_add(self.square_scale, EPSILON);
        let value = (-self.rate * mean).mul_add(reciprocal(size), value);
        (value, mean, square)
    }

    /// One line of parameters.
    #[inline(always)]
    pub(crate) fn line(self, learned: &mut Learned, at: usize, gradient: &Line) {
        // Copies, so that the compiler knows the arrays apart.
        let [mut value, mut mean, mut square] = [learned.value[at].0, learned.mean[at].0, learned.square[at].0];
        for l in 0..gradient.0.len() {
            (value[l], mean[l], square[l]) = self.apply(value[l], mean[l], square[l], gradient.0[l]);
        }
        [learned.value[at].0, learned.mean[at].0, learned.square[at].0] = [value, mean, square];
        if let Some(target) = learned.target.get_mut(at) {
            let mut slow = target.0;
            for l in 0..slow.len() {
                slow[l] = self.follow.mul_add(value[l] - slow[l], slow[l]);
            }
            target.0 = slow;
        }
    }
}

/// Zero where it is below [`TINY`] either way; not a number stays that.
#[inline(always)]
fn without_tiny(x: f32) -> f32 {
    if x.abs() < TINY { 0.0 } else { x }
}

// Division and root take the processor 16 and more cycles a vector, which for all parameters is a tenth of an update.
// Newton's iteration from a guess at the exponent needs products alone, and is the same on every machine.

/// `√x` to 3e-7 of it, for `x ≥ 0`; what is below 1e-37 may come out too small, far below ε.
#[inline(always)]
fn root(x: f32) -> f32 {
    let half = 0.5 * x;
    let mut y = f32::from_bits(0x5f37_5a86u32.wrapping_sub(x.to_bits() >> 1));
    for _ in 0..3 {
        // y ← y (3/2 − x y²/2), towards 1/√x; the error squares each time, from 3 %.
        y *= (-half * y).mul_add(y, 1.5);
    }
    x * y
}

/// `1/x` to 2e-7 of it, for `x` between 1e-8 and 1e30.
#[inline(always)]
fn reciprocal(x: f32) -> f32 {
    let mut y = f32::from_bits(0x7ef3_11c3u32.wrapping_sub(x.to_bits()));
    for _ in 0..3 {
        // y ← y (2 − x y); the error squares each time, from 12 %.
        y *= (-x).mul_add(y, 2.0);
    }
    y
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn root_and_reciprocal_are_good_to_a_few_units() {
        // Every octave from 1e-37 to 1e30, and points within.
        for n in 0..200_000 {
            let x = 10.0f64.powf(-36.9 + 66.9 * f64::from(n) / 200_000.0) as f32;
            let (r, wide) = (f64::from(root(x)), f64::from(x));
            assert!((r / wide.sqrt() - 1.0).abs() < 3e-7, "root of {x}: {r}");
            if x > 1e-8 {
                assert!((f64::from(reciprocal(x)) * wide - 1.0).abs() < 2e-7, "reciprocal of {x}");
            }
        }
        assert_eq!(root(0.0), 0.0);
        assert!((0.0..1e-18).contains(&root(1e-40)));
    }

    /// A weight whose gradient is zero must stay where it is, and one whose gradient is not a number must not.
    #[test]
    fn steps_of_nothing_and_of_nan() {
        let step = AdamStep::new(1, 1e-3, 0.0);
        assert_eq!(step.apply(0.5, 0.0, 0.0, 0.0), (0.5, 0.0, 0.0));
        assert!(step.apply(0.5, 0.0, 0.0, f32::NAN).0.is_nan());
        assert!(!step.apply(0.5, 0.0, 0.0, f32::INFINITY).0.is_finite());
    }

    /// Thousands of steps without a gradient: moments end at zero and never stay where numbers are subnormal, and the weight
    /// is where the formula in f64 leaves it.
    #[test]
    fn moments_that_are_left_alone_end_at_zero() {
        let (mut ours, mut exact) = ((0.5f32, 1e-3f32, 1e-6f32), (0.5f64, 1e-3f64, 1e-6f64));
        for n in 1..=150_000u64 {
            ours = AdamStep::new(n, 3e-4, 0.0).apply(ours.0, ours.1, ours.2, 0.0);
            let t = n as i32;
            (exact.1, exact.2) = (0.9 * exact.1, 0.999 * exact.2);
            let (m, v) = (exact.1 / (1.0 - 0.9f64.powi(t)), exact.2 / (1.0 - 0.999f64.powi(t)));
            exact.0 -= 3e-4 * m / (v.sqrt() + 1e-8);
            assert!(!ours.1.is_subnormal() && !ours.2.is_subnormal(), "step {n}: {ours:?}");
        }
        assert_eq!((ours.1, ours.2), (0.0, 0.0));
        // A few roundings of a half while it still moves.
        assert!((f64::from(ours.0) - exact.0).abs() < 1e-6 && exact.0 < 0.4999, "{} {}", ours.0, exact.0);
    }

    /// The published formula in f64 over a thousand steps of a wandering gradient.
    #[test]
    fn a_thousand_steps_are_the_formula() {
        let (mut ours, mut exact) = ((1.0f32, 0.0f32, 0.0f32), (1.0f64, 0.0f64, 0.0f64));
        for n in 1..=1000u64 {
            let g = ((n * 7919 % 1000) as f32 / 500.0 - 0.9) * 1e-3;
            ours = AdamStep::new(n, 3e-4, 0.0).apply(ours.0, ours.1, ours.2, g);
            let (t, g) = (n as i32, f64::from(g));
            exact.1 = 0.9 * exact.1 + 0.1 * g;
            exact.2 = 0.999 * exact.2 + 0.001 * g * g;
            let (m, v) = (exact.1 / (1.0 - 0.9f64.powi(t)), exact.2 / (1.0 - 0.999f64.powi(t)));
            exact.0 -= 3e-4 * m / (v.sqrt() + 1e-8);
        }
        // A thousand roundings of a number near one, 6e-8 each, as a random walk: 2e-6; five of that.
        assert!((f64::from(ours.0) - exact.0).abs() < 1e-5, "{} {}", ours.0, exact.0);
        assert!((exact.0 - 1.0).abs() > 0.01);
    }
}
