//! The balances: mass flow of every element, and what they do to every pressure and temperature.
//!
//! The only place where terms are added up. Written once over [`Real`]; whether temperatures are
//! states is a constant of the instantiation, so a rig without thermal chambers pays nothing for them.

use super::walls::Wall;
use super::{Plant, Scratch};
use crate::real::Real;

/// What temperature does to flow, by node; thermal chambers' entries are refreshed at each evaluation.
pub(crate) struct Gas<R, const NODES: usize> {
    /// Temperature in K.
    pub(crate) temperature: [R; NODES],
    /// 1/√(R T) in s/m.
    pub(crate) inverse_speed: [R; NODES],
}

/// Mass and enthalpy on their way into each node.
struct Balance<R, const NODES: usize> {
    /// Σṁ in kg/s.
    mass: [R; NODES],
    /// Σ ṁ T in kg K/s: inflow at its own temperature, outflow at the node's.
    heat: [R; NODES],
}

impl<R: Real, const NODES: usize> Balance<R, NODES> {
    /// Moves `flow` (kg/s, at least zero) from `up` to `down`.
    #[inline(always)]
    fn pass<const THERMAL: bool>(&mut self, up: usize, down: usize, flow: R, temperature: &[R; NODES]) {
        let (up, down) = (up % NODES, down % NODES);
        self.mass[up] = self.mass[up] - flow;
        self.mass[down] += flow;
        if THERMAL {
            let heat = flow * temperature[up];
            self.heat[up] = self.heat[up] - heat;
            self.heat[down] += heat;
        }
    }
}

/// Time derivatives of the states at instant `k` of the tick.
///
/// `x` holds pressures in Pa by node (chambers, cylinders, given places); the states among them are the first
/// `STATES`, and temperatures in K of thermal chambers are the last of those.
#[inline(always)]
pub(crate) fn rates<R: Real, const STATES: usize, const NODES: usize, const THERMAL: bool>(
    plant: &Plant<R>,
    scratch: &Scratch<R>,
    gas: &mut Gas<R, NODES>,
    x: &[R; NODES],
    k: usize,
) -> [R; STATES] {
    let zero = R::splat(0.0);
    if THERMAL {
        for chamber in &plant.thermal {
            let (node, temperature) = (chamber.node % NODES, x[chamber.temperature % NODES]);
            gas.temperature[node] = temperature;
            gas.inverse_speed[node] = R::splat(1.0) / (plant.gas_constant * temperature).sqrt();
        }
    }
    let Gas { temperature, inverse_speed } = &*gas;
    let mut balance = Balance { mass: [zero; NODES], heat: [zero; NODES] };

    for passage in &plant.passages {
        let (up, down) = (x[passage.up % NODES], x[passage.down % NODES]);
        let difference = up - down;
        // Check valves are shut most of the time, in all lanes at once.
        if difference.any_above(zero) {
            let phi = plant.law(passage.law).at_drop(difference / up);
            let flow = passage.area * inverse_speed[passage.up % NODES] * up * phi;
            balance.pass::<THERMAL>(passage.up, passage.down, flow, temperature);
        }
    }
    for vent in &plant.vents {
        let (up, down) = (x[vent.up % NODES], x[vent.down % NODES]);
        let difference = up - down;
        let duty = scratch.duty(vent.command, k);
        let lift = vent.input_area.mul_add(duty, vent.pressure_area * difference) - vent.spring_area;
        let area = lift.at_least(zero);
        let phi = plant.law(vent.law).at_drop(difference / up);
        let flow = area * inverse_speed[vent.up % NODES] * up * phi;
        balance.pass::<THERMAL>(vent.up, vent.down, flow, temperature);
    }
    for capillary in &plant.capillaries {
        let (one, other) = (x[capillary.up % NODES], x[capillary.down % NODES]);
        let flow = capillary.conductance * (one - other) * (one + other);
        balance.pass::<THERMAL>(capillary.up, capillary.down, flow.at_least(zero), temperature);
        balance.pass::<THERMAL>(capillary.down, capillary.up, (-flow).at_least(zero), temperature);
    }
    for (i, pump) in plant.displacements.iter().enumerate() {
        // What is displaced has the temperature that the inlet has now.
        let rt = if THERMAL { plant.gas_constant * temperature[pump.up % NODES] } else { pump.rt };
        let flow = pump.flow * scratch.displacement(i) * x[pump.up % NODES] / rt;
        balance.pass::<THERMAL>(pump.up, pump.down, flow, temperature);
    }
    for (i, feed) in plant.feeds.iter().enumerate() {
        let flow = feed.flow * scratch.feed(i);
        let node = feed.down % NODES;
        balance.mass[node] += flow;
        if THERMAL {
            // Drawn out, the gas leaves with the node's own temperature.
            balance.heat[node] += flow.at_least(zero) * feed.temperature - (-flow).at_least(zero) * temperature[node];
        }
    }

    // Rigid isothermal chambers and cylinders are one formula; the others are overwritten below.
    let walls: &[Wall<R>; STATES] = scratch.walls(k);
    let mut dx = [zero; STATES];
    for i in 0..STATES {
        dx[i] = walls[i].pressure_per_mass * balance.mass[i] - walls[i].growth * x[i];
    }
    for chamber in &plant.compliant {
        let p = x[chamber.node % NODES];
        let volume = chamber.compliance.mul_add(p, chamber.volume_at_vacuum);
        let stiffness = chamber.compliance.mul_add(p, volume);
        dx[chamber.node % STATES] = balance.mass[chamber.node % NODES] * chamber.rt / stiffness;
    }
    if THERMAL {
        let kappa = plant.heat_capacity_ratio;
        for chamber in &plant.thermal {
            let node = chamber.node % NODES;
            let (p, t) = (x[node], temperature[node]);
            let volume = chamber.compliance.mul_add(p, chamber.volume_at_vacuum);
            let stiffness = (kappa * chamber.compliance).mul_add(p, volume);
            let cooling = chamber.wall_conductance * (t - chamber.wall_temperature);
            let dp = (kappa * plant.gas_constant * balance.heat[node] - (kappa - R::splat(1.0)) * cooling) / stiffness;
            let relative =
                dp / p + chamber.compliance * dp / volume - balance.mass[node] * plant.gas_constant * t / (p * volume);
            dx[chamber.node % STATES] = dp;
            dx[chamber.temperature % STATES] = t * relative;
        }
    }
    dx
}
