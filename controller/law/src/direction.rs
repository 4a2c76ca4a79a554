//! Which way a planned duty is moving, and how much play the valve seems to have.
//!
//! A valve with play of half width `w` follows a duty only after it has reversed by `2w`. Adding `+w` while the
//! planned duty rises and `−w` while it falls undoes that. `w` is not known, and the model behind the
//! feed-forward has none; but where it is missing, the feedback has to supply the same square wave, so
//! the error correlates with the direction and `w` is learned from that:
//!
//! ```text
//! ẇ = η · s · (± e),      s = direction in −1 … 1, blended over a few ticks at a reversal
//! ```
//!
//! On a rig without play `w` stays near zero. Reversals are taken from the plan, which has no noise, with a
//! dead band so that rounding of the plan is none.

use crate::TICK_S;

/// How far a plan must come back from its last extreme to count as a reversal, in duty.
const REVERSAL_DUTY: f64 = 0.0015;
/// Time constant with which the compensation changes sides, in seconds: a step would excite the chamber
/// before the valve's lag lets it through.
const BLEND_S: f64 = 0.1;

/// Direction of one channel's planned duty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Direction {
    extreme: Option<f64>,
    way: f64,
    blended: f64,
}

impl Default for Direction {
    fn default() -> Self {
        Direction { extreme: None, way: 0.0, blended: 0.0 }
    }
}

impl Direction {
    /// Takes in the duty planned for this tick and answers the direction, −1 (falling) … 1 (rising).
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn follow(&mut self, planned: f64) -> f64 {
        let extreme = *self.extreme.get_or_insert(planned);
        let moved = planned - extreme;
        if moved * self.way > 0.0 {
            self.extreme = Some(planned);
        } else if moved.abs() > REVERSAL_DUTY {
            self.way = moved.signum();
            self.extreme = Some(planned);
        }
        self.blended += (self.way - self.blended) * (TICK_S / BLEND_S);
        self.blended
    }
}

/// The play of one channel's valve, learned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LearnedPlay {
    rate: f64,
    widest: f64,
    half_width: f64,
}

impl LearnedPlay {
    /// Starts at no play; learns at `rate` in duty/(kPa s), up to `widest` half width in duty.
    pub fn new(rate: f64, widest: f64) -> Self {
        LearnedPlay { rate, widest, half_width: 0.0 }
    }

    /// The half width in duty.
    pub fn half_width(&self) -> f64 {
        self.half_width
    }

    /// Moves the half width, in duty.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn shift(&mut self, duty: f64) {
        self.half_width = (self.half_width + duty).clamp(0.0, self.widest);
    }

    /// Takes in one tick: the direction of the plan and the error in kPa times the vent's sign.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn learn(&mut self, direction: f64, signed_error_kpa: f64) {
        self.half_width = (self.half_width + self.rate * direction * signed_error_kpa * TICK_S).clamp(0.0, self.widest);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plan_reverses_only_beyond_the_dead_band() {
        let mut direction = Direction::default();
        let mut follow = |planned: f64| (0..100).map(|_| direction.follow(planned)).last().unwrap();
        assert_eq!(follow(0.5), 0.0);
        assert!(follow(0.6) > 0.99);
        assert!(follow(0.599) > 0.99, "1e-3 back is no reversal");
        assert!(follow(0.598) < -0.99, "2e-3 back is one");
        assert!(follow(0.7) > 0.99);
    }

    #[test]
    fn play_never_leaves_its_range() {
        let mut play = LearnedPlay::new(0.02, 0.06);
        (0..10_000).for_each(|_| play.learn(1.0, 10.0));
        assert_eq!(play.half_width(), 0.06);
        (0..10_000).for_each(|_| play.learn(1.0, -10.0));
        assert_eq!(play.half_width(), 0.0);
    }
}
