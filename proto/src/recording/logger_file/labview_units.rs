//! Rows with a cell for each channel in the head of a LabVIEW segment: the channel that each cell of `Y_Unit_Label`, `X0`, `Delta_X` … belongs
//! to, and the units.
//!
//! LabVIEW writes the rows of a head above the names, column by column. With `X_Columns  Multi` a column of times stands before each
//! channel, the key over the first of them and a blank cell over every other one:
//!
//! ```text
//! Samples        100            100
//! Y_Unit_Label   V              kPa
//! X_Value        u     X_Value  p     Comment
//! ```
//!
//! Other programs leave these blanks out, so that the cells stand one behind another. Both are read where it is sure which of the two it
//! is: by this row itself, or by the others of its head that have a cell for each channel. Any other row is refused, since a unit at the
//! wrong channel would only scale its numbers, and a step of times only stretch them.

use std::borrow::Cow;

use super::labview::{TIME, has_times};
use super::logger_text::{Row, filled};
use crate::recording::csv::{CsvError, listed};

/// Key of the row of units.
const UNITS: &str = "Y_Unit_Label";
/// Keys of the rows with a cell for each channel.
const PER_CHANNEL: [&str; 7] = ["Samples", "Date", "Time", UNITS, "X_Dimension", "X0", "Delta_X"];
/// Last name of a segment, of a column that holds no channel.
const COMMENT: &str = "Comment";

/// The rows of a head with a cell for each channel, the last one of each key: a segment without a head of its own goes on with that of the
/// one before.
#[derive(Debug, Default)]
pub(crate) struct ChannelRows<'a> {
    rows: Vec<Row<'a>>,
}

/// An order in which cells stand behind their key.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Layout {
    /// Each in the column of its channel.
    InColumns,
    /// One behind another.
    Packed,
}

/// The columns of a segment as its names say them.
#[derive(Debug)]
pub(crate) struct Columns<'n> {
    names: Vec<&'n str>,
    /// Columns of the channels.
    pub(crate) channels: Vec<usize>,
    /// Column that the cell behind a key stands in.
    pub(crate) first: usize,
}

impl<'a> ChannelRows<'a> {
    /// Keeps a row if it is one of these.
    pub(crate) fn take(&mut self, line: u64, row: &[Cow<'a, str>]) {
        let key = key(row);
        if PER_CHANNEL.contains(&key) {
            self.rows.retain(|(_, of)| self::key(of) != key);
            self.rows.push((line, row.to_vec()));
        }
    }

    /// Units by column of these names, blank where a column has none; nothing where the head says no units.
    ///
    /// # Errors
    /// Units that may be those of other channels.
    pub(crate) fn units(&self, file: &str, names: &[Cow<'a, str>]) -> Result<Vec<Cow<'a, str>>, CsvError> {
        self.cells(file, UNITS, &Columns::of(names)).map(Option::unwrap_or_default)
    }

    /// Cells of the row of a key by column, blank where no channel stands; `None` where the head has no such row or nothing in it.
    ///
    /// # Errors
    /// Cells that may be those of other channels.
    pub(crate) fn cells(
        &self,
        file: &str,
        key: &str,
        columns: &Columns<'_>,
    ) -> Result<Option<Vec<Cow<'a, str>>>, CsvError> {
        let Some((line, row)) = self.row(key) else { return Ok(None) };
        let refused = |why: String| columns.refused(file, *line, row, why);
        let [in_columns, packed] =
            [Layout::InColumns, Layout::Packed].map(|of| columns.has_in(row, of).then(|| columns.cells_of(row, of)));
        match (in_columns, packed) {
            (Some(cells), None) => Ok(Some(cells)),
            (None, Some(cells)) if columns.has_all(row) => Ok(Some(cells)),
            (Some(cells), Some(other)) if cells == other => Ok(Some(cells)),
            (None, None) => Err(refused(columns.why_not(row))),
            (in_columns, packed) => {
                let cells = match self.layout_of_others(key, columns) {
                    Some(Layout::InColumns) => in_columns,
                    Some(Layout::Packed) => packed,
                    None => None,
                };
                let why = || refused("they may stand each above its channel or one behind another".to_owned());
                cells.ok_or_else(why).map(Some)
            }
        }
    }

    /// The row of a key, where anything stands behind it.
    pub(crate) fn row(&self, key: &str) -> Option<&Row<'a>> {
        self.rows.iter().find(|(_, row)| self::key(row) == key && filled(row) > 1)
    }

    /// The layout of the other rows, where those that tell agree.
    fn layout_of_others(&self, key: &str, columns: &Columns<'_>) -> Option<Layout> {
        let layout = |(_, row): &Row<'a>| match [Layout::InColumns, Layout::Packed].map(|of| columns.has_in(row, of)) {
            [true, false] => Some(Layout::InColumns),
            [false, true] => Some(Layout::Packed),
            _ => None,
        };
        let mut layouts = self.rows.iter().filter(|(_, row)| self::key(row) != key).filter_map(layout);
        let first = layouts.next()?;
        layouts.all(|other| other == first).then_some(first)
    }
}

fn key<'r>(row: &'r [Cow<'_, str>]) -> &'r str {
    row.first().map_or("", AsRef::as_ref)
}

impl<'n> Columns<'n> {
    pub(crate) fn of(names: &'n [Cow<'_, str>]) -> Self {
        let mut names: Vec<&str> = names.iter().take(filled(names)).map(AsRef::as_ref).collect();
        if names.last() == Some(&COMMENT) {
            names.pop();
        }
        let is_channel = |at: &usize| names.get(*at).is_some_and(|name| !name.is_empty() && *name != TIME);
        let channels = (0..names.len()).filter(is_channel).collect();
        // Where nothing stands over the times there are none, and the key stands before the first channel.
        let first = usize::from(names.first().is_some_and(|name| has_times(name)));
        Columns { names, channels, first }
    }

    /// The refusal of a row for this reason.
    pub(crate) fn refused(&self, file: &str, line: u64, row: &[Cow<'_, str>], why: String) -> CsvError {
        let (what, instead) = match key(row) {
            UNITS => (
                "units",
                "take the line out and say them in the rig file: [recording] columns.… = { from = \"…\", unit = \"…\" }",
            ),
            "Date" | "Time" => ("clocks", "write a file for each device"),
            _ => ("times", "write the file with a column of times for each channel (X_Columns Multi)"),
        };
        CsvError::ChannelCells {
            file: file.to_owned(),
            line,
            what,
            found: listed(row.iter().skip(1).map(AsRef::as_ref).filter(|cell| !cell.is_empty())),
            channels: listed(self.channels.iter().filter_map(|at| self.names.get(*at)).copied()),
            why,
            instead,
        }
    }

    /// Place in its row of the cell of the nth channel.
    fn cell_of(&self, nth: usize, layout: Layout) -> Option<usize> {
        match layout {
            Layout::InColumns => self.channels.get(nth).map(|column| column + 1 - self.first),
            Layout::Packed => Some(nth + 1),
        }
    }

    /// Cells of a row by column, blank where no channel stands.
    fn cells_of<'a>(&self, row: &[Cow<'a, str>], layout: Layout) -> Vec<Cow<'a, str>> {
        let mut cells = vec![Cow::Borrowed(""); self.channels.last().map_or(0, |last| last + 1)];
        for (nth, channel) in self.channels.iter().enumerate() {
            let cell = self.cell_of(nth, layout).and_then(|at| row.get(at));
            if let (Some(slot), Some(cell)) = (cells.get_mut(*channel), cell) {
                slot.clone_from(cell);
            }
        }
        cells
    }

    /// Tells whether a row has a cell for every channel, blank or not, and nothing besides, where cells stand like this.
    fn has_in(&self, row: &[Cow<'_, str>], layout: Layout) -> bool {
        let cells: Vec<usize> = (0..self.channels.len()).filter_map(|nth| self.cell_of(nth, layout)).collect();
        let is_filled = |at: &usize| row.get(*at).is_some_and(|cell| !cell.is_empty());
        cells.last().is_none_or(|last| *last < row.len())
            && (1..row.len()).filter(is_filled).all(|at| cells.contains(&at))
    }

    /// Tells whether the cells behind the key are filled, as many as there are channels.
    fn has_all(&self, row: &[Cow<'_, str>]) -> bool {
        row.iter().skip(1).take(self.channels.len()).all(|cell| !cell.is_empty())
    }

    /// The reason for which a row is in neither layout.
    fn why_not(&self, row: &[Cow<'_, str>]) -> String {
        let is_beside = |at: &usize| {
            let column = at - 1 + self.first;
            row.get(*at).is_some_and(|cell| !cell.is_empty()) && !self.channels.contains(&column)
        };
        match (1..row.len()).find(is_beside) {
            Some(at) => {
                let column = at - 1 + self.first;
                let holds = self.names.get(column).map_or_else(
                    || "is behind the last channel".to_owned(),
                    |name| format!("holds {}", if name.is_empty() { "no channel" } else { name }),
                );
                format!("one stands in column {}, which {holds}", column + 1)
            }
            None => {
                let has_cell = |column: &&usize| *column + 1 - self.first < row.len();
                let cells = self.channels.iter().filter(has_cell).count();
                format!("there are cells for {cells} of {} channels", self.channels.len())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Units of channels u, p and q, or the refusal, of a head with these rows.
    fn units(names: &str, rows: &[&str]) -> Result<Vec<String>, String> {
        let cells = |row: &str| row.split('\t').map(|cell| Cow::Owned(cell.to_owned())).collect::<Vec<_>>();
        let mut of = ChannelRows::default();
        rows.iter().zip(1..).for_each(|(row, line)| of.take(line, &cells(row)));
        let names = cells(names);
        let units = of.units("a.lvm", &names).map_err(|error| error.to_string())?;
        let unit = |name: &str| units.get(names.iter().position(|of| of == name).unwrap()).map(ToString::to_string);
        Ok(["u", "p", "q"].into_iter().filter_map(unit).collect())
    }

    const MULTI: &str = "X_Value\tu\tX_Value\tp\tX_Value\tq\tComment";
    const ONE: &str = "X_Value\tu\tp\tq\tComment";
    const NONE: &str = "u\tp\tq\tComment";

    #[test]
    fn each_unit_is_that_of_the_channel_it_belongs_to() {
        let apart = ["Samples\t9\t\t9\t\t9\t", "Y_Unit_Label\tV\t\t\t\tkPa\t"];
        let packed = ["Samples\t9\t9\t9\t", "Y_Unit_Label\tV\t\tkPa\t"];
        for (names, rows) in [(MULTI, apart), (MULTI, packed), (ONE, packed), (NONE, packed)] {
            assert_eq!(units(names, &rows).unwrap(), ["V", "", "kPa"], "{names:?} {rows:?}");
        }
        // A cell for each channel and one in a column of times besides can only stand one behind another.
        for names in [MULTI, ONE] {
            assert_eq!(units(names, &["Y_Unit_Label\tV\tkPa\tbar"]).unwrap(), ["V", "kPa", "bar"], "{names:?}");
        }
        // Of cells that fit both ways the others of the head tell, in a row as long as any other.
        let both = "Y_Unit_Label\tV\t\tkPa\t\t\t";
        assert_eq!(units(MULTI, &[both, "X_Dimension\tTime\t\tTime\t\tTime\t"]).unwrap(), ["V", "kPa", ""]);
        assert_eq!(units(MULTI, &[both, "X_Dimension\tTime\tTime\tTime\t\t\t"]).unwrap(), ["V", "", "kPa"]);
        assert_eq!(units(MULTI, &["Samples\t9\t\t9\t\t9"]).unwrap(), [""; 0]);
        assert_eq!(units(MULTI, &["Y_Unit_Label\t\t\t"]).unwrap(), [""; 0]);
    }

    #[test]
    fn units_that_may_be_those_of_other_channels_are_refused() {
        let samples = "Samples\t9\t\t9\t\t9\t";
        let both = "Y_Unit_Label\tV\t\tkPa\t\t\t";
        for (names, rows, why) in [
            (MULTI, vec![samples, "Y_Unit_Label\t\tV\t\tkPa\t\tkPa"], "one stands in column 3, which holds X_Value"),
            (MULTI, vec![samples, "Y_Unit_Label\tV\tkPa"], "one stands in column 3, which holds X_Value"),
            (MULTI, vec![samples, "Y_Unit_Label\tV\tkPa\t\t\t\t"], "each above its channel or one behind another"),
            (MULTI, vec![samples, "Y_Unit_Label\tV"], "there are cells for 1 of 3 channels"),
            (MULTI, vec![samples, "Y_Unit_Label\tV\t\tkPa\t\tkPa\t\tkPa"], "column 8, which is behind the last"),
            (MULTI, vec![both], "each above its channel or one behind another"),
            (ONE, vec!["Y_Unit_Label\t\tV\tkPa\tkPa"], "column 5, which is behind the last"),
            (ONE, vec!["Y_Unit_Label\tV\tkPa"], "there are cells for 2 of 3 channels"),
            (NONE, vec!["Y_Unit_Label\t\tV\tkPa\tkPa"], "column 4, which is behind the last"),
        ] {
            let said = units(names, &rows).unwrap_err();
            let line = rows.len();
            assert!(said.starts_with(&format!("a.lvm: line {line}: ")) && said.contains(why), "{rows:?}: {said}");
            assert!(said.contains("u,p,q") && said.contains("[recording]") && !said.contains('\n'), "{said}");
        }
    }
}
