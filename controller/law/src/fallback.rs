//! The fallback: a PI controller on top of the rig's inverse model.
//!
//! ```text
//! u = u_ff(g, ġ) + w s + (K/b) e + I
//! ```
//!
//! * `u_ff`: duties at which the model, averaged over a revolution, follows goal and slope
//!   ([`SteadyMap::duty_for`]). Both channels are solved together, which decouples them. It looks as far ahead as the
//!   rig file says that valve and wire are late ([`crate::foresight`]).
//! * `w s`: play of the valve undone at reversals of the plan ([`crate::direction`]); learned, from the width that the rig
//!   file states or from zero.
//! * `(K/b) e`: proportional action. `b` is the rate that a unit of duty makes (kPa/s), so `K` in 1/s is a
//!   bandwidth and the same at all pressures. The error is that of the chamber: a sensor's lag is undone
//!   ([`crate::ControlInput::undelayed_kpa`]).
//! * `I`: the paper's integral and anti-windup ([`crate::integral`]), which near the goal moves on with the proportional part as
//!   well, `İ += (K/b) e/T_i`, and stands still where a hold is held ([`crate::rest`]).
//!
//! Tuned on `dual_pressure` and `bench` together, holding the paper's two gains; measured in
//! `docs/performance.md`.

use std::sync::Arc;

use model::observation::{ActionTrajectory, CHANNELS, MOST_CHANGE_DUTY, Pair};
use model::steady::SteadyMap;
use model::valve_path::ValvePath;

use crate::direction::{BacklashEstimator, Direction};
use crate::foresight::{Foresight, is_told};
use crate::integral::{IntegralAction, IntegralSettings, VENT_SIGN};
use crate::repetition::{Left, Repetition};
use crate::repetitions::Repetitions;
use crate::rest::{Hold, Rest};
use crate::{ControlInput, ControlOutput, DutyTerms, TICK_S, saturated};

/// Error of a duty by rounding.
const ROUNDING_DUTY: f64 = 1e-9;

/// Gains of the fallback.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FallbackSettings {
    /// K in 1/s where nothing is known of a valve's timing; a loop with some 80 ms of delay and lag bears about 4.
    pub bandwidth_per_s: f64,
    /// K in 1/s where the rig file states a valve's timing: the feed-forward then does the tracking, and what more feedback
    /// would do is to pass on noise and to teach play what is none.
    pub told_bandwidth_per_s: f64,
    /// The most that K times what a valve is late may be: how near to swinging the loop is (a bare number; 1.6 swings for
    /// ever with a pure delay).
    pub most_lateness: f64,
    /// Rate at which play is learned, in duty/(kPa s).
    pub play_learning: f64,
    /// Rate at which play is learned where the rig file says anything of the valve's path, in duty/(kPa s): what the feed-forward
    /// then leaves is hardly play.
    pub told_play_learning: f64,
    /// The widest play (half width) that is undone, in duty.
    pub widest_play: f64,
    /// Errors beyond these (kPa) are not blamed on play.
    pub play_gate_kpa: Pair,
    /// T_i in s: reset time of the integral, beside the paper's gain.
    pub reset_time_s: f64,
    /// The integral is that fast only while the error is below these (kPa): on the way to a goal it would wind up.
    pub reset_gate_kpa: Pair,
    /// Integral action.
    pub integral: IntegralSettings,
}

impl FallbackSettings {
    /// Iterative learning beside a fallback with these gains for the rig that `map` was made of. Takes 700 kB and a tenth of a second.
    pub fn repetition(&self, map: &SteadyMap) -> Repetition {
        let paths = map.valve_paths();
        Repetition::new(paths, bandwidths(paths, self))
    }

    /// Learning for several references, each kept by itself.
    pub fn repetitions(&self, map: &SteadyMap) -> Repetitions {
        Repetitions::new(&self.repetition(map))
    }
}

impl Default for FallbackSettings {
    fn default() -> Self {
        FallbackSettings {
            bandwidth_per_s: 3.0,
            told_bandwidth_per_s: 1.5,
            most_lateness: 0.35,
            play_learning: 0.02,
            told_play_learning: 0.002,
            widest_play: 0.06,
            play_gate_kpa: [3.0, 2.0],
            reset_time_s: 1.5,
            reset_gate_kpa: [1.0, 0.5],
            integral: IntegralSettings::default(),
        }
    }
}

/// State that one tick left for the anti-windup to work with.
#[derive(Debug, Clone, Copy, Default)]
struct Pending {
    error_kpa: f64,
    raw: f64,
    /// True where the feed-forward itself is within 0 … 1; where no duty holds the goal, nothing may integrate.
    reachable: bool,
    /// Proportional part in duty.
    proportional: f64,
    /// State of the channel against its goal; at rest nothing integrates.
    hold: Hold,
}

/// The fallback controller.
#[derive(Debug, Clone)]
pub struct Fallback {
    map: Arc<SteadyMap>,
    settings: FallbackSettings,
    foresight: Foresight,
    /// K of each channel in 1/s.
    bandwidth_per_s: Pair,
    integral: IntegralAction,
    directions: [Direction; CHANNELS],
    play: [BacklashEstimator; CHANNELS],
    pending: [Pending; CHANNELS],
    /// Gain of a duty on the pressures in the last tick, in kPa/s per duty.
    gain_kpa_per_s: Pair,
    rest: Rest,
    /// True where the rig file says anything of the valve's path, by channel.
    is_known: [bool; CHANNELS],
    /// Duties that were sent in the last tick.
    sent: [Option<f64>; CHANNELS],
}

impl Fallback {
    /// A fallback for the rig that `map` was made of.
    pub fn new(map: Arc<SteadyMap>, settings: FallbackSettings) -> Self {
        let paths = *map.valve_paths();
        let bandwidth_per_s = bandwidths(&paths, &settings);
        Fallback {
            foresight: Foresight::new(Arc::clone(&map)),
            map,
            settings,
            bandwidth_per_s,
            integral: IntegralAction::new(settings.integral),
            directions: paths.map(|path| direction(&path)),
            play: paths.map(|path| play(&path, &settings)),
            pending: [Pending::default(); CHANNELS],
            gain_kpa_per_s: [1.0; CHANNELS],
            rest: Rest::default(),
            is_known: paths.each_ref().map(is_told),
            sent: [None; CHANNELS],
        }
    }

    /// Takes its feed-forward and gains from another model from now on, and hands back the one in force. Play begins anew from
    /// the width that the new model states, where it states one.
    ///
    /// # Real-time
    /// May run in the tick: nothing is freed as long as somebody else holds what is handed back.
    pub fn exchange_map(&mut self, map: Arc<SteadyMap>) -> Arc<SteadyMap> {
        let paths = *map.valve_paths();
        self.bandwidth_per_s = bandwidths(&paths, &self.settings);
        self.is_known = paths.each_ref().map(is_told);
        #[allow(clippy::needless_range_loop)] // several arrays of channels side by side
        for c in 0..CHANNELS {
            self.directions[c].take_plan(&direction(&paths[c]));
            if is_told(&paths[c]) {
                self.play[c] = play(&paths[c], &self.settings);
            }
        }
        self.foresight = Foresight::in_flight(Arc::clone(&map));
        std::mem::replace(&mut self.map, map)
    }

    /// Remainder of the last decision for the next flight of the reference.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn left(&self) -> Left {
        // At a limit nothing that is added acts, and what is left there teaches nothing.
        let acts = |p: &Pending| p.reachable && (0.0..=1.0).contains(&p.raw);
        let error_kpa = self.pending.map(|p| acts(&p).then_some(p.error_kpa));
        Left { error_kpa, gain_kpa_per_s: self.gain_kpa_per_s }
    }

    /// Forgets integral and direction; keeps what was learned about the valves' play.
    pub fn restart(&mut self) {
        self.integral.set([0.0; CHANNELS]);
        self.directions.iter_mut().for_each(Direction::restart);
        self.foresight.restart();
        self.rest = Rest::default();
        self.sent = [None; CHANNELS];
        self.pending = [Pending::default(); CHANNELS];
    }

    /// Puts the integral where it is known to have been, in duty. Not for the tick.
    pub fn set_integral(&mut self, duty: Pair) {
        self.integral.set(duty);
    }

    /// Decides the duties of a tick.
    ///
    /// # Real-time
    /// Some twenty look-ups of the steady map, a few µs; may run in the tick.
    pub fn decide(&mut self, situation: &ControlInput) -> ControlOutput {
        self.foresight.begin(situation);
        let (planned, turning) = self.foresight.duties(situation, 0);
        // Around what is planned: what feedback adds to it is small.
        let around = planned.map(|duty| duty.clamp(0.0, 1.0));
        let gain = self.map.sent_gain_kpa_per_s(self.map.chamber_kpa(situation.undelayed_kpa), around);
        let integral = self.integral.duty();
        let holds = self.rest.follow(situation);
        let learned = learned(situation, 0);
        let repeats = situation.learned_duty.is_some();
        let mut parts = [DutyTerms::default(); CHANNELS];
        for c in 0..CHANNELS {
            let error_kpa = situation.goals_kpa[0][c] - situation.undelayed_kpa[c];
            let feed_forward = planned[c].clamp(0.0, 1.0) + learned[c];
            let direction = self.directions[c].follow(turning[c].clamp(0.0, 1.0));
            parts[c] = DutyTerms {
                feed_forward,
                play: self.play[c].half_width() * self.directions[c].drive(),
                correction: 0.0,
                proportional: self.bandwidth_per_s[c] * error_kpa / gain[c],
                integral: integral[c],
            };
            let raw = parts[c].raw();
            let reachable = (0.0..=1.0).contains(&planned[c]);
            // What repetitions teach would be learned twice, and the two would drift against each other: the first flight
            // teaches play, the others the rest.
            // On a hold the plan does not say which way the flapper lies; where the width was never known, some of what a step
            // leaves there is play all the same.
            let shows_play = if self.is_known[c] { holds[c] == Hold::Moving } else { holds[c] != Hold::Resting };
            let learns = !repeats && shows_play && (0.0..=1.0).contains(&raw);
            if learns && error_kpa.abs() < self.settings.play_gate_kpa[c] {
                self.play[c].learn(direction, VENT_SIGN[c] * error_kpa);
            }
            let proportional = parts[c].proportional;
            self.pending[c] = Pending { error_kpa, raw, reachable, proportional, hold: holds[c] };
        }
        let trajectory = self.trajectory(situation, &parts);
        self.foresight.advance(situation);
        self.gain_kpa_per_s = gain;
        ControlOutput { parts, trajectory }
    }

    /// Takes what the command that was decided for is to be moved by into the integral, in duty: it stays.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn absorb(&mut self, duty: Pair) {
        for (c, (pending, duty)) in self.pending.iter_mut().zip(duty).enumerate() {
            self.integral.shift(c, duty);
            pending.raw += duty;
        }
    }

    /// The duties of now, and what is planned for the next ticks: feed-forward and play as they will be, feedback as it is.
    fn trajectory(&self, situation: &ControlInput, parts: &[DutyTerms; CHANNELS]) -> ActionTrajectory {
        let mut directions = self.directions;
        ActionTrajectory(std::array::from_fn(|j| {
            if j == 0 {
                return parts.map(|p| saturated(p.raw()));
            }
            let (ahead, turning) = self.foresight.duties(situation, j);
            let learned = learned(situation, j);
            std::array::from_fn(|c| {
                directions[c].follow(turning[c].clamp(0.0, 1.0));
                let play = self.play[c].half_width() * directions[c].drive();
                saturated(ahead[c].clamp(0.0, 1.0) + learned[c] + play + parts[c].proportional + parts[c].integral)
            })
        }))
    }

    /// Tells what a policy has added to the last decision, so that the anti-windup does not work against it.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn corrected(&mut self, correction: Pair) {
        for (pending, correction) in self.pending.iter_mut().zip(correction) {
            pending.raw += correction;
        }
    }

    /// Tells what was really sent, after all limits; the integral moves on from there.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn applied(&mut self, duty: Pair) {
        for (c, (pending, applied)) in self.pending.into_iter().zip(duty).enumerate() {
            if pending.reachable {
                let (resting, before) = (pending.hold == Hold::Resting, self.integral.duty()[c]);
                let error_kpa = if resting { 0.0 } else { pending.error_kpa };
                let wound = unheld(pending.raw, applied, self.sent[c]);
                self.integral.update(c, error_kpa, wound, applied);
                // Not at a limit, where nothing that is added acts.
                let near = pending.error_kpa.abs() < self.settings.reset_gate_kpa[c] && applied == pending.raw;
                if near && !resting {
                    self.integral.shift(c, pending.proportional / self.settings.reset_time_s * TICK_S);
                }
                if pending.hold == Hold::Standing {
                    self.put_into_play(c, self.integral.duty()[c] - before);
                }
            }
        }
        self.sent = duty.map(Some);
    }

    /// Takes what the integral did while the pressure stood for a way within the play, where the rig file states one. The command stays as it is; when the goal moves on, the whole way to the side that it needs is known.
    fn put_into_play(&mut self, channel: usize, duty: f64) {
        let half_width = self.play[channel].half_width();
        if self.is_known[channel] && half_width > ROUNDING_DUTY {
            let taken = self.directions[channel].shift_within_play(duty / half_width);
            self.integral.shift(channel, -taken * half_width);
        }
    }

    /// The half width of play that was learned for each valve, in duty.
    pub fn learned_play(&self) -> Pair {
        self.play.map(|p| p.half_width())
    }
}

/// Duties that repetitions have taught for `ahead` ticks from now, in duty.
fn learned(situation: &ControlInput, ahead: usize) -> Pair {
    situation.learned_duty.map_or([0.0; CHANNELS], |learned| learned[ahead])
}

/// Duty that was asked for, less what a limit on the command's speed held back of it: that comes a tick later, and winds nothing
/// up. `sent` is the tick before; all in duty.
fn unheld(raw: f64, applied: f64, sent: Option<f64>) -> f64 {
    let Some(sent) = sent else { return raw };
    let (moved, held_back) = (applied - sent, raw.clamp(0.0, 1.0) - applied);
    let at_the_limit = moved.abs() > MOST_CHANGE_DUTY - ROUNDING_DUTY;
    if at_the_limit && moved * held_back > 0.0 { raw - held_back } else { raw }
}

/// K of each channel in 1/s.
fn bandwidths(paths: &[ValvePath; CHANNELS], settings: &FallbackSettings) -> Pair {
    paths.map(|path| {
        let borne = settings.most_lateness / (path.late_s() + 0.5 * TICK_S);
        if is_told(&path) { borne.min(settings.told_bandwidth_per_s) } else { settings.bandwidth_per_s }
    })
}

/// Reversals of a valve, as far as the rig file tells of it.
fn direction(path: &ValvePath) -> Direction {
    if is_told(path) { Direction::told(path) } else { Direction::default() }
}

/// Play as the rig file states it, or none yet.
fn play(path: &ValvePath, settings: &FallbackSettings) -> BacklashEstimator {
    let rate = if is_told(path) { settings.told_play_learning } else { settings.play_learning };
    BacklashEstimator::starting_at(rate, settings.widest_play, path.half_width_duty)
}
