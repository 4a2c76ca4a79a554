//! A plant in motion.

use std::sync::Arc;

use super::dispatch::{InstructionSet, Simulated};
use super::residual::Variable;
use super::sensor::Filter;
use super::unknown::{Slot, Unknown};
use super::{MEMORY, MOST_DRIVES, NODES, Plant, Scratch, State};
use crate::mechanism::Heat;
use crate::real::Real;

mod coils;
mod warmth;

/// A plant with its state and everything a tick needs.
///
/// Pressures are absolute Pa unless a name says kPa, which is gauge.
#[derive(Debug, Clone)]
pub struct Simulation<R> {
    plant: Arc<Plant<R>>,
    state: State<R>,
    scratch: Scratch<R>,
    set: InstructionSet,
    /// The inputs that cylinders were last settled under, if they were.
    settled: Option<Vec<R>>,
    /// Whether averaged pumps leave no ripple on the pressures that are read.
    smooth: bool,
}

/// How a free run guesses what recordings do not tell: the pressures in the cylinders.
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

/// Ticks after which held cylinders are periodic.
const SETTLING_TICKS: usize = 30;

impl<R: Simulated> Simulation<R> {
    /// A simulation at rest: atmospheric pressure everywhere, crank at zero, duties long at zero.
    pub fn new(plant: Arc<Plant<R>>) -> Self {
        Self::on(plant, InstructionSet::detect())
    }

    /// Like [`Simulation::new`] on a given instruction set, or the best there is if it is not available.
    pub fn on(plant: Arc<Plant<R>>, set: InstructionSet) -> Self {
        let scratch = Scratch::new(&plant);
        let state = State {
            x: [plant.atmosphere_pa; NODES],
            phase: [R::splat(0.0); MOST_DRIVES],
            memory: [R::splat(0.0); MEMORY],
            ticks: 0,
        };
        let set = if set.is_available() { set } else { InstructionSet::detect() };
        let mut simulation = Simulation { plant, state, scratch, set, settled: None, smooth: false };
        simulation.reset_temperatures();
        simulation.rest();
        simulation.reset_sensors();
        simulation
    }

    /// The same with the ripple of averaged pumps left off all pressures: what readings would be at the mean of a turn.
    /// Of use where nobody knows at what angle the crank stood. Without averaged pumps it changes nothing.
    #[must_use]
    pub fn smooth(self) -> Self {
        Simulation { smooth: true, ..self }
    }

    /// The compiled rig.
    pub fn plant(&self) -> &Arc<Plant<R>> {
        &self.plant
    }

    /// Advances by one tick under `inputs`, in the order of [`Plant::inputs`].
    ///
    /// # Real-time
    /// Bounded, allocation-free, lock-free: it may run in the tick.
    #[inline]
    pub fn tick(&mut self, inputs: &[R]) {
        R::advance(self.set, &self.plant, &mut self.state, &mut self.scratch, inputs);
    }

    /// Everything that a later [`Simulation::restore`] needs to continue from here.
    ///
    /// # Real-time
    /// A copy of about 700 bytes for one rig; it may run in the tick.
    pub fn state(&self) -> State<R> {
        self.state
    }

    /// Goes back (or over) to a state taken from a simulation of the same plant.
    pub fn restore(&mut self, state: &State<R>) {
        self.state = *state;
    }

    /// Ticks since the start.
    pub fn ticks(&self) -> u64 {
        self.state.ticks
    }

    /// Absolute pressure of chamber `index` in Pa; NaN beyond the last chamber.
    pub fn pressure_pa(&self, index: usize) -> R {
        if index < self.plant.chambers {
            let state = self.state.x.get(index).copied().unwrap_or(R::splat(f64::NAN));
            if self.plant.averaged.is_empty() { state } else { state + self.ripple_pa(index, &Filter::none()) }
        } else {
            R::splat(f64::NAN)
        }
    }

    /// What the ripple of averaged pumps adds to the pressure of chamber `index` now, as it is seen through a filter.
    fn ripple_pa(&self, index: usize, seen: &Filter<R>) -> R {
        if self.smooth || self.plant.averaged.is_empty() {
            return R::splat(0.0);
        }
        R::ripple(self.set, &self.plant, &self.state, &self.scratch.speeds, index, seen)
    }

    /// Gauge pressure of chamber `index` in kPa, without any sensor in between.
    pub fn pressure_kpa(&self, index: usize) -> R {
        (self.pressure_pa(index) - self.plant.atmosphere_pa) * R::splat(1e-3)
    }

    /// Sets the absolute pressure of chamber `index` in Pa (and nothing else).
    pub fn set_pressure_pa(&mut self, index: usize, pressure: R) {
        if index >= self.plant.chambers {
            return;
        }
        if let Some(slot) = self.state.x.get_mut(index) {
            *slot = pressure;
        }
        if !self.plant.averaged.is_empty() {
            // The state is the mean; the ripple on it hardly depends on it.
            for _ in 0..2 {
                let mean = pressure - self.ripple_pa(index, &Filter::none());
                if let Some(slot) = self.state.x.get_mut(index) {
                    *slot = mean;
                }
            }
        }
    }

    /// Sets the chambers under the given sensors to what these measured (kPa gauge), and the sensors with them.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn correct(&mut self, sensors: &[usize], measured_kpa: &[R]) {
        let time_s = self.time_s();
        for (index, measured) in sensors.iter().zip(measured_kpa) {
            let Some(sensor) = self.plant.sensors.get(*index).copied() else { continue };
            let pressure = self.plant.atmosphere_pa + sensor.gauge_kpa(*measured, time_s) * R::splat(1e3);
            self.set_pressure_pa(sensor.node, pressure);
            sensor.settle(pressure, &mut self.state.memory);
        }
    }

    /// What sensor `index` reads, in gauge kPa; NaN beyond the last sensor.
    pub fn reading_kpa(&self, index: usize) -> R {
        let Some(sensor) = self.plant.sensors.get(index) else { return R::splat(f64::NAN) };
        let remembered = |place: Option<usize>| place.and_then(|m| self.state.memory.get(m)).copied();
        let step_s = self.plant.step_s;
        let mut pressure = match remembered(sensor.lagged()) {
            Some(lagged) => lagged + self.ripple_pa(sensor.node, &sensor.lag(step_s)),
            None => self.pressure_pa(sensor.node),
        };
        if let Some(answered) = remembered(sensor.response) {
            let answered = answered + self.ripple_pa(sensor.node, &sensor.answer(step_s));
            pressure = sensor.share.mul_add(answered - pressure, pressure);
        }
        sensor.reading((pressure - self.plant.atmosphere_pa) * R::splat(1e-3), self.time_s())
    }

    /// Seconds since the start.
    fn time_s(&self) -> f64 {
        self.state.ticks as f64 * self.plant.tick_s()
    }

    /// All readings in gauge kPa, in the order of [`Plant::sensor_columns`].
    pub fn readings_kpa(&self) -> impl Iterator<Item = R> + '_ {
        (0..self.plant.sensors.len()).map(|i| self.reading_kpa(i))
    }

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

    /// The same with all cranks `crank_rev` revolutions further on, `elapsed_s` after what drifts or changes by itself began
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

    /// Turns the pumps until their cylinders repeat themselves, chambers standing as they are, and ends where cranks
    /// stand now.
    fn settle_cylinders(&mut self, inputs: &[R]) {
        let plant = Arc::clone(&self.plant);
        let held = self.state;
        // One tick tells the speeds; a tick need not be a whole number of revolutions, so cranks start as far back.
        self.tick(inputs);
        self.state = held;
        let time = R::splat(plant.tick_s() * SETTLING_TICKS as f64);
        for (phase, speed) in self.state.phase.iter_mut().zip(&self.scratch.speeds) {
            *phase = (*phase - *speed * time).map(|p| p - p.floor());
        }
        // A revolution forgets about a third of its start (the outlet valve is tight), so thirty leave 1e-5 of it.
        for _ in 0..SETTLING_TICKS {
            self.tick(inputs);
            for node in (0..plant.chambers).chain(plant.slow_states()) {
                if let (Some(slot), Some(value)) = (self.state.x.get_mut(node), held.x.get(node)) {
                    *slot = *value;
                }
            }
            // What comes with time stands still meanwhile, too.
            self.state.ticks = held.ticks;
        }
        self.state.phase = held.phase;
        self.state.memory = held.memory;
    }

    /// Which start suits a recording whose first readings are these.
    pub fn start_for(&self, readings_kpa: &[R]) -> FreeRunStart {
        FreeRunStart::for_readings(readings_kpa)
    }

    /// For a held rig: what each of `chambers` gains in kg/s while they are at `pressures` (absolute, in Pa).
    pub(crate) fn gains_of_held(&mut self, chambers: &[usize], pressures: &[R], inputs: &[R]) -> Vec<R> {
        for (chamber, pressure) in chambers.iter().zip(pressures) {
            if let Some(slot) = self.state.x.get_mut(*chamber) {
                *slot = *pressure;
            }
        }
        self.run_averaged(inputs);
        self.tick(inputs);
        let plant = Arc::clone(&self.plant);
        let gain = |chamber: &usize, held: &R| {
            let gained = self.state.x.get(*chamber).copied().unwrap_or(*held) - *held;
            gained / plant.pa_per_kg(*chamber, &self.state.x, R::splat(0.0)) / R::splat(plant.tick_s())
        };
        chambers.iter().zip(pressures).map(|(chamber, held)| gain(chamber, held)).collect()
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
    fn run_averaged(&mut self, inputs: &[R]) {
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

    /// What a recording does not tell about its start, in the order of [`Simulation::set_unknown`].
    pub fn unknowns(&self) -> impl Iterator<Item = &Unknown> + '_ {
        self.plant.unknowns.iter().map(|placed| &placed.unknown)
    }

    /// Sets number `index` of [`Simulation::unknowns`]; to be called after [`Simulation::start_from`] or at the start,
    /// once for each: a flapper is moved from where it lies. Another crank angle lets the cylinders of a running pump
    /// settle anew, which takes as long as thirty ticks.
    pub fn set_unknown(&mut self, index: usize, value: R) {
        let plant = Arc::clone(&self.plant);
        match plant.unknowns.get(index).map(|placed| placed.slot) {
            Some(Slot::Heat { memory }) => {
                if let Some(heat) = self.state.memory.get_mut(memory..memory + Heat::MEMORY) {
                    heat.fill(value);
                }
            }
            Some(Slot::Play { path }) => {
                if let Some(path) = plant.commands.get(path) {
                    path.place_in_play(value, &mut self.state.memory);
                }
            }
            Some(Slot::Stick { path }) => {
                if let Some(path) = plant.commands.get(path) {
                    path.place_in_friction(value, &mut self.state.memory);
                }
            }
            Some(Slot::Held { vent }) => {
                if let Some(vent) = plant.shaped_vents.get(vent)
                    && let Some(held) = vent.held.and_then(|slot| self.state.memory.get_mut(slot))
                {
                    *held += vent.band * value;
                }
            }
            Some(Slot::Phase { drive }) => {
                if let Some(phase) = self.state.phase.get_mut(drive) {
                    *phase = value;
                }
                if let Some(inputs) = self.settled.take() {
                    self.settle_cylinders(&inputs);
                    self.settled = Some(inputs);
                }
            }
            None => {}
        }
    }

    /// What a rig at rest has in coils, muscles and averaged pumps.
    fn rest(&mut self) {
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

    fn reset_temperatures(&mut self) {
        for chamber in &self.plant.thermal {
            if let Some(slot) = self.state.x.get_mut(chamber.temperature) {
                *slot = chamber.wall_temperature;
            }
        }
    }

    fn reset_sensors(&mut self) {
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
