//! Intervals: what they must allow for beside noise.

#![allow(clippy::unwrap_used)] // What fails here fails the test.

mod made;

use diagnose::bench::Effort;
use diagnose::candidate::candidates;
use diagnose::unnamed::variance_by_the_unnamed;
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
    best.fitted.widen(&variance_by_the_unnamed(&bench, &all, &best));
    let widened = best.fitted.estimates.last().unwrap();
    let [low, high] = widened.interval();
    assert!(!(by_noise[0]..=by_noise[1]).contains(&80.0), "{by_noise:?}");
    assert!((low..=high).contains(&80.0), "{low} … {high}, by noise {by_noise:?}");
    // And it still says something: what it allows for is no more than some milliseconds.
    assert!(high - low < 0.1 * widened.value, "{low} … {high}");
}
