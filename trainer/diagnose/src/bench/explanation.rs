//! An explanation that was fitted: its terms, its numbers, its free run.

use std::sync::OnceLock;

use fit::objective::Fitted;
use fit::parameters::ParameterSet;

use super::{Allowed, Bench};

/// An explanation, fitted.
#[derive(Debug, Clone)]
pub struct Explanation {
    /// Indices of its terms in the list of candidates, ascending.
    pub terms: Vec<usize>,
    /// Free parameters: the nominal ones, then those of the terms in order.
    pub set: ParameterSet,
    /// The fit; residuals and Jacobian are emptied to save memory unless asked to be kept.
    pub fitted: Fitted,
    /// Free run over all rows of all recordings.
    pub trace: Vec<f64>,
    /// True where a flapper jumps in it: one jump that comes an instant late throws a free run off until the next.
    pub jumps: bool,
    /// Half the squared shifts of the nominal parameters in prior standard deviations.
    pub prior_cost: f64,
    /// [`Explanation::errors`], once they were asked for.
    pub(super) errors: OnceLock<Allowed>,
}

impl Explanation {
    /// Point of the fit, moved `by` that much in each coordinate, within their bounds.
    pub fn moved(&self, by: &[f64]) -> Vec<f64> {
        let moved = self.fitted.point.iter().zip(by).zip(self.set.bounds());
        moved.map(|((z, by), [low, high])| (z + by).clamp(low, high)).collect()
    }

    /// Point of the fit, with the rig's own parameters as they were given.
    pub fn as_given(&self, bench: &Bench<'_>) -> Vec<f64> {
        let own = bench.nominal.len();
        self.fitted.point.iter().enumerate().map(|(i, z)| if i < own { 0.0 } else { *z }).collect()
    }

    /// [`Bench::drift_of`] its trace, on the bench that it was fitted on.
    pub fn errors(&self, bench: &Bench<'_>) -> &Allowed {
        self.errors.get_or_init(|| bench.drift_of(&self.trace))
    }
}
