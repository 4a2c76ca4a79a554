//! The fallback: a PI controller on top of the rig's inverse model.
//!
//! ```text
//! u = u_ff(g, ġ) + w s + (K/b) e + I
//! ```
//!
//! * `u_ff`: duties at which the model, averaged over a revolution, follows goal and slope
//!   ([`SteadyMap::duty_for`]). Both channels are solved together, which decouples them. It looks
//!   [`FallbackSettings::lead_ticks`] ahead, about what valve and wire delay.
//! * `w s`: play of the valve undone at reversals of the plan ([`crate::direction`]); learned, zero at first.
//! * `(K/b) e`: proportional action. `b` is the rate that a unit of duty makes (kPa/s), so `K` in 1/s is a
//!   bandwidth and the same at all pressures.
//! * `I`: the paper's integral and anti-windup ([`crate::integral`]).
//!
//! Tuned on `dual_pressure` and `bench` together, holding the paper's two gains; measured in
//! `docs/performance.md`.

use std::sync::Arc;

use model::observation::{ActionTrajectory, CHANNELS, GOALS_AHEAD, Pair};
use model::steady::SteadyMap;

use crate::direction::{BacklashEstimator, Direction};
use crate::integral::{IntegralAction, IntegralSettings, VENT_SIGN};
use crate::{ControlInput, ControlOutput, DutyTerms, TICK_S, saturated};

/// Gains of the fallback.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FallbackSettings {
    /// K in 1/s; a loop with some 80 ms of delay and lag bears about 4.
    pub bandwidth_per_s: f64,
    /// Ticks that the feed-forward looks ahead (1 … 14).
    pub lead_ticks: usize,
    /// How fast play is learned, in duty/(kPa s).
    pub play_learning: f64,
    /// The widest play (half width) that is undone, in duty.
    pub widest_play: f64,
    /// Errors beyond these (kPa) are not blamed on play.
    pub play_gate_kpa: Pair,
    /// T_i in s: reset time of the integral while a policy flies, beside the paper's gain.
    pub reset_time_s: f64,
    /// The integral is that fast only while the error is below these (kPa): on the way to a goal it would wind up.
    pub reset_gate_kpa: Pair,
    /// Integral action.
    pub integral: IntegralSettings,
}

impl Default for FallbackSettings {
    fn default() -> Self {
        FallbackSettings {
            bandwidth_per_s: 3.0,
            lead_ticks: 2,
            play_learning: 0.02,
            widest_play: 0.06,
            play_gate_kpa: [3.0, 2.0],
            reset_time_s: 1.5,
            reset_gate_kpa: [1.0, 0.5],
            integral: IntegralSettings::default(),
        }
    }
}

/// What one tick left for the anti-windup to work with.
#[derive(Debug, Clone, Copy, Default)]
struct Pending {
    error_kpa: f64,
    raw: f64,
    /// Whether the feed-forward itself is within 0 … 1; where no duty holds the goal, nothing may integrate.
    reachable: bool,
    /// Proportional part in duty.
    proportional: f64,
    /// Whether a policy flew.
    flown: bool,
}

/// The fallback controller.
#[derive(Debug, Clone)]
pub struct Fallback {
    map: Arc<SteadyMap>,
    settings: FallbackSettings,
    integral: IntegralAction,
    directions: [Direction; CHANNELS],
    play: [BacklashEstimator; CHANNELS],
    pending: [Pending; CHANNELS],
}

impl Fallback {
    /// A fallback for the rig that `map` was made of.
    pub fn new(map: Arc<SteadyMap>, settings: FallbackSettings) -> Self {
        Fallback {
            map,
            settings,
            integral: IntegralAction::new(settings.integral),
            directions: [Direction::default(); CHANNELS],
            play: [BacklashEstimator::new(settings.play_learning, settings.widest_play); CHANNELS],
            pending: [Pending::default(); CHANNELS],
        }
    }

    /// Takes its feed-forward and gains from another model from now on, and hands back the one in force.
    ///
    /// # Real-time
    /// May run in the tick: nothing is freed as long as somebody else holds what is handed back.
    pub fn exchange_map(&mut self, map: Arc<SteadyMap>) -> Arc<SteadyMap> {
        std::mem::replace(&mut self.map, map)
    }

    /// Forgets integral and direction; keeps what was learned about the valves' play.
    pub fn restart(&mut self) {
        self.integral.set([0.0; CHANNELS]);
        self.directions = [Direction::default(); CHANNELS];
        self.pending = [Pending::default(); CHANNELS];
    }

    /// Decides the duties of a tick.
    ///
    /// # Real-time
    /// Seven look-ups of the steady map, about 1 µs; may run in the tick.
    pub fn decide(&mut self, situation: &ControlInput) -> ControlOutput {
        let lead = self.settings.lead_ticks.clamp(1, GOALS_AHEAD - 1);
        let planned = self.planned(situation, lead);
        let gain = self.map.gain_kpa_per_s(situation.measured_kpa);
        let integral = self.integral.duty();
        let mut parts = [DutyTerms::default(); CHANNELS];
        for c in 0..CHANNELS {
            let error_kpa = situation.goals_kpa[0][c] - situation.measured_kpa[c];
            let feed_forward = planned[c].clamp(0.0, 1.0);
            let direction = self.directions[c].follow(feed_forward);
            parts[c] = DutyTerms {
                feed_forward,
                play: self.play[c].half_width() * direction,
                correction: 0.0,
                proportional: self.settings.bandwidth_per_s * error_kpa / gain[c],
                integral: integral[c],
            };
            let raw = parts[c].raw();
            let reachable = feed_forward == planned[c];
            if error_kpa.abs() < self.settings.play_gate_kpa[c] && (0.0..=1.0).contains(&raw) {
                self.play[c].learn(direction, VENT_SIGN[c] * error_kpa);
            }
            let proportional = parts[c].proportional;
            self.pending[c] = Pending { error_kpa, raw, reachable, proportional, flown: false };
        }
        let trajectory = ActionTrajectory(std::array::from_fn(|j| {
            let ahead = if j == 0 { planned } else { self.planned(situation, (lead + j).min(GOALS_AHEAD - 1)) };
            std::array::from_fn(|c| saturated(parts[c].raw() - planned[c].clamp(0.0, 1.0) + ahead[c].clamp(0.0, 1.0)))
        }));
        ControlOutput { parts, trajectory }
    }

    /// Tells what a policy has added to the last decision. The anti-windup then does not work against it, and the
    /// integral moves on faster, as a policy damps what it alone would make swing:
    ///
    /// ```text
    /// İ += (K/b) e/T_i
    /// ```
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn corrected(&mut self, correction: Pair) {
        for (pending, correction) in self.pending.iter_mut().zip(correction) {
            pending.raw += correction;
            pending.flown = true;
        }
    }

    /// Tells what was really sent, after all limits; the integral moves on from there.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn applied(&mut self, duty: Pair) {
        for (c, (pending, applied)) in self.pending.into_iter().zip(duty).enumerate() {
            if pending.reachable {
                self.integral.update(c, pending.error_kpa, pending.raw, applied);
                // Not at a limit, where nothing that is added acts.
                let near = pending.error_kpa.abs() < self.settings.reset_gate_kpa[c] && applied == pending.raw;
                if near && pending.flown {
                    self.integral.shift(c, pending.proportional / self.settings.reset_time_s * TICK_S);
                }
            }
        }
    }

    /// The half width of play that was learned for each valve, in duty.
    pub fn learned_play(&self) -> Pair {
        self.play.map(|p| p.half_width())
    }

    /// Feed-forward for the goal `ahead` ticks from now, not limited.
    fn planned(&self, situation: &ControlInput, ahead: usize) -> Pair {
        let goal = |j: usize| situation.goals_kpa[j.min(GOALS_AHEAD)];
        let (before, here, after) = (goal(ahead - 1), goal(ahead), goal(ahead + 1));
        let slope = std::array::from_fn(|c| (after[c] - before[c]) / (2.0 * TICK_S));
        self.map.duty_for(here, slope)
    }
}
