//! Tracking error of the last 20 s under control.
//!
//! The figure that a person reads beside a run says how well the rig tracks now, so the way to the goal does not count: where the
//! rig is armed, or the goal jumps, the mean begins anew, and [`SKIPPED_S`] later, as in every other figure of the
//! trainer. Ticks that nothing is learned from are passed over and end nothing as long as they are few.

use std::collections::VecDeque;

use environment::score::SKIPPED_S;
use law::TICK_S;

use crate::transitions::Transition;

/// Squares that the mean is taken over: 20 s.
const WINDOW_TICKS: usize = 1_000;
/// Fewest squares that a mean is told of, 1 s: of fewer it is the noise of some readings.
const LEAST_TICKS: usize = 50;
/// Ticks without a transition from which the rig counts as armed anew, 1 s: the filter bends single commands, and a
/// rig that was vented meanwhile takes longer.
const PAUSE_TICKS: u32 = 50;
/// Change of a goal from tick to tick from which it jumps, in kPa: 50 kPa/s, half again what the approach after arming
/// asks for over a gap of 60 kPa and more than a rig follows.
const JUMP_KPA: f64 = 1.0;

/// Squares of the errors of the last 20 s under control, positive and negative channel.
#[derive(Debug, Clone, Default)]
pub struct RecentError {
    /// In kPa², oldest first.
    squares: VecDeque<[f64; 2]>,
    /// Session and tick, and goals in kPa, of the last transition.
    last: Option<((u32, u32), [f64; 2])>,
    /// Ticks since the mean began anew, the skipped ones included.
    since_begun: usize,
    taken: u64,
}

impl RecentError {
    /// Takes in the next transition.
    pub fn push(&mut self, transition: &Transition) {
        let (at, goals_kpa) = (transition.measured_at, transition.goals_kpa);
        let goes_on = self.last.is_some_and(|(before, goals_before_kpa)| {
            let passed = at.1.wrapping_sub(before.1);
            let most_kpa = JUMP_KPA * f64::from(passed);
            let jumps = goals_kpa.iter().zip(goals_before_kpa).any(|(now, before)| (now - before).abs() > most_kpa);
            at.0 == before.0 && passed <= PAUSE_TICKS && !jumps
        });
        self.last = Some((at, goals_kpa));
        self.taken += 1;
        if !goes_on {
            self.squares.clear();
            self.since_begun = 0;
        }
        self.since_begun += 1;
        if self.since_begun as f64 * TICK_S <= SKIPPED_S {
            return;
        }
        if self.squares.len() == WINDOW_TICKS {
            self.squares.pop_front();
        }
        self.squares.push_back(transition.error_kpa.map(|error| error * error));
    }

    /// Transitions that were taken in.
    pub fn taken(&self) -> u64 {
        self.taken
    }

    /// Root of the mean square in kPa; nothing within 6 s of an arming or a jump of the goal.
    pub fn rmse_kpa(&self) -> Option<[f64; 2]> {
        let count = self.squares.len();
        (count >= LEAST_TICKS).then(|| {
            std::array::from_fn(|c| (self.squares.iter().map(|square| square[c]).sum::<f64>() / count as f64).sqrt())
        })
    }

    /// Time that the mean is taken over, in s: 20, or less soon after an arming or a jump of the goal.
    pub fn over_s(&self) -> f64 {
        self.squares.len() as f64 * TICK_S
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn transition(at: (u32, u32), goals_kpa: [f64; 2], error_kpa: [f64; 2]) -> Transition {
        Transition {
            observation: Vec::new(),
            action: Vec::new(),
            reward: 0.0,
            next_observation: Vec::new(),
            terminal: false,
            measured_at: at,
            goals_kpa,
            error_kpa,
        }
    }

    /// Ticks of one session with one goal, their errors by tick.
    fn fly(recent: &mut RecentError, ticks: std::ops::Range<u32>, goal_kpa: f64, error_kpa: impl Fn(u32) -> f64) {
        for tick in ticks {
            let error = error_kpa(tick);
            recent.push(&transition((1, tick), [goal_kpa, -70.0], [error, -0.5 * error]));
        }
    }

    /// The closed form of the mean over the last thousand: nothing of the error at arming, nor of what is older than 20 s.
    #[test]
    fn it_is_the_mean_over_the_last_twenty_seconds_alone() {
        let mut recent = RecentError::default();
        let error_kpa = |tick: u32| if tick < 250 { 80.0 } else { 1e-3 * f64::from(tick) };
        fly(&mut recent, 0..299, 90.0, error_kpa);
        assert_eq!(recent.rmse_kpa(), None, "49 ticks are too few");
        fly(&mut recent, 299..2_000, 90.0, error_kpa);
        // Σ k² of 1000 … 1999 by Σ_{k ≤ n} k² = n (n + 1) (2n + 1)/6.
        let sum = |n: f64| n * (n + 1.0) * (2.0 * n + 1.0) / 6.0;
        let expected = 1e-3 * ((sum(1_999.0) - sum(999.0)) / 1_000.0).sqrt();
        let [pos, neg] = recent.rmse_kpa().unwrap();
        // Rounding of a thousand sums.
        assert!((pos - expected).abs() < 1e-12 && (neg - 0.5 * expected).abs() < 1e-12, "{pos} {neg} {expected}");
        assert_eq!((recent.taken(), recent.over_s()), (2_000, 20.0));
    }

    #[test]
    fn an_arming_and_a_jump_of_the_goal_begin_it_anew() {
        for (name, session, tick, goal_kpa) in [
            ("another session", 2, 1_000, 90.0),
            ("a second without control", 1, 1_051, 90.0),
            ("a jump", 1, 1_000, 92.0),
        ] {
            let mut recent = RecentError::default();
            fly(&mut recent, 0..1_000, 90.0, |_| 0.1);
            assert!((recent.rmse_kpa().unwrap()[0] - 0.1).abs() < 1e-12, "{name}");
            for k in 0..300 {
                let error = if k < 250 { 30.0 } else { 0.2 };
                recent.push(&transition((session, tick + k), [goal_kpa, -70.0], [error; 2]));
                assert_eq!(recent.rmse_kpa().is_some(), k == 299, "{name}, {k} ticks later");
            }
            assert!((recent.rmse_kpa().unwrap()[0] - 0.2).abs() < 1e-12, "{name}");
            assert_eq!(recent.over_s(), 1.0, "{name}");
        }
    }

    /// A tick that the filter bent makes no transition; the rig stays under control, and the mean goes on.
    #[test]
    fn single_ticks_that_are_left_out_end_nothing() {
        let mut recent = RecentError::default();
        for tick in (0..1_000_u32).filter(|tick| tick % 100 != 7) {
            // A ramp of 25 kPa/s, which is no jump across a gap either.
            recent.push(&transition((1, tick), [60.0 + 0.5 * f64::from(tick), -70.0], [0.1; 2]));
        }
        assert_eq!(recent.over_s(), 14.8, "990 ticks less 250");
    }
}
