//! Loggers with one row per command and a sensor that is read less often, or the other way round: the cells between are blank.
//!
//! A cell now and then without a number is a reading that is missing, or makes its row a lost one ([`super::lost_rows`]). Where a third
//! of a sensor's cells or more are blank it is a slower channel: the rows that have readings count as readings, what lies between them is
//! on straight lines. A command that is written less often is in force until the next one.

use std::ops::Range;

use crate::recording::csv::CsvError;
use crate::recording::csv::numbers::{parse, says_nothing};
use crate::recording::logger_file::sheet::{Cells, Sheet};

/// Share of blank cells from which a channel is a slower one.
const SLOWER: f64 = 1.0 / 3.0;
/// Readings that such a channel has at least: fewer tell nothing of a rate.
const LEAST_READINGS: usize = 20;
/// Commands that such a channel has at least: written where they change, there are few.
const LEAST_COMMANDS: usize = 2;
/// Words for what a relay does.
const SWITCHED: [(&str, f64); 8] = [
    ("on", 1.0),
    ("off", 0.0),
    ("yes", 1.0),
    ("no", 0.0),
    ("run", 1.0),
    ("stop", 0.0),
    ("running", 1.0),
    ("stopped", 0.0),
];

/// The numbers of a sensor's column, NaN where a slower channel has none, or a row now and then.
///
/// # Errors
/// As [`Sheet::numbers`], where cells hold something else or hardly any a number.
pub(crate) fn readings(sheet: &Sheet<'_>, column: usize) -> Result<Vec<f64>, CsvError> {
    let numbers = sheet.numbers(column);
    let Err(refused) = numbers else { return numbers };
    match with_blanks(sheet, column) {
        Some(read) if !is_slower(&read) || count(&read) >= LEAST_READINGS => Ok(read),
        _ => Err(refused),
    }
}

/// The numbers of a command's column, each held where many cells behind it are blank, and whether that is so; the first one also before
/// it. NaN where a row now and then has none.
///
/// # Errors
/// As [`Sheet::numbers`], where cells hold something else or hardly any a number.
pub(crate) fn commands(sheet: &Sheet<'_>, column: usize) -> Result<(Vec<f64>, bool), CsvError> {
    let refused = match sheet.numbers(column) {
        Ok(numbers) => return Ok((numbers, false)),
        Err(refused) => refused,
    };
    let mut written = match with_blanks(sheet, column) {
        Some(written) if !is_slower(&written) => return Ok((written, false)),
        Some(written) if count(&written) >= LEAST_COMMANDS => written,
        _ => return Err(refused),
    };
    let mut last = written.iter().copied().find(|x| !x.is_nan()).unwrap_or(f64::NAN);
    for x in &mut written {
        last = if x.is_nan() { last } else { *x };
        *x = last;
    }
    Ok((written, true))
}

/// The numbers of a relay's column, which may hold words: as [`commands`].
///
/// # Errors
/// As [`commands`], where words are others.
pub(crate) fn switches(sheet: &Sheet<'_>, column: usize) -> Result<(Vec<f64>, bool), CsvError> {
    let refused = match commands(sheet, column) {
        Ok(numbers) => return Ok(numbers),
        Err(refused) => refused,
    };
    let Some(Cells::Text(texts)) = sheet.columns.get(column).map(|of| &of.cells) else { return Err(refused) };
    let word = |text: &str| SWITCHED.iter().find(|(word, _)| text.trim().eq_ignore_ascii_case(word)).map(|(_, on)| *on);
    let numbers: Option<Vec<f64>> = texts.iter().map(|text| word(text)).collect();
    numbers.map(|numbers| (numbers, false)).ok_or(refused)
}

/// The numbers of a prescribed flow or pressure, NaN where a row now and then has none.
///
/// # Errors
/// As [`Sheet::numbers`], where cells hold something else or many hold nothing.
pub(crate) fn signals(sheet: &Sheet<'_>, column: usize) -> Result<Vec<f64>, CsvError> {
    let numbers = sheet.numbers(column);
    let Err(refused) = numbers else { return numbers };
    with_blanks(sheet, column).filter(|written| !is_slower(written)).ok_or(refused)
}

/// By row, whether a column has nothing there.
pub(crate) fn blank(sheet: &Sheet<'_>, column: usize) -> Vec<bool> {
    match sheet.columns.get(column).map(|of| &of.cells) {
        Some(Cells::Numbers(numbers)) => numbers.iter().map(|x| x.is_nan()).collect(),
        Some(Cells::Text(texts)) => texts.iter().map(|text| says_nothing(text)).collect(),
        None => Vec::new(),
    }
}

/// By row, whether a column has nothing there, where that is so in a row now and then; all false elsewhere.
pub(crate) fn now_and_then_blank(sheet: &Sheet<'_>, column: usize) -> Vec<bool> {
    let blank = blank(sheet, column);
    let count = blank.iter().filter(|blank| **blank).count();
    if are_many(count, blank.len()) { vec![false; blank.len()] } else { blank }
}

/// One row of so many at most has a remark where a number belongs.
const REMARKED: usize = 100;

/// Tells whether a cell holds a word, as somebody writes one over a number; digits with a letter among them are a number gone wrong.
fn is_remark(text: &str) -> bool {
    let letters = text.trim().chars().take_while(|c| c.is_alphabetic()).count();
    letters > 1
}

/// A column's numbers, NaN at blank cells and at a remark now and then; `None` where other cells hold no number.
fn with_blanks(sheet: &Sheet<'_>, column: usize) -> Option<Vec<f64>> {
    let remarks = |texts: &[std::borrow::Cow<'_, str>]| {
        texts
            .iter()
            .filter(|text| !says_nothing(text) && parse(text, sheet.decimal).is_none() && is_remark(text))
            .count()
    };
    match sheet.columns.get(column).map(|of| &of.cells) {
        Some(Cells::Numbers(numbers)) => {
            Some(numbers.iter().map(|x| if x.is_finite() { *x } else { f64::NAN }).collect())
        }
        Some(Cells::Text(texts)) => {
            let few = REMARKED * remarks(texts) <= texts.len();
            texts
                .iter()
                .map(|text| match parse(text, sheet.decimal) {
                    None if says_nothing(text) || few && is_remark(text) => Some(f64::NAN),
                    // What a converter that was overdriven writes.
                    Some(number) if number.is_infinite() => Some(f64::NAN),
                    number => number,
                })
                .collect()
        }
        None => None,
    }
}

fn count(numbers: &[f64]) -> usize {
    numbers.iter().filter(|x| !x.is_nan()).count()
}

/// Tells whether so many rows have no number that the column is a slower one.
pub(crate) fn is_slower(numbers: &[f64]) -> bool {
    are_many(numbers.len() - count(numbers), numbers.len())
}

/// Tells whether so many blank cells of a column are more than a row now and then.
fn are_many(blank: usize, cells: usize) -> bool {
    blank as f64 >= SLOWER * cells as f64
}

/// Where the slower channels of a file have readings.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Slower {
    /// By row, whether every sensor was read.
    pub(crate) read: Vec<bool>,
    /// From the first of these rows to the last.
    pub(crate) span: Range<usize>,
}

impl Slower {
    /// Finds the rows of sensors' columns; `None` where all have a reading in every row.
    ///
    /// # Errors
    /// The place of a column whose readings stand in other rows than those of the rest.
    pub(crate) fn of(columns: &[&[f64]]) -> Result<Option<Self>, usize> {
        let rows = columns.first().map_or(0, |column| column.len());
        let Some((slowest, fewest)) = columns.iter().map(|of| count(of)).enumerate().min_by_key(|(_, count)| *count)
        else {
            return Ok(None);
        };
        if fewest == rows {
            return Ok(None);
        }
        let read: Vec<bool> =
            (0..rows).map(|row| columns.iter().all(|of| of.get(row).is_some_and(|x| !x.is_nan()))).collect();
        let together = read.iter().filter(|read| **read).count();
        let (first, last) = (read.iter().position(|read| *read), read.iter().rposition(|read| *read));
        match (first, last) {
            (Some(first), Some(last)) if 2 * together >= fewest => Ok(Some(Slower { read, span: first..last + 1 })),
            _ => Err(slowest),
        }
    }

    /// Rows for each that has a reading, as a whole number.
    pub(crate) fn rows_a_reading(&self) -> usize {
        let count = self.read.iter().filter(|read| **read).count();
        (self.span.len() as f64 / count.max(1) as f64).round().max(1.0) as usize
    }
}

/// Puts straight lines over time where a column has no reading, between those that it has.
pub(crate) fn fill(time_s: &[f64], numbers: &mut [f64]) {
    let there = time_s.iter().zip(numbers.iter()).filter(|(_, x)| !x.is_nan());
    let there: Vec<(f64, f64)> = there.map(|(time, x)| (*time, *x)).collect();
    let mut after = 0;
    for (time, slot) in time_s.iter().zip(numbers) {
        while there.get(after).is_some_and(|(of, _)| of < time) {
            after += 1;
        }
        if slot.is_nan() {
            *slot = match (after.checked_sub(1).and_then(|before| there.get(before)), there.get(after)) {
                (Some((t0, x0)), Some((t1, x1))) => x0 + (x1 - x0) * (time - t0) / (t1 - t0),
                (Some((_, x)), None) | (None, Some((_, x))) => *x,
                (None, None) => f64::NAN,
            };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_go_from_reading_to_reading_over_time() {
        let nan = f64::NAN;
        let mut x = [nan, 1.0, nan, nan, 4.0, nan];
        fill(&[0.0, 0.02, 0.03, 0.06, 0.08, 0.1], &mut x);
        let expected = [1.0, 1.0, 1.5, 3.0, 4.0, 4.0];
        assert!(x.iter().zip(expected).all(|(x, e)| (x - e).abs() < 1e-12), "{x:?}");
    }

    #[test]
    fn channels_that_are_never_read_together_are_told() {
        let nan = f64::NAN;
        let (a, b) = ([1.0, nan, 1.0, nan], [nan, 1.0, nan, 1.0]);
        assert_eq!(Slower::of(&[&a, &b]), Err(0));
        assert_eq!(Slower::of(&[&[1.0; 4], &[2.0; 4]]), Ok(None));
        let of = Slower::of(&[&a, &[1.0; 4]]).unwrap().unwrap();
        assert_eq!((of.span.clone(), of.rows_a_reading()), (0..3, 2), "{of:?}");
    }
}
