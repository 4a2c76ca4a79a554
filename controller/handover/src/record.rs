//! The incumbent's errors, changes of duty and commands that the safety filter bent while it decides alone, by kind of tick: what a candidate is held against.

use model::observation::{CHANNELS, Pair};

use crate::conditions::KINDS;
use crate::conduct::WATCHED_TICKS;

/// Ticks over which the record forgets: two minutes, for a rig that warms up and for references whose stretches differ.
const WINDOW_TICKS: f64 = 6000.0;
/// Ticks of a kind from which on its mean counts: two seconds.
const ENOUGH_TICKS: f64 = 100.0;
/// Error that the converter's noise and the pump's ripple leave to the best of controllers, in kPa.
pub(crate) const FLOOR_KPA: Pair = [0.08, 0.02];

/// A running mean of squares.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct MeanSquare {
    ticks: f64,
    mean: f64,
}

impl MeanSquare {
    fn add(&mut self, value: f64) {
        self.ticks = (self.ticks + 1.0).min(WINDOW_TICKS);
        self.mean += (value * value - self.mean) / self.ticks;
    }
}

/// Commands that were bent, second by second.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Bent {
    ticks: u32,
    now: u32,
    worst: f64,
}

impl Bent {
    fn add(&mut self, is_bent: bool) {
        self.now += u32::from(is_bent);
        self.ticks += 1;
        if self.ticks >= WATCHED_TICKS {
            let kept = self.worst * (1.0 - f64::from(WATCHED_TICKS) / WINDOW_TICKS);
            *self = Bent { worst: kept.max(f64::from(self.now)), ..Bent::default() };
        }
    }
}

/// Mean squares of errors and of changes of duty, and the commands that were bent.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Record {
    errors: [[MeanSquare; KINDS]; CHANNELS],
    changes: [MeanSquare; CHANNELS],
    bent: Bent,
    ticks: u32,
}

impl Record {
    /// Takes in a tick: its kinds, errors in kPa, changes of the duties, and whether the safety filter bent its command.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn add(&mut self, kinds: [usize; CHANNELS], error_kpa: Pair, change_duty: Pair, is_bent: bool) {
        for c in 0..CHANNELS {
            if let Some(kind) = self.errors[c].get_mut(kinds[c]) {
                kind.add(error_kpa[c]);
            }
            self.changes[c].add(change_duty[c]);
        }
        self.bent.add(is_bent);
        self.ticks = self.ticks.saturating_add(1);
    }

    /// Ticks that were taken in.
    pub fn ticks(&self) -> u32 {
        self.ticks
    }

    /// An error squared, as a multiple of the incumbent's mean square in like conditions; `None` where too little is known.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn excess(&self, channel: usize, kind: usize, error_kpa: f64) -> Option<f64> {
        let known = self.errors.get(channel)?.get(kind)?;
        let floor = FLOOR_KPA.get(channel)?.powi(2);
        (known.ticks >= ENOUGH_TICKS).then(|| (error_kpa * error_kpa + floor) / (known.mean + floor))
    }

    /// Root mean square of the incumbent's changes of a duty from tick to tick.
    pub fn change_duty(&self, channel: usize) -> f64 {
        self.changes.get(channel).map_or(0.0, |changes| changes.mean.sqrt())
    }

    /// Commands of the incumbent that the safety filter bent in its worst second; it fades within minutes.
    pub fn most_bent(&self) -> f64 {
        self.bent.worst
    }

    /// Root mean square of the incumbent's errors over all kinds, in kPa.
    pub fn rms_kpa(&self) -> Pair {
        self.errors.map(|kinds| {
            let ticks: f64 = kinds.iter().map(|k| k.ticks).sum();
            (kinds.iter().map(|k| k.ticks * k.mean).sum::<f64>() / ticks.max(1.0)).sqrt()
        })
    }
}
