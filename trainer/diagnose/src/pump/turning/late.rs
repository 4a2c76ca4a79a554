//! Sensors that lag in place of valves that are late.
//!
//! Both make readings late, and of some ten milliseconds the two look much alike. A pump's ripple knows which it is: through a
//! valve that is late it comes whole, of 50 Hz through a sensor that lags by 14 ms a fifth is left. But which ripple is looked for
//! follows from what was found, and where that is a valve the sensor's is not heard.

use proto::diagnosis::Verdict;

use super::raw::Beside;
use crate::bench::{Bench, Explanation};
use crate::error::DiagnoseError;
use crate::judge::tell_once;
use crate::pump::answer::Answer;
use crate::search::candidate::Candidate;
use crate::search::quick_search::Footing;
use crate::search::{LATE_SENSOR, LATE_VALVES, PAIR_ROUNDS, starts, values_of};

/// Terms of `found` with sensors that lag where valves are late, which begin at as much; `None` where no valve is, or none with a sensor.
pub(super) fn in_sensors<'a>(bench: &Bench<'_>, found: &Beside<'a>) -> Option<Beside<'a>> {
    let (candidates, rig) = (found.candidates, &found.best.fitted.rig);
    let is_late_valve = |id: &str, component: &str| LATE_VALVES.contains(&id) && rig.valves.contains_key(component);
    let (late, mut terms): (Vec<usize>, Vec<usize>) = found.terms.iter().partition(|term| {
        candidates.get(**term).is_some_and(|candidate| is_late_valve(&candidate.id, &candidate.component))
    });
    let mut values: Vec<(usize, Vec<f64>)> = Vec::new();
    for term in late {
        let valve = rig.valves.get(&candidates.get(term)?.component)?;
        let by_ms = *values_of(bench, candidates, found.best, term)?.first()?;
        let lags = candidates.iter().enumerate().filter(|(_, candidate)| {
            let sensor = rig.sensors.get(&candidate.component);
            candidate.id == LATE_SENSOR
                && !candidate.is_refinement()
                && sensor.is_some_and(|sensor| sensor.volume == valve.from || sensor.volume == valve.to)
        });
        for (lag, _) in lags {
            match values.iter_mut().find(|(known, _)| *known == lag) {
                Some((_, known)) => known.iter_mut().take(1).for_each(|ms| *ms += by_ms),
                None => values.push((lag, vec![by_ms])),
            }
        }
    }
    let there = |lag: usize| terms.iter().any(|term| *term == lag || candidates[*term].excludes(&candidates[lag]));
    let new: Vec<usize> = values.iter().map(|(lag, _)| *lag).filter(|lag| !there(*lag)).collect();
    terms.extend(&new);
    terms.sort_unstable();
    (!new.is_empty()).then_some(Beside { terms, values, ..*found })
}

/// Log-likelihood by which lagging sensors may be behind at a glance before their ripple is asked. (Where a ripple swings that neither
/// explains, sensors that do lag were 25 behind late valves at a glance; beside late valves that are, 890.)
const BEHIND: f64 = 500.0;

/// Tells whether a glance shows that what stands in the place of what was `found` on these readings is out of reach of it.
///
/// # Errors
/// What was found cannot be simulated.
pub(super) fn is_far_behind(searched: &Bench<'_>, instead: &Beside<'_>) -> Result<bool, DiagnoseError> {
    let (candidates, found) = (instead.candidates, instead.best);
    let footing = Footing::of(searched, found)?;
    let set = searched.set_of(candidates, &instead.terms)?;
    let starts = starts(searched, candidates, found, &instead.terms, &instead.values, false);
    let within = footing.cost + BEHIND;
    let end = footing.glance(searched, &set, &starts, PAIR_ROUNDS, within);
    Ok(end.is_none_or(|end| end.cost > within))
}

/// Makes what an answer names and a `rival` has something else for rivals of each other, side by side: neither explains so much
/// more that the other is ruled out.
pub(super) fn contest(answer: &mut Answer, rival: Explanation, candidates: &[Candidate]) {
    let judgement = &mut answer.judgement;
    let only_in = |one: &[usize], other: &[usize]| -> Vec<usize> {
        one.iter().copied().filter(|term| !other.contains(term)).collect()
    };
    let others = only_in(&rival.terms, &answer.found.best.terms);
    for term in only_in(&answer.found.best.terms, &rival.terms) {
        // Another shape of the same mechanism there is no other answer.
        let there = |other: &&usize| {
            let (own, other) = (&candidates[term], &candidates[**other]);
            own.side == other.side && own.id != other.id
        };
        let Some(other) = others.iter().find(there) else { continue };
        let new =
            judgement.contested.iter_mut().find(|contest| contest.term == term && !contest.rivals.contains(other));
        if let Some(contest) = new {
            contest.rivals.push(*other);
            tell_once(&mut judgement.groups, vec![candidates[term].name(), candidates[*other].name()]);
            judgement.named.retain(|named| *named != term);
            judgement.verdict = Verdict::Undecided;
        }
    }
    if judgement.verdict == Verdict::Undecided {
        judgement.rivals.push(rival);
    }
}
