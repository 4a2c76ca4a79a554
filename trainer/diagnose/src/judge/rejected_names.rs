//! Names that do not hold: what fits the rows that were fitted, and is spoken against by those kept back (it makes them worse, or
//! leaves more of what was wrong there than a name may), by its own time constant, by a formula without a name that explains
//! what it leaves, or by how little it does where the rig works.

use fit::data::Role;
use fit::parameters::ParameterSet;

use crate::bench::{Bench, Effort, Explanation};
use crate::error::DiagnoseError;
use crate::judge::evidence::{Bar, CERTAIN, Evidence, evidence, root_of_drop};
use crate::judge::large_error::UNKNOWN_KPA;
use crate::judge::range_ends::at_an_end;
use crate::judge::{FLOOR_KPA, explains_most, left};
use crate::pump::switched::{REACH_KPA, reach_kpa, stands_somewhere};
use crate::report::figures::Figures;
use crate::search::candidate::{Candidate, is_leak, names_of};
use crate::search::{Found, cost, position_of, values_of};
use crate::unknown::{Formula, dead_end};

/// Why what was found has no name.
pub(crate) struct Objection {
    /// In words, for the notes.
    pub(crate) note: String,
    /// True where something is missing all the same.
    pub(crate) missing: bool,
    /// A formula without a name that explains it.
    pub(crate) formula: Option<Formula>,
}

/// Error that must be set right on the rows kept back, in kPa, where little is set right elsewhere. A minute of rows
/// tells the root of a drop in mean squared error to a hundredth of a kPa or so.
const KEPT_BACK_KPA: f64 = 0.02;
/// Such an error for what is beyond doubt on the rows that were fitted.
const KEPT_BACK_BEYOND_DOUBT_KPA: f64 = 0.01;

/// Objection to naming what was `found`; `None` if it holds. `searched` is what it was found on, `fitted` and `extended` are the
/// figures without and with it.
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
            "{} fits what was fitted, but errs more than nothing on validation data ({:.2} kPa instead of {:.2}, or \
             one pressure for the other): something like it, not it",
            names(),
            extended.total_rmse_kpa(),
            fitted.total_rmse_kpa()
        );
        return Ok(Some(Objection { note, missing: true, formula: None }));
    }
    let [before_kpa, left_kpa] = [fitted, extended].map(|figures| figures.beyond_noise_kpa(&searched.sigma_kpa()));
    // One jump that comes late throws a free run off, right as its cause may be.
    if !found.best.jumps && searched.is_more_than_a_name_may_leave(&left_kpa) && !explains_most(&before_kpa, &left_kpa)
    {
        let note = format!(
            "{} fits what was fitted, but leaves more than a name may on validation data ({:.2} kPa of {:.2}): something like it, \
             not it",
            names(),
            extended.total_rmse_kpa(),
            fitted.total_rmse_kpa()
        );
        return Ok(Some(Objection { note, missing: true, formula: None }));
    }
    if let Some(note) = at_an_end(searched, candidates, &found.best) {
        return Ok(Some(Objection { note, missing: true, formula: None }));
    }
    if let Some(note) = too_fast(searched, candidates, &found.best) {
        return Ok(Some(Objection { note, missing: true, formula: None }));
    }
    if let Some((formula, note)) = only_resembles(searched, found, &names()) {
        return Ok(Some(Objection { note, missing: true, formula: Some(formula) }));
    }
    let found_for = evidence(searched, &found.best, &found.nominal);
    let little = found_for.removed_kpa < UNKNOWN_KPA && !found_for.shows_somewhere()
        || reach_kpa(searched, &found.best)? < REACH_KPA;
    let least_kpa = if found_for.is_beyond_doubt() { KEPT_BACK_BEYOND_DOUBT_KPA } else { KEPT_BACK_KPA };
    // Far from where the rig works (a shut-in, a pump at rest) every model is off a little.
    Ok((little && removed_kpa(fitted, extended) < least_kpa).then(|| Objection {
        note: format!(
            "{} would fit what was fitted better by {:.2} kPa and changes next to nothing on validation data: \
             too little to be named",
            names(),
            found_for.removed_kpa
        ),
        missing: false,
        formula: None,
    }))
}

/// Tells whether all that was found are leaks that show while a pump stands and move nothing by [`REACH_KPA`] elsewhere: which of
/// them it is need not be told for them to be too small.
///
/// # Errors
/// The rig cannot be simulated without one of them.
pub(crate) fn are_leaks_too_small(
    searched: &Bench<'_>,
    candidates: &[Candidate],
    best: &Explanation,
) -> Result<bool, DiagnoseError> {
    let leaks = !best.terms.is_empty() && best.terms.iter().all(|term| is_leak(candidates, *term));
    Ok(leaks && stands_somewhere(searched) && reach_kpa(searched, best)? < REACH_KPA)
}

/// Root of the drop in mean squared error, in kPa; negative if it rose.
fn removed_kpa(without: &Figures, with: &Figures) -> f64 {
    root_of_drop(without.total_rmse_kpa().powi(2) - with.total_rmse_kpa().powi(2))
}

/// A dead end of a chamber, and what to say of it, where that explains most of what known physics leaves and would pass as a
/// further term of it: gas that warms comes near to it.
fn only_resembles(searched: &Bench<'_>, found: &Found, names: &str) -> Option<(Formula, String)> {
    let left_kpa = left(searched, &found.best);
    if left_kpa.iter().all(|kpa| *kpa < FLOOR_KPA) {
        return None;
    }
    let formula = dead_end(searched, &found.nominal)?;
    let with_it = &formula.term.explanation;
    let left_with_it_kpa = left(searched, with_it);
    let parameters = with_it.set.len().saturating_sub(found.best.set.len()).max(1);
    let passes = |e: &Evidence| Bar::default().passed(e, parameters, 1, searched.blocks(Role::Fit).len());
    let explains = explains_most(&left_kpa, &left_with_it_kpa) && passes(&evidence(searched, with_it, &found.best));
    let most = |kpa: &[f64]| kpa.iter().copied().fold(0.0, f64::max);
    let note = format!(
        "{names} leaves {:.2} kPa beside the noise where a dead end leaves {:.2}: something like it, not it",
        most(&left_kpa),
        most(&left_with_it_kpa)
    );
    explains.then_some((formula, note))
}

/// Times as slow as is plausible at least that a kind is tried to be which fits best as fast as that.
const SLOWER: f64 = 2.0;

/// Note on a term that fits best as fast as no part of its kind plausibly is; `None` where none does.
fn too_fast(bench: &Bench<'_>, candidates: &[Candidate], best: &Explanation) -> Option<String> {
    best.terms.iter().find_map(|term| {
        let candidate = candidates.get(*term)?;
        let (place, key, least) = candidate.too_fast(&values_of(bench, candidates, best, *term)?)?;
        let at = position_of(bench, candidates, best, *term)? + place;
        // Of a small effect no reading tells how fast it is.
        (!fits_as_slow(bench, best, at, SLOWER * least)).then(|| {
            format!(
                "{} fits best with the least {key} that is plausible for it, {least}: something like it, but faster, not it",
                candidate.name()
            )
        })
    })
}

/// Tells whether an explanation with one of its parameters at `least` or more is no further behind than what is certain is ahead.
fn fits_as_slow(bench: &Bench<'_>, best: &Explanation, at: usize, least: f64) -> bool {
    let refitted = |low: Option<f64>| -> Option<f64> {
        let (mut free, mut start) = (best.set.parameters().to_vec(), best.fitted.point.clone());
        if let Some(low) = low {
            let parameter = free.get_mut(at)?;
            parameter.bounds[0] = low.min(parameter.bounds[1]);
            *start.get_mut(at)? = parameter.coordinate(low);
        }
        let set = ParameterSet::new(best.set.rig(), free).ok()?;
        Some(cost(bench, &bench.fit_set(&best.terms, set, &[start], Effort::Polish).ok()?))
    };
    refitted(None).zip(refitted(Some(least))).is_some_and(|(free, slower)| slower - free < CERTAIN)
}

#[cfg(test)]
mod tests {
    use fit::data::Records;

    use super::*;
    use crate::made::{self, made_after, moved};
    use crate::search::candidate::candidates;

    /// Something as quick as 5 s is no coil where it shows plainly; where it hardly does, a slower one would do as well.
    #[test]
    fn only_what_shows_is_told_by_how_fast_it_is() {
        let (rig, _) = moved(&[]);
        let all = candidates(&rig);
        let coil = all.iter().position(|candidate| candidate.name() == "coil_heating:negative").unwrap();
        let said = |rise: f64| {
            let mut truth = rig.clone();
            truth.mechanisms.push(all[coil].attached(&[rise, 5.0]));
            let records = Records::new(&rig, &made_after(0, 3000, &truth, 1, 11)).unwrap();
            let bench = made::bench(&rig, &records);
            let mut start = vec![0.0; bench.nominal.len()];
            start.extend(all[coil].parameters(0).iter().zip([rise, 15.0]).map(|(p, value)| p.coordinate(value)));
            let best = bench.fit(&all, &[coil], &[start], Effort::Polish).unwrap();
            let at_its_end = all[coil].too_fast(&values_of(&bench, &all, &best, coil).unwrap()).is_some();
            (at_its_end, too_fast(&bench, &all, &best))
        };
        let (at_its_end, note) = said(0.08);
        assert!(at_its_end && note.is_some_and(|note| note.contains("coil_heating:negative fits best with the least")));
        let (at_its_end, note) = said(0.004);
        assert!(at_its_end && note.is_none(), "{at_its_end} {note:?}");
    }
}
