//! Answers beside truths: every way in which they can stand to each other.

#![allow(clippy::unwrap_used)] // a test that cannot go on should say where

use std::sync::OnceLock;

use hidden_rig::case::{Making, Plan, make};
use hidden_rig::effects::{Effect, Kind, Place};
use hidden_rig::rng::Draws;
use hidden_rig::truth::{Class, Planted, Truth};
use score_card::diagnosis::Diagnosis;
use score_card::judge::{Outcome, outcome};
use score_card::numbers::compare;

/// A null, to plant things in on paper.
fn null() -> Truth {
    static NULL: OnceLock<Truth> = OnceLock::new();
    let made = NULL.get_or_init(|| {
        let making = Making { seconds: [2.0; 4], probe_s: 2.0, nuisance_ceiling_kpa: 0.06 };
        let plan = Plan {
            name: "case_000".to_owned(),
            class: Class::Nothing,
            effects: Vec::new(),
            level_kpa: 0.0,
            ripple_beats: false,
            seed: 3,
        };
        let mut truth = make(&plan, &making).unwrap().truth;
        truth.nuisances.clear();
        truth
    });
    made.clone()
}

fn planted(kind: Kind, place: Place) -> Planted {
    Planted::new(kind.draw(&mut Draws::new(1)), place, null().nuisances_together)
}

fn concealing(class: Class, effects: &[(Kind, Place)]) -> Truth {
    Truth { class, truth: effects.iter().map(|(kind, place)| planted(*kind, *place)).collect(), ..null() }
}

fn says(verdict: &str, names: &[(&str, &str)], rivals: &[&str]) -> Diagnosis {
    let mechanisms: Vec<_> = names.iter().map(|(id, place)| serde_json::json!({"id": id, "where": place})).collect();
    let json = serde_json::json!({"verdict": verdict, "mechanisms": mechanisms, "rivals": [rivals]});
    serde_json::from_value(json).unwrap()
}

#[test]
fn a_null_has_no_name() {
    let mut truth = null();
    assert_eq!(outcome(&says("adequate", &[], &[]), &truth), Outcome::Right);
    assert_eq!(outcome(&says("parameters_moved", &[], &[]), &truth), Outcome::Right);
    assert_eq!(outcome(&says("undecided", &[], &["chamber_leak:positive"]), &truth), Outcome::UndecidedAstray);
    let shift = says("undecided", &[], &["chamber_leak:positive", "parameters_moved:both"]);
    assert_eq!(outcome(&shift, &truth), Outcome::Undecided);
    assert_eq!(outcome(&says("unknown_mechanism", &[], &[]), &truth), Outcome::FalseName);
    let leak = says("missing_physics", &[("chamber_leak", "positive")], &[]);
    assert_eq!(outcome(&leak, &truth), Outcome::FalseName);
    // Even if a little of it is there.
    truth.nuisances = vec![planted(Kind::ChamberLeak, Place::Positive)];
    assert_eq!(outcome(&leak, &truth), Outcome::FalseName);
}

#[test]
fn a_single_effect_is_named_in_its_place() {
    let mut truth = concealing(Class::Single, &[(Kind::ValveLag, Place::Negative)]);
    truth.nuisances = vec![planted(Kind::CoilHeating, Place::Both)];
    let named = |names: &[(&str, &str)]| outcome(&says("missing_physics", names, &[]), &truth);
    assert_eq!(named(&[("valve_lag", "negative")]), Outcome::Right);
    assert_eq!(named(&[("valve_lag", "positive")]), Outcome::Misplaced);
    assert_eq!(named(&[("sensor_lag", "negative")]), Outcome::FalseName);
    assert_eq!(named(&[("valve_lag", "negative"), ("sensor_lag", "negative")]), Outcome::FalseName);
    assert_eq!(named(&[("valve_lag", "negative"), ("coil_heating", "positive")]), Outcome::Right);
    assert_eq!(named(&[("coil_heating", "positive")]), Outcome::Missed);
    assert_eq!(outcome(&says("adequate", &[], &[]), &truth), Outcome::Missed);
    assert_eq!(outcome(&says("unknown_mechanism", &[], &[]), &truth), Outcome::ThoughtUnknown);
    assert_eq!(outcome(&says("undecided", &[], &["valve_lag:negative"]), &truth), Outcome::Undecided);
    assert_eq!(outcome(&says("undecided", &[], &["valve_lag:positive"]), &truth), Outcome::UndecidedAstray);
}

#[test]
fn an_effect_in_both_channels_may_be_named_channel_by_channel() {
    let truth = concealing(Class::Single, &[(Kind::ValveHysteresis, Place::Both)]);
    let named = |places: &[&str]| {
        let names: Vec<_> = places.iter().map(|place| ("valve_hysteresis", *place)).collect();
        outcome(&says("missing_physics", &names, &[]), &truth)
    };
    assert_eq!(named(&["both"]), Outcome::Right);
    assert_eq!(named(&["positive", "negative"]), Outcome::Right);
    assert_eq!(named(&["positive"]), Outcome::Partly);
}

#[test]
fn pairs_want_both_but_another_tank_may_be_a_parameter() {
    let pair = concealing(Class::Pair, &[(Kind::ValveLag, Place::Negative), (Kind::PumpDroop, Place::Both)]);
    let lag = says("missing_physics", &[("valve_lag", "negative")], &[]);
    assert_eq!(outcome(&lag, &pair), Outcome::Partly);
    let both = says("missing_physics", &[("valve_lag", "negative"), ("pump_droop", "positive")], &[]);
    assert_eq!(outcome(&both, &pair), Outcome::Right);
    let mut tank = concealing(Class::Pair, &[(Kind::ValveLag, Place::Negative), (Kind::VolumeChange, Place::Positive)]);
    let Effect::VolumeChange(change) = &mut tank.truth[1].effect else { panic!("a volume") };
    change.time_s = None;
    assert_eq!(outcome(&lag, &tank), Outcome::Right);
    tank.truth.remove(0);
    assert_eq!(outcome(&says("parameters_moved", &[], &[]), &tank), Outcome::Right);
    assert_eq!(outcome(&says("adequate", &[], &[]), &tank), Outcome::Missed);
}

#[test]
fn outside_the_library_the_neighbour_is_no_false_name() {
    let truth = concealing(Class::Outside, &[(Kind::SlewLimit, Place::Positive)]);
    assert_eq!(outcome(&says("unknown_mechanism", &[], &[]), &truth), Outcome::Right);
    assert_eq!(outcome(&says("missing_physics", &[("valve_lag", "positive")], &[]), &truth), Outcome::Adjacent);
    assert_eq!(outcome(&says("missing_physics", &[("valve_lag", "negative")], &[]), &truth), Outcome::FalseName);
    assert_eq!(outcome(&says("missing_physics", &[("chamber_leak", "positive")], &[]), &truth), Outcome::FalseName);
}

/// Units of the diagnosis are taken as stated, and an interval is held to account where the laws are the same.
#[test]
fn numbers_are_compared_in_one_unit() {
    let mut truth = concealing(Class::Single, &[(Kind::CommandDelay, Place::Both)]);
    let Effect::CommandDelay(delay) = &mut truth.truth[0].effect else { panic!("a delay") };
    delay.delay_s = 0.040;
    let found = |value: f64, unit: &str, low: f64, high: f64| {
        let json = serde_json::json!({"id": "command_delay", "where": "both", "parameters":
            {"delay": {"value": value, "unit": unit, "low": low, "high": high}}});
        compare(&serde_json::from_value(json).unwrap(), &truth.truth[0], &truth).unwrap()
    };
    let ms = found(42.0, "ms", 39.0, 45.0);
    assert!((ms.relative_error - 0.05).abs() < 1e-9 && ms.covered == Some(true), "{ms:?}");
    let s = found(0.042, "s", 0.041, 0.045);
    assert!((s.relative_error - 0.05).abs() < 1e-9 && s.covered == Some(false), "{s:?}");

    // A snubber with the cavity behind it: one lag for both, or each of them.
    let truth = concealing(Class::Single, &[(Kind::SensorLag, Place::Positive)]);
    let Effect::SensorLag(lag) = &truth.truth[0].effect else { panic!("a lag") };
    let ms = 1e3 * lag.time_constant_s;
    let of = |value: f64| serde_json::json!({"value": value, "unit": "ms", "low": 0.99 * value, "high": 1.01 * value});
    for (parameters, covered) in [
        (serde_json::json!({"time_constant_ms": of(1.1 * ms)}), None),
        (serde_json::json!({"time_constant_ms": of(ms), "second_time_constant_ms": of(0.1 * ms)}), Some(true)),
    ] {
        let json = serde_json::json!({"id": "sensor_lag", "where": "positive", "parameters": parameters});
        let compared = compare(&serde_json::from_value(json).unwrap(), &truth.truth[0], &truth).unwrap();
        assert!(compared.relative_error < 1e-9 && compared.covered == covered, "{compared:?}");
    }

    // A play's whole width is twice its half width; relays are no play, so its interval is not judged.
    let truth = concealing(Class::Single, &[(Kind::ValveHysteresis, Place::Positive)]);
    let Effect::ValveHysteresis(field) = &truth.truth[0].effect else { panic!("relays") };
    let json = serde_json::json!({"id": "valve_hysteresis", "where": "positive", "parameters":
        {"width": {"value": 2.0 * field.half_width_duty, "unit": "duty", "low": 0.0, "high": 1.0}}});
    let compared = compare(&serde_json::from_value(json).unwrap(), &truth.truth[0], &truth).unwrap();
    assert!(compared.relative_error < 1e-9 && compared.covered.is_none());
}
