//! What a piston pump moves between two chambers, as a function of one number.
//!
//! Isothermal gas, orifices whose flow is a pressure times a function of a pressure ratio, and pistons that only
//! scale volumes: multiply both chamber pressures by a factor and every pressure and flow in the pump is multiplied by
//! it. So the mass flow of a pump that has become periodic is
//!
//! ```text
//! ṁ(P_in, P_out) = P_in · f(P_out/P_in)
//! ```
//!
//! and `f` is tabled over the logarithm of the ratio: eight ratios side by side, two dozen revolutions each, instead of
//! a map over a plane of pressures. Leaks from the cylinders and springs on the check valves break the rule; the map
//! knows the paper's pump alone.

use std::sync::Arc;

use model::plant::{Plant, Simulation};
use model::real::{Lanes, Real};
use model::rig::{PistonPump, Pump, Rig, RigError};

/// Volume of the chambers while the pump is mapped, in litres: so large that a revolution hardly moves them.
const HELD_L: f64 = 100.0;
/// Revolutions before flow is measured over one. The outlet valve is tight: each forgets only a third of the
/// cylinders' start, so thirty leave 5e-6 of it.
const SETTLING: usize = 30;
/// Pressure at the outlet while the pump is mapped, in Pa: about that of cylinders at rest.
const OUTLET_PA: f64 = 1e5;
/// Tabled values of ln(P_out/P_in): from a little below 1 to 40, beyond any stalled pump.
const POINTS: usize = 24;
const LEAST_LN: f64 = -0.25;
const MOST_LN: f64 = 3.7;
const LANES: usize = 8;

/// The flow of one pump.
#[derive(Debug, Clone, PartialEq)]
pub struct PumpMap {
    /// `f` in kg/(s Pa) at equal steps of the logarithm of the ratio.
    flow: Vec<f64>,
}

impl PumpMap {
    /// Maps the pump of this name; about 5 ms.
    ///
    /// # Errors
    /// There is no such piston pump, or its numbers are unsound.
    pub fn new(rig: &Rig, name: &str) -> Result<Self, RigError> {
        let Some(Pump::Piston(pump)) = rig.pumps.get(name) else {
            return Err(RigError::at(format!("pumps.{name}"), "no piston pump of this name"));
        };
        let bench = bench(rig, name, pump)?;
        let plant = Arc::new(Plant::<Lanes<LANES>>::side_by_side(std::slice::from_ref(&bench))?);
        let tick_s = plant.tick_s();
        let chambers = (position(&bench, &pump.inlet), position(&bench, &pump.outlet));
        let temperature = bench.volumes.get(&pump.inlet).map_or(f64::NAN, |v| v.temperature_k);
        let mass_per_pa = HELD_L * 1e-3 / (bench.gas.gas_constant_j_per_kg_k * temperature);
        let mut flow = Vec::with_capacity(POINTS);
        for first in (0..POINTS).step_by(LANES) {
            // Only the ratio matters.
            let inlet = Lanes::from_lanes(|lane| OUTLET_PA / ratio(first + lane));
            let outlet = Lanes::splat(OUTLET_PA);
            let mut simulation = Simulation::new(Arc::clone(&plant));
            simulation.set_pressure_pa(chambers.0, inlet);
            simulation.set_pressure_pa(chambers.1, outlet);
            let inputs = vec![Lanes::splat(1.0); plant.inputs().len()];
            for _ in 0..SETTLING {
                simulation.tick(&inputs);
                simulation.set_pressure_pa(chambers.0, inlet);
                simulation.set_pressure_pa(chambers.1, outlet);
            }
            simulation.tick(&inputs);
            let drawn = inlet - simulation.pressure_pa(chambers.0);
            for lane in 0..LANES {
                flow.push(drawn.lane(lane) * mass_per_pa / (tick_s * inlet.lane(lane)));
            }
        }
        Ok(PumpMap { flow })
    }

    /// Mass flow in kg/s between absolute pressures in Pa.
    pub fn flow_kg_per_s(&self, inlet_pa: f64, outlet_pa: f64) -> f64 {
        let at = ((outlet_pa / inlet_pa).ln() - LEAST_LN) / (MOST_LN - LEAST_LN) * (POINTS - 1) as f64;
        let at = at.clamp(0.0, (POINTS - 1) as f64);
        let cell = (at as usize).min(POINTS - 2);
        let x = at - cell as f64;
        let value = |i: usize| self.flow.get(i.min(POINTS - 1)).copied().unwrap_or(f64::NAN);
        let (b, c) = (value(cell), value(cell + 1));
        // Catmull-Rom: slopes from the neighbours, one-sided at the ends.
        let a = if cell == 0 { 2.0 * b - c } else { value(cell - 1) };
        let d = if cell + 2 >= POINTS { 2.0 * c - b } else { value(cell + 2) };
        let cubic = b + 0.5 * x * (c - a + x * (2.0 * a - 5.0 * b + 4.0 * c - d + x * (3.0 * (b - c) + d - a)));
        inlet_pa * cubic
    }
}

fn ratio(point: usize) -> f64 {
    (LEAST_LN + (MOST_LN - LEAST_LN) * point.min(POINTS - 1) as f64 / (POINTS - 1) as f64).exp()
}

fn position(rig: &Rig, volume: &str) -> usize {
    rig.volumes.get_index_of(volume).unwrap_or(0)
}

/// The rig with nothing but the pump between two huge chambers, a tick being one revolution.
fn bench(rig: &Rig, name: &str, pump: &PistonPump) -> Result<Rig, RigError> {
    let mut bench = rig.without_mechanisms();
    bench.pumps.retain(|other, _| other == name);
    bench.valves.clear();
    bench.lines.clear();
    bench.sources.clear();
    for end in [&pump.inlet, &pump.outlet] {
        let Some(volume) = bench.volumes.get_mut(end) else {
            return Err(RigError::at(format!("pumps.{name}"), "the pump does not join two volumes; its flow is no map"));
        };
        volume.volume_l = HELD_L;
        volume.compliance_ml_per_kpa = 0.0;
    }
    bench.integrator.tick_ms = 6e4 / pump.speed_rpm;
    bench.integrator.step_ms = bench.integrator.tick_ms / 200.0;
    bench.integrator.refine_switching = true;
    Ok(bench)
}

#[cfg(test)]
mod tests {
    use super::*;
    use model::steady::SteadyMap;

    /// The map over a plane of pressures that the model makes for itself, at points between its grid's.
    #[test]
    fn flow_is_that_of_the_plane_map() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        let map = PumpMap::new(&rig, "pump").unwrap();
        let plane = SteadyMap::new(&rig).unwrap();
        for (positive, negative) in [(80.0, -70.0), (100.0, -75.0), (60.0, -62.5), (120.0, -80.0), (5.0, -5.0)] {
            let one = map.flow_kg_per_s((101.325 + negative) * 1e3, (101.325 + positive) * 1e3);
            let [gained, lost] = plane.flows([positive, negative]);
            // Both are interpolated, and the plane's chambers are held by 100 L; what one chamber gains the other loses
            // but for what the cylinders keep in a revolution.
            assert!((one / gained - 1.0).abs() < 2e-3 && (one / -lost - 1.0).abs() < 2e-3, "{one} {gained} {lost}");
        }
    }
}
