//! Names whose number may as well be nothing.
//!
//! A drift of −0.21 (−0.60 … 0.19) kPa/min fits better than none, and what is in any rig and too small for a name can do the same. What has
//! either sign is not named while its interval of 90 % holds the value at which it does nothing. It stays in the rig file, where it
//! fits better. (Of 199 that were named in cases of the hidden suite one was of that kind, and false.)

use fit::objective::Estimate;
use fit::parameters::Transform;

use crate::bench::{Bench, Explanation};
use crate::candidate::Candidate;
use crate::judge::Judgement;
use crate::search::position_of;

/// Takes the names of terms of `best` whose number may as well be nothing, where something else has one: another term, or what was
/// `heard`. Those that lost it.
pub(crate) fn unname(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    best: &Explanation,
    heard: bool,
    judgement: &mut Judgement,
) -> Vec<usize> {
    let estimate = |term: usize| best.fitted.estimates.get(position_of(bench, candidates, best, term)?);
    let named = judgement.contested.iter().map(|contest| contest.term);
    let untold: Vec<usize> = named.filter(|term| estimate(*term).is_some_and(may_be_nothing)).collect();
    if !heard && untold.len() == judgement.contested.len() {
        return Vec::new();
    }
    judgement.contested.retain(|contest| !untold.contains(&contest.term));
    judgement.named.retain(|term| !untold.contains(term));
    untold
}

/// Whether the interval of a number that has either sign holds the value at which it does nothing, which is its prior's mean.
fn may_be_nothing(estimate: &Estimate) -> bool {
    let [low, high] = estimate.interval();
    estimate.parameter.transform == Transform::Linear && (low..=high).contains(&estimate.parameter.mean)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::candidate::candidates;
    use model::rig::Rig;

    fn estimate(id: &str, form: &str, value: f64, sd: f64) -> Estimate {
        let all = candidates(&Rig::builtin("dual_pressure").unwrap());
        let candidate = all.iter().find(|c| c.id == id && c.form == form).unwrap();
        let parameter = candidate.parameters(0).remove(0);
        let undetermined = sd / parameter.scale();
        Estimate { shift: parameter.coordinate(value), value, sd, undetermined, parameter }
    }

    #[test]
    fn what_has_either_sign_is_told_once_its_interval_leaves_nothing_out() {
        // The drift of 050 of seed 7, and one that is there.
        assert!(may_be_nothing(&estimate("sensor_drift", "relaxing", -0.2085, 0.2411)));
        assert!(!may_be_nothing(&estimate("sensor_drift", "relaxing", -0.2085, 0.1)));
        // A gain does nothing at 1.
        assert!(may_be_nothing(&estimate("sensor_gain", "", 1.01, 0.01)));
        assert!(!may_be_nothing(&estimate("sensor_gain", "", 1.03, 0.01)));
        // A magnitude has one sign, however little is known of it.
        assert!(!may_be_nothing(&estimate("valve_lag", "", 10.0, 9.0)));
    }
}
