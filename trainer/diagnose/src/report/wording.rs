//! Plain words for things: mechanisms, components, keys, numbers.

pub(crate) use fit::wording::three_digits as three;

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
        "supply_sag" => "sags when both coils draw current, so that each valve opens less",
        "command_delay" => "acts on a command a fixed time after it was sent",
        "chamber_leak" => "leaks to the outside even when its valve is shut",
        "cross_leak" => "lets air pass back from the positive to the negative side",
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

/// Words on what a mechanism does where it is.
pub(crate) fn does_at(findings: &Findings<'_, '_>, candidate: &Candidate) -> &'static str {
    let line = findings.bench.rig.lines.contains_key(&candidate.component);
    match candidate.id.as_str() {
        "line_resistance" if line => {
            "loses more pressure than in proportion to its flow: part of it grows with the square"
        }
        "chamber_leak" if findings.bench.rig.valves.is_empty() => "leaks to the outside",
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
    const UNITS: [&str; 18] = [
        "_kpa_per_min",
        "_mm2_per_n2",
        "_per_mm2",
        "_kg_per_s_pa2",
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
            format!("{lower} {}", does_at(findings, candidate))
        }
        None => name.to_owned(),
    }
}
