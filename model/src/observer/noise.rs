//! Noise of a reading, found while it runs.
//!
//! A pressure behind a lag or a swing bends little from tick to tick, white noise a lot: of noise alone the second
//! difference `y(τ) − 2 y(τ−1) + y(τ−2)` has six times the variance.

use crate::real::Real;

/// Time constant of the mean, in ticks (2 s).
const MEAN_TICKS: f64 = 100.0;
/// A second difference counts as this many times the RMS at most: a jump of the pressure is no noise.
const MOST_OFF: f64 = 3.0;

/// Running estimate of a reading's noise.
#[derive(Debug, Clone, Copy)]
pub struct ReadingNoise<R> {
    variance: R,
    /// The last two readings, newest first; NaN before there are any.
    before: [R; 2],
}

impl<R: Real> ReadingNoise<R> {
    /// Begins at a noise in kPa RMS.
    pub fn beginning_at(noise_kpa: f64) -> Self {
        ReadingNoise { variance: R::splat(noise_kpa * noise_kpa), before: [R::splat(f64::NAN); 2] }
    }

    /// Forgets the readings before and keeps what was learned of their noise.
    pub fn restart(&mut self) {
        self.before = [R::splat(f64::NAN); 2];
    }

    /// As `restart`, for one lane.
    pub fn restart_lane(&mut self, lane: usize) {
        self.before = self.before.map(|reading| R::from_lanes(|l| if l == lane { f64::NAN } else { reading.lane(l) }));
    }

    /// Takes in a reading (kPa); answers the noise in kPa RMS.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn follow(&mut self, reading_kpa: R) -> R {
        let [newest, older] = self.before;
        self.before = [reading_kpa, newest];
        self.variance = R::from_lanes(|lane| {
            let variance = self.variance.lane(lane);
            let bend = reading_kpa.lane(lane) - 2.0 * newest.lane(lane) + older.lane(lane);
            if !bend.is_finite() {
                return variance;
            }
            let found = (bend * bend / 6.0).min(MOST_OFF * MOST_OFF * variance);
            variance + (found - variance) / MEAN_TICKS
        });
        self.variance.sqrt()
    }
}
