//! A finding: where, how bad, what it is, what to do.

use std::fmt;

use crate::wording::percent;

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

/// Severity and words of what is done about readings that cannot be trusted: they are left out, and where they are more than a share
/// `most` of a channel's nothing can be fitted to the recording. `longest_s` are the times of the longest stretch of them; empty where
/// they stand apart.
pub(super) fn consequence(share: f64, most: f64, longest_s: &[f64]) -> (Severity, String) {
    if share <= most {
        return (Severity::Doubtful, "left out".to_owned());
    }
    let stretch = match (longest_s.first(), longest_s.last()) {
        (Some(from_s), Some(to_s)) => {
            format!(", or cut such rows out of it (the longest stretch: {from_s:.1} to {to_s:.1} s)")
        }
        _ => String::new(),
    };
    let text = format!(
        "left out, and more than {} of all: nothing can be fitted to this recording; leave the file out, others will do without \
         it{stretch}",
        percent(most, 0)
    );
    (Severity::Unusable, text)
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
