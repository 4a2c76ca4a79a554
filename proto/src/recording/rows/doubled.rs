//! Rows that stand twice: a logger that flushes its buffer again or sends it again, files that were joined with an overlap.
//!
//! A row that is the one before it in every cell says nothing new and is passed over, and told. So is one that stands anywhere before, in
//! a file with a column of times that goes on without such rows, as long as they are no more than half: without a time a row that was
//! there before is a machine that came back to where it was. Where nothing in the file counts on from row to row, alike rows are
//! readings that did not move, and stay. A row now and then that has the time of the row before it and other readings is passed over as well.

use std::collections::HashMap;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};

use model::rig::RecordingMap;

use crate::recording::columns::Naming;
use crate::recording::logger_file::sheet::{Cells, Sheet};
use crate::recording::times::places_of_time;

/// Rows from which on it can be seen that a column counts on.
const LEAST_ROWS: usize = 3;

/// One row of so many at most may have the time of the row before: more of them are times that were rounded.
const RARELY: usize = 100;

/// The sheet without rows that repeat the row before them, where there are such rows and some column goes forward without them; or
/// without rows that repeat any before, where a column of times does.
pub(crate) fn once<'a>(sheet: &Sheet<'a>, map: &RecordingMap, naming: Naming) -> Option<Sheet<'a>> {
    let next_to: Vec<usize> = (1..sheet.rows()).filter(|row| is_row(sheet, *row, row - 1)).collect();
    let any_column = |of: &Sheet<'_>| (0..of.columns.len()).collect();
    let of_time = |of: &Sheet<'_>| places_of_time(of, map, naming);
    let (mut of, repeated, before) = match without(sheet, &next_to, any_column) {
        Some(of) => (of, next_to, "the row before"),
        None => {
            let repeated = again(sheet);
            let few = repeated.len() <= sheet.rows() / 2;
            (few.then(|| without(sheet, &repeated, of_time)).flatten()?, repeated, "a row above")
        }
    };
    let line = repeated.first().and_then(|row| sheet.lines.get(*row)).copied().unwrap_or(0);
    let rows = if repeated.len() == 1 { "1 row is".to_owned() } else { format!("{} rows are", repeated.len()) };
    of.notes.push(format!("{}: {rows} {before} in every cell, the first in line {line}; passed over", sheet.file));
    Some(of)
}

/// The sheet without these rows, where there are any and one of the columns that are asked goes forward without them.
fn without<'a>(sheet: &Sheet<'a>, repeated: &[usize], asked: impl Fn(&Sheet<'a>) -> Vec<usize>) -> Option<Sheet<'a>> {
    let kept: Vec<usize> = (0..sheet.rows()).filter(|row| repeated.binary_search(row).is_err()).collect();
    if repeated.is_empty() || kept.len() < LEAST_ROWS {
        return None;
    }
    let of = sheet.rows_alone(&kept);
    let goes_on = |column: usize| of.times(column).is_ok_and(|times| times.windows(2).all(|pair| pair[1] > pair[0]));
    asked(&of).into_iter().any(goes_on).then_some(of)
}

/// Rows that stand in the sheet before, in their order.
fn again(sheet: &Sheet<'_>) -> Vec<usize> {
    let mut first: HashMap<u64, usize> = HashMap::with_capacity(sheet.rows());
    let stands = |row: &usize| {
        let earlier = *first.entry(mark(sheet, *row)).or_insert(*row);
        earlier < *row && is_row(sheet, *row, earlier)
    };
    (0..sheet.rows()).filter(stands).collect()
}

/// A number that rows alike in every cell have in common.
fn mark(sheet: &Sheet<'_>, row: usize) -> u64 {
    let mut hasher = DefaultHasher::new();
    for column in &sheet.columns {
        match &column.cells {
            Cells::Text(texts) => texts.get(row).hash(&mut hasher),
            Cells::Numbers(numbers) => numbers.get(row).map(|x| x.to_bits()).hash(&mut hasher),
        }
    }
    hasher.finish()
}

/// Tells whether a row is another one in every cell.
fn is_row(sheet: &Sheet<'_>, row: usize, other: usize) -> bool {
    sheet.columns.iter().all(|column| is_alike(&column.cells, row, other))
}

/// The sheet without rows that have the time of the row before and other readings, as a logger writes them that was asked twice: which of
/// two was read then nobody knows, and the first stays. `None` where there is none, or where times are too coarse to tell rows apart.
pub(crate) fn at_one_time<'a>(sheet: &Sheet<'a>, of_time: &[usize]) -> Option<Sheet<'a>> {
    let times: Vec<&Cells<'_>> =
        of_time.iter().filter_map(|at| sheet.columns.get(*at)).map(|column| &column.cells).collect();
    let repeats =
        |row: &usize| *row > 0 && !times.is_empty() && times.iter().all(|cells| is_alike(cells, *row, row - 1));
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

fn is_alike(cells: &Cells<'_>, row: usize, other: usize) -> bool {
    match cells {
        Cells::Text(texts) => texts.get(row) == texts.get(other),
        // A cell without a number is like another one.
        Cells::Numbers(numbers) => numbers.get(row).map(|x| x.to_bits()) == numbers.get(other).map(|x| x.to_bits()),
    }
}
