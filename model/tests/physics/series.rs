//! Parts in series with a valve, a capillary or a pump; and other outflow functions.

use model::plant::Simulation;
use model::rig::Rig;

use crate::small_rigs::{
    ATMOSPHERE, KAPPA, R, T, TICK_S, chamber, choked, mechanism, orifice, plain_valve, printed_flow, rig, simulation,
    source,
};

const MM2: f64 = 1e-6;

/// Flow into a tank of 100 L over one tick, in kg/s: its pressure hardly moves.
fn flow_into(simulation: &mut Simulation<f64>, tank_pa: f64, inputs: &[f64]) -> f64 {
    simulation.set_pressure_pa(0, tank_pa);
    simulation.tick(inputs);
    (simulation.pressure_pa(0) - tank_pa) * 0.1 / (R * T) / TICK_S
}

/// A valve from a supply into a tank, with the given nozzle force, and what hangs on it.
fn valve(from: &str, to: &str, pressure_area: f64, mechanisms: &str) -> Rig {
    let force = format!("pressure_area_mm2_per_n = {pressure_area:?}");
    let valve = plain_valve("valve", from, to).replace("pressure_area_mm2_per_n = 0.0", &force);
    rig(&(chamber("tank", 100.0) + &source("supply", 300_000.0, T) + &valve + mechanisms))
}

/// ṁ through valve (area `a + b ΔP`) and a rough tube of area `line` on the side given, by bisection.
fn by_bisection(up: f64, down: f64, area: impl Fn(f64) -> f64, line: f64, upstream: bool) -> f64 {
    let rt = R * T;
    let excess = |flow: f64| {
        let lost = rt * (flow / line).powi(2);
        let (p1, p2) = if upstream { ((up * up - lost).sqrt(), down) } else { (up, (down * down + lost).sqrt()) };
        let difference = p1 - p2;
        flow - if difference > 0.0 { area(difference) * printed_flow(KAPPA, p1, p2, rt) } else { 0.0 }
    };
    let (mut low, mut high) = (0.0, line * ((up * up - down * down) / rt).sqrt());
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if excess(middle) > 0.0 { high = middle } else { low = middle }
    }
    0.5 * (low + high)
}

#[test]
fn a_line_in_series_passes_what_bisection_says() {
    let nozzle = std::f64::consts::PI * 1e-6 / 4.0;
    let mut worst = 0.0f64;
    for line in [0.02, 0.1, 0.5, 2.0, 20.0, 1e4] {
        for (from, to, id, upstream) in [
            ("supply", "tank", "line_resistance", false),
            ("tank", "supply", "line_resistance", true),
            ("tank", "atmosphere", "exhaust_restriction", false),
            ("atmosphere", "tank", "exhaust_restriction", true),
        ] {
            for pressure_area in [0.0, 8.0] {
                let parameter = format!("area_mm2 = {line:?}");
                let rig = valve(from, to, pressure_area, &mechanism(id, "valve", &parameter));
                let mut simulation = simulation(&rig);
                for duty in [0.02, 0.3, 1.0] {
                    for tank in [2e3, 50e3, 101e3, 110e3, 280e3, 299.9e3, 800e3] {
                        let sign = if to == "tank" { 1.0 } else { -1.0 };
                        let found = flow_into(&mut simulation, tank, &[duty]) * sign;
                        // While it is measured the tank moves: by a few pascals, of a difference of 100 at least.
                        let halfway = 0.5 * (tank + simulation.pressure_pa(0));
                        let place = |name: &str| match name {
                            "tank" => halfway,
                            "supply" => 300_000.0,
                            _ => ATMOSPHERE,
                        };
                        let (up, down) = (place(from), place(to));
                        // Backwards the difference pushes the flapper shut, and where all of it does, nothing flows that the
                        // line could take a part of it.
                        let area = |dp: f64| MM2 * (duty + pressure_area * nozzle * dp).max(0.0);
                        let exact = if up > down {
                            by_bisection(up, down, area, line * MM2, upstream)
                        } else if area(up - down) == 0.0 {
                            0.0
                        } else {
                            -by_bisection(down, up, |dp| area(-dp), line * MM2, !upstream)
                        };
                        let off = (found - exact).abs() / exact.abs().max(1e-7);
                        worst = worst.max(off);
                        // What the mean over a tick and the flow halfway differ by goes with the square of the tank's
                        // way over the difference, (17/325)²/24 at most.
                        assert!(
                            off < 1.5e-4,
                            "{id} {line} mm², duty {duty}, force {pressure_area}, {up} to {down}: {found} {exact}"
                        );
                    }
                }
            }
        }
    }
    println!("in series: at most {worst:.1e} of the flow off");
}

#[test]
fn a_wide_line_is_none_and_a_narrow_one_is_all_there_is() {
    let bare = |to: &str| simulation(&valve("supply", to, 3.0, ""));
    let with = |id: &str, area: f64| {
        simulation(&valve("supply", "tank", 3.0, &mechanism(id, "valve", &format!("area_mm2 = {area:?}"))))
    };
    let (none, wide) =
        (flow_into(&mut bare("tank"), 2e5, &[0.7]), flow_into(&mut with("line_resistance", 1e4), 2e5, &[0.7]));
    // (1 mm²/1e4 mm²)² of the drop.
    assert!((wide / none - 1.0).abs() < 1e-7, "{wide} against {none}");
    let narrow = flow_into(&mut with("line_resistance", 0.01), 2e5, &[0.7]);
    let tube = 0.01 * MM2 * ((9e10 - 4e10) / (R * T)).sqrt();
    assert!((narrow / tube - 1.0).abs() < 1e-3, "{narrow} against {tube}");
}

#[test]
fn a_parabolic_resistor_adds_both_parts() {
    // P₁² − P₂² = 2 R T ζ ṁ + R T (ṁ/A)²
    let (zeta, area) = (500.0, 1.5 * MM2);
    let line = format!(
        "[lines.line]\nkind = \"laminar\"\nfrom = \"supply\"\nto = \"tank\"\nresistance_kpa_s_per_l = {zeta:?}\n"
    );
    let parts = chamber("tank", 100.0) + &source("supply", 300_000.0, T) + &line;
    let mut both = simulation(&rig(&(parts.clone() + &mechanism("line_resistance", "line", "area_mm2 = 1.5"))));
    let mut laminar = simulation(&rig(&parts));
    let mut wide = simulation(&rig(&(parts.clone() + &mechanism("line_resistance", "line", "area_mm2 = 10000.0"))));
    for tank in [50e3, 200e3, 299e3, 400e3] {
        let flow = flow_into(&mut both, tank, &[]);
        let lost = 2.0 * R * T * zeta * 1e6 * flow + R * T * flow * flow.abs() / area.powi(2);
        assert!((lost / (9e10 - tank * tank) - 1.0).abs() < 2e-3, "tank {tank}: {lost}");
        let (laminar, wide) = (flow_into(&mut laminar, tank, &[]), flow_into(&mut wide, tank, &[]));
        assert!((wide / laminar - 1.0).abs() < 1e-5 && flow.abs() < laminar.abs(), "{flow} {laminar} {wide}");
    }
}

#[test]
fn a_line_at_a_pumps_port_is_a_smaller_check_valve() {
    let area = |outlet: f64, mechanisms: &str| {
        let text = model::rig::DUAL_PRESSURE
            .replace("outlet_check_area_mm2 = 1.46", &format!("outlet_check_area_mm2 = {outlet:?}"));
        let mut simulation = simulation(&Rig::from_toml(&format!("{text}\n{mechanisms}")).unwrap());
        for _ in 0..100 {
            simulation.tick(&[0.7, 0.7, 1.0]);
        }
        [simulation.pressure_pa(0), simulation.pressure_pa(1)]
    };
    let line = mechanism("line_resistance", "pump", "port = \"outlet\"\narea_mm2 = 2.0");
    let smaller = area(1.46 / (1.0f64 + 0.73 * 0.73).sqrt(), "");
    // The same area up to its last bit.
    for (one, other) in area(1.46, &line).into_iter().zip(smaller) {
        assert!((one - other).abs() < 1e-3, "{one} {other}");
    }
    assert!(area(1.46, "")[0] > smaller[0] + 1000.0);
}

#[test]
fn iso_6358_with_its_own_critical_ratio() {
    let supply = 300_000.0;
    for b in [0.1, 0.3, 0.5] {
        let mut simulation =
            simulation(&valve("supply", "tank", 0.0, &mechanism("critical_ratio", "valve", &format!("ratio = {b}"))));
        for ratio in [0.05, 0.2, 0.6, 0.9, 0.99] {
            let flow = flow_into(&mut simulation, ratio * supply, &[1.0]);
            let full = MM2 * supply / (R * T).sqrt() * choked(KAPPA);
            let exact = if ratio <= b { full } else { full * (1.0 - ((ratio - b) / (1.0 - b)).powi(2)).sqrt() };
            // The tank moves by 2 Pa of at least 3 kPa while it is measured.
            assert!((flow / exact - 1.0).abs() < 1e-3, "b {b}, p {ratio}: {flow} against {exact}");
        }
    }
    // The nozzle lies within 1 % of b = 0.528.
    let nozzle = simulation(&valve("supply", "tank", 0.0, ""));
    let ellipse = simulation(&valve("supply", "tank", 0.0, &mechanism("critical_ratio", "valve", "ratio = 0.528")));
    for ratio in [0.3, 0.6, 0.8, 0.95] {
        let [a, b] = [&nozzle, &ellipse].map(|s| flow_into(&mut s.clone(), ratio * supply, &[1.0]));
        assert!((a / b - 1.0).abs() < 0.01, "{a} {b}");
    }
    // On an orifice line as well.
    let parts = chamber("tank", 100.0) + &source("supply", supply, T) + &orifice("supply", "tank", 1.0);
    let mut line = self::simulation(&rig(&(parts + &mechanism("critical_ratio", "supply_tank", "ratio = 0.3"))));
    let flow = flow_into(&mut line, 0.8 * supply, &[]);
    let exact = MM2 * supply / (R * T).sqrt() * choked(KAPPA) * (1.0 - (0.5f64 / 0.7).powi(2)).sqrt();
    assert!((flow / exact - 1.0).abs() < 1e-3, "{flow} against {exact}");
}

#[test]
fn a_jet_curves_the_opening_over_pressure() {
    // a = u + Ĉ_P F + c F², F = A_n ΔP with A_n of 1 mm.
    let curve = mechanism("valve_force_curve", "valve", "pressure_curvature_mm2_per_n2 = 20.0");
    let mut simulation = simulation(&valve("supply", "tank", 8.0, &curve));
    for tank in [50e3, 150e3, 250e3] {
        let force = std::f64::consts::PI * 1e-6 / 4.0 * (300e3 - tank);
        let area = MM2 * (0.2 + 8.0 * force + 20.0 * force * force);
        let exact = area * printed_flow(KAPPA, 300e3, tank, R * T);
        let flow = flow_into(&mut simulation, tank, &[0.2]);
        assert!((flow / exact - 1.0).abs() < 1e-3, "{tank}: {flow} against {exact}");
    }
}
