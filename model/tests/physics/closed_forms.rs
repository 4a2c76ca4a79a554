//! Small rigs whose solution is a formula.
//!
//! With κ = 1.4 the subsonic branch of eq. (3) integrates in closed form: put y = p^(1/7), then
//! Φ = √7 y⁵ √(1 − y²), and a chamber at constant temperature that fills from a constant pressure obeys
//! d√(1 − y²)/dt = −K/√7 with K = (R T/V) A/√(R T_up), while one that empties to a constant pressure obeys
//! dG/dt = −K/√7 with G = c + 2c³/3 + c⁵/5, c = √(1 − y²)/y.
//!
//! Unless a test says otherwise the tolerance is what RK4 at 0.1 ms leaves, of the order (h/t)⁴ for a time
//! constant t of 0.1 s and more, with a margin for rounding over thousands of steps.

use model::rig::Rig;

use crate::small_rigs::{
    ATMOSPHERE, KAPPA, R, T, TICK_S, chamber, choked, critical, mechanism, orifice, printed_flow, rig, simulation,
    source,
};

const LITRE: f64 = 1e-3;
const MM2: f64 = 1e-6;

#[test]
fn orifice_passes_what_eq_3_prints() {
    // 0.01 mm² into 100 L for 1 ms: the pressures stand still to 2e-8, so the flow is that at the start. At a
    // ratio of 0.99 this shifts the flow by 1e-6 (the root's slope); rounding of the pressure weighs 1e-7.
    let (source_pa, source_k, volume, area) = (601_325.0, 350.0, 100.0 * LITRE, 0.01 * MM2);
    for (kappa, gas_constant) in [(1.4, 287.0), (1.667, 208.0)] {
        let mut rig =
            rig(&(chamber("tank", 100.0) + &source("line", source_pa, source_k) + &orifice("line", "tank", 0.01)));
        rig.integrator.tick_ms = 1.0;
        rig.gas.heat_capacity_ratio = kappa;
        rig.gas.gas_constant_j_per_kg_k = gas_constant;
        let flow_into_tank = |tank_pa: f64| {
            let mut simulation = simulation(&rig);
            simulation.set_pressure_pa(0, tank_pa);
            simulation.tick(&[]);
            (simulation.pressure_pa(0) - tank_pa) / 1e-3 * volume / (gas_constant * T)
        };
        for ratio in [0.1, 0.3, 0.48, 0.5, 0.52, 0.53, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99] {
            let filling = area * printed_flow(kappa, source_pa, ratio * source_pa, gas_constant * source_k);
            let got = flow_into_tank(ratio * source_pa);
            assert!((got / filling - 1.0).abs() < 2e-6, "κ {kappa}, filling at {ratio}: {got} against {filling} kg/s");
            let emptying = area * printed_flow(kappa, source_pa / ratio, source_pa, gas_constant * T);
            let got = -flow_into_tank(source_pa / ratio);
            assert!(
                (got / emptying - 1.0).abs() < 2e-6,
                "κ {kappa}, emptying at {ratio}: {got} against {emptying} kg/s"
            );
        }
    }
}

#[test]
fn one_way_orifice_passes_nothing_back() {
    let line = orifice("line", "tank", 5.0) + "one_way = true\n";
    let mut simulation = simulation(&rig(&(chamber("tank", 0.1) + &source("line", 150_000.0, T) + &line)));
    simulation.set_pressure_pa(0, 150_001.0);
    simulation.tick(&[]);
    assert_eq!(simulation.pressure_pa(0), 150_001.0);
    simulation.set_pressure_pa(0, 140_000.0);
    simulation.tick(&[]);
    assert!(simulation.pressure_pa(0) > 141_000.0);
}

/// Eqs. (4)-(5) with the numbers of Table III, on the rig itself without its pump; chambers beyond the air are vented through the
/// area that eq. (5) leaves, by eq. (3) the other way.
#[test]
fn vent_valves_open_as_eqs_4_and_5_print() {
    let mut rig = Rig::builtin("dual_pressure").unwrap();
    rig.integrator.tick_ms = 1.0;
    rig.pumps.clear();
    for volume in rig.volumes.values_mut() {
        // As large as may be: 1 ms changes the pressure by 1e-6 of itself.
        volume.volume_l = 100.0;
    }
    let nozzle = std::f64::consts::PI * 0.003f64.powi(2) / 4.0;
    let (mut shut, mut backwards) = (0, 0);
    for duty in [0.0, 0.3, 0.5, 0.7, 0.85, 1.0] {
        for gauge in [-20e3, -5e3, -1e3, 5e3, 40e3, 80e3, 95e3] {
            let mut simulation = simulation(&rig);
            let (pos, neg) = (ATMOSPHERE + gauge, ATMOSPHERE - gauge);
            simulation.set_pressure_pa(0, pos);
            simulation.set_pressure_pa(1, neg);
            simulation.tick(&[duty, duty]);
            let per_mass = R * T / (100.0 * LITRE) * 1e-3;
            let got = [(pos - simulation.pressure_pa(0)) / per_mass, (simulation.pressure_pa(1) - neg) / per_mass];
            let area = [
                ((4.876 * duty + 3.066 * nozzle * gauge - 4.474) * MM2).max(0.0),
                ((7.992 * duty + 7.590 * nozzle * gauge - 7.339) * MM2).max(0.0),
            ];
            let through =
                |up: f64, down: f64| printed_flow(KAPPA, up, down, R * T) - printed_flow(KAPPA, down, up, R * T);
            let flow = [area[0] * through(pos, ATMOSPHERE), area[1] * through(ATMOSPHERE, neg)];
            for (got, flow) in got.into_iter().zip(flow) {
                // Rounding of the pressure weighs 1e-9 kg/s; the area, a difference of larger numbers, drifts
                // with the pressure by 1e-5 of itself at most.
                assert!(
                    (got - flow).abs() < 1e-5 * flow.abs() + 1e-9,
                    "duty {duty}, {gauge} Pa: {got} against {flow} kg/s"
                );
                assert!(flow != 0.0 || got == 0.0, "a shut valve leaks {got} kg/s");
                shut += usize::from(flow == 0.0);
                backwards += usize::from(flow < 0.0);
            }
        }
    }
    assert!(shut > 8 && shut < 70, "{shut} of 84 shut: both branches must be met");
    assert!(backwards >= 4, "{backwards} of 84 backwards");
}

#[test]
fn choked_isothermal_filling_is_linear() {
    // The source is warmer than the chamber: the orifice sees the one, the balance the other.
    let (source_pa, source_k, volume_l) = (700_000.0, 350.0, 0.75);
    let mut simulation = simulation(&rig(&(chamber("tank", volume_l)
        + &source("line", source_pa, source_k)
        + &orifice("line", "tank", 1.0))));
    let slope = R * T / (volume_l * LITRE) * MM2 * source_pa / (R * source_k).sqrt() * choked(KAPPA);
    let mut ticks = 0.0;
    while simulation.pressure_pa(0) < 0.52 * source_pa {
        simulation.tick(&[]);
        ticks += 1.0;
        let exact = ATMOSPHERE + slope * ticks * TICK_S;
        // RK4 is exact here; the polynomial for Φ is good to 1e-10.
        assert!((simulation.pressure_pa(0) / exact - 1.0).abs() < 1e-9, "after {ticks} ticks");
    }
    assert!(ticks > 50.0);
}

#[test]
fn subsonic_isothermal_filling_follows_its_closed_form() {
    let (source_pa, source_k, volume_l) = (200_000.0, 350.0, 0.75);
    let mut simulation = simulation(&rig(&(chamber("tank", volume_l)
        + &source("line", source_pa, source_k)
        + &orifice("line", "tank", 1.0))));
    simulation.set_pressure_pa(0, 0.54 * source_pa);
    let k = R * T / (volume_l * LITRE) * MM2 / (R * source_k).sqrt();
    let root = |p: f64| (1.0 - (p / source_pa).powf(2.0 / 7.0)).sqrt();
    let from = root(0.54 * source_pa);
    let full_s = from * 7f64.sqrt() / k;
    let (mut time, mut worst) = (0.0, 0.0f64);
    while time < full_s - TICK_S {
        simulation.tick(&[]);
        time += TICK_S;
        let exact = source_pa * (1.0 - (from - k * time / 7f64.sqrt()).powi(2)).powf(3.5);
        worst = worst.max((simulation.pressure_pa(0) - exact).abs());
    }
    println!("subsonic filling: at most {worst:.1e} Pa off over {time:.2} s");
    assert!(time > 1.0 && worst < 1e-7, "{worst} Pa");
    // The formula says that the chamber is full at a finite time. RK4 overshoots that corner by what flows in a
    // step, then hunts about it.
    for _ in 0..3 {
        simulation.tick(&[]);
    }
    let left = (simulation.pressure_pa(0) - source_pa).abs();
    println!("subsonic filling: {left:.1e} Pa left when full");
    assert!(left < 1e-3, "{left} Pa");
}

#[test]
fn isothermal_venting_follows_its_closed_form() {
    let (volume_l, area_mm2, start) = (0.4, 2.0, 600_000.0);
    let mut simulation = simulation(&rig(&(chamber("tank", volume_l) + &orifice("tank", "atmosphere", area_mm2))));
    simulation.set_pressure_pa(0, start);
    let k = R * T / (volume_l * LITRE) * area_mm2 * MM2 / (R * T).sqrt();
    let unchoked_pa = ATMOSPHERE / critical(KAPPA);
    let unchoked_s = (start / unchoked_pa).ln() / (k * choked(KAPPA));
    let g = |p: f64| {
        let y = (ATMOSPHERE / p).powf(1.0 / 7.0);
        let c = (1.0 - y * y).sqrt() / y;
        c + 2.0 * c.powi(3) / 3.0 + c.powi(5) / 5.0
    };
    let (mut time, mut worst, mut subsonic) = (0.0, 0.0f64, 0);
    while simulation.pressure_pa(0) > 1.001 * ATMOSPHERE {
        simulation.tick(&[]);
        time += TICK_S;
        let p = simulation.pressure_pa(0);
        let off = if time < unchoked_s {
            p - start * (-k * choked(KAPPA) * time).exp()
        } else {
            subsonic += 1;
            // The time at which the formula has this pressure, and what the pressure does in the difference.
            let at = unchoked_s + 7f64.sqrt() / k * (g(unchoked_pa) - g(p));
            (at - time) * R * T / (volume_l * LITRE) * area_mm2 * MM2 * printed_flow(KAPPA, p, ATMOSPHERE, R * T)
        };
        worst = worst.max(off.abs());
    }
    println!("isothermal venting: at most {worst:.1e} Pa off over {time:.2} s");
    assert!(subsonic > 20 && worst < 1e-5, "{worst} Pa, {subsonic} ticks subsonic");
}

#[test]
fn flow_pump_evacuates_exponentially() {
    let pump = "[pumps.pump]\nkind = \"flow\"\ninlet = \"bell\"\nflow_l_per_min = 6.0\ncommand = \"speed\"\n";
    let mut simulation = simulation(&rig(&(chamber("bell", 0.3) + pump)));
    let mut displaced_l = 0.0;
    for tick in 0..500 {
        let speed = if tick < 250 { 1.0 } else { 0.4 };
        simulation.tick(&[speed]);
        displaced_l += speed * 6.0 / 60.0 * TICK_S;
        let exact = ATMOSPHERE * (-displaced_l / 0.3f64).exp();
        // (Q h/V)⁵/120 per step is 1e-25; what is left is rounding.
        assert!((simulation.pressure_pa(0) / exact - 1.0).abs() < 1e-11, "tick {tick}");
    }
    assert!(simulation.pressure_kpa(0) < -90.0, "{} kPa", simulation.pressure_kpa(0));
}

#[test]
fn flow_source_fills_linearly() {
    let source = "[sources.feed]\nkind = \"flow\"\nto = \"tank\"\nflow_l_per_min = 3.0\nsignal = \"feed\"\n";
    let mut rig = rig(&(chamber("tank", 0.3) + source));
    rig.volumes[0].temperature_k = 330.0;
    let mut simulation = simulation(&rig);
    for _ in 0..100 {
        simulation.tick(&[0.5]);
    }
    // 0.5 · 3 L/min of air at 293.15 K over 2 s, warmed to the chamber's 330 K.
    let exact = ATMOSPHERE * (1.0 + 0.5 * 3.0 / 60.0 * 2.0 / 0.3 * 330.0 / T);
    assert!((simulation.pressure_pa(0) / exact - 1.0).abs() < 1e-11, "{}", simulation.pressure_pa(0));
}

#[test]
fn laminar_line_fills_a_compliant_volume() {
    // ∫ (a + 2cP)/(Ps² − P²) dP = t/(2ζ) with a = V0 − c P_atm, from below and from above.
    let (source_pa, resistance, volume_l, compliance) = (161_325.0, 300.0, 0.3, 2.0);
    let line = format!(
        "[lines.hose]\nkind = \"laminar\"\nfrom = \"line\"\nto = \"bag\"\nresistance_kpa_s_per_l = {resistance}\n"
    );
    let mut rig = rig(&(chamber("bag", volume_l) + &source("line", source_pa, T) + &line));
    rig.volumes[0].compliance_ml_per_kpa = compliance;
    let (c, zeta) = (compliance * 1e-9, resistance * 1e6);
    let a = volume_l * LITRE - c * ATMOSPHERE;
    // With |Ps − P| in the logarithms it holds on both sides.
    let integral = |p: f64| {
        a / (2.0 * source_pa) * ((source_pa + p) / (source_pa - p).abs()).ln()
            - c * (source_pa.powi(2) - p * p).abs().ln()
    };
    for start in [0.3 * ATMOSPHERE, ATMOSPHERE, 250_000.0] {
        let mut simulation = simulation(&rig);
        simulation.set_pressure_pa(0, start);
        let (mut worst, mut time) = (0.0f64, 0.0);
        for _ in 0..100 {
            simulation.tick(&[]);
            time += TICK_S;
            let p = simulation.pressure_pa(0);
            let at = 2.0 * zeta * (integral(p) - integral(start));
            worst = worst.max(((at - time) * (source_pa.powi(2) - p * p) / (2.0 * zeta * (a + 2.0 * c * p))).abs());
        }
        let gone = (simulation.pressure_pa(0) - start).abs() / (source_pa - start).abs();
        println!("compliant volume from {start} Pa: at most {worst:.1e} Pa off, {:.0} % of the way", gone * 100.0);
        assert!(worst < 1e-6 && gone > 0.5, "{worst} Pa, {gone}");
    }
}

#[test]
fn leak_decays_by_its_closed_form() {
    // dP/dt = −(R T/V) k (P² − P_atm²), so (P − P_atm)/(P + P_atm) decays exponentially.
    let (volume_l, k) = (0.75, 2e-14);
    let leak = mechanism("chamber_leak", "tank", &format!("conductance_kg_per_s_pa2 = {k:e}"));
    let rig = rig(&(chamber("tank", volume_l) + &leak));
    let rate = 2.0 * ATMOSPHERE * R * T / (volume_l * LITRE) * k;
    for start in [5_000.0, 60_000.0, 200_000.0, 800_000.0] {
        let mut simulation = simulation(&rig);
        simulation.set_pressure_pa(0, start);
        for tick in 1..=150 {
            simulation.tick(&[]);
            let decayed = (start - ATMOSPHERE) / (start + ATMOSPHERE) * (-rate * f64::from(tick) * TICK_S).exp();
            let exact = ATMOSPHERE * (1.0 + decayed) / (1.0 - decayed);
            assert!((simulation.pressure_pa(0) / exact - 1.0).abs() < 1e-11, "from {start}, tick {tick}");
        }
        let left = (simulation.pressure_pa(0) - ATMOSPHERE) / (start - ATMOSPHERE);
        assert!(left < 0.6, "{left} of {start} left: too slow to tell");
    }
}
