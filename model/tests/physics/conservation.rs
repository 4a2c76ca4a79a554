//! Conservation in a closed rig: mass, and energy where no wall takes it.

use model::rig::Rig;

use crate::small_rigs::{ATMOSPHERE, R, T, chamber, mechanism, orifice, plain_valve, rig, simulation, source};

/// Two chambers joined every way there is: orifice, valve, capillary, and a pump against the flow.
fn joined() -> Rig {
    let rest = "[lines.hose]\nkind = \"laminar\"\nfrom = \"one\"\nto = \"two\"\nresistance_kpa_s_per_l = 200.0\n\
                [pumps.pump]\nkind = \"flow\"\ninlet = \"two\"\noutlet = \"one\"\nflow_l_per_min = 4.0\n";
    let mut rig = rig(&(chamber("one", 0.75)
        + &chamber("two", 0.4)
        + &orifice("one", "two", 0.8)
        + &plain_valve("valve", "one", "two")
        + rest));
    rig.volumes[1].temperature_k = 310.0;
    rig
}

#[test]
fn joined_chambers_keep_their_mass() {
    let mut simulation = simulation(&joined());
    simulation.set_pressure_pa(0, 400_000.0);
    simulation.set_pressure_pa(1, 20_000.0);
    let mass = |p: [f64; 2]| p[0] * 0.75e-3 / (R * T) + p[1] * 0.4e-3 / (R * 310.0);
    let before = mass([400_000.0, 20_000.0]);
    for tick in 0..200 {
        simulation.tick(&[f64::from(tick % 7) / 7.0]);
        let now = mass([simulation.pressure_pa(0), simulation.pressure_pa(1)]);
        // Runge-Kutta keeps linear invariants: 40 000 steps of one rounding each are at most 4e-12.
        assert!((now / before - 1.0).abs() < 5e-12, "tick {tick}: {:e}", now / before - 1.0);
    }
    assert!((simulation.pressure_pa(0) - 400_000.0).abs() > 50_000.0, "nothing flowed");
}

#[test]
fn compliant_chambers_keep_their_mass() {
    let mut rig = joined();
    rig.volumes[0].compliance_ml_per_kpa = 1.5;
    let mut simulation = simulation(&rig);
    simulation.set_pressure_pa(0, 300_000.0);
    simulation.set_pressure_pa(1, 20_000.0);
    let mass = |p: [f64; 2]| p[0] * (0.75e-3 + 1.5e-9 * (p[0] - ATMOSPHERE)) / (R * T) + p[1] * 0.4e-3 / (R * 310.0);
    let before = mass([300_000.0, 20_000.0]);
    for _ in 0..200 {
        simulation.tick(&[0.5]);
    }
    let drift = mass([simulation.pressure_pa(0), simulation.pressure_pa(1)]) / before - 1.0;
    println!("compliant chambers: mass drifts by {drift:.1e}");
    // P·V(P) is quadratic, which RK4 keeps only to its order.
    assert!(drift.abs() < 1e-11, "{drift:e}");
}

/// The paper's rig without its vents, and with a hose from the positive chamber back to the negative one.
fn closed_pump(step_ms: f64) -> Rig {
    let mut rig = Rig::builtin("dual_pressure").unwrap();
    rig.integrator.step_ms = step_ms;
    rig.valves.clear();
    let hose = self::rig(
        &(chamber("one", 1.0)
            + "[lines.hose]\nkind = \"laminar\"\nfrom = \"one\"\nto = \"atmosphere\"\nresistance_kpa_s_per_l = 100.0\n"),
    );
    let mut hose = hose.lines["hose"].clone();
    if let model::rig::Line::Laminar { from, to, .. } = &mut hose {
        (*from, *to) = ("positive".to_owned(), "negative".to_owned());
    }
    rig.lines.insert("hose".to_owned(), hose);
    rig
}

/// Runs the closed pump for 2 s, stops it, and lets the pressures even out: what the mean pressure has become
/// against the atmosphere's it started from, and by how many Pa the chambers still differ.
fn evened_out(step_ms: f64, refine: bool) -> (f64, f64) {
    let mut rig = closed_pump(step_ms);
    rig.integrator.refine_switching = refine;
    let mut simulation = simulation(&rig);
    for _ in 0..100 {
        simulation.tick(&[1.0]);
    }
    let apart = simulation.pressure_kpa(0) - simulation.pressure_kpa(1);
    assert!(apart > 20.0, "the pump moved nothing: {apart} kPa");
    for _ in 0..2000 {
        simulation.tick(&[0.0]);
    }
    let (p, n) = (simulation.pressure_pa(0), simulation.pressure_pa(1));
    ((0.75 * p + 0.4 * n) / (1.15 * ATMOSPHERE) - 1.0, (p - n).abs())
}

#[test]
fn a_closed_pump_keeps_its_mass() {
    // 3000 rpm stops at the crank angle it started from. The gas left in the cylinders lies between the
    // chambers' pressures (else a check valve would open), so once these are even all gas has one pressure; with
    // the same volumes and temperatures as at the start it must be the pressure of the start.
    let [coarse, paper, fine] = [0.2, 0.1, 0.02].map(|step_ms| evened_out(step_ms, false));
    let refined = evened_out(0.1, true);
    println!("closed pump: {:.1e}, {:.1e}, {:.1e} of the pressure gone in 100 revolutions", coarse.0, paper.0, fine.0);
    println!("closed pump: chambers {:.1e}, {:.1e}, {:.1e} Pa apart", coarse.1, paper.1, fine.1);
    // A moving wall is no linear invariant of Runge-Kutta, so this holds to what a step leaves: at least of order 2
    // from 0.1 to 0.02 ms. Evening out is slowed by the last check valve that hunts about its closing.
    assert!(paper.0.abs() < 2e-6 && paper.1 < 0.2, "{paper:?}");
    assert!(fine.0.abs() < 0.04 * paper.0.abs() && fine.1 < 1e-3, "{fine:?}");
    // Refined steps hunt about a closing valve in a pattern of their own, and stop evening out 1.4 Pa apart.
    assert!(refined.0.abs() < 2e-6 && refined.1 < 3.0, "{refined:?}");
}

#[test]
fn equal_pressures_pass_exactly_nothing() {
    for name in Rig::BUILTIN {
        let mut simulation = simulation(&Rig::builtin(name).unwrap());
        let inputs = simulation.plant().inputs().len();
        for tick in 0..50 {
            let duty = f64::from(tick) / 50.0;
            let mut commands = vec![duty; inputs];
            commands[2] = 0.0; // the pump stands
            simulation.tick(&commands);
            for chamber in 0..2 {
                assert_eq!(simulation.pressure_pa(chamber).to_bits(), ATMOSPHERE.to_bits(), "{name}, tick {tick}");
            }
        }
    }
    let still = chamber("one", 0.3)
        + &chamber("two", 0.2)
        + &source("line", 250_000.0, 350.0)
        + &orifice("line", "one", 3.0)
        + &orifice("one", "two", 3.0)
        + "[lines.hose]\nkind = \"laminar\"\nfrom = \"line\"\nto = \"two\"\nresistance_kpa_s_per_l = 1.0\n"
        + &mechanism("chamber_thermal", "two", "wall_conductance_w_per_k = 0.7");
    let mut simulation = simulation(&rig(&still));
    // Exactly what the source has, computed as the plant does.
    let line = ATMOSPHERE + (250_000.0 - ATMOSPHERE) / 1e3 * 1e3;
    for node in 0..2 {
        simulation.set_pressure_pa(node, line);
    }
    for _ in 0..10 {
        simulation.tick(&[]);
    }
    assert_eq!([simulation.pressure_pa(0), simulation.pressure_pa(1)], [line, line]);
}

#[test]
fn chambers_without_walls_keep_their_energy() {
    // U = P V/(κ−1) of each: what leaves the one with c_p T arrives in the other.
    let adiabatic = |name: &str| mechanism("chamber_thermal", name, "wall_conductance_w_per_k = 0.0");
    let mut simulation = simulation(&rig(&(chamber("one", 0.75)
        + &chamber("two", 0.4)
        + &orifice("one", "two", 4.0)
        + &adiabatic("one")
        + &adiabatic("two"))));
    simulation.set_pressure_pa(0, 500_000.0);
    simulation.set_pressure_pa(1, 50_000.0);
    let energy = |p: [f64; 2]| p[0] * 0.75e-3 + p[1] * 0.4e-3;
    let before = energy([500_000.0, 50_000.0]);
    for tick in 0..150 {
        simulation.tick(&[]);
        let now = energy([simulation.pressure_pa(0), simulation.pressure_pa(1)]);
        assert!((now / before - 1.0).abs() < 5e-12, "tick {tick}: {:e}", now / before - 1.0);
    }
    assert!((simulation.pressure_pa(0) - simulation.pressure_pa(1)).abs() < 10.0, "they have evened out");
}

#[test]
fn chambers_with_walls_come_back_to_their_temperature() {
    // Mass is kept and everything ends at the walls' 293.15 K: the pressure is the mixture's.
    let wall = |name: &str, g: f64| mechanism("chamber_thermal", name, &format!("wall_conductance_w_per_k = {g:?}"));
    let mut simulation = simulation(&rig(&(chamber("one", 0.75)
        + &chamber("two", 0.4)
        + &orifice("one", "two", 4.0)
        + &wall("one", 3.0)
        + &wall("two", 1.0))));
    simulation.set_pressure_pa(0, 500_000.0);
    simulation.set_pressure_pa(1, 50_000.0);
    for _ in 0..3000 {
        simulation.tick(&[]);
    }
    let mixed = (500_000.0 * 0.75 + 50_000.0 * 0.4) / (0.75 + 0.4);
    for node in 0..2 {
        let off = simulation.pressure_pa(node) / mixed - 1.0;
        println!("walled chambers: chamber {node} ends {off:.1e} from the mixture");
        assert!(off.abs() < 1e-6, "{off:e}");
    }
}
