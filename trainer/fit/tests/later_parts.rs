//! Parts of recordings that begin where others end.
#![allow(clippy::unwrap_used)] // a test that cannot set up its case must fail

mod made;

use fit::data::Records;
use fit::data::{Role, Split};
use fit::simulate::{Arcs, Fidelity, Simulator, refined_starts};
use made::{duties, quick_rig, recording};
use model::mechanism::{ChamberThermal, CoilHeating, CommandDelay, Lags, Mechanism, ValveLag};
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

/// A recording that begins 40 ms behind a jump, while the valves still move: behind its lead it goes on as the whole does, and its lead
/// has no role. A simulation from the first row alone is off for two seconds.
#[test]
fn what_was_commanded_before_a_recording_is_over_behind_its_lead() {
    const ROWS: usize = 900;
    const BEGINS: usize = 202;
    let mut rig = quick_rig();
    for valve in ["valve_pos", "valve_neg"] {
        for mechanism in [
            Mechanism::ValveLag(ValveLag { time_constant_ms: 60.0, lags: Lags::Coil, falling_over_rising: 1.0 }),
            Mechanism::CommandDelay(CommandDelay { delay_ms: 60.0 }),
        ] {
            rig.mechanisms.push(MechanismInstance { component: valve.to_owned(), enabled: true, mechanism });
        }
    }
    let duty: Vec<f64> = (0..ROWS).map(|row| if row < BEGINS - 2 { 0.95 } else { 0.7 }).collect();
    let duty = [duty.clone(), duty];
    let blank = Records::new(&rig, &[recording("whole.csv", &duty, &[vec![90.0; ROWS], vec![-60.0; ROWS]])]).unwrap();
    let simulator = Simulator::new(&blank, Fidelity::Averaged);
    let trace = simulator.run(&[rig.clone().into()], &Arcs::free(&blank)).pop().unwrap().unwrap();
    let whole = blank.with_readings(trace).unwrap();
    let (later, _) = whole.parts(&[(0, BEGINS..ROWS)]);
    let alone = later.clone().begun_anew();
    let first_role = |records: &Records| Split::of(records).of_role(Role::Fit).next().unwrap().rows.start;
    // Half a second, unless nothing else was commanded before for as long.
    let (held, _) = whole.parts(&[(0, BEGINS + 23..ROWS)]);
    assert_eq!([first_role(&alone), first_role(&later), first_role(&held)], [25, 25, 0]);
    let off = |arcs: Arcs| {
        let simulator = Simulator::new(&alone, Fidelity::Averaged);
        let trace = simulator.one(&rig, &refined_starts(&simulator, &rig, &arcs).unwrap()).unwrap();
        // A few strokes in which averaged pumps forget how they began.
        let behind = alone.layout().all().flat_map(|(.., range)| range.skip(25 + 5));
        behind.map(|i| (trace[i] - alone.readings_kpa()[i]).abs()).fold(0.0, f64::max)
    };
    let (led, free) = (off(Arcs::led(&alone)), off(Arcs::free(&alone)));
    // The noise of a converter is 0.06 kPa.
    assert!(led < 0.05 && free > 0.3, "{led} {free} kPa");
}
