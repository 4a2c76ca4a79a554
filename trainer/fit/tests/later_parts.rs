//! Parts of recordings that begin where others end.
#![allow(clippy::unwrap_used)] // a test that cannot set up its case must fail

mod made;

use fit::data::Records;
use fit::simulate::{Arcs, Fidelity, Simulator};
use made::{duties, quick_rig, recording};
use model::mechanism::{ChamberThermal, CoilHeating, Mechanism};
use model::rig::{MechanismInstance, Rig};

/// The paper's rig with a coil that warms by a tenth within 20 s.
fn warming() -> Rig {
    let mut rig = quick_rig();
    rig.mechanisms.push(MechanismInstance {
        component: "valve_neg".to_owned(),
        enabled: true,
        mechanism: Mechanism::CoilHeating(CoilHeating {
            resistance_rise: 0.1,
            time_constant_s: 20.0,
            initial_heat: 0.0,
            winding_share: 0.2,
            winding_time_constant_s: 3.0,
        }),
    });
    rig
}

/// A free run of a later part, and of a part of that, goes on where that of the whole is; only the first pressures start anew.
#[test]
fn a_later_part_begins_with_coils_as_warm_as_the_whole_has_them() {
    const ROWS: usize = 1500;
    let rig = warming();
    let blank = recording("whole.csv", &duties(ROWS, 5), &[vec![90.0; ROWS], vec![-60.0; ROWS]]);
    let records = Records::new(&rig, &[blank]).unwrap();
    let free = |records: &Records| {
        let simulator = Simulator::new(records, Fidelity::Averaged);
        simulator.run(&[rig.clone().into()], &Arcs::free(records)).pop().unwrap().unwrap()
    };
    let trace = free(&records);
    let whole = records.with_readings(trace.clone()).unwrap();
    let (later, places) = whole.parts(&[(0, 800..ROWS), (0, 0..400)]);
    let (last, of_later) = later.parts(&[(0, 200..700)]);
    let last_places: Vec<usize> = of_later.iter().map(|place| places[*place]).collect();
    for (part, places) in [(&later, &places), (&last, &last_places)] {
        let run = free(part);
        for (_, channel, range) in part.layout().all() {
            // 2 s in which a start at rates that are not the whole's is forgotten.
            let off = range.skip(100).map(|i| (run[i] - trace[places[i]]).abs()).fold(0.0, f64::max);
            assert!(off < 0.02, "channel {channel}: {off} kPa");
        }
    }
    // The same rows as a recording of their own begin with a cold coil.
    let rows = |of: &[f64]| of[800..].to_vec();
    let duty = duties(ROWS, 5).map(|duty| rows(&duty));
    let read = [0, 1].map(|channel| rows(&trace[whole.layout().channel(0, channel)]));
    let cold = Records::new(&rig, &[recording("cold.csv", &duty, &read)]).unwrap();
    let off = free(&cold).iter().zip(read.iter().flatten()).map(|(run, whole)| (run - whole).abs()).fold(0.0, f64::max);
    assert!(off > 1.0, "{off} kPa");
}

/// A part that begins while gas is hot, a little after the pump has started or amid moves, goes on as hot as the whole has it; of a
/// recording of its own nobody knows.
#[test]
fn a_later_part_begins_with_gas_as_warm_as_the_whole_has_it() {
    const ROWS: usize = 900;
    let mut rig = quick_rig();
    rig.mechanisms.push(MechanismInstance {
        component: "positive".to_owned(),
        enabled: true,
        mechanism: Mechanism::ChamberThermal(ChamberThermal { wall_conductance_w_per_k: 1.0 }),
    });
    // A jump half a second before the second part begins, more rows behind the beginning than a lead has.
    let duty: Vec<f64> = (0..ROWS).map(|row| if row < 725 { 0.75 } else { 0.95 }).collect();
    let duty = [duty.clone(), duty];
    let free = |records: &Records| {
        let simulator = Simulator::new(records, Fidelity::Averaged);
        simulator.run(&[rig.clone().into()], &Arcs::free(records)).pop().unwrap().unwrap()
    };
    let blank = recording("whole.csv", &duty, &[vec![0.0; ROWS], vec![0.0; ROWS]]);
    let blank = Records::new(&rig, &[blank]).unwrap();
    let trace = free(&blank);
    let whole = blank.with_readings(trace.clone()).unwrap();
    for (begins, alone_kpa) in [(30, 1.0), (750, 0.2)] {
        let (part, places) = whole.parts(&[(0, begins..ROWS)]);
        // A few strokes in which averaged pumps forget how they began.
        let off = |run: &[f64]| {
            let channel = part.layout().channel(0, 0).skip(5);
            channel.map(|i| (run[i] - trace[places[i]]).abs()).fold(0.0, f64::max)
        };
        let led = off(&free(&part));
        assert!(led < 0.1, "{begins}: {led} kPa");
        let alone = off(&free(&part.clone().begun_anew()));
        assert!(alone > alone_kpa, "{begins}: {alone} kPa");
    }
}
