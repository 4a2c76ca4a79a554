//! Readings held at a rate that does not divide that of the rows: each stands there two times, then three, then two.
//!
//! A sensor that is read every `T` and logged in rows shows its reading number `n`, taken at `φ + n·T`, from the first row at or after that
//! time on. A change from one row to the next so tells that a reading was taken between these rows, and the next ones with it:
//!
//! ```text
//! reading n     in (b, a]                       its number is new in the row at a, the row before is at b
//! reading n+m   in (b, a] + m·T                 m - 1 readings between came out as the one before
//! ```
//!
//! These spans are cut with each other from change to change. What is left of them stays no wider than a row where there is such a `T`, and
//! is empty soon where there is none: a chamber at rest and a coarse converter change in rows of no rhythm. Of several `T` that go with all
//! changes (a half and a third of the true one do) the longest is right.

use super::repeated::{Held, jumps};
use super::resample::{median_step, runs_of};

/// Changes that must be there to tell, for a sensor whose readings are many rows apart. Where they are `T` rows apart a change without
/// rhythm fits by chance one time in `T`, so more are asked for by `T / (T - 1)`.
const LEAST_CHANGES: f64 = 80.0;
/// Share of the changes that may fall out of step.
const OUT_OF_STEP: f64 = 0.03;
/// Rows from reading to reading that there are at least: below it most rows have a reading, and rhythm shows in few of them.
const LEAST_ROWS: f64 = 1.5;
/// Distance of the numbers of rows that are tried: over the hundreds of changes between two that fall out of step it is less than a row.
const TRIED_ROWS: f64 = 0.002;
/// Changes in which the distance of readings is looked for; it is confirmed in all.
const LOOKED_AT: usize = 400;
/// Readings alike in a row after which the rhythm is looked for anew.
const ALIKE: f64 = 20.0;
/// Share of the changes that go the other way than the one before, from which on the number goes to and fro between two levels, as
/// something that is switched does and no sampled noise (two of three).
const TO_AND_FRO: f64 = 0.9;

/// The span of time within which a reading was taken, in rows.
#[derive(Debug, Clone, Copy)]
struct Within {
    after: f64,
    until: f64,
}

impl Within {
    fn middle(self) -> f64 {
        0.5 * (self.after + self.until)
    }

    /// This span for a reading that is later by so many rows.
    fn later(self, rows: f64) -> Self {
        Within { after: self.after + rows, until: self.until + rows }
    }

    /// Common part of two spans; `None` for nothing.
    fn and(self, other: Self) -> Option<Self> {
        let both = Within { after: self.after.max(other.after), until: self.until.min(other.until) };
        (both.until - both.after > 1e-6).then_some(both)
    }
}

/// A run of rows without a gap: the time of each in rows, and the places of those whose number is new.
struct Run {
    first: usize,
    rows: Vec<f64>,
    changes: Vec<usize>,
}

impl Run {
    fn change(&self, place: usize) -> Option<Within> {
        Some(Within { after: *self.rows.get(place.checked_sub(1)?)?, until: *self.rows.get(place)? })
    }

    /// The changes and how each goes with the one before, where readings are `rows` apart.
    fn steps(&self, rows: f64) -> impl Iterator<Item = (usize, Step)> {
        let mut last: Option<Within> = None;
        self.changes.iter().filter_map(move |place| {
            let here = self.change(*place)?;
            let step = last.map_or(Step::Anew(here), |last| {
                let readings = ((here.middle() - last.middle()) / rows).round().max(1.0);
                let expected = last.later(readings * rows);
                let could_be_out = 1.0 + (expected.until - expected.after) < rows;
                match expected.and(here) {
                    _ if readings > ALIKE => Step::Anew(here),
                    Some(within) => Step::Regular { within, readings, could_be_out },
                    None => Step::Out(here),
                }
            });
            last = Some(step.within());
            Some((*place, step))
        })
    }
}

/// Relation of a change to the one before.
#[derive(Debug, Clone, Copy)]
enum Step {
    /// It is the first one, or too late after the last one to tell.
    Anew(Within),
    /// It is as many readings later; `could_be_out` where another row would have been wrong.
    Regular { within: Within, readings: f64, could_be_out: bool },
    /// It falls between readings.
    Out(Within),
}

impl Step {
    fn within(self) -> Within {
        match self {
            Step::Anew(within) | Step::Regular { within, .. } | Step::Out(within) => within,
        }
    }
}

/// Agreement of changes with a distance of readings.
#[derive(Debug, Default)]
struct Rhythm {
    changes: usize,
    /// Changes from a reading to the next one.
    next: usize,
    /// Changes that could have been out of step, and those that are.
    telling: usize,
    out: usize,
}

impl Rhythm {
    /// Looks at the first changes of all runs, `most` of them.
    fn of(runs: &[Run], rows: f64, most: usize) -> Self {
        let mut of = Rhythm::default();
        for (_, step) in runs.iter().flat_map(|run| run.steps(rows)).take(most) {
            of.changes += 1;
            match step {
                Step::Anew(_) => {}
                Step::Out(_) => (of.telling, of.out) = (of.telling + 1, of.out + 1),
                Step::Regular { readings, could_be_out, .. } => {
                    of.telling += usize::from(could_be_out);
                    of.next += usize::from(readings < 1.5);
                }
            }
        }
        of
    }

    fn share_out(&self) -> f64 {
        self.out as f64 / self.telling.max(1) as f64
    }

    /// Tells whether readings `rows` apart are what changes come from: they go with it, and most changes are from a reading to the next.
    fn is_right(&self, rows: f64) -> bool {
        let least = LEAST_CHANGES * rows / (rows - 1.0);
        self.telling as f64 >= least && self.share_out() <= OUT_OF_STEP && 2 * self.next >= self.changes
    }
}

/// The readings of a sensor whose numbers repeat at a rate of their own; `None` where there is none, and where it is that of the rows.
pub(crate) fn held(time_s: &[f64], values: &[f64]) -> Option<Held> {
    let step_s = median_step(time_s).filter(|step_s| *step_s > 0.0)?;
    if !jumps(values) || goes_to_and_fro(values) {
        return None;
    }
    let runs: Vec<Run> = runs_of(time_s)
        .into_iter()
        .filter_map(|run| {
            let values = values.get(run.clone())?;
            let rows = time_s.get(run.clone())?.iter().map(|time_s| time_s / step_s).collect();
            // Where there is no number nothing has changed.
            let is_new = |w: (usize, &[f64])| ((w.1[0] - w.1[1]).abs() > 0.0).then_some(w.0 + 1);
            Some(Run { first: run.start, rows, changes: values.windows(2).enumerate().filter_map(is_new).collect() })
        })
        .collect();
    let rows_a_reading = rows_a_reading(&runs)?;
    let mut read = vec![false; values.len()];
    runs.iter().for_each(|run| mark(run, rows_a_reading, &mut read));
    read.iter_mut().zip(values).for_each(|(read, x)| *read &= !x.is_nan());
    Some(Held { read, rows_a_reading })
}

/// The distance of readings that goes with nearly all changes, in rows.
fn rows_a_reading(runs: &[Run]) -> Option<f64> {
    let between = |run: &Run| run.changes.windows(2).map(|w| w[1] - w[0]).collect::<Vec<_>>();
    let mut between: Vec<usize> = runs.iter().flat_map(between).collect();
    let middle = between.len() / 2;
    if between.is_empty() {
        return None;
    }
    // Most changes are from a reading to the next, so the usual distance is the number of rows, rounded up or down.
    let usual = *between.select_nth_unstable(middle).1 as f64;
    let from = (usual - 1.0).max(LEAST_ROWS);
    let tried = ((usual + 1.0 - from) / TRIED_ROWS).max(0.0) as usize;
    let mut right: Vec<(f64, f64)> = Vec::new();
    for rows in (0..tried).rev().map(|k| from + TRIED_ROWS * k as f64) {
        let rhythm = Rhythm::of(runs, rows, LOOKED_AT);
        if rhythm.is_right(rows) {
            right.push((rows, rhythm.share_out()));
        } else if !right.is_empty() {
            // Those of a shorter distance are shares of this one.
            break;
        }
    }
    let near = middle_of_best(&right)?;
    let fine = (-20..=20).map(|k| near + 0.1 * TRIED_ROWS * f64::from(k));
    let tried: Vec<(f64, f64)> = fine
        .filter_map(|rows| {
            let rhythm = Rhythm::of(runs, rows, usize::MAX);
            rhythm.is_right(rows).then(|| (rows, rhythm.share_out()))
        })
        .collect();
    middle_of_best(&tried)
}

/// The middle of the numbers with the least share out of step.
fn middle_of_best(tried: &[(f64, f64)]) -> Option<f64> {
    let least = tried.iter().map(|(_, out)| *out).min_by(f64::total_cmp)?;
    let mut best = tried.iter().filter(|(_, out)| *out <= least).map(|(rows, _)| *rows);
    let first = best.next()?;
    Some(0.5 * (first + best.next_back().unwrap_or(first)))
}

/// Marks the rows of a run that are the first with a reading: those whose number is new, and between them those where readings came out
/// as the one before.
fn mark(run: &Run, rows: f64, read: &mut [bool]) {
    let mut set = |place: usize| read.get_mut(run.first + place).into_iter().for_each(|read| *read = true);
    let (Some(begin), Some(end)) = (run.rows.first(), run.rows.last()) else { return };
    let row_of = |time: f64| run.rows.partition_point(|row| *row < time - 1e-9);
    let mut last: Option<(usize, f64)> = None;
    for (place, step) in run.steps(rows) {
        let here = step.within().middle();
        match last {
            Some((before, at)) => {
                let readings = ((here - at) / rows).round();
                let alike = (1..readings.max(1.0) as usize).map(|n| row_of(here - rows * (readings - n as f64)));
                alike.filter(|row| (before + 1..place).contains(row)).for_each(&mut set);
            }
            // A reading that stands in the first row may be older than it.
            None => {
                let before = (1..).map(|n| here - rows * f64::from(n)).take_while(|time| *time > begin - 1.0);
                before.map(row_of).for_each(&mut set);
            }
        }
        set(place);
        last = Some((place, here));
    }
    let from = last.map_or(*begin, |(_, at)| at + rows);
    (0..).map(|n| from + rows * f64::from(n)).take_while(|time| *time <= *end).map(row_of).for_each(&mut set);
}

/// Tells whether nearly every change undoes the one before.
fn goes_to_and_fro(values: &[f64]) -> bool {
    let changes: Vec<f64> = values.windows(2).map(|w| w[1] - w[0]).filter(|change| change.abs() > 0.0).collect();
    let turns = changes.windows(2).filter(|w| w[0] * w[1] < 0.0).count();
    turns as f64 >= TO_AND_FRO * changes.len().saturating_sub(1).max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROWS: usize = 1500;

    /// Numbers between -1 and 1 without rhythm, by splitmix64.
    fn noise(seed: usize, k: usize) -> f64 {
        let mut z = (seed as u64) << 32 ^ (k as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    fn times() -> Vec<f64> {
        (0..ROWS).map(|k| 0.02 * k as f64).collect()
    }

    /// Number of the reading that stands in a row of 20 ms, where the sensor is read `hz` times a second, the first time `phase_s` late.
    fn reading(row: usize, hz: f64, phase_s: f64) -> usize {
        ((0.02 * row as f64 - phase_s) * hz + 1e-9).floor().max(-1.0) as i64 as usize
    }

    /// A moving pressure in kPa with noise, in steps of a converter.
    fn kpa(seed: usize, reading: usize, hz: f64, step: f64) -> f64 {
        let moving = 90.0 + 12.0 * (1.7 * reading as f64 / hz).sin();
        ((moving + 0.3 * noise(seed, reading)) / step).round() * step
    }

    #[test]
    fn readings_are_found_whose_rate_does_not_divide_that_of_the_rows() {
        for (hz, step, phase_s) in [
            (20.0, 1e-3, 0.0),
            (20.0, 0.1, 0.013),
            (30.0, 1e-3, 0.004),
            (30.0, 0.1, 0.019),
            (12.5, 0.1, 0.007),
            (22.73, 0.1, 0.003),
            (8.9, 0.05, 0.03),
            (19.98, 0.1, 0.011),
        ] {
            for seed in 0..5 {
                let of = |row: usize| reading(row, hz, phase_s);
                let values: Vec<f64> = (0..ROWS).map(|row| kpa(seed, of(row), hz, step)).collect();
                let found = held(&times(), &values).unwrap_or_else(|| panic!("{hz} Hz, {step} kPa, seed {seed}"));
                assert!((found.rows_a_reading - 50.0 / hz).abs() < 2e-3, "{hz} Hz: {found:?}");
                let wrong: Vec<usize> = (1..ROWS).filter(|row| found.read[*row] != (of(*row) != of(row - 1))).collect();
                // A reading that came out as the one before may be told in a neighbouring row, where the clocks' rhythm allows both.
                assert!(wrong.len() * 200 <= ROWS, "{hz} Hz, {step} kPa, seed {seed}: {wrong:?}");
            }
        }
    }

    /// Lost rows, a gap behind which the sensor's clock stands otherwise, and a rest on which the converter shows nothing.
    #[test]
    fn the_rhythm_goes_through_lost_rows_gaps_and_rests() {
        let rows: Vec<usize> = (0..2 * ROWS).filter(|row| row % 97 != 3 && !(1000..1300).contains(row)).collect();
        let of = |row: usize| reading(row, 20.0, if row < 1150 { 0.003 } else { 0.046 });
        let at_rest = |row: usize| (400..600).contains(&row);
        let value = |row: &usize| if at_rest(*row) { 90.0 } else { kpa(1, of(*row), 20.0, 0.01) };
        let values: Vec<f64> = rows.iter().map(value).collect();
        let times: Vec<f64> = rows.iter().map(|row| 0.02 * *row as f64).collect();
        let found = held(&times, &values).unwrap();
        assert!((found.rows_a_reading - 2.5).abs() < 2e-3, "{}", found.rows_a_reading);
        let is_new = |w: &[usize]| of(w[0]) != of(w[1]);
        let wrong = rows.windows(2).enumerate().filter(|(at, w)| {
            !w.iter().any(|row| (395..605).contains(row) || *row == 1300) && found.read[at + 1] != is_new(w)
        });
        assert!(wrong.count() * 200 <= rows.len());
        let resting = rows.iter().zip(&found.read).filter(|(row, read)| at_rest(**row) && **read).count();
        assert!((70..=90).contains(&resting), "200 rows of rest hold 80 readings: {resting}");
    }

    /// A sensor that comes off has no readings from there on, whatever its rhythm.
    #[test]
    fn rows_without_a_number_hold_no_reading() {
        let of = |row: usize| if row < 1000 { kpa(2, reading(row, 20.0, 0.003), 20.0, 0.01) } else { f64::NAN };
        let found = held(&times(), &(0..ROWS).map(of).collect::<Vec<_>>()).unwrap();
        assert!((found.rows_a_reading - 2.5).abs() < 2e-3, "{}", found.rows_a_reading);
        let [there, none] =
            [&found.read[..1000], &found.read[1000..]].map(|part| part.iter().filter(|read| **read).count());
        assert!(there.abs_diff(400) <= 2 && none == 0, "{there} {none}");
    }

    #[test]
    fn what_repeats_without_rhythm_is_read_in_every_row() {
        let none = |what: &str, of: &dyn Fn(usize, usize) -> f64| {
            for seed in 0..40 {
                let values: Vec<f64> = (0..ROWS).map(|row| of(seed, row)).collect();
                assert_eq!(held(&times(), &values), None, "{what}, seed {seed}");
            }
        };
        for scatter in [0.3, 0.6, 0.8, 1.0, 1.3, 1.6, 2.0, 3.0] {
            none("rest on a coarse converter", &|seed, row| (scatter * noise(seed, row)).round());
            none("drift in steps", &|seed, row| (0.01 * row as f64 + scatter * noise(seed, row)).round());
            none("waves in steps", &|seed, row| {
                (20.0 * (row as f64 * 0.01).sin() + scatter * noise(seed, row)).round()
            });
        }
        none("ramp", &|seed, row| (row as f64 / (1.6 + 0.05 * seed as f64)).floor());
        none("a valve at its stop", &|seed, row| noise(seed, row).clamp(-0.2, 0.2));
        none("between two stops", &|seed, row| {
            if row * 2 % 5 < 2 { noise(seed, 0) } else { 3.0 + 0.01 * (row / 50) as f64 }
        });
        none("each row another", &|seed, row| noise(seed, row));
        // Each row another, now and then none.
        none("a number now and then again", &|seed, row| {
            noise(seed, row - usize::from(noise(seed + 1, row) > 0.5 && row > 0))
        });
    }
}
