//! Stages of a candidate's way, and the levels of its ramp.

use crate::sequential_test::Rigour;

/// Authorities of the ramp, as shares of the command.
pub const LEVELS: [f64; 6] = [0.05, 0.1, 0.2, 0.4, 0.7, 1.0];
/// Place of all of the command in them.
pub(crate) const LAST_LEVEL: usize = LEVELS.len() - 1;
/// The first level behind the recheck, 70 %: from here on a candidate alone can make the rig swing.
pub(crate) const RECHECKED_LEVEL: usize = LAST_LEVEL - 1;

/// Stage at which a candidate stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StageNow {
    /// Computed, not used.
    Shadow,
    /// Part of the command; the level's place in [`LEVELS`].
    Ramp(usize),
    /// Not used for a while: the incumbent controls alone, and what it does now is what all of the command is held against. It
    /// goes on learning the rig, and what was as good as it in the beginning need not be so later.
    Recheck,
    /// Not used for a while either: it erred more than the record of the incumbent, which is measured anew before that is held
    /// against the candidate; then it begins the ramp again.
    Retrial,
    /// All of the command, with the way back open.
    Probation,
}

impl StageNow {
    /// The number that events carry: 0 shadow, 1 … 6 ramp, 7 probation, 8 recheck, 9 retrial.
    pub fn code(self) -> u8 {
        match self {
            StageNow::Shadow => 0,
            StageNow::Ramp(level) => level as u8 + 1,
            StageNow::Probation => LEVELS.len() as u8 + 1,
            StageNow::Recheck => LEVELS.len() as u8 + 2,
            StageNow::Retrial => LEVELS.len() as u8 + 3,
        }
    }

    /// The stage of a number.
    pub fn of_code(code: u8) -> Self {
        match usize::from(code) {
            0 => StageNow::Shadow,
            level if level <= LEVELS.len() => StageNow::Ramp(level - 1),
            level if level == LEVELS.len() + 1 => StageNow::Probation,
            level if level == LEVELS.len() + 2 => StageNow::Recheck,
            _ => StageNow::Retrial,
        }
    }

    /// Tells whether the incumbent is measured anew in it.
    pub(crate) fn measures_incumbent(self) -> bool {
        matches!(self, StageNow::Recheck | StageNow::Retrial)
    }

    /// Rigour with which errors are judged in it.
    pub(crate) fn rigour(self) -> Rigour {
        match self {
            StageNow::Ramp(RECHECKED_LEVEL..) | StageNow::Probation => Rigour::ALL,
            _ => Rigour::SHARE,
        }
    }
}
