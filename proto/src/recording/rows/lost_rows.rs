//! Cells without a number that is needed: a logger that had nothing for one row, and wrote nothing, `NaN` or `---`.
//!
//! A row without a time or a command is a lost one, as if it were not in the file: a hole that is bridged where it is short and a gap
//! where it is long, and told as that. A sensor's cell is one reading that is missing, and nothing else: the commands of its row were
//! sent, and the other sensors were read. A run needs all pressures to begin at, so rows before the first of a sensor's readings are left
//! out. Which cells and how many is told besides, for whoever looks for the rows.

use std::ops::Range;

use super::resample::{self, Kind};
use super::slower::{self, is_slower, now_and_then_blank};
use crate::recording::csv::{Column, ColumnData, rows_alone};
use crate::recording::logger_file::sheet::Sheet;

/// The sheet without rows that have no time; `None` where all have one.
pub(crate) fn timed<'a>(sheet: &Sheet<'a>, of_time: &[usize]) -> Option<Sheet<'a>> {
    let blank: Vec<Vec<bool>> = of_time.iter().map(|column| now_and_then_blank(sheet, *column)).collect();
    let lost = |row: usize| blank.iter().any(|blank| blank.get(row).copied().unwrap_or(false));
    let title = of_time.first().and_then(|at| sheet.columns.get(*at)).map_or("", |column| column.title.as_str());
    without(sheet, title, lost).map(|(sheet, _)| sheet)
}

/// The sheet, times and columns without rows in which a column other than a sensor's has no number.
pub(crate) fn numbered<'a>(
    sheet: &Sheet<'a>,
    time_s: &mut Vec<f64>,
    columns: &mut [(Column, Kind)],
) -> Option<Sheet<'a>> {
    let mut whole: Option<Sheet<'a>> = None;
    for at in 0..columns.len() {
        let sheet = whole.as_ref().unwrap_or(sheet);
        let Some((column, kind)) = columns.get(at) else { break };
        let Some(numbers) = column.numbers().filter(|_| *kind != Kind::Reading) else { continue };
        if is_slower(numbers) {
            continue;
        }
        let lost = |row: usize| numbers.get(row).is_some_and(|x| x.is_nan());
        let Some((left, kept)) = without(sheet, &column.name, lost) else { continue };
        *time_s = rows_alone(time_s, &kept);
        for (column, _) in columns.iter_mut() {
            column.data = column.data.rows_alone(&kept);
        }
        whole = Some(left);
    }
    whole
}

/// Readings that are missing now and then.
#[derive(Debug, Default)]
pub(crate) struct Missing {
    /// Columns of sensors that lack some; by row, whether one is missing there.
    pub(crate) columns: Vec<(String, Vec<bool>)>,
    /// Remarks on them.
    pub(crate) notes: Vec<String>,
}

impl Missing {
    /// Puts straight lines in a column where it lacks readings.
    pub(crate) fn fill(&self, time_s: &[f64], column: &mut Column) {
        if let ColumnData::Numbers(numbers) = &mut column.data
            && self.columns.iter().any(|(name, _)| *name == column.name)
        {
            slower::fill(time_s, numbers);
        }
    }

    /// Missing readings of some rows alone.
    pub(crate) fn cut(self, rows: &Range<usize>) -> Self {
        let cut = |missing: Vec<bool>| missing.get(rows.clone()).unwrap_or_default().to_vec();
        Missing { columns: self.columns.into_iter().map(|(name, missing)| (name, cut(missing))).collect(), ..self }
    }
}

/// Puts straight lines where sensors that are read in every row lack readings, and says where; with them the sheet without the rows of
/// each run in which such a sensor has not been read yet, `None` where there are none.
pub(crate) fn readings<'a>(
    sheet: &Sheet<'a>,
    time_s: &mut Vec<f64>,
    columns: &mut [(Column, Kind)],
) -> (Missing, Option<Sheet<'a>>) {
    let sensors = columns.iter().filter(|(_, kind)| *kind == Kind::Reading);
    let sensors: Vec<(&str, &[f64])> = sensors.filter_map(|(c, _)| Some((c.name.as_str(), c.numbers()?))).collect();
    let place = |row: usize| format!("in line {}", sheet.lines.get(row).copied().unwrap_or(0));
    let (mut of, kept) = missing(&sheet.file, place, time_s, &sensors);
    let whole = (kept.len() < sheet.rows()).then(|| {
        *time_s = rows_alone(time_s, &kept);
        columns.iter_mut().for_each(|(column, _)| column.data = column.data.rows_alone(&kept));
        sheet.rows_alone(&kept)
    });
    for (column, _) in columns.iter_mut() {
        of.fill(time_s, column);
    }
    of.columns.retain(|(_, missing)| missing.contains(&true));
    (of, whole)
}

/// Which readings of sensors are missing, and the rows that are kept: all but those of each run in which a sensor has not been read yet.
pub(crate) fn missing(
    file: &str,
    place: impl Fn(usize) -> String,
    time_s: &[f64],
    sensors: &[(&str, &[f64])],
) -> (Missing, Vec<usize>) {
    let mut of = Missing::default();
    for (name, numbers) in sensors.iter().filter(|(_, numbers)| !is_slower(numbers)) {
        let missing: Vec<bool> = numbers.iter().map(|x| x.is_nan()).collect();
        let Some(first) = missing.iter().position(|missing| *missing).map(&place) else { continue };
        of.notes.push(match missing.iter().filter(|missing| **missing).count() {
            1 => format!(
                "{file}: 1 reading of {name} is missing ({first}); the rest of its row is used, and a straight line in its place is no \
                 evidence"
            ),
            count => format!(
                "{file}: {count} readings of {name} are missing (the first {first}); the rest of their rows is used, and straight lines in \
                 their place are no evidence"
            ),
        });
        of.columns.push(((*name).to_owned(), missing));
    }
    if of.columns.is_empty() {
        return (of, (0..time_s.len()).collect());
    }
    let lacks = |row: usize| of.columns.iter().any(|(_, missing)| missing.get(row).copied().unwrap_or(false));
    // A run in which a sensor was never read with the others begins nowhere: nothing of it is left.
    let read_from = |run: &Range<usize>| run.clone().find(|row| !lacks(*row)).unwrap_or(run.end);
    let kept: Vec<usize> = resample::runs_of(time_s).into_iter().flat_map(|run| read_from(&run)..run.end).collect();
    let left_out = time_s.len() - kept.len();
    if kept.is_empty() || left_out == 0 {
        return (of, (0..time_s.len()).collect());
    }
    of.notes.extend(left_out_before_readings(file, left_out));
    of.columns.iter_mut().for_each(|(_, missing)| *missing = rows_alone(missing, &kept));
    (of, kept)
}

/// The remark on rows that are left out before a run's readings begin; `None` where there are none.
pub(crate) fn left_out_before_readings(file: &str, rows: usize) -> Option<String> {
    let rows = match rows {
        0 => return None,
        1 => "1 row".to_owned(),
        _ => format!("{rows} rows"),
    };
    Some(format!("{file}: {rows} left out before the first reading of every sensor, where no run can begin"))
}

/// The sheet without the rows that are lost for want of a number in a column, and the rows that it keeps; `None` where none is, or all.
fn without<'a>(sheet: &Sheet<'a>, column: &str, lost: impl Fn(usize) -> bool) -> Option<(Sheet<'a>, Vec<usize>)> {
    let kept: Vec<usize> = (0..sheet.rows()).filter(|row| !lost(*row)).collect();
    let count = sheet.rows() - kept.len();
    if count == 0 || kept.is_empty() {
        return None;
    }
    let line = (0..sheet.rows()).find(|row| lost(*row)).and_then(|row| sheet.lines.get(row)).copied().unwrap_or(0);
    let mut left = sheet.rows_alone(&kept);
    let (rows, count_as) = if count == 1 {
        ("1 row has".to_owned(), "counts as lost")
    } else {
        (format!("{count} rows have"), "count as lost")
    };
    let first = if count == 1 { "in line" } else { "the first in line" };
    left.notes.push(format!("{}: {rows} no number in {column} ({first} {line}) and {count_as}", sheet.file));
    Some((left, kept))
}
