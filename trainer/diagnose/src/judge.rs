//! From explanations to a verdict.
//!
//! Three rules keep it honest. What is named must set right most of what is wrong (`EXPLAINED`); what explains the
//! recordings as well as the best must be named as its rival; and a mechanism that only saves the priors a stretch is
//! a reason to ask for an experiment, never to name it.

pub mod added_uncertainty;
pub(crate) mod curved_sensor;
pub mod evidence;
pub(crate) mod extrapolated;
pub(crate) mod implausible_parameters;
pub(crate) mod kind_of_rig;
pub(crate) mod large_error;
pub(crate) mod range_ends;
pub(crate) mod rejected_names;
pub mod step_uncertainty;
pub mod undetectable;
pub(crate) mod undetermined;
pub(crate) mod weakening_supply;

use fit::cores::side_by_side_telling;
use fit::data::Role;
use proto::diagnosis::Verdict;

use crate::bench::{Bench, Effort, Explanation};
use crate::error::DiagnoseError;
use crate::judge::evidence::evidence;
use crate::pump::switched::{REACH_KPA, reaches_kpa, stands_somewhere};
use crate::search::candidate::{Candidate, DRIFT, is_leak};
use crate::search::place::volumes_at;
use crate::search::quick_search::Footing;
use crate::search::{Found, GLANCE_ROUNDS, cost, late_in_place_of, starts, twins, with, without};

mod alike;
mod moved;
use alike::{alike_on_validation_data, cost_of_alike, leaves_several_times_the_noise};
pub(crate) use moved::{LESS, furthest_kpa, have_moved};
use moved::{instead_of_moved, nothing_named};

/// Error beyond the noise, in kPa, below which a model is as good as the recordings of a rig of the paper's size can tell; whether
/// parameters moved is asked of less where the pressures are small ([`moved`]).
pub(crate) const FLOOR_KPA: f64 = 0.06;
/// Share of the mean squared error beyond the noise that what is named must take away. The same physics written in
/// another way (relays instead of plays) leaves a sixth; what is merely similar (a lag for a resonance) leaves more.
const EXPLAINED: f64 = 0.7;
/// Log-likelihood within which two explanations are rivals whatever their blocks say.
const TIE: f64 = 6.0;
/// Standard errors within which they are.
const TIE_SE: f64 = 2.0;

/// Rounds of a glance that nothing follows.
const LONG_GLANCE_ROUNDS: usize = 10;

/// The rival that is no mechanism.
pub const MOVED: &str = "parameters_moved:both";

/// A verdict and what it rests on.
#[derive(Clone)]
pub struct Judgement {
    /// The answer.
    pub verdict: Verdict,
    /// Terms that are named.
    pub named: Vec<usize>,
    /// For each named or contested term: the term and what could stand in its place.
    pub contested: Vec<Contest>,
    /// Rival explanations as a whole, the best first; more than one if undecided.
    pub rivals: Vec<Explanation>,
    /// Groups of names that the recordings do not tell apart.
    pub groups: Vec<Vec<String>>,
    /// Error beyond the noise by channel in kPa: given, re-identified, extended.
    pub excess_kpa: [Vec<f64>; 3],
}

impl Judgement {
    /// Tells whether every term that was found has its name, be it beside parameters that something else may stand behind.
    pub fn is_of_names(&self) -> bool {
        let of_moved = |group: &Vec<String>| group.iter().any(|name| name == MOVED);
        self.verdict == Verdict::MissingPhysics || !self.named.is_empty() && self.groups.iter().all(of_moved)
    }

    /// The judgement without a name: what was to be named did not hold.
    #[must_use]
    pub fn of_no_name(self) -> Self {
        let [given, nominal, _] = self.excess_kpa;
        Judgement::unnamed(Verdict::UnknownMechanism, [given, nominal.clone(), nominal])
    }

    /// Nothing named, and no rivals.
    fn unnamed(verdict: Verdict, excess_kpa: [Vec<f64>; 3]) -> Self {
        Judgement {
            verdict,
            named: Vec::new(),
            contested: Vec::new(),
            rivals: Vec::new(),
            groups: Vec::new(),
            excess_kpa,
        }
    }
}

/// A term and its rivals.
#[derive(Debug, Clone, PartialEq)]
pub struct Contest {
    /// The term.
    pub term: usize,
    /// Candidates that explain the recordings as well in its place.
    pub rivals: Vec<usize>,
    /// Log-likelihood lost without the term, everything else fitted again.
    pub gain: f64,
    /// Share of the error on validation data that goes with the term, everything else fitted again without it (1 is all); `None`
    /// where the rig cannot be run without it.
    pub validation_gain: Option<f64>,
}

/// Judges what a search found. `given` is the free run of the rig as it was given.
///
/// # Errors
/// A fit failed.
pub fn judge(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    found: &Found,
    given: &[f64],
    tell: &mut dyn FnMut(&str, f64),
) -> Result<Judgement, DiagnoseError> {
    let jumps = found.best.jumps;
    let excess_kpa = [given, &found.nominal.trace, &found.best.trace].map(|trace| beyond_noise(bench, trace, jumps));
    if found.best.terms.is_empty() {
        nothing_named(bench, candidates, found, given, excess_kpa, &[])
    } else {
        something_named(bench, candidates, found, excess_kpa, tell)
    }
}

/// Judges with nothing found: what was to be named is not worth it.
///
/// # Errors
/// A fit failed.
pub fn judge_without(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    found: &Found,
    given: &[f64],
) -> Result<Judgement, DiagnoseError> {
    let nominal = excess(bench, &found.nominal.trace);
    let excess_kpa = [excess(bench, given), nominal.clone(), nominal];
    nothing_named(bench, candidates, found, given, excess_kpa, &found.best.terms)
}

/// Some candidates passed the bar.
fn something_named(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    found: &Found,
    excess_kpa: [Vec<f64>; 3],
    tell: &mut dyn FnMut(&str, f64),
) -> Result<Judgement, DiagnoseError> {
    let best = &found.best;
    if bench.is_more_than_a_name_may_leave(&excess_kpa[2]) && !explains_most(&excess_kpa[1], &excess_kpa[2]) {
        return Ok(Judgement::unnamed(Verdict::UnknownMechanism, excess_kpa));
    }
    let small = small_leaks(bench, candidates, best)?;
    let asked: Vec<usize> = best.terms.iter().copied().filter(|term| !small.contains(term)).collect();
    let footing = Footing::of(bench, best)?;
    let contest = |term: &usize| contest(bench, candidates, &footing, found, *term);
    let contests = side_by_side_telling(&asked, contest, &mut |share| tell("comparing hypotheses", share));
    let mut contested = Vec::new();
    let mut rivals = vec![best.clone()];
    let mut groups = Vec::new();
    for contest in contests {
        let (contest, of_it) = contest?;
        if !contest.rivals.is_empty() {
            let mut group: Vec<String> = vec![candidates[contest.term].name()];
            // Two shapes of one mechanism there are one answer.
            contest.rivals.iter().for_each(|k| tell_once(&mut group, candidates[*k].name()));
            groups.push(group);
        }
        rivals.extend(of_it);
        contested.push(contest);
    }
    for rival in &found.tried {
        let instead = stand_ins(candidates, best, rival);
        if instead.is_empty() || !is_rival(bench, best, rival) {
            continue;
        }
        for (term, k) in instead {
            // Each may be its rival by itself as well.
            let new = contested.iter_mut().filter(|c| c.term == term && !c.rivals.contains(&k));
            let by_itself = new.map(|contest| contest.rivals.push(k)).count() == 0;
            if !by_itself {
                tell_once(&mut groups, vec![candidates[term].name(), candidates[k].name()]);
            }
        }
        rivals.push(rival.clone());
    }
    if let Some((group, instead)) = instead_of_moved(bench, candidates, found) {
        groups.push(group);
        rivals.extend(instead);
    }
    let verdict = if groups.is_empty() { Verdict::MissingPhysics } else { Verdict::Undecided };
    let named = contested.iter().filter(|c| c.rivals.is_empty()).map(|c| c.term).collect();
    Ok(Judgement { verdict, named, contested, rivals, groups, excess_kpa })
}

/// Terms of what was found with those that stand for them in a rival, where several are exchanged at once: a mechanism on both sides
/// for another one, or all that is late.
fn stand_ins(candidates: &[Candidate], best: &Explanation, rival: &Explanation) -> Vec<(usize, usize)> {
    for (one, other) in twins(candidates, &best.terms) {
        let rest = without(&without(&best.terms, one), other);
        let for_both = |(a, b): &(usize, usize)| {
            candidates[*a].id != candidates[one].id && with(&with(&rest, *a), *b) == rival.terms
        };
        if let Some((a, b)) = twins(candidates, &rival.terms).into_iter().find(for_both) {
            return vec![(one, a), (other, b)];
        }
    }
    late_in_place_of(candidates, &best.terms, &rival.terms)
}

/// Adds a name, or a group of rivals, that is not there yet: two shapes of a mechanism have one name.
pub(crate) fn tell_once<T: PartialEq>(told: &mut Vec<T>, new: T) {
    if !told.contains(&new) {
        told.push(new);
    }
}

/// Rivals of a term of what was found: the candidates that may stand in its place, and the explanations with them.
fn contest(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    footing: &Footing,
    found: &Found,
    term: usize,
) -> Result<(Contest, Vec<Explanation>), DiagnoseError> {
    let best = &found.best;
    let rest = without(&best.terms, term);
    let (gain, validation_gain) = lost_without(bench, candidates, footing, best, &rest, found)?;
    let mut tied = Vec::new();
    let mut rivals = Vec::new();
    // Of what explains as much, nothing else is there on the other side already and asks for no number of its own.
    let several = leaves_several_times_the_noise(bench, best);
    let mut close = if found.by_likeness.contains(&term) { Vec::new() } else { close_to(found, term) };
    if several {
        close.extend(next_best(found, term));
    }
    // A reading that falls slowly is a drift or a leak, and neither is told without the other beside it.
    close.extend(other_side_of_a_slow_fall(bench, candidates, term));
    close.sort_unstable();
    close.dedup();
    // What is alike on validation data may be behind by more than what a likelihood tells apart.
    let readings = bench.fit_weights().iter().filter(|w| **w != 0.0).count() as f64;
    let behind = if several { cost_of_alike(readings) } else { 0.0 };
    for k in close {
        // Another shape of the same mechanism at the same place is no other answer.
        if candidates[k].name() == candidates[term].name() {
            continue;
        }
        if best.terms.contains(&k) || rest.iter().any(|t| candidates[*t].excludes(&candidates[k])) {
            continue;
        }
        let terms = with(&rest, k);
        let known =
            found.tried.iter().filter(|e| e.terms == terms).min_by(|a, b| cost(bench, a).total_cmp(&cost(bench, b)));
        let rival = match known {
            Some(known) => known.clone(),
            None => {
                let values: Vec<_> = values_of(found, k).into_iter().collect();
                let starts = starts(bench, candidates, best, &terms, &values, false);
                // What is far behind after a glance is no rival, whatever a fit would still mend.
                let set = bench.set_of(candidates, &terms)?;
                let Some(close) = footing.contender_within(bench, &set, &starts, GLANCE_ROUNDS, behind) else {
                    continue;
                };
                let Ok(fitted) = bench.fit(candidates, &terms, &[close.point], Effort::Polish) else { continue };
                fitted
            }
        };
        if is_rival(bench, best, &rival) {
            tied.push(k);
            rivals.push(rival);
        }
    }
    Ok((Contest { term, rivals: tied, gain, validation_gain }, rivals))
}

/// Number of candidates, beyond those that came close, that are asked where likelihoods are no measure.
const NEXT_BEST: usize = 4;

/// The candidates that came next in the rounds in which `term` was ranked.
fn next_best(found: &Found, term: usize) -> Vec<usize> {
    let of_term = found.rounds.iter().filter(|round| round.ranked.iter().any(|r| r.candidate == term));
    let ranked =
        of_term.flat_map(|round| round.ranked.iter().filter(|r| r.candidate != term && r.gain > 0.0).take(NEXT_BEST));
    ranked.map(|r| r.candidate).collect()
}

/// For a sensor that drifts the leaks of its volume, and the other way round.
fn other_side_of_a_slow_fall(bench: &Bench<'_>, candidates: &[Candidate], term: usize) -> Vec<usize> {
    let found = &candidates[term];
    let volumes = |candidate: &Candidate| volumes_at(bench.rig, &candidate.component);
    let of = |id: &str| {
        let meets = |other: &Candidate| volumes(other).iter().any(|volume| volumes(found).contains(volume));
        let all = candidates.iter().enumerate().filter(|(_, other)| other.id == id && meets(other));
        all.map(|(k, _)| k).collect::<Vec<usize>>()
    };
    match found.id.as_str() {
        DRIFT => of("chamber_leak"),
        "chamber_leak" => of(DRIFT),
        _ => Vec::new(),
    }
}

/// Leaks among the terms that a pump at rest shows and nothing else would: they are in the rig, and not worth a name beside what is.
fn small_leaks(bench: &Bench<'_>, candidates: &[Candidate], best: &Explanation) -> Result<Vec<usize>, DiagnoseError> {
    let leaks = |term: &usize| is_leak(candidates, *term);
    if best.terms.len() < 2 || !best.terms.iter().any(leaks) || !stands_somewhere(bench) {
        return Ok(Vec::new());
    }
    let reaches = reaches_kpa(bench, best)?;
    let small = best.terms.iter().zip(&reaches).filter(|(term, reach)| leaks(term) && **reach < REACH_KPA);
    let small: Vec<usize> = small.map(|(term, _)| *term).collect();
    Ok(if small.len() < best.terms.len() { small } else { Vec::new() })
}

/// Log-likelihood that `best` has more than what is left of it with the terms `rest`, fitted again, and the share of the error on
/// validation data that goes with what `rest` lacks.
fn lost_without(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    footing: &Footing,
    best: &Explanation,
    rest: &[usize],
    found: &Found,
) -> Result<(f64, Option<f64>), DiagnoseError> {
    let share = |without: &[f64]| {
        let [with_kpa, without_kpa] = [&best.trace[..], without].map(|trace| bench.validation_kpa(trace));
        (without_kpa > 0.0).then(|| 1.0 - with_kpa / without_kpa).filter(|share| share.is_finite())
    };
    if let Some(known) = found.tried.iter().chain([&found.nominal]).find(|e| e.terms == rest) {
        return Ok((evidence(bench, best, known).fitted, share(&known.trace)));
    }
    let set = bench.set_of(candidates, rest)?;
    let starts = starts(bench, candidates, best, rest, &[], false);
    let Some(glanced) = footing.glance(bench, &set, &starts, LONG_GLANCE_ROUNDS, f64::INFINITY) else {
        return Ok((f64::INFINITY, None));
    };
    let rig = set.rig_at(&glanced.point).map_err(DiagnoseError::rig(set.rig()))?;
    let score = |trace: &[f64]| bench.score(trace, Role::Fit, best.errors(bench));
    let trace = bench.free_run(&rig)?;
    Ok((score(&best.trace).gain_over(&score(&trace)).0, share(&trace)))
}

/// Tells whether the recordings cannot tell `rival` from `best`. Where several times the noise is left, a difference is no larger
/// than its scatter from block to block says, however large it is as a likelihood.
fn is_rival(bench: &Bench<'_>, best: &Explanation, rival: &Explanation) -> bool {
    let e = evidence(bench, best, rival);
    let both = e.fitted + e.chosen;
    let se = e.fitted_se.hypot(e.chosen_se);
    let scatters = both < TIE_SE * se;
    both < TIE || scatters && (both < 5.0 * TIE || alike_on_validation_data(bench, best, rival))
}

/// Where a candidate did best at a glance.
fn values_of(found: &Found, candidate: usize) -> Option<(usize, Vec<f64>)> {
    let glances = found.rounds.iter().flat_map(|round| &round.ranked).filter(|ranked| ranked.candidate == candidate);
    glances.max_by(|a, b| a.gain.total_cmp(&b.gain)).map(|best| (candidate, best.values.clone()))
}

/// Candidates that came close to what `term` gained in any round.
fn close_to(found: &Found, term: usize) -> Vec<usize> {
    let mut close: Vec<usize> = Vec::new();
    let ranked = found.rounds.iter().any(|round| round.ranked.iter().any(|r| r.candidate == term));
    if !ranked {
        // It came in with its like at another place: whatever gained in that round may stand for it.
        let into = found.rounds.iter().rev().find(|round| !round.base.contains(&term));
        close.extend(into.iter().flat_map(|round| &round.ranked).filter(|r| r.gain > 0.0).map(|r| r.candidate));
    }
    for round in &found.rounds {
        let Some(own) = round.ranked.iter().find(|r| r.candidate == term).map(|r| r.gain) else { continue };
        // A glance is not converged: where parameters must go far, it is off by a third.
        let within = 30.0 + 0.3 * own.abs();
        let others = round.ranked.iter().filter(|r| r.candidate != term && own - r.gain < within);
        close.extend(others.map(|r| r.candidate));
    }
    close.sort_unstable();
    close.dedup();
    close
}

/// Tells whether errors beyond the noise fall far enough, channels together, for what made them fall to be named.
pub(crate) fn explains_most(before_kpa: &[f64], after_kpa: &[f64]) -> bool {
    let squares = |excess: &[f64]| excess.iter().map(|kpa| kpa * kpa).sum::<f64>();
    squares(after_kpa) <= (1.0 - EXPLAINED) * squares(before_kpa)
}

/// Error beyond the noise by channel, on the rows that were fitted or chose, in kPa.
pub fn excess(bench: &Bench<'_>, trace: &[f64]) -> Vec<f64> {
    beyond_noise(bench, trace, false)
}

/// Error beyond the noise that an explanation leaves, as in [`excess`]; where a flapper jumps in it, in the middle one of all
/// stretches of 2 s.
pub(crate) fn left(bench: &Bench<'_>, explanation: &Explanation) -> Vec<f64> {
    beyond_noise(bench, &explanation.trace, explanation.jumps)
}

/// Errors beyond the noise, of all readings together or of those in the middle.
fn beyond_noise(bench: &Bench<'_>, trace: &[f64], in_the_middle: bool) -> Vec<f64> {
    let squares = bench.squares_by_channel(trace, in_the_middle).into_iter();
    squares.zip(bench.sigma_kpa()).map(|(square, sigma)| (square - sigma * sigma).max(0.0).sqrt()).collect()
}
