//! Numbers at an end of the range that was searched.
//!
//! Ranges keep a fit out of nonsense; they are no knowledge of the rig at hand. A number that a fit drives to an end of its
//! range was cut off there: the range is widened and the fit asked again, as far as a rig file may hold the number. What ends at an
//! end even then is something like the mechanism, not it ([`at_an_end`]).

use model::rig::Rig;

use crate::bench::{Bench, Effort, Explanation};
use crate::search::candidate::Candidate;
use crate::search::{cost, values_of};

/// Times that ranges are widened, each time as [`Candidate::wider`] does.
const WIDENINGS: usize = 3;
/// Times that the distance to a new end is halved where the rig cannot be built there.
const HALVINGS: usize = 6;

/// An explanation whose ranges have been widened until none of its numbers is at an end, or they can be widened no further. The
/// candidates have the new ranges.
pub(crate) fn widened(bench: &Bench<'_>, candidates: &mut [Candidate], mut best: Explanation) -> Explanation {
    for _ in 0..WIDENINGS {
        let mut moved = false;
        for term in best.terms.clone() {
            let Some(values) = values_of(bench, candidates, &best, term) else { continue };
            let Some(candidate) = candidates.get_mut(term) else { continue };
            for place in 0..values.len() {
                moved |= widen(bench.rig, candidate, &values, place);
            }
        }
        if !moved {
            break;
        }
        let start = best.fitted.point.clone();
        match bench.fit(candidates, &best.terms, &[start], Effort::Polish) {
            Ok(again) if cost(bench, &again) <= cost(bench, &best) => best = again,
            _ => break,
        }
    }
    best
}

/// Widens the range of one number of a candidate that stands at an end of it; whether it could.
fn widen(rig: &Rig, candidate: &mut Candidate, values: &[f64], place: usize) -> bool {
    let Some(value) = values.get(place).copied() else { return false };
    let Some(end) = candidate.end_of_range(place, value) else { return false };
    let Some(mut wider) = candidate.wider(place, end) else { return false };
    let can_be_built = |value: f64| {
        let mut values = values.to_vec();
        if let Some(slot) = values.get_mut(place) {
            *slot = value;
        }
        let mut with = rig.clone();
        with.mechanisms.push(candidate.attached(&values));
        with.check().is_ok()
    };
    for _ in 0..HALVINGS {
        if can_be_built(wider) {
            break;
        }
        wider = 0.5 * (wider + value);
    }
    if !can_be_built(wider) || (wider - value).abs() <= 1e-3 * value.abs() {
        return false;
    }
    candidate.widen(place, end, wider);
    true
}

/// Note on a term whose magnitude stands at an end of its range, however wide; `None` where none does.
pub(crate) fn at_an_end(bench: &Bench<'_>, candidates: &[Candidate], best: &Explanation) -> Option<String> {
    best.terms.iter().find_map(|term| {
        let candidate = candidates.get(*term)?;
        let value = *values_of(bench, candidates, best, *term)?.first()?;
        candidate.end_of_range(0, value)?;
        let key = candidate.keys().next()?;
        Some(format!(
            "{} fits best with {key} = {value:.3e}, an end of the range that such a part can have: something like it, not it",
            candidate.name()
        ))
    })
}

#[cfg(test)]
mod tests {
    use fit::data::Records;
    use proto::diagnosis::RangeEnd;

    use super::*;
    use crate::made::{self, made_after, moved};
    use crate::search::candidate::candidates;

    /// A leak beyond the range is no longer held at its end once the range is widened.
    #[test]
    fn a_number_beyond_its_range_is_not_held_at_its_end() {
        let (rig, _) = moved(&[]);
        let mut all = candidates(&rig);
        let leak = all.iter().position(|candidate| candidate.name() == "chamber_leak:positive").unwrap();
        let (true_value, high) = (2e-14, 4e-15);
        // A range that ends short of the truth.
        all[leak].widen(0, RangeEnd::High, high);
        let mut truth = rig.clone();
        truth.mechanisms.push(all[leak].attached(&[true_value]));
        let records = Records::new(&rig, &made_after(0, 2000, &truth, 1, 3)).unwrap();
        let bench = made::bench(&rig, &records);
        let mut start = vec![0.0; bench.nominal.len()];
        start.extend(all[leak].parameters(0).iter().map(|p| p.coordinate(2e-15)));
        let best = bench.fit(&all, &[leak], &[start], Effort::Polish).unwrap();
        assert!(at_an_end(&bench, &all, &best).is_some());
        let best = widened(&bench, &mut all, best);
        let found = values_of(&bench, &all, &best, leak).unwrap()[0];
        // Valves that are open all the time leave a leak's size to the rig's own parameters: what is asked is that the range no
        // longer decides it, not that these recordings find it.
        assert!(found > high && at_an_end(&bench, &all, &best).is_none(), "{found:e}");
    }
}
