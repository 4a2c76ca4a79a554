//! Everything that can be wrong, in one list from the least to the worst.
//!
//! The place in [`Condition::ALL`] is the rank: of two conditions the later one is the worse, replaces the earlier as
//! the reason of a state, and is told. The code is what recordings and `status` carry; it never changes its meaning, and one that
//! is no longer used is not used again (15 and 16: a reading suspect, tracking poor, of either channel).

use serde::{Deserialize, Serialize};

/// Consequence of a condition for the daemon.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Severity {
    /// It is told and counted.
    Warning,
    /// Nothing is armed while it holds; a run goes on.
    BarsArming,
    /// HOLD: the plan goes on, integrators stand still, duties move slowly.
    Hold,
    /// REVERT: the fallback takes over in the same tick.
    Revert,
    /// VENT: both vents open, pump off, in the same tick.
    Vent,
    /// FAULT: venting itself is in doubt.
    Fault,
}

/// Memory of a condition: whether a person must acknowledge it once it is over, before the rig can be armed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Latch {
    /// It clears by itself.
    ClearsItself,
    /// It stays until somebody acknowledges it.
    UntilAcknowledged,
}

macro_rules! conditions {
    ($($(#[$doc:meta])* $name:ident = $code:literal, $severity:ident, $latch:ident, $text:literal;)*) => {
        /// Something that is wrong; declared from the least to the worst, each with the code that recordings carry.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
        #[serde(rename_all = "snake_case")]
        #[repr(u16)]
        pub enum Condition {
            $($(#[$doc])* $name = $code,)*
        }

        impl Condition {
            /// All conditions, from the least to the worst.
            pub const ALL: &'static [Condition] = &[$(Condition::$name,)*];

            /// Consequence for the daemon.
            pub const fn severity(self) -> Severity {
                match self { $(Condition::$name => Severity::$severity,)* }
            }

            /// Memory of it: whether it waits for a person.
            pub const fn latch(self) -> Latch {
                match self { $(Condition::$name => Latch::$latch,)* }
            }

            /// A short name, for tables and `status`.
            pub const fn name(self) -> &'static str {
                match self { $(Condition::$name => $text,)* }
            }

            /// The condition with a recorded code; `None` for a code that is none.
            pub const fn from_code(code: u16) -> Option<Condition> {
                match code { $($code => Some(Condition::$name),)* _ => None }
            }
        }
    };
}

conditions! {
    /// More than 10 of the last 100 frames did not come in time.
    FramesScarce = 10, Warning, ClearsItself, "frames scarce";
    /// No FIFO priority, no locked memory or no CPU of its own although `realtime.enforce` asks for it.
    NotRealtime = 11, BarsArming, ClearsItself, "not real-time";
    /// A run begun now would not be recorded: the disk has failed, is nearly full, or does not answer.
    NotRecorded = 43, BarsArming, ClearsItself, "not recorded";
    /// One frame did not come in time.
    FrameMissing = 12, Hold, ClearsItself, "frame missing";
    /// A frame came whose sequence number, clock or tick cannot be right.
    FrameImplausible = 13, Hold, ClearsItself, "frame implausible";
    /// One command left after its deadline.
    DeadlineMissed = 14, Hold, ClearsItself, "deadline missed";
    /// The positive reading jumped away from what the model foresaw; it is believed neither way for some ticks.
    SuspectPositive = 46, Hold, ClearsItself, "positive reading suspect";
    /// The negative reading jumped away from what the model foresaw; it is believed neither way for some ticks.
    SuspectNegative = 47, Hold, ClearsItself, "negative reading suspect";
    /// The positive pressure stays away from its reference.
    TrackingPositive = 48, Revert, ClearsItself, "positive tracking poor";
    /// The negative pressure stays away from its reference.
    TrackingNegative = 49, Revert, ClearsItself, "negative tracking poor";
    /// The safety filter has bent more than 20 of the last 50 commands.
    FilterBusy = 17, Revert, ClearsItself, "safety filter busy";
    /// The model behind the predictions came to numbers that are none; it begins anew from what is measured.
    ModelDiverged = 45, Revert, ClearsItself, "model diverged";
    /// The policy gave no usable answer.
    PolicyRefused = 18, Revert, ClearsItself, "policy refused";
    /// Frames stopped coming.
    FramesMissing = 1, Vent, ClearsItself, "frames missing";
    /// More than 25 of the last 100 frames did not come in time.
    FramesLost = 19, Vent, ClearsItself, "frames lost";
    /// More than 25 of the last 100 commands did not reach the cRIO in time, by its own count.
    CommandsScarce = 44, Vent, ClearsItself, "commands scarce";
    /// Three deadlines missed in a row, or five of the last 100.
    DeadlinesMissed = 20, Vent, ClearsItself, "deadlines missed";
    /// The cRIO vented because our commands did not reach it in time.
    CommandsLost = 9, Vent, ClearsItself, "commands lost";
    /// Sequence numbers, clock or ticks of the frames go on being wrong.
    ClockImplausible = 21, Vent, ClearsItself, "clock implausible";
    /// Three of the last 100 frames had a wrong CRC.
    FramesDamaged = 23, Vent, ClearsItself, "frames damaged";
    /// More bytes came than a cRIO can have to say.
    LinkFlooded = 24, Vent, ClearsItself, "link flooded";
    /// A frame came with another magic number, type or length.
    StreamBroken = 25, Vent, ClearsItself, "byte stream broken";
    /// A frame came of another protocol version.
    VersionWrong = 26, Vent, ClearsItself, "protocol version";
    /// The cRIO no longer reads what is sent.
    NotRead = 27, Vent, ClearsItself, "commands not read";
    /// The cRIO said BYE.
    PeerLeft = 28, Vent, ClearsItself, "cRIO said BYE";
    /// The link is gone.
    LinkLost = 7, Vent, ClearsItself, "link lost";
    /// The cRIO does not sample 50 times a second.
    SampleRate = 22, Vent, UntilAcknowledged, "sample rate";
    /// The control law's answer was not a number.
    LawNotFinite = 8, Vent, UntilAcknowledged, "control law not finite";
    /// No command, or one that is too old, is in force at the cRIO.
    CommandNotInForce = 29, Vent, UntilAcknowledged, "command not in force";
    /// The duty that the cRIO reports is not the one that was commanded.
    EchoWrong = 30, Vent, UntilAcknowledged, "duty echo wrong";
    /// The cRIO does not report that it runs although it was told to.
    CrioIdle = 31, Vent, UntilAcknowledged, "cRIO not running";
    /// The pump is reported off although it was switched on.
    PumpOff = 32, Vent, UntilAcknowledged, "pump off";
    /// The pressures stay away from their references with the valves at their limits.
    Uncontrolled = 33, Vent, UntilAcknowledged, "pressure out of control";
    /// The positive reading does not agree with what the model foresees.
    ModelPositive = 34, Vent, UntilAcknowledged, "positive reading against the model";
    /// The negative reading does not agree with what the model foresees.
    ModelNegative = 35, Vent, UntilAcknowledged, "negative reading against the model";
    /// The positive reading stands still although it used to scatter.
    FrozenPositive = 36, Vent, UntilAcknowledged, "positive reading frozen";
    /// The negative reading stands still although it used to scatter.
    FrozenNegative = 37, Vent, UntilAcknowledged, "negative reading frozen";
    /// The positive chamber reads what no such chamber can have.
    RangePositive = 38, Vent, UntilAcknowledged, "positive reading implausible";
    /// The negative chamber reads what no such chamber can have.
    RangeNegative = 39, Vent, UntilAcknowledged, "negative reading implausible";
    /// The positive sensor's voltage is out of range or not a number.
    SensorPositive = 2, Vent, UntilAcknowledged, "positive sensor broken";
    /// The negative sensor's voltage is out of range or not a number.
    SensorNegative = 3, Vent, UntilAcknowledged, "negative sensor broken";
    /// Trip bits are set although the cRIO does not say that it tripped.
    TripBits = 40, Vent, UntilAcknowledged, "trip bits without a trip";
    /// The cRIO tripped by itself: pressure, a sensor, or an operator's stop.
    CrioTripped = 6, Vent, UntilAcknowledged, "cRIO tripped";
    /// Negative pressure below its limit.
    OverVacuum = 5, Vent, UntilAcknowledged, "over-vacuum";
    /// Positive pressure above its limit.
    OverPressure = 4, Vent, UntilAcknowledged, "over-pressure";
    /// Open vents were commanded and the cRIO does not report them.
    VentNotEchoed = 41, Fault, UntilAcknowledged, "vent not echoed";
    /// Open vents were commanded and the pressure does not fall.
    VentIneffective = 42, Fault, UntilAcknowledged, "vent without effect";
}

impl Condition {
    /// The code that recordings carry.
    pub const fn code(self) -> u16 {
        self as u16
    }

    /// Place in the list: the higher, the worse.
    pub fn rank(self) -> usize {
        Self::ALL.iter().position(|c| *c == self).unwrap_or(0)
    }

    /// Tells whether a new session would undo somebody's decision at the cRIO, so that none is opened before a person
    /// has acknowledged it.
    pub const fn bars_session(self) -> bool {
        matches!(self, Condition::CrioTripped | Condition::TripBits)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_are_unique_and_ranks_follow_severity() {
        for (rank, condition) in Condition::ALL.iter().enumerate() {
            assert_eq!(condition.rank(), rank);
            assert_eq!(Condition::from_code(condition.code()), Some(*condition));
        }
        assert!(Condition::ALL.windows(2).all(|pair| pair[0].severity() <= pair[1].severity()));
        assert!(Condition::ALL.len() <= 64, "they must fit the set");
        assert!(Condition::ALL.iter().all(|c| c.code() < 64), "and a recording's 64 bits");
        assert_eq!(Condition::from_code(0), None);
    }
}
