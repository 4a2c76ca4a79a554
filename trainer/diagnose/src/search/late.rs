//! Late valves and late sensors in exchange for one another: a delay, a lag, or two of such, with their sum as it is.
//!
//! To first order readings show only the sum of the times by which something is late. So a search may take the wrong ones first (a
//! late sensor on each side for a lag and a delay of each valve), and no exchange of one term, or of one mechanism on both sides,
//! leads over to the right ones: these are more, or fewer. Here all that is late is exchanged at once.

use fit::cores::side_by_side_telling;

use super::additions::is_cheaper;
use super::terms::{is_open, kinds, position_of, starts_at, values_of, with};
use super::{PAIR_ROUNDS, SearchSettings};
use crate::bench::{Bench, Effort, Explanation};
use crate::error::DiagnoseError;
use crate::search::candidate::Candidate;
use crate::search::quick_search::{Footing, Glanced};

/// Mechanisms by which a valve is late; their first number says by how much, in ms.
pub(crate) const LATE_VALVES: [&str; 2] = ["valve_lag", "command_delay"];
/// The one by which a sensor is.
pub(crate) const LATE_SENSOR: &str = "sensor_lag";

/// Mechanisms that may make a chamber's readings late together.
const TOGETHER: [&[&str]; 6] = [
    &["valve_lag"],
    &["command_delay"],
    &["sensor_lag"],
    &["valve_lag", "command_delay"],
    &["valve_lag", "sensor_lag"],
    &["command_delay", "sensor_lag"],
];

/// Cost by which an exchange may be behind after a glance for it to be fitted: terms that are all new are far from where they will end
/// (chosen; the right ones were ahead by 65 and by 400 at a glance, and by 86 and 1,968 in the end).
const BEHIND: f64 = 1000.0;
/// Number of exchanges, those nearest after a glance, that are fitted (chosen).
const FITTED: usize = 2;

/// Tells whether readings come late behind the commands by a candidate, whatever else it does.
fn is_late(candidate: &Candidate) -> bool {
    candidate.id == LATE_SENSOR || LATE_VALVES.contains(&candidate.id.as_str())
}

/// Terms that are late with what is late in their place on their side in a `rival` of the same terms otherwise; none where the rival is
/// another one, or has all of them.
pub(crate) fn late_in_place_of(candidates: &[Candidate], terms: &[usize], rival: &[usize]) -> Vec<(usize, usize)> {
    let split = |terms: &[usize]| -> (Vec<usize>, Vec<usize>) {
        terms.iter().copied().partition(|term| is_late(&candidates[*term]))
    };
    let ((own, rest), (its, its_rest)) = (split(terms), split(rival));
    if rest != its_rest {
        return Vec::new();
    }
    let new: Vec<usize> = its.iter().copied().filter(|k| !own.contains(k)).collect();
    let gone = own.into_iter().filter(|term| !its.contains(term));
    let stands_in = |term: usize| {
        // Another shape of a mechanism is no other mechanism.
        let there = new.iter().filter(move |k| {
            let (one, other) = (&candidates[**k], &candidates[term]);
            one.side == other.side && one.id != other.id
        });
        there.map(move |k| (term, *k))
    };
    gone.flat_map(stands_in).collect()
}

/// Exchanges all that is late in `best`, on every side where something is, for what else may be, where that costs less.
pub(super) fn exchanged_late(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    mut best: Explanation,
    settings: &SearchSettings,
    tried: &mut Vec<Explanation>,
    tell: &mut dyn FnMut(&str, f64),
) -> Result<Explanation, DiagnoseError> {
    let late: Vec<usize> = best.terms.iter().copied().filter(|term| is_late(&candidates[*term])).collect();
    // Of one term every exchange was tried as such.
    if late.len() < 2 {
        return Ok(best);
    }
    let footing = Footing::of(bench, &best)?;
    let asked: Vec<Exchange> =
        TOGETHER.iter().filter_map(|ids| Exchange::of(bench, candidates, &best, &late, ids)).collect();
    let allowed = |exchange: &&Exchange| {
        exchange.terms != best.terms && kinds(candidates, &exchange.terms) <= settings.most_kinds
    };
    let asked: Vec<&Exchange> = asked.iter().filter(allowed).collect();
    let glance = |exchange: &&Exchange| -> Result<Option<Glanced>, DiagnoseError> {
        let set = bench.set_of(candidates, &exchange.terms)?;
        Ok(footing.contender_within(bench, &set, &exchange.starts, PAIR_ROUNDS, BEHIND))
    };
    let glances = side_by_side_telling(&asked, glance, &mut |share| tell("exchanging what is late", share));
    let glances: Vec<Option<Glanced>> = glances.into_iter().collect::<Result<_, _>>()?;
    let mut near: Vec<(&Exchange, Glanced)> = asked.iter().zip(glances).filter_map(|(e, g)| Some((*e, g?))).collect();
    near.sort_by(|a, b| a.1.cost.total_cmp(&b.1.cost));
    near.truncate(FITTED);
    let fit = |(exchange, glanced): &(&Exchange, Glanced)| {
        bench.fit(candidates, &exchange.terms, std::slice::from_ref(&glanced.point), Effort::Polish).ok()
    };
    let fits = side_by_side_telling(&near, fit, &mut |share| tell("exchanging what is late", share));
    for fitted in fits.into_iter().flatten() {
        if is_cheaper(bench, &fitted, &best) {
            tried.push(std::mem::replace(&mut best, fitted));
        } else {
            tried.push(fitted);
        }
    }
    Ok(best)
}

/// Terms with others that are late, and where their fit starts.
struct Exchange {
    terms: Vec<usize>,
    starts: Vec<Vec<f64>>,
}

impl Exchange {
    /// Exchange of the terms `late` of `best` for mechanisms of these `ids`, wherever one of the former is; `None` where one of the
    /// latter cannot be there.
    fn of(
        bench: &Bench<'_>,
        candidates: &[Candidate],
        best: &Explanation,
        late: &[usize],
        ids: &[&str],
    ) -> Option<Exchange> {
        let mut terms: Vec<usize> = best.terms.iter().copied().filter(|term| !late.contains(term)).collect();
        let mut sides: Vec<&str> = late.iter().map(|term| candidates[*term].side.as_str()).collect();
        sides.sort_unstable();
        sides.dedup();
        let mut shared = Vec::new();
        for side in sides {
            let there = late.iter().copied().filter(|term| candidates[*term].side == side);
            let late_ms = |term: usize| {
                let values = values_of(bench, candidates, best, term)?;
                Some((term, candidates[term].times_ms(&values)))
            };
            let known: Vec<(usize, f64)> = there.filter_map(late_ms).collect();
            let mut chosen = Vec::new();
            for id in ids {
                let stays = known.iter().map(|(term, _)| *term).find(|term| candidates[*term].id == *id);
                let offered = |k: &usize| {
                    let candidate = &candidates[*k];
                    candidate.id == *id && candidate.side == side && is_open(bench, candidates, &terms, *k)
                };
                let term = stays.or_else(|| (0..candidates.len()).find(offered))?;
                terms = with(&terms, term);
                chosen.push(term);
            }
            shared.extend(shares(&known, &chosen));
        }
        let with_the_rest = shared.iter().map(|share| (share.term, share.rest_ms));
        let equal = shared.iter().map(|share| (share.term, share.equal_ms));
        let starts = [with_the_rest.collect::<Vec<_>>(), equal.collect()];
        let starts = starts.iter().filter_map(|times| start(bench, candidates, best, &terms, times)).collect();
        Some(Exchange { terms, starts })
    }
}

/// Times in ms that a term takes over on its side.
struct Share {
    term: usize,
    /// Time that it had where it stood there already, an equal part of what is left where it is new.
    rest_ms: f64,
    /// Equal part of all.
    equal_ms: f64,
}

/// Times that the `chosen` terms take over of those `known` on a side, with the same sum.
fn shares(known: &[(usize, f64)], chosen: &[usize]) -> Vec<Share> {
    let of = |term: usize| known.iter().find(|(known, _)| *known == term).map(|(_, ms)| *ms);
    let all_ms: f64 = known.iter().map(|(_, ms)| ms).sum();
    let stay_ms: f64 = chosen.iter().filter_map(|term| of(*term)).sum();
    let new = chosen.iter().filter(|term| of(**term).is_none()).count();
    let equal_ms = all_ms / chosen.len() as f64;
    let share = |term: &usize| {
        let rest_ms = match of(*term) {
            Some(ms) if new > 0 => ms,
            Some(ms) if stay_ms > 0.0 => ms * all_ms / stay_ms,
            Some(_) => equal_ms,
            None => (all_ms - stay_ms) / new as f64,
        };
        Share { term: *term, rest_ms, equal_ms }
    };
    chosen.iter().map(share).collect()
}

/// Start of a fit of `terms` near `best`, with these times in ms for those that are late.
fn start(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    best: &Explanation,
    terms: &[usize],
    times: &[(usize, f64)],
) -> Option<Vec<f64>> {
    let mut point = best.fitted.point.clone();
    let mut new = Vec::new();
    for (term, ms) in times {
        let parameter = candidates[*term].parameters(0).into_iter().next()?;
        let [low, high] = parameter.bounds;
        match position_of(bench, candidates, best, *term) {
            Some(place) => {
                // A second time constant of a sensor stays as it is.
                let values = values_of(bench, candidates, best, *term)?;
                let further_ms = candidates[*term].times_ms(&values) - values.first()?;
                *point.get_mut(place)? = parameter.coordinate((ms - further_ms).clamp(low, high));
            }
            None => new.push((*term, vec![ms.clamp(low, high)])),
        }
    }
    starts_at(bench, candidates, (best, &point), terms, &new, false).pop()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sensor's 55 ms beside nothing, and 31 ms of one beside a lag of 60 ms, for a delay or for both of a valve.
    #[test]
    fn what_is_late_keeps_its_sum() {
        let times = |known: &[(usize, f64)], chosen: &[usize]| -> Vec<[f64; 2]> {
            shares(known, chosen).iter().map(|share| [share.rest_ms, share.equal_ms]).collect()
        };
        assert_eq!(times(&[(7, 55.0)], &[2, 5]), [[27.5, 27.5], [27.5, 27.5]]);
        assert_eq!(times(&[(7, 31.0), (2, 60.0)], &[2, 5]), [[60.0, 45.5], [31.0, 45.5]]);
        assert_eq!(times(&[(7, 30.0), (2, 60.0)], &[2]), [[90.0, 90.0]]);
        // A delay of nothing stays beside a sensor's lag, and takes it over.
        assert_eq!(times(&[(7, 30.0), (2, 0.0)], &[2]), [[30.0, 30.0]]);
    }

    /// Two late sensors are told from a delay and a lag of each valve, or are their rivals; nothing is that lacks another term.
    #[test]
    fn what_stands_for_late_terms_is_what_is_late_on_their_side() {
        let all = crate::search::candidate::candidates(&model::rig::Rig::builtin("dual_pressure").unwrap());
        let of = |names: &[&str]| -> Vec<usize> {
            let at = |name: &&str| all.iter().position(|c| c.full_name() == **name).unwrap();
            let mut terms: Vec<usize> = names.iter().map(at).collect();
            terms.sort_unstable();
            terms
        };
        let sensors =
            of(&["valve_hysteresis:positive", "sensor_lag:positive", "valve_lag:negative", "sensor_lag:negative"]);
        let valves =
            of(&["valve_hysteresis:positive", "valve_lag:positive", "valve_lag:negative", "command_delay:negative"]);
        let pair = |one: &str, other: &str| (of(&[one])[0], of(&[other])[0]);
        let mut found = late_in_place_of(&all, &sensors, &valves);
        found.sort_unstable();
        let mut expected =
            [pair("sensor_lag:positive", "valve_lag:positive"), pair("sensor_lag:negative", "command_delay:negative")];
        expected.sort_unstable();
        assert_eq!(found, expected);
        assert_eq!(late_in_place_of(&all, &sensors[1..], &valves), []);
        let armature = of(&["valve_hysteresis:negative", "valve_lag:negative (armature)"]);
        assert_eq!(late_in_place_of(&all, &of(&["valve_hysteresis:negative", "valve_lag:negative"]), &armature), []);
        assert_eq!(late_in_place_of(&all, &sensors, &sensors), []);
    }
}
