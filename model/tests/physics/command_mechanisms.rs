//! Mechanisms along a valve's command, read by the flow meter of `mechanisms`.

use model::rig::Rig;

use crate::mechanisms::{METER, acting, paper_with};
use crate::small_rigs::{ATMOSPHERE, KAPPA, R, T, chamber, choked, source};
use crate::small_rigs::{TICK_S, mechanism, plain_valve, rig, simulation};

#[test]
fn stiction_makes_stairs_of_a_ramp() {
    let band = 0.03;
    // Slow up, slow down, a jump, and small moves that nothing follows.
    let mut sent: Vec<f64> = (0..=60).map(|i| 0.01 * f64::from(i)).collect();
    sent.extend((0..40).map(|i| 0.6 - 0.01 * f64::from(i)));
    sent.extend([0.9, 0.92, 0.88, 0.9, 0.929]);
    // Steps of 0.04 (the first multiple of 0.01 beyond the band): 15 up, about 9 down, and the jump. Jumps that end half
    // a band short of the duty come every 0.02 (0.015 and what the ramp's steps add) and are twice as many on the ramps.
    for (short, expected) in [(0.0, 24..=27), (0.5, 45..=52)] {
        let stick = mechanism("valve_stiction", "valve", &format!("band_duty = {band}\nshort_of_it = {short:?}"));
        let (mut flapper, mut jumps) = (0.0f64, 0);
        for (k, (u, y)) in sent.iter().zip(&acting(&stick, &sent)).enumerate() {
            if (u - flapper).abs() > band {
                flapper = u - short * band * (u - flapper).signum();
                jumps += 1;
            }
            assert!((y - flapper).abs() < METER, "tick {k}: duty {u} acts as {y}, the stuck flapper is at {flapper}");
        }
        assert!(expected.contains(&jumps), "{jumps} jumps");
    }
    // No smaller: a band of zero follows everything.
    let free = acting(&mechanism("valve_stiction", "valve", "band_duty = 0.0"), &sent);
    assert!(free.iter().zip(&sent).all(|(y, u)| (y - u).abs() < METER));
}

#[test]
fn the_coils_force_bends_between_fixed_ends() {
    let sent: Vec<f64> = (0..=20).map(|i| 0.05 * f64::from(i)).collect();
    for m in [1.0, 0.3, -0.5, 0.0] {
        let curve = mechanism("valve_force_curve", "valve", &format!("duty_curvature = {m:?}"));
        for (u, y) in sent.iter().zip(acting(&curve, &sent)) {
            let exact = u + m * u * (u - 1.0);
            assert!((y - exact).abs() < METER, "m {m}: duty {u} acts as {y}, not {exact}");
        }
    }
    // m = 1 is the pure square of the duty.
    let square = acting(&mechanism("valve_force_curve", "valve", "duty_curvature = 1.0"), &[0.4]);
    assert!((square[0] - 0.16).abs() < METER);
}

#[test]
fn an_opening_that_ends_approaches_its_full_area() {
    // a/(1 + (a/a_full)⁴)^¼ with a the duty in mm².
    for full in [0.3, 0.8, 3.0] {
        let curve = mechanism("valve_force_curve", "valve", &format!("inverse_full_area_per_mm2 = {:?}", 1.0 / full));
        let sent = [0.05, 0.2, 0.5, 1.0];
        for (a, y) in sent.iter().zip(acting(&curve, &sent)) {
            let exact = a / (1.0 + (a / full).powi(4)).powf(0.25);
            assert!((y - exact).abs() < METER, "full {full}: {a} acts as {y}, not {exact}");
            assert!(y < full && y <= *a + METER);
        }
    }
}

#[test]
fn a_coil_warms_exponentially_and_weakens() {
    let (rise, tau) = (0.1, 3.0);
    let heating = mechanism("coil_heating", "valve", &format!("resistance_rise = {rise}\ntime_constant_s = {tau:?}"));
    let sent: Vec<f64> = (0..600).map(|k| if k < 300 { 0.9 } else { 0.5 }).collect();
    let mut heat = 0.0;
    for (k, (u, mean)) in sent.iter().zip(acting(&heating, &sent)).enumerate() {
        // θ = u² + (θ₀ − u²) e^(−t/τ); the integral of 1/(c + b e^(−t/τ)) is (t + τ ln(c + b e^(−t/τ)))/c.
        let (c, b, left) = (1.0 + rise * u * u, rise * (heat - u * u), (-TICK_S / tau).exp());
        let exact = u / c * (1.0 + tau / TICK_S * ((c + b * left) / (c + b)).ln());
        heat = u * u + (heat - u * u) * left;
        assert!((mean - exact).abs() < METER, "tick {k}: {mean} against {exact}");
    }
    // A coil that starts warm starts weak; a rise of nothing changes nothing.
    let warm = acting(&(heating.clone() + "initial_heat = 1.0\n"), &[0.8]);
    assert!((warm[0] - 0.8 / 1.1).abs() < 1e-3, "{}", warm[0]);
    let none = acting(&mechanism("coil_heating", "valve", "resistance_rise = 0.0\ntime_constant_s = 3.0"), &[0.7, 0.7]);
    assert!((none[1] - 0.7).abs() < METER);
}

/// A step onto a cold coil: the winding's share comes with its own time constant, the rest with the body's.
#[test]
fn a_winding_warms_before_its_body() {
    let (rise, body_s, share, winding_s) = (0.2, 4.0, 0.3, 0.5);
    let heating = mechanism(
        "coil_heating",
        "valve",
        &format!(
            "resistance_rise = {rise}\ntime_constant_s = {body_s:?}\nwinding_share = {share}\n\
             winding_time_constant_s = {winding_s:?}"
        ),
    );
    let u = 0.8_f64;
    for (k, mean) in acting(&heating, &[u; 400]).iter().enumerate() {
        let t = TICK_S * (k as f64 + 0.5);
        let warmed = |tau: f64| u * u * -(-t / tau).exp_m1();
        let exact = u / (1.0 + rise * ((1.0 - share) * warmed(body_s) + share * warmed(winding_s)));
        // Mean of a tick against its middle: the curvature of the quick part, u³ k s (T/τ_w)²/24.
        assert!((mean - exact).abs() < METER + 3e-6, "tick {k}: {mean} against {exact}");
    }
}

#[test]
fn free_runs_start_with_the_coil_as_cold_as_the_rig_says() {
    let heated = paper_with(&mechanism("coil_heating", "valve_pos", "resistance_rise = 0.2\ntime_constant_s = 60.0"));
    let plain = paper_with("");
    let run = |rig, heat: Option<f64>| {
        let mut simulation = simulation(rig);
        let start = simulation.start_for(&[80.0, -70.0]);
        simulation.start_from(&[80.0, -70.0], &[0.8, 0.8, 1.0], start);
        if let Some(heat) = heat {
            let index = simulation.unknowns().position(|u| u.name == "heat:valve_pos").unwrap();
            simulation.set_unknown(index, heat);
        }
        simulation.tick(&[0.8, 0.8, 1.0]);
        simulation.pressure_kpa(0)
    };
    let (plain, cold, warm) = (run(&plain, None), run(&heated, None), run(&heated, Some(0.64)));
    // In one tick of a minute the cold coil loses 0.2·0.8²·20 ms/60 s/2 of its force.
    assert!((cold - plain).abs() < 1e-3, "{cold} against {plain}");
    assert!(warm > plain + 0.4, "warm, it opens less: {warm} against {plain}");
}

#[test]
fn a_free_run_can_begin_with_a_flapper_held_anywhere_in_its_band() {
    let run = |rig: &Rig, duty: f64, share: Option<f64>| {
        let mut simulation = simulation(rig);
        let start = simulation.start_for(&[80.0, -70.0]);
        simulation.start_from(&[80.0, -70.0], &[0.8, 0.8, 1.0], start);
        if let Some(share) = share {
            let index = simulation.unknowns().position(|u| u.name == "stick:valve_pos").unwrap();
            simulation.set_unknown(index, share);
        }
        simulation.tick(&[duty, 0.8, 1.0]);
        simulation.pressure_kpa(0)
    };
    let plain = paper_with("");
    // The plunger's place is the duty that acts; the flapper's is that and the pressure's push, which changes in the tick.
    for (rubs, tolerance) in [("plunger", 1e-9), ("flapper", 0.02)] {
        let parameters = format!("band_duty = 0.05\nrubs = \"{rubs}\"");
        let stuck = paper_with(&mechanism("valve_stiction", "valve_pos", &parameters));
        for share in [-0.9, -0.3, 0.0, 0.6] {
            let (held, moved) = (run(&stuck, 0.8, Some(share)), run(&plain, 0.8 + 0.05 * share, None));
            assert!((held - moved).abs() < tolerance, "{rubs} at {share}: {held} instead of {moved}");
        }
        let ends = [-0.9, 0.9].map(|share| run(&stuck, 0.8, Some(share)));
        assert!(ends[0] - ends[1] > 0.3, "{rubs}: {ends:?}");
    }
}

/// Two flow meters on one supply of current.
fn on_one_supply(mechanisms: &str, sent: [f64; 2]) -> [f64; 2] {
    let supply = 2_000_000.0;
    let rig = rig(&(chamber("one", 100.0)
        + &chamber("two", 100.0)
        + &source("supply", supply, T)
        + &plain_valve("left", "supply", "one")
        + &plain_valve("right", "supply", "two")
        + mechanisms));
    let full = R * T / 0.1 * 1e-6 * supply / (R * T).sqrt() * choked(KAPPA) * TICK_S;
    let mut simulation = simulation(&rig);
    simulation.tick(&sent);
    [0, 1].map(|i| (simulation.pressure_pa(i) - ATMOSPHERE) / full)
}

#[test]
fn a_sagging_supply_couples_the_valves() {
    let sag = mechanism("supply_sag", "rig", "loss_per_duty = 0.1");
    for sent in [[0.8, 0.0], [0.8, 0.5], [0.3, 1.0]] {
        let left = 1.0 - 0.1 * (sent[0] + sent[1]);
        let acted = on_one_supply(&sag, sent);
        for (acted, sent) in acted.into_iter().zip(sent) {
            assert!((acted - sent * left).abs() < METER, "{acted} against {}", sent * left);
        }
    }
    assert_eq!(
        on_one_supply("", [0.8, 0.5]),
        on_one_supply(&mechanism("supply_sag", "rig", "loss_per_duty = 0.0"), [0.8, 0.5])
    );
    // What a delayed valve draws is what it was sent then, so the other one feels it late.
    let late = sag.clone() + &mechanism("command_delay", "left", "delay_ms = 10.0");
    let acted = on_one_supply(&late, [0.6, 0.5]);
    // Nothing drawn by the left valve in the first half of the tick.
    let right = 0.5 * (0.5 * (1.0 - 0.1 * 0.5) + 0.5 * (1.0 - 0.1 * 1.1));
    let left = 0.5 * 0.6 * (1.0 - 0.1 * 1.1);
    // The switch is blended over one instant of 0.025 ms, of 20 ms.
    assert!((acted[1] - right).abs() < 1e-4 && (acted[0] - left).abs() < 2e-3, "{acted:?}, {left}, {right}");
}

#[test]
fn heating_and_sag_act_in_front_of_the_coils_lag() {
    // With a long lag the coil has hardly moved, whatever weakens its current.
    let lag = mechanism("valve_lag", "valve", "time_constant_ms = 5000.0");
    let weak = lag.clone()
        + &mechanism("coil_heating", "valve", "resistance_rise = 1.0\ntime_constant_s = 1.0\ninitial_heat = 1.0");
    let (alone, weak) = (acting(&lag, &[1.0]), acting(&weak, &[1.0]));
    // Half of the current, so half of the little way.
    assert!((weak[0] / alone[0] - 0.5).abs() < 1e-9, "{} of {}", weak[0], alone[0]);
}
