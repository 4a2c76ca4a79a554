//! Errors and valve movement of one channel, over the ticks that count.
//!
//! ```text
//! e_k  = measured_k − reference_k                       (kPa)
//! RMSE = √(Σ e_k² / n)
//! action change = √(Σ (u_k − u_{k−1})² / m)             (duty per tick), neighbouring ticks only
//! ```

use crate::oscillation::{OscillationWatch, Repetition};

/// Figures of one channel, tick by tick.
#[derive(Debug, Clone, Default)]
pub struct Tracking {
    ticks: u64,
    sum: f64,
    sum_of_squares: f64,
    max_abs: f64,
    duty_before: Option<f64>,
    changes: u64,
    sum_of_change_squares: f64,
    oscillation: OscillationWatch,
}

impl Tracking {
    /// A channel that has flown nothing.
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes a tick that follows the last one: reading and reference (kPa gauge), duty sent.
    ///
    /// Without a finite error (a missing reading) only the duty counts.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn add(&mut self, measured_kpa: f64, reference_kpa: f64, duty: f64) {
        let error = measured_kpa - reference_kpa;
        self.oscillation.add(error);
        if error.is_finite() {
            self.ticks += 1;
            self.sum += error;
            self.sum_of_squares += error * error;
            self.max_abs = self.max_abs.max(error.abs());
        }
        if let Some(before) = self.duty_before.filter(|_| duty.is_finite()) {
            self.changes += 1;
            self.sum_of_change_squares += (duty - before) * (duty - before);
        }
        self.duty_before = Some(duty).filter(|duty| duty.is_finite());
    }

    /// Says that the next tick does not follow the last.
    pub fn pause(&mut self) {
        self.duty_before = None;
        self.oscillation.pause();
    }

    /// Ticks with a finite error.
    pub fn ticks(&self) -> u64 {
        self.ticks
    }

    /// Root of the mean squared error (kPa); `None` without a tick.
    pub fn rmse_kpa(&self) -> Option<f64> {
        self.mean(self.sum_of_squares).map(f64::sqrt)
    }

    /// Mean error (kPa), positive when the pressure lies above its reference; `None` without a tick.
    pub fn mean_error_kpa(&self) -> Option<f64> {
        self.mean(self.sum)
    }

    /// Largest error, without its sign (kPa); `None` without a tick.
    pub fn max_abs_kpa(&self) -> Option<f64> {
        (self.ticks > 0).then_some(self.max_abs)
    }

    /// Root of the mean squared change of duty from tick to tick; `None` without two neighbours.
    pub fn action_change_rms(&self) -> Option<f64> {
        (self.changes > 0).then(|| (self.sum_of_change_squares / self.changes as f64).sqrt())
    }

    /// The strongest repetition in the error: see [`oscillation`](crate::oscillation).
    pub fn repetition(&self) -> Option<Repetition> {
        self.oscillation.repetition()
    }

    fn mean(&self, sum: f64) -> Option<f64> {
        // A sum of squares that ran over is no figure.
        (self.ticks > 0).then(|| sum / self.ticks as f64).filter(|mean| mean.is_finite())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_by_hand() {
        let mut channel = Tracking::new();
        assert_eq!((channel.rmse_kpa(), channel.action_change_rms()), (None, None));
        // Errors 3, −4, 0; changes of duty 0.25, then −0.5: (0.0625 + 0.25) / 2 = 0.15625. A missing
        // reading changes nothing but the duty: 0, so (0.3125 + 0) / 3.
        channel.add(13.0, 10.0, 0.25);
        channel.add(6.0, 10.0, 0.5);
        channel.add(10.0, 10.0, 0.0);
        assert_eq!(channel.rmse_kpa(), Some((25.0_f64 / 3.0).sqrt()));
        assert_eq!(channel.mean_error_kpa(), Some(-1.0 / 3.0));
        assert_eq!(channel.max_abs_kpa(), Some(4.0));
        assert_eq!(channel.action_change_rms(), Some(0.156_25_f64.sqrt()));
        channel.add(f64::NAN, 10.0, 0.0);
        assert_eq!(channel.ticks(), 3);
        assert_eq!(channel.action_change_rms(), Some((0.3125_f64 / 3.0).sqrt()));
    }

    #[test]
    fn a_pause_is_not_a_movement() {
        let mut channel = Tracking::new();
        channel.add(0.0, 0.0, 0.0);
        channel.pause();
        channel.add(0.0, 0.0, 1.0);
        assert_eq!(channel.action_change_rms(), None);
        channel.add(0.0, 0.0, f64::NAN);
        channel.add(0.0, 0.0, 1.0);
        assert_eq!(channel.action_change_rms(), None);
    }
}
