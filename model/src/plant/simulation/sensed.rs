//! Numbers of a simulation that an observer needs: the way in which sensors follow their chambers in a tick, and both moved by a little.

use super::Simulation;
use crate::plant::dispatch::Simulated;
use crate::plant::{MEMORY, Plant};
use crate::real::Real;

/// The most numbers that a sensor remembers: two lags, and an answer with its speed.
pub(crate) const MOST_SENSED: usize = 4;

/// The least absolute pressure that a correction leaves in a chamber, in Pa: formulas of flow need some.
const LEAST_PA: f64 = 1e3;

/// A sensor with a memory, as a linear system over one tick. All pressures are in one unit, whichever.
///
/// ```text
/// m(τ+1) = A m(τ) + B P,        y = h m + h_P P        (P held over the tick)
/// ```
#[derive(Debug, Clone)]
pub(crate) struct SensorSystem<R> {
    /// Numbers that it remembers, at most [`MOST_SENSED`].
    pub(crate) count: usize,
    /// `A`, row by row.
    pub(crate) transition: [[R; MOST_SENSED]; MOST_SENSED],
    /// `B`.
    pub(crate) input: [R; MOST_SENSED],
    /// `h`.
    pub(crate) output: [R; MOST_SENSED],
    /// `h_P`.
    pub(crate) direct: R,
    /// Reading per pressure, the sensor's gain.
    pub(crate) gain: R,
}

impl<R: Real> Plant<R> {
    /// Where the memory of sensor `index` lives, in the order of [`SensorSystem`].
    fn sensed(&self, index: usize) -> [Option<usize>; MOST_SENSED] {
        let Some(sensor) = self.sensors.get(index) else { return [None; MOST_SENSED] };
        [sensor.memory, sensor.second, sensor.response, sensor.response.map(|m| m + 1)]
    }

    /// Sensor `index` over a tick; `None` if it reads what is there.
    pub(crate) fn sensor_system(&self, index: usize) -> Option<SensorSystem<R>> {
        let sensor = self.sensors.get(index)?;
        let slots: Vec<usize> = self.sensed(index).into_iter().flatten().collect();
        if slots.is_empty() {
            return None;
        }
        let (zero, one) = (R::splat(0.0), R::splat(1.0));
        let followed = |start: Option<usize>, pressure: R| {
            let mut memory = [zero; MEMORY];
            if let Some(slot) = start.and_then(|m| memory.get_mut(m)) {
                *slot = one;
            }
            for _ in 0..self.steps {
                sensor.follow([pressure; 2], &mut memory);
            }
            memory
        };
        let mut system = SensorSystem {
            count: slots.len(),
            transition: [[zero; MOST_SENSED]; MOST_SENSED],
            input: [zero; MOST_SENSED],
            output: [zero; MOST_SENSED],
            direct: zero,
            gain: sensor.gain,
        };
        let forced = followed(None, one);
        for (row, slot) in slots.iter().enumerate() {
            system.input[row] = forced.get(*slot).copied().unwrap_or(zero);
        }
        for (column, from) in slots.iter().enumerate() {
            let free = followed(Some(*from), zero);
            for (row, slot) in slots.iter().enumerate() {
                system.transition[row][column] = free.get(*slot).copied().unwrap_or(zero);
            }
        }
        // y = (1 − c) (lagged or the pressure itself) + c (what answers).
        let share = if sensor.response.is_some() { sensor.share } else { zero };
        match sensor.lagged().and_then(|m| slots.iter().position(|slot| *slot == m)) {
            Some(at) => system.output[at] = one - share,
            None => system.direct = one - share,
        }
        if let Some(at) = sensor.response.and_then(|m| slots.iter().position(|slot| *slot == m)) {
            system.output[at] = share;
        }
        Some(system)
    }
}

impl<R: Simulated> Simulation<R> {
    /// Moves the chamber under sensor `index` by so much (Pa), to no less than a hundredth of an atmosphere.
    ///
    /// # Real-time
    /// May run in the tick.
    pub(crate) fn move_sensed_pressure(&mut self, index: usize, by_pa: R) {
        let Some(node) = self.plant.sensors.get(index).map(|sensor| sensor.node) else { return };
        if let Some(slot) = self.state.x.get_mut(node) {
            *slot = (*slot + by_pa).at_least(R::splat(LEAST_PA));
        }
    }

    /// Moves what sensor `index` remembers by so much (Pa), in the order of [`SensorSystem`].
    ///
    /// # Real-time
    /// May run in the tick.
    pub(crate) fn move_sensor_memory(&mut self, index: usize, by_pa: &[R; MOST_SENSED]) {
        let slots = self.plant.sensed(index);
        for (slot, by) in slots.into_iter().flatten().zip(by_pa) {
            if let Some(remembered) = self.state.memory.get_mut(slot) {
                *remembered += *by;
            }
        }
    }

    /// Reading of sensor `index` (kPa gauge) if neither lag nor swing stood before it; gain, bias and drift are in it.
    ///
    /// # Real-time
    /// May run in the tick.
    pub(crate) fn undelayed_kpa(&self, index: usize) -> R {
        let Some(sensor) = self.plant.sensors.get(index) else { return R::splat(f64::NAN) };
        let gauge_kpa = (self.pressure_pa(sensor.node) - self.plant.atmosphere_pa) * R::splat(1e-3);
        sensor.reading(gauge_kpa, self.time_s())
    }
}
