//! A plant in motion.

use std::sync::Arc;

use super::dispatch::{InstructionSet, Simulated};
use super::{MEMORY, MOST_DRIVES, NODES, Plant, Scratch, State};

/// A plant with its state and everything a tick needs.
///
/// Pressures are absolute Pa unless a name says kPa, which is gauge.
#[derive(Debug, Clone)]
pub struct Simulation<R> {
    plant: Arc<Plant<R>>,
    state: State<R>,
    scratch: Scratch<R>,
    set: InstructionSet,
}

/// How a free run guesses what recordings do not tell: the pressures in the cylinders.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FreeRunStart {
    /// The rig stood still: cylinders at atmospheric pressure.
    AtRest,
    /// The pump was running: cylinders as they are once periodic.
    Running,
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
        let mut simulation = Simulation { plant, state, scratch, set };
        simulation.reset_temperatures();
        simulation.reset_sensors();
        simulation
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
            self.state.x.get(index).copied().unwrap_or(R::splat(f64::NAN))
        } else {
            R::splat(f64::NAN)
        }
    }

    /// Gauge pressure of chamber `index` in kPa, without any sensor in between.
    pub fn pressure_kpa(&self, index: usize) -> R {
        (self.pressure_pa(index) - self.plant.atmosphere_pa) * R::splat(1e-3)
    }

    /// Sets the absolute pressure of chamber `index` in Pa (and nothing else).
    pub fn set_pressure_pa(&mut self, index: usize, pressure: R) {
        if index < self.plant.chambers
            && let Some(slot) = self.state.x.get_mut(index)
        {
            *slot = pressure;
        }
    }

    /// Sets the chambers under the given sensors to what these measured (kPa gauge), and the sensors with them.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn correct(&mut self, sensors: &[usize], measured_kpa: &[R]) {
        for (index, measured) in sensors.iter().zip(measured_kpa) {
            let Some(sensor) = self.plant.sensors.get(*index).copied() else { continue };
            let pressure = self.plant.atmosphere_pa + *measured * R::splat(1e3);
            self.set_pressure_pa(sensor.node, pressure);
            if let Some(slot) = sensor.memory.and_then(|m| self.state.memory.get_mut(m)) {
                *slot = pressure;
            }
        }
    }

    /// What sensor `index` reads, in gauge kPa; NaN beyond the last sensor.
    pub fn reading_kpa(&self, index: usize) -> R {
        let Some(sensor) = self.plant.sensors.get(index) else { return R::splat(f64::NAN) };
        let lagged = sensor.memory.and_then(|m| self.state.memory.get(m)).copied();
        let pressure = lagged.unwrap_or_else(|| self.pressure_pa(sensor.node));
        (pressure - self.plant.atmosphere_pa) * R::splat(1e-3)
    }

    /// All readings in gauge kPa, in the order of [`Plant::sensor_columns`].
    pub fn readings_kpa(&self) -> impl Iterator<Item = R> + '_ {
        (0..self.plant.sensors.len()).map(|i| self.reading_kpa(i))
    }

    /// Sets the memory of the command paths as if `inputs` had been commanded for ever.
    pub fn settle_commands(&mut self, inputs: &[R]) {
        let plant = Arc::clone(&self.plant);
        for path in &plant.commands {
            if let Some(duty) = inputs.get(path.input) {
                path.settle(*duty, &mut self.state.memory);
            }
        }
    }

    /// Starts a free run: sensors read `readings_kpa` (gauge), `inputs` have long been commanded, the crank
    /// is at zero; cylinders as `start` says.
    ///
    /// A chamber without a sensor starts at atmospheric pressure.
    pub fn start_from(&mut self, readings_kpa: &[R], inputs: &[R], start: FreeRunStart) {
        let fresh = Simulation::on(Arc::clone(&self.plant), self.set);
        self.state = fresh.state;
        let plant = Arc::clone(&self.plant);
        for (sensor, reading) in plant.sensors.iter().zip(readings_kpa) {
            self.set_pressure_pa(sensor.node, plant.atmosphere_pa + *reading * R::splat(1e3));
        }
        self.settle_commands(inputs);
        if start == FreeRunStart::Running {
            // With the chambers put back after each tick the cylinders become periodic: a revolution forgets
            // about a third of its start (the outlet valve is tight), so thirty leave 1e-5 of it.
            let held = self.state;
            for _ in 0..SETTLING_TICKS {
                self.tick(inputs);
                for node in (0..plant.chambers).chain(plant.thermal.iter().map(|t| t.temperature)) {
                    if let (Some(slot), Some(value)) = (self.state.x.get_mut(node), held.x.get(node)) {
                        *slot = *value;
                    }
                }
            }
            self.state.phase = held.phase;
            self.state.memory = held.memory;
            self.state.ticks = 0;
        }
        self.reset_sensors();
    }

    /// Which start suits a recording whose first readings are these.
    pub fn start_for(&self, readings_kpa: &[R]) -> FreeRunStart {
        let close = R::splat(AT_REST_PA * 1e-3);
        let off = readings_kpa.iter().any(|p| p.any_above(close) || (-*p).any_above(close));
        if off { FreeRunStart::Running } else { FreeRunStart::AtRest }
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
            if let Some(slot) = sensor.memory.and_then(|m| self.state.memory.get_mut(m)) {
                *slot = pressure;
            }
        }
    }
}
