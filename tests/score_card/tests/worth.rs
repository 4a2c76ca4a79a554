//! Worth of answers, counted by hand.

#![allow(clippy::unwrap_used)] // a test that cannot go on should say where

use score_card::case::CaseScore;
use score_card::worth::{Kept, Worth};

/// A line: what is concealed, the last answer, how it stands to the truth, its names, and what its rig is off by in both pressures.
fn line(class: &str, answer: &str, last: &str, names: &[(&str, &str)], off_kpa: f64) -> CaseScore {
    serde_json::from_value(serde_json::json!({
        "case": "case_000", "class": class, "level_kpa": 1.0, "ripple_beats": false, "concealed": "any",
        "first_answer": answer, "answer": answer, "first": last, "last": last, "names": names, "rivals": [],
        "experiments": [], "trouble": null,
        "oracle": {"case": "case_000", "nuisance_chi2": 0.0, "effects": []}, "separable": true,
        "held_out": {"nominal_kpa": null, "refit_kpa": null, "first_kpa": null, "extended_kpa": [off_kpa, off_kpa],
            "floor_kpa": [0.0, 0.0], "noise_kpa": [0.1, 0.1]},
        "numbers": [], "took": {"wall_s": 1.0, "cpu_s": 1.0}, "refit_took": null
    }))
    .unwrap()
}

#[test]
fn each_kind_of_answer_is_counted_by_what_became_of_it() {
    let cases = [
        line("single", "valve_lag", "right", &[("valve_lag:both", "true")], 0.0),
        line("pair", "valve_lag", "partly", &[("valve_lag:both", "true")], 0.0),
        line("single", "sensor_lag", "false_name", &[("sensor_lag:both", "false")], 0.0),
        line("nothing", "parameters_moved", "right", &[], 0.5),
        line("single", "parameters_moved", "missed", &[], 0.02),
        line("outside", "unknown_mechanism", "right", &[], 0.0),
        line("single", "unknown_mechanism", "thought_unknown", &[], 0.0),
        // The neighbour of what the library lacks is no false name.
        line("outside", "chamber_thermal", "adjacent", &[("chamber_thermal:positive", "false")], 0.0),
        // A false name beside what is left undecided is one.
        line("parameters_moved", "undecided", "undecided", &[("chamber_leak:negative", "false")], 0.0),
        line("single", "none", "failed", &[], 0.0),
    ];
    let worth = Worth::of(&cases);
    let kept = |said: &str| worth.answers.get(said).cloned().unwrap();
    assert_eq!(kept("something is named"), Kept { answers: 4, whole: 1, part: 2, more: 0, wrong: 1 });
    assert_eq!(kept("nothing is missing"), Kept { answers: 2, whole: 1, part: 0, more: 1, wrong: 0 });
    assert_eq!(kept("something unknown is missing"), Kept { answers: 2, whole: 1, part: 0, more: 1, wrong: 0 });
    assert_eq!(kept("not decided"), Kept { answers: 1, whole: 0, part: 0, more: 0, wrong: 1 });
    // The null's rig is not among those that missed something.
    assert_eq!(worth.missed_kpa.map(|spread| (spread.count, spread.median)), Some((1, 0.02)));
    assert_eq!((worth.names.of_them, worth.names.all), (2, 5));
    assert!(worth.table().contains("| something is named | 4 | 1 (25 %) | 2 (50 %) | 0 (0 %) | 1 (25 %) |"));
}
