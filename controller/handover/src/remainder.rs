//! Remainder of a bump: the command goes on from where it was, whatever controls from now on, and comes to what that wants over
//! half a second.

use law::{ControlOutput, saturated};
use model::observation::{ActionTrajectory, CHANNELS, Pair};

/// Ticks over which a remainder decays.
const DECAY_TICKS: u32 = 25;

/// A remainder, in duty, and how long it is there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Remainder {
    /// `None`: to be taken from the next decision.
    duty: Option<Pair>,
    left: u32,
}

impl Remainder {
    /// There is none.
    pub(crate) const NONE: Remainder = Remainder { duty: Some([0.0; CHANNELS]), left: 0 };

    /// The next decision goes on from the last command, whatever it is.
    pub(crate) const FROM_SENT: Remainder = Remainder { duty: None, left: DECAY_TICKS };

    /// Distance of this decision from the command that was sent last.
    pub(crate) fn between(sent: Pair, decision: &ControlOutput) -> Self {
        Remainder { duty: Some(away(sent, decision)), left: DECAY_TICKS }
    }

    /// Adds what is left of it to a decision and its plan, and moves on by a tick.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub(crate) fn add_to(&mut self, mut decision: ControlOutput, sent: Pair) -> ControlOutput {
        if self.left == 0 {
            return decision;
        }
        let duty = *self.duty.get_or_insert(away(sent, &decision));
        let share = f64::from(self.left) / f64::from(DECAY_TICKS);
        for (parts, remainder) in decision.parts.iter_mut().zip(duty) {
            parts.correction += share * remainder;
        }
        decision.trajectory = ActionTrajectory(std::array::from_fn(|j| {
            let ahead = (share - j as f64 / f64::from(DECAY_TICKS)).max(0.0);
            std::array::from_fn(|c| saturated(decision.trajectory.0[j][c] + ahead * duty[c]))
        }));
        self.left -= 1;
        decision
    }
}

/// Distance of a decision from what was sent.
pub(crate) fn away(sent: Pair, decision: &ControlOutput) -> Pair {
    let raw = decision.raw();
    std::array::from_fn(|c| sent[c] - raw[c].clamp(0.0, 1.0))
}
