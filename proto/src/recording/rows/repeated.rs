//! Loggers that are quicker than their sensors: each reading stands there several times.
//!
//! A sensor that is read every 100 ms and logged every 20 ms repeats each number five times. Only the first of them is a sample. Such
//! runs of equal numbers are all of one length, or of several such lengths where a reading came out as the one before; those of a calm
//! chamber and a coarse converter are of every length. A ramp through the steps of a coarse converter has runs of one length as well, but
//! goes on by one step of it at a time. A rate that does not divide that of the rows is another matter ([`super::uneven`]).

use std::ops::Range;

use super::resample::runs_of;
use super::uneven;

/// Runs that must be there to tell.
const LEAST_RUNS: usize = 40;
/// Share of the runs that must have the usual length, or a multiple of it.
const ALIKE: f64 = 0.8;
/// Steps of the converter from which on a change is none of a slow ramp, and the share of the changes that must be such ones.
const JUMP_STEPS: f64 = 1.5;
const JUMPS: f64 = 0.25;

/// Distance of a number of rows from a whole one up to which all readings stand there equally often.
const WHOLE: f64 = 0.03;

/// Relation of samples and sensors' readings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Sensors {
    /// A reading in each sample.
    EachSample,
    /// Each reading stands in so many samples.
    Repeated(usize),
    /// One of so many samples has a reading, the others have none.
    Slower(usize),
    /// Each sensor has samples of its own; the one that is read least often in one of so many, as a mean.
    Own(f64),
}

impl Sensors {
    /// Samples for each reading.
    pub(crate) fn samples(self) -> f64 {
        match self {
            Sensors::EachSample => 1.0,
            Sensors::Repeated(samples) | Sensors::Slower(samples) => samples as f64,
            Sensors::Own(samples) => samples,
        }
    }
}

/// Readings of one sensor that stand in several rows each.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Held {
    /// By row, whether it is the first one with its reading.
    pub(crate) read: Vec<bool>,
    /// Rows from reading to reading, as a mean.
    pub(crate) rows_a_reading: f64,
}

impl Held {
    /// Finds the readings among numbers in rows at these times; `None` where they are not repeated.
    pub(crate) fn of(time_s: &[f64], values: &[f64]) -> Option<Self> {
        match uneven::held(time_s, values) {
            Some(of) if !of.is_even() => Some(of),
            even => held(time_s, values).map(|(read, rows)| Held { read, rows_a_reading: rows as f64 }).or(even),
        }
    }

    /// Tells whether all readings stand there equally often.
    pub(crate) fn is_even(&self) -> bool {
        (self.rows_a_reading - self.rows_a_reading.round()).abs() <= WHOLE
    }

    /// Words on how often a reading stands there.
    pub(crate) fn told(&self) -> String {
        if self.is_even() {
            return format!("each reading stands there {:.0} times", self.rows_a_reading);
        }
        let least = self.rows_a_reading.floor();
        if least < 2.0 {
            return "each reading stands there once or twice".to_owned();
        }
        format!("each reading stands there {least:.0} or {:.0} times", least + 1.0)
    }
}

/// Which samples are new and how many stand for one; `None` where readings are not repeated, or not all of them together.
pub(crate) fn fresh(time_s: &[f64], readings: &[&[f64]]) -> Option<(Vec<bool>, usize)> {
    let (first, others) = readings.split_first()?;
    let usual = usual_run(first)?;
    let mut fresh = begins_by_run(time_s, first, usual);
    for other in others {
        if usual_run(other)? != usual {
            return None;
        }
        // Two sensors of one converter change together; now and then one of them reads the same again.
        fresh.iter_mut().zip(begins_by_run(time_s, other, usual)).for_each(|(fresh, new)| *fresh |= new);
    }
    let count = fresh.iter().filter(|fresh| **fresh).count();
    // Sensors that change at different times are each told by some rows; of those together nearly all would be new.
    (count * usual <= fresh.len() * 5 / 4).then_some((fresh, usual))
}

/// Which samples of one sensor are new and how many stand for one; `None` where its readings are not all repeated equally often.
fn held(time_s: &[f64], values: &[f64]) -> Option<(Vec<bool>, usize)> {
    let usual = usual_run(values)?;
    Some((begins_by_run(time_s, values, usual), usual))
}

/// Tells of each sample whether it is the first of a reading, run by run of those that no gap parts.
fn begins_by_run(time_s: &[f64], values: &[f64], usual: usize) -> Vec<bool> {
    let of = |rows: Range<usize>| {
        let values = values.get(rows).unwrap_or_default();
        let mut fresh = begins(values, usual);
        // What began before the file, or in a gap, is an older reading than the first row.
        if values.chunk_by(|a, b| a == b).next().is_some_and(|run| run.len() < usual)
            && let Some(first) = fresh.first_mut()
        {
            *first = false;
        }
        fresh
    };
    runs_of(time_s).into_iter().flat_map(of).collect()
}

/// Tells whether a sample is the first of a reading that stands for `usual` of them: a run of several times as many holds several readings.
fn begins(values: &[f64], usual: usize) -> Vec<bool> {
    let of = |run: &[f64]| {
        let readings = ((run.len() as f64 / usual as f64).round() as usize).max(1);
        let begins = move |at: usize| at.is_multiple_of(usual) && at / usual < readings;
        (0..run.len()).map(begins).collect::<Vec<bool>>()
    };
    values.chunk_by(|a, b| a == b).flat_map(of).collect()
}

/// The length that nearly all runs of equal numbers have, or a multiple of it, if it is more than 1.
fn usual_run(values: &[f64]) -> Option<usize> {
    let mut lengths: Vec<usize> = values.chunk_by(|a, b| a == b).map(<[f64]>::len).collect();
    if lengths.len() < LEAST_RUNS {
        return None;
    }
    // Multiples are longer, and the few that are shorter were cut off.
    let quarter = lengths.len() / 4;
    let usual = *lengths.select_nth_unstable(quarter).1;
    if usual < 2 {
        return None;
    }
    let alike = lengths.iter().filter(|length| length.is_multiple_of(usual)).count();
    (alike as f64 >= ALIKE * lengths.len() as f64 && jumps(values)).then_some(usual)
}

/// Tells whether readings often change by more than the least change among them, as those of a ramp through coarse steps never do.
pub(super) fn jumps(values: &[f64]) -> bool {
    let changes: Vec<f64> = values.windows(2).map(|w| (w[1] - w[0]).abs()).filter(|change| *change > 0.0).collect();
    let least = changes.iter().copied().fold(f64::INFINITY, f64::min);
    let jumps = changes.iter().filter(|change| **change > JUMP_STEPS * least).count();
    jumps as f64 >= JUMPS * changes.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn repeated_readings_are_told_from_calm_ones() {
        let noise = |k: usize| ((k * 7919 % 1000) as f64 / 1000.0 * 37.0).sin();
        let rows_s: Vec<f64> = (0..500).map(|k| 0.02 * f64::from(k)).collect();
        let held: Vec<f64> = (0..500).map(|k| noise(k / 5)).collect();
        let other: Vec<f64> = (0..500).map(|k| noise(1000 + k / 5)).collect();
        let (new, usual) = fresh(&rows_s, &[&held, &other]).unwrap();
        assert_eq!((usual, new.iter().filter(|new| **new).count()), (5, 100));
        assert!((0..500).all(|k| new[k] == (k % 5 == 0)));
        let quick: Vec<f64> = (0..500).map(noise).collect();
        assert_eq!(fresh(&rows_s, &[&quick]), None);
        assert_eq!(fresh(&rows_s, &[&held, &quick]), None);
        // A coarse converter on a calm chamber.
        let coarse: Vec<f64> = (0..500).map(|k| (noise(k) * 0.8).round()).collect();
        assert_eq!(fresh(&rows_s, &[&coarse]), None);
        let shifted: Vec<f64> = (0..500).map(|k| noise((k + 2) / 5)).collect();
        assert_eq!(fresh(&rows_s, &[&held, &shifted]), None, "two converters out of step");
    }

    /// A number that repeats for another reason than a slow sensor is every row's reading: rest, steps of a converter, a ramp through them,
    /// a ripple.
    #[test]
    fn one_sensor_is_held_or_at_rest() {
        let noise = |k: usize| ((k * 7919 % 1000) as f64 / 1000.0 * 37.0).sin();
        // A reading that comes out as the one before is another one: every third is here.
        let slow: Vec<f64> = (0..700).map(|k| noise((k + 3) / 7 - usize::from((k + 3) / 7 % 3 == 2))).collect();
        let rows_s: Vec<f64> = (0..2000).map(|k| 0.02 * f64::from(k)).collect();
        let (new, usual) = held(&rows_s[..slow.len()], &slow).unwrap();
        assert_eq!(usual, 7);
        assert!((0..700).all(|k| new[k] == (k % 7 == 4)), "{new:?}");
        let coarse = |of: &dyn Fn(f64) -> f64| -> Vec<f64> { (0..2000).map(|k| of(k as f64).round() * 0.5).collect() };
        let ramp = coarse(&|k| (k + 0.5) / 6.0);
        let triangle = coarse(&|k| 20.0 * (((k + 0.5) / 240.0 % 1.0) - 0.5).abs());
        let ripple = coarse(&|k| if k % 8.0 < 4.0 { 3.0 } else { 4.0 });
        let resting = coarse(&|k| if k < 300.0 { 0.3 * k } else { 90.0 + 0.6 * noise(k as usize) });
        for (what, values) in [("ramp", ramp), ("triangle", triangle), ("ripple", ripple), ("resting", resting)] {
            assert_eq!(held(&rows_s, &values), None, "{what}");
        }
    }
}
