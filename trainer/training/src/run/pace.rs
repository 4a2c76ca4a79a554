//! Pace of a sitting, and the time that it will take still.

use std::time::Duration;

use environment::SIDE_BY_SIDE;

/// Turns after which a pace is known (chosen: about a second).
const TURNS_TO_KNOW: u64 = 40;
/// Weight of the newest turn in the pace, so that it follows a computer that becomes busy within half a minute (chosen).
const NEWEST: f64 = 1.0 / 500.0;

/// The pace of this sitting.
#[derive(Debug, Clone, Default)]
pub(super) struct Pace {
    turns: u64,
    turn_s: f64,
    evaluations: u64,
    evaluations_s: f64,
}

impl Pace {
    /// Takes in a turn.
    pub(super) fn add_turn(&mut self, took: Duration) {
        self.turns += 1;
        let share = NEWEST.max(1.0 / self.turns as f64);
        self.turn_s += share * (took.as_secs_f64() - self.turn_s);
    }

    /// Takes in an evaluation.
    pub(super) fn add_evaluation(&mut self, took: Duration) {
        self.evaluations += 1;
        self.evaluations_s += took.as_secs_f64();
    }

    /// Steps per second while learning; 0 until it is known.
    pub(super) fn steps_per_s(&self) -> f64 {
        if self.turns < TURNS_TO_KNOW { 0.0 } else { SIDE_BY_SIDE as f64 / self.turn_s.max(1e-9) }
    }

    /// Seconds that so many steps and evaluations will take; nothing until a pace is known.
    pub(super) fn left_s(&self, steps: u64, evaluations: u64) -> Option<f64> {
        if self.turns < TURNS_TO_KNOW {
            return None;
        }
        let each_s = self.evaluations_s / self.evaluations.max(1) as f64;
        Some(steps as f64 / SIDE_BY_SIDE as f64 * self.turn_s + evaluations as f64 * each_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_counts_steps_and_evaluations() {
        let mut pace = Pace::default();
        assert_eq!(pace.left_s(800, 1), None);
        pace.add_evaluation(Duration::from_secs(3));
        (0..100).for_each(|_| pace.add_turn(Duration::from_millis(20)));
        let left_s = pace.left_s(800, 2).unwrap();
        assert!((left_s - 8.0).abs() < 1e-9, "{left_s}");
        assert!((pace.steps_per_s() - 400.0).abs() < 1e-9);
    }
}
