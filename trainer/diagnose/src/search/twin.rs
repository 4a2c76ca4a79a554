//! Likes, on the other side, of what was found on one: two chambers, and two valves, are mostly of one make.

use fit::simulate::Look;

use super::terms::starts;
use super::{SearchSettings, cost, values_of, with};
use crate::bench::{Bench, Effort, Explanation};
use crate::judge::evidence::{CERTAIN, evidence};
use crate::search::candidate::Candidate;
use crate::search::screen::screen;

/// Factor within which both sides of one make have the same number.
const ALIKE: f64 = 2.0;

/// Tells whether two terms of an explanation have numbers as of one make.
fn are_alike(bench: &Bench<'_>, candidates: &[Candidate], explanation: &Explanation, terms: [usize; 2]) -> bool {
    let sizes = terms.map(|t| values_of(bench, candidates, explanation, t).and_then(|v| v.first().copied()));
    matches!(sizes, [Some(a), Some(b)] if (1.0 / ALIKE..=ALIKE).contains(&(a / b)))
}

/// Tells whether an explanation has the like of a term at another place, with a number as of one make.
pub(super) fn has_its_like(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    explanation: &Explanation,
    term: usize,
) -> bool {
    let (found, others) = (&candidates[term], explanation.terms.iter().copied());
    let mut likes = others.filter(|k| candidates[*k].is_like(found) && candidates[*k].component != found.component);
    found.is_of_the_make() && likes.any(|like| are_alike(bench, candidates, explanation, [term, like]))
}

/// Likes on the other side, as far as a search knows them.
#[derive(Default)]
pub(super) struct Likes {
    /// Terms that came in as such.
    pub(super) found: Vec<usize>,
    /// Fits that were made: a round that changes nothing asks the same again.
    fits: Vec<Fit>,
}

/// Factor by which a like may come to gain more than the screen sees, to first order.
const BEYOND_THE_SCREEN: f64 = 5.0;

/// Tells whether a term on top of `base` could be there for certain, by what the screen sees in it.
fn may_be_certain(bench: &Bench<'_>, candidates: &[Candidate], base: &Explanation, term: usize) -> bool {
    let screening = screen(bench, candidates, base, &[term], Look::Roughly);
    screening.single.first().is_none_or(|screened| BEYOND_THE_SCREEN * screened.gain > CERTAIN)
}

/// Terms that were fitted, from where, and what that came to.
struct Fit {
    terms: Vec<usize>,
    from: Vec<Vec<f64>>,
    end: Option<Explanation>,
}

impl Likes {
    /// A fit of some terms, once.
    fn fit(
        &mut self,
        bench: &Bench<'_>,
        candidates: &[Candidate],
        terms: &[usize],
        from: Vec<Vec<f64>>,
    ) -> Option<Explanation> {
        if let Some(known) = self.fits.iter().find(|fit| fit.terms == terms && fit.from == from) {
            return known.end.clone();
        }
        let end = bench.fit(candidates, terms, &from, Effort::Polish).ok();
        self.fits.push(Fit { terms: terms.to_vec(), from, end: end.clone() });
        end
    }
}

/// The explanation with the likes of its terms on the other side, where these are there beyond doubt and of about the same size;
/// what comes in so is noted in `likes`.
///
/// A second effect must set right several hundredths of a kPa to have a name ([`super::worth`]), since what the formulas of the
/// first are off by looks like some small physics or other. It does not look like the same mechanism at the other side, and of
/// the same size there.
pub(super) fn twinned(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    mut best: Explanation,
    settings: &SearchSettings,
    tried: &mut Vec<Explanation>,
    likes: &mut Likes,
) -> Explanation {
    for term in best.terms.clone() {
        let found = &candidates[term];
        let open = |k: &usize| {
            let other = &candidates[*k];
            other.is_like(found)
                && other.component != found.component
                && other.is_of_the_make()
                && best.terms.iter().all(|t| t != k && !candidates[*t].excludes(other))
        };
        let Some(twin) = (0..candidates.len()).find(open) else { continue };
        let Some(values) = values_of(bench, candidates, &best, term) else { continue };
        if !settings.thorough && !may_be_certain(bench, candidates, &best, twin) {
            continue;
        }
        let terms = with(&best.terms, twin);
        let from = starts(bench, candidates, &best, &terms, &[(twin, values)], false);
        // What was tried with the same on both sides may have come further than a fit from here.
        let known = tried.iter().filter(|e| e.terms == terms).cloned();
        let both = known.chain(likes.fit(bench, candidates, &terms, from));
        // What cannot be run on both sides is on one.
        let Some(both) = both.min_by(|a, b| cost(bench, a).total_cmp(&cost(bench, b))) else { continue };
        if are_alike(bench, candidates, &both, [term, twin]) && evidence(bench, &both, &best).is_certain() {
            tried.push(std::mem::replace(&mut best, both));
            likes.found.push(twin);
        } else {
            tried.push(both);
        }
    }
    best
}
