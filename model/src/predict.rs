//! Model-predicted observations (MPObs), paper §III-A2.
//!
//! The model runs along with the rig since start-up. At tick τ its chamber pressures are set to the measured
//! ones, or, behind a sensor that lags or swings, to what an observer makes of them (`crate::observer`); what is not
//! measured (cylinder pressures, crank angle, memory of mechanisms) stays the model's own. From there the actions planned one tick ago for τ … τ+4 roll a copy forward to õ(τ+1) … õ(τ+5).

mod averaged;

use std::sync::Arc;

use crate::observation::{AHEAD, CHANNELS};
use crate::observer::Observer;
use crate::plant::{FreeRunStart, Plant, Simulated, Simulation, State};
use crate::real::{Lanes, Real};
use crate::rig::{Rig, RigError};

/// Where a rig's inputs and sensors are that the controller needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DualPressurePorts {
    duty: [usize; CHANNELS],
    pump_on: Option<usize>,
    sensor: [usize; CHANNELS],
}

/// The most inputs a rig flown by the controller may have: two duties, the pump's relay, and one to spare.
const MOST_INPUTS: usize = 4;

impl DualPressurePorts {
    /// Input columns of the duties.
    pub const DUTY: [&'static str; CHANNELS] = ["u_pos", "u_neg"];
    /// Recording columns of the readings.
    pub const READING: [&'static str; CHANNELS] = ["p_pos_kpa", "p_neg_kpa"];
    /// Input column of the pump's relay.
    pub const PUMP_ON: &'static str = "pump_on";

    /// Finds the ports of a compiled rig.
    ///
    /// # Errors
    /// Names the input or sensor that the rig lacks, or an input that the controller cannot serve.
    pub fn of<R: Real>(plant: &Plant<R>) -> Result<Self, RigError> {
        let missing = |what: &str, column: &str| {
            RigError::at(what, format!("no {what} uses column `{column}`; a rig for this controller needs it"))
        };
        let mut duty = [0; CHANNELS];
        for (slot, column) in duty.iter_mut().zip(Self::DUTY) {
            *slot = plant.inputs().iter().position(|i| i.column == column).ok_or_else(|| missing("valves", column))?;
        }
        let mut sensor = [0; CHANNELS];
        for (slot, column) in sensor.iter_mut().zip(Self::READING) {
            *slot =
                plant.sensor_columns().iter().position(|c| c == column).ok_or_else(|| missing("sensors", column))?;
        }
        let pump_on = plant.inputs().iter().position(|i| i.column == Self::PUMP_ON);
        let known = |i: usize| duty.contains(&i) || pump_on == Some(i);
        if let Some((_, extra)) = plant.inputs().iter().enumerate().find(|(i, _)| !known(*i)) {
            return Err(RigError::at(
                "",
                format!("input `{}` is neither a duty nor `pump_on`; the controller cannot serve it", extra.column),
            ));
        }
        Ok(DualPressurePorts { duty, pump_on, sensor })
    }

    /// The inputs of a tick, in the order of [`Plant::inputs`].
    fn inputs<R: Real>(&self, duty: [R; CHANNELS], pump_on: bool) -> [R; MOST_INPUTS] {
        let mut inputs = [R::splat(0.0); MOST_INPUTS];
        let relay = R::splat(f64::from(u8::from(pump_on)));
        for (at, value) in self.duty.into_iter().zip(duty).chain(self.pump_on.map(|at| (at, relay))) {
            if let Some(slot) = inputs.get_mut(at) {
                *slot = value;
            }
        }
        inputs
    }
}

/// A dual-pressure rig that is driven by two duties and a relay and read by two sensors; `R` is one rig or several.
#[derive(Debug, Clone)]
pub struct DualPressureRig<R = f64> {
    simulation: Simulation<R>,
    ports: DualPressurePorts,
}

impl DualPressureRig {
    /// Compiles a rig, at rest.
    ///
    /// # Errors
    /// If the rig is unsound or lacks a port (see [`DualPressurePorts::of`]).
    pub fn new(rig: &Rig) -> Result<Self, RigError> {
        Self::of(Plant::new(rig)?)
    }
}

impl<const N: usize> DualPressureRig<Lanes<N>>
where
    Lanes<N>: Simulated,
{
    /// Compiles `N` rigs of one structure, at rest, to be driven each by its own duties.
    ///
    /// # Errors
    /// As [`DualPressureRig::new`], or if the rigs differ in more than numbers.
    pub fn side_by_side(rigs: &[Rig; N]) -> Result<Self, RigError> {
        Self::of(Plant::side_by_side(rigs)?)
    }

    /// Puts one lane's chambers at the given gauge pressures in kPa, as [`DualPressureRig::start_from`] does with
    /// all of them; the others go on as they are. Runs the pump for some thirty ticks.
    pub fn restart_lane(&mut self, lane: usize, readings_kpa: [f64; CHANNELS], duty: [f64; CHANNELS]) {
        let mut others = self.simulation.state();
        self.start_from(readings_kpa.map(Lanes::splat), duty.map(Lanes::splat));
        others.take_lane(lane, &self.simulation.state());
        self.simulation.restore(&others);
    }
}

impl<R: Simulated> DualPressureRig<R> {
    fn of(plant: Plant<R>) -> Result<Self, RigError> {
        let ports = DualPressurePorts::of(&plant)?;
        Ok(DualPressureRig { simulation: Simulation::new(Arc::new(plant)), ports })
    }

    /// Advances by one tick.
    ///
    /// # Real-time
    /// Bounded and allocation-free: it may run in the tick.
    pub fn tick(&mut self, duty: [R; CHANNELS], pump_on: bool) {
        let inputs = self.ports.inputs(duty, pump_on);
        self.simulation.tick(&inputs);
    }

    /// Readings of the two sensors, in kPa gauge.
    pub fn readings_kpa(&self) -> [R; CHANNELS] {
        self.ports.sensor.map(|i| self.simulation.reading_kpa(i))
    }

    /// Puts both chambers at the given gauge pressures in kPa, as if the duties had long been `duty`.
    pub fn start_from(&mut self, readings_kpa: [R; CHANNELS], duty: [R; CHANNELS]) {
        let mut readings = [R::splat(0.0); CHANNELS];
        for (at, value) in self.ports.sensor.into_iter().zip(readings_kpa) {
            if let Some(slot) = readings.get_mut(at) {
                *slot = value;
            }
        }
        let start = self.simulation.start_for(&readings);
        self.simulation.start_from(&readings, &self.ports.inputs(duty, start == FreeRunStart::Running), start);
    }

    /// Sets the chamber pressures to measured ones (kPa gauge) and leaves everything else; sensors that lag with them.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn correct(&mut self, measured_kpa: [R; CHANNELS]) {
        self.simulation.correct(&self.ports.sensor, &measured_kpa);
    }
}

/// The model behind MPObs, for one rig or for several side by side.
#[derive(Debug, Clone)]
pub struct Predictor<R = f64> {
    model: DualPressureRig<R>,
    observer: Observer<R>,
    /// The model as it was given.
    first: State<R>,
}

impl Predictor {
    /// Compiles the model from a rig.
    ///
    /// # Errors
    /// As [`DualPressureRig::new`].
    pub fn new(rig: &Rig) -> Result<Self, RigError> {
        Ok(Predictor::with(DualPressureRig::new(rig)?))
    }
}

impl<const N: usize> Predictor<Lanes<N>>
where
    Lanes<N>: Simulated,
{
    /// Starts one lane anew, as [`DualPressureRig::restart_lane`] does.
    pub fn restart_lane(&mut self, lane: usize, measured_kpa: [f64; CHANNELS], duty: [f64; CHANNELS]) {
        self.model.restart_lane(lane, measured_kpa, duty);
        self.observer.restart_lane(lane);
    }
}

impl<R: Simulated> Predictor<R> {
    /// Predicts with a model that was compiled before.
    pub fn with(model: DualPressureRig<R>) -> Self {
        let observer = Observer::of(model.simulation.plant(), model.ports.sensor);
        let first = model.simulation.state();
        Predictor { model, observer, first }
    }

    /// Starts anew from measured pressures (kPa gauge), with the duties that have been in force.
    pub fn restart(&mut self, measured_kpa: [R; CHANNELS], duty: [R; CHANNELS]) {
        self.model.start_from(measured_kpa, duty);
        self.observer.restart();
    }

    /// Stands where another predictor of the same model stands.
    pub fn stand_where(&mut self, other: &Self) {
        self.model.restore(&other.model.state());
        self.observer.clone_from(&other.observer);
    }

    /// Begins anew from the state that the model was given in, with its chambers at measured pressures (kPa gauge): what is
    /// left to do for one that has diverged. Cylinders and valves find their places within some ticks.
    ///
    /// # Real-time
    /// Allocation-free, unlike [`Predictor::restart`]: it may run in the tick.
    pub fn recover(&mut self, measured_kpa: [R; CHANNELS]) {
        self.model.simulation.restore(&self.first);
        self.model.correct(measured_kpa);
        self.observer.restart();
    }

    /// Takes in what was measured at this tick, in kPa gauge; answers what the sensors would read if none of them lagged or
    /// swung: what was measured where none does, what the chambers have been estimated at otherwise.
    ///
    /// # Real-time
    /// Allocation-free and bounded: may run in the tick.
    pub fn observe(&mut self, measured_kpa: [R; CHANNELS]) -> [R; CHANNELS] {
        self.observer.correct(&mut self.model.simulation, measured_kpa);
        self.observer.undelayed_kpa(&self.model.simulation, measured_kpa)
    }

    /// Correction that the last reading made to each chamber beyond the model's own motion, in kPa as its sensor reads it: the
    /// error of the model's last tick. Where a sensor reads what is there, this is the reading less the one foreseen.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn added_kpa(&self) -> [R; CHANNELS] {
        self.observer.added_kpa()
    }

    /// Readings of the sensors by the model now (kPa gauge): before [`Predictor::observe`] what is foreseen for this tick.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn readings_kpa(&self) -> [R; CHANNELS] {
        self.model.readings_kpa()
    }

    /// Predicts the readings (kPa gauge) of the next five ticks under the given duties.
    ///
    /// # Real-time
    /// Five ticks of the model (1,000 RK4 steps on the paper's rig), allocation-free: it may run in the tick.
    pub fn predict(&mut self, duties: &[[R; CHANNELS]; AHEAD], pump_on: bool) -> [[R; CHANNELS]; AHEAD] {
        let now = self.model.simulation.state();
        let predicted = duties.map(|duty| {
            self.advance(duty, pump_on);
            self.model.readings_kpa()
        });
        self.model.simulation.restore(&now);
        predicted
    }

    /// Runs the model along through the tick, under the duties that were applied.
    ///
    /// # Real-time
    /// One tick of the model, allocation-free: it may run in the tick, after the command is out.
    pub fn advance(&mut self, applied: [R; CHANNELS], pump_on: bool) {
        self.model.tick(applied, pump_on);
        self.observer.disturb(&mut self.model.simulation);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observation::Pair;

    #[test]
    fn a_model_that_has_diverged_stands_where_the_rig_is_again() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        let (mut plant, mut predictor) = (DualPressureRig::new(&rig).unwrap(), Predictor::new(&rig).unwrap());
        let fly = |plant: &mut DualPressureRig, predictor: &mut Predictor, ticks: u32| {
            let mut last_kpa: f64 = 0.0;
            for _ in 0..ticks {
                predictor.observe(plant.readings_kpa());
                last_kpa = predictor.added_kpa()[0].abs().max(predictor.added_kpa()[1].abs());
                plant.tick([0.85, 0.83], true);
                predictor.advance([0.85, 0.83], true);
            }
            last_kpa
        };
        fly(&mut plant, &mut predictor, 200);
        predictor.observe([f64::NAN; CHANNELS]);
        predictor.advance([0.85, 0.83], true);
        assert!(!predictor.readings_kpa()[0].is_finite());
        predictor.recover(plant.readings_kpa());
        assert!(predictor.readings_kpa().iter().zip(plant.readings_kpa()).all(|(a, b)| (a - b).abs() < 1e-6));
        assert!(fly(&mut plant, &mut predictor, 50) < 0.1, "and foresees as before within a second");
    }

    #[test]
    fn a_perfect_model_predicts_what_comes() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        let (mut plant, mut predictor) = (DualPressureRig::new(&rig).unwrap(), Predictor::new(&rig).unwrap());
        let duty = |t: u32| [0.8 + 0.1 * f64::from(t % 7) / 7.0, 0.85 - 0.1 * f64::from(t % 5) / 5.0];
        let mut expected: Vec<[Pair; AHEAD]> = Vec::new();
        for t in 0..60 {
            let measured = plant.readings_kpa();
            predictor.observe(measured);
            for (back, predicted) in expected.iter().rev().take(AHEAD).enumerate() {
                for c in 0..CHANNELS {
                    // Readings pass through gauge kPa and back: a few roundings of 1e-11 Pa each.
                    assert!((predicted[back][c] - measured[c]).abs() < 1e-10, "tick {t}, {} ticks before", back + 1);
                }
            }
            expected.push(predictor.predict(&std::array::from_fn(|j| duty(t + j as u32)), true));
            plant.tick(duty(t), true);
            predictor.advance(duty(t), true);
        }
    }

    #[test]
    fn a_lane_that_is_restarted_leaves_the_others_alone() {
        let rigs: [Rig; 8] = std::array::from_fn(|_| Rig::builtin("bench").unwrap());
        let mut disturbed = DualPressureRig::side_by_side(&rigs).unwrap();
        disturbed.start_from([80.0, -70.0].map(Lanes::splat), [0.8, 0.8].map(Lanes::splat));
        let mut alone = disturbed.clone();
        let duty = |t: usize| [0.7 + 0.01 * t as f64, 0.9 - 0.01 * t as f64].map(Lanes::splat);
        for t in 0..20 {
            if t == 10 {
                disturbed.restart_lane(3, [60.0, -60.0], [1.0, 1.0]);
                let restarted = disturbed.readings_kpa().map(|p| p.lane(3));
                assert!((restarted[0] - 60.0).abs() < 1e-9 && (restarted[1] + 60.0).abs() < 1e-9, "{restarted:?}");
            }
            disturbed.tick(duty(t), true);
            alone.tick(duty(t), true);
        }
        for lane in (0..8).filter(|lane| *lane != 3) {
            assert_eq!(
                disturbed.readings_kpa().map(|p| p.lane(lane)),
                alone.readings_kpa().map(|p| p.lane(lane)),
                "lane {lane}"
            );
        }
    }

    #[test]
    fn a_rig_without_a_port_is_refused_by_name() {
        let text = crate::rig::DUAL_PRESSURE.replace("column = \"p_neg_kpa\"", "column = \"vacuum_kpa\"");
        let message = DualPressureRig::new(&Rig::from_toml(&text).unwrap()).unwrap_err().to_string();
        assert!(message.contains("p_neg_kpa"), "{message}");
    }
}
