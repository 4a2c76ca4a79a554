//! Commands that reach one valve of each hypothesis: the command some ticks late, through a lag, further shut.
//!
//! ```text
//! v(τ) = v(τ−1) + (1 − e^(−T/θ)) (u(τ−d) − v(τ−1)),      duty = v − offset, within 0 … 1
//! ```
//!
//! The model's own delay, lag and play come on top, as the rig file has them.

use model::observation::TICKS_PER_S;
use model::real::{Lanes, Real};

use crate::hypotheses::{HYPOTHESES, lanes};

/// One number for each hypothesis.
pub(crate) type Eight = Lanes<8>;

/// Ticks of delay that a hypothesis may add.
pub const MOST_DELAY_TICKS: usize = 2;

/// The numbers of all hypotheses that a path needs.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PathSettings {
    /// Share of the way that a lagging valve goes in a tick; 1 without a lag.
    share: Eight,
    closed: Eight,
}

impl PathSettings {
    pub(crate) fn new() -> Self {
        let share = |lag_ms: f64| {
            if lag_ms > 0.0 { 1.0 - (-1e3 / (TICKS_PER_S * lag_ms)).exp() } else { 1.0 }
        };
        PathSettings { share: lanes(|h| share(h.lag_ms)), closed: lanes(|h| h.closed_duty) }
    }
}

/// The way from commands to one valve.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ActuatorPath {
    /// Commands of the ticks before, the newest first.
    sent: [f64; MOST_DELAY_TICKS],
    opening: Eight,
}

impl ActuatorPath {
    /// A command that has long been in force.
    pub(crate) fn at_rest(duty: f64) -> Self {
        ActuatorPath { sent: [duty; MOST_DELAY_TICKS], opening: Eight::splat(duty) }
    }

    /// Moves on by a tick with this command, and gives the duty that each hypothesis' valve has in it.
    #[inline]
    pub(crate) fn step(&mut self, command: f64, settings: &PathSettings) -> Eight {
        let sent = self.sent;
        let delayed = Eight::from_lanes(|lane| {
            let late = HYPOTHESES.get(lane).map_or(0, |h| h.delay_ticks);
            late.checked_sub(1).and_then(|place| sent.get(place)).copied().unwrap_or(command)
        });
        self.sent.rotate_right(1);
        self.sent[0] = command;
        self.opening += settings.share * (delayed - self.opening);
        (self.opening - settings.closed).limited(Eight::splat(0.0), Eight::splat(1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A step of the command from 1 to 0 and what each hypothesis makes of it, by hand.
    #[test]
    fn a_step_comes_late_slowly_and_further_shut() {
        let settings = PathSettings::new();
        let mut path = ActuatorPath::at_rest(1.0);
        let steps: Vec<Eight> = (0..4).map(|_| path.step(0.0, &settings)).collect();
        let at = |tick: usize, lane: usize| steps[tick].lane(lane);
        assert_eq!((at(0, 0), at(1, 0)), (0.0, 0.0));
        assert_eq!([at(0, 1), at(1, 1), at(2, 1)], [1.0, 1.0, 0.0], "two ticks late");
        // 1 − e^(−20/100) of the way in each tick.
        assert!((at(2, 2) - (-0.6_f64).exp()).abs() < 1e-12, "{}", at(2, 2));
        let mut path = ActuatorPath::at_rest(1.0);
        assert!((path.step(0.5, &settings).lane(3) - 0.44).abs() < 1e-12);
    }
}
