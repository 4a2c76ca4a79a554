//! The rig averaged over a revolution: what the pump moves at given pressures, and which duties hold them.
//!
//! With both chambers held at fixed pressures and the valves shut, the cylinders soon repeat themselves and
//! each chamber gains a constant mass per time, `ṁ(P_pos, P_neg)`. That map (from the averaged plant, see
//! [`crate::averaged`], whose pump is at rest with its ports) turns the dynamics into algebra:
//!
//! ```text
//! V/(R T) · Ṗ = ṁ(P) ∓ ṁ_valve(P, u)
//! ```
//!
//! which is solved for `u` (feed-forward: [`SteadyMap::duty_for`]) or, with `Ṗ = 0`, for `P`
//! ([`SteadyMap::settled_kpa`]).
//!
//! In it are mechanisms that change the flows of a rig that has settled: of the pump, leaks, another critical ratio,
//! curved forces, a full opening and whatever is in series with a valve; and another volume or a compliant one. Left out
//! is what the past decides (play, stiction, lag and delay of a valve; heat of a coil; muscles; warm gas), what one valve
//! does to the other's supply, tabled flows that are over a valve's duty, and sensors: pressures are the chambers'.

use std::sync::Arc;

use nalgebra::{Matrix2, Vector2};

use crate::averaged::PumpTables;
use crate::mechanism::{Mechanism, Variable};
use crate::observation::{CHANNELS, Pair};
use crate::plant::{Plant, Simulation, ValveModel};
use crate::predict::DualPressurePorts;
use crate::real::{Lanes, Real};
use crate::rig::{ATMOSPHERE, Rig, RigError, Valve};

const POSITIVE_KPA: Axis = Axis { low: -5.0, step: 5.0, points: 36 };
const NEGATIVE_KPA: Axis = Axis { low: -97.5, step: 2.5, points: 41 };

/// Net mass flow into both chambers by pressures, and the valves' inverse.
#[derive(Debug, Clone)]
pub struct SteadyMap {
    /// Net mass flow into each chamber in kg/s with valves shut; `[negative][positive]` flattened.
    flows: Vec<Pair>,
    valves: [ValveInverse; CHANNELS],
    chambers: [Capacity; CHANNELS],
    atmosphere_pa: f64,
}

/// What a chamber takes up per pressure, V/(R T) of one that may be compliant.
#[derive(Debug, Clone, Copy)]
struct Capacity {
    /// In kg/Pa, extrapolated to no pressure.
    at_vacuum: f64,
    /// Growth in kg/Pa².
    growth: f64,
}

impl Capacity {
    fn of(rig: &Rig, name: &str) -> Self {
        let Some(volume) = rig.volumes.get(name) else { return Capacity { at_vacuum: f64::NAN, growth: 0.0 } };
        let (mut litres, mut compliance) = (volume.volume_l, volume.compliance_ml_per_kpa);
        for mechanism in rig.mechanisms.iter().filter(|m| m.enabled && m.component == name).map(|m| &m.mechanism) {
            match mechanism {
                Mechanism::VolumeChange(m) if !m.is_later() => litres += m.extra_volume_l,
                Mechanism::VolumeCompliance(m) => compliance += m.compliance_ml_per_kpa,
                _ => {}
            }
        }
        let rt = rig.gas.gas_constant_j_per_kg_k * volume.temperature_k;
        let growth = compliance * 1e-9 / rt;
        // P V grows by V + P V' per pressure, with V = V₀ + V' (P − P_atm).
        let at_vacuum = litres * 1e-3 / rt - growth * rig.atmosphere.pressure_kpa_abs * 1e3;
        Capacity { at_vacuum, growth: 2.0 * growth }
    }

    fn at(&self, pressure_pa: f64) -> f64 {
        self.growth.mul_add(pressure_pa, self.at_vacuum)
    }
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

/// A valve between a chamber and the atmosphere, solved for its duty.
#[derive(Debug, Clone, Copy)]
struct ValveInverse {
    model: ValveModel,
    /// +1 if it fills its chamber, −1 if it empties it.
    fills: f64,
}

impl ValveInverse {
    fn ports(&self, chamber_pa: f64, atmosphere_pa: f64) -> (f64, f64) {
        if self.fills > 0.0 { (atmosphere_pa, chamber_pa) } else { (chamber_pa, atmosphere_pa) }
    }

    /// Net mass flow into the chamber in kg/s.
    fn inflow(&self, duty: f64, chamber_pa: f64, atmosphere_pa: f64) -> f64 {
        let (up, down) = self.ports(chamber_pa, atmosphere_pa);
        self.fills * self.model.flow(duty, up, down)
    }

    /// The duty that lets `inflow` kg/s into the chamber, beyond 0 … 1 where no duty does.
    fn duty(&self, inflow: f64, chamber_pa: f64, atmosphere_pa: f64) -> f64 {
        let (up, down) = self.ports(chamber_pa, atmosphere_pa);
        self.model.duty(self.fills * inflow, up, down)
    }
}

impl SteadyMap {
    /// Maps a rig; some milliseconds.
    ///
    /// # Errors
    /// If the rig is unsound, or is not two chambers each with one valve to the atmosphere.
    pub fn new(rig: &Rig) -> Result<Self, RigError> {
        let plant = Plant::new(rig)?;
        DualPressurePorts::of(&plant)?;
        let mut valves = Vec::new();
        let mut capacities = Vec::new();
        let mut chambers = [0; CHANNELS];
        for (c, column) in DualPressurePorts::DUTY.into_iter().enumerate() {
            let (index, name, valve) = rig
                .valves
                .iter()
                .enumerate()
                .find_map(|(i, (name, v))| (v.command == column).then_some((i, name, v)))
                .ok_or_else(|| RigError::at("valves", column))?;
            let (place, fills) = chamber_of(name, valve)?;
            chambers[c] = rig
                .volumes
                .get_index_of(place)
                .ok_or_else(|| RigError::at(format!("valves.{name}"), format!("`{place}` is no volume")))?;
            let model = plant.valve_model(index).ok_or_else(|| RigError::at("valves", column))?;
            capacities.push(Capacity::of(rig, place));
            valves.push(ValveInverse { model, fills });
        }
        let ([Some(positive), Some(negative)], [Some(one), Some(other)]) = (
            [valves.first().copied(), valves.get(1).copied()],
            [capacities.first().copied(), capacities.get(1).copied()],
        ) else {
            return Err(RigError::at("valves", "two valves are needed"));
        };
        Ok(SteadyMap {
            flows: pump_flows(rig, chambers)?,
            valves: [positive, negative],
            chambers: [one, other],
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
            (flows[c] + self.valves[c].inflow(duty[c], chamber, self.atmosphere_pa)) / self.chambers[c].at(chamber)
                * 1e-3
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
            let wanted = self.chambers[c].at(chamber) * rates_kpa_per_s[c] * 1e3 - flows[c];
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
            let chamber = self.atmosphere_pa + pressures_kpa[c] * 1e3;
            let (up, down) = valve.ports(chamber, self.atmosphere_pa);
            valve.fills * valve.model.flow_per_duty(up, down) / self.chambers[c].at(chamber) * 1e-3
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

/// The chamber that a valve joins to the atmosphere, and +1 if the valve fills it, −1 if it empties it.
fn chamber_of<'v>(name: &str, valve: &'v Valve) -> Result<(&'v str, f64), RigError> {
    match (valve.from.as_str(), valve.to.as_str()) {
        (ATMOSPHERE, to) => Ok((to, 1.0)),
        (from, ATMOSPHERE) => Ok((from, -1.0)),
        _ => Err(RigError::at(format!("valves.{name}"), "neither end is the atmosphere; no steady map can be made")),
    }
}

/// Net mass flow into the two chambers over the grid, valves shut, eight grid points at a time.
fn pump_flows(rig: &Rig, chambers: [usize; CHANNELS]) -> Result<Vec<Pair>, RigError> {
    type Eight = Lanes<8>;
    let plant = Arc::new(Plant::<Eight>::held(&without_valves(rig), &PumpTables::new())?);
    let on: Vec<Eight> = plant.inputs().iter().map(|i| Eight::splat(i.default.unwrap_or(1.0))).collect();
    let mut simulation = Simulation::new(Arc::clone(&plant));
    let cells: Vec<Pair> = (0..NEGATIVE_KPA.points)
        .flat_map(|j| (0..POSITIVE_KPA.points).map(move |i| [POSITIVE_KPA.value(i), NEGATIVE_KPA.value(j)]))
        .collect();
    let mut flows = Vec::with_capacity(cells.len());
    for eight in cells.chunks(Eight::LANES) {
        let held = [0, 1].map(|c: usize| {
            let kpa = Eight::from_lanes(|lane| eight.get(lane).or(eight.last()).map_or(0.0, |p| p[c]));
            plant.atmosphere_pa() + kpa * Eight::splat(1e3)
        });
        let gained = simulation.gains_of_held(&chambers, &held, &on);
        for lane in 0..eight.len() {
            flows.push(std::array::from_fn(|c| gained.get(c).map_or(f64::NAN, |flow| flow.lane(lane))));
        }
    }
    Ok(flows)
}

/// The rig with its valves gone, and only what acts without them in a settled rig.
fn without_valves(rig: &Rig) -> Rig {
    let mut shut = rig.clone();
    shut.valves.clear();
    let over_a_valve = |mechanism: &Mechanism| match mechanism {
        Mechanism::ResidualFlow(m) => m.axes.iter().any(|axis| axis.variable != Variable::Pressure),
        Mechanism::SupplySag(_) => true,
        _ => false,
    };
    shut.mechanisms.retain(|m| {
        let acts =
            m.mechanism.acts_when_settled() || matches!(&m.mechanism, Mechanism::VolumeChange(m) if !m.is_later());
        m.enabled && acts && !rig.valves.contains_key(&m.component) && !over_a_valve(&m.mechanism)
    });
    shut
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

    /// With the pump a little slower readings go through all crank angles, 0.33 times a second: their mean is what the map
    /// gives, without the ripple. A feed-forward that is off by a tenth of a kPa shows in every reversal.
    #[test]
    fn mean_pressures_agree_with_the_simulation() {
        let mut rig = Rig::builtin("dual_pressure").unwrap();
        for pump in rig.pumps.values_mut() {
            if let crate::rig::Pump::Piston(pump) = pump {
                pump.speed_rpm = 2990.0;
            }
        }
        let map = SteadyMap::new(&rig).unwrap();
        for duty in [[0.6, 0.7], [0.8, 0.8], [1.0, 0.9]] {
            let mut plant = crate::predict::DualPressureRig::new(&rig).unwrap();
            let mut sums = [0.0; CHANNELS];
            for tick in 0..2300 {
                plant.tick(duty, true);
                if tick >= 2000 {
                    for (sum, kpa) in sums.iter_mut().zip(plant.readings_kpa()) {
                        *sum += kpa / 300.0;
                    }
                }
            }
            let settled = map.settled_kpa(duty).unwrap();
            for c in 0..CHANNELS {
                assert!((settled[c] - sums[c]).abs() < 0.02, "{duty:?}: {settled:?} against {sums:?}");
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
