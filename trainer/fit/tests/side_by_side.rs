//! Rigs and recordings that share a simulation's lanes against each of them alone.
#![allow(clippy::unwrap_used)] // a test that cannot set up its case must fail

mod made;

use fit::data::Records;
use fit::simulate::{Arcs, Fidelity, Flapper, Run, Simulator};
use made::{duties, quick_rig, recording, recording_at};
use model::mechanism::{Mechanism, ValveHysteresis};
use model::rig::{MechanismInstance, Rig};
use proto::recording::Recording;

/// A recording of so many rows that begins at `start_kpa`; what follows does not matter, as only commands are followed.
fn begun_at(source: &str, rows: usize, seed: u64, start_kpa: [f64; 2]) -> Recording {
    recording(source, &duties(rows, seed), &start_kpa.map(|kpa| vec![kpa; rows]))
}

/// Two that begin under pressure, of different lengths; one at rest; one with a gap, whose second half begins later.
fn recordings() -> [Recording; 4] {
    let time_s = (0..300).map(|row| 0.02 * f64::from(row) + if row < 130 { 0.0 } else { 3.0 }).collect();
    let gap = recording_at("gap.csv", time_s, &duties(300, 4), &[vec![80.0; 300], vec![-60.0; 300]]);
    [
        begun_at("long.csv", 420, 1, [95.0, -70.0]),
        begun_at("short.csv", 260, 2, [60.0, -50.0]),
        begun_at("at_rest.csv", 310, 3, [0.02, -0.03]),
        gap,
    ]
}

/// Rigs with play in a valve that differ in numbers.
fn runs(arcs: &Arcs) -> Vec<Run> {
    let rig = |half_width_duty: f64, kelvin: f64| -> Rig {
        let mut rig = quick_rig();
        rig.mechanisms.push(MechanismInstance {
            component: "valve_pos".to_owned(),
            enabled: true,
            mechanism: Mechanism::ValveHysteresis(ValveHysteresis { half_width_duty, spread_duty: 0.0 }),
        });
        rig.volumes.values_mut().for_each(|volume| volume.temperature_k += kelvin);
        rig
    };
    let lying = |share| vec![vec![Flapper { unknown: "play:valve_pos".to_owned(), share }]; arcs.arcs().len()];
    vec![
        Run { flappers: lying(0.5), ..Run::from(rig(0.02, 0.0)) },
        Run { shift_kpa: vec![0.3, -0.2], ..Run::from(rig(0.03, 4.0)) },
        Run { crank_rev: 0.3, ..Run::from(rig(0.01, -3.0)) },
    ]
}

#[test]
fn a_lane_has_the_bits_of_a_run_alone() {
    let rig = quick_rig();
    let records = Records::new(&rig, &recordings()).unwrap().with_cranks(&[0.1, 0.4, 0.0, 0.7]);
    assert_eq!(records.records()[3].segments.len(), 2, "the gap is one");
    for fidelity in [Fidelity::Averaged, Fidelity::Smooth, Fidelity::Coarse] {
        let simulator = Simulator::new(&records, fidelity);
        let windows = Arcs::windows(&records, 50, records.readings_kpa());
        let until = Arcs::free(&records).until(&[400, 260, 200, 300]);
        for arcs in [Arcs::free(&records), until, windows] {
            let runs = runs(&arcs);
            // On one core all is bundled; where there are more cores than runs, nothing is.
            let together = simulator.on(1).run(&runs, &arcs);
            for (run, bundled) in runs.iter().zip(together) {
                let alone = simulator.on(64).run(std::slice::from_ref(run), &arcs).pop().unwrap().unwrap();
                let bits = |trace: &[f64]| trace.iter().map(|kpa| kpa.to_bits()).collect::<Vec<_>>();
                assert_eq!(bits(&bundled.unwrap()), bits(&alone), "{fidelity:?}");
                assert!(alone.iter().all(|kpa| kpa.is_finite()));
            }
        }
    }
}

#[test]
fn an_unsound_rig_among_sound_ones_fails_by_itself() {
    let records = Records::new(&quick_rig(), &recordings()).unwrap();
    let mut unsound = quick_rig();
    unsound.volumes.values_mut().for_each(|volume| volume.temperature_k = -1.0);
    let rigs = [quick_rig(), unsound, quick_rig()];
    let outcomes = Simulator::new(&records, Fidelity::Averaged).on(1).free(&rigs);
    assert_eq!(outcomes.iter().map(Result::is_ok).collect::<Vec<_>>(), [true, false, true]);
    assert_eq!(outcomes[0].as_ref().unwrap(), outcomes[2].as_ref().unwrap());
}

/// Steps of averaged plants are 10 ms, and no longer than a tick.
#[test]
fn a_rig_with_short_ticks_runs_as_with_long_ones() {
    let records = Records::new(&quick_rig(), &recordings()).unwrap();
    let free = |tick_ms: f64| {
        let mut rig = quick_rig();
        rig.integrator.tick_ms = tick_ms;
        Simulator::new(&records, Fidelity::Averaged).free(&[rig]).pop().unwrap().unwrap()
    };
    let (long, short) = (free(20.0), free(5.0));
    let square = |(long, short): (&f64, &f64)| (long - short).powi(2);
    let off = (long.iter().zip(&short).map(square).sum::<f64>() / long.len() as f64).sqrt();
    // What steps of 10 ms err by where duties jump and a rig fills from rest: 0.08 kPa at most, in single rows.
    assert!(off < 0.01, "{off} kPa");
}
