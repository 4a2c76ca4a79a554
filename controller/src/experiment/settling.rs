//! Test whether the pressures stand still: means of half seconds, compared.
//!
//! A mean of 25 readings scatters by a fifth of what one does (0.06 kPa for the converter's 0.3 kPa), so noise and the
//! pump's ripple do not hide rest, and a chamber that still empties does not pass for it: with a time constant of 1 s a
//! change of `STILL_KPA` from mean to mean leaves 0.3 kPa to go.

use model::observation::{CHANNELS, Pair};

/// Readings to a mean: half a second.
const BLOCK: u32 = 25;
/// Change from mean to mean that counts as none, in kPa.
const STILL_KPA: f64 = 0.2;
/// Such changes in a row that make rest.
const ENOUGH: u32 = 2;

/// Watches two pressures come to rest.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SettlingDetector {
    sum: Pair,
    count: u32,
    last: Option<Pair>,
    still: u32,
}

impl SettlingDetector {
    /// Nothing seen yet.
    pub fn new() -> Self {
        SettlingDetector::default()
    }

    /// Takes a reading (kPa) and answers whether the pressures have stood still up to it.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn add(&mut self, measured: Pair) -> bool {
        for (sum, reading) in self.sum.iter_mut().zip(measured) {
            *sum += reading;
        }
        self.count += 1;
        if self.count == BLOCK {
            let mean = self.sum.map(|sum| sum / f64::from(BLOCK));
            let still = self.last.is_some_and(|last| (0..CHANNELS).all(|c| (mean[c] - last[c]).abs() <= STILL_KPA));
            self.still = if still { self.still + 1 } else { 0 };
            (self.last, self.sum, self.count) = (Some(mean), [0.0; CHANNELS], 0);
        }
        self.still >= ENOUGH
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(reading: impl Fn(u32) -> f64) -> Option<u32> {
        let mut calm = SettlingDetector::new();
        (0..1000).find(|k| calm.add([0.0, reading(*k)]))
    }

    #[test]
    fn noise_is_rest_and_drift_is_not() {
        // Three means make two changes.
        assert_eq!(after(|k| if k % 2 == 0 { -70.3 } else { -70.0 }), Some(3 * BLOCK - 1));
        // 1 kPa/s is 0.5 kPa from mean to mean.
        assert_eq!(after(|k| -70.0 + 0.02 * f64::from(k)), None);
        assert!(after(|k| -70.0 * (-f64::from(k) / 50.0).exp()).is_some_and(|k| k > 200));
    }
}
