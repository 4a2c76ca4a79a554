//! Mechanisms of pumps.

use model::plant::FreeRunStart;
use model::rig::Rig;

use crate::mechanisms::paper_with;
use crate::small_rigs::{ATMOSPHERE, R, T, TICK_S, chamber, mechanism, rig, simulation};

/// One slow piston between the atmosphere and a tank, behind wide check valves: it delivers what its volumes say.
fn slow_pump(inlet: &str, outlet: &str, rpm: f64, mechanisms: &str) -> Rig {
    rig(&(chamber("tank", 0.05)
        + &format!(
            "[pumps.pump]\nkind = \"piston\"\ninlet = \"{inlet}\"\noutlet = \"{outlet}\"\nspeed_rpm = {rpm:?}\n\
             phases_deg = [0.0]\ncrank_radius_mm = 20.0\nrod_length_mm = 70.0\neffective_length_mm = 50.0\n\
             head_area_cm2 = 38.485\ngas_temperature_k = 323.15\n\
             inlet_check_area_mm2 = 20.0\noutlet_check_area_mm2 = 20.0\n"
        )
        + mechanisms))
}

/// Slow pump from the atmosphere into a large tank, which hardly pushes back.
fn slow_pump_into(tank_l: f64, mechanisms: &str) -> Rig {
    let mut rig = slow_pump("atmosphere", "tank", 600.0, mechanisms);
    rig.volumes.get_mut("tank").unwrap().volume_l = tank_l;
    rig
}

/// Where a pump stalls, in Pa.
fn stalled(rig: &Rig) -> f64 {
    let mut simulation = simulation(rig);
    for _ in 0..5000 {
        simulation.tick(&[]);
    }
    simulation.pressure_pa(0)
}

#[test]
fn springs_on_check_valves_take_their_pressure_from_the_stall() {
    // Sealed compression by 5 = δ/(δ − 2r) of what comes in, P_atm − p_in, out against P + p_out.
    let ratio = 5.0;
    for (inlet, outlet) in [(0.0, 0.0), (4.0, 0.0), (0.0, 30.0), (4.0, 30.0)] {
        // Whatever drives the flow, a valve shuts where the difference is its cracking pressure. One that lifts slowly (a share
        // of two) is still 1e-3 away after these 100 s: its flow ends as the square of the difference.
        for opening in ["", "wide_open_share = 0.1", "wide_open_share = 0.5"] {
            let parameters = format!("inlet_kpa = {inlet:?}\noutlet_kpa = {outlet:?}\n{opening}");
            let springs = mechanism("check_valve_cracking", "pump", &parameters);
            let up = stalled(&slow_pump("atmosphere", "tank", 120.0, &springs));
            let exact = (ATMOSPHERE - 1e3 * inlet) * ratio - 1e3 * outlet;
            assert!((up / exact - 1.0).abs() < 5e-4, "{parameters}: {up} against {exact}");
            // Evacuating: the gas of the clearance, at P_atm + p_out, expands to P − p_in.
            let down = stalled(&slow_pump("tank", "atmosphere", 120.0, &springs));
            let exact = (ATMOSPHERE + 1e3 * outlet) / ratio + 1e3 * inlet;
            assert!((down / exact - 1.0).abs() < 5e-4, "{parameters}: {down} against {exact}");
        }
    }
}

#[test]
fn springs_of_nothing_are_no_springs() {
    let run = |mechanisms: &str| {
        let mut simulation = simulation(&paper_with(mechanisms));
        (0..150).for_each(|_| simulation.tick(&[0.7, 0.8, 1.0]));
        [simulation.pressure_pa(0), simulation.pressure_pa(1)]
    };
    assert_eq!(run(""), run(&mechanism("check_valve_cracking", "pump", "")));
    assert_eq!(run(""), run(&mechanism("piston_blowby", "pump", "conductance_kg_per_s_pa2 = 0.0")));
    assert_eq!(run(""), run(&mechanism("pump_droop", "pump", "speed_loss_per_bar = 0.0")));
    assert_eq!(run(""), run(&mechanism("pump_speed", "pump", "change_percent = 0.0")));
}

#[test]
fn a_standing_cylinder_blows_down_through_its_rings() {
    // The pump stands; a tank behind a shut outlet valve cannot be seen, so the inlet's tank is: the cylinder draws
    // from it what the rings let out. Tank and cylinder empty to, or fill from, the atmosphere as P² − P_atm².
    let k = 1e-14;
    let parts = chamber("tank", 0.05)
        + &format!(
            "[pumps.pump]\nkind = \"piston\"\ninlet = \"tank\"\noutlet = \"dump\"\nrelay = \"on\"\nspeed_rpm = 120.0\n\
             phases_deg = [0.0]\ncrank_radius_mm = 20.0\nrod_length_mm = 70.0\neffective_length_mm = 41.0\n\
             head_area_cm2 = 38.485\ngas_temperature_k = {T}\ninlet_check_area_mm2 = 50.0\noutlet_check_area_mm2 = 0.001\n"
        )
        + &crate::small_rigs::source("dump", 900_000.0, T)
        + &mechanism("piston_blowby", "pump", &format!("conductance_kg_per_s_pa2 = {k:?}"));
    let mut simulation = simulation(&rig(&parts));
    simulation.set_pressure_pa(0, 400_000.0);
    // One tick to let the cylinder (3.85 mL of clearance) fill.
    simulation.tick(&[0.0]);
    let start = simulation.pressure_pa(0);
    for _ in 0..50 {
        simulation.tick(&[0.0]);
    }
    let volume = 0.05e-3 + 38.485e-4 * 1e-3;
    let left = (start - ATMOSPHERE) / (start + ATMOSPHERE) * (-2.0 * ATMOSPHERE * R * T / volume * k).exp();
    let exact = ATMOSPHERE * (1.0 + left) / (1.0 - left);
    // The cylinder trails the tank by what drives the leak (1.5e-3 kg/s) through 50 mm²: √ of little, 200 Pa.
    assert!((simulation.pressure_pa(0) - exact).abs() < 300.0, "{} against {exact} Pa", simulation.pressure_pa(0));
    assert!(start > exact + 10_000.0);
}

#[test]
fn blowby_is_a_second_way_out() {
    let run = |mechanisms: &str| {
        let mut simulation = simulation(&paper_with(mechanisms));
        (0..2000).for_each(|_| simulation.tick(&[0.8, 0.6, 1.0]));
        [simulation.pressure_kpa(0), simulation.pressure_kpa(1)]
    };
    let [tight, small, large] = [0.0, 3e-15, 3e-14]
        .map(|k| run(&mechanism("piston_blowby", "pump", &format!("conductance_kg_per_s_pa2 = {k:?}"))));
    // Less is delivered; with less left in the clearance more is drawn.
    assert!(tight[0] > small[0] && small[0] > large[0], "{tight:?} {small:?} {large:?}");
    assert!(tight[1] > small[1] && small[1] > large[1], "{tight:?} {small:?} {large:?}");
}

#[test]
fn another_speed_is_the_stated_one_scaled() {
    let with = paper_with(&mechanism("pump_speed", "pump", "change_percent = -2.5"));
    let stated =
        Rig::from_toml(&model::rig::DUAL_PRESSURE.replace("speed_rpm = 3000.0", "speed_rpm = 2925.0")).unwrap();
    let (mut one, mut other) = (simulation(&with), simulation(&stated));
    for _ in 0..200 {
        one.tick(&[0.7, 0.8, 1.0]);
        other.tick(&[0.7, 0.8, 1.0]);
        // The same speed up to rounding, which turns the crank by 1e-15 of a revolution a tick.
        for chamber in 0..2 {
            assert!((one.pressure_pa(chamber) - other.pressure_pa(chamber)).abs() < 1e-3);
        }
    }
}

/// The gas of one stroke is known, so the gas delivered counts the revolutions:
/// `n = ω₀ (T + s (T − τ (1 − e^(−T/τ))))`, as at a constant speed of that mean.
#[test]
fn a_pump_that_warms_turns_as_often_as_its_course_says() {
    let (change, tau_s, run_s) = (0.2, 4.0, 10.0);
    let delivered = |mechanisms: &str| {
        let mut simulation = simulation(&slow_pump_into(100.0, mechanisms));
        let before = simulation.pressure_pa(0);
        (0..(run_s / TICK_S) as usize).for_each(|_| simulation.tick(&[]));
        simulation.pressure_pa(0) - before
    };
    let speed = |percent: f64, more: &str| {
        delivered(&mechanism("pump_speed", "pump", &format!("change_percent = {percent:?}\n{more}")))
    };
    let mean = change * (1.0 - tau_s / run_s * -(-run_s / tau_s).exp_m1());
    let warming = speed(100.0 * change, &format!("time_constant_s = {tau_s:?}"));
    let (as_often, stated, in_the_end) = (speed(100.0 * mean, ""), speed(0.0, ""), speed(100.0 * change, ""));
    // A hundred strokes, of which the last may be under way.
    assert!((warming / as_often - 1.0).abs() < 1e-2, "{warming} {as_often}");
    assert!(stated * 1.05 < warming && warming * 1.05 < in_the_end, "{stated} {warming} {in_the_end}");
}

#[test]
fn a_drooping_pump_turns_as_slowly_as_its_pressures_say() {
    // Held pressures: two sources and a tank in between would move them, so the outlet is a tank of 100 L.
    let k = 0.2;
    let parts = |mechanisms: &str, rpm: f64| {
        let text = format!(
            "[pumps.pump]\nkind = \"piston\"\ninlet = \"atmosphere\"\noutlet = \"big\"\nspeed_rpm = {rpm:?}\n\
             phases_deg = [0.0, 180.0]\ncrank_radius_mm = 20.0\nrod_length_mm = 70.0\neffective_length_mm = 50.0\n\
             head_area_cm2 = 38.485\ngas_temperature_k = 323.15\ninlet_check_area_mm2 = 20.0\noutlet_check_area_mm2 = 20.0\n"
        );
        let mut simulation = simulation(&rig(&(chamber("big", 100.0) + &text + mechanisms)));
        simulation.set_pressure_pa(0, 2.0 * ATMOSPHERE);
        (0..25).for_each(|_| simulation.tick(&[]));
        simulation.pressure_pa(0)
    };
    let droop = mechanism("pump_droop", "pump", &format!("speed_loss_per_bar = {k}"));
    // Over half a second the tank gains about 4 kPa: the load, and with it the speed, moves by 0.8 %.
    let (with, slower) = (parts(&droop, 600.0), parts("", 600.0 * (1.0 - k * 1.035)));
    let gained = slower - 2.0 * ATMOSPHERE;
    assert!(((with - slower) / gained).abs() < 0.01, "{with} against {slower}, {gained} gained");
}

#[test]
fn a_flow_pump_that_droops_stalls() {
    // V/(R T) Ṗ = ρ_in Q (1 − k (P − P_in)) : exponential approach to the stall.
    let (flow, k) = (6.0 / 60e3, 2.0e-5);
    let pump = "[pumps.pump]\nkind = \"flow\"\noutlet = \"tank\"\nflow_l_per_min = 6.0\n";
    let droop = mechanism("pump_droop", "pump", "speed_loss_per_bar = 2.0");
    let mut simulation = simulation(&rig(&(chamber("tank", 0.3) + pump + &droop)));
    let rate = ATMOSPHERE * flow * k / 0.3e-3;
    for tick in 1..=300 {
        simulation.tick(&[]);
        let exact = (1.0 - (-rate * f64::from(tick) * TICK_S).exp()) / k;
        let gauge = simulation.pressure_pa(0) - ATMOSPHERE;
        assert!((gauge - exact).abs() < 1e-4, "tick {tick}: {gauge} against {exact}");
    }
    assert!(simulation.pressure_kpa(0) > 40.0 && simulation.pressure_kpa(0) < 50.0);
}

#[test]
fn a_commanded_pump_has_a_dead_zone_and_a_dead_time() {
    let pump = |more: &str| {
        let text = format!(
            "[pumps.pump]\nkind = \"flow\"\noutlet = \"tank\"\ncommand = \"pwm\"\nflow_l_per_min = 6.0\n{more}"
        );
        simulation(&rig(&(chamber("tank", 0.3) + &text)))
    };
    let full = ATMOSPHERE * 6.0 / 60.0 * TICK_S / 0.3;
    let risen = |simulation: &mut model::plant::Simulation<f64>, command: f64| {
        let before = simulation.pressure_pa(0);
        simulation.tick(&[command]);
        (simulation.pressure_pa(0) - before) / full
    };
    let mut dead = pump("dead_zone_duty = 0.25\n");
    for (command, share) in [(0.0, 0.0), (0.2, 0.0), (0.25, 0.0), (0.5, 1.0 / 3.0), (1.0, 1.0)] {
        // Rounding of 200 steps on 1e5 Pa against a rise of 670 Pa.
        assert!((risen(&mut dead, command) - share).abs() < 1e-11, "{command}");
    }
    let mut late = pump(&mechanism("command_delay", "pump", "delay_ms = 50.0"));
    let found: Vec<f64> = [1.0, 1.0, 1.0, 0.0, 0.0, 0.0].map(|command| risen(&mut late, command)).to_vec();
    // Two ticks and a half late; the switch is resolved to an instant of 0.025 ms.
    for (found, exact) in found.iter().zip([0.0, 0.0, 0.5, 1.0, 1.0, 0.5]) {
        assert!((found - exact).abs() < 2e-3, "{found} against {exact}");
    }
}

#[test]
fn a_free_run_starts_periodic_wherever_the_crank_stands() {
    // 0.98 revolutions a tick: with two pistons everything repeats itself after 25 ticks, while the chambers are put
    // back, and neither one tick nor the thirty that cylinders settle for are whole revolutions.
    let rig = Rig::from_toml(&model::rig::DUAL_PRESSURE.replace("speed_rpm = 3000.0", "speed_rpm = 2940.0")).unwrap();
    let inputs = [0.8, 0.8, 1.0];
    for phase in [0.0, 0.3, 0.77] {
        let mut simulation = simulation(&rig);
        simulation.start_from(&[95.0, -70.0], &inputs, FreeRunStart::Running);
        let crank = simulation.unknowns().position(|unknown| unknown.name == "phase:pump").unwrap();
        simulation.set_unknown(crank, phase);
        let held = [0, 1].map(|chamber| simulation.pressure_pa(chamber));
        let mut gained = Vec::new();
        for _ in 0..50 {
            simulation.tick(&inputs);
            gained.push([0, 1].map(|chamber| simulation.pressure_pa(chamber) - held[chamber]));
            [0, 1].into_iter().for_each(|chamber| simulation.set_pressure_pa(chamber, held[chamber]));
        }
        for (early, late) in gained[..25].iter().zip(&gained[25..]) {
            for (early, late) in early.iter().zip(late) {
                // Of 1e5 Pa in a cylinder thirty revolutions leave 1e-5, a chamber feels a fifth; the grid of 0.1 ms
                // falls on other crank angles and moves a tick by some pascals more.
                assert!((early - late).abs() < 10.0, "phase {phase}: {early} and 25 ticks later {late} Pa");
            }
        }
    }
}
