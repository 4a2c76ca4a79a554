//! Course of a search: round after round of a further term, and what is asked of the best in between and at the end.

use super::additions::{Additions, additions, cheaper, is_cheaper};
use super::believed::{believed, has_given_way, is_led_astray};
use super::exchange::{deletions, pairs, swaps, twins};
use super::late::exchanged_late;
use super::refine::{anew, from_priors, plainer, refined};
use super::screen::Screening;
use super::slips::in_pieces;
use super::terms::kinds;
use super::twin::{Likes, twinned};
use super::usual::usual_at_once;
use super::worth::{earns_its_place, least_gain, leaves_room};
use super::{Found, Ranked, Round, SearchSettings};
use crate::bench::{Bench, Effort, Explanation};
use crate::error::DiagnoseError;
use crate::judge::evidence::{Evidence, evidence};
use crate::judge::{excess, explains_most, left};
use crate::search::candidate::Candidate;

/// Callback that is told what is being done, and the share of it that is done.
type Tell<'t> = &'t mut dyn FnMut(&str, f64);

/// Searches among `candidates`, from the rig's own parameters at `start` (near their best without any term).
///
/// # Errors
/// The rig itself cannot be fitted.
pub fn search(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    start: &[f64],
    settings: &SearchSettings,
    tell: Tell<'_>,
) -> Result<Found, DiagnoseError> {
    let mut search = Search::begin(bench, candidates, start, settings)?;
    while search.may_go_on() {
        let next;
        (search, next) = search.round(tell)?;
        if next == Next::End {
            break;
        }
    }
    search.end(tell)
}

/// A search under way.
struct Search<'s, 'b> {
    bench: &'s Bench<'b>,
    candidates: &'s [Candidate],
    settings: &'s SearchSettings,
    nominal: Explanation,
    best: Explanation,
    rounds: Vec<Round>,
    tried: Vec<Explanation>,
    /// Explanation that was not taken in the last round.
    next: Option<Explanation>,
    likes: Likes,
    /// Terms that were the best before: what is added and then deleted again would be added once more, and so on.
    stood: Vec<Vec<usize>>,
    /// Pairs on both sides that need not be exchanged again in a short search.
    exchanged: Vec<(usize, usize)>,
    /// Explanation that was taken last in richer shapes, where these wait.
    waiting: Option<Explanation>,
    /// The last screening of every candidate and the terms beside it: in a short search the first, which tells the later ones what to
    /// expect.
    screened: Option<(Vec<usize>, Screening)>,
}

/// Sequel of a round.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Next {
    Round,
    End,
}

impl<'s, 'b> Search<'s, 'b> {
    fn begin(
        bench: &'s Bench<'b>,
        candidates: &'s [Candidate],
        start: &[f64],
        settings: &'s SearchSettings,
    ) -> Result<Self, DiagnoseError> {
        let nominal = bench.fit(candidates, &[], &[start.to_vec()], Effort::Polish)?;
        Ok(Search {
            bench,
            candidates,
            settings,
            best: nominal.clone(),
            nominal,
            rounds: Vec::new(),
            tried: Vec::new(),
            next: None,
            likes: Likes::default(),
            stood: Vec::new(),
            exchanged: Vec::new(),
            waiting: None,
            screened: None,
        })
    }

    fn may_go_on(&self) -> bool {
        kinds(self.candidates, &self.best.terms) < self.settings.most_kinds
            && !self.stood.contains(&self.best.terms)
            && (self.best.terms.is_empty() || leaves_room(self.bench, self.settings, &self.best))
    }

    /// Tries a further term, and what follows from it.
    fn round(mut self, tell: Tell<'_>) -> Result<(Self, Next), DiagnoseError> {
        let Search { bench, candidates, settings, .. } = self;
        self.stood.push(self.best.terms.clone());
        let (ranked, mut polished) = self.further(tell)?;
        if polished.is_empty() {
            if !ranked.is_empty() {
                let base = self.best.terms.clone();
                self.rounds.push(Round { base, ranked, best: Vec::new(), evidence: None, taken: false });
            }
            return Ok((self, Next::End));
        }
        polished.extend(tried_beside(&self.best, &mut self.tried, &polished));
        polished.sort_by(|a, b| cheaper(bench, a, b));
        before_what_steps(bench, candidates, &self.best, &mut polished);
        let Some(first) = polished.first().cloned() else { return Ok((self, Next::End)) };
        let (mut top, taken, found) = self.strongest(first, &polished)?;
        let missed: Vec<usize> = ranked.iter().map(|r| r.candidate).collect();
        let mut round = Round { base: self.best.terms.clone(), ranked, best: Vec::new(), evidence: None, taken };
        round.shows(&top, found);
        self.tried.extend(polished);
        // What sticks and slips passes for itself with a wrong band: then the rest of it is still there.
        let sticks = top.terms.iter().any(|term| !self.best.terms.contains(term) && candidates[*term].stepped());
        if taken
            && sticks
            && bench.is_much(&left(bench, &top))
            && let Some(slips) = in_pieces(bench, candidates, &self.best, settings, &self.tried, Some(&top), tell)?
        {
            self.tried.push(std::mem::replace(&mut top, slips));
            round.shows(&top, evidence(bench, &top, &self.best));
        }
        if taken {
            self = self.take(top)?;
        } else {
            match self.in_its_place(&top, &missed, tell)? {
                Some(again) => {
                    round.shows(&again, evidence(bench, &again, &self.best));
                    round.taken = true;
                    self.best = again;
                }
                None => {
                    self.rounds.push(round);
                    if let Some(rich) = self.waiting.take().filter(|rich| is_cheaper(bench, rich, &self.best)) {
                        self.best = rich;
                        return Ok((self, Next::Round));
                    }
                    self.next = Some(top);
                    return Ok((self, Next::End));
                }
            }
        }
        self.rounds.push(round);
        Ok((self.exchanged(tell)?, Next::Round))
    }

    /// Further terms on top of the best: candidates after a glance, and the best ones fitted to the end.
    fn further(&mut self, tell: Tell<'_>) -> Result<(Vec<Ranked>, Vec<Explanation>), DiagnoseError> {
        let Search { bench, candidates, settings, .. } = *self;
        let (best, nominal) = (&self.best, &self.nominal);
        // Slopes where parameters have given way say little of what comes: what is behind at a glance is looked at as well.
        let explained = !best.terms.is_empty() && !is_unexplained(bench, nominal, best) && !is_led_astray(bench, best);
        let least_gain = if explained && !settings.thorough { least_gain(bench, nominal, best) } else { 0.0 };
        let earlier = self.screened.as_ref().map(|(_, screening)| screening);
        let Additions { screening, ranked, polished } =
            additions(bench, candidates, best, settings, (earlier, least_gain), tell)?;
        if settings.thorough || self.screened.is_none() {
            self.screened = Some((best.terms.clone(), screening));
        }
        Ok((ranked, polished))
    }

    /// Tells whether an explanation earns its place beside another, with its evidence.
    fn earns(&self, with: &Explanation, without: &Explanation) -> (bool, Evidence) {
        let found = evidence(self.bench, with, without);
        let explanations = [with, without, &self.nominal];
        (earns_its_place(self.bench, self.candidates, self.settings, &found, explanations), found)
    }

    /// The first of `polished` in its plainest shape, or another of them that earns its place where it does not.
    fn strongest(
        &self,
        first: Explanation,
        polished: &[Explanation],
    ) -> Result<(Explanation, bool, Evidence), DiagnoseError> {
        // A plainer shape sets no more right: in a short search it is not fitted where the richer one is not taken.
        let may_be_plainer = self.settings.thorough || self.earns(&first, &self.best).0;
        let top = if may_be_plainer {
            plainer(self.bench, self.candidates, first, self.settings.bar.removed_kpa)?
        } else {
            first
        };
        let (taken, found) = self.earns(&top, &self.best);
        // Where little is left, what costs least may do so by slow errors of the formulas, which no name stands for.
        if !taken {
            let mut others = polished.iter().skip(1).map(|other| (other, self.earns(other, &self.best)));
            if let Some((other, (taken, found))) = others.find(|(_, (earned, _))| *earned) {
                return Ok((other.clone(), taken, found));
            }
        }
        Ok((top, taken, found))
    }

    /// Takes what earns its place as the best, in the shape that it needs.
    fn take(mut self, mut top: Explanation) -> Result<Self, DiagnoseError> {
        let Search { bench, candidates, settings, .. } = self;
        if let Some(rich) = self.waiting.take().filter(|rich| is_cheaper(bench, rich, &top)) {
            self.tried.push(std::mem::replace(&mut top, rich));
        }
        let rich = refined(bench, candidates, top.clone(), settings.bar.removed_kpa)?;
        // While much is left, a richer shape takes up a part of whatever else is missing: it waits for what is added next, and
        // stands where that costs more, or nothing is added.
        if rich.terms != top.terms && bench.is_much(&left(bench, &top)) {
            (self.best, self.waiting) = (top, Some(rich));
        } else {
            self.best = rich;
        }
        Ok(self)
    }

    /// Explanation that is taken instead of `top`, which earns no place; `missed` are the candidates of the round.
    fn in_its_place(
        &mut self,
        top: &Explanation,
        missed: &[usize],
        tell: Tell<'_>,
    ) -> Result<Option<Explanation>, DiagnoseError> {
        let Search { bench, candidates, settings, .. } = *self;
        let unexplained = is_unexplained(bench, &self.nominal, &self.best);
        let slips = if unexplained {
            in_pieces(bench, candidates, &self.best, settings, &self.tried, None, tell)?
        } else {
            None
        };
        let unexplained = unexplained && slips.is_none();
        // What is far from any known physics may be near one from where the parameters were before they gave way.
        let led_astray = slips.is_none() && is_led_astray(bench, &self.best);
        // Each of two may be lost in what the other does, and where parameters stand in for both, neither passes alone.
        let looks_ahead = unexplained && (settings.thorough || self.best.terms.len() < 2) || led_astray;
        let ahead = if looks_ahead { self.pair_beyond(top, tell)? } else { None };
        let from_afar = unexplained && settings.thorough || led_astray;
        let again = match ahead {
            Some(pair) => Some(plainer(bench, candidates, pair, settings.bar.removed_kpa)?),
            None if from_afar => from_priors(bench, candidates, &self.best, missed, &mut self.tried, tell)?,
            None => None,
        };
        Ok(slips.or(again.filter(|again| self.earns(again, &self.best).0)))
    }

    /// One term further than `top`, where that earns its place beside both.
    fn pair_beyond(&self, top: &Explanation, tell: Tell<'_>) -> Result<Option<Explanation>, DiagnoseError> {
        let earlier = self.screened.as_ref().map(|(_, screening)| screening);
        let ahead = self.settings.looking_ahead();
        let further = additions(self.bench, self.candidates, top, &ahead, (earlier, 0.0), tell)?;
        let earned = |pair: &Explanation| self.earns(pair, &self.best).0 && self.earns(pair, top).0;
        Ok(further.polished.into_iter().find(earned))
    }

    /// Exchanges terms of a new best for others, and deletes what is needed no more.
    fn exchanged(mut self, tell: Tell<'_>) -> Result<Self, DiagnoseError> {
        let Search { bench, candidates, settings, .. } = self;
        // Before anything else stands for what the same does on the other side.
        self.best = twinned(bench, candidates, self.best, settings, &mut self.tried, &mut self.likes);
        if self.best.terms.len() > 1 {
            self.best = swaps(bench, candidates, self.best, &self.rounds, settings, &mut self.tried, tell)?;
            for both in twins(candidates, &self.best.terms) {
                let stands = [both.0, both.1].iter().all(|term| self.best.terms.contains(term));
                if stands && (settings.thorough || !self.exchanged.contains(&both)) {
                    let pair = (self.best, both);
                    self.best = pairs(bench, candidates, pair, &self.rounds, settings, &mut self.tried, tell)?;
                }
            }
            self.exchanged = twins(candidates, &self.best.terms);
            self = self.pruned()?;
        }
        Ok(self)
    }

    /// Deletes terms of the best that are needed no more.
    fn pruned(mut self) -> Result<Self, DiagnoseError> {
        let Search { bench, candidates, settings, .. } = self;
        let (nominal, likes) = (&self.nominal, &self.likes.found);
        self.best = deletions(bench, candidates, nominal, self.best, settings, likes, &mut self.tried)?;
        Ok(self)
    }

    /// Last questions to the best: late parts, all that is usual, plainer shapes, parameters that gave way.
    fn end(mut self, tell: Tell<'_>) -> Result<Found, DiagnoseError> {
        let Search { bench, candidates, settings, .. } = self;
        if let Some(rich) = self.waiting.take().filter(|rich| is_cheaper(bench, rich, &self.best)) {
            self.best = rich;
        }
        let found_late = self.best.terms.clone();
        self.best = exchanged_late(bench, candidates, self.best, settings, &mut self.tried, tell)?;
        if self.best.terms != found_late {
            self = self.pruned()?;
        }
        if is_led_astray(bench, &self.best)
            && let Some(all) = usual_at_once(bench, candidates, [&self.best, &self.nominal], settings, tell)
        {
            self.tried.push(std::mem::replace(&mut self.best, all));
            self = self.pruned()?;
        }
        // A shape that was richer before the rest was found may be needed no more.
        let plain = plainer(bench, candidates, self.best.clone(), settings.bar.removed_kpa)?;
        if is_cheaper(bench, &plain, &self.best) {
            self.tried.push(std::mem::replace(&mut self.best, plain));
        }
        let Search { nominal, rounds, mut tried, next, mut likes, screened, .. } = self;
        let mut best = twinned(bench, candidates, self.best, settings, &mut tried, &mut likes);
        if !best.terms.is_empty()
            && has_given_way(bench, &best)
            && let Some(again) = anew(bench, candidates, &best)
        {
            tried.push(std::mem::replace(&mut best, again));
        }
        // What a fit does not need may still be there, where its parameters are not believed.
        if !best.terms.is_empty() && kinds(candidates, &best.terms) < settings.most_kinds && has_given_way(bench, &best)
        {
            let known = screened.filter(|(terms, _)| *terms == best.terms).map(|(_, screening)| screening);
            tried.extend(believed(bench, candidates, &best, known, settings, tell));
        }
        let by_likeness = likes.found.into_iter().filter(|term| best.terms.contains(term)).collect();
        Ok(Found { nominal, best, by_likeness, next, rounds, tried })
    }
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

/// Tells whether an explanation leaves more than a name may of what the `nominal` rig misses.
fn is_unexplained(bench: &Bench<'_>, nominal: &Explanation, explanation: &Explanation) -> bool {
    let left = left(bench, explanation);
    bench.is_much(&left) && !explains_most(&excess(bench, &nominal.trace), &left)
}
