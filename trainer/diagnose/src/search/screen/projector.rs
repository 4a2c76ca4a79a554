//! Gain of an effect beside a fit, to first order.
//!
//! At a fit with residuals `r`, Jacobian `J` and prior `P`, a candidate that moves the readings by `s` gains
//!
//! ```text
//! max over a of  −(a (s·r − s·J h) + ½ a² s⊥·s),     s⊥ = s − J (JᵀWJ + P)⁻¹ JᵀW s,   h = (JᵀWJ + P)⁻¹ (JᵀW r + P z)
//! ```
//!
//! in log-likelihood and prior together, to first order; `h` is what is left to gain without it, nothing at a minimum. Two
//! runs per first magnitude are all it takes; `s` is the effect at that magnitude itself, so `a` near one means that the
//! magnitude was right.

use fit::least_squares::Linearised;
use fit::objective::{Fitted, Projection};
use nalgebra::{DMatrix, DVector};

use crate::bench::LOSS;

/// Least and largest ratio of an effect to what was tried before the screen stops believing in it.
pub const AMPLITUDE: [f64; 2] = [0.05, 2.5];

/// An effect as a linearised fit sees it.
pub(super) struct Effect {
    /// The effect itself, weighted.
    pub(super) of: Vec<f64>,
    /// Products of the effect with the slopes.
    on_slopes: DVector<f64>,
    /// Shifts by which the free parameters' coordinates give way.
    pub(super) shift: DVector<f64>,
    /// `s·r − s·J h`.
    along: f64,
    /// `s⊥·s`.
    pub(super) size: f64,
}

impl Effect {
    /// The most that it can gain, and how large it is then.
    pub(super) fn most(&self) -> (f64, f64) {
        if self.size.is_nan() || self.size <= 1e-9 {
            return (0.0, 1.0);
        }
        let a = (-self.along / self.size).clamp(AMPLITUDE[0], AMPLITUDE[1]);
        (-(a * self.along + 0.5 * a * a * self.size), a)
    }
}

/// A linearised fit, ready to judge effects.
pub struct Projector<'a> {
    at: &'a Linearised,
    /// Effects of the starts: no fit would leave what they explain.
    starts: &'a Projection,
    weights: Vec<f64>,
    factor: nalgebra::Cholesky<f64, nalgebra::Dyn>,
    /// JᵀW r + P z: zero at a minimum.
    gradient: DVector<f64>,
}

impl<'a> Projector<'a> {
    /// The projector of a fit and its priors; `None` if it has no slopes.
    pub fn of(fitted: &'a Fitted, prior: &[f64]) -> Option<Self> {
        Projector::new(&fitted.linearised, &fitted.starts, prior, &fitted.point)
    }

    /// From a fit's residuals and slopes, its starts, its priors and its point; `None` if the slopes are not those of a fit.
    fn new(at: &'a Linearised, starts: &'a Projection, prior: &[f64], point: &[f64]) -> Option<Self> {
        let weights: Vec<f64> = at.residuals.iter().map(|r| LOSS.weight(*r)).collect();
        let n = at.jacobian.len();
        let mut normal = DMatrix::zeros(n, n);
        for (i, column) in at.jacobian.iter().enumerate() {
            for (k, other) in at.jacobian.iter().enumerate().take(i + 1) {
                let sum = dot(column, other, &weights);
                normal[(i, k)] = sum;
                normal[(k, i)] = sum;
            }
            normal[(i, i)] += prior.get(i).copied().unwrap_or(0.0) + 1e-9;
        }
        let factor = normal.cholesky()?;
        let gradient = DVector::from_iterator(
            n,
            at.jacobian
                .iter()
                .zip(prior.iter().zip(point))
                .map(|(column, (p, z))| dot(column, &at.residuals, &weights) + p * z),
        );
        Some(Projector { at, starts, weights, factor, gradient })
    }

    /// Gain of an effect as it is by the loss of the fits, or once the free parameters have given way, whichever is more; and what
    /// they give way by then. Large effects that come at the wrong moments count for no more than in a fit.
    pub fn as_is(&self, effect: &[f64]) -> (f64, Vec<f64>) {
        let still: f64 = self.at.residuals.iter().map(|r| LOSS.cost(*r)).sum();
        let lost = |residuals: &[f64]| residuals.iter().map(|r| LOSS.cost(*r)).sum::<f64>() - still;
        let mut with: Vec<f64> = self.at.residuals.iter().zip(effect).map(|(r, e)| r + e).collect();
        self.starts.apply(&mut with);
        let as_it_is = lost(&with);
        let shift: Vec<f64> = self.seen(effect.to_vec()).shift.iter().copied().collect();
        for (column, by) in self.at.jacobian.iter().zip(&shift) {
            with.iter_mut().zip(column).for_each(|(r, slope)| *r += slope * by);
        }
        let given_way = lost(&with);
        if given_way < as_it_is { (-given_way, shift) } else { (-as_it_is, vec![0.0; shift.len()]) }
    }

    /// Size of an effect, and how well it is known: no better than its scores over groups of readings allow, whose residuals belong
    /// together, in any of these `groupings` (the group of each reading, or `usize::MAX`).
    pub fn sized(&self, effect: Vec<f64>, groupings: &[Vec<usize>]) -> Size {
        let seen = self.seen(effect);
        let best = if seen.size > 0.0 { -seen.along / seen.size } else { 0.0 };
        let shift: Vec<f64> = seen.shift.iter().copied().collect();
        let mut left = seen.of;
        for (column, by) in self.at.jacobian.iter().zip(&shift) {
            for (l, slope) in left.iter_mut().zip(column) {
                *l += slope * by;
            }
        }
        let scores: Vec<f64> =
            left.iter().zip(&self.at.residuals).zip(&self.weights).map(|((l, r), w)| l * r * w).collect();
        let of_noise = seen.size.max(0.0);
        let spread = groupings.iter().map(|groups| spread(&scores, groups)).fold(of_noise, f64::max);
        let information = if of_noise > 0.0 { of_noise * (of_noise / spread) } else { 0.0 };
        Size { shift, best, information }
    }

    /// The most that an effect gains at any size, the free parameters having given way.
    pub(super) fn most(&self, effect: Vec<f64>) -> f64 {
        self.seen(effect).most().0
    }

    /// An effect that was seen with the parameters shifted, less what the slopes make of that shift.
    pub(super) fn without_shift(&self, mut effect: Vec<f64>, shift: &[f64]) -> Vec<f64> {
        for (column, by) in self.at.jacobian.iter().zip(shift) {
            for (e, slope) in effect.iter_mut().zip(column) {
                *e -= slope * by;
            }
        }
        effect
    }

    /// Square of an effect with the free parameters as they are: [`Effect::size`] is what they leave of it.
    pub(super) fn whole(&self, effect: &Effect) -> f64 {
        dot(&effect.of, &effect.of, &self.weights)
    }

    /// An effect as the fit sees it.
    pub(super) fn seen(&self, mut of: Vec<f64>) -> Effect {
        self.starts.apply(&mut of);
        let n = self.at.jacobian.len();
        let on_slopes = DVector::from_iterator(n, self.at.jacobian.iter().map(|c| dot(c, &of, &self.weights)));
        let shift = -self.factor.solve(&on_slopes);
        let along = dot(&of, &self.at.residuals, &self.weights) + shift.dot(&self.gradient);
        let size = dot(&of, &of, &self.weights) + shift.dot(&on_slopes);
        Effect { of, on_slopes, shift, along, size }
    }

    /// The most that two effects can gain together, and how large each is then.
    pub(super) fn most_of_both(&self, one: &Effect, other: &Effect) -> (f64, [f64; 2]) {
        let cross = dot(&one.of, &other.of, &self.weights) + one.shift.dot(&other.on_slopes);
        let determinant = one.size * other.size - cross * cross;
        if determinant.is_nan() || determinant <= 1e-6 * one.size * other.size {
            return (0.0, [1.0; 2]);
        }
        let limited = |a: f64| a.clamp(AMPLITUDE[0], AMPLITUDE[1]);
        let free = [
            (cross * other.along - other.size * one.along) / determinant,
            (cross * one.along - one.size * other.along) / determinant,
        ];
        // Inside the limits the minimum itself; else on one of them, the other effect at its best there.
        let mut at = vec![free.map(limited)];
        for limit in AMPLITUDE {
            at.push([limit, limited(-(other.along + cross * limit) / other.size)]);
            at.push([limited(-(one.along + cross * limit) / one.size), limit]);
        }
        let gain = |[a, b]: [f64; 2]| {
            -(a * one.along + b * other.along) - 0.5 * (a * a * one.size + 2.0 * a * b * cross + b * b * other.size)
        };
        let gains = at.into_iter().map(|at| (gain(at), at));
        gains.max_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((0.0, [1.0; 2]))
    }
}

/// Size of an effect as far as it is known, in multiples of itself.
#[derive(Debug, Clone, PartialEq)]
pub struct Size {
    /// Shifts by which the coordinates give way to the whole effect.
    pub shift: Vec<f64>,
    /// Where it fits best, of either sign: `-(s·r − s·J h) / s⊥·s`.
    pub best: f64,
    /// Information on its size as residuals are: `s⊥·W s⊥` if they are independent, less if they are not.
    pub information: f64,
}

/// Sum of the squares of scores added up over groups.
fn spread(scores: &[f64], groups: &[usize]) -> f64 {
    let count = groups.iter().filter(|group| **group != usize::MAX).max().map_or(0, |group| group + 1);
    let mut sums = vec![0.0; count];
    for (score, group) in scores.iter().zip(groups) {
        if let Some(sum) = sums.get_mut(*group) {
            *sum += score;
        }
    }
    sums.iter().map(|sum| sum * sum).sum()
}

fn dot(a: &[f64], b: &[f64], weights: &[f64]) -> f64 {
    a.iter().zip(b).zip(weights).map(|((a, b), w)| a * b * w).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Residuals are a known multiple of an effect plus what a parameter explains: the gain is the exact one.
    #[test]
    fn gain_is_what_least_squares_would_gain() {
        let n = 50;
        let column: Vec<f64> = (0..n).map(|k| 0.01 * f64::from(k)).collect();
        let effect: Vec<f64> = (0..n).map(|k| 0.01 * f64::from(k * k % 17)).collect();
        // Small residuals, so that Student's weights are all 6/5.
        let residuals: Vec<f64> = column.iter().zip(&effect).map(|(c, e)| 1e-3 * (0.7 * c - e)).collect();
        let (at, starts) = (Linearised { residuals, jacobian: vec![column] }, Projection::default());
        let projector = Projector::new(&at, &starts, &[0.0], &[0.0]).unwrap();
        let scaled: Vec<f64> = effect.iter().map(|e| 1e-3 * e).collect();
        let r = |x: f64, a: f64| -> f64 {
            at.residuals.iter().zip(&at.jacobian[0]).zip(&scaled).map(|((r, c), e)| (r + x * c + a * e).powi(2)).sum()
        };
        // The parameter's column explains 0.7 of it by itself, and the effect the rest.
        let without = (0..2001).map(|k| r(-2e-3 + 2e-6 * f64::from(k), 0.0)).fold(f64::INFINITY, f64::min);
        let with = r(-0.7e-3, 1.0);
        let expected = 0.5 * 1.2 * (without - with);
        let (gain, _) = projector.seen(scaled).most();
        assert!((gain / expected - 1.0).abs() < 1e-3, "{gain} {expected}");
    }

    /// Two effects that overlap, one of which alone would be asked to be negative: together they gain what least squares over
    /// both does, and each is as large as it is.
    #[test]
    fn two_effects_gain_together_what_neither_does_alone() {
        let n = 60;
        let of =
            |f: &dyn Fn(f64) -> f64| -> Vec<f64> { (0..n).map(|k| 1e-3 * f(f64::from(k) / f64::from(n))).collect() };
        let (one, other) = (of(&|t| t), of(&|t| t + 0.3 * t * t));
        let residuals: Vec<f64> = one.iter().zip(&other).map(|(a, b)| -(0.4 * a + 0.7 * b)).collect();
        let (at, starts) = (Linearised { residuals, jacobian: vec![vec![1e-3; n as usize]] }, Projection::default());
        let projector = Projector::new(&at, &starts, &[0.0], &[0.0]).unwrap();
        let (one, other) = (projector.seen(one), projector.seen(other));
        let (gain, [a, b]) = projector.most_of_both(&one, &other);
        assert!((a - 0.4).abs() < 1e-3 && (b - 0.7).abs() < 1e-3, "{a} {b}");
        assert!(gain > one.most().0 && gain > other.most().0);
        // Beyond the limits each stays within them, and the gain is what it is there.
        let far = Linearised { residuals: one.of.iter().map(|a| -9.0 * a).collect(), jacobian: at.jacobian.clone() };
        let projector = Projector::new(&far, &starts, &[0.0], &[0.0]).unwrap();
        let (one, other) = (projector.seen(one.of), projector.seen(other.of));
        let (_, [a, b]) = projector.most_of_both(&one, &other);
        assert!((AMPLITUDE[0]..=AMPLITUDE[1]).contains(&a) && (AMPLITUDE[0]..=AMPLITUDE[1]).contains(&b), "{a} {b}");
    }
}
