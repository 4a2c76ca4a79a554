//! The error that a jump of the goal leaves for a while, and that nothing may integrate.
//!
//! A feed-forward that knows the valve answers a jump by itself. What a plain integral gathers on the way stands in its way afterwards
//! (0.07 of duty behind 20 kPa, an overshoot of several kPa, and play that is learned from it). So the integral is given the
//! error beside a reference model, as in control with two degrees of freedom (Åström and Hägglund, *Advanced PID Control*, 2006,
//! ch. 5): of an error that a jump made, what decays as the feedback alone would have it is none of its business.
//!
//! ```text
//! x(τ) = (x(τ−1) + Δ(τ)) e^(−K T),    0 ≤ x ≤ e,    left = e − x,      Δ the goal's jump, K the feedback's bandwidth
//! ```
//!
//! Where nothing is known of a valve the feed-forward does not do that, and the integral has to: nothing is expected.

use model::observation::{CHANNELS, Pair};

use crate::{ControlInput, TICK_S};

/// A goal that changes by more than this in a tick (kPa) jumps. Chosen: 25 and 15 kPa/s, more than valves let a chamber follow.
const JUMP_KPA: Pair = [0.5, 0.3];

/// What is expected to decay of each channel's error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GoalJump {
    /// e^(−K T) of each channel; 0 where nothing is expected.
    keeps: Pair,
    goal_kpa: Option<Pair>,
    expected_kpa: Pair,
}

impl GoalJump {
    /// For feedback of these bandwidths (1/s); none where nothing is known of the valve.
    pub fn new(bandwidth_per_s: [Option<f64>; CHANNELS]) -> Self {
        let keeps = bandwidth_per_s.map(|per_s| per_s.map_or(0.0, |per_s| (-per_s * TICK_S).exp()));
        GoalJump { keeps, goal_kpa: None, expected_kpa: [0.0; CHANNELS] }
    }

    /// Goes on for feedback of other bandwidths.
    pub fn take_bandwidths(&mut self, other: &GoalJump) {
        self.keeps = other.keeps;
    }

    /// Begins anew: what the first goal asks for is no jump.
    pub fn restart(&mut self) {
        (self.goal_kpa, self.expected_kpa) = (None, [0.0; CHANNELS]);
    }

    /// Takes in a tick; answers what is left of the errors (kPa) beside what is expected.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn follow(&mut self, situation: &ControlInput) -> Pair {
        let goal_kpa = situation.goals_kpa[0];
        let before_kpa = self.goal_kpa.replace(goal_kpa).unwrap_or(goal_kpa);
        std::array::from_fn(|c| {
            let error_kpa = goal_kpa[c] - situation.undelayed_kpa[c];
            let jump_kpa = goal_kpa[c] - before_kpa[c];
            let jump_kpa = if jump_kpa.abs() > JUMP_KPA[c] { jump_kpa } else { 0.0 };
            let expected_kpa = (self.expected_kpa[c] + jump_kpa) * self.keeps[c];
            self.expected_kpa[c] = expected_kpa.clamp(error_kpa.min(0.0), error_kpa.max(0.0));
            error_kpa - self.expected_kpa[c]
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use model::observation::GOALS_AHEAD;

    const TIME_S: f64 = 1.5;

    fn known() -> GoalJump {
        GoalJump::new([Some(1.0 / TIME_S); CHANNELS])
    }

    fn left(jump: &mut GoalJump, goal_kpa: f64, reads_kpa: f64) -> f64 {
        jump.follow(&ControlInput::of_measured([reads_kpa, -70.0], [[goal_kpa, -70.0]; GOALS_AHEAD + 1]))[0]
    }

    /// A chamber that answers a jump faster than the feedback alone leaves nothing; one that stays where it was leaves all in the end.
    #[test]
    fn what_decays_by_itself_is_left_out() {
        let mut jump = known();
        assert_eq!(left(&mut jump, 100.0, 97.0), 3.0, "the first goal is no jump");
        jump.restart();
        left(&mut jump, 100.0, 100.0);
        for tick in 0..100 {
            let falls = 80.0 + 20.0 * (-f64::from(tick) * TICK_S / 0.5).exp();
            assert!(left(&mut jump, 80.0, falls).abs() < 0.55, "tick {tick}");
        }
        let mut stuck = known();
        left(&mut stuck, 100.0, 100.0);
        let after = |ticks: u32, jump: &mut GoalJump| (0..ticks).map(|_| left(jump, 80.0, 100.0)).last().unwrap();
        let once = after(75, &mut stuck);
        assert!((once + 20.0 * (1.0 - (-1.0_f64).exp())).abs() < 1e-9, "{once}");
        assert!((after(1000, &mut stuck) + 20.0).abs() < 1e-3);
    }

    #[test]
    fn a_goal_that_moves_on_is_no_jump_and_overshoot_is_all_left() {
        let mut jump = known();
        for tick in 0..200 {
            let goal_kpa = 80.0 + 0.4 * f64::from(tick);
            assert!((left(&mut jump, goal_kpa, goal_kpa - 1.0) - 1.0).abs() < 1e-12);
        }
        left(&mut jump, 100.0, 100.0);
        left(&mut jump, 80.0, 99.0);
        assert!((left(&mut jump, 80.0, 79.0) - 1.0).abs() < 1e-12);
        assert!(
            (left(&mut jump, 80.0, 80.5) + 0.5).abs() < 1e-12,
            "what was expected is forgotten once the goal was passed"
        );
    }

    #[test]
    fn nothing_is_expected_of_a_valve_that_nobody_knows() {
        let mut jump = GoalJump::new([None; CHANNELS]);
        left(&mut jump, 100.0, 100.0);
        assert_eq!(left(&mut jump, 80.0, 100.0), -20.0);
    }
}
