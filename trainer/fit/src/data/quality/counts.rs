//! Raw counts of a converter where readings are asked for.
//!
//! A logger that nobody told the sensor's scale writes what its converter gives: whole numbers up to a power of two. Units give whole
//! numbers as well, so counts are told only where no unit explains all columns, and where one converter does.

use model::rig::Rig;

use super::meaning::Meaning;
use super::mend::pressure_key;
use super::trials::{Taken, tried};
use crate::data::Records;

/// Largest counts of usual converters: 8, 10, 12, 13, 14, 15, 16, 23 and 24 bits, those of odd numbers with a sign.
const FULL_COUNTS: [f64; 9] = [255.0, 1023.0, 4095.0, 8191.0, 16_383.0, 32_767.0, 65_535.0, 8_388_607.0, 16_777_215.0];
/// Volts at which converters usually give them.
const FULL_VOLTS: [f64; 5] = [5.0, 10.0, 3.3, 4.096, 2.5];
/// Least number of different readings, and the least that the largest of them is, for whole numbers to be no chance.
const LEAST_DIFFERENT: usize = 20;
const LEAST_LARGEST: f64 = 100.0;
/// Converters of a size that are asked: the smallest that gives a count, and the next two.
const NEAREST: usize = 3;
/// The most that the rig is off where it follows counts, as a share of what pressures move through …
const FOLLOWS: f64 = 0.25;
/// … how much less than with any unit, where these are no units …
const ALONE: f64 = 0.5;
/// … and than with a converter that was asked before, for another to be taken.
const CLEARLY: f64 = 0.9;

/// Tells whether readings are whole numbers, many different ones and large, as counts are.
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

/// The largest of some readings.
pub(super) fn largest(readings: impl Iterator<Item = f64>) -> f64 {
    readings.fold(f64::NEG_INFINITY, f64::max)
}

/// The counts of a converter in words, with the key that scales them, for one recording where there is one that the rig can be run over.
#[derive(Clone, Copy)]
pub(super) struct Counts<'a> {
    pub(super) rig: &'a Rig,
    pub(super) run: Option<(&'a Records, usize)>,
}

/// Certainty that numbers are counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Sure {
    /// The rig does what they say, and not what any unit says.
    Alone,
    /// The rig does what they say, and what a unit says.
    AsAUnit,
    /// Only their size tells the converter.
    BySize,
}

impl Counts<'_> {
    /// A complaint that says a unit of a column that looks like counts, with the counts beside it: first, where no unit does as well.
    pub(super) fn beside(&self, column: &str, largest: f64, text: &str) -> String {
        match self.told(column, largest) {
            Some((Sure::Alone, counts)) => {
                format!("whole numbers, which seem to be {counts}; or, if they are not: {text}")
            }
            Some((_, counts)) => format!("{text}; or, being whole numbers, these are {counts}"),
            None => text.to_owned(),
        }
    }

    /// The complaint about a column that looks like counts and like no unit.
    pub(super) fn alone(&self, column: &str, largest: f64) -> Option<String> {
        let (_, counts) = self.told(column, largest)?;
        Some(format!("whole numbers of up to {largest} seem to be {counts}"))
    }

    fn told(&self, column: &str, largest: f64) -> Option<(Sure, String)> {
        let (sure, meaning) = self.by_run(column, largest).or_else(|| Some((Sure::BySize, by_size(largest)?)))?;
        let Meaning::Counts { full, volts } = meaning else { return None };
        let over = volts.map_or("the sensor's range".to_owned(), |volts| format!("0 … {volts} V"));
        let file_unit = self.run.and_then(|(records, record)| records.records().get(record)?.file_unit(column));
        let key = pressure_key(self.rig, column, meaning, file_unit);
        let if_any = if sure == Sure::BySize { ", if it has no other scale" } else { "" };
        Some((sure, format!("the raw counts of a converter (0 … {full} over {over}{if_any}): {key}")))
    }

    /// The converter under whose counts the rig follows the recording best; `None` where it follows none.
    fn by_run(&self, column: &str, largest: f64) -> Option<(Sure, Meaning)> {
        let (records, record) = self.run?;
        let channel = records.sensors().iter().position(|of| of == column)?;
        let looks_counted = |channel: &usize| is_counted(records, record, *channel);
        // One logger writes the counts of all.
        let mut counted: Vec<usize> = (0..records.sensors().len()).filter(looks_counted).collect();
        if !counted.contains(&channel) {
            counted.push(channel);
        }
        let fulls: Vec<f64> = FULL_COUNTS.into_iter().filter(|full| *full >= largest).take(NEAREST).collect();
        let of_size = |meaning: &Meaning| matches!(meaning, Meaning::Counts { full, .. } if fulls.contains(full));
        let units = Meaning::wrong().filter(|meaning| matches!(meaning, Meaning::Gauge(..) | Meaning::Absolute(..)));
        let meanings: Vec<Meaning> = converters().filter(of_size).chain(units).collect();
        let trials: Vec<Taken> =
            meanings.iter().map(|meaning| Taken::SensorsMeant(counted.clone(), *meaning)).collect();
        let outcomes = tried(self.rig, records, record, &trials)?;
        let (mut converter, mut unit) = (None, f64::INFINITY);
        for (meaning, outcome) in meanings.into_iter().zip(outcomes) {
            let off = outcome.off(&counted);
            match (meaning, converter) {
                (Meaning::Counts { .. }, Some((least, _))) if off >= CLEARLY * least => {}
                (Meaning::Counts { .. }, _) => converter = Some((off, meaning)),
                _ => unit = unit.min(off),
            }
        }
        let (off, meaning) = converter.filter(|(off, _)| *off < FOLLOWS)?;
        Some((if off < ALONE * unit { Sure::Alone } else { Sure::AsAUnit }, meaning))
    }
}

/// Tells whether the samples of a channel look like the counts of a converter.
pub(super) fn is_counted(records: &Records, record: usize, channel: usize) -> bool {
    look_like_counts(samples(records, record, channel))
}

/// The readings of a channel that were taken (kPa).
pub(super) fn samples(records: &Records, record: usize, channel: usize) -> impl Iterator<Item = f64> {
    let readings = records.channel_kpa(record, channel).iter().enumerate();
    let of = records.records().get(record);
    readings.filter(move |(row, _)| of.is_some_and(|of| of.is_read(channel, *row))).map(|(_, kpa)| *kpa)
}

/// The smallest converter that gives such counts, over the sensor's range.
fn by_size(largest: f64) -> Option<Meaning> {
    let full = FULL_COUNTS.into_iter().find(|full| *full >= largest)?;
    Some(Meaning::Counts { full, volts: None })
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
