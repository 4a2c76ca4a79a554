//! `chamber_thermal` against the first law.
//!
//! A temperature cannot be read from outside. It shows in what flows out: venting after filling measures it.

use model::rig::Rig;

use crate::small_rigs::{
    ATMOSPHERE, KAPPA, R, T, TICK_S, chamber, choked, mechanism, plain_valve, rig, simulation, source,
};

const VOLUME: f64 = 0.75e-3;
const MM2: f64 = 1e-6;
const SUPPLY_PA: f64 = 1_000_000.0;
const SUPPLY_K: f64 = 350.0;

/// A tank that fills from a hot supply by one valve and empties by another.
fn tank(wall_conductance_w_per_k: f64) -> Rig {
    let wall = format!("wall_conductance_w_per_k = {wall_conductance_w_per_k:?}");
    rig(&(chamber("tank", 0.75)
        + &source("supply", SUPPLY_PA, SUPPLY_K)
        + &plain_valve("fill", "supply", "tank")
        + &plain_valve("vent", "tank", "atmosphere")
        + &mechanism("chamber_thermal", "tank", &wall)))
}

/// Mass flow of the choked filling valve at duty 1, in kg/s.
fn supply_flow() -> f64 {
    MM2 * SUPPLY_PA / (R * SUPPLY_K).sqrt() * choked(KAPPA)
}

#[test]
fn adiabatic_filling_and_venting_follow_the_first_law() {
    let mut simulation = simulation(&tank(0.0));
    // Filling brings κ R T_s in with each kilogram, whatever the tank's own temperature: linear.
    let slope = KAPPA * R * SUPPLY_K * supply_flow() / VOLUME;
    for tick in 1..=40 {
        simulation.tick(&[1.0, 0.0]);
        let exact = ATMOSPHERE + slope * f64::from(tick) * TICK_S;
        assert!((simulation.pressure_pa(0) / exact - 1.0).abs() < 1e-9, "tick {tick}");
    }
    let filled = simulation.pressure_pa(0);
    assert!(filled < 0.52 * SUPPLY_PA, "filling must stay choked");
    // Shut in without a wall nothing changes.
    for _ in 0..10 {
        simulation.tick(&[0.0, 0.0]);
    }
    assert!((simulation.pressure_pa(0) / filled - 1.0).abs() < 1e-12);
    // T₂ = κ T_s/(1 + (P₁/P₂)(κ T_s/T₁ − 1)), and what stays behind while venting expands isentropically:
    // P = P₂ (1 + (κ−1)/2 · √(R T₂) A Φ*/V · t)^(−2κ/(κ−1)).
    let warm = KAPPA * SUPPLY_K / (1.0 + ATMOSPHERE / filled * (KAPPA * SUPPLY_K / T - 1.0));
    assert!(warm > 400.0, "{warm} K");
    let rate = 0.5 * (KAPPA - 1.0) * (R * warm).sqrt() * MM2 * choked(KAPPA) / VOLUME;
    for tick in 1..=40 {
        simulation.tick(&[0.0, 1.0]);
        let exact = filled * (1.0 + rate * f64::from(tick) * TICK_S).powf(-2.0 * KAPPA / (KAPPA - 1.0));
        assert!((simulation.pressure_pa(0) / exact - 1.0).abs() < 1e-9, "tick {tick}");
    }
    assert!(simulation.pressure_pa(0) > 2.0 * ATMOSPHERE, "venting must stay choked");
}

#[test]
fn shut_in_gas_cools_through_the_wall_exponentially() {
    // m c_v Ṫ = −G (T − T_wall) with m = P∞ V/(R T_wall) and c_v = R/(κ−1).
    let wall = 0.5;
    let mut simulation = simulation(&tank(wall));
    for _ in 0..30 {
        simulation.tick(&[1.0, 0.0]);
    }
    let start = simulation.pressure_pa(0);
    let mut trace = Vec::new();
    for _ in 0..10_000 {
        simulation.tick(&[0.0, 0.0]);
        trace.push(simulation.pressure_pa(0));
    }
    let end = simulation.pressure_pa(0);
    let time_constant = end * VOLUME / ((KAPPA - 1.0) * wall * T);
    assert!(start > 1.2 * end && time_constant * 40.0 < 200.0, "{start} to {end} Pa, {time_constant} s");
    for (tick, p) in trace.iter().enumerate().step_by(50) {
        let exact = end + (start - end) * (-((tick + 1) as f64) * TICK_S / time_constant).exp();
        assert!((p - exact).abs() < 1e-3, "tick {tick}: {p} against {exact} Pa");
    }
}

#[test]
fn what_the_wall_takes_is_what_filling_brought_too_much() {
    // Filled for 0.6 s, then left alone: at the end m R T_wall/V, however much the wall took on the way.
    for wall in [0.2, 1.0, 5.0, 50.0] {
        let mut simulation = simulation(&tank(wall));
        for _ in 0..30 {
            simulation.tick(&[1.0, 0.0]);
        }
        for _ in 0..15_000 {
            simulation.tick(&[0.0, 0.0]);
        }
        let exact = ATMOSPHERE + R * T / VOLUME * supply_flow() * 0.6;
        let off = simulation.pressure_pa(0) / exact - 1.0;
        println!("G = {wall} W/K: {off:.1e} from the isothermal filling");
        assert!(off.abs() < 1e-8, "{off}");
    }
}

#[test]
fn a_wall_that_conducts_well_makes_it_isothermal() {
    let trace = |rig: &Rig| {
        let mut simulation = simulation(rig);
        let step = |tick: i32| {
            // Filling, holding and venting, each slow against m c_v/G.
            let (fill, vent) = if tick < 40 { (0.5, 0.0) } else { (0.0, 0.3) };
            simulation.tick(&[fill, vent]);
            simulation.pressure_kpa(0)
        };
        (0..100).map(step).collect::<Vec<_>>()
    };
    let isothermal = trace(&tank(1.0).without_mechanisms());
    let deviation = |wall: f64| {
        let with = trace(&tank(wall));
        with.iter().zip(&isothermal).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    };
    let [poor, middle, good] = [1.0, 100.0, 1000.0].map(deviation);
    println!("from isothermal: {poor:.3}, {middle:.4}, {good:.5} kPa at 1, 100, 1000 W/K");
    // First order in 1/G once the wall takes nearly all.
    assert!((9.0..11.0).contains(&(middle / good)), "{middle} and {good} kPa");
    assert!(good < 0.5 && poor > 30.0, "{good} and {poor} kPa");
}

#[test]
fn a_flow_pump_evacuates_a_wall_less_bell_isentropically() {
    // It takes V̇ of what is there, so m falls as exp(−Q t/V) and P as m^κ.
    let pump = "[pumps.pump]\nkind = \"flow\"\ninlet = \"bell\"\nflow_l_per_min = 6.0\n";
    let wall = mechanism("chamber_thermal", "bell", "wall_conductance_w_per_k = 0.0");
    let mut simulation = simulation(&rig(&(chamber("bell", 0.3) + pump + &wall)));
    for tick in 1..=200 {
        simulation.tick(&[]);
        let exact = ATMOSPHERE * (-KAPPA * 6.0 / 60.0 * f64::from(tick) * TICK_S / 0.3).exp();
        assert!(
            (simulation.pressure_pa(0) / exact - 1.0).abs() < 1e-10,
            "tick {tick}: {} Pa",
            simulation.pressure_pa(0)
        );
    }
}
