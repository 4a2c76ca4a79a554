//! What numbers are off by because of what is too small for a name.
//!
//! A mechanism that moves no pressure by 0.175 kPa (`REACH_KPA`) is not named, so one may be in any rig beside those that are. With `s` its effect
//! on the readings, `h` what the fitted coordinates give way by to it, and `s⊥` what is left of it then ([`crate::screen`]),
//!
//! ```text
//! var_i = cov_ii + Σ h_i² / (1/α² + κ⁻¹ s⊥·W s⊥)      α: as much as moves a pressure by REACH_KPA, one side of a 90 % interval
//! ```
//!
//! over all such mechanisms, each by itself: what a fit with one as well, held near nothing, would state. `κ` is by how much the
//! scores of `s⊥`, added up over groups of readings whose residuals belong together, scatter more than noise does.

use fit::objective::NINETY;

use crate::bench::{Bench, Explanation};
use crate::candidate::Candidate;
use crate::hidden::small_effects;
use crate::screen::Projector;
use crate::search::is_open;
use crate::switched::REACH_KPA;

/// Variance of each coordinate of an explanation, in units of its prior's, by mechanisms that are too small for a name and may be
/// there beside it.
pub fn variance_by_the_unnamed(bench: &Bench<'_>, candidates: &[Candidate], explanation: &Explanation) -> Vec<f64> {
    let mut variance = vec![0.0; explanation.fitted.point.len()];
    let Some(projector) = Projector::of(&explanation.fitted, &explanation.set.prior()) else { return variance };
    let groupings = bench.groupings();
    for small in small_effects(bench, candidates, explanation, |k| is_open(bench, candidates, &explanation.terms, k)) {
        let sized = projector.sized(small.effect, &groupings);
        let unnamed = (small.moves_kpa * NINETY / REACH_KPA).powi(2);
        for (variance, h) in variance.iter_mut().zip(&sized.shift) {
            *variance += h * h / (unnamed + sized.information);
        }
    }
    variance
}
