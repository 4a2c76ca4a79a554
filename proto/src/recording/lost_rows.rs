//! Rows that lack a number which is needed: a logger that had nothing for one row, and wrote nothing, `NaN` or `---`.
//!
//! Such a row is a lost one, as if it were not in the file: a hole that is bridged where it is short and a gap where it is long, and
//! told as that. Which cells and how many is told besides, for whoever looks for the rows.

use super::csv::{Column, rows_alone};
use super::resample::Kind;
use super::sheet::Sheet;
use super::slower::now_and_then_blank;

/// The sheet without rows that have no time; `None` where all have one.
pub(super) fn timed<'a>(sheet: &Sheet<'a>, of_time: &[usize]) -> Option<Sheet<'a>> {
    let blank: Vec<Vec<bool>> = of_time.iter().map(|column| now_and_then_blank(sheet, *column)).collect();
    let lost = |row: usize| blank.iter().any(|blank| blank.get(row).copied().unwrap_or(false));
    let title = of_time.first().and_then(|at| sheet.columns.get(*at)).map_or("", |column| column.title.as_str());
    without(sheet, title, lost).map(|(sheet, _)| sheet)
}

/// The sheet, times and columns without rows in which a column has no number, `slower` ones aside that have none in many rows.
pub(super) fn numbered<'a>(
    sheet: &Sheet<'a>,
    time_s: &mut Vec<f64>,
    columns: &mut [(Column, Kind)],
) -> Option<Sheet<'a>> {
    let mut whole: Option<Sheet<'a>> = None;
    for at in 0..columns.len() {
        let sheet = whole.as_ref().unwrap_or(sheet);
        let Some((column, _)) = columns.get(at) else { break };
        let Some(numbers) = column.numbers() else { continue };
        if super::slower::is_slower(numbers) {
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
