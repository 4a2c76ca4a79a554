//! Construction of a cycle, for a reference and for a sequence of commands.

use model::observation::CHANNELS;
use model::rig::{Rig, RigError};
use monitor::Monitor;
use monitor::plausibility::Foresight;
use policy::Policy;
use proto::reference::Reference;
use safety_filter::{Envelope, SafetyFilter, SlewLimit};
use supervisor::{Arming, ConditionSet, Memory};

use super::Cycle;
use super::filtering::FilterWatch;
use crate::config::Safety;
use crate::cycle::duty_source::{ActuatorCommand, DutySource};
use crate::cycle::running_source::RunningSource;
use crate::cycle::sensing::Sensing;
use crate::experiment::command_sequence::Row;
use crate::experiment::open_loop_playback::OpenLoopPlayback;
use crate::experiment::pump_relay::PumpRelay;

impl Cycle<RunningSource> {
    /// A cycle that follows a reference on the rig that the model is made of.
    ///
    /// # Errors
    /// If the rig cannot be flown: unsound, or without the valves and sensors the controller needs.
    pub fn new(
        rig: &Rig,
        policy: Option<Policy>,
        reference: Reference,
        safety: Safety,
        arming: Arming,
    ) -> Result<Self, RigError> {
        let duty_source = RunningSource::new(rig, policy, reference)?;
        let filter = SafetyFilter::new(rig, envelope(safety), SlewLimit::DEFAULT)?;
        let monitor = Monitor::new(rig, Foresight::Judged)?;
        let parts = Parts { sensing: Sensing::of(rig)?, monitor, filter, safety };
        Ok(Cycle::with(duty_source, parts, arming))
    }
}

impl Cycle<OpenLoopPlayback> {
    /// A cycle that plays the rows of a sequence once, from rest, and arms itself for it.
    ///
    /// # Errors
    /// If the rig lacks one of the two sensors.
    pub fn playing(rig: &Rig, rows: Box<[Row]>, relay: PumpRelay, safety: Safety) -> Result<Self, RigError> {
        // Rows are played as they are; only what would leave the envelope is bent.
        let filter = SafetyFilter::new(rig, envelope(safety), SlewLimit::None)?;
        let monitor = Monitor::new(rig, Foresight::Unjudged)?;
        let parts = Parts { sensing: Sensing::of(rig)?, monitor, filter, safety };
        Ok(Cycle::with(OpenLoopPlayback::new(rows, relay), parts, Arming::Manual))
    }
}

/// Envelope that the safety filter keeps: the limits beyond which the rig is vented.
fn envelope(safety: Safety) -> Envelope {
    Envelope { max_pos_kpa: safety.max_pos_kpa, min_neg_kpa: safety.min_neg_kpa }
}

/// Parts that stand around any duty source.
struct Parts {
    sensing: Sensing,
    monitor: Monitor,
    filter: SafetyFilter,
    safety: Safety,
}

impl<H: DutySource> Cycle<H> {
    fn with(duty_source: H, parts: Parts, arming: Arming) -> Self {
        let Parts { sensing, monitor, filter, safety } = parts;
        Cycle {
            filter,
            filter_watch: FilterWatch::new(),
            sensing,
            safety,
            duty_source,
            monitor,
            memory: Memory::START,
            arming,
            request: None,
            conditions: ConditionSet::EMPTY,
            reported: ConditionSet::EMPTY,
            tick: 0,
            measured: [0.0; CHANNELS],
            answer: ActuatorCommand::VENT,
            action: None,
            missing: 0,
            renew_session: false,
            faulted_ticks: 0,
            exploration: None,
        }
    }
}
