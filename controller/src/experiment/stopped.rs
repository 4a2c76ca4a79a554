//! Reasons why a command sequence was not played to its end, and the words for a person.

use model::observation::Pair;
use proto::recording::PERIOD_S;
use supervisor::Condition;

use crate::experiment::open_loop_playback::LONGEST_SETTLE;
use crate::operator::notice::{fault_text, why_barred};

/// Reason why a sequence was not played to its end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Stopped {
    /// The watch vented the rig.
    Vented {
        /// Condition that vented it.
        cause: Condition,
        /// The number behind it: volts, kPa, ms, trip bits.
        value: f64,
    },
    /// The operator disarmed.
    Disarmed,
    /// The pump runs although it was asked to stop.
    PumpRuns,
    /// The pressures did not come to rest.
    Restless {
        /// Readings of the last frame, kPa gauge.
        measured: Pair,
    },
    /// The rig stood at rest and was not armed: nobody may wait by the time when it could be.
    NotArmed {
        /// Condition that barred it; `None`: it was never in standby for long enough.
        bars_arming: Option<Condition>,
    },
}

impl std::fmt::Display for Stopped {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Stopped::Vented { cause, value } => f.write_str(&fault_text(cause.code(), *value)),
            Stopped::Disarmed => f.write_str("disarmed by the operator"),
            Stopped::PumpRuns => f.write_str(
                "the cRIO reports its pump running although it is asked to stop: it has no pump relay, and the model has",
            ),
            Stopped::Restless { measured: [pos, neg] } => write!(
                f,
                "no rest within {:.0} s with both vents open: {pos:.1}/{neg:.1} kPa; are the vents free, the sensors sound?",
                f64::from(LONGEST_SETTLE) * PERIOD_S
            ),
            Stopped::NotArmed { bars_arming: Some(condition) } => {
                write!(f, "at rest it could not be armed: {}; mend that, then ask for it again", why_barred(*condition))
            }
            Stopped::NotArmed { bars_arming: None } => write!(
                f,
                "at rest it could not be armed within {:.0} s; `controller status` tells why",
                f64::from(LONGEST_SETTLE) * PERIOD_S
            ),
        }
    }
}
