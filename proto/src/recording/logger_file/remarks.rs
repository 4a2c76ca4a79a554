//! Text that somebody put beside the data: a line by itself, a word behind a row's last column, a column of notes that most rows do not have.
//!
//! None of it is data, and none of it makes a row of data worth less: lines are passed over, words left out, and both are told with
//! their first line. What may be a column that the header lacks (a number, or text in many rows) is no remark: it would put every number
//! behind it under another name.

use std::borrow::Cow;

use model::rig::Decimal;

use super::logger_text::{Row, filled, usual};
use super::sheet::is_data;
use crate::recording::csv::numbers::says_nothing;

/// One row of so many at most has text behind its last column.
const NOTED: usize = 10;

/// Tells remarks from data in the rows of one table.
pub(crate) struct Remarks {
    width: usize,
    least: usize,
    decimal: Decimal,
    /// True where rows of data begin with a number or a time.
    begin_with_data: bool,
    /// True where text behind the last column is a remark.
    noted: bool,
}

impl Remarks {
    /// Finds the remarks of rows below a header with these names, of which `width` are columns.
    pub(crate) fn of(rows: &[Row<'_>], names: &[String], width: usize, decimal: Decimal) -> Self {
        let is_text = |cells: Option<&[Cow<'_, str>]>| {
            cells.is_some_and(|cells| cells.iter().all(|cell| !is_data(cell, decimal)))
        };
        let noted = rows.iter().filter(|(_, row)| filled(row) > width).count();
        let all_text = rows.iter().filter(|(_, row)| filled(row) > width).all(|(_, row)| is_text(row.get(width..)));
        // A comment that rows may have and need not, or columns that only rows with text in them have.
        let spare = names
            .get(width.wrapping_sub(1))
            .is_some_and(|name| name.is_empty() || name.eq_ignore_ascii_case("comment"));
        let most = usual(rows.iter().map(|(_, row)| row.len()));
        let mut longer = rows.iter().filter(|(_, row)| row.len() > most).peekable();
        let only_notes = longer.peek().is_some() && longer.all(|(_, row)| is_text(row.get(most..)));
        let least = if most < width && only_notes { most } else { width - usize::from(spare) };
        let begins = |row: &[Cow<'_, str>]| row.first().is_some_and(|cell| !cell.is_empty() && is_data(cell, decimal));
        Remarks {
            width,
            least,
            decimal,
            begin_with_data: rows.first().is_some_and(|(_, first)| begins(first)),
            noted: all_text && NOTED * noted <= rows.len(),
        }
    }

    /// Cells that a row has at least.
    pub(crate) fn least_cells(&self) -> usize {
        self.least
    }

    /// The text of a line that is no row: it has fewer cells than the others and begins with text where they begin with a number or a
    /// time, or nothing but text stands behind its time, or nothing but text in it at all.
    pub(crate) fn line<'r>(&self, row: &'r [Cow<'_, str>]) -> Option<&'r str> {
        if !self.begin_with_data {
            return None;
        }
        let data = |cell: &Cow<'_, str>| is_data(cell, self.decimal);
        let is_short = filled(row) < self.width;
        let (first, rest) = row.split_first()?;
        if is_short && !first.is_empty() && !data(first) {
            return Some(first);
        }
        let mut said = rest.iter().filter(|cell| !cell.is_empty());
        let text = said.clone().next()?;
        let all_text = said.all(|cell| !data(cell) && !says_nothing(cell));
        let beside_time = is_short && row.len() < self.least && data(first);
        (all_text && (beside_time || first.is_empty())).then_some(text.as_ref())
    }

    /// The text behind a row's last column, where that is a remark.
    pub(crate) fn behind<'r>(&self, row: &'r [Cow<'_, str>]) -> Option<&'r str> {
        let behind = row.get(self.width..)?.iter().find(|cell| !cell.is_empty());
        behind.filter(|_| self.noted).map(AsRef::as_ref)
    }
}

/// `1 line`, `2 lines`.
pub(crate) fn counted(number: usize, what: &str) -> String {
    format!("{number} {what}{}", if number == 1 { "" } else { "s" })
}

/// Takes a zero byte off the end of a cell: programs in C write the one that ends a text with it.
pub(super) fn strip_zero(cell: &mut Cow<'_, str>) {
    match cell {
        Cow::Borrowed(text) => *text = text.strip_suffix('\0').map_or(*text, str::trim_end),
        Cow::Owned(text) => {
            let kept = text.strip_suffix('\0').map_or(text.len(), |text| text.trim_end().len());
            text.truncate(kept);
        }
    }
}

/// Remark on lines with zero bytes together in them, which stand where a card or a disk lost power while a file grew.
pub(crate) fn zero_bytes(file: &str, lines: &[u64]) -> Option<String> {
    let first = lines.first()?;
    Some(format!(
        "{file}: {} with zero bytes, as a disk that lost power leaves them, left out, the first line {first}",
        counted(lines.len(), "line")
    ))
}

/// Remark on lines of text below a table: notes, means of the columns.
pub(crate) fn behind_the_data(file: &str, lines: usize, from: u64) -> String {
    format!("{file}: {} of text behind the data, from line {from} on", counted(lines, "line"))
}
