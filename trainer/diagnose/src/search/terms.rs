//! Terms of an explanation: which may stand beside which, and where their parameters lie in its point.

use crate::bench::{Bench, Explanation};
use crate::search::candidate::Candidate;

/// Tells whether candidate `k` can and may be put beside `terms`.
pub fn is_open(bench: &Bench<'_>, candidates: &[Candidate], terms: &[usize], k: usize) -> bool {
    let beside: Vec<&Candidate> = terms.iter().map(|t| &candidates[*t]).collect();
    !terms.contains(&k)
        && !candidates[k].is_refinement()
        && beside.iter().all(|term| !term.excludes(&candidates[k]))
        && candidates[k].is_apt(bench.rig, &beside)
}

/// The candidates that can and may be put beside `terms`.
pub fn open_beside(bench: &Bench<'_>, candidates: &[Candidate], terms: &[usize]) -> Vec<usize> {
    (0..candidates.len()).filter(|k| is_open(bench, candidates, terms, *k)).collect()
}

/// Starts for `terms`: the base's point, and the priors' means of the rig's own parameters. What the base does not have
/// starts from `values`, or from its prior's mean.
pub fn starts(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    base: &Explanation,
    terms: &[usize],
    values: &[(usize, Vec<f64>)],
    from_prior: bool,
) -> Vec<Vec<f64>> {
    starts_at(bench, candidates, (base, &base.fitted.point), terms, values, from_prior)
}

/// As [`starts`], from another point of the base.
pub(super) fn starts_at(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    (base, point): (&Explanation, &[f64]),
    terms: &[usize],
    values: &[(usize, Vec<f64>)],
    from_prior: bool,
) -> Vec<Vec<f64>> {
    let nominal = bench.nominal.len();
    let mut warm: Vec<f64> = point.iter().take(nominal).copied().collect();
    let mut cold = vec![0.0; nominal];
    for term in terms {
        let known = position_of(bench, candidates, base, *term);
        let given = values.iter().find(|(k, _)| k == term).map(|(_, v)| v);
        for (i, parameter) in candidates[*term].parameters(0).iter().enumerate() {
            let of_base = known.and_then(|at| point.get(at + i)).copied();
            let of_values = given.and_then(|v| v.get(i)).map(|v| parameter.coordinate(*v));
            let coordinate = of_base.or(of_values).filter(|z| z.is_finite()).unwrap_or(0.0);
            warm.push(coordinate);
            cold.push(coordinate);
        }
    }
    if from_prior { vec![warm, cold] } else { vec![warm] }
}

/// Where the parameters of a term begin in an explanation's point.
pub fn position_of(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    explanation: &Explanation,
    term: usize,
) -> Option<usize> {
    position_in(bench, candidates, &explanation.terms, term)
}

/// The numbers of a term in an explanation; `None` of one that it has not.
pub fn values_of(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    explanation: &Explanation,
    term: usize,
) -> Option<Vec<f64>> {
    let at = position_of(bench, candidates, explanation, term)?;
    Some(explanation.set.values(&explanation.fitted.point).get(at..at + candidates.get(term)?.len())?.to_vec())
}

/// Where the parameters of a term begin in a point of some terms.
pub(super) fn position_in(bench: &Bench<'_>, candidates: &[Candidate], terms: &[usize], term: usize) -> Option<usize> {
    let before = terms.iter().take(terms.iter().position(|known| *known == term)?);
    Some(bench.nominal.len() + before.map(|known| candidates[*known].len()).sum::<usize>())
}

/// Number of mechanisms among some terms, one that is at several places counted once.
pub fn kinds(candidates: &[Candidate], terms: &[usize]) -> usize {
    let mut ids: Vec<&str> = terms.iter().filter_map(|term| candidates.get(*term)).map(|c| c.id.as_str()).collect();
    ids.sort_unstable();
    ids.dedup();
    ids.len()
}

/// `terms` and `k`, ascending.
pub fn with(terms: &[usize], k: usize) -> Vec<usize> {
    let mut all = terms.to_vec();
    all.push(k);
    all.sort_unstable();
    all
}

/// `terms` without `k`.
pub fn without(terms: &[usize], k: usize) -> Vec<usize> {
    terms.iter().copied().filter(|t| *t != k).collect()
}
