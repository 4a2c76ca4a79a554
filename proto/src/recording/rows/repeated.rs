//! Loggers that are quicker than their sensors: each reading stands there several times.
//!
//! A sensor that is read every 100 ms and logged every 20 ms repeats each number five times. Only the first of them is a sample. Such
//! runs of equal numbers are all of one length; those of a calm chamber and a coarse converter are of every length.

/// Runs that must be there to tell.
const LEAST_RUNS: usize = 40;
/// Share of the runs that must have the usual length.
const ALIKE: f64 = 0.8;

/// How samples and sensors' readings go together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Sensors {
    /// A reading in each sample.
    EachSample,
    /// Each reading stands in so many samples.
    Repeated(usize),
    /// One of so many samples has a reading, the others have none.
    Slower(usize),
}

impl Sensors {
    /// Samples for each reading.
    pub(crate) fn samples(self) -> usize {
        match self {
            Sensors::EachSample => 1,
            Sensors::Repeated(samples) | Sensors::Slower(samples) => samples,
        }
    }
}

/// Which samples are new and how many stand for one; `None` where readings are not repeated, or not all of them together.
pub(crate) fn fresh(readings: &[&[f64]]) -> Option<(Vec<bool>, usize)> {
    let (first, others) = readings.split_first()?;
    let usual = usual_run(first)?;
    let mut fresh = begins(first);
    for other in others {
        if usual_run(other)? != usual {
            return None;
        }
        // Two sensors of one converter change together; now and then one of them reads the same again.
        fresh.iter_mut().zip(begins(other)).for_each(|(fresh, new)| *fresh |= new);
    }
    let count = fresh.iter().filter(|fresh| **fresh).count();
    // Sensors that change at different times are each told by some rows; of those together nearly all would be new.
    (count * usual <= fresh.len() * 5 / 4).then_some((fresh, usual))
}

/// Whether a sample is another number than the one before.
fn begins(values: &[f64]) -> Vec<bool> {
    let new = values.windows(2).map(|w| w[0] != w[1]);
    std::iter::once(true).chain(new).take(values.len()).collect()
}

/// The length that nearly all runs of equal numbers have, if it is more than 1.
fn usual_run(values: &[f64]) -> Option<usize> {
    let mut lengths: Vec<usize> = values.chunk_by(|a, b| a == b).map(<[f64]>::len).collect();
    if lengths.len() < LEAST_RUNS {
        return None;
    }
    let middle = lengths.len() / 2;
    let usual = *lengths.select_nth_unstable(middle).1;
    let alike = lengths.iter().filter(|length| **length == usual).count();
    (usual > 1 && alike as f64 >= ALIKE * lengths.len() as f64).then_some(usual)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn repeated_readings_are_told_from_calm_ones() {
        let noise = |k: usize| ((k * 7919 % 1000) as f64 / 1000.0 * 37.0).sin();
        let held: Vec<f64> = (0..500).map(|k| noise(k / 5)).collect();
        let other: Vec<f64> = (0..500).map(|k| noise(1000 + k / 5)).collect();
        let (new, usual) = fresh(&[&held, &other]).unwrap();
        assert_eq!((usual, new.iter().filter(|new| **new).count()), (5, 100));
        assert!((0..500).all(|k| new[k] == (k % 5 == 0)));
        let quick: Vec<f64> = (0..500).map(noise).collect();
        assert_eq!(fresh(&[&quick]), None);
        assert_eq!(fresh(&[&held, &quick]), None);
        // A coarse converter on a calm chamber.
        let coarse: Vec<f64> = (0..500).map(|k| (noise(k) * 0.8).round()).collect();
        assert_eq!(fresh(&[&coarse]), None);
        let shifted: Vec<f64> = (0..500).map(|k| noise((k + 2) / 5)).collect();
        assert_eq!(fresh(&[&held, &shifted]), None, "two converters out of step");
    }
}
