//! Inputs of the pure function: what made a call, what is wrong, what is asked for.

use crate::condition_set::ConditionSet;

/// Cause of a call.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tick {
    /// A frame was accepted.
    Frame,
    /// No frame was accepted in time.
    Missing,
    /// A session was opened.
    SessionOpened,
    /// The link is gone.
    LinkGone,
    /// Still without a session.
    Waiting,
}

/// Request of a person, or of what is steered for on a person's behalf.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Request {
    /// Play the rows of an experiment: arms for these only, and whatever stops them leaves arming to a person.
    Play,
    /// Control the pressures.
    Arm,
    /// A person has looked at what was wrong.
    Acknowledge,
    /// Open the vents.
    Disarm,
    /// End the program.
    Stop,
}

/// Need of a person for arming.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arming {
    /// By a person only.
    Manual,
    /// By itself once all is sound (`control.auto_arm`: simulation and tests).
    Automatic,
}

/// Inputs of one call.
#[derive(Debug, Clone, Copy)]
pub struct Inputs<'a> {
    /// Kind of tick that made this call.
    pub tick: Tick,
    /// Present faults.
    pub conditions: &'a ConditionSet,
    /// Request of this tick, where there is one.
    pub request: Option<Request>,
    /// Tells whether a person is needed to arm.
    pub arming: Arming,
}
