//! Pumps and supplies that weaken during a run, which one pressure alone does not tell from a sensor that drifts.

use model::rig::{Pump, Source};

use crate::bench::Bench;
use crate::search::candidate::{Candidate, DRIFT, names_of};

/// Note on a named drift that something else which changes slowly would pass for: a pump without pistons that wears or warms, a bottle
/// that empties. No mechanism describes either. `None` where there is neither, or a second pressure would have told.
pub(crate) fn in_words(bench: &Bench<'_>, candidates: &[Candidate], named: &[usize]) -> Option<String> {
    let drifts = |term: &&usize| candidates.get(**term).is_some_and(|candidate| candidate.id == DRIFT);
    let those: Vec<usize> = named.iter().filter(drifts).copied().collect();
    let has_pump = bench.rig.pumps.values().any(|pump| matches!(pump, Pump::Flow(_)));
    let has_supply = bench.rig.sources.values().any(|source| matches!(source, Source::Pressure { signal: None, .. }));
    let what = match (has_pump, has_supply) {
        (true, false) => "a pump that weakens",
        (false, true) => "a supply whose pressure falls",
        (true, true) => "a pump that weakens or a supply whose pressure falls",
        (false, false) => return None,
    };
    let alone = bench.records.layout().channels() == 1;
    (alone && !those.is_empty()).then(|| {
        format!(
            "with one pressure {what} in the course of a recording looks much the same as {}: end a recording with the chamber open to \
             the air for 10 s before you believe it; a sensor that drifted then reads off zero",
            names_of(candidates, &those)
        )
    })
}

#[cfg(test)]
mod tests {
    use fit::data::Records;
    use fit::simulate::Fidelity;
    use model::rig::Rig;

    use super::*;
    use crate::made::two_chambers::{recorded, rig};
    use crate::search::candidate::candidates;

    #[test]
    fn one_pressure_does_not_tell_a_pump_that_weakens_from_a_sensor_that_drifts() {
        let noted = |rig: &Rig, id: &str| {
            let all = candidates(rig);
            let named = all.iter().position(|candidate| candidate.id == id).unwrap();
            let records = Records::new(rig, &[recorded(rig, "run.csv", &[0.5; 600], 1)]).unwrap();
            let bench = Bench::new(rig, &records, &vec![1.0; records.layout().len()], Fidelity::Averaged);
            in_words(&bench, &all, &[named])
        };
        let mut one = rig();
        one.sensors.shift_remove("sb");
        let note = noted(&one, DRIFT).unwrap();
        assert!(note.contains("a pump that weakens") && note.contains("same as sensor_drift"), "{note}");
        assert_eq!(noted(&one, "chamber_leak"), None);
        assert_eq!(noted(&rig(), DRIFT), None);
    }
}
