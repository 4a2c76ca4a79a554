//! Rules for a table that is a recording: names, finite numbers, time that goes forward at 50 Hz, known columns in their ranges.

use std::ops::Range;

use super::{MAX_STEP_S, PERIOD_S, RecordingError};
use crate::recording::csv::{self, ColumnData, CsvError, Table};

/// The least that a reading of a gauge pressure may be (kPa): no pressure is below vacuum, but a line that rings, or a zero that is
/// off, is read there. Beyond it lie the usual vacuums in mbar, hPa, mmHg and Pa.
pub(in crate::recording) const LEAST_READING_KPA: f64 = -200.0;

/// Columns whose meaning is fixed: must be numbers, within (least, largest).
pub(super) const KNOWN: [(&str, f64, f64); 7] = [
    ("u_pos", 0.0, 1.0),
    ("u_neg", 0.0, 1.0),
    ("p_pos_kpa", LEAST_READING_KPA, f64::MAX),
    ("p_neg_kpa", LEAST_READING_KPA, f64::MAX),
    ("ref_pos_kpa", -101.325, f64::MAX),
    ("ref_neg_kpa", -101.325, f64::MAX),
    ("pump_on", 0.0, 1.0),
];

/// Checks a table and cuts its rows into segments.
///
/// # Errors
/// The first thing that is wrong, with its line and column.
pub(super) fn check(file: &str, table: &Table) -> Result<Vec<Range<usize>>, RecordingError> {
    check_names_and_numbers(file, table)?;
    check_time(file, table)?;
    for (name, low, high) in KNOWN {
        check_range(file, table, name, low, high)?;
    }
    Ok(segments(&table.time_s))
}

/// Checks tables that did not come from a file for all that `Table::parse` sees to in files.
fn check_names_and_numbers(file: &str, table: &Table) -> Result<(), CsvError> {
    let mut seen = std::collections::HashSet::from([csv::TIME_COLUMN]);
    for (index, column) in table.columns.iter().enumerate() {
        let position = table.position(&column.name).unwrap_or(index + 2);
        if !seen.insert(&column.name) {
            return Err(CsvError::DuplicateColumn {
                file: file.to_owned(),
                line: 1,
                position: index + 2,
                column: column.name.clone(),
                mend: String::new(),
            });
        }
        if let ColumnData::Numbers(numbers) = &column.data {
            all_finite(file, table, numbers, &column.name, position)?;
        }
    }
    all_finite(file, table, &table.time_s, csv::TIME_COLUMN, table.time_position)
}

fn all_finite(file: &str, table: &Table, numbers: &[f64], name: &str, position: usize) -> Result<(), CsvError> {
    match numbers.iter().zip(&table.lines).find(|(number, _)| !number.is_finite()) {
        None => Ok(()),
        Some((number, line)) => Err(CsvError::NotFinite {
            file: file.to_owned(),
            line: *line,
            position,
            column: name.to_owned(),
            cell: number.to_string(),
        }),
    }
}

fn check_time(file: &str, table: &Table) -> Result<(), RecordingError> {
    if table.time_s.is_empty() {
        return Err(CsvError::NoRows { file: file.to_owned() }.into());
    }
    let pairs = table.time_s.iter().zip(table.time_s.iter().skip(1));
    for ((previous, value), line) in pairs.clone().zip(table.lines.iter().skip(1)) {
        if value <= previous {
            return Err(CsvError::TimeNotForward {
                file: file.to_owned(),
                line: *line,
                position: table.time_position,
                column: csv::TIME_COLUMN.to_owned(),
                value: *value,
                previous: *previous,
            }
            .into());
        }
    }
    let mut steps: Vec<f64> = pairs.map(|(previous, value)| value - previous).collect();
    let middle = steps.len() / 2;
    if steps.is_empty() {
        return Ok(());
    }
    let (_, median, _) = steps.select_nth_unstable_by(middle, f64::total_cmp);
    let median_s = *median;
    if (median_s / PERIOD_S - 1.0).abs() <= 0.05 {
        return Ok(());
    }
    Err(RecordingError::WrongRate {
        file: file.to_owned(),
        // Three digits are enough to see what it is; the full f64 is noise in a message.
        median_ms: (median_s * 1e6).round() / 1e3,
        hint: time_hint(median_s)
            .map_or_else(|| "; resample it to 50 Hz".to_owned(), |hint| format!("; time_s seems to {hint}")),
    })
}

/// Mend where 20 ms are taken for something else, since times are not in seconds.
pub(in crate::recording) fn time_hint(median_s: f64) -> Option<&'static str> {
    const OTHERS: [(f64, &str); 6] = [
        (1e3, "be in milliseconds: divide it by 1000"),
        (1e6, "be in microseconds: divide it by 1e6"),
        (1e9, "be in nanoseconds: divide it by 1e9"),
        (50.0, "count rows: multiply it by 0.02"),
        (1.0 / 60.0, "be in minutes: multiply it by 60"),
        (1.0 / 3600.0, "be in hours: multiply it by 3600"),
    ];
    let taken_for = |(factor, _): &&(f64, &str)| (median_s / (factor * PERIOD_S) - 1.0).abs() <= 0.05;
    OTHERS.iter().find(taken_for).map(|(_, hint)| *hint)
}

fn check_range(file: &str, table: &Table, name: &str, low: f64, high: f64) -> Result<(), CsvError> {
    let Some(numbers) = table.numbers(name) else { return Ok(()) };
    for (number, line) in numbers.iter().zip(&table.lines) {
        let wrong = !(low..=high).contains(number);
        let not_a_switch = name == "pump_on" && *number != 0.0 && *number != 1.0;
        if wrong || not_a_switch {
            return Err(CsvError::OutOfRange {
                file: file.to_owned(),
                line: *line,
                position: table.position(name).unwrap_or(0),
                column: name.to_owned(),
                value: *number,
                low,
                high,
                hint: match name {
                    "u_pos" | "u_neg" => "; a duty is a share, not a percentage",
                    "pump_on" => "; the pump is on (1) or off (0)",
                    _ => below_vacuum(*number),
                }
                .to_owned(),
            });
        }
    }
    Ok(())
}

/// Likely kind of a number that no gauge pressure in kPa can be: a vacuum of some tens of kPa, in units that are smaller.
pub(in crate::recording) fn below_vacuum(number: f64) -> &'static str {
    match number {
        ..-2_000.0 => "; pressures are gauge kPa, and this seems to be Pa",
        ..-200.0 => "; pressures are gauge kPa, and this seems to be mbar, hPa or mmHg",
        _ => "; pressures are gauge kPa, and nothing is so far below vacuum",
    }
}

/// Cuts the rows wherever a step is longer than [`MAX_STEP_S`].
pub(in crate::recording) fn segments(time_s: &[f64]) -> Vec<Range<usize>> {
    // A written 30 ms step may read back a rounding error longer.
    const SLACK_S: f64 = 1e-6;
    let mut segments = Vec::new();
    let mut start = 0;
    for (row, (previous, time)) in time_s.iter().zip(time_s.iter().skip(1)).enumerate() {
        if time - previous > MAX_STEP_S + SLACK_S {
            segments.push(start..row + 1);
            start = row + 1;
        }
    }
    segments.push(start..time_s.len());
    segments
}
