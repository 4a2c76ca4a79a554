//! Rows at the end of a file that nobody wrote: arrays that were made as long as a run might last, and zeros where it ended before.
//!
//! Such rows are zero in every column, the time among them, and told by it: a time that went on is zero again. Taken for rows they would be
//! readings at the open air under commands of nothing. Without a time in the file they may be a machine at rest, and stay.

use model::rig::RecordingMap;

use crate::recording::columns::Naming;
use crate::recording::csv::numbers::parse;
use crate::recording::logger_file::sheet::{Cells, Sheet};
use crate::recording::times::places_of_time;

/// The sheet without the rows of zeros at its end; `None` where there are none, or where no column of times counts on up to them.
pub(crate) fn filled<'a>(sheet: &Sheet<'a>, map: &RecordingMap, naming: Naming) -> Option<Sheet<'a>> {
    let is_zero = |row: usize| {
        sheet.columns.iter().all(|column| match &column.cells {
            Cells::Text(texts) => texts.get(row).is_some_and(|text| parse(text, sheet.decimal) == Some(0.0)),
            Cells::Numbers(numbers) => numbers.get(row) == Some(&0.0),
        })
    };
    let left_out = (0..sheet.rows()).rev().take_while(|row| is_zero(*row)).count();
    let kept: Vec<usize> = (0..sheet.rows() - left_out).collect();
    let first = sheet.lines.get(kept.len()).filter(|_| left_out > 0 && kept.len() > 1)?;
    let mut of = sheet.rows_alone(&kept);
    let counts_on = |column: usize| {
        of.numbers(column).is_ok_and(|x| x.windows(2).all(|pair| pair[1] > pair[0]) && x.last() > Some(&0.0))
    };
    if !places_of_time(&of, map, naming).into_iter().any(counts_on) {
        return None;
    }
    let rows = if left_out == 1 { "1 row is".to_owned() } else { format!("{left_out} rows are") };
    of.notes.push(format!(
        "{}: {rows} zero in every column at the end, from line {first} on, as in arrays that were not filled; left out",
        sheet.file
    ));
    Some(of)
}
