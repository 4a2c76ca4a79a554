//! Nothing was named: whether the rig is as stated, only its parameters moved, or something may stand behind that.
//!
//! Parameters that were fitted to recordings of a rig with a leak take the leak up. What then speaks for the leak is not the
//! likelihood: it is that parameters need not be believed to be far off. So mechanisms are asked for that save the priors much,
//! on top of the fitted parameters and, by themselves, on top of the rig as it was given; and what no more than equals the
//! shift is asked for as well where it explains nearly all of the mismatch with one number ([`crate::search::single_mechanism`]), unless a pump stood in
//! some recording: that shows what leaks, and nothing is left to prudence.
//!
//! A shift that sets right less than [`FLOOR_KPA`] is not worth telling of pressures of a hundred kPa: it is of the size of what
//! formulas are off by. Of a bladder that never comes to more than 10 kPa the same error is half a percent, and the formulas' own
//! is as much smaller. So there the floor is a share of what the pressure comes to, and such a shift counts if it is certain as well.

use proto::diagnosis::Verdict;

use super::{FLOOR_KPA, Judgement, MOVED, TIE, excess, is_rival};
use crate::bench::{Bench, Explanation};
use crate::error::DiagnoseError;
use crate::judge::evidence::{Bar, evidence};
use crate::pump::switched::{REACH_KPA, reach_kpa, stands_somewhere};
use crate::search::candidate::{Candidate, is_leak};
use crate::search::single_mechanism::{ByThemselves, by_themselves};
use crate::search::{Found, brings_back, has_given_way, with};

/// Gain of prior and likelihood, beyond what the best of all candidates has by chance, at which a mechanism that does
/// not pass the bar is a rival of moved parameters.
const HINT: f64 = 5.0;
/// Error beyond the noise, in kPa, from which on one asks whether a single mechanism explains a shift of parameters.
const SHIFTED_KPA: f64 = 0.5;
/// Factor by which fitted parameters must lessen an error for it to count as much less.
pub(crate) const LESS: f64 = 1.2;
/// Share of what a pressure comes to, from the open air, from which on a shift of parameters is worth telling: [`FLOOR_KPA`] from 30 kPa on,
/// which either chamber of the paper's rig goes beyond whenever its pump runs (60 kPa with the vents nearly open).
const OF_REACH: f64 = 0.002;
/// The most rivals of moved parameters.
const MOST_RIVALS: usize = 5;

/// No candidate passed the bar, or what did was withdrawn.
pub(super) fn nothing_named(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    found: &Found,
    given: &[f64],
    excess_kpa: [Vec<f64>; 3],
    withdrawn: &[usize],
) -> Result<Judgement, DiagnoseError> {
    let undecided = |rivals, group| Judgement {
        rivals,
        groups: vec![group],
        ..Judgement::unnamed(Verdict::Undecided, excess_kpa.clone())
    };
    // What was withdrawn says where the error is: far from where the rig works.
    if withdrawn.is_empty() && bench.is_much(&excess_kpa[1]) {
        return Ok(Judgement::unnamed(Verdict::UnknownMechanism, excess_kpa));
    }
    let as_given = excess(bench, given);
    let shifted = as_given.iter().any(|kpa| *kpa > SHIFTED_KPA);
    let lone =
        if shifted { by_themselves(bench, candidates, &found.nominal, MOST_RIVALS)? } else { ByThemselves::default() };
    let known = found.tried.iter().filter(|e| e.terms.len() == 1 && e.terms != withdrawn);
    let singles: Vec<&Explanation> = known.chain(&lone.fitted).collect();
    let may_be_alone = lone.nearly_all && !stands_somewhere(bench);
    let close = hints(bench, candidates, &found.nominal, &singles);
    let close = if close.is_empty() && may_be_alone {
        let as_likely = lone.fitted.iter().filter(|e| evidence(bench, e, &found.nominal).fitted > -TIE);
        as_likely.filter(|e| reaches(bench, e)).collect()
    } else {
        close
    };
    let (group, mut rivals) = group_of(candidates, &found.nominal, &close);
    if !rivals.is_empty() {
        rivals.insert(0, found.nominal.clone());
        return Ok(undecided(rivals, group));
    }
    let traces = [given, &found.nominal.trace[..]];
    let moved = have_moved(bench, &found.nominal, [&as_given, &excess_kpa[1]], traces);
    let verdict = if moved { Verdict::ParametersMoved } else { Verdict::Adequate };
    Ok(Judgement::unnamed(verdict, excess_kpa))
}

/// Tells whether the rig's parameters are others than those of its file: with fitted ones much less error beyond the noise is left
/// in some channel, and what was left before is worth telling. Errors in kPa by channel and traces are those of the rig as given and
/// with the parameters of `fitted`.
pub(crate) fn have_moved(
    bench: &Bench<'_>,
    fitted: &Explanation,
    [given_kpa, left_kpa]: [&[f64]; 2],
    [given, with_fitted]: [&[f64]; 2],
) -> bool {
    let is_beyond = |floors_kpa: &[f64]| {
        let mut channels = given_kpa.iter().zip(left_kpa).zip(floors_kpa);
        channels.any(|((given, left), floor)| *given >= f64::max(*floor, LESS * left))
    };
    if is_beyond(&vec![FLOOR_KPA; given_kpa.len()]) {
        return true;
    }
    // No estimate of a small error beyond the noise is good to itself: what is small must be certain.
    let with = |trace: &[f64]| {
        let mut explanation = fitted.clone();
        explanation.trace = trace.to_vec();
        explanation
    };
    is_beyond(&floors_kpa(bench)) && evidence(bench, &with(with_fitted), &with(given)).is_certain()
}

/// Error beyond the noise by channel, in kPa, below which a shift of parameters is not worth telling.
fn floors_kpa(bench: &Bench<'_>) -> Vec<f64> {
    furthest_kpa(bench).iter().map(|reach| FLOOR_KPA.min(OF_REACH * reach)).collect()
}

/// Furthest from the open air that readings which count come to, by channel in kPa.
pub(crate) fn furthest_kpa(bench: &Bench<'_>) -> Vec<f64> {
    bench.recorded_kpa().into_iter().map(|[low, high]| f64::max(-low, high)).collect()
}

/// Names for what may stand behind moved parameters beside the terms of `found.best`, with the rivals that are no more than that:
/// where they have given way so far that nobody would believe them, and a leak brings them back. `None` where none does, or a pump
/// stood in some recording.
pub(super) fn instead_of_moved(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    found: &Found,
) -> Option<(Vec<String>, Vec<Explanation>)> {
    let best = &found.best;
    // A pump that stood has shown what leaks.
    if !has_given_way(bench, best) || stands_somewhere(bench) {
        return None;
    }
    let beside = |e: &&Explanation| {
        let leak = |term| is_leak(candidates, term) && e.terms == with(&best.terms, term);
        added(best, e).is_some_and(leak) && brings_back(best, e)
    };
    let beside: Vec<&Explanation> = found.tried.iter().filter(beside).collect();
    let (group, rivals) = group_of(candidates, best, &hints(bench, candidates, best, &beside));
    (!rivals.is_empty()).then_some((group, rivals))
}

/// Tells whether readings would change without one of the terms: for what next to nothing would, no experiment is worth flying.
fn reaches(bench: &Bench<'_>, explanation: &Explanation) -> bool {
    reach_kpa(bench, explanation).is_ok_and(|kpa| kpa > REACH_KPA)
}

/// Explanations with one term more than `base` that the recordings, or the priors, would rather have than a mere shift of its
/// parameters, and what can stand in the place of the first; the best first.
fn hints<'e>(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    base: &Explanation,
    singles: &[&'e Explanation],
) -> Vec<&'e Explanation> {
    // The best of many candidates gains the logarithm of their number by chance.
    let looked_at = (candidates.len().max(1) as f64).ln();
    let mut hints: Vec<(f64, &Explanation)> = singles
        .iter()
        .filter_map(|e| {
            let found_for = evidence(bench, e, base);
            // What hardly shows in the free run is an everyday imperfection; what saves the priors much is not, nor what is
            // beyond all doubt, small as it may be.
            let shows = found_for.removed_kpa > Bar::default().removed_kpa || found_for.is_certain();
            let gain = if shows { found_for.posterior } else { found_for.posterior - found_for.fitted.max(0.0) };
            (gain > HINT + looked_at).then_some((gain, *e))
        })
        .filter(|(_, e)| reaches(bench, e))
        .collect();
    hints.sort_by(|a, b| b.0.total_cmp(&a.0));
    let Some((top, first)) = hints.first().copied() else { return Vec::new() };
    let near = hints.iter().filter(|(gain, e)| *gain > top - TIE || is_rival(bench, first, e));
    let mut close: Vec<&Explanation> = near.map(|(_, e)| *e).collect();
    // What is no hint by itself can still stand in the first one's place.
    let posterior = |e: &Explanation| evidence(bench, e, base).posterior;
    let least = posterior(first) - TIE;
    let others = singles.iter().copied().filter(|e| posterior(e) > least && is_rival(bench, first, e));
    close.extend(others.filter(|e| reaches(bench, e)));
    close
}

/// The first term that an explanation has and `base` has not.
fn added(base: &Explanation, explanation: &Explanation) -> Option<usize> {
    explanation.terms.iter().copied().find(|term| !base.terms.contains(term))
}

/// Names of moved parameters of `base` and of what may stand behind them; and the explanations that do.
fn group_of(candidates: &[Candidate], base: &Explanation, close: &[&Explanation]) -> (Vec<String>, Vec<Explanation>) {
    let mut group = vec![MOVED.to_owned()];
    let mut rivals = Vec::new();
    for rival in close {
        let Some(name) = added(base, rival).and_then(|t| candidates.get(t)).map(Candidate::name) else { continue };
        // Two shapes of one mechanism there are one answer.
        if !group.contains(&name) && rivals.len() < MOST_RIVALS {
            group.push(name);
            rivals.push((*rival).clone());
        }
    }
    (group, rivals)
}

#[cfg(test)]
mod tests {
    use fit::data::Records;
    use fit::parameters::{set_value, value};

    use super::*;
    use crate::made::two_chambers::{holds, recorded, rig};
    use crate::made::{self, judged, made_after};

    /// A rig of some 9 kPa whose pump is 0.6 % stronger than stated: off by 0.04 kPa, which is 0.4 % of all that it shows, beside
    /// noise of 0.03 kPa. Of chambers of a hundred kPa so much is not told.
    #[test]
    fn a_shift_is_measured_by_what_the_pressure_comes_to() {
        let stated = rig();
        let verdict = |factor: f64| {
            let mut truth = stated.clone();
            let path = "pumps.micro.flow_l_per_min";
            set_value(&mut truth, path, factor * value(&stated, path).unwrap()).unwrap();
            let recordings =
                [1, 2].map(|seed| recorded(&truth, &format!("run{seed}.csv"), &holds(1500, [0.1, 0.3], seed), seed));
            let records = Records::new(&stated, &recordings).unwrap();
            let bench = made::bench(&stated, &records);
            let floors_kpa = floors_kpa(&bench);
            assert!(floors_kpa.iter().all(|kpa| *kpa < 0.03), "{floors_kpa:?}");
            let (_, judgement) = judged(&bench, &[]);
            (judgement.verdict, judgement.excess_kpa)
        };
        let (moved, [given_kpa, fitted_kpa, _]) = verdict(1.006);
        assert_eq!(moved, Verdict::ParametersMoved, "{given_kpa:?} {fitted_kpa:?}");
        assert!(given_kpa.iter().all(|kpa| *kpa < FLOOR_KPA), "{given_kpa:?}");
        assert_eq!(verdict(1.0).0, Verdict::Adequate);
    }

    #[test]
    fn on_the_papers_rig_the_floor_is_that_of_a_hundred_kpa() {
        let (rig, _) = made::moved(&[]);
        let records = Records::new(&rig, &made_after(0, 600, &rig, 1, 5)).unwrap();
        assert_eq!(floors_kpa(&made::bench(&rig, &records)), [FLOOR_KPA; 2]);
    }
}
