//! Intervals: what they must allow for beside noise.

#![allow(clippy::unwrap_used)] // What fails here fails the test.

mod made;

use diagnose::bench::Effort;
use diagnose::judge::added_uncertainty::{FORMULAS, variance_beyond_noise};
use diagnose::judge::step_uncertainty::variance_of_steps;
use diagnose::search::candidate::candidates;
use fit::data::Records;
use made::{bench, made, moved};

/// Commands that come 80 ms late at a valve whose coil lags by 1.5 ms more, which is too little to be named: by noise alone the delay
/// is known to a fraction of a millisecond, and it is not that well known.
#[test]
fn an_interval_holds_the_truth_beside_what_is_too_small_for_a_name() {
    let (rig, mut truth) = moved(&[("volumes.positive.volume_l", 1.02), ("valves.valve_neg.input_area_mm2", 0.98)]);
    let all = candidates(&rig);
    let of = |name: &str| all.iter().position(|c| c.name() == name && c.form.is_empty()).unwrap();
    let delay = of("command_delay:positive");
    truth.mechanisms.push(all[delay].attached(&[80.0]));
    truth.mechanisms.push(all[of("valve_lag:positive")].attached(&[1.5]));
    let records = Records::new(&rig, &made(&truth, 2, 41)).unwrap();
    let bench = bench(&rig, &records);
    let mut start = vec![0.0; bench.nominal.len()];
    let parameter = &bench.set_of(&all, &[delay]).unwrap().parameters()[start.len()].clone();
    start.push(parameter.coordinate(80.0));
    let mut best = bench.fit(&all, &[delay], &[start], Effort::Polish).unwrap();
    let by_noise = best.fitted.estimates.last().unwrap().interval();
    best.fitted.widen(&variance_beyond_noise(&bench, &all, &best));
    let widened = best.fitted.estimates.last().unwrap();
    let [low, high] = widened.interval();
    assert!(!(by_noise[0]..=by_noise[1]).contains(&80.0), "{by_noise:?}");
    assert!((low..=high).contains(&80.0), "{low} … {high}, by noise {by_noise:?}");
    // And it still says something: what it allows for is no more than some milliseconds either way, of a minute of recordings.
    assert!(high - low < 0.1 * FORMULAS * widened.value, "{low} … {high}");
}

/// A valve that sticks over 0.03 of duty, fitted from that band and from one that is 4 % wide: slopes know both to a hundredth, what is
/// left says which of them is to be trusted.
#[test]
fn a_band_is_known_as_well_as_it_explains_what_was_recorded() {
    let (rig, mut truth) = moved(&[]);
    let all = candidates(&rig);
    let sticks = all.iter().position(|c| c.name() == "valve_stiction:positive" && c.form.is_empty()).unwrap();
    truth.mechanisms.push(all[sticks].attached(&[0.03, 0.0]));
    let records = Records::new(&rig, &made(&truth, 2, 43)).unwrap();
    let bench = bench(&rig, &records);
    let interval = |band: f64| {
        let mut start = vec![0.0; bench.nominal.len()];
        start.extend(all[sticks].parameters(0).iter().zip([band, 0.0]).map(|(p, value)| p.coordinate(value)));
        let mut fitted = bench.fit(&all, &[sticks], &[start], Effort::Polish).unwrap();
        let at = bench.nominal.len();
        let by_slopes = fitted.fitted.estimates[at].interval();
        fitted.fitted.widen(&variance_beyond_noise(&bench, &all, &fitted));
        fitted.fitted.widen(&variance_of_steps(&bench, &all, &fitted));
        (by_slopes, fitted.fitted.estimates[at].interval())
    };
    let (_, [low, high]) = interval(0.03);
    assert!((low..=high).contains(&0.03) && high - low < 0.05 * 0.03, "{low} … {high}");
    let (by_slopes, [low, high]) = interval(0.0312);
    assert!(!(by_slopes[0]..=by_slopes[1]).contains(&0.03), "{by_slopes:?}");
    assert!((low..=high).contains(&0.03), "{low} … {high}");
    assert!(high - low < 0.5 * 0.03, "{low} … {high}");
}
