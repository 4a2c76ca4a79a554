//! Action of the pure function: what goes to the valves and by whom, and what a person is told.

use crate::condition::Condition;
use crate::inputs::Arming;

/// Source of the duties that go to the valves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Actuation {
    /// Both vents open, pump off.
    Vent,
    /// The controller's duties.
    Control,
    /// The plan that was made for this tick: there is no frame to answer.
    Plan,
}

/// Controller whose duties count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ControlledBy {
    /// The policy, where there is one.
    Policy,
    /// The fallback.
    Fallback,
}

/// Motion of the integrators.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Integration {
    /// They move.
    On,
    /// They stand still, and duties move slowly.
    Off,
}

/// News for a person.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transition {
    /// Nothing happened.
    None,
    /// A session was opened.
    SessionOpened,
    /// Armed.
    Armed(Arming),
    /// Disarmed by the operator.
    Disarmed,
    /// Vented, or vented already and now for a worse reason.
    Vented(Condition),
    /// Venting is in doubt.
    Faulted(Condition),
    /// The link is gone while nothing worse was told.
    Disconnected(Condition),
    /// HOLD began.
    Held(Condition),
    /// HOLD is over.
    Resumed,
    /// The fallback took over.
    Reverted(Condition),
    /// The policy controls again.
    Returned,
    /// The cause is over, and acknowledged where it had to be.
    Recovered,
    /// Ending.
    Stopped,
}

/// Outcome of [`crate::inputs::Request::Acknowledge`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Acknowledgement {
    /// There was none.
    None,
    /// Everything that waited is cleared.
    Cleared,
    /// This still holds, and goes on waiting.
    StillHolds(Condition),
}

/// Action of one tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Action {
    /// Command to the valves.
    pub actuation: Actuation,
    /// Whose duties count.
    pub controlled_by: ControlledBy,
    /// Motion of the integrators.
    pub integration: Integration,
    /// Transition as a person is told of it.
    pub transition: Transition,
    /// Outcome of an acknowledgement.
    pub acknowledgement: Acknowledgement,
    /// Tells whether the cRIO's trip may be ended by a new HELLO now.
    pub renew_session: bool,
}
