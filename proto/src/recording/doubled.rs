//! Rows that stand twice: a logger that flushes its buffer again, files that were joined with an overlap of a row.
//!
//! A row that is the one before it in every cell says nothing new and is passed over, and told. Where nothing in the file counts
//! on from row to row, alike rows are readings that did not move, and stay.

use super::sheet::{Cells, Sheet};

/// Rows from which on it can be seen that a column counts on.
const LEAST_ROWS: usize = 3;

/// The sheet without rows that repeat the row before them, where there are such rows and some column goes forward without them.
pub(super) fn once<'a>(sheet: &Sheet<'a>) -> Option<Sheet<'a>> {
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

fn is_alike(cells: &Cells<'_>, row: usize) -> bool {
    match cells {
        Cells::Text(texts) => texts.get(row) == texts.get(row - 1),
        // A cell without a number is like another one.
        Cells::Numbers(numbers) => numbers.get(row).map(|x| x.to_bits()) == numbers.get(row - 1).map(|x| x.to_bits()),
    }
}
