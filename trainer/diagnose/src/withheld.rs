//! Names that do not hold: what fits the rows that were fitted, and is spoken against by those kept back, by its own time
//! constant, or by how little it does where the rig works.

use crate::bench::{Bench, Explanation};
use crate::candidate::{Candidate, names_of};
use crate::error::DiagnoseError;
use crate::evidence::{evidence, root_of_drop};
use crate::figures::Figures;
use crate::judge::UNKNOWN_KPA;
use crate::search::{Found, position_of};
use crate::switched::{REACH_KPA, reach_kpa};

/// Why what was found has no name.
pub(crate) struct Objection {
    /// In words, for the notes.
    pub(crate) note: String,
    /// Whether something is missing all the same.
    pub(crate) missing: bool,
}

/// What must be set right on the rows kept back, in kPa, where little is set right elsewhere. A minute of rows tells the
/// root of a drop in mean squared error to a hundredth of a kPa or so.
const KEPT_BACK_KPA: f64 = 0.02;

/// What speaks against naming what was `found`; `None` if it holds. `searched` is what it was found on, `fitted` and `extended` are
/// the figures without and with it.
///
/// # Errors
/// The rig cannot be run without one of its terms.
pub(crate) fn objection(
    searched: &Bench<'_>,
    candidates: &[Candidate],
    found: &Found,
    [fitted, extended]: [&Figures; 2],
) -> Result<Option<Objection>, DiagnoseError> {
    let names = || names_of(candidates, &found.best.terms);
    if !extended.holds_against(fitted, &searched.sigma_kpa()) {
        let note = format!(
            "{} fits what was fitted, but errs more than nothing on the rows kept back ({:.2} kPa instead of {:.2}, or \
             one pressure for the other): something like it, not it",
            names(),
            extended.total_rmse_kpa(),
            fitted.total_rmse_kpa()
        );
        return Ok(Some(Objection { note, missing: true }));
    }
    if let Some(note) = too_fast(searched, candidates, &found.best) {
        return Ok(Some(Objection { note, missing: true }));
    }
    let found_for = evidence(searched, &found.best, &found.nominal);
    let little = found_for.removed_kpa < UNKNOWN_KPA && !found_for.shows_somewhere()
        || reach_kpa(searched, &found.best)? < REACH_KPA;
    // Far from where the rig works (a shut-in, a pump at rest) every model is off a little.
    Ok((little && removed_kpa(fitted, extended) < KEPT_BACK_KPA).then(|| Objection {
        note: format!(
            "{} would fit what was fitted better by {:.2} kPa and changes next to nothing on the rows kept back: \
             too little to be named",
            names(),
            found_for.removed_kpa
        ),
        missing: false,
    }))
}

/// Root of the drop in mean squared error, in kPa; negative if it rose.
fn removed_kpa(without: &Figures, with: &Figures) -> f64 {
    root_of_drop(without.total_rmse_kpa().powi(2) - with.total_rmse_kpa().powi(2))
}

/// What to say of a term that fits best as fast as its kind is told by not being.
fn too_fast(bench: &Bench<'_>, candidates: &[Candidate], best: &Explanation) -> Option<String> {
    best.terms.iter().find_map(|term| {
        let candidate = candidates.get(*term)?;
        let at = position_of(bench, candidates, best, *term)?;
        let estimates = best.fitted.estimates.iter().skip(at).take(candidate.len());
        let (key, least) = candidate.too_fast(&estimates.map(|estimate| estimate.value).collect::<Vec<_>>())?;
        Some(format!(
            "{} fits best with the least {key} that is plausible for it, {least}: something like it, but faster, not it",
            candidate.name()
        ))
    })
}
