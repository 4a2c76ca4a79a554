//! Exploring behind a rest trips nothing: by then the monitor's record is of valves that hardly move, and the noise of exploration moves
//! the model more than a rig whose valves have play. What that does to the limits is tested beside them (`monitor`, unit tests); this is
//! the whole loop on several rigs.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use controller::config::Safety;
use controller::cycle::Cycle;
use controller::daemon::shipped_policy;
use controller::operator::notice::Notice;
use evaluate::rigs_around::rigs_around;
use handover::ExplorationRules;
use model::rig::Rig;
use proto::reference::Reference;
use supervisor::Arming;
use tests::coarse_rigs::coarse;
use tests::lockstep::Flight;

/// Ticks of a rest: 25 s, after which the record is of it alone.
const REST: u64 = 1_250;
/// Ticks of an exploration: 10 s, after which the record is of exploring.
const EXPLORED: u64 = 500;
/// Levels that are held, kPa gauge.
const HELD_KPA: [[f64; 2]; 2] = [[100.0, -75.0], [80.0, -70.0]];

/// Flight of the shipped policy at a level, with the nominal model.
fn held(rig: &Rig, [positive_kpa, negative_kpa]: [f64; 2], seed: u64) -> Flight {
    let policy = Some(shipped_policy().unwrap().0);
    let reference = Reference::constant(positive_kpa, negative_kpa);
    let cycle = Cycle::new(&coarse("dual_pressure"), policy, reference, Safety::default(), Arming::Automatic).unwrap();
    Flight::new(rig, cycle, seed)
}

fn rules(seed: u32) -> ExplorationRules {
    ExplorationRules { seed, std_share: 0.02, most_duty: 0.02 }
}

/// Causes of venting of a rig that rests and is explored by turns, so many times, with the defaults of `[policy]`.
fn vented(rig: &Rig, held_kpa: [f64; 2], times: u32) -> Vec<String> {
    let mut flight = held(rig, held_kpa, u64::from(times));
    let mut explored = 0;
    for seed in 1..=times {
        for tick in 0..REST + EXPLORED {
            match tick {
                REST => flight.cycle.explore(Some(rules(seed))),
                0 => flight.cycle.explore(None),
                _ => {}
            }
            let told = flight.step().told;
            explored += u32::from(told.iter().any(|notice| matches!(notice, Notice::Exploring { .. })));
            if let Some(notice) = told.into_iter().find(|notice| matches!(notice, Notice::Vented { .. })) {
                return vec![format!("{}, {held_kpa:?} kPa, seed {seed}, tick {tick}: {notice:?}", rig.name)];
            }
        }
    }
    assert_eq!(explored, times, "{} was not explored each time", rig.name);
    Vec::new()
}

fn vented_around_bench(rigs: usize, times: u32) -> Vec<String> {
    let mut rigs = rigs_around(&coarse("bench"), rigs, 5).unwrap();
    rigs.push(coarse("bench"));
    let on_each = |held_kpa| rigs.iter().flat_map(|rig| vented(rig, held_kpa, times)).collect::<Vec<_>>();
    std::thread::scope(|scope| {
        let started = HELD_KPA.map(|held_kpa| scope.spawn(move || on_each(held_kpa)));
        started.into_iter().flat_map(|flown| flown.join().unwrap()).collect()
    })
}

/// The monitor's limit of half a second, positive channel, in kPa.
fn limit_kpa(flight: &Flight) -> f64 {
    let [as_filed, _] = flight.cycle.monitor().figures_kpa();
    as_filed[0][3]
}

#[test]
fn a_record_of_rest_holds_no_more_from_the_first_tick_of_exploring() {
    let mut flight = held(&coarse("bench"), HELD_KPA[0], 1);
    let goes_on = |flight: &mut Flight, ticks: u64| (0..ticks).for_each(|_| drop(flight.step()));
    goes_on(&mut flight, 3_000);
    let at_rest = limit_kpa(&flight);
    flight.cycle.explore(Some(rules(7)));
    goes_on(&mut flight, 3);
    let explored = limit_kpa(&flight);
    assert!(explored > 1.2 * at_rest, "{at_rest} kPa at rest, {explored} kPa explored");
}

/// Tests of the thorough tier (docs/testing.md).
mod thorough {
    use super::*;

    /// `RIGS` in the environment takes more of them.
    #[test]
    #[ignore = "thorough: docs/testing.md"]
    fn rigs_around_bench_that_are_explored_again_and_again_trip_nothing() {
        let rigs = std::env::var("RIGS").ok().and_then(|rigs| rigs.parse().ok()).unwrap_or(6);
        assert_eq!(vented_around_bench(rigs, 6), Vec::<String>::new());
    }
}
