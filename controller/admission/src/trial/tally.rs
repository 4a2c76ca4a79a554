//! Counts on one rig of a trial.

use model::observation::{CHANNELS, Pair};

/// Figures of one flight.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tally {
    /// Root mean square of the errors before noise, in kPa: readings less what the sensors show of chambers on the reference.
    pub rmse_kpa: Pair,
    /// The largest standard deviation of a reading before noise about its mean on a hold, in kPa.
    pub swing_kpa: Pair,
    /// Root mean square of the duties' changes from tick to tick on the holds, in duty.
    pub chatter_duty: Pair,
    /// Seconds after arming at which the envelope was left; `None` if it was kept.
    pub left_s: Option<f64>,
    /// True where the policy answered something that is not finite.
    pub not_finite: bool,
}

/// Sums on the way to a [`Tally`].
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sums {
    errors: [Moments; CHANNELS],
    pressures: [[Moments; CHANNELS]; STRETCHES],
    changes: [Moments; CHANNELS],
    pub(super) left_s: Option<f64>,
    pub(super) not_finite: bool,
}

/// Still stretches of a course.
const STRETCHES: usize = 2;

/// Number, sum and sum of squares.
#[derive(Debug, Clone, Copy, Default)]
struct Moments {
    count: f64,
    sum: f64,
    squares: f64,
}

impl Moments {
    fn add(&mut self, value: f64) {
        self.count += 1.0;
        self.sum += value;
        self.squares += value * value;
    }

    fn rms(&self) -> f64 {
        if self.count > 0.0 { (self.squares / self.count).sqrt() } else { 0.0 }
    }

    fn deviation(&self) -> f64 {
        if self.count > 0.0 {
            (self.squares / self.count - (self.sum / self.count).powi(2)).max(0.0).sqrt()
        } else {
            0.0
        }
    }
}

impl Sums {
    /// Takes in a tick whose errors count (kPa).
    pub(super) fn error(&mut self, error_kpa: Pair) {
        self.errors.iter_mut().zip(error_kpa).for_each(|(moments, error)| moments.add(error));
    }

    /// Takes in a tick of a still stretch: errors in kPa, changes in duty.
    pub(super) fn still(&mut self, stretch: usize, error_kpa: Pair, change_duty: Pair) {
        for (c, (error, change)) in error_kpa.into_iter().zip(change_duty).enumerate() {
            if let Some(moments) = self.pressures.get_mut(stretch).and_then(|pair| pair.get_mut(c)) {
                moments.add(error);
            }
            if let Some(moments) = self.changes.get_mut(c) {
                moments.add(change);
            }
        }
    }

    pub(super) fn tally(&self) -> Tally {
        let swing = |c: usize| self.pressures.iter().fold(0.0_f64, |most, pair| most.max(pair[c].deviation()));
        Tally {
            rmse_kpa: self.errors.map(|moments| moments.rms()),
            swing_kpa: [swing(0), swing(1)],
            chatter_duty: self.changes.map(|moments| moments.rms()),
            left_s: self.left_s,
            not_finite: self.not_finite,
        }
    }
}
