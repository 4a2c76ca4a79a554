//! A finding: where, how bad, what it is, what to do.

use std::fmt;

/// Severity of a finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// Results have to be read with it in mind.
    Doubtful,
    /// Any result would be wrong.
    Unusable,
}

/// Kind of trouble.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Trouble {
    /// Too few rows to tell anything.
    TooShort,
    /// A channel that never moves.
    Flat,
    /// A channel that stays on one reading for a while.
    Stuck,
    /// Readings cut off at a limit.
    Clipped,
    /// Single readings far from their neighbours.
    Spikes,
    /// Rows are missing.
    Gaps,
    /// Time steps are not 20 ms.
    UnevenTime,
    /// The pressures of both chambers are exchanged.
    SwappedPressures,
    /// The duties of two valves are exchanged.
    SwappedDuties,
    /// A duty works the wrong way round.
    InvertedDuty,
    /// Pressures are in another unit.
    WrongUnit,
    /// Pressures are absolute instead of gauge.
    Absolute,
    /// Duties look like something else than a share.
    DutyScale,
    /// Commands or pressures hardly move.
    NoExcitation,
    /// Pressures move and nothing in the rig can move them.
    NothingMoves,
    /// The pump never runs.
    PumpOff,
    /// The pump stood while the recorded commands say that it ran.
    PumpStood,
}

/// Something wrong with a recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    /// The file it is in; empty where all are meant.
    pub source: String,
    /// The column; empty where none is meant.
    pub column: String,
    /// Severity of the trouble.
    pub severity: Severity,
    /// Kind of trouble.
    pub trouble: Trouble,
    /// Words on what is wrong and what to do about it.
    pub text: String,
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for place in [&self.source, &self.column] {
            if !place.is_empty() {
                write!(f, "{place}: ")?;
            }
        }
        f.write_str(&self.text)
    }
}
