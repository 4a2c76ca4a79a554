//! A plant in motion.

use std::sync::Arc;

use super::dispatch::{InstructionSet, Simulated};
use super::sensor::Filter;
use super::unobserved::{Slot, UnobservedInitialState};
use super::{MEMORY, MOST_DRIVES, NODES, Plant, Scratch, State};
use crate::mechanism::Heat;

mod coils;
mod sensed;
mod start;
mod warmth;

pub(crate) use sensed::{MOST_SENSED, SensorSystem};
pub use start::FreeRunStart;

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
    /// True where averaged pumps leave no ripple on the pressures that are read.
    smooth: bool,
}

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

    /// Simulation with the ripple of averaged pumps left off all pressures: what readings would be at the mean of a turn.
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

    /// Pressure that the ripple of averaged pumps adds to the pressure of chamber `index` now, as it is seen through a filter.
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

    /// Reading of sensor `index`, in gauge kPa; NaN beyond the last sensor.
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

    /// For a held rig: what each of `chambers` gains in kg/s while they are at `pressures` (absolute, in Pa).
    pub(crate) fn gains_of_held(&mut self, chambers: &[usize], pressures: &[R], inputs: &[R]) -> Vec<R> {
        self.hold(chambers, pressures);
        self.run_averaged(inputs);
        self.gains_in_a_tick(chambers, pressures, inputs)
    }

    /// Gains while the pressures come to these from lower ones by `steps_pa` a tick, over so many ticks.
    pub(crate) fn gains_of_ramped(
        &mut self,
        chambers: &[usize],
        [pressures, steps_pa]: [&[R]; 2],
        ticks: usize,
        inputs: &[R],
    ) -> Vec<R> {
        let before = |ticks: usize| -> Vec<R> {
            let back = R::splat(ticks as f64);
            pressures.iter().zip(steps_pa).map(|(pressure, step)| *pressure - back * *step).collect()
        };
        self.hold(chambers, &before(ticks));
        self.run_averaged(inputs);
        for left in (1..ticks).rev() {
            self.hold(chambers, &before(left));
            self.tick(inputs);
        }
        self.hold(chambers, pressures);
        self.gains_in_a_tick(chambers, pressures, inputs)
    }

    fn hold(&mut self, chambers: &[usize], pressures: &[R]) {
        for (chamber, pressure) in chambers.iter().zip(pressures) {
            if let Some(slot) = self.state.x.get_mut(*chamber) {
                *slot = *pressure;
            }
        }
    }

    fn gains_in_a_tick(&mut self, chambers: &[usize], pressures: &[R], inputs: &[R]) -> Vec<R> {
        self.tick(inputs);
        let plant = Arc::clone(&self.plant);
        let gain = |chamber: &usize, held: &R| {
            let gained = self.state.x.get(*chamber).copied().unwrap_or(*held) - *held;
            gained / plant.pa_per_kg(*chamber, &self.state.x, R::splat(0.0)) / R::splat(plant.tick_s())
        };
        chambers.iter().zip(pressures).map(|(chamber, held)| gain(chamber, held)).collect()
    }

    /// Numbers that a recording does not tell about its start, in the order of [`Simulation::set_unknown`].
    pub fn unknowns(&self) -> impl Iterator<Item = &UnobservedInitialState> + '_ {
        self.plant.unknowns.iter().map(|placed| &placed.unknown)
    }

    /// Sets number `index` of [`Simulation::unknowns`]; to be called after [`Simulation::start_from`] or at the start,
    /// once for each: a flapper is moved from where it lies. Another crank angle lets the cylinders of a running pump
    /// settle anew, which takes as long as 0.6 s of the run.
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
}
