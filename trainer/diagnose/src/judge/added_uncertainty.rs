//! Uncertainty of numbers beyond noise: from what is too small for a name, and from formulas that stand for something else.
//!
//! A mechanism that moves no pressure by 0.175 kPa (`REACH_KPA`) is not named, so one may be in any rig beside those that are. With `s` its effect
//! on the readings, `h` what the fitted coordinates give way by to it, and `s⊥` what is left of it then ([`crate::search::screen`]),
//!
//! ```text
//! var_i = cov_ii + Σ h_i² / (1/α² + κ⁻¹ s⊥·W s⊥)      α: as much as moves a pressure by REACH_KPA, one side of a 90 % interval
//! ```
//!
//! over all such mechanisms, each by itself: what a fit with one as well, held near nothing, would state. `κ` is by how much the
//! scores of `s⊥`, added up over groups of readings whose residuals belong together, scatter more than noise does.
//!
//! What is left is that formulas stand for something else: five plays for relays, one temperature for the air in a chamber, a pump whose
//! air leaves as warm as it is in the middle. No residual tells, for the numbers have taken it up. So errors were compared
//! with truths, in recordings of rigs of other physics, and are stated [`FORMULAS`] times as large, which is what that showed.

use fit::objective::NINETY;

use crate::bench::{Bench, Explanation};
use crate::judge::undetectable::small_effects;
use crate::pump::switched::REACH_KPA;
use crate::search::candidate::Candidate;
use crate::search::is_open;
use crate::search::screen::Projector;

/// By how much further than by noise and by the unnamed alone a number is off, as formulas stand for something else: measured.
pub const FORMULAS: f64 = 1.4;

/// Variance to be added to that of each coordinate of an explanation, in units of its prior's, for mechanisms that are too small
/// for a name and may be there beside it, and for formulas that stand for something else.
pub fn variance_beyond_noise(bench: &Bench<'_>, candidates: &[Candidate], explanation: &Explanation) -> Vec<f64> {
    let mut variance = vec![0.0; explanation.fitted.point.len()];
    if let Some(projector) = Projector::of(&explanation.fitted, &explanation.set.prior()) {
        let groupings = bench.groupings();
        for small in
            small_effects(bench, candidates, explanation, |k| is_open(bench, candidates, &explanation.terms, k))
        {
            let sized = projector.sized(small.effect, &groupings);
            let unnamed = (small.moves_kpa * NINETY / REACH_KPA).powi(2);
            for (variance, h) in variance.iter_mut().zip(&sized.shift) {
                *variance += h * h / (unnamed + sized.information);
            }
        }
    }
    for (variance, estimate) in variance.iter_mut().zip(&explanation.fitted.estimates) {
        let by_noise = estimate.undetermined.powi(2);
        *variance = FORMULAS.powi(2) * (by_noise + *variance) - by_noise;
    }
    variance
}
