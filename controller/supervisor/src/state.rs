//! The daemon's states.

use serde::{Deserialize, Serialize};

use crate::condition::Condition;

/// State of the daemon.
///
/// 0 … 2 are the codes that recordings have always carried; the others follow in the order in which they came to be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u8)]
pub enum State {
    /// Vents open, session open, waiting to be armed.
    Standby = 0,
    /// Controlling the pressures.
    Run = 1,
    /// Vents open because something is wrong.
    #[serde(rename = "vented")]
    Vent = 2,
    /// Controlling on the plan, with integrators still: a frame or a deadline was missed, or a reading is in doubt.
    Hold = 3,
    /// Controlling with the fallback because the policy is not trusted.
    Revert = 4,
    /// Vents commanded open, and nothing shows that they are.
    Fault = 5,
    /// No session with the cRIO, which vents by itself.
    #[serde(rename = "connecting")]
    Connect = 6,
    /// Not started yet.
    #[default]
    #[serde(rename = "starting")]
    Init = 7,
    /// Ending: vent, BYE, recording finished.
    #[serde(rename = "stopping")]
    Stop = 8,
}

impl State {
    /// All states.
    pub const ALL: [State; 9] = [
        State::Init,
        State::Connect,
        State::Standby,
        State::Run,
        State::Hold,
        State::Revert,
        State::Vent,
        State::Fault,
        State::Stop,
    ];

    /// The number that recordings and status carry.
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// The state with a recorded code; `None` for a code that is none.
    pub fn from_code(code: u8) -> Option<State> {
        Self::ALL.into_iter().find(|state| state.code() == code)
    }

    /// The name of a recorded code.
    pub fn name(code: u8) -> &'static str {
        match Self::from_code(code) {
            Some(State::Standby) => "standby",
            Some(State::Run) => "run",
            Some(State::Vent) => "vented",
            Some(State::Hold) => "hold",
            Some(State::Revert) => "revert",
            Some(State::Fault) => "fault",
            Some(State::Connect) => "connecting",
            Some(State::Init) => "starting",
            Some(State::Stop) => "stopping",
            None => "unknown",
        }
    }

    /// The name that a person and `status` are told.
    pub fn as_str(self) -> &'static str {
        State::name(self.code())
    }

    /// Tells whether the valves are being controlled: RUN, HOLD, REVERT.
    pub const fn is_controlling(self) -> bool {
        matches!(self, State::Run | State::Hold | State::Revert)
    }

    /// Tells whether the vents are open because of `cause`.
    pub const fn is_vented(self) -> bool {
        matches!(self, State::Vent | State::Fault)
    }

    /// The fault number of a record in this state: the cause's code while vented, else 0.
    pub fn fault(self, cause: Option<Condition>) -> u16 {
        if self.is_vented() { cause.map_or(0, Condition::code) } else { 0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_go_there_and_back() {
        for state in State::ALL {
            assert_eq!(State::from_code(state.code()), Some(state));
            assert_ne!(State::name(state.code()), "unknown");
        }
        assert_eq!(State::name(200), "unknown");
        assert_eq!([State::Standby, State::Run, State::Vent].map(State::code), [0, 1, 2]);
    }
}
