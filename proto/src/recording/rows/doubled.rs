//! Rows that stand twice: a logger that flushes its buffer again, files that were joined with an overlap of a row.
//!
//! A row that is the one before it in every cell says nothing new and is passed over, and told. Where nothing in the file counts
//! on from row to row, alike rows are readings that did not move, and stay. A row now and then that has the time of the row before it and
//! other readings is passed over as well.

use crate::recording::logger_file::sheet::{Cells, Sheet};

/// Rows from which on it can be seen that a column counts on.
const LEAST_ROWS: usize = 3;

/// One row of so many at most may have the time of the row before: more of them are times that were rounded.
const RARELY: usize = 100;

/// The sheet without rows that repeat the row before them, where there are such rows and some column goes forward without them.
pub(crate) fn once<'a>(sheet: &Sheet<'a>) -> Option<Sheet<'a>> {
    let repeats = |row: usize| row > 0 && sheet.columns.iter().all(|column| is_alike(&column.cells, row));
    let kept: Vec<usize> = (0..sheet.rows()).filter(|row| !repeats(*row)).collect();
    if kept.len() == sheet.rows() || kept.len() < LEAST_ROWS {
        return None;
    }
    let mut of = sheet.rows_alone(&kept);
    let goes_on = |column: usize| of.times(column).is_ok_and(|times| times.windows(2).all(|pair| pair[1] > pair[0]));
    if !(0..of.columns.len()).any(goes_on) {
        return None;
    }
    let first = (0..sheet.rows()).find(|row| repeats(*row)).and_then(|row| sheet.lines.get(row)).copied().unwrap_or(0);
    let count = sheet.rows() - kept.len();
    let rows = if count == 1 { "1 row is".to_owned() } else { format!("{count} rows are") };
    of.notes
        .push(format!("{}: {rows} the row before in every cell, the first in line {first}; passed over", sheet.file));
    Some(of)
}

/// The sheet without rows that have the time of the row before and other readings, as a logger writes them that was asked twice: which of
/// two was read then nobody knows, and the first stays. `None` where there is none, or where times are too coarse to tell rows apart.
pub(crate) fn at_one_time<'a>(sheet: &Sheet<'a>, of_time: &[usize]) -> Option<Sheet<'a>> {
    let times: Vec<&Cells<'_>> =
        of_time.iter().filter_map(|at| sheet.columns.get(*at)).map(|column| &column.cells).collect();
    let repeats = |row: &usize| *row > 0 && !times.is_empty() && times.iter().all(|cells| is_alike(cells, *row));
    let (repeated, kept): (Vec<usize>, Vec<usize>) = (0..sheet.rows()).partition(repeats);
    let line = repeated.first().and_then(|row| sheet.lines.get(*row))?;
    if RARELY * repeated.len() > sheet.rows() {
        return None;
    }
    let mut of = sheet.rows_alone(&kept);
    let rows = if repeated.len() == 1 { "1 row has".to_owned() } else { format!("{} rows have", repeated.len()) };
    of.notes.push(format!(
        "{}: {rows} the time of the row before and other cells, the first in line {line}; passed over",
        sheet.file
    ));
    Some(of)
}

fn is_alike(cells: &Cells<'_>, row: usize) -> bool {
    match cells {
        Cells::Text(texts) => texts.get(row) == texts.get(row - 1),
        // A cell without a number is like another one.
        Cells::Numbers(numbers) => numbers.get(row).map(|x| x.to_bits()) == numbers.get(row - 1).map(|x| x.to_bits()),
    }
}
