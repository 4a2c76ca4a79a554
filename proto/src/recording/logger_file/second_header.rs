//! Heads that stand again among the data, as programs write them that append each session to one file.
//!
//! A head like the first is passed over. One with other names, another order of them or another unit begins a table of another kind: its
//! numbers under the names of the first would be those of other columns, so that it is refused.

use std::borrow::Cow;

use model::rig::Decimal;

use super::logger_text::{Manner, Row, cells_of, filled};
use super::sheet::is_data;
use super::table_head::{Head, is_units};
use crate::recording::columns::units::Unit;
use crate::recording::csv::{CsvError, listed};

/// The place of a row in a head that stands again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Repeated {
    /// The names.
    Names,
    /// A line above or below them: a remark, units.
    Beside,
}

/// Finds the lines of a head among the rows behind it.
#[derive(Debug)]
pub(crate) struct SecondHeader<'h, 'a> {
    head: &'h Head<'a>,
    /// Rows before the data.
    above: &'h [Row<'a>],
    decimal: Decimal,
    /// True where the row before was the head's names.
    behind_names: bool,
}

impl<'h, 'a> SecondHeader<'h, 'a> {
    pub(crate) fn new(head: &'h Head<'a>, above: &'h [Row<'a>], decimal: Decimal) -> Self {
        SecondHeader { head, above, decimal, behind_names: false }
    }

    /// The place in the head that a row repeats; `None` of a row of any other kind.
    ///
    /// # Errors
    /// Another header begins here, or the same with other units.
    pub(crate) fn repeated(&mut self, file: &str, (line, row): &Row<'_>) -> Result<Option<Repeated>, CsvError> {
        let behind_names = std::mem::take(&mut self.behind_names);
        let names = &self.head.names;
        if row.iter().map(AsRef::as_ref).eq(names.iter().map(String::as_str)) {
            self.behind_names = true;
            return Ok(Some(Repeated::Names));
        }
        let data = row.iter().filter(|cell| is_data(cell, self.decimal)).count();
        if 2 * data >= filled(row) {
            return Ok(None);
        }
        if self.above.iter().any(|(_, above)| above == row) {
            self.behind_names = behind_names;
            return Ok(Some(Repeated::Beside));
        }
        if behind_names && is_units(row) {
            let units: Vec<&str> = self.head.units.iter().map(AsRef::as_ref).collect();
            return Err(another(file, *line, row, &units));
        }
        if data == 0 && names_columns(row, names) {
            return Err(another(file, *line, row, &names.iter().map(String::as_str).collect::<Vec<_>>()));
        }
        Ok(None)
    }
}

/// Refuses comments among the data that name the columns in another way than the one above them does.
///
/// # Errors
/// The first of them.
pub(crate) fn check_comments(
    file: &str,
    head: &Head<'_>,
    comments: &[(u64, &str)],
    manner: &Manner,
) -> Result<(), CsvError> {
    let names: Vec<&str> = head.names.iter().map(String::as_str).collect();
    for (line, text) in comments {
        let row: Vec<Cow<'_, str>> = cells_of(text, manner.separator).into_iter().map(Cow::Borrowed).collect();
        let has_data = row.iter().any(|cell| is_data(cell, manner.decimal));
        if !has_data && !row.iter().map(AsRef::as_ref).eq(names.iter().copied()) && names_columns(&row, &head.names) {
            return Err(another(file, *line, &row, &names));
        }
    }
    Ok(())
}

/// Tells whether cells name the columns that others name: half of them and more, in whatever order and unit.
fn names_columns(row: &[Cow<'_, str>], names: &[String]) -> bool {
    fn name(title: &str) -> &str {
        Unit::in_name(title).map_or(title, |(name, _)| name)
    }
    let is_known = |cell: &&Cow<'_, str>| {
        !cell.is_empty() && names.iter().any(|known| name(known).eq_ignore_ascii_case(name(cell)))
    };
    let known = row.iter().filter(is_known).count();
    known > 1 && 2 * known >= filled(row).max(names.len())
}

/// The error of a head, with the cells in which it differs; with all of them where it has more or fewer.
pub(crate) fn another(file: &str, line: u64, row: &[Cow<'_, str>], first: &[&str]) -> CsvError {
    let alike = row.len() == first.len();
    let differ = |at: usize| !alike || row.get(at).map(AsRef::as_ref) != first.get(at).copied();
    let of = |cells: &mut dyn Iterator<Item = &str>| {
        listed(cells.enumerate().filter(|(at, _)| differ(*at)).map(|(_, cell)| cell))
    };
    CsvError::AnotherHeader {
        file: file.to_owned(),
        line,
        found: of(&mut row.iter().map(AsRef::as_ref)),
        expected: if first.is_empty() { "no units".to_owned() } else { of(&mut first.iter().copied()) },
    }
}
