//! Iterative learning: a reference that is flown again and again is followed better each time.
//!
//! The error that a flight leaves, tick by tick, is taken off in the next by a duty `δ` that is added to the feed-forward. Norm-optimal
//! (Amann, Owens, Rogers, *IEE Proc. D* 143, 1996; Schoellig, Mueller, D'Andrea, *Auton. Robots* 33, 2012):
//!
//! ```text
//! δ' = argmin |e − G (δ' − δ)|² + λ |δ' − δ|² + s |D² δ'|²
//!    = Q δ + L e,      M = GᵀG + λ + s D²ᵀD²,   Q = M⁻¹ (GᵀG + λ),   L = M⁻¹ Gᵀ
//! ```
//!
//! `G` is what a duty does to the pressure in the closed loop: delay and lag of the valve, then a chamber that the feedback
//! holds. Divided by the valve's gain it is the same all along a reference, so `Q` and `L` are two short symmetric filters,
//! worked out once, and a tick costs some hundred multiplications. A tick's `δ` is renewed half a filter after it was flown
//! and used in the next flight, so nothing has to be worked out between flights. The first flight, or as
//! many as make a minute, teaches the fallback the valves' play and nothing else.
//!
//! All that is learned belongs to one reference and to one model; [`crate::repetitions`] keeps that of several references. It lies
//! beside the law and not in it: what controls may change from flight to flight, and all that build on the fallback are told the same
//! ([`crate::ControlInput::learned_duty`]).

use model::observation::{AHEAD, CHANNELS, Pair};
use model::valve_path::ValvePath;
use nalgebra::{DMatrix, DVector};

use crate::TICK_S;
use crate::foresight::{UNKNOWN_LATE_TICKS, is_told};

/// Ticks to either side that a filter reaches: 0.8 s, in which the closed loop has nearly forgotten.
const HALF: usize = 40;
const TAPS: usize = 2 * HALF + 1;
/// Ticks of a flight that are learned, five minutes; beyond them nothing is added.
pub const LONGEST_TICKS: usize = 15_000;
/// λ in s²: a change that acts for a tick (20 ms) at all is worth it. Chosen with the next on `bench`.
const CHANGE_WEIGHT_S2: f64 = 4e-4;
/// s in s²: what wiggles within a few ticks is noise.
const BEND_WEIGHT_S2: f64 = 0.4;
/// Errors in kPa beyond which nothing is learned: on the way to a goal that is out of reach.
const MOST_ERROR_KPA: Pair = [1.0, 0.5];
/// Errors in kPa below which learning begins again after a limit or such an error. The way back is no error of the feed-forward: duties that are learned from
/// it act where the next flight is at the limit, and left two to three times the error of the first flight on rigs that cannot follow
/// their reference everywhere.
const BACK_KPA: Pair = [0.2, 0.1];
/// Share of what was learned that a flight forgets, so that nothing builds up where errors are not its doing.
const FORGOTTEN: f64 = 0.05;
/// The most that is added, in duty.
const MOST_DUTY: f64 = 0.2;
/// Share of the step that a flight takes: the first ones whole, later ones less, so that noise is averaged over several.
const SHARES: [f64; 4] = [1.0, 0.8, 0.6, 0.45];
const LATER_SHARE: f64 = 0.3;
/// Ticks of flight that teach the valves' play alone: 50 s, in which the fallback has learned most of it on `bench`. What is learned of both
/// at once drifts against each other.
const PLAY_TICKS: usize = 2_500;

/// Both filters of a channel.
#[derive(Debug, Clone, PartialEq)]
struct Filters {
    /// Q, over δ.
    keeps: [f64; TAPS],
    /// L, over errors divided by the valve's gain.
    learns: [f64; TAPS],
}

impl Filters {
    fn of(path: &ValvePath, bandwidth_per_s: f64) -> Self {
        let response = response(path, bandwidth_per_s);
        // Long enough for the middle row not to feel the ends.
        let count = 3 * TAPS;
        let g = DMatrix::from_fn(count, count, |row, column| {
            row.checked_sub(column).and_then(|n| response.get(n)).copied().unwrap_or(0.0)
        });
        let bend = DMatrix::from_fn(count, count, |row, column| match row.abs_diff(column) {
            0 => 2.0,
            1 => -1.0,
            _ => 0.0,
        });
        let kept = g.transpose() * &g + DMatrix::identity(count, count) * CHANGE_WEIGHT_S2;
        let all = &kept + bend.transpose() * bend * BEND_WEIGHT_S2;
        let mut middle = DVector::zeros(count);
        middle[count / 2] = 1.0;
        // The middle row of M⁻¹, which is symmetric.
        let row = all.cholesky().map_or_else(|| DVector::zeros(count), |all| all.solve(&middle));
        let window = |values: DVector<f64>| std::array::from_fn(|n| values[count / 2 - HALF + n]);
        Filters { keeps: window(kept.transpose() * &row), learns: window(&g * &row) }
    }
}

/// Effect of a duty of one over the valve's gain (kPa/s per duty), for one tick, on the pressure at the following ticks, in s.
fn response(path: &ValvePath, bandwidth_per_s: f64) -> [f64; TAPS] {
    let lag_s = path.coil_lag_s + path.armature_lag_s;
    let late_ticks = if is_told(path) { path.delay_s / TICK_S } else { UNKNOWN_LATE_TICKS };
    let (whole, part) = ((late_ticks as usize).min(TAPS - 2), late_ticks.fract());
    let keeps = if lag_s > 0.0 { (-TICK_S / lag_s).exp() } else { 0.0 };
    let mean_share = 1.0 - (1.0 - keeps) * lag_s / TICK_S;
    let (mut sent, mut coil, mut pressure) = ([0.0; TAPS], 0.0, 0.0);
    let mut response = [0.0; TAPS];
    for k in 0..TAPS {
        response[k] = pressure;
        sent[k] = f64::from(u8::from(k == 0)) - bandwidth_per_s * pressure;
        let at = |late: usize| k.checked_sub(late).map_or(0.0, |k| sent[k]);
        let acting = (1.0 - part) * at(whole) + part * at(whole + 1);
        pressure += TICK_S * ((1.0 - mean_share) * coil + mean_share * acting);
        coil = keeps * coil + (1.0 - keeps) * acting;
    }
    response
}

/// Choice whether flights of a reference teach the next ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RepetitionLearning {
    /// They teach nothing.
    #[default]
    Off,
    /// They teach the next ones.
    On,
}

/// Error that a tick left, for the next flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Left {
    /// Errors in kPa; none where nothing that is added acts: at a limit, or while something else decides.
    pub error_kpa: [Option<f64>; CHANNELS],
    /// Effect of a duty on the pressures, in kPa/s per duty.
    pub gain_kpa_per_s: Pair,
}

impl Left {
    /// Nothing to learn from.
    pub const NOTHING: Left = Left { error_kpa: [None; CHANNELS], gain_kpa_per_s: [1.0; CHANNELS] };
}

/// Learning from flights of one reference.
#[derive(Debug, Clone)]
pub struct Repetition {
    filters: [Filters; CHANNELS],
    /// δ by tick, as it is flown.
    flown: Vec<Pair>,
    /// And as it will be in the next flight, up to what has been flown.
    next: Vec<Pair>,
    /// Errors over the valve's gain, by tick of this flight.
    errors: Vec<Pair>,
    /// Channels on their way back from a limit.
    on_the_way_back: [bool; CHANNELS],
    tick: usize,
    /// Ticks of the flights that are over.
    flown_ticks: usize,
    flights: usize,
    /// Ticks after which the next flight follows, where it does by itself.
    period_ticks: Option<usize>,
}

impl Repetition {
    /// Nothing learned yet, for valves and feedback as given. Takes some 700 kB and a tenth of a second.
    pub fn new(paths: &[ValvePath; CHANNELS], bandwidth_per_s: Pair) -> Self {
        let empty = vec![[0.0; CHANNELS]; LONGEST_TICKS];
        Repetition {
            filters: std::array::from_fn(|c| Filters::of(&paths[c], bandwidth_per_s[c])),
            flown: empty.clone(),
            next: empty.clone(),
            errors: empty,
            on_the_way_back: [false; CHANNELS],
            tick: 0,
            flown_ticks: 0,
            flights: 0,
            period_ticks: None,
        }
    }

    /// Flights that have been learned from; those that taught play count as one.
    pub fn flights(&self) -> usize {
        self.flights
    }

    /// Empties what was learned: another reference is flown from now on.
    ///
    /// # Real-time
    /// Bounded (480 kB written), allocation-free: may run in the tick.
    pub fn forget(&mut self) {
        self.flown.fill([0.0; CHANNELS]);
        self.next.fill([0.0; CHANNELS]);
        (self.flights, self.flown_ticks, self.tick) = (0, 0, 0);
    }

    /// Begins a flight of the reference: what the last one taught counts from here. After `period_ticks` the next one follows, where it
    /// does by itself.
    ///
    /// # Real-time
    /// Bounded, allocation-free: may run in the tick.
    pub fn begin(&mut self, period_ticks: Option<u32>) {
        self.period_ticks = period_ticks.map(|ticks| ticks as usize);
        let flown = self.tick.min(LONGEST_TICKS);
        for tick in flown.saturating_sub(HALF)..flown {
            self.renew(tick, flown);
        }
        if let (Some(flown), Some(next)) = (self.flown.get_mut(..flown), self.next.get(..flown)) {
            flown.copy_from_slice(next);
        }
        self.flown_ticks = self.flown_ticks.saturating_add(flown);
        self.flights += usize::from(flown > HALF && self.flown_ticks >= PLAY_TICKS);
        self.on_the_way_back = [false; CHANNELS];
        self.tick = 0;
    }

    /// The duties to be added in this tick and the next ones; nothing in the flights that teach play.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn learned(&self) -> Option<[Pair; AHEAD + 1]> {
        (self.flights > 0).then(|| std::array::from_fn(|ahead| self.duty(ahead)))
    }

    fn duty(&self, ahead: usize) -> Pair {
        let tick = self.tick + ahead;
        let tick = self.period_ticks.map_or(tick, |period| tick % period.max(1));
        self.flown.get(tick).copied().unwrap_or([0.0; CHANNELS])
    }

    /// Takes in what this tick left; goes on to the next tick.
    ///
    /// # Real-time
    /// Some three hundred multiplications; may run in the tick.
    pub fn follow(&mut self, left: &Left) {
        let seen: Pair = std::array::from_fn(|c| {
            let error = self.learnable(c, left.error_kpa[c]) / left.gain_kpa_per_s[c];
            if error.is_finite() { error } else { 0.0 }
        });
        if let Some(slot) = self.errors.get_mut(self.tick) {
            *slot = seen;
        }
        self.tick += 1;
        if let Some(due) = self.tick.checked_sub(HALF + 1).filter(|due| *due < LONGEST_TICKS) {
            self.renew(due, self.tick.min(LONGEST_TICKS));
        }
    }

    /// Error of a channel that is learned from, in kPa: none at a limit, nor on the way back from there.
    fn learnable(&mut self, c: usize, error_kpa: Option<f64>) -> f64 {
        let most_kpa = if self.on_the_way_back[c] { BACK_KPA[c] } else { MOST_ERROR_KPA[c] };
        let learned = error_kpa.filter(|kpa| kpa.abs() < most_kpa);
        self.on_the_way_back[c] = learned.is_none();
        learned.filter(|_| self.flights > 0).unwrap_or(0.0)
    }

    /// Works out δ of a tick for the next flight from what is known of this one up to tick `known`.
    fn renew(&mut self, tick: usize, known: usize) {
        let share = SHARES.get(self.flights).copied().unwrap_or(LATER_SHARE);
        let mut renewed = [0.0; CHANNELS];
        for n in 0..TAPS {
            let Some(at) = (tick + n).checked_sub(HALF) else { continue };
            let before = self.flown.get(at).copied().unwrap_or([0.0; CHANNELS]);
            let error = self.errors.get(at).filter(|_| at < known).copied().unwrap_or([0.0; CHANNELS]);
            for c in 0..CHANNELS {
                renewed[c] += self.filters[c].keeps[n] * before[c] + self.filters[c].learns[n] * error[c];
            }
        }
        if let (Some(before), Some(slot)) = (self.flown.get(tick), self.next.get_mut(tick)) {
            *slot = std::array::from_fn(|c| {
                ((1.0 - FORGOTTEN) * before[c] + share * (renewed[c] - before[c])).clamp(-MOST_DUTY, MOST_DUTY)
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn late() -> ValvePath {
        ValvePath { delay_s: 0.02, coil_lag_s: 0.05, is_timed: true, ..ValvePath::default() }
    }

    /// A loop as the formula has it, with an error that comes again in every flight: ten flights leave what is forgotten.
    #[test]
    fn what_repeats_is_taken_off() {
        let (bandwidth, gain) = ([3.0; CHANNELS], [-150.0, 90.0]);
        let mut repetition = Repetition::new(&[late(); CHANNELS], bandwidth);
        let wave = |t: f64| 0.01 * (0.8 * t).sin() + 0.004 * (2.1 * t).cos();
        let mut last = f64::INFINITY;
        for _ in 0..10 {
            repetition.begin(None);
            repetition.flown_ticks = PLAY_TICKS;
            let (mut sent, mut coil, mut pressure, mut squares) = ([0.0; 2], 0.0, 0.0, 0.0);
            for tick in 0..1000 {
                let t = tick as f64 * TICK_S;
                let error = -pressure;
                let duty = repetition.duty(0)[0] + bandwidth[0] * error / gain[0];
                repetition.follow(&Left { error_kpa: [Some(error), None], gain_kpa_per_s: gain });
                sent = [duty, sent[0]];
                let keeps = (-TICK_S / 0.05_f64).exp();
                coil = keeps * coil + (1.0 - keeps) * sent[1];
                pressure += TICK_S * gain[0] * (coil + wave(t));
                if (100..900).contains(&tick) {
                    squares += error * error;
                }
            }
            last = squares.min(last);
            println!("{:.6}", (squares / 800.0_f64).sqrt());
        }
        // Without learning the loop leaves gain · 0.01 / K, half a kPa.
        assert!((last / 800.0).sqrt() < 0.05, "{}", (last / 800.0).sqrt());
    }

    const SOME: Left = Left { error_kpa: [Some(0.5), Some(0.2)], gain_kpa_per_s: [-150.0, 90.0] };

    #[test]
    fn another_reference_begins_with_nothing() {
        let mut repetition = Repetition::new(&[late(); CHANNELS], [3.0; CHANNELS]);
        for ticks in [PLAY_TICKS - 200, 200, 200, 200] {
            repetition.begin(None);
            (0..ticks).for_each(|_| repetition.follow(&SOME));
        }
        repetition.begin(None);
        assert!(repetition.duty(100)[0].abs() > 1e-4 && repetition.flights() == 3);
        repetition.forget();
        assert_eq!((repetition.duty(100), repetition.flights(), repetition.learned()), ([0.0; CHANNELS], 0, None));
    }

    /// The plan at the end of a flight is that of the next one's beginning.
    #[test]
    fn what_repeats_by_itself_is_planned_across_its_end() {
        let mut repetition = Repetition::new(&[late(); CHANNELS], [3.0; CHANNELS]);
        for _ in 0..PLAY_TICKS / 200 + 2 {
            repetition.begin(Some(200));
            (0..200).for_each(|_| repetition.follow(&SOME));
        }
        repetition.begin(Some(200));
        let first = repetition.learned().unwrap();
        (0..197).for_each(|_| repetition.follow(&SOME));
        assert_eq!(repetition.learned().unwrap()[3..], first[..3]);
    }

    /// Errors on the way back from a limit teach nothing; below a fifth of a kPa they do again.
    #[test]
    fn the_way_back_from_a_limit_teaches_nothing() {
        let mut repetition = Repetition::new(&[late(); CHANNELS], [3.0; CHANNELS]);
        let of = |error_kpa: Option<f64>| Left { error_kpa: [error_kpa, None], ..SOME };
        for (ticks, error_kpa) in [(PLAY_TICKS, Some(0.5)), (200, None)] {
            repetition.begin(None);
            (0..ticks).for_each(|_| repetition.follow(&of(error_kpa)));
        }
        for behind in [Some(0.9), Some(0.25), Some(-0.25)] {
            repetition.follow(&of(behind));
        }
        repetition.begin(None);
        assert!((0..203).all(|tick| repetition.duty(tick) == [0.0; CHANNELS]));
        (0..200).for_each(|_| repetition.follow(&of(None)));
        (0..3).for_each(|_| repetition.follow(&of(Some(0.15))));
        (0..3).for_each(|_| repetition.follow(&of(Some(0.5))));
        repetition.begin(None);
        assert!(repetition.duty(203)[0].abs() > 1e-5);
    }

    /// A flight that is broken off leaves what was learned of the rest.
    #[test]
    fn a_short_flight_keeps_the_rest() {
        let mut repetition = Repetition::new(&[late(); CHANNELS], [3.0; CHANNELS]);
        for ticks in [PLAY_TICKS, 400, 0] {
            repetition.begin(None);
            (0..ticks).for_each(|_| repetition.follow(&SOME));
        }
        let learned = repetition.duty(300);
        repetition.begin(None);
        (0..50).for_each(|_| repetition.follow(&SOME));
        repetition.begin(None);
        assert_eq!(repetition.duty(300), learned);
        assert!(learned[0] != 0.0);
    }
}
