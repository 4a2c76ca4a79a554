//! Seconds of a column of times: the unit that its numbers are in, said or found.

use model::rig::Term;

use super::unlikely_times::{DAY_S, MOST_STEP_S};
use super::{NAMES, UNIT_MARKS};
use crate::recording::columns::units::Unit;
use crate::recording::csv::CsvError;
use crate::recording::logger_file::sheet::Sheet;
use crate::recording::recording_error::RecordingError;
use crate::recording::rows::resample::median_step;

/// Epochs in seconds lie between these (2001 and 2286), which no recording's own seconds reach.
pub(super) const EPOCH_S: [f64; 2] = [1e9, 1e10];

/// Steps of 100 ns, of the years 1981 to 2108 and 1965 to 2155, and where they are counted from.
const EPOCHS_100_NS: [([f64; 2], &str); 2] =
    [([1.2e17, 1.6e17], "1601, as Windows counts them"), ([6.2e17, 6.8e17], "the year 1, as .NET counts them")];

/// Days since 1900, as spreadsheets count them, of 1954 to 2118, and days since year 0, as MATLAB does, of 1971 to 2108.
const SERIAL_DAYS: [[f64; 2]; 2] = [[20_000.0, 80_000.0], [720_000.0, 770_000.0]];

/// The source of a column's unit of time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Said {
    /// The map, the file or the name says the unit: s per number.
    Unit(f64),
    /// The map names the column, which is in s then.
    Column,
    /// Neither says one.
    Nothing,
}

/// The unit of a column of times, by the map, the file or its name.
///
/// # Errors
/// A unit in the map that is none of time.
pub(super) fn said(sheet: &Sheet<'_>, at: usize, term: Option<&Term>) -> Result<Said, RecordingError> {
    let Some(column) = sheet.columns.get(at) else { return Ok(Said::Nothing) };
    if let Some(text) = term.and_then(|term| term.unit.as_ref()) {
        return match Unit::parse(text) {
            Some(Unit::Time(s)) => Ok(Said::Unit(s)),
            _ => Err(RecordingError::Unit {
                file: sheet.file.clone(),
                column: column.title.clone(),
                problem: format!(
                    "`unit = \"{text}\"` in [recording] time is no unit of time; use s, ms, us, ns, min or h"
                ),
            }),
        };
    }
    if term.is_some_and(|term| !term.is_plain()) {
        return Ok(Said::Unit(1.0));
    }
    if let Some(Unit::Time(s)) = column.unit.as_ref().and_then(|unit| Unit::parse(unit)) {
        return Ok(Said::Unit(s));
    }
    let nobody = if term.is_some() { Said::Column } else { Said::Nothing };
    Ok(by_name(&column.name).map_or(nobody, Said::Unit))
}

/// s per number of a time that says so in its name.
fn by_name(name: &str) -> Option<f64> {
    let known = NAMES.iter().find(|(known, _)| name.eq_ignore_ascii_case(known)).and_then(|(_, s)| *s);
    // `time_s` is what a column is called that somebody meant to bring to seconds.
    known.or_else(|| unit_behind(name).filter(|s| *s != 1.0))
}

/// s per number by the unit behind a name.
pub(super) fn unit_behind(name: &str) -> Option<f64> {
    match Unit::parse(name.rsplit_once(UNIT_MARKS)?.1) {
        Some(Unit::Time(s)) => Some(s),
        _ => None,
    }
}

/// The seconds of one column, and a word where they were not seconds already.
///
/// # Errors
/// A cell that is no time.
pub(super) fn seconds(sheet: &Sheet<'_>, at: usize, said: Said) -> Result<(Vec<f64>, Option<String>), RecordingError> {
    let title = sheet.columns.get(at).map_or("", |column| column.title.as_str());
    let mut numbers = sheet.times(at).map_err(no_time)?;
    if sheet.is_timestamped(at) {
        return Ok((numbers, Some(format!("{title} as date and time"))));
    }
    let wrapped = crate::recording::times::counter_wrap::unwrapped(&mut numbers);
    let (factor, word) = match said {
        Said::Unit(s) => (s, (s != 1.0).then(|| format!("{title} in {}", unit_word(s)))),
        Said::Column | Said::Nothing => {
            if is_in_days(&numbers) {
                (DAY_S, Some(format!("{title} in days, as spreadsheets and MATLAB count them")))
            } else {
                epoch(numbers.first().copied().unwrap_or(0.0))
                    .map_or((1.0, None), |(factor, words)| (factor, words.map(|words| format!("{title} {words}"))))
            }
        }
    };
    // Differences of times since 1970 keep more digits before they are scaled than after.
    let first = numbers.first().copied().unwrap_or(0.0);
    if first.abs() * factor > EPOCH_S[0] {
        numbers.iter_mut().for_each(|x| *x = (*x - first) * factor);
    } else {
        numbers.iter_mut().for_each(|x| *x *= factor);
    }
    let wrapped = wrapped.map(|(counter, times)| {
        let times = if times == 1 { "once".to_owned() } else { format!("{times} times") };
        format!("{title} as {counter} that began anew {times}")
    });
    let words: Vec<String> = word.into_iter().chain(wrapped).collect();
    Ok((numbers, (!words.is_empty()).then(|| words.join(", "))))
}

/// A unit of time as one writes it, of so many s.
fn unit_word(s: f64) -> String {
    let known = [("ns", 1e-9), ("us", 1e-6), ("ms", 1e-3), ("min", 60.0), ("h", 3600.0), ("days", DAY_S)];
    known
        .into_iter()
        .find(|(_, of)| (s / of - 1.0).abs() < 1e-9)
        .map_or_else(|| format!("{s} s"), |(unit, _)| unit.to_owned())
}

/// The error of a cell of times that is no number.
fn no_time(error: CsvError) -> CsvError {
    match error {
        CsvError::NotANumber { file, line, position, column, cell } if !cell.is_empty() => {
            CsvError::NotATime { file, line, position, column, cell }
        }
        error => error,
    }
}

/// Says whether numbers are days of a calendar: as large as its days, and so close that seconds would be no logger's.
fn is_in_days(numbers: &[f64]) -> bool {
    let first = numbers.first().copied().unwrap_or(0.0);
    let of_calendar = SERIAL_DAYS.iter().any(|[from, to]| (*from..*to).contains(&first));
    of_calendar && median_step(numbers).is_some_and(|step| step > 0.0 && step * DAY_S <= MOST_STEP_S)
}

/// s per number of an epoch, and words for what is no s; `None` where a number is none.
fn epoch(first: f64) -> Option<(f64, Option<String>)> {
    let since_1970 = |factor: &f64| (EPOCH_S[0]..EPOCH_S[1]).contains(&(first * factor));
    if let Some(factor) = [1.0, 1e-3, 1e-6, 1e-9].into_iter().find(since_1970) {
        return Some((factor, (factor != 1.0).then(|| format!("since 1970 in {}", unit_word(factor)))));
    }
    let (_, words) = EPOCHS_100_NS.into_iter().find(|([from, to], _)| (*from..*to).contains(&first))?;
    Some((1e-7, Some(format!("in 100 ns since {words}"))))
}
