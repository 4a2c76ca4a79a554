//! Raw counts of a converter where readings are asked for.
//!
//! A logger that nobody told the sensor's scale writes what its converter gives: whole numbers up to a power of two. Units give whole
//! numbers as well, so counts are told only where no unit explains all columns, and where one converter does.

use model::rig::Rig;

use super::meaning::Meaning;
use super::mend::scaled_key;

/// Largest counts of usual converters: 8, 10, 12, 13, 14, 15, 16, 23 and 24 bits, those of odd numbers with a sign.
const FULL_COUNTS: [f64; 9] = [255.0, 1023.0, 4095.0, 8191.0, 16_383.0, 32_767.0, 65_535.0, 8_388_607.0, 16_777_215.0];
/// Volts at which converters usually give them.
const FULL_VOLTS: [f64; 5] = [5.0, 10.0, 3.3, 4.096, 2.5];
/// Least number of different readings, and the least that the largest of them is, for whole numbers to be no chance.
const LEAST_DIFFERENT: usize = 20;
const LEAST_LARGEST: f64 = 100.0;

/// Whether readings are whole numbers, many different ones and large, as counts are.
pub(super) fn look_like_counts(readings: impl Iterator<Item = f64>) -> bool {
    let mut different = std::collections::HashSet::new();
    let mut largest = 0.0_f64;
    for reading in readings {
        if reading.fract() != 0.0 || !reading.is_finite() {
            return false;
        }
        largest = largest.max(reading.abs());
        different.insert(reading as i64);
    }
    different.len() >= LEAST_DIFFERENT && largest >= LEAST_LARGEST
}

/// The other thing that whole numbers may be which a unit explains in one column alone.
pub(super) fn or_counts(rig: &Rig, column: &str) -> String {
    let key = scaled_key(rig, column);
    format!("; or, being whole numbers, these are the raw counts of a converter; bring them to gauge kPa by {key}")
}

/// Every usual converter: over its own volts, and over the whole range of a sensor.
pub(super) fn converters() -> impl Iterator<Item = Meaning> {
    let over_volts = |full| FULL_VOLTS.into_iter().map(move |volts| Meaning::Counts { full, volts: Some(volts) });
    FULL_COUNTS.into_iter().flat_map(move |full| over_volts(full).chain([Meaning::Counts { full, volts: None }]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_many_large_whole_numbers() {
        assert!(look_like_counts((0..40).map(|k| f64::from(100 * k))));
        assert!(!look_like_counts((0..40).map(f64::from)), "whole kPa");
        assert!(!look_like_counts((0..400).map(|k| f64::from(200 * (k % 5)))), "holds in whole kPa");
        assert!(!look_like_counts((0..40).map(|k| 100.5 * f64::from(k))));
    }
}
