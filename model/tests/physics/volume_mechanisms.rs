//! Mechanisms of volumes, of sensors, and tabled flows.

use model::rig::Rig;

use crate::mechanisms::paper_with;
use crate::small_rigs::{
    ATMOSPHERE, KAPPA, R, T, TICK_S, chamber, choked, mechanism, orifice, plain_valve, rig, simulation, source,
};

const MM2: f64 = 1e-6;

/// Choked flow through 1 mm² from 2 MPa, in kg/s.
fn feed_flow() -> f64 {
    MM2 * 2e6 / (R * T).sqrt() * choked(KAPPA)
}

fn fed(mechanisms: &str) -> Rig {
    rig(&(chamber("tank", 0.75) + &source("supply", 2e6, T) + &plain_valve("valve", "supply", "tank") + mechanisms))
}

#[test]
fn a_ballooning_chamber_fills_to_p_times_v() {
    // P (V₀ + c (P − P_atm)) grows by R T ṁ t.
    let compliance = 1.3e-9;
    let mut simulation = simulation(&fed(&mechanism("volume_compliance", "tank", "compliance_ml_per_kpa = 1.3")));
    for tick in 1..=60 {
        simulation.tick(&[1.0]);
        let p = simulation.pressure_pa(0);
        let content = p * (0.75e-3 + compliance * (p - ATMOSPHERE));
        let exact = ATMOSPHERE * 0.75e-3 + R * T * feed_flow() * f64::from(tick) * TICK_S;
        assert!((content / exact - 1.0).abs() < 1e-9, "tick {tick}: {content} against {exact}");
        assert!(p < 1e6, "it must stay choked");
    }
}

#[test]
fn compliance_as_a_mechanism_is_compliance_of_the_volume() {
    let stated = model::rig::DUAL_PRESSURE.replace("volume_l = 0.4", "volume_l = 0.4\ncompliance_ml_per_kpa = 0.8");
    let (mut one, mut other) = (
        simulation(&Rig::from_toml(&stated).unwrap()),
        simulation(&paper_with(&mechanism("volume_compliance", "negative", "compliance_ml_per_kpa = 0.8"))),
    );
    for _ in 0..50 {
        one.tick(&[0.7, 0.8, 1.0]);
        other.tick(&[0.7, 0.8, 1.0]);
    }
    assert_eq!(one.pressure_pa(1), other.pressure_pa(1));
}

#[test]
fn extra_volume_is_volume() {
    let stated = Rig::from_toml(&model::rig::DUAL_PRESSURE.replace("volume_l = 0.75", "volume_l = 0.80")).unwrap();
    let extra = paper_with(&mechanism("volume_change", "positive", "extra_volume_l = 0.05"));
    let run = |rig: &Rig| {
        let mut simulation = simulation(rig);
        (0..50).for_each(|_| simulation.tick(&[0.7, 0.8, 1.0]));
        simulation.pressure_pa(0)
    };
    // 0.75 + 0.05 and 0.80 differ in the last bit.
    assert!((run(&stated) - run(&extra)).abs() < 1e-6);
}

#[test]
fn a_volume_that_joins_later_keeps_the_gas_and_adds_its_own() {
    for (extra, brings, parts) in [(0.25, 0.0, 0.0), (0.25, 150e3, 150e3 * 0.25), (-0.15, 0.0, 0.0)] {
        let number = format!("extra_volume_l = {extra:?}\nbegins_s = 0.33\nbrings_kpa_abs = {:?}", 1e-3 * brings);
        // With an energy balance as well, whose walls take up all heat at once.
        let walls = mechanism("chamber_thermal", "tank", "wall_conductance_w_per_k = 1000.0");
        for walls in ["", &walls] {
            let joins = mechanism("volume_change", "tank", &number);
            let mut simulation = simulation(&rig(&(chamber("tank", 0.75) + &joins + walls)));
            simulation.set_pressure_pa(0, 300e3);
            for tick in 1..=100 {
                simulation.tick(&[]);
                let p = simulation.pressure_pa(0);
                // Nothing before, Boyle's law after; half a second is what it takes.
                let exact = (300e3 * 0.75 + parts) / (0.75 + extra);
                match tick {
                    ..=16 => assert!((p - 300e3).abs() < 1e-6, "tick {tick}: {p}"),
                    42.. => assert!((p / exact - 1.0).abs() < 1e-4, "tick {tick}: {p} against {exact}"),
                    _ => {}
                }
            }
        }
    }
}

#[test]
fn a_run_that_begins_later_has_what_has_joined_and_drifted_by_then() {
    let all = mechanism("volume_change", "positive", "extra_volume_l = 0.2\nbegins_s = 5.0")
        + &mechanism("sensor_drift", "sensor_pos", "rate_kpa_per_min = 6.0");
    let mut later = simulation(&paper_with(&all));
    let duties = [0.7, 0.8, 1.0];
    later.start_at(&[50.0, -40.0], &duties, model::plant::FreeRunStart::Running, 0.0, 20.0);
    assert!((later.reading_kpa(0) - 50.0).abs() < 1e-9, "it reads what it is said to");
    assert!((later.pressure_kpa(0) - 48.0).abs() < 1e-9, "after two kPa of drift: {}", later.pressure_kpa(0));
    let stated = mechanism("volume_change", "positive", "extra_volume_l = 0.2");
    let mut larger = simulation(&paper_with(&stated));
    larger.start_at(&[48.0, -40.0], &duties, model::plant::FreeRunStart::Running, 0.0, 0.0);
    for tick in 0..100 {
        later.tick(&duties);
        larger.tick(&duties);
        let off = later.pressure_kpa(0) - larger.pressure_kpa(0);
        // The same physics; cylinders settle against chambers of the same pressure.
        assert!(off.abs() < 1e-6, "tick {tick}: {off} kPa");
    }
}

#[test]
fn what_leaks_across_leaves_one_and_enters_the_other() {
    let k = 4e-15;
    let leak = mechanism("cross_leak", "one", &format!("to = \"two\"\nconductance_kg_per_s_pa2 = {k:?}"));
    let mut simulation = simulation(&rig(&(chamber("one", 0.75) + &chamber("two", 0.4) + &leak)));
    simulation.set_pressure_pa(0, 400_000.0);
    simulation.set_pressure_pa(1, 30_000.0);
    let content = |s: &model::plant::Simulation<f64>| 0.75 * s.pressure_pa(0) + 0.4 * s.pressure_pa(1);
    let before = content(&simulation);
    // With the mass kept, P₁ and P₂ are straight in each other and P₁² − P₂² is a quadratic in P₁: the difference
    // from the mixture decays as a logistic curve; here by its own small steps.
    let (mut p, mut n) = (400_000.0f64, 30_000.0f64);
    for tick in 1..=100 {
        simulation.tick(&[]);
        for _ in 0..2000 {
            let flow = |p: f64, n: f64| k * (p * p - n * n) * R * T * 1e-5;
            let half = flow(p, n) * 0.5;
            let (mp, mn) = (p - half / 0.75e-3, n + half / 0.4e-3);
            let whole = flow(mp, mn);
            (p, n) = (p - whole / 0.75e-3, n + whole / 0.4e-3);
        }
        assert!((simulation.pressure_pa(0) - p).abs() < 1.0, "tick {tick}: {} against {p}", simulation.pressure_pa(0));
        assert!((content(&simulation) / before - 1.0).abs() < 1e-13);
    }
    assert!(p < 399_000.0);
}

/// A muscle between two tanks.
fn muscle(more: &str, extra: &str) -> Rig {
    let load = mechanism("actuator_load", "positive", &format!("vacuum = \"negative\"\n{more}"));
    rig(&(chamber("positive", 0.75) + &chamber("negative", 0.4) + &load + extra))
}

#[test]
fn a_muscle_keeps_the_mass_of_both_chambers_and_stops_where_forces_balance() {
    let (area, stiffness, payload) = (12.1e-4, 3300.0, 5.0);
    let mut simulation = simulation(&muscle("payload_kg = 5.0", ""));
    simulation.set_pressure_pa(0, ATMOSPHERE + 90_000.0);
    simulation.set_pressure_pa(1, ATMOSPHERE - 72_000.0);
    // At rest (x = 0) both have their stated volume.
    let (p0, n0) = (ATMOSPHERE + 90_000.0, ATMOSPHERE - 72_000.0);
    for _ in 0..100 {
        simulation.tick(&[]);
    }
    let (p, n) = (simulation.pressure_pa(0), simulation.pressure_pa(1));
    // P V is kept, so both pressures tell the contraction, and the forces must balance there.
    let by_positive = (p0 / p - 1.0) * 0.75e-3 / area;
    let by_negative = (1.0 - n0 / n) * 0.4e-3 / area;
    let balance = (area * (p - n) - payload * 9.80665) / stiffness;
    assert!((by_positive - by_negative).abs() < 1e-9, "{by_positive} {by_negative}");
    assert!((by_positive - balance).abs() < 1e-9 && balance > 0.02, "{by_positive} m against {balance} m");
    // After 100 ticks, 25 time constants of 80 ms: 1e-11 of the way is left.
}

#[test]
fn twenty_kilograms_are_too_much_at_the_papers_references() {
    let contracted = |payload: f64| {
        let mut simulation = simulation(&muscle(&format!("payload_kg = {payload:?}"), ""));
        simulation.set_pressure_pa(0, ATMOSPHERE + 90_000.0);
        simulation.set_pressure_pa(1, ATMOSPHERE - 72_000.0);
        (0..100).for_each(|_| simulation.tick(&[]));
        (1.0 - (ATMOSPHERE - 72_000.0) / simulation.pressure_pa(1)) * 0.4e-3 / 12.1e-4
    };
    let lengths = [0.0, 5.0, 10.0, 15.0, 20.0].map(contracted);
    println!("contraction at 0 … 20 kg: {:.1?} mm", lengths.map(|x| 1e3 * x));
    assert!(lengths.windows(2).all(|w| w[0] > w[1] + 0.005) && lengths[4].abs() < 1e-12, "{lengths:?}");
}

#[test]
fn a_muscle_on_a_chamber_without_walls_does_work() {
    // Shut in and adiabatic, what the gas loses of its energy is what the muscle does: dU = −P dV in each chamber, so
    // P V^κ stays, however the muscle moves.
    let wall = |name: &str| mechanism("chamber_thermal", name, "wall_conductance_w_per_k = 0.0");
    let mut simulation = simulation(&muscle("payload_kg = 2.0", &(wall("positive") + &wall("negative"))));
    simulation.set_pressure_pa(0, 2.0 * ATMOSPHERE);
    simulation.set_pressure_pa(1, 0.4 * ATMOSPHERE);
    for _ in 0..60 {
        simulation.tick(&[]);
    }
    let (p, n) = (simulation.pressure_pa(0), simulation.pressure_pa(1));
    let by_positive = ((2.0 * ATMOSPHERE / p).powf(1.0 / KAPPA) - 1.0) * 0.75e-3;
    let by_negative = (1.0 - (0.4 * ATMOSPHERE / n).powf(1.0 / KAPPA)) * 0.4e-3;
    assert!((by_positive - by_negative).abs() < 1e-12 && by_positive > 1e-5, "{by_positive} {by_negative} m³");
}

#[test]
fn a_free_run_starts_with_the_muscle_where_it_hangs() {
    let load = mechanism("actuator_load", "positive", "vacuum = \"negative\"\npayload_kg = 5.0");
    let mut simulation = simulation(&paper_with(&load));
    let start = simulation.start_for(&[90.0, -72.0]);
    simulation.start_from(&[90.0, -72.0], &[0.0, 0.0, 0.0], start);
    for _ in 0..20 {
        simulation.tick(&[0.0, 0.0, 0.0]);
    }
    // Everything shut and the pump off: nothing moves (cylinders were periodic at these pressures, and breathe a little).
    assert!((simulation.pressure_kpa(0) - 90.0).abs() < 0.5 && (simulation.pressure_kpa(1) + 72.0).abs() < 0.5);
}

#[test]
fn readings_are_off_as_stated_and_nothing_else_is() {
    let parts = mechanism("sensor_gain", "sensor_pos", "gain = 1.05")
        + &mechanism("sensor_bias", "sensor_pos", "bias_kpa = -0.7")
        + &mechanism("sensor_drift", "sensor_pos", "rate_kpa_per_min = 3.0\ntime_constant_s = 0.5")
        + &mechanism("sensor_drift", "sensor_neg", "rate_kpa_per_min = -6.0");
    let (mut off, mut right) = (simulation(&paper_with(&parts)), simulation(&paper_with("")));
    for tick in 1..=100 {
        off.tick(&[0.7, 0.8, 1.0]);
        right.tick(&[0.7, 0.8, 1.0]);
        let time = f64::from(tick) * TICK_S;
        let pos = 1.05 * right.reading_kpa(0) - 0.7 + 0.05 * 0.5 * (1.0 - (-time / 0.5).exp());
        let neg = right.reading_kpa(1) - 0.1 * time;
        assert!((off.reading_kpa(0) - pos).abs() < 1e-12 && (off.reading_kpa(1) - neg).abs() < 1e-12, "tick {tick}");
        assert_eq!([0, 1].map(|i| off.pressure_pa(i)), [0, 1].map(|i| right.pressure_pa(i)));
    }
}

#[test]
fn a_free_run_starts_from_what_was_read() {
    // 84.3 read by a sensor with gain 1.05 and bias 0.3 is 80 in the chamber.
    let parts = mechanism("sensor_gain", "sensor_pos", "gain = 1.05")
        + &mechanism("sensor_bias", "sensor_pos", "bias_kpa = 0.3");
    let mut simulation = simulation(&paper_with(&parts));
    simulation.start_from(&[84.3, -60.0], &[0.7, 0.7, 1.0], model::plant::FreeRunStart::AtRest);
    assert!((simulation.pressure_kpa(0) - 80.0).abs() < 1e-9 && (simulation.reading_kpa(0) - 84.3).abs() < 1e-9);
    simulation.correct(&[0], &[94.8]);
    assert!((simulation.pressure_kpa(0) - 90.0).abs() < 1e-9);
}

#[test]
fn tabled_flow_over_pressure_is_what_the_table_says() {
    // ṁ = −s (P_gauge − 50 kPa) in mg/s: an exponential towards 50 kPa gauge.
    let table = "flow_mg_per_s = [100.0, -100.0]\n\
                 axes = [{ variable = \"pressure\", of = \"tank\", knots = [0.0, 100.0] }]";
    for shape in ["linear", "cubic"] {
        let residual = mechanism("residual_flow", "tank", &format!("shape = \"{shape}\"\n{table}"));
        let mut simulation = simulation(&rig(&(chamber("tank", 0.75) + &residual)));
        let rate = 2.0 * 1e-6 / 1e3 * R * T / 0.75e-3;
        for tick in 1..=200 {
            simulation.tick(&[]);
            let exact = 50.0 * (1.0 - (-rate * f64::from(tick) * TICK_S).exp());
            assert!((simulation.pressure_kpa(0) - exact).abs() < 1e-9, "{shape} tick {tick}: {exact}");
        }
    }
}

#[test]
fn tabled_area_over_duty_adds_to_the_valve() {
    let flow = |mechanisms: &str, duty: f64| {
        let mut simulation = simulation(&fed(mechanisms));
        simulation.tick(&[duty]);
        (simulation.pressure_pa(0) - ATMOSPHERE) * 0.75e-3 / (R * T) / TICK_S / feed_flow()
    };
    let residual = mechanism(
        "residual_flow",
        "valve",
        "area_mm2 = [0.0, 0.3, -0.9]\naxes = [{ variable = \"duty\", of = \"valve\", knots = [0.2, 0.6, 0.8] }]",
    );
    // Below the first knot, on it, between, at the last (where the sum would be negative) and beyond.
    for (duty, extra) in [(0.1f64, 0.0f64), (0.4, 0.15), (0.6, 0.3), (0.7, -0.3), (0.8, -0.8), (1.0, -0.9)] {
        let exact = (duty + extra).max(0.0);
        assert!((flow(&residual, duty) - exact).abs() < 1e-9, "{duty}: {} against {exact}", flow(&residual, duty));
    }
}

#[test]
fn a_table_with_a_memory_sees_the_lagged_variable() {
    // f(z) = 100 mg/s · z with τ ż = u − z, and the same over u − z: together 100 u.
    let tau = 0.05;
    let table = |departure: bool| {
        let axis = format!(
            "axes = [{{ variable = \"duty\", of = \"valve\", time_constant_ms = 50.0, departure = {departure}, knots = [-1.0, 1.0] }}]"
        );
        mechanism("residual_flow", "tank", &format!("flow_mg_per_s = [-100.0, 100.0]\n{axis}"))
    };
    // The valve itself is shut off from the tank: it only carries the duty.
    let rig = |mechanism: &str| {
        rig(&(chamber("tank", 0.75)
            + &chamber("other", 1.0)
            + &plain_valve("valve", "other", "atmosphere")
            + mechanism))
    };
    let (mut lagged, mut away) = (simulation(&rig(&table(false))), simulation(&rig(&table(true))));
    let full = 100e-6 * R * T / 0.75e-3;
    for tick in 1..=20 {
        lagged.tick(&[0.8]);
        away.tick(&[0.8]);
        let time = f64::from(tick) * TICK_S;
        let by_lag = 0.8 * (time - tau * (1.0 - (-time / tau).exp()));
        let exact = [by_lag, 0.8 * time - by_lag].map(|integral| full * integral);
        for (simulation, exact) in [&lagged, &away].into_iter().zip(exact) {
            // The memory moves once a step of 0.1 ms: half a step of 0.8·full.
            let gained = simulation.pressure_pa(0) - ATMOSPHERE;
            assert!((gained - exact).abs() < 0.8 * full * 0.6e-4, "tick {tick}: {gained} against {exact}");
        }
    }
}

#[test]
fn two_variables_and_an_orifice_of_a_thermal_chamber_go_together() {
    // Nothing to compare with but itself: what a table of constants feeds is a flow source of that size.
    let constant = "flow_mg_per_s = [50.0, 50.0, 50.0, 50.0]\naxes = [\
        { variable = \"pressure\", of = \"tank\", knots = [0.0, 100.0] },\
        { variable = \"pressure\", of = \"other\", knots = [-50.0, 100.0] }]";
    let parts = chamber("tank", 0.75)
        + &chamber("other", 0.4)
        + &orifice("tank", "other", 0.5)
        + &mechanism("chamber_thermal", "tank", "wall_conductance_w_per_k = 0.5");
    let density = ATMOSPHERE / (R * T);
    let source =
        format!("[sources.feed]\nkind = \"flow\"\nto = \"tank\"\nflow_l_per_min = {:?}\n", 50e-6 / density * 60e3);
    let mut tabled = simulation(&rig(&(parts.clone() + &mechanism("residual_flow", "tank", constant))));
    let mut stated = simulation(&rig(&(parts + &source)));
    for _ in 0..100 {
        tabled.tick(&[]);
        stated.tick(&[]);
    }
    for chamber in 0..2 {
        assert!((tabled.pressure_pa(chamber) - stated.pressure_pa(chamber)).abs() < 1e-6);
    }
    assert!(stated.pressure_kpa(0) > 1.0);
}
