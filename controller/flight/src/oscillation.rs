//! Errors that repeat themselves faster than the reference moves: a sign of a limit cycle.
//!
//! A loop that hunts (hysteresis or stiction under integral action, too much gain) makes an error that
//! repeats itself after a fixed period; noise does not, and a tracking error repeats only with the
//! reference. So:
//!
//! ```text
//! h(t) = e(t) − mean of e over the 3 s around t        slow errors out
//! r(k) = Σ h(t) h(t−k) / Σ h(t)²                       autocorrelation at a lag of k ticks
//! ```
//!
//! The period is the lag of the highest r after r has first gone below 0, up to 3 s; r there is the
//! *regularity*: 0 for noise, 1 for a pure tone, and √(2 r ⟨h²⟩) is the tone's amplitude. An error
//! counts as oscillating at a regularity of 0.5 and an amplitude of 0.05 kPa. Both limits are choices:
//! half of the power repeats itself, and the amplitude is a third of the tightest RMSE asked of the rig.
//!
//! # What it does not tell
//! It cannot tell a loop that excites itself from one that rings in answer to noise, nor from a
//! reference that itself repeats within 3 s. The paper's reference repeats after 8 and 10 s; at a lag
//! below 3 s a tone of 8 s stands at r < 0. Cycles slower than 3 s are not seen.
//!
//! # Cost
//! 302 additions and 151 multiplications per tick, in fixed memory of 3.6 kB.

use crate::flight_clock::RATE_HZ;

/// The longest lag (ticks): 3 s.
const LAGS: usize = 150;
/// Ticks of the running mean: odd, so that it has a middle.
const WINDOW: usize = LAGS + 1;
/// Least number of correlated ticks: twice the longest lag.
const LEAST: u64 = 2 * LAGS as u64;
/// Regularity from which an error counts as oscillating.
pub const REGULARITY: f64 = 0.5;
/// Amplitude from which an error counts as oscillating (kPa).
pub const AMPLITUDE_KPA: f64 = 0.05;

/// The strongest repetition in an error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Repetition {
    /// After this time it repeats itself (s).
    pub period_s: f64,
    /// Regularity: 0 for noise, 1 for a pure tone.
    pub regularity: f64,
    /// Amplitude of the part that repeats (kPa).
    pub amplitude_kpa: f64,
}

impl Repetition {
    /// Tells whether it is strong and regular enough to count as an oscillation.
    pub fn is_oscillation(&self) -> bool {
        self.regularity >= REGULARITY && self.amplitude_kpa >= AMPLITUDE_KPA
    }
}

/// Looks for repetition in an error, tick by tick.
#[derive(Debug, Clone)]
pub struct OscillationWatch {
    // The newest value last. `errors` fills the running mean, `highs` the correlation.
    errors: [f64; WINDOW],
    errors_held: usize,
    highs: [f64; LAGS + 1],
    highs_held: usize,
    // Σ h(t) h(t−k); the last place is lag 0, so that it lies as `highs` does.
    sums: [f64; LAGS + 1],
    correlated: u64,
}

impl Default for OscillationWatch {
    fn default() -> Self {
        Self::new()
    }
}

impl OscillationWatch {
    /// A watch that has seen nothing.
    pub fn new() -> Self {
        Self {
            errors: [0.0; WINDOW],
            errors_held: 0,
            highs: [0.0; LAGS + 1],
            highs_held: 0,
            sums: [0.0; LAGS + 1],
            correlated: 0,
        }
    }

    /// Takes the error of the next tick (kPa); one that is not finite counts as a [`pause`](Self::pause).
    ///
    /// # Real-time
    /// May run in the tick: the same work each time, allocates nothing.
    pub fn add(&mut self, error_kpa: f64) {
        if !error_kpa.is_finite() {
            self.pause();
            return;
        }
        append(&mut self.errors, error_kpa);
        self.errors_held = (self.errors_held + 1).min(WINDOW);
        if self.errors_held < WINDOW {
            return;
        }
        let mean = self.errors.iter().sum::<f64>() / WINDOW as f64;
        let newest = self.errors.get(WINDOW / 2).map_or(0.0, |middle| middle - mean);
        append(&mut self.highs, newest);
        self.highs_held = (self.highs_held + 1).min(LAGS + 1);
        if self.highs_held <= LAGS {
            return;
        }
        for (sum, past) in self.sums.iter_mut().zip(&self.highs) {
            *sum += newest * past;
        }
        self.correlated += 1;
    }

    /// Says that the next tick does not follow the last: nothing is correlated across the hole.
    pub fn pause(&mut self) {
        self.errors_held = 0;
        self.highs_held = 0;
    }

    /// The strongest repetition so far; `None` before 12 s, or when the error never swings back.
    pub fn repetition(&self) -> Option<Repetition> {
        let [.., power] = self.sums;
        if self.correlated < LEAST || power <= 0.0 || !power.is_finite() {
            return None;
        }
        // From lag 0 upwards.
        let lags = self.sums.iter().rev().enumerate();
        let beyond = lags.skip_while(|(_, sum)| **sum >= 0.0);
        let (lag, sum) = beyond.max_by(|a, b| a.1.total_cmp(b.1))?;
        let regularity = (sum / power).max(0.0);
        Some(Repetition {
            period_s: lag as f64 / RATE_HZ,
            regularity,
            amplitude_kpa: (2.0 * regularity * power / self.correlated as f64).sqrt(),
        })
    }
}

/// Moves all values one place towards the front and puts one at the end.
fn append<const N: usize>(values: &mut [f64; N], value: f64) {
    values.copy_within(1.., 0);
    if let Some(last) = values.last_mut() {
        *last = value;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    /// Repeatable noise of unit size: sums of a linear congruential generator's draws.
    fn noise() -> impl FnMut() -> f64 {
        let mut state = 7_u64;
        let mut uniform = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        move || (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    }

    fn watched(error: impl FnMut(f64) -> f64) -> Option<Repetition> {
        let mut watch = OscillationWatch::new();
        (0..2_750).map(|k| f64::from(k) / 50.0).map(error).for_each(|e| watch.add(e));
        watch.repetition()
    }

    #[test]
    fn a_tone_in_noise_is_found_with_period_and_amplitude() {
        let mut noise = noise();
        let found = watched(|t| 0.2 * (TAU * t / 0.8).sin() + 0.05 * noise()).unwrap();
        // One tick of period; 10 % of amplitude, because the running mean takes up to 4 % of a tone.
        // The second or third repetition may stand a hair higher than the first.
        let periods = found.period_s / 0.8;
        assert!((periods - periods.round()).abs() < 0.026 && periods < 3.1, "{found:?}");
        assert!((found.amplitude_kpa - 0.2).abs() < 0.02, "{found:?}");
        assert!(found.regularity > 0.8 && found.is_oscillation(), "{found:?}");
    }

    #[test]
    fn the_sawtooth_of_a_sticking_valve_is_found() {
        let found = watched(|t| 0.3 * ((t / 1.7).fract() - 0.5)).unwrap();
        assert!((found.period_s - 1.7).abs() < 0.021 && found.is_oscillation(), "{found:?}");
    }

    #[test]
    fn noise_and_slow_drift_are_no_oscillation() {
        let (mut white, mut steps) = (noise(), noise());
        let found = watched(|_| 0.3 * white()).unwrap();
        assert!(found.regularity < 0.15 && !found.is_oscillation(), "white: {found:?}");
        let mut level = 0.0;
        let found = watched(|_| {
            level = 0.95 * level + 0.1 * steps();
            level
        });
        assert!(found.is_none_or(|found| found.regularity < 0.4), "low-passed: {found:?}");
    }

    #[test]
    fn a_tracking_error_that_repeats_with_the_paper_reference_is_none() {
        let mut noise = noise();
        // Far larger than a flight's: 1 kPa at both of the reference's periods.
        for period_s in [8.0, 10.0] {
            let found = watched(|t| (TAU * t / period_s).sin() + 0.06 * noise());
            assert!(found.is_none_or(|found| !found.is_oscillation()), "{period_s} s: {found:?}");
        }
        // What a valve's hysteresis leaves: a bump after each turn, of alternating sign.
        let found = watched(|t| {
            let half = (t / 4.0).floor();
            let bump = (-(t - 4.0 * half) / 0.3).exp();
            0.8 * bump * if half % 2.0 == 0.0 { 1.0 } else { -1.0 } + 0.06 * noise()
        });
        assert!(found.is_none_or(|found| !found.is_oscillation()), "bumps: {found:?}");
    }

    #[test]
    fn too_short_is_no_answer_and_holes_are_not_bridged() {
        let mut watch = OscillationWatch::new();
        for k in 0..10_000 {
            // A hole every 2 s: never long enough for the running mean and the lags.
            watch.add(if k % 100 == 0 { f64::NAN } else { (f64::from(k) * 0.2).sin() });
        }
        assert_eq!(watch.repetition(), None);
    }
}
