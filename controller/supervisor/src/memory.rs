//! Memory of the pure function from tick to tick, and what follows from it alone: whether the rig can be armed, whether a session may be
//! opened.

use crate::condition::{Condition, Severity};
use crate::condition_set::ConditionSet;
use crate::state::State;

/// Sound frames in a row before the rig can be armed, and after the cause before VENT is left: half a second (chosen).
pub const FRAMES_TO_ARM: u32 = 25;

/// Everything that is remembered from tick to tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Memory {
    /// The state.
    pub state: State,
    /// Reason why the state is HOLD, VENT or FAULT, or why the last session ended; the worst so far.
    pub cause: Option<Condition>,
    /// Reason why the policy does not control, while it does not.
    pub reverted: Option<Condition>,
    /// Conditions that wait for a person.
    pub latched: ConditionSet,
    /// Sound frames in a row.
    pub sound_frames: u32,
    /// Sound frames that are still to come behind a venting before the rig arms by itself; a person need not wait for them.
    pub settling_frames: u32,
    /// Good ticks in a row while in HOLD or REVERT.
    pub good_ticks: u32,
    /// Returns from REVERT made in this period.
    pub returns: u8,
    /// Ticks since the first of them.
    pub return_period_ticks: u32,
    /// True while `auto_arm` may act: not after a latched condition, a disarm or the beginning of an experiment, until it is armed
    /// by a person or, after an experiment that began under control and was played to its end, for the reference again.
    pub may_arm_itself: bool,
}

impl Memory {
    /// Nothing has happened yet.
    pub const START: Memory = Memory {
        state: State::Init,
        cause: None,
        reverted: None,
        latched: ConditionSet::EMPTY,
        sound_frames: 0,
        settling_frames: 0,
        good_ticks: 0,
        returns: 0,
        return_period_ticks: 0,
        may_arm_itself: true,
    };

    /// Tells whether an order to arm would be followed at the next sound frame.
    pub fn can_arm(&self, conditions: &ConditionSet) -> bool {
        self.state == State::Standby
            && self.sound_frames >= FRAMES_TO_ARM
            && self.latched.is_empty()
            && Self::bars_arming(conditions).is_none()
    }

    /// Worst condition that keeps the rig from being armed as long as it holds.
    pub fn bars_arming(conditions: &ConditionSet) -> Option<Condition> {
        let bars = |condition: &Condition| condition.severity() == Severity::BarsArming;
        conditions.worst(Severity::Vent).or_else(|| conditions.iter().find(bars))
    }

    /// Tells whether a session may be opened: not while a trip of the cRIO waits for a person, because a HELLO would undo it.
    pub fn may_open_session(&self) -> bool {
        !self.latched.iter().any(Condition::bars_session)
    }
}

impl Default for Memory {
    fn default() -> Self {
        Memory::START
    }
}
