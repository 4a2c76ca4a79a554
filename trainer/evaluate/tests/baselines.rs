//! Baselines that are told all of a rig: what an expert would fly must not be worse than a PI controller that is told the same.

#![allow(clippy::unwrap_used)]

use std::sync::Arc;

use environment::Controller;
use environment::closed_loop::{FlightPlan, fly};
use environment::score::Score;
use evaluate::rigs_around::rigs_around;
use evaluate::{Mpc, RepeatedFallback, TickTimes};
use law::{Fallback, FallbackSettings};
use model::observation::Pair;
use model::rig::Rig;
use model::steady::SteadyMap;
use proto::reference::Reference;

/// Rigs around `bench` as `trainer evaluate` draws them: backlash, lag and delay of both valves of other sizes each, delays that are no
/// whole ticks.
fn drawn(count: usize) -> Vec<(Rig, Arc<SteadyMap>)> {
    let rigs = rigs_around(&Rig::builtin("bench").unwrap(), count, 2026).unwrap();
    let with_map = |rig: Rig| {
        let map = Arc::new(SteadyMap::new(&rig).unwrap());
        (rig, map)
    };
    rigs.into_iter().map(with_map).collect()
}

/// Errors in kPa RMS on the paper's reference, a minute of it.
fn errors_kpa(rig: &Rig, controller: &mut impl Controller, seed: u64) -> Pair {
    let reference = Reference::paper();
    let plan = FlightPlan { rig, model: None, reference: &reference, seconds: 60.0, noise_v_rms: 0.00024, seed };
    Score::of(&fly(&plan, controller).unwrap().ticks).rmse_kpa
}

fn fallback(map: &Arc<SteadyMap>) -> Fallback {
    Fallback::new(Arc::clone(map), FallbackSettings::default())
}

#[test]
fn the_nmpc_follows_no_worse_than_the_fallback_on_rigs_that_both_are_told() {
    let mut sums = [[0.0; 2]; 2];
    for (rig, map) in drawn(8) {
        let of = [
            errors_kpa(&rig, &mut Mpc::new(&map, Arc::new(TickTimes::default())), 1),
            errors_kpa(&rig, &mut fallback(&map), 1),
        ];
        println!("{} {of:.3?}", rig.name);
        for (sum, errors) in sums.iter_mut().zip(of) {
            *sum = [sum[0] + errors[0], sum[1] + errors[1]];
        }
        // The negative reference is within reach of all of them: what is left is twice the noise of the readings, 0.007 kPa, or three times.
        assert!(of[0][1] < 0.022, "{}: {:?}", rig.name, of[0]);
    }
    assert!(sums[0][0] < sums[1][0] && sums[0][1] < sums[1][1], "{sums:?}");
}

/// The third and the sixth rig cannot let the positive chamber out as fast as the reference falls. What flights leave there cannot be
/// learned, and must not take from what the first one reached.
#[test]
fn flights_of_a_reference_out_of_reach_teach_nothing_wrong() {
    let rigs = drawn(6);
    for (rig, map) in [&rigs[2], &rigs[5]] {
        let first = errors_kpa(rig, &mut fallback(map), 1);
        let mut repeated = RepeatedFallback::new(map, FallbackSettings::default());
        let mut last = [0.0; 2];
        for flight in 0..12 {
            last = errors_kpa(rig, &mut repeated, 1000 * flight + 1);
        }
        assert!(first[0] > 0.2, "{}: within reach, {first:?}", rig.name);
        assert!(last[0] < first[0] && last[1] < first[1], "{}: {last:?} after {first:?}", rig.name);
    }
}
