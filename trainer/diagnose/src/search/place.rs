//! Where a component sits: which side of the rig, in the words of a diagnosis.

use model::rig::{ATMOSPHERE, Line, Pump, Rig, Source};

/// The volumes that a component touches, in the order of the rig file; empty for one that is not in the rig.
pub fn volumes_at<'r>(rig: &'r Rig, component: &str) -> Vec<&'r str> {
    let joins: Vec<&str> = if let Some(valve) = rig.valves.get(component) {
        vec![&valve.from, &valve.to]
    } else if let Some(pump) = rig.pumps.get(component) {
        match pump {
            Pump::Piston(p) => vec![&p.inlet, &p.outlet],
            Pump::Flow(p) => vec![&p.inlet, &p.outlet],
        }
    } else if let Some(line) = rig.lines.get(component) {
        match line {
            Line::Orifice { from, to, .. } | Line::Laminar { from, to, .. } => vec![from, to],
        }
    } else if let Some(sensor) = rig.sensors.get(component) {
        vec![&sensor.volume]
    } else if let Some(Source::Flow { to, .. }) = rig.sources.get(component) {
        vec![to]
    } else if rig.volumes.contains_key(component) {
        vec![component]
    } else if component == ATMOSPHERE {
        rig.volumes.keys().map(String::as_str).collect()
    } else {
        vec![]
    };
    rig.volumes.keys().map(String::as_str).filter(|name| joins.contains(name)).collect()
}

/// `positive`, `negative` (the name of the volume, in a rig of other volumes) or `both`.
pub fn side(rig: &Rig, components: &[String]) -> String {
    let mut touched: Vec<&str> = components.iter().flat_map(|component| volumes_at(rig, component)).collect();
    touched.sort_unstable();
    touched.dedup();
    match touched.as_slice() {
        [] => "both".to_owned(),
        [one] => (*one).to_owned(),
        _ => "both".to_owned(),
    }
}

/// As [`side`], of one component.
pub fn side_of(rig: &Rig, component: &str) -> String {
    side(rig, &[component.to_owned()])
}

/// The channel (index of the sensor) that reads a volume.
pub fn channel_of(rig: &Rig, volume: &str) -> Option<usize> {
    rig.sensors.values().position(|sensor| sensor.volume == volume)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn components_of_the_papers_rig_are_on_their_sides() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        let at = |names: &[&str]| side(&rig, &names.iter().map(|n| (*n).to_owned()).collect::<Vec<_>>());
        assert_eq!(at(&["valve_pos"]), "positive");
        assert_eq!(at(&["sensor_neg"]), "negative");
        assert_eq!(at(&["negative"]), "negative");
        assert_eq!(at(&["pump"]), "both");
        assert_eq!(at(&["valve_pos", "valve_neg"]), "both");
        assert_eq!(channel_of(&rig, "negative"), Some(1));
    }
}
