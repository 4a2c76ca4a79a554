//! Which terms belong into the model: added one by one, swapped, deleted.
//!
//! | file | subject |
//! | --- | --- |
//! | `additions` | a further term: every candidate tried on top of what is found |
//! | `believed` | a further term that parameters have given way to |
//! | `worth` | what a further term must show to be taken |
//! | `exchange` | terms in exchange for others |
//! | `late` | late valves and late sensors in exchange for one another |
//! | `usual` | all that is usual at once, where a search has ended far from the data |
//! | `refine` | fits that least squares from where things stand would miss |
//! | `stepped` | what moves in steps, or begins at a moment |
//! | `slips` | what sticks and slips, found in pieces that forget a slip that came late |
//! | `twin` | what was found on one side, on the other |
//! | `terms` | which terms may stand beside which, and where their parameters lie |

pub mod candidate;
pub mod place;
pub mod quick_search;
pub mod screen;
pub mod single_mechanism;

use fit::simulate::Look;

use crate::bench::{Bench, Effort, Explanation};
use crate::error::DiagnoseError;
use crate::judge::evidence::{Bar, Evidence, evidence};
use crate::judge::{excess, explains_most, left};
use crate::search::candidate::Candidate;
use crate::search::screen::Screening;

mod additions;
mod believed;
mod exchange;
mod late;
mod refine;
mod slips;
mod stepped;
mod terms;
mod twin;
mod usual;
mod worth;

use additions::{Additions, additions, cheaper, is_cheaper};
use believed::{believed, is_led_astray};
pub(crate) use believed::{brings_back, has_given_way};
pub use exchange::twins;
use exchange::{deletions, pairs, swaps};
use late::exchanged_late;
pub(crate) use late::{LATE_SENSOR, LATE_VALVES, late_in_place_of};
use refine::{anew, from_priors, plainer, refined, richer};
use slips::in_pieces;
pub(crate) use stepped::lying_where;
use stepped::sharpened;
pub use terms::{is_open, kinds, open_beside, position_of, starts, values_of, with, without};
use twin::{Likes, twinned};
use usual::usual_at_once;
use worth::{earns_its_place, least_gain, leaves_room};

/// Settings of a search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SearchSettings {
    /// The most kinds of terms ([`kinds`]): backlash, lag and delay of both valves and warm gas are seven terms of four kinds.
    pub most_kinds: usize,
    /// Number of the best candidates of a round that are fitted to the end.
    pub polished: usize,
    /// The same beside what was found, where that leaves much.
    pub polished_of_much: usize,
    /// Number of candidates, those that the screen puts first, that are fitted at all.
    pub glanced: usize,
    /// Number of pairs, those that it puts first, that are fitted.
    pub paired: usize,
    /// True where candidates are also tried from the priors' means.
    pub from_prior: bool,
    /// True where the search looks as well where much time seldom brings an answer to light: fits from the priors' means once
    /// nothing passes, mechanisms by themselves from the build sheet, a grid of bands for what moves in steps and is behind beside
    /// what was found, one term further than a pair, pairs in exchange for what was found on both sides that are far behind, or
    /// again after each term, what comes near the bar by a noise that is less than it was taken for. What else a short search
    /// leaves out is told where it is.
    pub thorough: bool,
    /// Bar that a term must pass.
    pub bar: Bar,
}

impl SearchSettings {
    /// The whole search, for a rig whose pump was switched in the recordings or not.
    pub fn whole(switched: bool) -> Self {
        let bar = if switched { Bar::of_experiments() } else { Bar::default() };
        SearchSettings {
            most_kinds: 4,
            glanced: 6,
            paired: 3,
            polished: 3,
            polished_of_much: 6,
            from_prior: true,
            thorough: true,
            bar,
        }
    }

    /// A short one: the same in most cases (docs/diagnose-hidden-suite.md), in two thirds of the time where a rig lacks one or two
    /// mechanisms.
    pub fn short(switched: bool) -> Self {
        SearchSettings { thorough: false, ..Self::whole(switched) }
    }

    /// Closeness with which the screen looks for where flappers lay.
    fn look(&self) -> Look {
        if self.thorough { Look::Evenly } else { Look::Roughly }
    }

    /// For a round that is only there to see whether something follows.
    fn looking_ahead(&self) -> Self {
        SearchSettings { polished: 1, polished_of_much: 1, paired: 1, ..*self }
    }
}

/// A round of additions.
#[derive(Debug, Clone, PartialEq)]
pub struct Round {
    /// Terms before the round.
    pub base: Vec<usize>,
    /// Candidates after a glance, best first.
    pub ranked: Vec<Ranked>,
    /// Terms that the best one after fits to the end adds, ascending.
    pub best: Vec<usize>,
    /// Evidence for the best one against the base.
    pub evidence: Option<Evidence>,
    /// True where the best one was taken.
    pub taken: bool,
}

impl Round {
    /// Notes the best that was fitted to the end, and its evidence.
    fn shows(&mut self, best: &Explanation, found: Evidence) {
        self.best = best.terms.iter().copied().filter(|term| !self.base.contains(term)).collect();
        self.evidence = Some(found);
    }
}

/// A candidate after a glance.
#[derive(Debug, Clone, PartialEq)]
pub struct Ranked {
    /// Which.
    pub candidate: usize,
    /// Gain in log-likelihood and prior.
    pub gain: f64,
    /// Values of its parameters there.
    pub values: Vec<f64>,
}

/// Result of a search.
pub struct Found {
    /// The rig with its parameters fitted and nothing added.
    pub nominal: Explanation,
    /// The best explanation.
    pub best: Explanation,
    /// Terms of it that are there since the same is on the other side, with the same number.
    pub by_likeness: Vec<usize>,
    /// The strongest candidate that was not taken, on top of the best explanation.
    pub next: Option<Explanation>,
    /// Rounds in order.
    pub rounds: Vec<Round>,
    /// Every explanation that was fitted to the end.
    pub tried: Vec<Explanation>,
}

/// Searches among `candidates`, from the rig's own parameters at `start` (near their best without any term).
///
/// # Errors
/// The rig itself cannot be fitted.
pub fn search(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    start: &[f64],
    settings: &SearchSettings,
    tell: &mut dyn FnMut(&str, f64),
) -> Result<Found, DiagnoseError> {
    let nominal = bench.fit(candidates, &[], &[start.to_vec()], Effort::Polish)?;
    let mut best = nominal.clone();
    let mut rounds = Vec::new();
    let mut tried = Vec::new();
    let mut next = None;
    let mut likes = Likes::default();
    let mut stood: Vec<Vec<usize>> = Vec::new();
    // What is on both sides and need not be exchanged again in a short search.
    let mut exchanged: Vec<(usize, usize)> = Vec::new();
    // What was taken last in richer shapes, where these wait.
    let mut waiting: Option<Explanation> = None;
    // The last one of every candidate: in a short search the first, which tells the later ones what to expect.
    let mut screened: Option<(Vec<usize>, Screening)> = None;
    // What is added and then deleted again would be added once more, and so on.
    while kinds(candidates, &best.terms) < settings.most_kinds && !stood.contains(&best.terms) {
        if !best.terms.is_empty() && !leaves_room(bench, settings, &best) {
            break;
        }
        stood.push(best.terms.clone());
        // Slopes where parameters have given way say little of what comes: what is behind at a glance is looked at as well.
        let explained =
            !best.terms.is_empty() && !is_unexplained(bench, &nominal, &best) && !is_led_astray(bench, &best);
        let least_gain = if explained && !settings.thorough { least_gain(bench, &nominal, &best) } else { 0.0 };
        let earlier = screened.as_ref().map(|(_, screening)| screening);
        let Additions { screening, ranked, mut polished } =
            additions(bench, candidates, &best, settings, (earlier, least_gain), tell)?;
        if settings.thorough || screened.is_none() {
            screened = Some((best.terms.clone(), screening));
        }
        if polished.is_empty() {
            if !ranked.is_empty() {
                rounds.push(Round { base: best.terms.clone(), ranked, best: Vec::new(), evidence: None, taken: false });
            }
            break;
        }
        polished.extend(tried_beside(&best, &mut tried, &polished));
        polished.sort_by(|a, b| cheaper(bench, a, b));
        before_what_steps(bench, candidates, &best, &mut polished);
        let Some(first) = polished.first().cloned() else { break };
        let earns = |with: &Explanation| {
            let found = evidence(bench, with, &best);
            (earns_its_place(bench, candidates, settings, &found, [with, &best, &nominal]), found)
        };
        // A plainer shape sets no more right: in a short search it is not fitted where the richer one is not taken.
        let may_be_plainer = settings.thorough || earns(&first).0;
        let mut top = if may_be_plainer { plainer(bench, candidates, first, settings.bar.removed_kpa)? } else { first };
        let (mut taken, mut found) = earns(&top);
        // Where little is left, what costs least may do so by slow errors of the formulas, which no name stands for.
        if !taken {
            let earned = polished.iter().skip(1).map(|other| (other, earns(other))).find(|(_, (earned, _))| *earned);
            if let Some((other, its)) = earned {
                (top, (taken, found)) = (other.clone(), its);
            }
        }
        let missed: Vec<usize> = ranked.iter().map(|r| r.candidate).collect();
        let mut round = Round { base: best.terms.clone(), ranked, best: Vec::new(), evidence: None, taken };
        round.shows(&top, found);
        tried.extend(polished);
        // What sticks and slips passes for itself with a wrong band: then the rest of it is still there.
        let sticks = top.terms.iter().any(|term| !best.terms.contains(term) && candidates[*term].stepped());
        if taken
            && sticks
            && bench.is_much(&left(bench, &top))
            && let Some(slips) = in_pieces(bench, candidates, &best, settings, &tried, Some(&top), tell)?
        {
            tried.push(std::mem::replace(&mut top, slips));
            round.shows(&top, evidence(bench, &top, &best));
        }
        if taken {
            if let Some(rich) = waiting.take().filter(|rich| is_cheaper(bench, rich, &top)) {
                tried.push(std::mem::replace(&mut top, rich));
            }
            let rich = refined(bench, candidates, top.clone(), settings.bar.removed_kpa)?;
            // While much is left, a richer shape takes up a part of whatever else is missing: it waits for what is added next, and
            // stands where that costs more, or nothing is added.
            if rich.terms != top.terms && bench.is_much(&left(bench, &top)) {
                (best, waiting) = (top, Some(rich));
            } else {
                best = rich;
            }
        } else {
            let unexplained = is_unexplained(bench, &nominal, &best);
            let passed = |again: &Explanation| {
                earns_its_place(bench, candidates, settings, &evidence(bench, again, &best), [again, &best, &nominal])
            };
            let slips =
                if unexplained { in_pieces(bench, candidates, &best, settings, &tried, None, tell)? } else { None };
            let unexplained = unexplained && slips.is_none();
            // What is far from any known physics may be near one from where the parameters were before they gave way.
            let led_astray = slips.is_none() && is_led_astray(bench, &best);
            // Each of two may be lost in what the other does, and where parameters stand in for both, neither passes alone.
            let looks_ahead = unexplained && (settings.thorough || best.terms.len() < 2) || led_astray;
            let ahead = if looks_ahead {
                let earlier = screened.as_ref().map(|(_, screening)| screening);
                let further = additions(bench, candidates, &top, &settings.looking_ahead(), (earlier, 0.0), tell)?;
                further.polished.into_iter().find(|pair| {
                    let earned = |without: &Explanation| {
                        let found = evidence(bench, pair, without);
                        earns_its_place(bench, candidates, settings, &found, [pair, without, &nominal])
                    };
                    earned(&best) && earned(&top)
                })
            } else {
                None
            };
            let from_afar = unexplained && settings.thorough || led_astray;
            let again = match ahead {
                Some(pair) => Some(plainer(bench, candidates, pair, settings.bar.removed_kpa)?),
                None if from_afar => from_priors(bench, candidates, &best, &missed, &mut tried, tell)?,
                None => None,
            };
            match slips.or(again.filter(passed)) {
                Some(again) => {
                    round.shows(&again, evidence(bench, &again, &best));
                    round.taken = true;
                    best = again;
                }
                None => {
                    rounds.push(round);
                    if let Some(rich) = waiting.take().filter(|rich| is_cheaper(bench, rich, &best)) {
                        best = rich;
                        continue;
                    }
                    next = Some(top);
                    break;
                }
            }
        }
        rounds.push(round);
        // Before anything else stands for what the same does on the other side.
        best = twinned(bench, candidates, best, settings, &mut tried, &mut likes);
        if best.terms.len() > 1 {
            best = swaps(bench, candidates, best, &rounds, settings, &mut tried, tell)?;
            for both in twins(candidates, &best.terms) {
                let stands = [both.0, both.1].iter().all(|term| best.terms.contains(term));
                if stands && (settings.thorough || !exchanged.contains(&both)) {
                    best = pairs(bench, candidates, (best, both), &rounds, settings, &mut tried, tell)?;
                }
            }
            exchanged = twins(candidates, &best.terms);
            best = deletions(bench, candidates, &nominal, best, settings, &likes.found, &mut tried)?;
        }
    }
    best = waiting.filter(|rich| is_cheaper(bench, rich, &best)).unwrap_or(best);
    let found_late = best.terms.clone();
    best = exchanged_late(bench, candidates, best, settings, &mut tried, tell)?;
    if best.terms != found_late {
        best = deletions(bench, candidates, &nominal, best, settings, &likes.found, &mut tried)?;
    }
    if is_led_astray(bench, &best)
        && let Some(all) = usual_at_once(bench, candidates, [&best, &nominal], settings, tell)
    {
        tried.push(std::mem::replace(&mut best, all));
        best = deletions(bench, candidates, &nominal, best, settings, &likes.found, &mut tried)?;
    }
    // A shape that was richer before the rest was found may be needed no more.
    let plain = plainer(bench, candidates, best.clone(), settings.bar.removed_kpa)?;
    if is_cheaper(bench, &plain, &best) {
        tried.push(std::mem::replace(&mut best, plain));
    }
    best = twinned(bench, candidates, best, settings, &mut tried, &mut likes);
    if !best.terms.is_empty()
        && has_given_way(bench, &best)
        && let Some(again) = anew(bench, candidates, &best)
    {
        tried.push(std::mem::replace(&mut best, again));
    }
    // What a fit does not need may still be there, where its parameters are not believed.
    if !best.terms.is_empty() && kinds(candidates, &best.terms) < settings.most_kinds && has_given_way(bench, &best) {
        let known = screened.filter(|(terms, _)| *terms == best.terms).map(|(_, screening)| screening);
        tried.extend(believed(bench, candidates, &best, known, settings, tell));
    }
    let by_likeness = likes.found.into_iter().filter(|term| best.terms.contains(term)).collect();
    Ok(Found { nominal, best, by_likeness, next, rounds, tried })
}

/// Takes out of `tried` what has one term more than `best` and is not among those `polished`: the same as a term of it at the other side,
/// of another size there.
fn tried_beside(best: &Explanation, tried: &mut Vec<Explanation>, polished: &[Explanation]) -> Vec<Explanation> {
    let one_more = |e: &mut Explanation| {
        e.terms.len() == best.terms.len() + 1
            && best.terms.iter().all(|term| e.terms.contains(term))
            && polished.iter().all(|known| known.terms != e.terms)
    };
    tried.extract_if(.., one_more).collect()
}

/// Factor by which something else must set right more of the squared error for what moves in steps to wait.
const MORE_THAN_STEPS: f64 = 2.0;

/// Puts something else before what moves in steps, where that is the first of `polished`: what has a moment for every stretch fits a
/// little of whatever is wrong. What sets right several times as much, and is likelier with slow errors allowed for, comes first.
fn before_what_steps(bench: &Bench<'_>, candidates: &[Candidate], best: &Explanation, polished: &mut [Explanation]) {
    let steps = |e: &Explanation| e.terms.iter().any(|term| !best.terms.contains(term) && candidates[*term].stepped());
    let Some(first) = polished.first().filter(|first| steps(first)) else { return };
    let its = evidence(bench, first, best);
    let least_kpa = MORE_THAN_STEPS.sqrt() * its.removed_kpa.max(0.0);
    let others = polished.iter().enumerate().filter(|(_, e)| !steps(e)).map(|(at, e)| (at, evidence(bench, e, best)));
    let more = others.filter(|(_, found)| found.fitted > its.fitted && found.removed_kpa > least_kpa);
    if let Some((at, _)) = more.max_by(|a, b| a.1.fitted.total_cmp(&b.1.fitted)) {
        polished[..=at].rotate_right(1);
    }
}

/// Rounds of least squares of a glance.
pub const GLANCE_ROUNDS: usize = 6;
/// Rounds of a glance at a pair: two terms at a time are further from where they will end.
pub(crate) const PAIR_ROUNDS: usize = 12;
/// Drop in cost (half chi-square) that pays for a term, and for a reading of the pump's speed.
pub const PRICE: f64 = 20.0;
/// And for each of its parameters: a mechanism is not worth a richer shape for less.
pub const PRICE_OF_A_PARAMETER: f64 = 5.0;

/// Cost of an explanation: half chi-square (robust) and prior.
pub fn cost(bench: &Bench<'_>, explanation: &Explanation) -> f64 {
    explanation.fitted.comparable_cost(bench.records, bench.fit_weights())
}

/// Tells whether an explanation leaves more than a name may of what the `nominal` rig misses.
fn is_unexplained(bench: &Bench<'_>, nominal: &Explanation, explanation: &Explanation) -> bool {
    let left = left(bench, explanation);
    bench.is_much(&left) && !explains_most(&excess(bench, &nominal.trace), &left)
}
