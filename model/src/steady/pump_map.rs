//! Flows of the pump at given pressures, tabled.

use std::sync::Arc;

use crate::averaged::PumpTables;
use crate::mechanism::{Mechanism, Variable};
use crate::observation::{CHANNELS, Pair};
use crate::plant::{Plant, Simulation};
use crate::real::{Lanes, Real};
use crate::rig::{Rig, RigError};

const POSITIVE_KPA: Axis = Axis { low: -5.0, step: 5.0, points: 36 };
const NEGATIVE_KPA: Axis = Axis { low: -97.5, step: 2.5, points: 41 };
/// Ticks of a held rig (1 ms each) after which the cylinders' gas follows a ramp as it will: five of its time constants.
const RAMP_TICKS: usize = 80;
/// Slope of that ramp in Pa per tick; flows are straight over what it passes.
const RAMP_PA_PER_TICK: f64 = 10.0;

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

/// Pressures in kPa gauge, moved to the map's edge where they are beyond it.
pub(super) fn within_map(pressures_kpa: Pair) -> Pair {
    let axes = [POSITIVE_KPA, NEGATIVE_KPA];
    std::array::from_fn(|c| pressures_kpa[c].clamp(axes[c].low, axes[c].value(axes[c].points - 1)))
}

/// Flows and capacities over the grid of pressures, `[negative][positive]` flattened.
#[derive(Debug, Clone)]
pub(super) struct PumpMap {
    /// Net mass flow into each chamber in kg/s with valves shut.
    flows: Vec<Pair>,
    /// Addition of the cylinders to the capacities, in kg/Pa: `[c][j]` is what is lost to chamber c per rate of pressure j.
    pub(super) followed: Vec<[Pair; CHANNELS]>,
}

impl PumpMap {
    /// The map of a rig whose channels are the volumes of these numbers.
    pub(super) fn of(rig: &Rig, chambers: [usize; CHANNELS]) -> Result<Self, RigError> {
        mapped(rig, chambers)
    }

    /// Net mass flow into both chambers in kg/s, by bilinear interpolation.
    pub(super) fn flows(&self, pressures_kpa: Pair) -> Pair {
        between(pressures_kpa, |at| self.flows.get(at).copied().unwrap_or([f64::NAN; CHANNELS]))
    }

    /// Addition of the cylinders to the capacities there, in kg/Pa, by bilinear interpolation.
    pub(super) fn followed(&self, pressures_kpa: Pair) -> [Pair; CHANNELS] {
        std::array::from_fn(|c| between(pressures_kpa, |at| self.followed.get(at).map_or([0.0; CHANNELS], |e| e[c])))
    }
}

fn between(pressures_kpa: Pair, value: impl Fn(usize) -> Pair) -> Pair {
    let (i, x) = POSITIVE_KPA.locate(pressures_kpa[0]);
    let (j, y) = NEGATIVE_KPA.locate(pressures_kpa[1]);
    let at = |i: usize, j: usize| value(j * POSITIVE_KPA.points + i);
    let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1));
    std::array::from_fn(|n| (1.0 - y) * ((1.0 - x) * a[n] + x * b[n]) + y * ((1.0 - x) * c[n] + x * d[n]))
}

/// Net mass flow into the two chambers over the grid, valves shut, and what it loses while pressures rise; eight grid points at a
/// time.
fn mapped(rig: &Rig, chambers: [usize; CHANNELS]) -> Result<PumpMap, RigError> {
    type Eight = Lanes<8>;
    let plant = Arc::new(Plant::<Eight>::held(&without_valves(rig), &PumpTables::new())?);
    let on: Vec<Eight> = plant.inputs().iter().map(|i| Eight::splat(i.default.unwrap_or(1.0))).collect();
    let mut simulation = Simulation::new(Arc::clone(&plant));
    let cells: Vec<Pair> = (0..NEGATIVE_KPA.points)
        .flat_map(|j| (0..POSITIVE_KPA.points).map(move |i| [POSITIVE_KPA.value(i), NEGATIVE_KPA.value(j)]))
        .collect();
    let mut flows = Vec::with_capacity(cells.len());
    let mut followed = Vec::with_capacity(cells.len());
    for eight in cells.chunks(Eight::LANES) {
        let held = [0, 1].map(|c: usize| {
            let kpa = Eight::from_lanes(|lane| eight.get(lane).or(eight.last()).map_or(0.0, |p| p[c]));
            plant.atmosphere_pa() + kpa * Eight::splat(1e3)
        });
        let gained = simulation.gains_of_held(&chambers, &held, &on);
        let ramped: Vec<Vec<Eight>> = (0..CHANNELS)
            .map(|j| {
                let steps: [Eight; CHANNELS] =
                    std::array::from_fn(|c| Eight::splat(if c == j { RAMP_PA_PER_TICK } else { 0.0 }));
                simulation.gains_of_ramped(&chambers, [&held, &steps], RAMP_TICKS, &on)
            })
            .collect();
        let rate_pa_per_s = RAMP_PA_PER_TICK / plant.tick_s();
        for lane in 0..eight.len() {
            let of = |gained: &[Eight], c: usize| gained.get(c).map_or(f64::NAN, |flow| flow.lane(lane));
            flows.push(std::array::from_fn(|c| of(&gained, c)));
            followed.push(std::array::from_fn(|c| {
                std::array::from_fn(|j| {
                    let lost = of(&gained, c) - ramped.get(j).map_or(f64::NAN, |ramped| of(ramped, c));
                    if lost.is_finite() { lost / rate_pa_per_s } else { 0.0 }
                })
            }));
        }
    }
    Ok(PumpMap { flows, followed })
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
