//! Piston pumps whose limit is a formula: P·V is constant in a sealed cylinder at constant temperature.
//!
//! The cylinders' own pressures are not part of the crate's interface, so these pumps are watched from
//! outside. They turn slowly behind wide check valves, so that the gas has time to come to rest at the
//! dead centres; then the valves' areas drop out of what a revolution delivers.

use crate::small_rigs::{ATMOSPHERE, R, T, chamber, rig, simulation};

const HEAD_M2: f64 = 38.485e-4;
const T_PISTON: f64 = 323.15;

/// One piston with a stroke of 40 mm between the atmosphere and a chamber.
fn pump(inlet: &str, outlet: &str, rpm: f64, effective_length_mm: f64) -> String {
    format!(
        "[pumps.pump]\nkind = \"piston\"\ninlet = \"{inlet}\"\noutlet = \"{outlet}\"\nspeed_rpm = {rpm}\n\
         phases_deg = [0.0]\ncrank_radius_mm = 20.0\nrod_length_mm = 70.0\n\
         effective_length_mm = {effective_length_mm}\nhead_area_cm2 = 38.485\ngas_temperature_k = {T_PISTON}\n\
         inlet_check_area_mm2 = 20.0\noutlet_check_area_mm2 = 20.0\n"
    )
}

#[test]
fn sealed_compression_stalls_the_pump_at_the_ratio_of_volumes() {
    // V_max/V_min = δ/(δ − 2r). At the stall the cylinder never opens: it takes P_in·V_max to P_out·V_min.
    for (length_mm, ratio) in [(50.0, 5.0), (60.0, 3.0), (80.0, 2.0)] {
        let compress = rig(&(chamber("tank", 0.05) + &pump("atmosphere", "tank", 120.0, length_mm)));
        let evacuate = rig(&(chamber("tank", 0.05) + &pump("tank", "atmosphere", 120.0, length_mm)));
        for (name, rig, limit) in [("up", compress, ATMOSPHERE * ratio), ("down", evacuate, ATMOSPHERE / ratio)] {
            let mut simulation = simulation(&rig);
            for _ in 0..4000 {
                simulation.tick(&[]);
            }
            let off = simulation.pressure_pa(0) / limit - 1.0;
            println!("ratio {ratio} {name}: stalls {off:.1e} from the limit");
            assert!(off.abs() < 1e-4, "{name} to {} Pa, limit {limit}", simulation.pressure_pa(0));
        }
    }
}

#[test]
fn a_revolution_delivers_what_the_volumes_say() {
    // m = (P_in V_max − P_out V_min)/(R T): drawn at P_in, and what stays behind in the clearance at P_out.
    let (v_max, v_min) = (HEAD_M2 * 0.050, HEAD_M2 * 0.010);
    let mut simulation = simulation(&rig(&(chamber("tank", 100.0) + &pump("atmosphere", "tank", 30.0, 50.0))));
    simulation.set_pressure_pa(0, 2.5 * ATMOSPHERE);
    let mut expected = 2.5 * ATMOSPHERE;
    for revolution in 1..=10 {
        for _ in 0..100 {
            simulation.tick(&[]);
        }
        expected += R * T / 0.1 * (ATMOSPHERE * v_max - expected * v_min) / (R * T_PISTON);
        let share = (simulation.pressure_pa(0) - 2.5 * ATMOSPHERE) / (expected - 2.5 * ATMOSPHERE);
        println!("revolution {revolution}: {share:.6} of the formula");
        assert!((share - 1.0).abs() < 1e-3, "{share}");
    }
}
