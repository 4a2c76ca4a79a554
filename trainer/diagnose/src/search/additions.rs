//! A further term: every candidate tried on top of what is found, the best ones fitted to the end.

use std::cmp::Ordering;

use fit::cores::{side_by_side, side_by_side_telling};

use super::stepped::{STEPS, STEPS_IN_SHORT, Spot, scanned, sharpened};
use super::terms::{kinds, open_beside, position_in, starts, starts_at};
use super::worth::any_could_earn;
use super::{GLANCE_ROUNDS, PAIR_ROUNDS, PRICE, PRICE_OF_A_PARAMETER, Ranked, SearchSettings, cost, has_given_way};
use crate::bench::{Bench, Effort, Explanation};
use crate::error::DiagnoseError;
use crate::judge::{explains_most, left};
use crate::search::candidate::Candidate;
use crate::search::quick_search::{Footing, Glanced};
use crate::search::screen::{Screened, Screening, screen};
use crate::search::single_mechanism::by_themselves;

/// Share of the first one's gain at a glance within which others are fitted as well.
const NOT_CONVERGED: f64 = 0.7;
/// Ends of fits of what moves in steps that are looked at closely.
const SHARPENED: usize = 2;

/// Ratio of the candidates that are screened to those that are tried, where an earlier screen tells what to expect.
const FORESEEN: usize = 2;

/// Result of trying every candidate.
#[derive(Default)]
pub(super) struct Additions {
    pub(super) screening: Screening,
    /// After a glance, best first.
    pub(super) ranked: Vec<Ranked>,
    /// The best ones fitted to the end, cheapest first.
    pub(super) polished: Vec<Explanation>,
}

/// Tries every candidate on top of `base`; a short search, of those that an `earlier` screen of every candidate saw, what that makes
/// likely. None is fitted to the end where none gains `least_gain` at a glance.
pub(super) fn additions(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    base: &Explanation,
    settings: &SearchSettings,
    (earlier, least_gain): (Option<&Screening>, f64),
    tell: &mut dyn FnMut(&str, f64),
) -> Result<Additions, DiagnoseError> {
    tell("screening mechanisms", 0.0);
    let mut open = open_beside(bench, candidates, &base.terms);
    if let Some(earlier) = earlier.filter(|_| !settings.thorough) {
        let first = [settings.glanced, settings.paired].map(|first| FORESEEN * first);
        open = earlier.likely(bench, candidates, base, &open, first);
    }
    let screening = screen(bench, candidates, base, &open, settings.look());
    if !base.terms.is_empty() && !any_could_earn(bench, base, &screening, settings.bar.removed_beyond_doubt_kpa) {
        return Ok(Additions { screening, ..Additions::default() });
    }
    let footing = Footing::of(bench, base)?;
    // Parameters that have given way too far lead a fit into a valley of their own.
    let far_off = has_given_way(bench, base);
    let fits = |screened: &&Screened| kinds(candidates, &screened.beside(&base.terms)) <= settings.most_kinds;
    let singles = screening.single.iter().filter(fits).take(settings.glanced);
    let doubles = screening.double.iter().filter(fits).take(settings.paired);
    let asked: Vec<&Screened> = singles.chain(doubles).collect();
    let tried = side_by_side_telling(
        &asked,
        |screened| glanced(bench, candidates, base, &footing, screened, settings.from_prior && far_off),
        &mut |share| tell("trying mechanisms", share),
    );
    let tried: Vec<Option<Tried<'_>>> = tried.into_iter().collect::<Result<_, _>>()?;
    let mut glances: Vec<Tried<'_>> = tried.into_iter().flatten().collect();
    glances.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    let ranked: Vec<Ranked> = glances.iter().filter_map(|tried| tried.ranked(bench, candidates)).collect();
    if glances.first().is_some_and(|first| first.gain < least_gain) {
        return Ok(Additions { screening, ranked, polished: Vec::new() });
    }
    let best = ranked.first().map_or(0.0, |first| first.gain);
    // What is far behind after a glance is not worth a fit, nor is a second place that adds next to nothing. A glance is not
    // converged: where parameters have far to go, what gains less than half of the first at a glance may come out ahead.
    let double = glances.iter().find(|tried| tried.alone().is_none() && tried.gain > best + PRICE);
    let first = double.map_or(best, |double| double.gain);
    let single = glances
        .iter()
        .filter(|tried| tried.alone().is_some() && tried.gain >= first - 20.0 - NOT_CONVERGED * first.abs());
    let close: Vec<&Tried<'_>> = single.collect();
    let polish = if base.terms.is_empty() {
        settings.polished
    } else if bench.is_much(&left(bench, base)) {
        // What gains most beside what was found may be an effect too small for a name, in a channel that hardly scatters. What
        // explains the much that is left is behind it then.
        settings.polished_of_much
    } else if settings.thorough {
        settings.polished
    } else {
        // The first name decides what every later one is: only beside it a short search looks at fewer.
        settings.polished.saturating_sub(1).max(1)
    };
    // What moves in steps fits a little of whatever is wrong: it is never the only one.
    let steps = |tried: &&&Tried<'_>| tried.alone().is_some_and(|k| candidates[k].stepped());
    let polish = polish.max(1 + close.iter().take_while(steps).count());
    let mut chosen: Vec<&Tried<'_>> = double.into_iter().chain(close.iter().copied().take(polish)).collect();
    // What the screen put first is fitted in any case: its glance may have led into a wrong valley.
    let screened_first = screening.single.first().map(|screened| &screened.terms);
    let left_behind = close.iter().skip(polish).find(|tried| Some(&tried.screened.terms) == screened_first);
    chosen.extend(left_behind);
    let wanted = chosen.len();
    let left_out = glances.iter().filter(|tried| chosen.iter().all(|known| known.terms != tried.terms));
    chosen.extend(left_out.collect::<Vec<_>>());
    let fitted = |tried: &&Tried<'_>| near_a_glance(bench, candidates, base, tried, far_off && settings.thorough);
    let (first, behind) = chosen.split_at(wanted.min(chosen.len()));
    let ends = side_by_side_telling(first, fitted, &mut |share| tell("fitting the best", share));
    let mut polished = Vec::new();
    for (tried, ends) in first.iter().zip(ends) {
        polished.extend(placed(bench, candidates, base, tried, ends, &polished, settings.thorough)?);
    }
    // Those behind have their turn where none of the first can be fitted.
    for tried in behind {
        if !polished.is_empty() {
            break;
        }
        polished.extend(placed(bench, candidates, base, tried, fitted(tried), &polished, settings.thorough)?);
    }
    // Parameters that are far off beside the best of them are not believed: something else may need no such shift.
    let best = polished.iter().min_by(|a, b| cheaper(bench, a, b));
    if settings.thorough && best.is_some_and(|best| has_given_way(bench, best)) {
        tell("trying mechanisms by themselves", 0.9);
        polished.extend(by_themselves(bench, candidates, base, settings.polished)?.fitted);
    }
    polished.sort_by(|a, b| cheaper(bench, a, b));
    Ok(Additions { screening, ranked, polished })
}

/// A glance at what the screen offers on top of `base`; `None` where it cannot be run.
fn glanced<'s>(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    base: &Explanation,
    footing: &Footing,
    screened: &'s Screened,
    from_prior: bool,
) -> Result<Option<Tried<'s>>, DiagnoseError> {
    let terms = screened.beside(&base.terms);
    let from = base.moved(&screened.shift);
    let starts = starts_at(bench, candidates, (base, &from), &terms, &screened.terms, from_prior);
    let rounds = if screened.terms.len() > 1 { PAIR_ROUNDS } else { GLANCE_ROUNDS };
    let end = footing.glance(bench, &bench.set_of(candidates, &terms)?, &starts, rounds, f64::INFINITY);
    Ok(end.map(|Glanced { cost, point }| Tried { screened, gain: footing.cost - cost, terms, point }))
}

/// Fits to the end from where a glance has left them, and where parameters that are `far_off` leave much, from the priors' means.
fn near_a_glance(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    base: &Explanation,
    tried: &Tried<'_>,
    far_off: bool,
) -> Vec<Explanation> {
    // What cannot be run in full where a glance has left it (a wall that gives way by more than its chamber holds) is no
    // explanation.
    let warm = bench.fit(candidates, &tried.terms, std::slice::from_ref(&tried.point), Effort::Polish);
    // Where much is left, the priors' means may lead to a better end than parameters that have given way.
    let leaves_much = |e: &Explanation| bench.is_much(&left(bench, e));
    let cold = if far_off && warm.as_ref().map_or(true, leaves_much) {
        let values = &tried.screened.terms;
        let from: Vec<_> = starts(bench, candidates, base, &tried.terms, values, true).into_iter().skip(1).collect();
        bench.fit(candidates, &tried.terms, &from, Effort::Polish).ok()
    } else {
        None
    };
    warm.into_iter().chain(cold).collect()
}

/// The best of some ends of fits; of what moves in steps, of the places too where it may belong, its steps at their moments.
fn placed(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    base: &Explanation,
    tried: &Tried<'_>,
    mut ends: Vec<Explanation>,
    polished: &[Explanation],
    thorough: bool,
) -> Result<Option<Explanation>, DiagnoseError> {
    // Its many fits are spared where something smooth that a glance put first does explain it; in a short search also where that is
    // ahead beside what was found.
    let explained = polished.iter().any(|e| explains_most(&left(bench, base), &left(bench, e)));
    let ahead = |e: &Explanation| ends.iter().all(|end| cost(bench, e) < cost(bench, end));
    let behind = !thorough && !base.terms.is_empty() && polished.iter().any(ahead);
    let stepped = tried.alone().filter(|k| candidates[*k].stepped() && !explained && !behind);
    let found = stepped.and_then(|_| tried.screened.terms.first());
    let steps = if thorough { STEPS } else { STEPS_IN_SHORT };
    let places = found.map_or_else(Vec::new, |(k, values)| scanned(bench, candidates, base, (*k, values), steps));
    let fit =
        |place: &Spot| bench.fit(candidates, &tried.terms, std::slice::from_ref(&place.start), Effort::Polish).ok();
    ends.extend(side_by_side(&places, fit).into_iter().flatten());
    ends.sort_by(|a, b| cost(bench, a).total_cmp(&cost(bench, b)));
    // Before steps come at their moments the right place may be second to a wrong one.
    ends.truncate(if stepped.is_some() { SHARPENED } else { 1 });
    let known: Vec<usize> = if behind { tried.terms.clone() } else { base.terms.clone() };
    let sharp = side_by_side(&ends, |end| sharpened(bench, candidates, end.clone(), &known));
    let sharp = sharp.into_iter().collect::<Result<Vec<Explanation>, _>>()?;
    Ok(sharp.into_iter().min_by(|a, b| cost(bench, a).total_cmp(&cost(bench, b))))
}

/// Which of two explanations costs less, terms and parameters paid for.
pub(super) fn cheaper(bench: &Bench<'_>, one: &Explanation, other: &Explanation) -> Ordering {
    let priced = |explanation: &Explanation| {
        let (terms, parameters) = (explanation.terms.len(), explanation.set.len());
        cost(bench, explanation) + PRICE * terms as f64 + PRICE_OF_A_PARAMETER * parameters as f64
    };
    priced(one).total_cmp(&priced(other))
}

/// Tells whether one explanation costs less than another, as by [`cheaper`].
pub(super) fn is_cheaper(bench: &Bench<'_>, one: &Explanation, other: &Explanation) -> bool {
    cheaper(bench, one, other) == Ordering::Less
}

/// Terms after a glance.
struct Tried<'s> {
    screened: &'s Screened,
    gain: f64,
    terms: Vec<usize>,
    point: Vec<f64>,
}

impl Tried<'_> {
    /// The candidate with its values, where it is one.
    fn ranked(&self, bench: &Bench<'_>, candidates: &[Candidate]) -> Option<Ranked> {
        let candidate = self.alone()?;
        let at = position_in(bench, candidates, &self.terms, candidate)?;
        let coordinates = self.point.get(at..).unwrap_or_default();
        let values = candidates[candidate].parameters(0).iter().zip(coordinates).map(|(p, z)| p.value(*z)).collect();
        Some(Ranked { candidate, gain: self.gain, values })
    }

    /// The candidate, where it is one.
    fn alone(&self) -> Option<usize> {
        match self.screened.terms.as_slice() {
            [(k, _)] => Some(*k),
            _ => None,
        }
    }
}
