//! Which candidates are worth a fit: each one's effect, less what the free parameters could do instead.
//!
//! At a fit with residuals `r`, Jacobian `J` and prior `P`, a candidate that moves the readings by `s` gains
//!
//! ```text
//! max over a of  −(a (s·r − s·J h) + ½ a² s⊥·s),     s⊥ = s − J (JᵀWJ + P)⁻¹ JᵀW s,   h = (JᵀWJ + P)⁻¹ (JᵀW r + P z)
//! ```
//!
//! in log-likelihood and prior together, to first order; `h` is what is left to gain without it, nothing at a minimum. One run per first magnitude is all it takes; `s` is the effect at that
//! magnitude itself, so `a` near one means that the magnitude was right.

use fit::least_squares::Linearised;
use fit::simulate::Run;
use model::rig::Rig;
use nalgebra::{DMatrix, DVector};

use crate::bench::{Bench, Explanation, LOSS};
use crate::candidate::Candidate;
use crate::glance::weighted;

/// What the screen says of a candidate.
#[derive(Debug, Clone, PartialEq)]
pub struct Screened {
    /// Index of the candidate.
    pub candidate: usize,
    /// Gain in log-likelihood at its best first magnitude, to first order.
    pub gain: f64,
    /// That magnitude.
    pub start: Vec<f64>,
}

/// How much weaker or stronger than tried an effect may turn out to be before the screen stops believing in it.
const AMPLITUDE: [f64; 2] = [0.05, 2.5];

/// Screens candidates on top of an explanation; strongest first.
pub fn screen(bench: &Bench<'_>, candidates: &[Candidate], base: &Explanation, open: &[usize]) -> Vec<Screened> {
    let prior = base.set.prior();
    let fitted = &base.fitted;
    let Some(projector) = Projector::new(&fitted.linearised, &prior, &fitted.point) else {
        return Vec::new();
    };
    let mut tries: Vec<(usize, &Vec<f64>)> = Vec::new();
    let mut runs = vec![Run::from(fitted.rig.clone())];
    for k in open {
        let Some(candidate) = candidates.get(*k) else { continue };
        for start in &candidate.starts {
            let mut rig: Rig = fitted.rig.clone();
            rig.mechanisms.push(candidate.attached(start));
            tries.push((*k, start));
            runs.push(Run::from(rig));
        }
    }
    let mut traces = bench.fast.run(&runs, &fitted.arcs).into_iter();
    let Some(Ok(still)) = traces.next() else { return Vec::new() };
    let weights = bench.weighted(&fitted.scale_kpa);
    let mut best: Vec<Screened> = Vec::new();
    for ((k, start), trace) in tries.into_iter().zip(traces) {
        let Ok(trace) = trace else { continue };
        let effect = weighted(&still, &trace, &[], &weights);
        if effect.iter().any(|e| !e.is_finite()) {
            continue;
        }
        let gain = projector.gain(&effect);
        match best.iter_mut().find(|s| s.candidate == k) {
            Some(known) if known.gain >= gain => {}
            Some(known) => (known.gain, known.start) = (gain, start.clone()),
            None => best.push(Screened { candidate: k, gain, start: start.clone() }),
        }
    }
    best.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    best
}

/// A linearised fit, ready to judge effects.
pub struct Projector<'a> {
    at: &'a Linearised,
    weights: Vec<f64>,
    factor: nalgebra::Cholesky<f64, nalgebra::Dyn>,
    /// JᵀW r + P z: zero at a minimum.
    gradient: DVector<f64>,
}

impl<'a> Projector<'a> {
    /// From a fit's residuals and slopes, its priors and its point; `None` if the slopes are not those of a fit.
    pub fn new(at: &'a Linearised, prior: &[f64], point: &[f64]) -> Option<Self> {
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
        Some(Projector { at, weights, factor, gradient })
    }

    /// What an effect gains as it is, the free parameters having given way.
    pub fn gain_as_is(&self, effect: &[f64]) -> f64 {
        let (along, size) = self.along_and_size(effect);
        -(along + 0.5 * size)
    }

    /// The most that an effect can gain.
    fn gain(&self, effect: &[f64]) -> f64 {
        let (along, size) = self.along_and_size(effect);
        if size.is_nan() || size <= 1e-9 {
            return 0.0;
        }
        let a = (-along / size).clamp(AMPLITUDE[0], AMPLITUDE[1]);
        -(a * along + 0.5 * a * a * size)
    }

    /// `s·r − s·J h` and `s⊥·s`.
    fn along_and_size(&self, effect: &[f64]) -> (f64, f64) {
        let n = self.at.jacobian.len();
        let on_effect = DVector::from_iterator(n, self.at.jacobian.iter().map(|c| dot(c, effect, &self.weights)));
        let solved = self.factor.solve(&on_effect);
        let along = dot(effect, &self.at.residuals, &self.weights) - solved.dot(&self.gradient);
        (along, dot(effect, effect, &self.weights) - solved.dot(&on_effect))
    }
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
        let at = Linearised { residuals, jacobian: vec![column] };
        let projector = Projector::new(&at, &[0.0], &[0.0]).unwrap();
        let scaled: Vec<f64> = effect.iter().map(|e| 1e-3 * e).collect();
        let r = |x: f64, a: f64| -> f64 {
            at.residuals.iter().zip(&at.jacobian[0]).zip(&scaled).map(|((r, c), e)| (r + x * c + a * e).powi(2)).sum()
        };
        // The parameter's column explains 0.7 of it by itself, and the effect the rest.
        let without = (0..2001).map(|k| r(-2e-3 + 2e-6 * f64::from(k), 0.0)).fold(f64::INFINITY, f64::min);
        let with = r(-0.7e-3, 1.0);
        let expected = 0.5 * 1.2 * (without - with);
        assert!((projector.gain(&scaled) / expected - 1.0).abs() < 1e-3, "{} {expected}", projector.gain(&scaled));
    }
}
