//! Parameters that have given way to something that was not looked for where it would have been seen.
//!
//! A leak past open valves is taken up by the parameters, be it ever so large, and the fit is as good without it. What speaks
//! for it is where they end: a clearance seventeen standard deviations from what was measured is not believed. The screen sees
//! that, for the priors are in its slopes; a glance does not get there, since over such a way slopes change. So what the screen
//! puts first is fitted, glance or not, where it is a leak: open valves hide leaks alone so well, and a sensor's zero takes up what
//! a formula is off by (play found as another formula was off by enough for one).

use fit::cores::side_by_side_telling;

use super::terms::{open_beside, starts_at};
use super::{PRICE, SearchSettings, cost};
use crate::bench::{Bench, Effort, Explanation};
use crate::judge::left;
use crate::search::candidate::{Candidate, is_leak};
use crate::search::screen::{Screened, Screening, screen};

/// Gain that the screen must see in a term, in log-likelihood and prior, for it to be fitted.
const LEAST: f64 = 10.0;
/// Share of the priors' cost that it must save by what the screen sees.
const LEAST_SAVED: f64 = 0.25;
/// Share of it that is left where parameters are believed again.
const MOST_LEFT: f64 = 0.5;

/// Standard deviations of its prior beyond which a parameter has given way to something that it is not.
const FAR_OFF: f64 = 6.0;

/// Tells whether one of the rig's own parameters has given way to something that it is not.
pub(crate) fn has_given_way(bench: &Bench<'_>, explanation: &Explanation) -> bool {
    explanation.fitted.point.iter().take(bench.nominal.len()).any(|z| z.abs() > FAR_OFF)
}

/// Tells whether an explanation leaves much, and one of the rig's own parameters stands in for something.
pub(super) fn is_led_astray(bench: &Bench<'_>, explanation: &Explanation) -> bool {
    bench.is_much(&left(bench, explanation)) && has_given_way(bench, explanation)
}

/// Tells whether the parameters of `best` are believed again with what is `with` it: most of what they cost the priors is gone.
pub(crate) fn brings_back(best: &Explanation, with: &Explanation) -> bool {
    with.prior_cost < MOST_LEFT * best.prior_cost
}

/// The terms of `best`, whose parameters have given way, and a leak, with which they need not: those that cost less, the best
/// first. `screening` is what the screen said on top of `best`, where it was asked already.
pub(super) fn believed(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    best: &Explanation,
    screening: Option<Screening>,
    settings: &SearchSettings,
    tell: &mut dyn FnMut(&str, f64),
) -> Vec<Explanation> {
    let screened = || {
        let mut open = open_beside(bench, candidates, &best.terms);
        open.retain(|k| settings.thorough || is_leak(candidates, *k));
        screen(bench, candidates, best, &open, settings.look())
    };
    let screening = screening.unwrap_or_else(screened);
    let cost_as_it_is = best.set.prior_cost(&best.fitted.point);
    let saves = |screened: &Screened| cost_as_it_is - best.set.prior_cost(&best.moved(&screened.shift));
    let gains = screening.single.iter().filter(|screened| screened.gain > LEAST);
    let mut first: Vec<(f64, &Screened)> = gains.map(|screened| (saves(screened), screened)).collect();
    first.retain(|(saved, _)| *saved > LEAST_SAVED * best.prior_cost);
    first.sort_by(|(a, _), (b, _)| b.total_cmp(a));
    first.truncate(settings.polished);
    first.retain(|(_, screened)| screened.terms.iter().all(|(k, _)| is_leak(candidates, *k)));
    let needed = cost(bench, best) - PRICE;
    let with_it = |(_, screened): &(f64, &Screened)| {
        let terms = screened.beside(&best.terms);
        let from = starts_at(bench, candidates, (best, &best.moved(&screened.shift)), &terms, &screened.terms, false);
        let fitted = bench.fit(candidates, &terms, &from, Effort::Polish);
        fitted.ok().filter(|e| cost(bench, e) < needed && brings_back(best, e))
    };
    let told = &mut |share| tell("asking what parameters have given way to", share);
    let mut believed: Vec<Explanation> = side_by_side_telling(&first, with_it, told).into_iter().flatten().collect();
    believed.sort_by(|a, b| cost(bench, a).total_cmp(&cost(bench, b)));
    believed
}
