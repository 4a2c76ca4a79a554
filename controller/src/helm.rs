//! Who decides the duties while the rig is armed.
//!
//! [`Cycle`](crate::cycle::Cycle) keeps watch: volts, limits, missing frames, the state. What is steered for is
//! the helm's: a reference ([`Following`](crate::following::Following)) or the rows of a programme
//! ([`Playing`](crate::playing::Playing)). A helm never sees a frame that is not sound, and what it decides counts
//! only while the rig is armed; it cannot keep the watch from venting.

use model::contract::Pair;
use proto::recording::{EventLevel, TickRecord};
use proto::reference::Reference;
use proto::wire::Mode;

use crate::notice::{Cause, Notice};
use crate::state::State;

/// Both vents open: what is sent whenever the rig is not being controlled.
pub const VENT: Pair = [1.0, 1.0];

/// What is to be sent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Answer {
    /// Duties, positive and negative valve.
    pub duty: Pair,
    /// Mode.
    pub mode: Mode,
    /// Whether the pump is to run.
    pub pump_on: bool,
}

impl Answer {
    /// The safe state: both vents open, pump off.
    pub const VENT: Answer = Answer { duty: VENT, mode: Mode::Vent, pump_on: false };

    /// Duties in force, pump as told.
    pub fn run(duty: Pair, pump_on: bool) -> Self {
        Answer { duty, mode: Mode::Run, pump_on }
    }
}

/// Where notices go; the tick calls it at most a few times.
pub type Tell<'a> = &'a mut dyn FnMut(Notice);

/// A sound frame, as a helm sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// Tick of the cRIO.
    pub tick: u32,
    /// Measured pressures, kPa gauge.
    pub measured: Pair,
    /// Whether the cRIO says that the pump runs.
    pub pump_running: bool,
    /// The state, with this frame taken in.
    pub state: State,
}

/// What a helm wants of the watch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Wish {
    /// Nothing.
    Nothing,
    /// To be armed, at the next frame if it is sound.
    Arm,
    /// To be disarmed at once, both vents open; the notice says why.
    Stand(Notice),
}

/// Who decides the duties while the rig is armed. All of it but `verdict` runs in the tick: bounded, no allocation.
pub trait Helm: Send {
    /// Whether one session is all there is: a lost link then ends the flight.
    const ONE_SESSION: bool;

    /// Looks at a sound frame, armed or not.
    fn watch(&mut self, seen: &Seen) -> Wish;

    /// The rig was armed in this tick.
    fn armed(&mut self, tick: u32, measured: Pair);

    /// Rolls a model ahead from what was measured, where one is used; `applied` is the duty in force.
    fn predict(&mut self, measured: Pair, applied: Pair, record: &mut TickRecord);

    /// Decides the tick; `None` if there is no finite answer, and the rig is vented.
    fn decide(&mut self, tick: u32, measured: Pair, record: &mut TickRecord, tell: Tell<'_>) -> Option<Answer>;

    /// What to send in a tick whose frame is missing.
    fn bridge(&mut self, tick: u32) -> Answer;

    /// What was sent.
    fn sent(&mut self, answer: &Answer);

    /// The rig was vented, or the operator disarms it (no cause).
    fn stopped(&mut self, cause: Option<(Cause, f64)>);

    /// Whether there is nothing more to do.
    fn is_over(&self) -> bool;

    /// Takes another reference, which starts at once where `running` gives tick and pressures, and hands back the
    /// one that is not followed, to be dropped outside the tick.
    fn exchange_reference(&mut self, reference: Box<Reference>, running: Option<(u32, Pair)>) -> Box<Reference> {
        let _ = running;
        reference
    }

    /// What the end of the recording says about the flight.
    fn verdict(&self) -> Option<(EventLevel, String)> {
        None
    }
}
