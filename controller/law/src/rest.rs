//! Rest on a hold: where integral action stands still, so that play in a valve makes no slow limit cycle.
//!
//! An integral in a loop with play never comes to rest: while the flapper stands, what is left of the error integrates until the
//! play is crossed, the flapper moves at the speed that the integral has by then, goes past the goal, and the play is crossed
//! back. The cure is the usual one for integral action with backlash (Åström and Hägglund, *Advanced PID Control*, 2006, on
//! friction in valves): on a goal that stands still nothing integrates once the mean error is within half a step of the reading,
//! until it is beyond a whole one.

use model::observation::{CHANNELS, GOALS_AHEAD, Pair};

use crate::{ControlInput, TICK_S};

/// Mean error in kPa within which a channel comes to rest. Derived: half a step of the converters over the paper's sensors (0.08 and
/// 0.008 kPa), to which a reading is rounded.
const BAND_KPA: Pair = [0.04, 0.004];
/// From so many bands on it is no longer at rest: from a whole step, which a reading tells apart.
const LEAVES_BANDS: f64 = 2.0;
/// Time constant of the mean error in seconds. Derived: the noise of a reading (0.06 and 0.006 kPa) is a third of a band in it.
const MEAN_S: f64 = 0.25;
/// Time constant in seconds of the slower mean, by which a pressure is seen to stand. Chosen: long beside [`MEAN_S`], and short beside the
/// half minute in which an integral crosses a play.
const STANDS_S: f64 = 1.0;
/// Time for which a goal has stood still before it counts as a hold, in ticks (chosen: the loop settles in about a second).
const STILL_TICKS: u32 = 50;

/// Motion of a channel's goal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Hold {
    /// The goal moves, or has not stood still for long.
    #[default]
    Moving,
    /// The goal stands, and the channel is on its way there.
    Settling,
    /// The goal stands and the pressure does, off its goal: the flapper stands in its play, whatever the duty does.
    Standing,
    /// At rest on the goal.
    Resting,
}

/// Holds of both channels.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Rest {
    goal_kpa: Pair,
    still_ticks: u32,
    mean_kpa: Pair,
    slow_mean_kpa: Pair,
    resting: [bool; CHANNELS],
}

impl Rest {
    /// Takes in a tick; answers how the channels stand to their goals.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn follow(&mut self, situation: &ControlInput) -> [Hold; CHANNELS] {
        let [now, .., last] = situation.goals_kpa;
        // A goal that will move within the preview is no hold any more: both channels are coupled, so neither rests.
        let still = now == last && now == self.goal_kpa && situation.goals_kpa.len() == GOALS_AHEAD + 1;
        self.still_ticks = if still { self.still_ticks.saturating_add(1) } else { 0 };
        self.goal_kpa = now;
        for c in 0..CHANNELS {
            let error_kpa = now[c] - situation.undelayed_kpa[c];
            self.mean_kpa[c] += (error_kpa - self.mean_kpa[c]) * TICK_S / MEAN_S;
            self.slow_mean_kpa[c] += (error_kpa - self.slow_mean_kpa[c]) * TICK_S / STANDS_S;
            let bands = if self.resting[c] { LEAVES_BANDS } else { 1.0 };
            self.resting[c] = self.still_ticks >= STILL_TICKS && self.mean_kpa[c].abs() < bands * BAND_KPA[c];
        }
        std::array::from_fn(|c| {
            if self.still_ticks < STILL_TICKS {
                Hold::Moving
            } else if self.resting[c] {
                Hold::Resting
            } else if (self.mean_kpa[c] - self.slow_mean_kpa[c]).abs() < BAND_KPA[c] {
                // Three standard deviations of what the readings' noise makes of the difference.
                Hold::Standing
            } else {
                Hold::Settling
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOAL: Pair = [100.0, -70.0];

    /// Follows a goal for so long with these errors; whether the channels rest by the last answer.
    fn held(rest: &mut Rest, ticks: u32, error_kpa: Pair) -> [bool; CHANNELS] {
        let reads = std::array::from_fn(|c| GOAL[c] - error_kpa[c]);
        let input = ControlInput::of_measured(reads, [GOAL; GOALS_AHEAD + 1]);
        (0..ticks).map(|_| rest.follow(&input)).last().unwrap().map(|hold| hold == Hold::Resting)
    }

    #[test]
    fn rests_within_a_band_and_leaves_at_two() {
        let mut rest = Rest::default();
        assert_eq!(held(&mut rest, 200, [0.035, 0.006]), [true, false]);
        assert_eq!(held(&mut rest, 200, [0.075, 0.0035]), [true, true]);
        assert_eq!(held(&mut rest, 200, [0.085, 0.006]), [false, true]);
        // Having left it has to come back to one band.
        assert_eq!(held(&mut rest, 200, [0.075, 0.006]), [false, true]);
    }

    #[test]
    fn does_not_rest_while_the_goal_moves_or_will() {
        let mut rest = Rest::default();
        assert_eq!(held(&mut rest, STILL_TICKS, [0.0; CHANNELS]), [false; CHANNELS]);
        assert_eq!(held(&mut rest, 1, [0.0; CHANNELS]), [true; CHANNELS]);
        let mut goals = [GOAL; GOALS_AHEAD + 1];
        goals[GOALS_AHEAD][0] += 0.1;
        assert_eq!(rest.follow(&ControlInput::of_measured(GOAL, goals)), [Hold::Moving; CHANNELS]);
    }
}
