//! Candidates for what is missing from a rig: the list that a search for missing physics goes through.

use std::collections::BTreeSet;

use model::mechanism::{Candidate, candidates};
use model::rig::Rig;

use crate::small_rigs::simulation;

/// Every id that a diagnosis may name.
const NAMED: [&str; 23] = [
    "valve_hysteresis",
    "valve_stiction",
    "valve_lag",
    "valve_force_curve",
    "coil_heating",
    "supply_sag",
    "command_delay",
    "chamber_leak",
    "cross_leak",
    "piston_blowby",
    "chamber_thermal",
    "volume_compliance",
    "volume_change",
    "line_resistance",
    "exhaust_restriction",
    "critical_ratio",
    "check_valve_cracking",
    "pump_droop",
    "pump_speed",
    "sensor_lag",
    "sensor_drift",
    "sensor_bias",
    "sensor_gain",
];

fn paper() -> Rig {
    Rig::builtin("dual_pressure").unwrap()
}

fn ids(found: &[Candidate]) -> BTreeSet<&'static str> {
    found.iter().map(|c| c.id).collect()
}

/// Values of all parameters: the `n`-th start of the first, the first start of the others.
fn values(candidate: &Candidate, n: usize) -> Vec<f64> {
    let mut values: Vec<f64> = candidate.parameters.iter().map(|p| p.starts[0]).collect();
    values[0] = candidate.parameters[0].starts[n];
    values
}

#[test]
fn every_named_mechanism_is_a_candidate_on_the_papers_rig() {
    let found = candidates(&paper());
    assert_eq!(ids(&found), NAMED.into_iter().collect());
    let at = |id: &str| found.iter().filter(|c| c.id == id).map(|c| c.component.as_str()).collect::<Vec<_>>();
    // One play, and several side by side.
    assert_eq!(at("valve_hysteresis"), ["valve_pos", "valve_pos", "valve_neg", "valve_neg"]);
    assert_eq!(at("cross_leak"), ["positive"], "each pair once");
    assert_eq!(at("supply_sag"), ["rig"]);
    assert_eq!(at("sensor_gain"), ["sensor_pos", "sensor_neg"]);
    // Both ports of the pump, both valves.
    assert_eq!(at("line_resistance"), ["valve_pos", "valve_neg", "pump", "pump"]);
}

#[test]
fn every_start_makes_a_sound_rig_within_the_limits() {
    let rig = paper();
    for candidate in candidates(&rig) {
        assert!(!candidate.parameters.is_empty(), "{candidate:?}");
        for (index, parameter) in candidate.parameters.iter().enumerate() {
            assert!(!parameter.starts.is_empty(), "{candidate:?}");
            assert_eq!(parameter.signed, parameter.low < 0.0, "{parameter:?}");
            for value in parameter.starts.iter().chain([&parameter.low, &parameter.high]) {
                assert!((parameter.low..=parameter.high).contains(value), "{parameter:?}");
                let mut values = values(&candidate, 0);
                values[index] = *value;
                let extended = candidate.on(&rig, &values);
                extended.check().unwrap_or_else(|e| panic!("{} {}: {e}", candidate.id, candidate.component));
                // What was fitted stands where a fit looks for it.
                let path = format!("mechanisms[0].{}", parameter.key);
                assert_eq!(extended.value(&path).unwrap(), *value);
            }
        }
    }
}

#[test]
fn later_starts_are_stronger() {
    let rig = paper();
    let run = |rig: &Rig| {
        let mut simulation = simulation(rig);
        let mut seen = Vec::new();
        for tick in 0..150 {
            let wave = f64::from(tick) / 50.0;
            simulation.tick(&[0.8 + 0.15 * (7.0 * wave).sin(), 0.75 + 0.2 * (5.0 * wave).cos(), 1.0]);
            seen.extend(simulation.readings_kpa());
        }
        seen
    };
    let plain = run(&rig);
    for candidate in candidates(&rig) {
        let effect = |n: usize| {
            let seen = run(&candidate.on(&rig, &values(&candidate, n)));
            seen.iter().zip(&plain).map(|(a, b)| (a - b).powi(2)).sum::<f64>()
        };
        // Of one sign where there are two.
        let starts = &candidate.parameters[0].starts;
        let same_sign: Vec<usize> = if candidate.parameters[0].signed || candidate.id == "sensor_gain" {
            (0..starts.len()).step_by(2).collect()
        } else {
            (0..starts.len()).collect()
        };
        let effects: Vec<f64> = same_sign.iter().map(|n| effect(*n)).collect();
        let name = format!("{} on {} ({}): {effects:?}", candidate.id, candidate.component, candidate.form);
        // Jumps come where they come: starts a tenth apart may swap places, those four times apart may not.
        let apart = if candidate.stepped { 4 } else { 1 };
        assert!(effects.windows(apart + 1).all(|w| w[apart] > w[0]) && effects[0] > 0.0, "{name}");
    }
}

#[test]
fn what_is_attached_is_no_candidate_unless_it_is_off() {
    let mut bench = Rig::builtin("bench").unwrap();
    let missing =
        |rig: &Rig, id: &str, component: &str| candidates(rig).iter().any(|c| c.id == id && c.component == component);
    assert!(!missing(&bench, "valve_lag", "valve_pos") && !missing(&bench, "chamber_thermal", "positive"));
    assert!(missing(&bench, "chamber_thermal", "negative"));
    for attached in &mut bench.mechanisms {
        attached.enabled = false;
    }
    assert!(missing(&bench, "valve_lag", "valve_pos"));
}

#[test]
fn other_rigs_get_what_makes_sense_there() {
    let text = r#"
format = 1
name = "pump and hose"
gas = { gas_constant_j_per_kg_k = 287.0, heat_capacity_ratio = 1.4 }
atmosphere = { pressure_kpa_abs = 101.325, temperature_k = 293.15 }
[volumes.line]
volume_l = 0.1
temperature_k = 293.15
[pumps.pump]
kind = "flow"
outlet = "line"
command = "pwm"
flow_l_per_min = 3.0
[lines.hose]
kind = "laminar"
from = "line"
to = "atmosphere"
resistance_kpa_s_per_l = 100.0
[sensors.gauge]
volume = "line"
column = "p_kpa"
range_kpa_gauge = [0.0, 100.0]
range_v = [1.0, 5.0]
"#;
    let rig = Rig::from_toml(text).unwrap();
    let found = candidates(&rig);
    let expected = [
        "chamber_leak",
        "chamber_thermal",
        "command_delay",
        "dead_zone",
        "line_resistance",
        "pump_droop",
        "pump_speed",
        "sensor_bias",
        "sensor_drift",
        "sensor_gain",
        "sensor_lag",
        "valve_lag",
        "volume_change",
        "volume_compliance",
    ];
    assert_eq!(ids(&found), expected.into_iter().collect());
    for candidate in &found {
        let extended = candidate.on(&rig, &values(candidate, 0));
        let mut simulation = simulation(&extended);
        (0..20).for_each(|_| simulation.tick(&[0.8]));
        assert!(simulation.pressure_kpa(0).is_finite(), "{candidate:?}");
    }
}
