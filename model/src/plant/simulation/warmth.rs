//! Temperature of the gas in chambers whose pressures had settled when a run begins.
//!
//! Temperatures are in no recording. Gas in a tank that a pump fills is warmer than its walls for as long as the pump runs:
//! what flows in is what flows out, and has its own temperature with it,
//!
//! ```text
//! ṁ c_p (T_in − T) = h (T − T_wall)
//! ```
//!
//! (first law for a chamber at constant pressure; `c_p = κ R/(κ − 1)`). A run that began at the walls' temperature instead
//! would warm up first: 2 K, or 1.4 kPa of 200, within the first tenths of a second.

use std::sync::Arc;

use super::Simulation;
use crate::plant::dispatch::Simulated;

/// Rounds of a held rig ([`Simulation::ticks_in_a_round`]) over which flows are averaged: a crank need not be back where it was
/// after one.
const AVERAGED_ROUNDS: usize = 10;

impl<R: Simulated> Simulation<R> {
    /// Tells whether gas in some chamber is warmer or colder than its walls at times.
    pub fn has_gas_that_warms(&self) -> bool {
        !self.plant.thermal.is_empty()
    }

    /// Temperatures of the gas in chambers where it is not its walls', in K.
    pub fn gas_temperatures_k(&self) -> Vec<R> {
        let at = |node: usize| self.state.x.get(node).copied().unwrap_or(R::splat(f64::NAN));
        self.plant.thermal.iter().map(|chamber| at(chamber.temperature)).collect()
    }

    /// Sets temperatures as [`Simulation::gas_temperatures_k`] gives them; pressures stay.
    pub fn set_gas_temperatures_k(&mut self, temperatures_k: &[R]) {
        for (chamber, kelvin) in self.plant.thermal.iter().zip(temperatures_k) {
            if let Some(slot) = self.state.x.get_mut(chamber.temperature) {
                *slot = *kelvin;
            }
        }
    }

    /// Makes gas as warm as it is where the pressures, as they are now, had settled with pumps running as `inputs` say.
    ///
    /// What flows into a chamber and how warm it is are measured: with all valves shut it is what the chamber gains in mass, and
    /// in pressure. A chamber that loses gas then draws it in from the surroundings when settled, and is left at its walls'
    /// temperature.
    pub(super) fn warm_as_settled(&mut self, inputs: &[R]) {
        let plant = Arc::clone(&self.plant);
        if plant.thermal.is_empty() {
            return;
        }
        let zero = R::splat(0.0);
        let held = self.state;
        let mut shut = inputs.to_vec();
        for path in &plant.commands {
            if let Some(duty) = shut.get_mut(path.input) {
                *duty = zero;
            }
        }
        self.settle_commands(&shut);
        let kappa = plant.heat_capacity_ratio;
        let beyond = kappa - R::splat(1.0);
        let ticks = self.ticks_in_a_round();
        let round_s = plant.tick_s() * ticks as f64;
        let time = R::splat(round_s);
        // Σ Δm in kg and Σ Δ(m T) of what flows, in kg K.
        let mut gained = vec![[zero; 2]; plant.thermal.len()];
        for _ in 0..AVERAGED_ROUNDS {
            for _ in 0..ticks {
                self.tick(&shut);
            }
            for (chamber, [mass, heat]) in plant.thermal.iter().zip(&mut gained) {
                let of = |x: &[R]| [chamber.node, chamber.temperature].map(|at| x.get(at).copied().unwrap_or(zero));
                let ([p0, t0], [p, t]) = (of(&held.x), of(&self.state.x));
                let volume = |p: R| chamber.compliance.mul_add(p, chamber.volume_at_vacuum);
                *mass += (p * volume(p) / t - p0 * volume(p0) / t0) / plant.gas_constant;
                let cooled =
                    chamber.wall_conductance * (R::splat(0.5) * (t0 + t) - chamber.wall_temperature) * time * beyond;
                let stiffness = (kappa * chamber.compliance).mul_add(p0, volume(p0));
                *heat += (stiffness * (p - p0) + cooled) / (kappa * plant.gas_constant);
            }
            for node in (0..plant.chambers).chain(plant.slow_states()) {
                if let (Some(slot), Some(value)) = (self.state.x.get_mut(node), held.x.get(node)) {
                    *slot = *value;
                }
            }
        }
        self.state = held;
        let per_second = R::splat(1.0 / (round_s * AVERAGED_ROUNDS as f64));
        let heat_capacity = kappa * plant.gas_constant / beyond;
        for (chamber, [mass, heat]) in plant.thermal.iter().zip(gained) {
            let (wall, conductance) = (chamber.wall_temperature, chamber.wall_conductance);
            let [carried, brought] = [mass, heat].map(|sum| heat_capacity * sum * per_second);
            let settled = (brought + conductance * wall) / (carried + conductance);
            if let Some(slot) = self.state.x.get_mut(chamber.temperature) {
                *slot = R::from_lanes(|l| {
                    let settled = settled.lane(l);
                    if mass.lane(l) > 0.0 && settled.is_finite() { settled } else { wall.lane(l) }
                });
            }
        }
    }
}
