//! Reason why a link is gone or must be closed.

use proto::wire::{ByeReason, WireError};
use supervisor::Condition;

/// Reason why a link is gone or must be closed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Broken {
    /// The condition.
    pub condition: Condition,
    /// The number behind it; of a lost link the system's error, 0 where the cRIO closed it, minus the seconds of a silence.
    pub value: f64,
}

impl Broken {
    pub(super) fn because(condition: Condition, value: f64) -> Self {
        Broken { condition, value }
    }

    /// A cRIO that has said nothing for so long.
    pub fn silent(ns: u64) -> Self {
        Broken { condition: Condition::LinkLost, value: -(ns as f64) * 1e-9 }
    }

    /// Reason of the BYE that is said before closing.
    pub fn bye_reason(self) -> ByeReason {
        match self.condition {
            Condition::VersionWrong => ByeReason::Version,
            Condition::LinkLost | Condition::PeerLeft => ByeReason::Normal,
            _ => ByeReason::ProtocolError,
        }
    }
}

/// Reason that the reader's error is.
pub(super) fn broken_stream(error: WireError) -> Broken {
    match error {
        WireError::Version { found, .. } => Broken::because(Condition::VersionWrong, f64::from(found)),
        WireError::Magic { header } => {
            let first = header.as_bytes().iter().take(4).fold(0u32, |word, byte| (word << 8) | u32::from(*byte));
            Broken::because(Condition::StreamBroken, f64::from(first))
        }
        _ => Broken::because(Condition::StreamBroken, f64::from(proto::wire::MAGIC)),
    }
}
