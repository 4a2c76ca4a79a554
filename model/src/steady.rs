//! The rig averaged over a revolution: what the pump moves at given pressures, and which duties hold them.
//!
//! With both chambers held at fixed pressures and the valves shut, the cylinders soon repeat themselves and
//! each chamber gains a constant mass per time, `ṁ(P_pos, P_neg)`. That map (from the same compiled plant, with
//! chambers so large that a revolution hardly moves them) turns the dynamics into algebra:
//!
//! ```text
//! V/(R T) · Ṗ = ṁ(P) ∓ ṁ_valve(P, u)
//! ```
//!
//! which is solved for `u` (feed-forward: [`SteadyMap::duty_for`]) or, with `Ṗ = 0`, for `P`
//! ([`SteadyMap::settled_kpa`]).

use std::sync::Arc;

use nalgebra::{Matrix2, Vector2};

use crate::contract::{CHANNELS, Pair};
use crate::orifice::FlowFunction;
use crate::plant::{Plant, Simulation};
use crate::predict::DualPressurePorts;
use crate::real::{Lanes, Real};
use crate::rig::{ATMOSPHERE, Rig, RigError, Valve, Volume};

/// Volume of the chambers while the pump is mapped, in litres: a revolution then moves them by about 2 Pa.
const HELD_L: f64 = 100.0;
/// Revolutions before the map is read. The outlet valve is tight: a revolution forgets only about a third of
/// the cylinders' start, and each group of cells starts from the cylinders of its neighbours.
const SETTLING_TICKS: usize = 24;
/// Steps of the integrator per revolution while mapping, as on the paper's rig.
const STEPS: f64 = 200.0;
const POSITIVE_KPA: Axis = Axis { low: -5.0, step: 5.0, points: 36 };
const NEGATIVE_KPA: Axis = Axis { low: -97.5, step: 2.5, points: 41 };

/// Net mass flow into both chambers by pressures, and the valves' inverse.
#[derive(Debug, Clone)]
pub struct SteadyMap {
    /// Net mass flow into each chamber in kg/s with valves shut; `[negative][positive]` flattened.
    flows: Vec<Pair>,
    valves: [ValveInverse; CHANNELS],
    /// V/(R T) of each chamber in kg/Pa.
    capacity: Pair,
    atmosphere_pa: f64,
}

/// A uniform grid in kPa gauge.
#[derive(Debug, Clone, Copy)]
struct Axis {
    low: f64,
    step: f64,
    points: usize,
}

impl Axis {
    fn value(&self, index: usize) -> f64 {
        self.low + self.step * index as f64
    }

    /// Cell and position within it, limited to the grid.
    fn locate(&self, value: f64) -> (usize, f64) {
        let position = ((value - self.low) / self.step).clamp(0.0, (self.points - 1) as f64);
        let cell = (position as usize).min(self.points - 2);
        (cell, position - cell as f64)
    }
}

/// A nozzle-flapper valve, solved for its duty.
#[derive(Debug, Clone, Copy)]
struct ValveInverse {
    law: FlowFunction<f64>,
    input_area: f64,
    pressure_area: f64,
    spring_area: f64,
    /// 1/√(R T) of the gas upstream, in s/m.
    inverse_speed: f64,
    /// +1 if it fills its chamber, −1 if it empties it.
    fills: f64,
}

impl ValveInverse {
    fn ports(&self, chamber_pa: f64, atmosphere_pa: f64) -> (f64, f64) {
        if self.fills > 0.0 { (atmosphere_pa, chamber_pa) } else { (chamber_pa, atmosphere_pa) }
    }

    /// Mass flow in kg/s per m² of area.
    fn flux(&self, up: f64, down: f64) -> f64 {
        self.inverse_speed * up * self.law.at_drop((up - down) / up)
    }

    /// Net mass flow into the chamber in kg/s.
    fn inflow(&self, duty: f64, chamber_pa: f64, atmosphere_pa: f64) -> f64 {
        let (up, down) = self.ports(chamber_pa, atmosphere_pa);
        let area = (self.input_area * duty + self.pressure_area * (up - down) - self.spring_area).max(0.0);
        self.fills * area * self.flux(up, down)
    }

    /// The duty that lets `inflow` kg/s into the chamber, beyond 0 … 1 where no duty does.
    fn duty(&self, inflow: f64, chamber_pa: f64, atmosphere_pa: f64) -> f64 {
        let (up, down) = self.ports(chamber_pa, atmosphere_pa);
        // Near the atmosphere no area is enough; a floor keeps the answer finite, and it is limited anyway.
        let area = self.fills * inflow / self.flux(up, down).max(1e-3);
        (area + self.spring_area - self.pressure_area * (up - down)) / self.input_area
    }
}

impl SteadyMap {
    /// Maps a rig; a few tenths of a second.
    ///
    /// # Errors
    /// If the rig is unsound, or is not two chambers each with one valve to the atmosphere.
    pub fn new(rig: &Rig) -> Result<Self, RigError> {
        let plant = Plant::new(rig)?;
        DualPressurePorts::of(&plant)?;
        let mut valves = Vec::new();
        let mut capacity = [0.0; CHANNELS];
        let mut chambers = [0; CHANNELS];
        for (c, column) in DualPressurePorts::DUTY.into_iter().enumerate() {
            let (name, valve) =
                rig.valves.iter().find(|(_, v)| v.command == column).ok_or_else(|| RigError::at("valves", column))?;
            let (chamber, volume, inverse) = ValveInverse::of(rig, name, valve)?;
            capacity[c] = volume.volume_l * 1e-3 / (rig.gas.gas_constant_j_per_kg_k * volume.temperature_k);
            chambers[c] = chamber;
            valves.push(inverse);
        }
        let [Some(positive), Some(negative)] = [valves.first().copied(), valves.get(1).copied()] else {
            return Err(RigError::at("valves", "two valves are needed"));
        };
        Ok(SteadyMap {
            flows: pump_flows(rig, chambers)?,
            valves: [positive, negative],
            capacity,
            atmosphere_pa: rig.atmosphere.pressure_kpa_abs * 1e3,
        })
    }

    /// Net mass flow into both chambers with the valves shut, in kg/s, by bilinear interpolation.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn flows(&self, pressures_kpa: Pair) -> Pair {
        let (i, x) = POSITIVE_KPA.locate(pressures_kpa[0]);
        let (j, y) = NEGATIVE_KPA.locate(pressures_kpa[1]);
        let at =
            |i: usize, j: usize| self.flows.get(j * POSITIVE_KPA.points + i).copied().unwrap_or([f64::NAN; CHANNELS]);
        let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1));
        std::array::from_fn(|n| (1.0 - y) * ((1.0 - x) * a[n] + x * b[n]) + y * ((1.0 - x) * c[n] + x * d[n]))
    }

    /// Rate of both pressures in kPa/s at pressures (kPa gauge) and duties.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn rate_kpa_per_s(&self, pressures_kpa: Pair, duty: Pair) -> Pair {
        let flows = self.flows(pressures_kpa);
        std::array::from_fn(|c| {
            let chamber = self.atmosphere_pa + pressures_kpa[c] * 1e3;
            (flows[c] + self.valves[c].inflow(duty[c], chamber, self.atmosphere_pa)) / self.capacity[c] * 1e-3
        })
    }

    /// The duties at which pressures (kPa gauge) change at the given rates (kPa/s), not limited to 0 … 1.
    ///
    /// Both channels are solved together, so the coupling through the pump is in it.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn duty_for(&self, pressures_kpa: Pair, rates_kpa_per_s: Pair) -> Pair {
        let flows = self.flows(pressures_kpa);
        std::array::from_fn(|c| {
            let chamber = self.atmosphere_pa + pressures_kpa[c] * 1e3;
            let wanted = self.capacity[c] * rates_kpa_per_s[c] * 1e3 - flows[c];
            self.valves[c].duty(wanted, chamber, self.atmosphere_pa)
        })
    }

    /// By how much each pressure's rate changes with its own valve's duty, in kPa/s per duty; negative for the
    /// positive channel (opening vents it), positive for the negative one.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn gain_kpa_per_s(&self, pressures_kpa: Pair) -> Pair {
        std::array::from_fn(|c| {
            let valve = &self.valves[c];
            let (up, down) = valve.ports(self.atmosphere_pa + pressures_kpa[c] * 1e3, self.atmosphere_pa);
            valve.fills * valve.input_area * valve.flux(up, down).max(1e-3) / self.capacity[c] * 1e-3
        })
    }

    /// The pressures (kPa gauge) at which the rig settles under constant duties, by Newton's method;
    /// `None` if there are none within the map.
    pub fn settled_kpa(&self, duty: Pair) -> Option<Pair> {
        let mut p = Vector2::new(80.0, -70.0);
        for _ in 0..60 {
            let rate = |p: Vector2<f64>| Vector2::from(self.rate_kpa_per_s(p.into(), duty));
            let here = rate(p);
            let by = 0.01;
            let column = |d: Vector2<f64>| (rate(p + d) - rate(p - d)) / (2.0 * by);
            let jacobian = Matrix2::from_columns(&[column(Vector2::new(by, 0.0)), column(Vector2::new(0.0, by))]);
            let step = jacobian.lu().solve(&here)?;
            // Short steps: far from the solution the map is far from linear.
            let limited = step * (20.0 / step.norm().max(20.0));
            p -= limited;
            p.x = p.x.clamp(POSITIVE_KPA.low, POSITIVE_KPA.value(POSITIVE_KPA.points - 1));
            p.y = p.y.clamp(NEGATIVE_KPA.low, NEGATIVE_KPA.value(NEGATIVE_KPA.points - 1));
            if limited.norm() < 1e-9 {
                return (here.norm() < 1e-3).then(|| p.into());
            }
        }
        None
    }
}

impl ValveInverse {
    fn of<'r>(rig: &'r Rig, name: &str, valve: &Valve) -> Result<(usize, &'r Volume, Self), RigError> {
        let (place, fills, upstream_k) = match (valve.from.as_str(), valve.to.as_str()) {
            (ATMOSPHERE, to) => (to, 1.0, Some(rig.atmosphere.temperature_k)),
            (from, ATMOSPHERE) => (from, -1.0, None),
            _ => {
                return Err(RigError::at(
                    format!("valves.{name}"),
                    "neither end is the atmosphere; no steady map can be made",
                ));
            }
        };
        let (chamber, _, volume) = rig
            .volumes
            .get_full(place)
            .ok_or_else(|| RigError::at(format!("valves.{name}"), format!("`{place}` is no volume")))?;
        let kelvin = upstream_k.unwrap_or(volume.temperature_k);
        let inverse = ValveInverse {
            law: FlowFunction::nozzle(rig.gas.heat_capacity_ratio),
            input_area: valve.input_area_mm2 * 1e-6,
            pressure_area: valve.pressure_area_mm2_per_n
                * 1e-6
                * std::f64::consts::PI
                * (valve.nozzle_diameter_mm * 1e-3).powi(2)
                / 4.0,
            spring_area: valve.spring_area_mm2 * 1e-6,
            inverse_speed: 1.0 / (rig.gas.gas_constant_j_per_kg_k * kelvin).sqrt(),
            fills,
        };
        Ok((chamber, volume, inverse))
    }
}

/// Net mass flow into the two chambers over the grid, valves shut, eight grid points at a time.
fn pump_flows(rig: &Rig, chambers: [usize; CHANNELS]) -> Result<Vec<Pair>, RigError> {
    type Eight = Lanes<8>;
    let held = held_rig(rig);
    let plant = Arc::new(Plant::<Eight>::side_by_side(std::slice::from_ref(&held))?);
    let on: Vec<Eight> = plant.inputs().iter().map(|i| Eight::splat(i.default.unwrap_or(1.0))).collect();
    let capacity: Vec<f64> = held
        .volumes
        .values()
        .map(|v| v.volume_l * 1e-3 / (held.gas.gas_constant_j_per_kg_k * v.temperature_k))
        .collect();
    let mut simulation = Simulation::new(Arc::clone(&plant));
    let cells: Vec<Pair> = (0..NEGATIVE_KPA.points)
        .flat_map(|j| (0..POSITIVE_KPA.points).map(move |i| [POSITIVE_KPA.value(i), NEGATIVE_KPA.value(j)]))
        .collect();
    let mut flows = Vec::with_capacity(cells.len());
    for eight in cells.chunks(Eight::LANES) {
        let put = |simulation: &mut Simulation<Eight>| {
            for (c, chamber) in chambers.into_iter().enumerate() {
                let kpa = Eight::from_lanes(|lane| eight.get(lane).or(eight.last()).map_or(0.0, |p| p[c]));
                simulation.set_pressure_pa(chamber, plant.atmosphere_pa() + kpa * Eight::splat(1e3));
            }
        };
        for _ in 0..SETTLING_TICKS {
            put(&mut simulation);
            simulation.tick(&on);
        }
        put(&mut simulation);
        let before = chambers.map(|c| simulation.pressure_pa(c));
        simulation.tick(&on);
        for lane in 0..eight.len() {
            flows.push(std::array::from_fn(|c| {
                let gained = simulation.pressure_pa(chambers[c]).lane(lane) - before[c].lane(lane);
                gained * capacity.get(chambers[c]).copied().unwrap_or(f64::NAN) / plant.tick_s()
            }));
        }
    }
    Ok(flows)
}

/// The rig with its chambers held, its valves gone, a tick per revolution, and only what acts in a settled rig.
fn held_rig(rig: &Rig) -> Rig {
    let mut held = rig.clone();
    held.valves.clear();
    held.mechanisms.retain(|m| m.enabled && m.mechanism.acts_when_settled());
    for volume in held.volumes.values_mut() {
        volume.volume_l = HELD_L;
        volume.compliance_ml_per_kpa = 0.0;
    }
    let speed_rpm = held.pumps.values().find_map(|pump| match pump {
        crate::rig::Pump::Piston(p) => Some(p.speed_rpm),
        crate::rig::Pump::Flow(_) => None,
    });
    if let Some(rpm) = speed_rpm {
        held.integrator.tick_ms = 60_000.0 / rpm;
        held.integrator.step_ms = held.integrator.tick_ms / STEPS;
    }
    held
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The full simulation, left alone for 40 s, settles where the map says.
    #[test]
    fn settled_pressures_agree_with_the_simulation() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        let map = SteadyMap::new(&rig).unwrap();
        for duty in [[0.6, 0.7], [0.8, 0.8], [1.0, 0.9]] {
            let mut plant = crate::predict::DualPressureRig::new(&rig).unwrap();
            for _ in 0..2000 {
                plant.tick(duty, true);
            }
            let (settled, simulated) = (map.settled_kpa(duty).unwrap(), plant.readings_kpa());
            for c in 0..CHANNELS {
                // The map gives the mean over a revolution, a reading the instant at top dead centre; the
                // ripple is 0.53 kPa (positive) and 0.76 kPa (negative) from peak to peak.
                assert!((settled[c] - simulated[c]).abs() < 0.45, "{duty:?}: {settled:?} against {simulated:?}");
            }
        }
    }

    #[test]
    fn duty_for_inverts_rate() {
        let map = SteadyMap::new(&Rig::builtin("dual_pressure").unwrap()).unwrap();
        for (p, rates) in [([90.0, -72.0], [0.0, 0.0]), ([100.0, -75.0], [5.0, -2.0]), ([80.0, -70.0], [-5.0, 2.0])] {
            let duty = map.duty_for(p, rates);
            let again = map.rate_kpa_per_s(p, duty);
            for c in 0..CHANNELS {
                assert!((again[c] - rates[c]).abs() < 1e-9, "{again:?} against {rates:?}");
            }
        }
    }
}
