//! Source of the duties while the rig is armed.
//!
//! [`Cycle`](crate::cycle::Cycle) keeps watch: volts, limits, missing frames, the state. What is steered for is
//! the duty source's: a reference ([`ReferenceTracking`](crate::cycle::reference_tracking::ReferenceTracking)), the rows of a sequence
//! ([`OpenLoopPlayback`]), or first the one and then the other
//! ([`RunningSource`](crate::cycle::running_source::RunningSource)). What it decides counts
//! only while the rig is armed; it cannot keep the watch from venting.

use handover::{ExplorationRules, ExplorationShown};
use model::observation::Pair;
use monitor::Monitor;
use proto::recording::{EventLevel, TickRecord};
use proto::reference::Reference;
use proto::wire::Mode;
use safety_filter::SafetyFilter;
use serde::{Deserialize, Serialize};
use supervisor::{Condition, ControlledBy, State};

use crate::experiment::open_loop_playback::OpenLoopPlayback;
use crate::operator::notice::Notice;

/// Both vents open: what is sent whenever the rig is not being controlled.
pub const VENT: Pair = [1.0, 1.0];

/// Command that is to be sent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ActuatorCommand {
    /// Duties, positive and negative valve.
    pub duty: Pair,
    /// Mode.
    pub mode: Mode,
    /// True where the pump is to run.
    pub pump_on: bool,
}

impl ActuatorCommand {
    /// The safe state: both vents open, pump off.
    pub const VENT: ActuatorCommand = ActuatorCommand { duty: VENT, mode: Mode::Vent, pump_on: false };

    /// Duties in force, pump on.
    pub fn run(duty: Pair) -> Self {
        ActuatorCommand { duty, mode: Mode::Run, pump_on: true }
    }
}

/// Place where notices go; the tick calls it at most a few times.
pub type NoticeSink<'a> = &'a mut dyn FnMut(Notice);

/// A sound frame, as a duty source sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorSample {
    /// Tick of the cRIO.
    pub tick: u32,
    /// Measured pressures, kPa gauge.
    pub measured: Pair,
    /// True where the cRIO says that the pump runs.
    pub pump_running: bool,
    /// The state, with this frame taken in.
    pub state: State,
    /// Condition that keeps the rig from being armed, in standby.
    pub bars_arming: Option<Condition>,
}

/// Request of a duty source to the watch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ModeRequest {
    /// Nothing.
    None,
    /// To be armed for the rows of an experiment, at the next frame if it is sound; whatever stops them leaves arming to a person.
    Play,
    /// To be armed for the reference, at the next frame if it is sound.
    Arm,
    /// To be disarmed at once, both vents open; the notice says why.
    Disarm(Notice),
}

/// State that follows an experiment that was played to its end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Afterwards {
    /// Controlling again, as before it.
    Armed,
    /// Standing by, as before it.
    StandingBy,
}

/// Fate of a prediction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Prediction {
    /// It was made, or none is needed.
    Sound,
    /// The model came to numbers that are none: what is measured stands in, and the model begins anew from there.
    Diverged,
}

/// Way in which the watch takes what a source decides.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Steering {
    /// Toward a reference: readings are held against the model, duties keep the slew limit, and persons arm.
    ClosedLoop,
    /// By rows that are played as they are, often to find out where the model is wrong; the source arms by itself.
    OpenLoop,
}

/// Phases of an experiment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ExperimentPhase {
    /// Vents open, pump off, until the pressures stand still.
    Settling,
    /// The rows are sent.
    Playing,
    /// Vents open after the last row, or after what stopped it.
    Resting,
}

impl ExperimentPhase {
    /// The number that recordings carry; 0 is no experiment.
    pub const fn code(self) -> u8 {
        match self {
            ExperimentPhase::Settling => 1,
            ExperimentPhase::Playing => 2,
            ExperimentPhase::Resting => 3,
        }
    }
}

/// Progress of an experiment as the tick shows it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct ExperimentProgress {
    /// Phase.
    pub phase: ExperimentPhase,
    /// Rows that were sent.
    pub reached: u32,
    /// Rows that it has.
    pub rows: u32,
}

/// Source of the duties while the rig is armed. All of it but `verdict` runs in the tick: bounded, no allocation.
pub trait DutySource: Send {
    /// True where one session is all there is: a lost link then ends the flight.
    const ONE_SESSION: bool;

    /// Puts in another model where one waits, those of the safety filter and of the monitor with it; before anything is
    /// decided in a tick.
    fn exchange_model(
        &mut self,
        state: State,
        filter: &mut SafetyFilter,
        monitor: &mut Monitor,
        record: &mut TickRecord,
    ) {
        let _ = (state, filter, monitor, record);
    }

    /// Looks at a sound frame, armed or not.
    fn on_sample(&mut self, seen: &SensorSample) -> ModeRequest;

    /// The rig was armed in this tick.
    fn armed(&mut self, tick: u32, measured: Pair);

    /// Rolls a model ahead from what was measured, where one is used.
    fn predict(&mut self, measured: Pair, record: &mut TickRecord) -> Prediction;

    /// Decides the tick; `None` if there is no finite answer, and the rig is vented.
    fn decide(
        &mut self,
        tick: u32,
        measured: Pair,
        record: &mut TickRecord,
        tell: NoticeSink<'_>,
    ) -> Option<ActuatorCommand>;

    /// Gives the command for a tick whose frame is missing.
    fn bridge(&mut self, tick: u32) -> ActuatorCommand;

    /// Takes note of the command that was sent.
    fn sent(&mut self, answer: &ActuatorCommand);

    /// Takes note of the command of a tick of HOLD: models move on, integrators stand still.
    fn held(&mut self, answer: &ActuatorCommand) {
        self.sent(answer);
    }

    /// Whose duties count from now on; nothing to a source that has no policy.
    fn controlled_by(&mut self, controller: ControlledBy) {
        let _ = controller;
    }

    /// The rig was vented, or the operator disarms it (no cause).
    fn stopped(&mut self, cause: Option<(Condition, f64)>);

    /// Tells whether there is nothing more to do.
    fn is_over(&self) -> bool;

    /// Takes another reference, which starts at once where `running` gives tick and pressures, and hands back the
    /// one that is not followed, to be dropped outside the tick.
    fn exchange_reference(&mut self, reference: Box<Reference>, running: Option<(u32, Pair)>) -> Box<Reference> {
        let _ = running;
        reference
    }

    /// Way in which the watch takes what this source decides now.
    fn steering(&self) -> Steering {
        Steering::ClosedLoop
    }

    /// Progress of an experiment, while one is under way.
    fn experiment(&self) -> Option<ExperimentProgress> {
        None
    }

    /// Plays an experiment from now on, and goes on as `afterwards` says; hands it back where that cannot be.
    fn begin_experiment(
        &mut self,
        playback: Box<OpenLoopPlayback>,
        afterwards: Afterwards,
    ) -> Result<(), Box<OpenLoopPlayback>> {
        let _ = afterwards;
        Err(playback)
    }

    /// The experiment that is over, to be dropped outside the tick.
    fn take_finished_experiment(&mut self) -> Option<Box<OpenLoopPlayback>> {
        None
    }

    /// Explores around the active policy from the next tick on, or no more.
    fn explore(&mut self, rules: Option<ExplorationRules>) {
        let _ = rules;
    }

    /// Exploration that is on.
    fn exploration(&self) -> Option<ExplorationShown> {
        None
    }

    /// The session is over: there are no ticks in which to come to rest.
    fn session_over(&mut self) {}

    /// Verdict on the flight for the end of the recording.
    fn verdict(&self) -> Option<(EventLevel, String)> {
        None
    }
}
