//! Draws from ranges, the same on every machine and in every version of a library.

use proto::split_mix::SplitMix64;

/// Draws that a seed stands for.
#[derive(Debug, Clone)]
pub(crate) struct Draw(SplitMix64);

impl Draw {
    pub(crate) fn new(seed: u64) -> Self {
        Draw(SplitMix64::new(seed))
    }

    /// Uniform in 0 … 1, on 53 bits.
    pub(crate) fn unit(&mut self) -> f64 {
        self.0.unit()
    }

    /// Uniform in −1 … 1.
    pub(crate) fn signed(&mut self) -> f64 {
        2.0 * self.unit() - 1.0
    }

    /// Uniform in 1 − spread … 1 + spread.
    pub(crate) fn about_one(&mut self, spread: f64) -> f64 {
        1.0 + spread * self.signed()
    }
}
