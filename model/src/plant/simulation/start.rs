//! Start of a run: what stands still, what has settled, and what a recording's first row tells.

use std::sync::Arc;

use super::Simulation;
use crate::observation::TICKS_PER_S;
use crate::plant::MOST_DRIVES;
use crate::plant::dispatch::Simulated;
use crate::plant::residual::Variable;
use crate::real::Real;

/// Guess of a free run at what recordings do not tell: the pressures in the cylinders.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FreeRunStart {
    /// The rig stood still: cylinders at atmospheric pressure.
    AtRest,
    /// The pump was running: cylinders as they are once periodic.
    Running,
}

impl FreeRunStart {
    /// Which start suits a recording whose first readings (gauge kPa) are these.
    pub fn for_readings<R: Real>(readings_kpa: &[R]) -> Self {
        let close = R::splat(AT_REST_PA * 1e-3);
        let off = readings_kpa.iter().any(|p| p.any_above(close) || (-*p).any_above(close));
        if off { FreeRunStart::Running } else { FreeRunStart::AtRest }
    }
}

/// A rig all of whose chambers are this close to the atmosphere has been standing still, in Pa. Far above
/// the sensors' noise of 110 Pa, far below what one revolution of the pump does (4.7 kPa).
const AT_REST_PA: f64 = 500.0;

/// Rounds of a held rig ([`Simulation::ticks_in_a_round`]) after which its cylinders are periodic.
const SETTLING_ROUNDS: usize = 30;

impl<R: Simulated> Simulation<R> {
    /// Sets the memory of the command paths as if `inputs` had been commanded for ever.
    pub fn settle_commands(&mut self, inputs: &[R]) {
        let plant = Arc::clone(&self.plant);
        let supplied = plant.supplied(inputs);
        let mut acting = Vec::with_capacity(supplied.len());
        for (path, supplied) in plant.commands.iter().zip(supplied) {
            let sent = inputs.get(path.input).copied().unwrap_or(R::splat(0.0));
            acting.push(path.settle(sent, supplied, &mut self.state.memory));
        }
        for vent in &plant.shaped_vents {
            let duty = acting.get(vent.command).copied().unwrap_or(R::splat(0.0));
            let at = |node: usize| self.state.x.get(node).copied().unwrap_or(plant.atmosphere_pa);
            let balance = vent.balance(duty, at(vent.up), at(vent.down));
            if let Some(slot) = vent.held.and_then(|slot| self.state.memory.get_mut(slot)) {
                *slot = balance;
            }
        }
        for probe in plant.residuals.iter().flat_map(|residual| &residual.probes) {
            if let (Variable::Duty { command }, Some(slot)) =
                (probe.variable, probe.memory.and_then(|m| self.state.memory.get_mut(m)))
            {
                *slot = acting.get(command).copied().unwrap_or(R::splat(0.0));
            }
        }
    }

    /// Starts a free run: sensors read `readings_kpa` (gauge), `inputs` have long been commanded, the crank
    /// is at zero; cylinders as `start` says.
    ///
    /// A chamber without a sensor starts at the reading of the nearest one that lines join it to; at atmospheric pressure
    /// where there is none.
    pub fn start_from(&mut self, readings_kpa: &[R], inputs: &[R], start: FreeRunStart) {
        self.start_at(readings_kpa, inputs, start, R::splat(0.0), 0.0);
    }

    /// Start with all cranks `crank_rev` revolutions further on, `elapsed_s` after what drifts or changes by itself began
    /// to: a recording's later part.
    pub fn start_at(&mut self, readings_kpa: &[R], inputs: &[R], start: FreeRunStart, crank_rev: R, elapsed_s: f64) {
        let fresh = Simulation::on(Arc::clone(&self.plant), self.set);
        self.state = fresh.state;
        self.state.ticks = (elapsed_s / self.plant.tick_s()).round().max(0.0) as u64;
        let time_s = self.time_s();
        self.state.phase = [crank_rev.map(|rev| rev - rev.floor()); MOST_DRIVES];
        let plant = Arc::clone(&self.plant);
        for (sensor, reading) in plant.sensors.iter().zip(readings_kpa) {
            self.set_pressure_pa(sensor.node, plant.atmosphere_pa + sensor.gauge_kpa(*reading, time_s) * R::splat(1e3));
        }
        for (node, sensor) in &plant.like {
            if let (Some(sensor), Some(reading)) = (plant.sensors.get(*sensor), readings_kpa.get(*sensor)) {
                let gauge_kpa = sensor.gauge_kpa(*reading, time_s);
                self.set_pressure_pa(*node, plant.atmosphere_pa + gauge_kpa * R::splat(1e3));
            }
        }
        if start == FreeRunStart::Running {
            self.run_averaged(inputs);
            // Once more, now that the ripple of all ports is on.
            for (sensor, reading) in plant.sensors.iter().zip(readings_kpa) {
                self.set_pressure_pa(
                    sensor.node,
                    plant.atmosphere_pa + sensor.gauge_kpa(*reading, time_s) * R::splat(1e3),
                );
            }
            self.run_averaged(inputs);
        }
        for joined in &plant.joined {
            if let Some(slot) = self.state.x.get_mut(joined.volume) {
                *slot = joined.volume_at(time_s);
            }
        }
        for muscle in &plant.muscles {
            let at = |node: usize| self.state.x.get(node).copied().unwrap_or(plant.atmosphere_pa);
            let contraction = muscle.at_rest(at(muscle.gains), at(muscle.loses));
            if let Some(slot) = self.state.x.get_mut(muscle.contraction) {
                *slot = contraction;
            }
        }
        self.settle_commands(inputs);
        self.settled = None;
        if start == FreeRunStart::Running && !plant.cylinders.is_empty() {
            self.fill_standing_cylinders(inputs);
            self.settle_cylinders(inputs);
            self.settled = Some(inputs.to_vec());
        }
        if start == FreeRunStart::Running {
            self.warm_as_settled(inputs);
        }
        self.reset_sensors();
    }

    /// Ticks after which a held rig's chambers are put back to where they were: as many as go into a row of recordings, 20 ms,
    /// whatever the rig's own tick is. Put back more often they would lose their ripple in the middle of a revolution.
    pub(super) fn ticks_in_a_round(&self) -> usize {
        (1.0 / (TICKS_PER_S * self.plant.tick_s())).round().max(1.0) as usize
    }

    /// Turns the pumps until their cylinders repeat themselves, chambers standing as they are, and ends where cranks
    /// stand now.
    pub(super) fn settle_cylinders(&mut self, inputs: &[R]) {
        let plant = Arc::clone(&self.plant);
        let held = self.state;
        // One tick tells the speeds; a tick need not be a whole number of revolutions, so cranks start as far back.
        self.tick(inputs);
        self.state = held;
        let ticks = self.ticks_in_a_round();
        let time = R::splat(plant.tick_s() * (SETTLING_ROUNDS * ticks) as f64);
        for (phase, speed) in self.state.phase.iter_mut().zip(&self.scratch.speeds) {
            *phase = (*phase - *speed * time).map(|p| p - p.floor());
        }
        // A revolution forgets about a third of its start (the outlet valve is tight), so thirty leave 1e-5 of it.
        for _ in 0..SETTLING_ROUNDS {
            for _ in 0..ticks {
                self.tick(inputs);
                // What comes with time stands still meanwhile.
                self.state.ticks = held.ticks;
            }
            for node in (0..plant.chambers).chain(plant.slow_states()) {
                if let (Some(slot), Some(value)) = (self.state.x.get_mut(node), held.x.get(node)) {
                    *slot = *value;
                }
            }
        }
        self.state.phase = held.phase;
        self.state.memory = held.memory;
    }

    /// Which start suits a recording whose first readings are these.
    pub fn start_for(&self, readings_kpa: &[R]) -> FreeRunStart {
        FreeRunStart::for_readings(readings_kpa)
    }

    /// Which drives `inputs` switch on: 1 or 0.
    fn running(&self, drive: usize, inputs: &[R]) -> R {
        let relay = self.plant.drives.get(drive).and_then(|drive| inputs.get(drive.relay?)).copied();
        relay.unwrap_or(R::splat(1.0)).map(|relay| if relay >= 0.5 { 1.0 } else { 0.0 })
    }

    /// Cylinders of pumps that `inputs` switch off are as full as what they draw from: their inlet valves have let in what
    /// they lacked.
    fn fill_standing_cylinders(&mut self, inputs: &[R]) {
        let plant = Arc::clone(&self.plant);
        for cylinder in &plant.cylinders {
            let running = self.running(cylinder.drive, inputs);
            let inlet = self.state.x.get(cylinder.inlet).copied().unwrap_or(plant.atmosphere_pa);
            if let Some(slot) = self.state.x.get_mut(cylinder.node) {
                *slot = running * *slot + (R::splat(1.0) - running) * inlet;
            }
        }
    }

    /// Sets averaged pumps as they are once periodic where `inputs` switch them on, as full as what they draw from where
    /// not.
    pub(super) fn run_averaged(&mut self, inputs: &[R]) {
        let plant = Arc::clone(&self.plant);
        for pump in &plant.averaged {
            let running = self.running(pump.drive, inputs);
            let at = |node: usize| self.state.x.get(node).copied().unwrap_or(plant.atmosphere_pa);
            let mean = pump.table.at(at(pump.inlet), at(pump.outlet)).content;
            let content = running * mean + (R::splat(1.0) - running) * at(pump.inlet) * pump.table.content_per_pa;
            for (slot, value) in
                [(self.state.x.get_mut(pump.content), content), (self.state.memory.get_mut(pump.memory), running)]
            {
                if let Some(slot) = slot {
                    *slot = value;
                }
            }
        }
    }

    /// Puts in what a rig at rest has in coils, muscles and averaged pumps.
    pub(super) fn rest(&mut self) {
        let plant = Arc::clone(&self.plant);
        for joined in &plant.joined {
            if let Some(slot) = self.state.x.get_mut(joined.volume) {
                *slot = R::splat(0.0);
            }
        }
        for muscle in &plant.muscles {
            if let Some(slot) = self.state.x.get_mut(muscle.contraction) {
                *slot = muscle.at_rest(plant.atmosphere_pa, plant.atmosphere_pa);
            }
        }
        for pump in &plant.averaged {
            if let Some(slot) = self.state.x.get_mut(pump.content) {
                *slot = plant.atmosphere_pa * pump.table.content_per_pa;
            }
        }
        let rest = vec![R::splat(0.0); plant.inputs.len()];
        self.settle_commands(&rest);
    }

    pub(super) fn reset_temperatures(&mut self) {
        for chamber in &self.plant.thermal {
            if let Some(slot) = self.state.x.get_mut(chamber.temperature) {
                *slot = chamber.wall_temperature;
            }
        }
    }

    pub(super) fn reset_sensors(&mut self) {
        let plant = Arc::clone(&self.plant);
        for sensor in &plant.sensors {
            let pressure = self.pressure_pa(sensor.node);
            sensor.settle(pressure, &mut self.state.memory);
        }
        for probe in plant.residuals.iter().flat_map(|residual| &residual.probes) {
            // Duties' memories are settled with the commands; no table is over anything else that a state lacks.
            if !matches!(probe.variable, Variable::Duty { .. })
                && let Some(slot) = probe.memory.and_then(|m| self.state.memory.get_mut(m))
            {
                *slot = probe.variable.at(&self.scratch, plant.atmosphere_pa, &self.state.x, 0);
            }
        }
    }
}
