//! One rig, one controller, one reference: a flight without sockets and clocks, tick by tick as in the daemon.

use law::{ControlInput, ControlOutput, Fallback, PolicyLaw, SoftStart, TICK_S};
use model::observation::{ACTION_LEN, AHEAD, ActionTrajectory, CHANNELS, CORRECTION_OBSERVATION_LEN, Pair};
use model::predict::{DualPressureRig, Predictor};
use model::rig::Rig;
use model::shown_reference::ShownReference;
use proto::emulator::{EmulatedPlant, Sensors, check_tick};
use proto::reference::Reference;

use crate::{EnvironmentError, sensor_scales};

/// Both vents open: how a rig is found.
const VENT: Pair = [1.0; CHANNELS];

/// Whatever decides duties.
pub trait Controller {
    /// Starts anew, with `duty` long in force.
    fn restart(&mut self, duty: Pair);
    /// Decides the duties of a tick, given what the model predicts for the next five.
    fn decide(&mut self, situation: &ControlInput, predicted_kpa: &[Pair; AHEAD]) -> ControlOutput;
    /// Takes note of what was sent.
    fn applied(&mut self, duty: Pair);
}

impl Controller for Fallback {
    fn restart(&mut self, _duty: Pair) {
        Fallback::restart(self);
    }

    fn decide(&mut self, situation: &ControlInput, _predicted_kpa: &[Pair; AHEAD]) -> ControlOutput {
        Fallback::decide(self, situation)
    }

    fn applied(&mut self, duty: Pair) {
        Fallback::applied(self, duty);
    }
}

/// A policy in its law; `run` maps an observation to twelve outputs in the contract's units.
pub struct PolicyController<F> {
    law: PolicyLaw,
    run: F,
}

impl<F: FnMut(&[f32]) -> [f32; ACTION_LEN]> PolicyController<F> {
    /// Flies `run` in `law`.
    pub fn new(law: PolicyLaw, run: F) -> Self {
        PolicyController { law, run }
    }
}

impl<F: FnMut(&[f32]) -> [f32; ACTION_LEN]> Controller for PolicyController<F> {
    fn restart(&mut self, duty: Pair) {
        self.law.restart(duty);
    }

    fn decide(&mut self, situation: &ControlInput, predicted_kpa: &[Pair; AHEAD]) -> ControlOutput {
        self.law.observe(situation);
        let mut observation = [0.0; CORRECTION_OBSERVATION_LEN];
        let told = observation.get_mut(..self.law.contract().observation_len()).unwrap_or_default();
        self.law.write_observation(situation, predicted_kpa, told);
        let outputs = (self.run)(told);
        self.law.decide(situation, &outputs)
    }

    fn applied(&mut self, duty: Pair) {
        self.law.applied(duty);
    }
}

/// One tick of a flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlownTick {
    /// Readings that the sensors showed, noise and converter included, in kPa gauge.
    pub measured_kpa: Pair,
    /// Pressures that there were to show.
    pub true_kpa: Pair,
    /// The reference as given.
    pub goal_kpa: Pair,
    /// Readings of the rig's sensors with the chambers on it: the reference itself where none of them is late.
    pub shown_goal_kpa: Pair,
    /// The duties that were sent.
    pub duty: Pair,
}

/// A flight.
#[derive(Debug, Clone, PartialEq)]
pub struct Flown {
    /// Ticks.
    pub ticks: Vec<FlownTick>,
}

/// Plan of a flight.
#[derive(Debug, Clone, Copy)]
pub struct FlightPlan<'a> {
    /// The rig that is flown.
    pub rig: &'a Rig,
    /// The model behind MPObs; `None` tells the controller that everything stays as it is.
    pub model: Option<&'a Rig>,
    /// The reference.
    pub reference: &'a Reference,
    /// Length, in s.
    pub seconds: f64,
    /// Noise of the converter in V RMS.
    pub noise_v_rms: f64,
    /// Seed of the noise.
    pub seed: u64,
}

/// Flies: from rest and vented, along an approach to where the reference begins, then along the reference.
///
/// # Errors
/// If the rig or the model cannot be flown.
pub fn fly(plan: &FlightPlan<'_>, controller: &mut impl Controller) -> Result<Flown, EnvironmentError> {
    Ok(fly_while(plan, controller, &mut || true)?.unwrap_or(Flown { ticks: Vec::new() }))
}

/// As [`fly`], as long as `goes_on` says so, which is asked in every tick; nothing where it ends the flight.
///
/// # Errors
/// As [`fly`].
pub fn fly_while(
    plan: &FlightPlan<'_>,
    controller: &mut impl Controller,
    goes_on: &mut dyn FnMut() -> bool,
) -> Result<Option<Flown>, EnvironmentError> {
    let mut plant = DualPressureRig::new(plan.rig).map_err(EnvironmentError::rig(plan.rig))?;
    fly_plant(plan, &mut plant, controller, goes_on)
}

/// As [`fly_while`], with a plant that may be another one than `plan.rig`, of which the sensors' scales and lags are taken.
///
/// # Errors
/// As [`fly`].
pub fn fly_plant(
    plan: &FlightPlan<'_>,
    plant: &mut dyn EmulatedPlant,
    controller: &mut impl Controller,
    goes_on: &mut dyn FnMut() -> bool,
) -> Result<Option<Flown>, EnvironmentError> {
    for rig in std::iter::once(plan.rig).chain(plan.model) {
        check_tick(rig).map_err(EnvironmentError::rig(rig))?;
    }
    let scales = sensor_scales(plan.rig)?;
    let mut predictor = match plan.model {
        Some(model) => Some(Predictor::new(model).map_err(EnvironmentError::rig(model))?),
        None => None,
    };
    let mut sensors = Sensors::new(scales, plan.noise_v_rms, plan.seed);
    let count = (plan.seconds / TICK_S).round() as usize;
    let mut ticks = Vec::with_capacity(count);
    let mut trajectory = ActionTrajectory::held(VENT);
    let mut approach = None;
    let mut shown_reference = ShownReference::of(plan.rig);
    for tick in 0..count {
        if !goes_on() {
            return Ok(None);
        }
        let true_kpa = plant.pressures_gauge_kpa();
        let volts = sensors.sample(true_kpa, [&[], &[]]);
        let measured_kpa: Pair = std::array::from_fn(|c| scales[c].gauge_kpa(f64::from(volts[c])));
        if approach.is_none() {
            controller.restart(VENT);
            if let Some(predictor) = &mut predictor {
                predictor.restart(measured_kpa, VENT);
            }
        }
        let approach = *approach.get_or_insert_with(|| SoftStart::new(measured_kpa, plan.reference.at(0.0)));
        let goals_kpa = std::array::from_fn(|j| {
            let time_s = (tick + j) as f64 * TICK_S;
            let (goal, offset) = (plan.reference.at(time_s), approach.offset_kpa(time_s));
            std::array::from_fn(|c| goal[c] + offset[c])
        });
        let (undelayed_kpa, predicted) = match &mut predictor {
            Some(predictor) => {
                let undelayed_kpa = predictor.observe(measured_kpa);
                (undelayed_kpa, predictor.predict(&trajectory.remaining(), true))
            }
            None => (measured_kpa, [measured_kpa; AHEAD]),
        };
        let decision = controller
            .decide(&ControlInput { undelayed_kpa, ..ControlInput::of_measured(measured_kpa, goals_kpa) }, &predicted);
        let duty = decision.duty();
        trajectory = decision.trajectory;
        controller.applied(duty);
        if let Some(predictor) = &mut predictor {
            predictor.advance(duty, true);
        }
        let goal_kpa = plan.reference.at(tick as f64 * TICK_S);
        let shown_goal_kpa = shown_reference.next_kpa(1, goal_kpa);
        ticks.push(FlownTick { measured_kpa, true_kpa, goal_kpa, shown_goal_kpa, duty });
        plant.tick(duty, true);
    }
    Ok(Some(Flown { ticks }))
}
