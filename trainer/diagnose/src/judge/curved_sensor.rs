//! Sensors whose reading bends with the pressure, which one pressure alone does not tell from a pump or a line that does.

use crate::bench::Bench;
use crate::search::candidate::{Candidate, names_of};

/// Mechanisms that bend the pressure that a command leads to, as a curved sensor bends its reading.
const BENDS: [&str; 2] = ["pump_droop", "line_resistance"];

/// Note on named terms that a curved sensor would pass for; `None` where a second pressure, or a second pump, would have told.
pub(crate) fn in_words(bench: &Bench<'_>, candidates: &[Candidate], named: &[usize]) -> Option<String> {
    let alone = bench.records.layout().channels() == 1 && bench.rig.pumps.len() == 1;
    let bends = |term: &&usize| candidates.get(**term).is_some_and(|candidate| BENDS.contains(&candidate.id.as_str()));
    let those: Vec<usize> = named.iter().filter(bends).copied().collect();
    (alone && !those.is_empty()).then(|| {
        format!(
            "with one pump and one pressure a sensor whose reading bends with the pressure looks the same as {}: compare the sensor with \
             another gauge at a low and a high pressure before you believe it",
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
    fn one_pressure_does_not_tell_a_pump_from_a_curved_sensor() {
        let noted = |rig: &Rig, id: &str| {
            let all = candidates(rig);
            let named = all.iter().position(|candidate| candidate.id == id).unwrap();
            let records = Records::new(rig, &[recorded(rig, "run.csv", &[0.5; 600], 1)]).unwrap();
            let bench = Bench::new(rig, &records, &vec![1.0; records.layout().len()], Fidelity::Averaged);
            in_words(&bench, &all, &[named])
        };
        let mut one = rig();
        one.sensors.shift_remove("sb");
        assert!(noted(&one, "pump_droop").is_some_and(|note| note.contains("looks the same as pump_droop")));
        assert_eq!(noted(&one, "chamber_leak"), None);
        assert_eq!(noted(&rig(), "pump_droop"), None);
    }
}
