//! Identification of rigs whose parameters are known, from recordings that the model made.
#![allow(clippy::unwrap_used)] // a test that cannot set up its case must fail

mod made;

use fit::data::switched::Change;
use fit::data::{Records, Role, Split};
use fit::identify::{IdentifySettings, run, table, undetermined, verdict};
use fit::objective::{FitSettings, Shooting, blocks_of, fit_from};
use fit::parameters::{ParameterSet, Scatter, nominal};
use fit::simulate::{Fidelity, Horizon, Simulator, errors_at};
use made::{made, quick_rig, truth};
use model::rig::Rig;
use proto::recording::Recording;
use proto::recording::csv::{Column, ColumnData};

/// The paper's rig with every free parameter off by up to about twice what its prior expects.
fn off_rig(nominal_rig: &Rig, by: f64) -> Rig {
    let set = ParameterSet::new(nominal_rig, nominal(nominal_rig, Scatter::default())).unwrap();
    let pattern = [1.0, -1.2, 0.8, -0.6, 1.1, -0.9, 0.7, -1.0, 0.5, -0.8, 0.3, -0.4, 0.2, 0.6];
    let point: Vec<f64> = (0..set.len()).map(|i| by * pattern[i % pattern.len()]).collect();
    set.rig_at(&point).unwrap()
}

#[test]
fn a_rig_that_is_off_is_found_again() {
    let nominal_rig = quick_rig();
    let truth_rig = off_rig(&nominal_rig, 1.0);
    let recordings = [made(&truth_rig, 2000, 1), made(&truth_rig, 2000, 2)];
    let found = run(&nominal_rig, &recordings, &IdentifySettings::default(), &mut |_| {}).unwrap();

    // Free run of fresh commands against the noise-free truth: within 0.05 kPa, where the rig file was off by kilopascals.
    let (duty, pressures) = truth(&truth_rig, 1500, 3);
    let fresh = made::recording("fresh.csv", &duty, &pressures);
    let records = Records::new(&nominal_rig, &[fresh]).unwrap();
    let simulator = Simulator::new(&records, Fidelity::Detailed);
    let everywhere = vec![1.0; records.layout().len()];
    let errors = |rig: &Rig| errors_at(&simulator, rig, Horizon::Free, &everywhere).unwrap();
    for (before, after) in errors(&nominal_rig).iter().zip(errors(&found.fitted.rig)) {
        assert!(before.rmse_kpa > 1.0, "the case is too easy: {before:?}");
        assert!(after.rmse_kpa < 0.05, "{after:?}");
    }

    // Every parameter within four standard errors, most within two.
    let set = ParameterSet::new(&nominal_rig, nominal(&nominal_rig, Scatter::default())).unwrap();
    let true_point = set.point_of(&truth_rig).unwrap();
    let scores: Vec<f64> =
        found.fitted.estimates.iter().zip(&true_point).map(|(e, z)| (e.shift - z).abs() / e.undetermined).collect();
    assert!(scores.iter().all(|s| *s < 4.0), "{scores:?}");
    assert!(scores.iter().filter(|s| **s < 2.0).count() * 4 >= 3 * scores.len(), "{scores:?}");

    // Both starts (rig file and the paper's procedure) end in the same minimum.
    assert_eq!(found.costs.len(), 2);
    // (Its ground is rough by several units, see `words`; another minimum would be hundreds away.)
    assert!((found.costs[0] - found.costs[1]).abs() < 15.0, "{:?}", found.costs);
    // The procedure alone comes near: valves within a few per cent, as errors in the readings bend a regression.
    for valve in &found.paper.as_ref().unwrap().valves {
        let expected = truth_rig.valves[valve.valve.as_str()].input_area_mm2;
        assert!((valve.coefficients[1] / expected - 1.0).abs() < 0.15, "{valve:?}, {expected}");
    }
    // Words: a line for each parameter; the displacement of the pump and its gas temperature act alike.
    assert_eq!(table(&found).lines().filter(|line| !line.starts_with('*')).count(), 1 + found.fitted.estimates.len());
    assert!(verdict(&found).iter().filter(|line| line.contains("nothing more to explain")).count() == 2);
    assert!(
        undetermined(&found.fitted).iter().any(|line| line.contains("pumps.pump.")),
        "{:?}",
        undetermined(&found.fitted)
    );
}

/// A recording of an experiment: at rest, the pump switched on after 1 s. Its motor takes 0.3 s to come up, as none of the model's does.
fn with_a_slow_start(rig: &Rig, rows: usize, seed: u64) -> Recording {
    const SWITCHED: usize = 50;
    const RUNS: usize = SWITCHED + 15;
    let duty = made::duties(rows, seed);
    let with_relay = |kpa: &[Vec<f64>; 2], on_from: usize| {
        let column =
            |name: &str, numbers: &[f64]| Column { name: name.to_owned(), data: ColumnData::Numbers(numbers.to_vec()) };
        let pump_on: Vec<f64> = (0..rows).map(|row| if row < on_from { 0.0 } else { 1.0 }).collect();
        let columns = vec![
            column("u_pos", &duty[0]),
            column("u_neg", &duty[1]),
            column("p_pos_kpa", &kpa[0]),
            column("p_neg_kpa", &kpa[1]),
            column("pump_on", &pump_on),
        ];
        Recording::new("experiment.csv", (0..rows).map(|k| 0.02 * k as f64).collect(), columns).unwrap()
    };
    let records = Records::new(rig, &[with_relay(&[vec![0.0; rows], vec![0.0; rows]], RUNS)]).unwrap();
    let trace = Simulator::new(&records, Fidelity::Detailed).free(std::slice::from_ref(rig)).pop().unwrap().unwrap();
    let kpa = [0, 1].map(|channel| trace[records.layout().channel(0, channel)].to_vec());
    with_relay(&made::noisy(&kpa, 1000 + seed), SWITCHED)
}

/// Fitted through, the start of the motor is some tens of kPa for which parameters have to answer.
#[test]
fn a_motor_that_comes_up_slowly_spoils_no_parameter() {
    let nominal_rig = quick_rig();
    let truth_rig = off_rig(&nominal_rig, 1.0);
    let recordings = [with_a_slow_start(&truth_rig, 2000, 1), made(&truth_rig, 2000, 2)];
    let found = run(&nominal_rig, &recordings, &IdentifySettings::default(), &mut |_| {}).unwrap();
    assert_eq!(found.change, Some(Change::Switched));
    let (duty, pressures) = truth(&truth_rig, 1500, 3);
    let records = Records::new(&nominal_rig, &[made::recording("fresh.csv", &duty, &pressures)]).unwrap();
    let everywhere = vec![1.0; records.layout().len()];
    let simulator = Simulator::new(&records, Fidelity::Detailed);
    // Twice what two ordinary recordings of these lengths lead to at most (`a_rig_that_is_off_is_found_again`).
    for error in errors_at(&simulator, &found.fitted.rig, Horizon::Free, &everywhere).unwrap() {
        assert!(error.rmse_kpa < 0.1, "{error:?}");
    }
}

#[test]
fn the_fast_search_ends_where_the_close_one_does() {
    // Generated in detail; searched with averaged pumps, corrected, and in detail throughout.
    let nominal_rig = Rig::builtin("dual_pressure").unwrap();
    // Two volumes and two valve coefficients are enough to show it.
    let set = ParameterSet::new(&nominal_rig, nominal(&nominal_rig, Scatter::default()))
        .unwrap()
        .without(|path| !(path.contains("volume_l") || path.contains("input_area")));
    let truth_rig = set.rig_at(&[0.5, -0.6, 0.4, -0.5]).unwrap();
    let records = Records::new(&nominal_rig, &[made(&truth_rig, 2200, 4)]).unwrap();
    // Of which 1,200 are fitted.
    let split = Split::of(&records);
    let weights = split.weights(records.layout(), Role::Fit);
    let simulator = Simulator::new(&records, Fidelity::Detailed);
    let at = |search| {
        let settings = FitSettings { search, stages: vec![Shooting::Free], ..FitSettings::default() };
        let blocks = blocks_of(&split, Role::Fit);
        fit_from(simulator, &set, &set.origin(), &weights, &[0.08, 0.08], &blocks, &settings).unwrap()
    };
    let (fast, close) = (at(Fidelity::Averaged), at(Fidelity::Detailed));
    for ((f, c), e) in fast.point.iter().zip(&close.point).zip(&close.estimates) {
        // A fifth of a standard error, against an error of averaged pumps alone of several.
        assert!((f - c).abs() < 0.2 * e.undetermined, "{}: {f} {c} ± {}", e.parameter.path, e.undetermined);
    }
}
