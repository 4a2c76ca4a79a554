//! `valve_stiction` that rubs on the flapper: pressure alone breaks it loose, and until then the valve is an orifice.

use std::sync::Arc;

use model::plant::{Plant, Simulation};

use crate::mechanisms::{METER, acting};
use crate::small_rigs::{ATMOSPHERE, KAPPA, R, T, TICK_S, chamber, choked, mechanism, plain_valve, rig};

/// Where the pressure does not push, the balance of forces is the duty, and it is all one what rubs.
#[test]
fn without_a_push_flapper_and_plunger_are_one() {
    let sent: Vec<f64> = (0..120).map(|k| 0.5 + 0.4 * (0.11 * f64::from(k)).sin()).collect();
    let stick = |rubs: &str| {
        let keys = format!("band_duty = 0.03\nshort_of_it = 0.3\nrubs = \"{rubs}\"");
        acting(&mechanism("valve_stiction", "valve", &keys), &sent)
    };
    let (plunger, flapper) = (stick("plunger"), stick("flapper"));
    for (k, (a, b)) in plunger.iter().zip(&flapper).enumerate() {
        assert!((a - b).abs() < METER, "tick {k}: {a} and {b}");
    }
    assert!(plunger.windows(2).filter(|w| (w[0] - w[1]).abs() > 0.01).count() > 20, "it must have jumped");
}

/// A supply that rises and falls pushes a flapper of constant duty: stairs of the force, by a recursion of the test's own.
#[test]
fn pressure_alone_makes_stairs() {
    let (band, short, push_mm2_per_n, duty) = (0.03, 0.25, 0.1, 0.2);
    let (nozzle_m2, volume) = (std::f64::consts::PI * 1e-6 / 4.0, 0.1);
    let valve = plain_valve("valve", "supply", "meter")
        .replace("pressure_area_mm2_per_n = 0.0", &format!("pressure_area_mm2_per_n = {push_mm2_per_n:?}"));
    let keys = format!("band_duty = {band}\nshort_of_it = {short}\nrubs = \"flapper\"");
    let supply = format!(
        "[sources.supply]\nkind = \"pressure\"\npressure_kpa_gauge = 1000.0\ntemperature_k = {T}\nsignal = \"push\"\n"
    );
    let rig = rig(&(chamber("meter", 100.0) + &supply + &valve + &mechanism("valve_stiction", "valve", &keys)));
    let plant = Arc::new(Plant::new(&rig).unwrap());
    let inputs = |push: f64| -> Vec<f64> {
        plant.inputs().iter().map(|input| if input.column == "push" { push } else { duty }).collect()
    };
    let mut simulation = Simulation::new(Arc::clone(&plant));
    let push: Vec<f64> = (0..200).chain((0..200).rev()).map(|k| 1.0 + 0.01 * f64::from(k)).collect();
    let (mut flapper, mut jumps) = (f64::NAN, 0);
    for (tick, push) in push.into_iter().enumerate() {
        let before = simulation.pressure_pa(0);
        let up = ATMOSPHERE + 1e6 * push;
        let balance = duty + push_mm2_per_n * nozzle_m2 * (up - before);
        if tick == 0 {
            // It starts from rest with nothing commanded, and no push: this breaks it loose.
            flapper = 0.0;
        }
        if (balance - flapper).abs() > band {
            flapper = balance - short * band * (balance - flapper).signum();
            jumps += 1;
        }
        simulation.tick(&inputs(push));
        assert!(simulation.pressure_pa(0) < 0.5 * up, "the meter must stay choked");
        let full = R * T / volume * 1e-6 * up / (R * T).sqrt() * choked(KAPPA) * TICK_S;
        let area_mm2 = (simulation.pressure_pa(0) - before) / full;
        assert!((area_mm2 - flapper).abs() < METER, "tick {tick}: {area_mm2} mm², the stuck flapper is at {flapper}");
    }
    assert!((9..=14).contains(&jumps), "{jumps} jumps");
}
