//! Terms in exchange for others: swapped one by one or in pairs, deleted.

use fit::cores::side_by_side_telling;

use super::additions::is_cheaper;
use super::refine::{plainer, refined, richer};
use super::stepped::sharpened;
use super::terms::is_open;
use super::twin::has_its_like;
use super::worth::earns_its_place;
use super::{GLANCE_ROUNDS, PAIR_ROUNDS, PRICE, Round, SearchSettings, cost, starts, values_of, with, without};
use crate::bench::{Bench, Effort, Explanation};
use crate::error::DiagnoseError;
use crate::judge::evidence::evidence;
use crate::judge::left;
use crate::search::candidate::Candidate;
use crate::search::quick_search::{Footing, Glanced};

/// Replaces terms one by one by what stood next to them in earlier rounds, while that lowers the cost.
pub(super) fn swaps(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    mut best: Explanation,
    rounds: &[Round],
    settings: &SearchSettings,
    tried: &mut Vec<Explanation>,
    tell: &mut dyn FnMut(&str, f64),
) -> Result<Explanation, DiagnoseError> {
    // What came close in any round so far.
    let mut close: Vec<usize> =
        rounds.iter().flat_map(|round| round.ranked.iter().take(settings.polished + 1).map(|r| r.candidate)).collect();
    close.sort_unstable();
    close.dedup();
    let mut footing = Footing::of(bench, &best)?;
    for term in best.terms.clone() {
        let rest = without(&best.terms, term);
        // And its own other shape, where that is another only since something stands beside it.
        let shapes = (0..candidates.len()).filter(|k| candidates[*k].differs_beside(&candidates[term]));
        let mut offered: Vec<usize> = shapes.chain(close.iter().copied()).collect();
        offered.retain(|k| !best.terms.contains(k) && is_open(bench, candidates, &rest, *k));
        let swapped = |k: &usize| -> Result<Option<Explanation>, DiagnoseError> {
            let terms = with(&rest, *k);
            let values: Vec<_> = in_place_of(bench, candidates, &best, *k, term).into_iter().collect();
            let starts = starts(bench, candidates, &best, &terms, &values, false);
            // A swap that is far behind after a glance does not overtake.
            let set = bench.set_of(candidates, &terms)?;
            let close = footing.contender(bench, &set, &starts, GLANCE_ROUNDS);
            Ok(close.and_then(|close| bench.fit(candidates, &terms, &[close.point], Effort::Polish).ok()))
        };
        let swaps = side_by_side_telling(&offered, swapped, &mut |share| tell("swapping mechanisms", share));
        let mut swaps: Vec<Explanation> = swaps.into_iter().filter_map(Result::transpose).collect::<Result<_, _>>()?;
        // The first that costs less, as they were ranked: its own other shape comes before other names.
        // What moves in steps fits a little of whatever is wrong: it must be likelier with slow errors allowed for as well.
        let new = |swap: &Explanation| swap.terms.iter().copied().find(|term| !best.terms.contains(term));
        let steps = |swap: &Explanation| new(swap).is_some_and(|term| candidates[term].stepped());
        let cheaper = |swap: &Explanation| cost(bench, swap) < cost(bench, &best) - 1.0;
        let better = |swap: &Explanation| cheaper(swap) && (!steps(swap) || evidence(bench, swap, &best).fitted > 0.0);
        if let Some(at) = swaps.iter().position(better) {
            swaps.truncate(at + 1);
            if let Some(swap) = swaps.last_mut() {
                std::mem::swap(&mut best, swap);
            }
            footing = Footing::of(bench, &best)?;
        }
        tried.extend(swaps);
    }
    Ok(best)
}

/// Cost by which a pair that is to stand in for another may be behind after a glance.
const PAIR_BEHIND: f64 = 2000.0;
/// Such costs in a short search, and after a fit, for a richer shape to be tried.
const PAIR_BEHIND_IN_SHORT: f64 = 1000.0;
const PAIR_BEHIND_FITTED: f64 = 500.0;

/// Another mechanism on both sides.
struct Pair {
    plain: Explanation,
    /// With the richer shapes that fit; not tried where the plain one is too far behind.
    shaped: Option<Explanation>,
}

/// Replaces a mechanism that was found on both sides, as the terms `one` and `other`, by another one on both sides, where that
/// lowers the cost.
///
/// Late valves and late sensors are nearly the same to the readings; once one of each pair stands on one side, its like on
/// the other side fits best, and no exchange of a single term leads over to the other pair.
pub(super) fn pairs(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    (mut best, (one, other)): (Explanation, (usize, usize)),
    rounds: &[Round],
    settings: &SearchSettings,
    tried: &mut Vec<Explanation>,
    tell: &mut dyn FnMut(&str, f64),
) -> Result<Explanation, DiagnoseError> {
    let rest = without(&without(&best.terms, one), other);
    let seen: Vec<usize> = rounds.iter().flat_map(|round| round.ranked.iter().map(|r| r.candidate)).collect();
    let open = |k: usize| is_open(bench, candidates, &rest, k);
    let like = |k: usize, side: &str| {
        (0..candidates.len()).find(|n| {
            let (a, b) = (&candidates[*n], &candidates[k]);
            a.is_like(b) && a.side == side
        })
    };
    let mut pairs: Vec<(usize, usize)> = Vec::new();
    for k in seen.iter().filter(|k| candidates[**k].id != candidates[one].id) {
        let (Some(a), Some(b)) = (like(*k, &candidates[one].side), like(*k, &candidates[other].side)) else { continue };
        if a != b && open(a) && open(b) && !pairs.contains(&(a, b)) {
            pairs.push((a, b));
        }
    }
    let footing = Footing::of(bench, &best)?;
    let behind = if settings.thorough { PAIR_BEHIND } else { PAIR_BEHIND_IN_SHORT };
    let swapped = |(a, b): &(usize, usize)| -> Result<Option<Pair>, DiagnoseError> {
        let terms = with(&with(&rest, *a), *b);
        let values: Vec<(usize, Vec<f64>)> = [(*a, one), (*b, other)]
            .into_iter()
            .filter_map(|(k, term)| in_place_of(bench, candidates, &best, k, term))
            .collect();
        let starts = starts(bench, candidates, &best, &terms, &values, false);
        let set = bench.set_of(candidates, &terms)?;
        // Two terms at once are far from where they will end: a glance may leave them 700 of log-likelihood short.
        let close = footing.contender_within(bench, &set, &starts, PAIR_ROUNDS, behind);
        let fit = |close: Glanced| bench.fit(candidates, &terms, &[close.point], Effort::Polish).ok();
        // Neither pair's plain formula need be the right one: a valve that falls 4 % more slowly than it rises is 150 behind two
        // sensors as a plain lag, and 140 ahead of them with its own.
        let Some(plain) = close.and_then(fit) else { return Ok(None) };
        if !settings.thorough && cost(bench, &plain) > cost(bench, &best) + PAIR_BEHIND_FITTED {
            return Ok(Some(Pair { plain, shaped: None }));
        }
        let shaped = Some(refined(bench, candidates, plain.clone(), 0.0)?);
        Ok(Some(Pair { plain, shaped }))
    };
    let swaps = side_by_side_telling(&pairs, swapped, &mut |share| tell("swapping mechanisms", share));
    let swaps: Vec<Pair> = swaps.into_iter().filter_map(Result::transpose).collect::<Result<_, _>>()?;
    if swaps.is_empty() {
        return Ok(best);
    }
    let mut own = refined(bench, candidates, best.clone(), 0.0)?;
    for Pair { plain, shaped } in swaps {
        tried.push(plain);
        let Some(shaped) = shaped else { continue };
        if is_cheaper(bench, &shaped, &own) {
            own = shaped.clone();
            tried.push(std::mem::replace(&mut best, shaped));
        } else {
            tried.push(shaped);
        }
    }
    Ok(best)
}

/// Where candidate `k` starts in place of `term`: at the same number, where it is of the same unit (a lag for a lag).
fn in_place_of(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    best: &Explanation,
    k: usize,
    term: usize,
) -> Option<(usize, Vec<f64>)> {
    let value = *values_of(bench, candidates, best, term)?.first()?;
    let mut values = candidates[k].starts.first()?.clone();
    let [low, high] = candidates[k].parameters(0).first()?.bounds;
    let (one, other) = (&candidates[k], &candidates[term]);
    if one.unit() != other.unit() || one.unit().is_empty() && one.id != other.id {
        return None;
    }
    *values.first_mut()? = value.clamp(low, high);
    Some((k, values))
}

/// Pairs of terms that are one mechanism at different places.
pub fn twins(candidates: &[Candidate], terms: &[usize]) -> Vec<(usize, usize)> {
    let alike = |a: usize, b: usize| candidates[a].id == candidates[b].id && candidates[a].side != candidates[b].side;
    let behind = |n: usize| terms.iter().skip(n + 1);
    let of_it = |(n, a): (usize, &usize)| behind(n).find(|b| alike(*a, **b)).map(|b| (*a, *b));
    terms.iter().enumerate().filter_map(of_it).collect()
}

/// Removes terms that the others, in a richer shape where one is offered, have made needless; of those that are there
/// `by_likeness`, or have their like on the other side, what is certain to be there stays.
pub(super) fn deletions(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    nominal: &Explanation,
    mut best: Explanation,
    settings: &SearchSettings,
    by_likeness: &[usize],
    tried: &mut Vec<Explanation>,
) -> Result<Explanation, DiagnoseError> {
    for term in best.terms.clone() {
        if best.terms.len() < 2 {
            break;
        }
        let terms = without(&best.terms, term);
        let starts = starts(bench, candidates, &best, &terms, &[], false);
        let footing = Footing::of(bench, &best)?;
        let without_it = footing.contender(bench, &bench.set_of(candidates, &terms)?, &starts, GLANCE_ROUNDS);
        // What a plain shape of another term leaves looks like physics of its own, and so does what is left by one that moves
        // in steps and was not yet quite where it belongs when this one came in.
        let may_be_richer = terms.iter().any(|t| richer(candidates, *t).next().is_some());
        let stepped = terms.iter().any(|t| candidates[*t].stepped());
        if !may_be_richer && !stepped && without_it.is_none() {
            continue;
        }
        let Ok(reduced) = bench.fit(candidates, &terms, &starts, Effort::Polish) else { continue };
        let reduced = sharpened(bench, candidates, reduced, &[])?;
        let reduced = if may_be_richer { refined(bench, candidates, reduced, 0.0)? } else { reduced };
        let found = evidence(bench, &best, &reduced);
        // While much is left, what the rest cannot do without stays: what it does shows little beside what is still missing.
        let needed = cost(bench, &reduced) > cost(bench, &best) + PRICE && found.removed_kpa > settings.bar.removed_kpa;
        let likely = by_likeness.contains(&term) || has_its_like(bench, candidates, &best, term);
        let stays = likely && found.is_certain() || bench.is_much(&left(bench, &best)) && needed;
        if stays || earns_its_place(bench, candidates, settings, &found, [&best, &reduced, nominal]) {
            tried.push(reduced);
        } else {
            best = plainer(bench, candidates, reduced, settings.bar.removed_kpa)?;
        }
    }
    Ok(best)
}
