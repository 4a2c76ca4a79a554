//! Errors of the feed-forward PI on a rig and a reference: the yardstick that a run is judged by.
//!
//! The rig is simulated in lockstep behind the sensors and the converter of the emulated cRIO, with the same model,
//! reference and seed as the run, and without its faults. Off the tick and off the wire: a minute takes about a second.

use flight::{OnWhichRig, Pacing, RunYardstick, StatisticsOptions};
use model::rig::{Rig, RigError};
use proto::emulator::{EmulatedPlant, Sensors, rig_and_crio};
use proto::recording::{Arrival, TickRecord};
use proto::reference::Reference;
use proto::wire::Mode;

use crate::cycle::duty_source::{ActuatorCommand, DutySource, VENT};
use crate::cycle::reference_tracking::ReferenceTracking;
use crate::cycle::sensing::Sensing;
use crate::state::{FRAMES_TO_ARM, State};

/// Runs longer than this are judged by their first so many seconds: by then the figures no longer change, and the
/// yardstick would take minutes.
const LONGEST_S: f64 = 120.0;
/// Ticks per second.
const RATE_HZ: f64 = 50.0;

/// RMSE of the clairvoyant optimum on the paper's reference (kPa; positive, negative), for a run of [`OPTIMUM_S`]:
/// measured with `trainer evaluate comparison`, `docs/runs/limit/table.md`.
const OPTIMUM_KPA: [(&str, [f64; 2]); 2] = [("dual_pressure", [0.064, 0.007]), ("bench", [0.079, 0.017])];
/// Length of the runs that [`OPTIMUM_KPA`] was taken from.
const OPTIMUM_S: f64 = 60.0;

/// Trial that is to be simulated.
pub struct Trial<'a> {
    /// The rig that is driven, where it is known; otherwise the model stands for it.
    pub rig: Option<&'a Rig>,
    /// The model behind the feed-forward and the predictions.
    pub model: &'a Rig,
    /// Reference that is followed.
    pub reference: Reference,
    /// Length from arming on.
    pub seconds: f64,
    /// Seed of the converter's noise.
    pub seed: u64,
}

/// Runs the feed-forward PI and says what it reached.
///
/// # Errors
/// If rig or model cannot be driven by the controller.
pub fn yardstick(trial: Trial<'_>) -> Result<RunYardstick, RigError> {
    let rig = trial.rig.unwrap_or(trial.model);
    let optimum_kpa = optimum_kpa(rig, &trial);
    let on = if trial.rig.is_some() { OnWhichRig::TheRig } else { OnWhichRig::TheModel };
    let options = StatisticsOptions { pacing: Pacing::Lockstep, ..StatisticsOptions::default() };
    let mut statistics = flight::FlightStatistics::new(options);
    let (mut plant, crio) = rig_and_crio(rig)?;
    let mut sensors = Sensors::new(crio.scales, Sensors::ADC_NOISE_V_RMS, trial.seed);
    let sensing = Sensing::of(trial.model)?;
    let mut control = ReferenceTracking::new(trial.model, None, trial.reference)?;
    let ticks = (trial.seconds.min(LONGEST_S) * RATE_HZ).round() as u32;
    let mut command = ActuatorCommand::VENT;
    for tick in 0..ticks.saturating_add(FRAMES_TO_ARM) {
        let volts = sensors.sample(plant.pressures_gauge_kpa(), [&[], &[]]);
        let Ok(measured) = sensing.pressures_kpa(&volts) else { break };
        let mut record = TickRecord { session: 1, tick, arrival: Arrival::InTime, ..TickRecord::default() };
        [record.p_pos_kpa, record.p_neg_kpa] = measured;
        if tick == FRAMES_TO_ARM {
            control.armed(tick, measured);
        }
        if tick >= FRAMES_TO_ARM {
            control.predict(measured, &mut record);
            let decided = control.decide(tick, measured, &mut record, &mut |_| {});
            command = decided.unwrap_or(ActuatorCommand::VENT);
            control.sent(&command);
            (record.mode, record.state) = (Mode::Run.code(), State::Run.code());
        }
        [record.u_pos, record.u_neg] = command.duty;
        statistics.push(&record);
        // The wire carries single precision.
        let duty = if tick >= FRAMES_TO_ARM { command.duty.map(|u| f64::from(u as f32)) } else { VENT };
        EmulatedPlant::tick(&mut plant, duty, command.pump_on);
    }
    let rmse = |channel| statistics.channel(channel).and_then(flight::tracking::Tracking::rmse_kpa);
    Ok(RunYardstick { fallback_kpa: [rmse(0), rmse(1)], optimum_kpa, on })
}

/// The clairvoyant optimum, where it was measured: on a built-in rig, the paper's reference, a minute of it.
fn optimum_kpa(rig: &Rig, trial: &Trial<'_>) -> Option<[f64; 2]> {
    let known = |(name, _): &&(&str, [f64; 2])| Rig::builtin(name).is_ok_and(|builtin| builtin == *rig);
    let same = trial.reference == Reference::paper() && trial.seconds == OPTIMUM_S;
    OPTIMUM_KPA.iter().find(known).map(|(_, kpa)| *kpa).filter(|_| same && trial.rig.is_some())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The table of `trainer evaluate comparison`, made by another program: 0.180/0.189 on `bench` (docs/control.md).
    #[test]
    fn the_fallback_reaches_what_the_evaluation_says() {
        let (rig, model) = (Rig::builtin("bench").unwrap(), Rig::builtin("dual_pressure").unwrap());
        let trial = Trial { rig: Some(&rig), model: &model, reference: Reference::paper(), seconds: 60.0, seed: 1 };
        let found = yardstick(trial).unwrap();
        println!("{found:?}");
        let [pos, neg] = found.fallback_kpa.map(Option::unwrap);
        // Another noise, another first second: a tenth.
        assert!((pos / 0.180 - 1.0).abs() < 0.1 && (neg / 0.189 - 1.0).abs() < 0.1, "{pos} {neg}");
        assert_eq!(found.optimum_kpa, Some([0.079, 0.017]));
    }

    #[test]
    fn an_optimum_is_given_only_for_what_it_was_measured_on() {
        let model = Rig::builtin("dual_pressure").unwrap();
        let rig = model.clone();
        let of = |seconds: f64, reference: Reference, rig: Option<&Rig>| {
            optimum_kpa(rig.unwrap_or(&model), &Trial { rig, model: &model, reference, seconds, seed: 1 })
        };
        assert_eq!(of(60.0, Reference::paper(), Some(&rig)), Some([0.064, 0.007]));
        assert_eq!(of(30.0, Reference::paper(), Some(&rig)), None);
        assert_eq!(of(60.0, Reference::constant(90.0, -70.0), Some(&rig)), None);
        assert_eq!(of(60.0, Reference::paper(), None), None, "a model is no rig");
    }
}
