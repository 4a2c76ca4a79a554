//! Direction in which a planned duty is moving, and the play that the valve seems to have.
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
//! On a rig without play `w` stays near zero; where the rig file states a width, learning starts from it. Reversals are
//! taken from the plan, which has no noise, with a dead band so that rounding of the plan is none.
//!
//! Where the rig file states plays of several widths side by side, a reversal does not cross them at once: how far the
//! duty has to be beside the plan then follows from how far the plan has come back (`plays`).
//!
//! Between the duty and the flapper's play lies the coil's lag. Where the rig file states it, it is undone, so that the
//! flapper crosses its play in few ticks instead of several time constants:
//!
//! ```text
//! c(τ+1) = α c(τ) + (1 − α) u(τ)      gives      u(τ) = (c(τ+1) − α c(τ))/(1 − α),      α = e^(−T/τ_coil)
//! ```

use model::observation::MOST_CHANGE_DUTY;
use model::valve_path::ValvePath;

use crate::TICK_S;
use crate::plays::Plays;

/// Distance by which a plan must come back from its last extreme to count as a reversal, in duty.
const REVERSAL_DUTY: f64 = 0.0015;
/// Time constant in seconds with which the compensation changes sides where nothing is known of the valve's lag: a step
/// would excite the chamber before the valve's lag lets it through.
const BLEND_S: f64 = 0.1;
/// Time constant in seconds of the same where the lag is known and undone. Chosen: a tick and a half takes the worst off a lag that is known to some
/// tens of percent.
const KNOWN_BLEND_S: f64 = 0.03;
/// By how much undoing the lag may change a duty in a tick: a little less than what is let through, as the feed-forward moves as well.
/// A part that is cut off would leave the flapper short of the other side of its play.
const MOST_STEP_DUTY: f64 = 0.8 * MOST_CHANGE_DUTY;

/// Direction of one channel's planned duty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Direction {
    extreme: Option<f64>,
    /// Direction in which the plan went last: −1, 1, or 0 where that is not known.
    heading: f64,
    way: f64,
    blended: f64,
    drive: f64,
    /// Share of the way to the other side that is covered in a tick.
    share: f64,
    /// α of the coil's lag; 0 where it is not undone.
    keeps: f64,
    /// The most that the drive may change in a tick, in half widths of play.
    most_step: f64,
    /// The plays, where they scatter.
    scattered: Option<Plays>,
}

impl Default for Direction {
    /// Direction for a valve whose lag is not known.
    fn default() -> Self {
        Direction {
            extreme: None,
            heading: 0.0,
            way: 0.0,
            blended: 0.0,
            drive: 0.0,
            share: TICK_S / BLEND_S,
            keeps: 0.0,
            most_step: f64::INFINITY,
            scattered: None,
        }
    }
}

impl Direction {
    /// Direction for a valve of which the rig file states something: its coil's lag is undone.
    pub fn told(path: &ValvePath) -> Self {
        let keeps = if path.coil_lag_s > 0.0 { (-TICK_S / path.coil_lag_s).exp() } else { 0.0 };
        // Without play it is infinite, and there is nothing to cross.
        let most_step = MOST_STEP_DUTY / path.half_width_duty;
        let scattered = path.scattered_duty.map(Plays::new);
        Direction { share: 1.0 - (-TICK_S / KNOWN_BLEND_S).exp(), keeps, most_step, scattered, ..Direction::default() }
    }

    /// Goes on for another valve path.
    pub fn take_path(&mut self, other: &Direction) {
        (self.share, self.keeps, self.most_step) = (other.share, other.keeps, other.most_step);
        self.scattered = other.scattered;
        if let Some(plays) = &mut self.scattered {
            plays.restart();
        }
    }

    /// Goes on in the same direction for a plan that another model makes: where that begins is no reversal.
    pub fn take_plan(&mut self, other: &Direction) {
        self.take_path(other);
        self.extreme = None;
    }

    /// Begins anew, with nothing planned yet.
    pub fn restart(&mut self) {
        let path = *self;
        *self = Direction::default();
        self.take_path(&path);
    }

    /// Drive for the last plan that was taken in, in half widths of play: the direction with the lag undone.
    pub fn drive(&self) -> f64 {
        self.drive
    }

    /// Moves within the play by so many half widths while the plan stands, and answers how much of it there was room for. It
    /// stays there until the plan moves again.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn shift_within_play(&mut self, half_widths: f64) -> f64 {
        let moved = (self.blended + half_widths).clamp(-1.0, 1.0) - self.blended;
        self.blended += moved;
        self.drive += moved;
        self.way = self.blended;
        self.heading = if self.way.abs() >= 1.0 { self.way.signum() } else { 0.0 };
        if let (Some(plays), Some(planned)) = (&mut self.scattered, self.extreme) {
            plays.pull(planned + plays.mean_half_width() * self.way);
        }
        moved
    }

    /// Takes in the duty planned for this tick and answers the direction, −1 (falling) … 1 (rising).
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn follow(&mut self, planned: f64) -> f64 {
        let extreme = *self.extreme.get_or_insert(planned);
        let moved = planned - extreme;
        // Where nothing is engaged either way, going on is a way to be taken as well.
        if moved * self.heading > 0.0 || moved.abs() > REVERSAL_DUTY {
            self.extreme = Some(planned);
            self.heading = moved.signum();
            self.way = self.way_to(planned);
        }
        let wanted = self.blended + (self.way - self.blended) * self.share;
        let undone = (wanted - self.keeps * self.blended) / (1.0 - self.keeps);
        self.drive = undone.clamp(self.drive - self.most_step, self.drive + self.most_step);
        self.blended = self.keeps * self.blended + (1.0 - self.keeps) * self.drive;
        self.blended
    }

    /// Place of the flapper in its play once the plan has come this far, in half widths.
    fn way_to(&mut self, planned: f64) -> f64 {
        let Some(plays) = &mut self.scattered else { return self.heading };
        let half_width = plays.mean_half_width();
        let duty = plays.undone(planned, planned + half_width * self.way);
        ((duty - planned) / half_width).clamp(-1.0, 1.0)
    }
}

/// Distance that a duty has come since it last turned round.
///
/// A valve with play of half width `w` is engaged again once the duty has come back by `2w`; before, nothing moves.
/// Turns within [`ReversalTravel::TURN`] are none: noise of the converter makes them in every tick.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ReversalTravel {
    /// Duty at which it turned round.
    from: f64,
    /// The furthest it has come since.
    furthest: f64,
    now: f64,
}

impl From<f64> for ReversalTravel {
    /// A duty that has long been what it is.
    fn from(duty: f64) -> Self {
        ReversalTravel { from: duty, furthest: duty, now: duty }
    }
}

impl ReversalTravel {
    /// Distance by which a duty must come back to have turned round.
    pub const TURN: f64 = 0.008;
    /// More than this is told as this: the widest play is crossed.
    pub const MOST: f64 = 0.15;

    /// Takes in the duty of a tick.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn follow(&mut self, duty: f64) {
        let upwards = self.furthest >= self.from;
        let back = if upwards { self.furthest - duty } else { duty - self.furthest };
        if back > Self::TURN {
            self.from = self.furthest;
            self.furthest = duty;
        } else if back < 0.0 {
            self.furthest = duty;
        }
        self.now = duty;
    }

    /// The distance since the last turn, upwards positive, within ±[`ReversalTravel::MOST`].
    pub fn distance(&self) -> f64 {
        (self.now - self.from).clamp(-Self::MOST, Self::MOST)
    }
}

/// The play of one channel's valve, learned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BacklashEstimator {
    rate: f64,
    widest: f64,
    half_width: f64,
}

impl BacklashEstimator {
    /// Starts at no play; learns at `rate` in duty/(kPa s), up to `widest` half width in duty.
    pub fn new(rate: f64, widest: f64) -> Self {
        BacklashEstimator { rate, widest, half_width: 0.0 }
    }

    /// Starts at a known half width (duty); may widen to one and a half times that where it is more than the widest.
    pub fn starting_at(rate: f64, widest: f64, half_width: f64) -> Self {
        BacklashEstimator { rate, widest: widest.max(1.5 * half_width), half_width }
    }

    /// The half width in duty.
    pub fn half_width(&self) -> f64 {
        self.half_width
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

    /// A drive, put through the lag that it undoes, is the direction itself.
    #[test]
    fn a_known_lag_is_undone() {
        let lag_s = 0.08;
        let path = ValvePath { coil_lag_s: lag_s, half_width_duty: 0.03, is_timed: true, ..ValvePath::default() };
        let (mut direction, mut coil, mut before) = (Direction::told(&path), 0.0, 0.0);
        let keeps = (-TICK_S / lag_s).exp();
        for tick in 0..200 {
            let planned = 0.5 + 0.1 * (f64::from(tick) * 0.05).sin();
            let way = direction.follow(planned);
            coil = keeps * coil + (1.0 - keeps) * direction.drive();
            assert!((coil - way).abs() < 1e-9, "tick {tick}: {coil} for {way}");
            let step = path.half_width_duty * (direction.drive() - before);
            assert!(step.abs() <= MOST_STEP_DUTY + 1e-12, "tick {tick}: {step}");
            before = direction.drive();
        }
        let mut plain = Direction::default();
        plain.follow(0.5);
        let way = plain.follow(0.6);
        assert_eq!(plain.drive(), way);
    }

    /// Half way through the play, nothing is engaged: it stays there while the plan stands, and goes on to either side.
    #[test]
    fn within_the_play_both_ways_are_left() {
        for (planned, side) in [(0.61, 1.0), (0.59, -1.0)] {
            let mut direction = Direction::default();
            let follow =
                |direction: &mut Direction, planned: f64| (0..100).map(|_| direction.follow(planned)).last().unwrap();
            follow(&mut direction, 0.5);
            follow(&mut direction, 0.6);
            assert!((direction.shift_within_play(-1.4) + 1.4).abs() < 1e-3);
            assert!((follow(&mut direction, 0.6) + 0.4).abs() < 1e-3, "a plan that stands moves nothing");
            assert!((follow(&mut direction, planned) - side).abs() < 1e-3);
            let room = direction.shift_within_play(5.0 * side);
            assert!(room.abs() < 1e-3, "{room} beyond the play");
        }
    }

    #[test]
    fn travel_counts_from_the_last_turn_and_ignores_noise() {
        let mut travel = ReversalTravel::from(0.5);
        let mut at = |duty: f64| {
            travel.follow(duty);
            travel.distance()
        };
        let close = |found: f64, expected: f64| assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        close(at(0.53), 0.03);
        close(at(0.525), 0.025);
        close(at(0.55), 0.05);
        close(at(0.54), -0.01);
        close(at(0.51), -0.04);
        close(at(0.515), -0.035);
        close(at(0.53), 0.02);
        close(at(0.9), 0.15);
    }

    #[test]
    fn play_never_leaves_its_range() {
        let mut play = BacklashEstimator::new(0.02, 0.06);
        (0..10_000).for_each(|_| play.learn(1.0, 10.0));
        assert_eq!(play.half_width(), 0.06);
        (0..10_000).for_each(|_| play.learn(1.0, -10.0));
        assert_eq!(play.half_width(), 0.0);
    }
}
