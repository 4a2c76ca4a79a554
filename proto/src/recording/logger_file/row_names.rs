//! Rows that have a name each, in front of the first column: what R writes unless it is told not to (`write.table`), counted from 1, and
//! what pandas prints (`to_string`), counted from 0.
//!
//! Every row has then one cell more than the header. That may also be a column whose name is missing, and every number would stand under
//! another name; so the first cells must count rows, and the next ones be the times that the header's first name says.

use std::borrow::Cow;

use model::rig::Decimal;

use super::logger_text::{Row, filled};
use crate::recording::csv::numbers::parse;

/// Fewer rows count by chance.
const LEAST_ROWS: usize = 3;

/// Tells whether a column of this name holds times.
pub(crate) fn is_called_a_time(name: &str) -> bool {
    let name = name.to_ascii_lowercase();
    ["time", "t", "zeit", "stamp", "elapsed", "seconds"]
        .iter()
        .any(|word| name == *word || (word.len() > 1 && name.contains(word)) || name.starts_with("t_"))
}

/// The rows without their names; `None` where they have none.
pub(crate) fn lifted<'a>(names: &[String], rows: &[Row<'a>], decimal: Decimal) -> Option<Vec<Row<'a>>> {
    let width = names.len() + 1;
    let first_name = names.first().filter(|name| !name.is_empty())?;
    let is_time = is_called_a_time(first_name);
    // The last one may be cut.
    let whole = rows.split_last().map_or(rows, |(_, before)| before);
    let number = |row: &Row<'a>, at: usize| row.1.get(at).and_then(|cell| parse(cell, decimal));
    let counts = |(row, at): (&Row<'a>, usize)| {
        let named = number(row, 0) == number(whole.first()?, 0).map(|first| first + at as f64);
        (named && filled(&row.1) <= width && row.1.len() == width).then_some(())
    };
    let all_count = whole.iter().zip(0..).all(|(row, at)| counts((row, at)).is_some());
    let from_the_first = whole.first().and_then(|row| number(row, 0)).is_some_and(|first| first == 0.0 || first == 1.0);
    let goes_on = whole.windows(2).all(|pair| match pair {
        [before, after] => number(before, 1).zip(number(after, 1)).is_some_and(|(before, after)| after > before),
        _ => true,
    });
    let has_names = is_time && whole.len() + 1 >= LEAST_ROWS && all_count && from_the_first && goes_on;
    let without = |(line, row): &Row<'a>| (*line, row.iter().skip(1).cloned().collect::<Vec<Cow<'a, str>>>());
    has_names.then(|| rows.iter().map(without).collect())
}
