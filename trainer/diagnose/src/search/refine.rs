//! Fits that least squares from where things stand would miss: of other shapes, and from the priors.

use fit::cores::{side_by_side, side_by_side_telling};

use super::stepped::sharpened;
use super::{cost, starts, values_of, with, without};
use crate::bench::{Bench, Effort, Explanation};
use crate::error::DiagnoseError;
use crate::judge::evidence::evidence;
use crate::search::candidate::Candidate;

/// The explanation with plainer shapes of its terms, where the richer ones set right less than is worth a name: a number more takes
/// up what the formula is off by, and with it the numbers that were right.
pub(super) fn plainer(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    mut explanation: Explanation,
    least_kpa: f64,
) -> Result<Explanation, DiagnoseError> {
    for term in explanation.terms.clone() {
        let Some(plain) = (0..candidates.len()).find(|k| candidates[*k].is_plainer_than(&candidates[term])) else {
            continue;
        };
        let Some(fitted) = in_shape(bench, candidates, &explanation, term, plain) else { continue };
        if evidence(bench, &explanation, &fitted).removed_kpa < least_kpa {
            explanation = fitted;
        }
    }
    Ok(explanation)
}

/// Richer shapes that are offered in place of a term: of its own shape, or of another plain one, which may stand nearer to the
/// truth than what was found first.
pub(super) fn richer(candidates: &[Candidate], term: usize) -> impl Iterator<Item = usize> + '_ {
    let found = &candidates[term];
    let of_it =
        move |k: &usize| !found.is_refinement() && candidates[*k].is_refinement() && found.excludes(&candidates[*k]);
    (0..candidates.len()).filter(of_it)
}

/// The explanation with richer shapes of its terms that are offered for what was found, where that sets right what is worth a name.
pub(super) fn refined(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    mut explanation: Explanation,
    least_kpa: f64,
) -> Result<Explanation, DiagnoseError> {
    for term in explanation.terms.clone() {
        let rich: Vec<usize> = richer(candidates, term).collect();
        let fits = side_by_side(&rich, |rich| in_shape(bench, candidates, &explanation, term, *rich));
        for fitted in fits.into_iter().flatten() {
            if evidence(bench, &fitted, &explanation).removed_kpa >= least_kpa {
                explanation = fitted;
                break;
            }
        }
    }
    Ok(explanation)
}

/// The explanation fitted again with `shape` in place of `term`: the numbers that both have start where they are, the others where
/// the shape's own start; `None` if it cannot be run.
///
/// A shape with more numbers also starts with all of its own: of two time constants a plain shape has found one, and not
/// always the one that it is named for.
fn in_shape(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    explanation: &Explanation,
    term: usize,
    shape: usize,
) -> Option<Explanation> {
    let known = values_of(bench, candidates, explanation, term)?;
    let (found, wanted) = (&candidates[term], &candidates[shape]);
    let mut values = wanted.starts.first()?.clone();
    for (key, value) in wanted.keys().zip(values.iter_mut()) {
        if let Some(known) = found.keys().position(|k| k == key).and_then(|i| known.get(i)) {
            *value = *known;
        }
    }
    let terms = with(&without(&explanation.terms, term), shape);
    let mut from = starts(bench, candidates, explanation, &terms, &[(shape, values)], false);
    if wanted.is_refinement() {
        let own = wanted.starts.first()?.clone();
        from.extend(starts(bench, candidates, explanation, &terms, &[(shape, own)], false));
    }
    bench.fit(candidates, &terms, &from, Effort::Polish).ok()
}

/// Fits each of some candidates on top of `base` anew from the priors' means; the best.
///
/// Parameters that have given way to missing physics (a chamber's volume for warm gas: by a third) stand so far off that the
/// slopes there lead nowhere. A glance uses those slopes; this works them out on the way.
pub(super) fn from_priors(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    base: &Explanation,
    among: &[usize],
    tried: &mut Vec<Explanation>,
    tell: &mut dyn FnMut(&str, f64),
) -> Result<Option<Explanation>, DiagnoseError> {
    let mut best: Option<Explanation> = None;
    let from_afar = |k: &usize| {
        let terms = with(&base.terms, *k);
        let middle = candidates[*k].middle_start();
        let cold = starts(bench, candidates, base, &terms, &[(*k, middle)], true).into_iter().skip(1);
        // From so far away some cannot be run at all.
        bench.fit(candidates, &terms, &cold.collect::<Vec<_>>(), Effort::Polish).ok()
    };
    let told = &mut |share| tell("trying again from the priors", share);
    for fitted in side_by_side_telling(among, from_afar, told).into_iter().flatten() {
        if best.as_ref().is_none_or(|best| cost(bench, &fitted) < cost(bench, best)) {
            tried.extend(best.replace(fitted));
        } else {
            tried.push(fitted);
        }
    }
    match best {
        Some(best) => Ok(Some(sharpened(bench, candidates, best, &base.terms)?)),
        None => Ok(None),
    }
}

/// The terms of `base`, whose parameters have given way, fitted anew from the priors' means; `None` where that costs no less.
///
/// A number of a term and a parameter of the rig may stand in for one another over a long way (half of a valve's lag, and a chamber of
/// more than twice the volume), with a ridge between them that no small step crosses.
pub(super) fn anew(bench: &Bench<'_>, candidates: &[Candidate], base: &Explanation) -> Option<Explanation> {
    let cold = starts(bench, candidates, base, &base.terms, &[], true).split_off(1);
    let fitted = bench.fit(candidates, &base.terms, &cold, Effort::Polish).ok()?;
    (cost(bench, &fitted) < cost(bench, base) - 1.0).then_some(fitted)
}
