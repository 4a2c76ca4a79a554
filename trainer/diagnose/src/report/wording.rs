//! Plain words for things: mechanisms, components, keys, numbers.

pub(crate) use fit::wording::three_digits as three;

use model::rig::Rig;
use proto::diagnosis::FoundParameter;

use crate::report::findings::Findings;
use crate::search::candidate::Candidate;

/// Words on what a mechanism does, to be read after the name of the component.
pub(crate) fn does(id: &str) -> &'static str {
    match id {
        "valve_hysteresis" => "opens less on the way up than on the way down: it has backlash",
        "valve_stiction" => "sticks and then jumps instead of following small changes of its command",
        "valve_lag" => "follows its command late",
        "valve_force_curve" => "is pushed open by the pressure in another way than in proportion",
        "coil_heating" => "opens less as its coil warms",
        "supply_sag" => "sags when its coils draw current together, so that each valve opens less",
        "command_delay" => "acts on a command a fixed time after it was sent",
        "chamber_leak" => "leaks to the outside",
        "cross_leak" => "loses gas into another chamber, or lets it in from there",
        "piston_blowby" => "loses air past its piston rings",
        "chamber_thermal" => "warms when it is filled and cools afterwards, so its pressure overshoots and creeps back",
        "volume_compliance" => "grows with its pressure",
        "volume_change" => "has another volume than stated",
        "line_resistance" => "is throttled by the line to it",
        "exhaust_restriction" => "is throttled by what is fitted to its outlet",
        "critical_ratio" => "chokes at another pressure ratio than an ideal nozzle",
        "check_valve_cracking" => "has check valves that open only above a pressure difference",
        "pump_droop" => "delivers less the more it works against",
        "dead_zone" => "passes nothing until its command has reached some level",
        "pump_speed" => "runs at another speed than stated",
        "sensor_lag" => "shows the pressure late",
        "sensor_drift" => "drifts with time",
        "sensor_bias" => "reads too much or too little by a constant",
        "sensor_gain" => "reads too much or too little in proportion",
        _ => "does something that the model leaves out",
    }
}

/// Words on what a mechanism does where it is: by what there is of valves and chambers in the rig.
pub(crate) fn does_at(rig: &Rig, candidate: &Candidate) -> &'static str {
    let component = candidate.component.as_str();
    let has_a_valve =
        || rig.valves.values().any(|valve| [&valve.from, &valve.to].into_iter().any(|at| at == component));
    let has_both_sides = || component == "positive" && rig.volumes.contains_key("negative") && rig.volumes.len() == 2;
    match candidate.id.as_str() {
        "line_resistance" if rig.lines.contains_key(component) => {
            "loses more pressure than in proportion to its flow: part of it grows with the square"
        }
        "chamber_leak" if has_a_valve() => "leaks to the outside even when its valve is shut",
        "cross_leak" if has_both_sides() => "lets air through to the negative one",
        "supply_sag" if rig.valves.len() == 2 => "sags when both coils draw current, so that each valve opens less",
        "volume_change" if candidate.onset().is_some() => "takes on another volume while a recording runs",
        id => does(id),
    }
}

/// A component in words: `valve_neg` becomes `The negative valve`.
pub(crate) fn called(findings: &Findings<'_, '_>, candidate: &Candidate) -> String {
    let rig = findings.bench.rig;
    let component = candidate.component.as_str();
    let kind = if rig.valves.contains_key(component) {
        "valve"
    } else if rig.sensors.contains_key(component) {
        "sensor"
    } else if rig.pumps.contains_key(component) {
        return "The pump".to_owned();
    } else if rig.volumes.contains_key(component) {
        "chamber"
    } else if rig.lines.contains_key(component) {
        return format!("The line `{component}`");
    } else {
        return if candidate.id == "supply_sag" { "The valves' supply".to_owned() } else { format!("`{component}`") };
    };
    // In a rig of other sides than the paper's two, the name in its file says more.
    match candidate.side.as_str() {
        side @ ("positive" | "negative") => format!("The {side} {kind}"),
        _ => format!("The {kind} `{component}`"),
    }
}

/// A candidate for tables and legends: `positive valve: coil heating (winding)`.
pub(crate) fn short(findings: &Findings<'_, '_>, candidate: &Candidate) -> String {
    let called = called(findings, candidate);
    let shape = if candidate.form.is_empty() { String::new() } else { format!(" ({})", candidate.form) };
    format!("{}: {}{shape}", called.trim_start_matches("The "), candidate.id.replace('_', " "))
}

/// A key of the rig file without its unit and underscores.
pub(crate) fn plain(key: &str) -> String {
    const UNITS: [&str; 22] = [
        "_kpa_per_min",
        "_mm2_per_n2",
        "_per_mm2",
        "_mm2_per_n",
        "_kg_per_s_pa2",
        "_kpa_s_per_l",
        "_kpa_gauge",
        "_l_per_min",
        "_w_per_k",
        "_ml_per_kpa",
        "_per_bar",
        "_percent",
        "_duty",
        "_mm2",
        "_kpa",
        "_rpm",
        "_ms",
        "_ml",
        "_hz",
        "_k",
        "_l",
        "_s",
    ];
    let bare = UNITS.iter().find_map(|unit| key.strip_suffix(unit)).unwrap_or(key);
    bare.replace('_', " ")
}

/// A number with its unit: `0.0971 L/min`, and `1.40` where there is none.
pub(crate) fn with_unit(value: f64, unit: &str) -> String {
    format!("{} {unit}", three(value)).trim_end().to_owned()
}

/// `chamber_leak:positive` becomes `the positive chamber leaks to the outside even when its valve is shut`.
pub(crate) fn in_words(findings: &Findings<'_, '_>, name: &str) -> String {
    // Without a side where the rig has not the paper's two.
    if name.split(':').next() == crate::judge::MOVED.split(':').next() {
        return "only the rig's parameters are other than stated".to_owned();
    }
    match findings.candidates.iter().find(|candidate| candidate.name() == name) {
        Some(candidate) => {
            let called = called(findings, candidate);
            let lower = called.strip_prefix("The ").map_or(called.clone(), |rest| format!("the {rest}"));
            format!("{lower} {}", does_at(findings.bench.rig, candidate))
        }
        None => name.to_owned(),
    }
}

/// A number of a mechanism in words: `half width 0.031 (0.028 … 0.034) duty`, its interval alone where recordings do not tell it. What
/// is told of a value at which no recording was stands behind its interval, and so does the end of the range that it stands at.
pub(crate) fn number_in_words(key: &str, number: &FoundParameter, beyond: Option<&str>) -> String {
    let (key, low, high) = (plain(key), three(number.low), three(number.high));
    let told = if number.undetermined {
        format!("{key} not told by these recordings: {low} … {high} {}", number.unit)
    } else {
        let end = match number.at_end_of_range {
            Some(_) => ", the end of the range that was searched".to_owned(),
            None => beyond.map(|words| format!(", {words}")).unwrap_or_default(),
        };
        format!("{key} {} ({low} … {high}{end}) {}", three(number.value), number.unit)
    };
    // A share or a factor has no unit.
    told.trim_end().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::search::candidate::candidates;
    use proto::diagnosis::RangeEnd;

    fn said(rig: &Rig, name: &str) -> &'static str {
        let all = candidates(rig);
        does_at(rig, all.iter().find(|candidate| candidate.name() == name).unwrap())
    }

    /// A chamber in a rig with valves need not have one itself, nor need chambers be a positive and a negative one.
    #[test]
    fn a_sentence_presumes_nothing_that_the_rig_lacks() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        assert!(said(&rig, "chamber_leak:positive").ends_with("even when its valve is shut"));
        assert_eq!(said(&rig, "cross_leak:positive"), "lets air through to the negative one");
        let mut other = rig.clone();
        other.valves.shift_remove("valve_neg");
        assert_eq!(said(&other, "chamber_leak:negative"), "leaks to the outside");
        assert!(said(&other, "chamber_leak:positive").ends_with("even when its valve is shut"));
        let duo = crate::made::two_chambers::rig();
        assert_eq!(said(&duo, "chamber_leak:b"), "leaks to the outside");
        assert!(!said(&duo, "cross_leak:a").contains("positive"));
    }

    #[test]
    fn a_number_of_a_rig_is_told_with_its_unit_and_its_key_without() {
        assert_eq!(plain("offset_l_per_min"), "offset");
        assert_eq!(plain("resistance_kpa_s_per_l"), "resistance");
        assert_eq!(plain("pressure_area_mm2_per_n"), "pressure area");
        assert_eq!([with_unit(0.0971, "L/min"), with_unit(1.4, "")], ["0.0971 L/min", "1.40"]);
    }

    /// The end of a range says something of a number that is told there, and nothing of one that is not.
    #[test]
    fn the_end_of_a_range_belongs_to_a_number_that_is_told() {
        let number = |undetermined: bool| FoundParameter {
            value: 880.0,
            unit: "ms".to_owned(),
            low: 0.125,
            high: 900.0,
            at_end_of_range: Some(RangeEnd::High),
            undetermined,
        };
        let told = number_in_words("lag_ms", &number(false), None);
        assert_eq!(told, "lag 880 (0.125 … 900, the end of the range that was searched) ms");
        let untold = number_in_words("lag_ms", &number(true), Some("beyond what was recorded"));
        assert_eq!(untold, "lag not told by these recordings: 0.125 … 900 ms");
    }
}
