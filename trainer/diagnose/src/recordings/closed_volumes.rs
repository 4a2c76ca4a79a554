//! Volumes that a measured flow fills and nothing empties.
//!
//! A flow meter's error, fed into a closed volume, adds up: 0.1 L/min is 17 mL in ten seconds, a tenth of a breath. What a
//! free run is off by then tells of the meter, not of the rig. Such rigs are run freely for a few seconds at a time, each
//! piece from its own first pressures. Rigs whose volumes are joined to the open air or to a given pressure forget, and are
//! run from end to end.

use fit::data::Records;
use model::rig::{ATMOSPHERE, Line, Pump, Rig, Source};

/// Rows at the start of a piece that do not count: what no sensor shows is there only as far as the first reading tells.
const UNSETTLED_ROWS: usize = 3;

/// The first recorded flow into a volume that nothing joins to the open air or a given pressure.
pub fn accumulates(rig: &Rig) -> Option<&str> {
    let mut joins: Vec<[&str; 2]> = Vec::new();
    joins.extend(rig.valves.values().map(|v| [v.from.as_str(), v.to.as_str()]));
    joins.extend(rig.pumps.values().map(|pump| match pump {
        Pump::Piston(p) => [p.inlet.as_str(), p.outlet.as_str()],
        Pump::Flow(p) => [p.inlet.as_str(), p.outlet.as_str()],
    }));
    joins.extend(rig.lines.values().map(|line| match line {
        Line::Orifice { from, to, .. } | Line::Laminar { from, to, .. } => [from.as_str(), to.as_str()],
    }));
    let given = |place: &str| place == ATMOSPHERE || rig.sources.contains_key(place);
    rig.sources.iter().find_map(|(name, source)| {
        let Source::Flow { to, signal: Some(_), .. } = source else { return None };
        let mut reached = vec![to.as_str()];
        while let Some(next) = joins.iter().find_map(|[one, other]| {
            let new = |from: &str, to: &str| reached.contains(&from) && !reached.contains(&to);
            if new(one, other) { Some(*other) } else { new(other, one).then_some(*one) }
        }) {
            reached.push(next);
        }
        reached.iter().all(|place| !given(place)).then_some(name.as_str())
    })
}

/// Takes the first rows of every recording out of what counts.
pub fn without_starts(records: &Records, usable: &mut [f64]) {
    for (_, _, range) in records.layout().all() {
        let first = range.start..range.end.min(range.start + UNSETTLED_ROWS);
        usable.get_mut(first).unwrap_or_default().fill(0.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_closed_lung_adds_up_and_one_with_a_vent_does_not() {
        const LUNG: &str = include_str!("../../../../docs/rigs/ventilator_c50_r20.toml");
        assert_eq!(accumulates(&Rig::from_toml(LUNG).unwrap()), Some("ventilator"));
        let vented = LUNG.replace("to = \"lung\"", "to = \"atmosphere\"");
        assert_eq!(accumulates(&Rig::from_toml(&vented).unwrap()), None);
        assert_eq!(accumulates(&Rig::builtin("dual_pressure").unwrap()), None, "no recorded flow");
    }
}
