//! Sizes of a rig that ranges and first magnitudes of mechanisms are stated in.
//!
//! A leak of 1e-15 kg/(s Pa²) empties a litre at 1 bar in minutes and a syringe in seconds; a zero error of 1 kPa is
//! nothing on a gauge of 10 bar and all that a draught meter shows. Numbers that have a unit are therefore stated once,
//! for the paper's rig, and scaled by what they mean without a unit:
//!
//! ```text
//! leak             k R T P_top / V        P_top: highest absolute pressure that the chamber's sensors read
//! heat at a wall   G R T / (V P_top c_v)
//! zero, drift      b / span of the sensor
//! square resistance of a line beside its laminar one       A_eq / A
//! ```
//!
//! Scales are whole powers of ten, cut towards the paper's rig: first magnitudes need be no closer, and a rig of about the
//! paper's size has the paper's ranges to the bit.

use crate::rig::{Line, Pump, Rig};

/// Conductance in kg/(s Pa²) by which the paper's positive chamber (0.75 L, read up to 1000 kPa) would empty in 1 s.
const LEAK_KG_PER_S_PA2: f64 = 8.1e-15;
/// Volume times highest pressure in J: the geometric mean of the paper's two chambers (826 and 40 J).
const GAS_J: f64 = 182.0;
/// Span in kPa: the geometric mean of the paper's two sensors (1000 and 101 kPa).
const SPAN_KPA: f64 = 318.0;
/// Displacement in L/min of the paper's pump: two cylinders of 154 mL at 3000 rev/min.
const PUMP_L_PER_MIN: f64 = 924.0;
/// Area in mm² that loses 1 kPa at the flow at which a line of 2 kPa s/L does: 24.5 mm² at 1 L/s (Bernoulli, 1.2 kg/m³).
const LINE_MM2: f64 = 12.2;
const LINE_MM2_KPA_S_PER_L: f64 = 24.5;

/// `ratio` as a power of ten, cut towards 1.
fn decades(ratio: f64) -> f64 {
    if ratio.is_finite() && ratio > 0.0 { 10f64.powf(ratio.log10().trunc()) } else { 1.0 }
}

/// Highest absolute pressure in Pa that the sensors of a volume read; the atmosphere's where none does.
fn top_pa(rig: &Rig, volume: &str) -> f64 {
    let sensors = rig.sensors.values().filter(|sensor| sensor.volume == volume);
    let gauge_kpa = sensors.flat_map(|sensor| sensor.range_kpa_gauge).fold(0.0, f64::max);
    1e3 * (rig.atmosphere.pressure_kpa_abs + gauge_kpa)
}

/// Scale of what leaks out of a volume; 1 for a volume that is not in the rig.
pub(super) fn of_leak(rig: &Rig, volume: &str) -> f64 {
    rig.volumes.get(volume).map_or(1.0, |v| {
        let gas = rig.gas.gas_constant_j_per_kg_k * v.temperature_k;
        decades(1e-3 * v.volume_l / (gas * top_pa(rig, volume)) / LEAK_KG_PER_S_PA2)
    })
}

/// Scale of what leaks past the pistons of a pump.
pub(super) fn of_blowby(rig: &Rig, pump: &str) -> f64 {
    match rig.pumps.get(pump) {
        Some(Pump::Piston(p)) => {
            // cm² × mm is 0.1 mL.
            let stroke_l = 1e-4 * p.head_area_cm2 * 2.0 * p.crank_radius_mm;
            decades(stroke_l * p.speed_rpm * p.phases_deg.len() as f64 / PUMP_L_PER_MIN)
        }
        _ => 1.0,
    }
}

/// Scale of the heat that a chamber's wall takes up.
pub(super) fn of_wall(rig: &Rig, volume: &str) -> f64 {
    rig.volumes.get(volume).map_or(1.0, |v| decades(1e-3 * v.volume_l * top_pa(rig, volume) / GAS_J))
}

/// Scale of a sensor's zero.
pub(super) fn of_sensor(rig: &Rig, sensor: &str) -> f64 {
    rig.sensors.get(sensor).map_or(1.0, |s| {
        let [one, other] = s.range_kpa_gauge;
        decades((one - other).abs() / SPAN_KPA)
    })
}

/// Scale of the area of a restriction in series with a laminar line.
pub(super) fn of_line(rig: &Rig, line: &str) -> f64 {
    match rig.lines.get(line) {
        Some(Line::Laminar { resistance_kpa_s_per_l, .. }) => {
            decades(LINE_MM2_KPA_S_PER_L / resistance_kpa_s_per_l / LINE_MM2)
        }
        _ => 1.0,
    }
}

/// Highest gauge pressure in kPa that a sensor at the outlet of a pump reads; `None` where none is.
pub(super) fn load_kpa(rig: &Rig, outlet: &str) -> Option<f64> {
    let top_kpa = 1e-3 * top_pa(rig, outlet) - rig.atmosphere.pressure_kpa_abs;
    (top_kpa > 0.0).then_some(top_kpa)
}

/// Tells whether nothing that the rig file states lets gas into a volume or out of it: a pressure-decay (leak) test.
pub(super) fn is_closed(rig: &Rig, volume: &str) -> bool {
    let at_valve = rig.valves.values().any(|v| v.from == volume || v.to == volume);
    let at_pump = rig.pumps.values().any(|pump| match pump {
        Pump::Piston(p) => p.inlet == volume || p.outlet == volume,
        Pump::Flow(p) => p.inlet == volume || p.outlet == volume,
    });
    let at_line = rig.lines.values().any(|line| match line {
        Line::Orifice { from, to, .. } | Line::Laminar { from, to, .. } => from == volume || to == volume,
    });
    !(at_valve || at_pump || at_line)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mechanism::{Candidate, candidates};

    fn of<'c>(all: &'c [Candidate], id: &str, component: &str) -> &'c Candidate {
        all.iter().find(|c| c.id == id && c.component == component).unwrap()
    }

    /// A rig of the paper's kind, `times` as large in volume.
    fn scaled(times: f64) -> Rig {
        let mut rig = Rig::builtin("dual_pressure").unwrap();
        rig.volumes.values_mut().for_each(|volume| volume.volume_l *= times);
        rig
    }

    #[test]
    fn the_papers_rig_has_the_stated_ranges_and_another_one_the_same_without_units() {
        let paper = candidates(&Rig::builtin("dual_pressure").unwrap());
        for volume in ["positive", "negative"] {
            let leak = &of(&paper, "chamber_leak", volume).parameters[0];
            assert_eq!(leak.starts, [1e-16, 5e-16, 2e-15, 1e-14]);
        }
        let small = candidates(&scaled(1e-3));
        for id in ["chamber_leak", "chamber_thermal"] {
            let [large, small] = [&paper, &small].map(|all| of(all, id, "positive").parameters[0].clone());
            let ratio = small.high / large.high;
            // A thousandth of the gas: its time constants are the same within the decade that scales are cut to.
            assert!((0.9e-3..1.1e-2).contains(&ratio), "{id} {ratio}");
            assert!(small.starts.iter().zip(&large.starts).all(|(s, l)| (s / l / ratio - 1.0).abs() < 1e-9));
        }
    }

    #[test]
    fn a_sealed_chamber_is_closed_and_leaks_slowly_at_first() {
        let mut rig = scaled(1.0);
        assert!(!is_closed(&rig, "positive"));
        rig.valves.clear();
        rig.pumps.clear();
        assert!(is_closed(&rig, "positive"));
        let all = candidates(&rig);
        let leak = &of(&all, "chamber_leak", "positive").parameters[0];
        assert!(leak.starts[0] < 1e-17 && leak.low < leak.starts[0], "{leak:?}");
    }
}
