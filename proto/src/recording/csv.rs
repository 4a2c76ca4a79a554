//! A CSV table of numbers with a header line, read with an eye on where it is wrong.
//!
//! Format: UTF-8 (a byte-order mark is skipped), comma-separated, LF or CRLF, one header line of
//! column names, then one row per line; cells may be quoted and padded with blanks; blank lines
//! are skipped. Columns are found by name, so their order is free. `time_s` is required and comes
//! first in what we write.
//!
//! A column holds numbers, unless its name is unknown to the caller and its first cell is no
//! number: then it is a text column (an operator's notes, a state's name) and is kept as text.
//! Known columns must be finite numbers in every row. So must unknown ones that begin with a
//! number: a typing error in row 900 is an error there, not a column that silently became text.
//!
//! Numbers are written in the shortest form that reads back to the same `f64` bit for bit.
//!
//! Left out: separators other than the comma (the error says so), decimal commas, comments. What loggers write is read by
//! [`Recording::read_for`](super::Recording::read_for).

pub(crate) mod cells;
mod csv_error;
pub(crate) mod numbers;

use std::borrow::Cow;
use std::collections::HashSet;

use self::cells::{Broken, Rows};

pub use self::csv_error::CsvError;

/// The column of times in every table.
pub const TIME_COLUMN: &str = "time_s";

/// Content of one column.
#[derive(Debug, Clone, PartialEq)]
pub enum ColumnData {
    /// A finite number per row.
    Numbers(Vec<f64>),
    /// A text per row, as it stood in the file.
    Text(Vec<String>),
}

/// Cells of these rows alone.
pub(super) fn rows_alone<T: Clone>(all: &[T], rows: &[usize]) -> Vec<T> {
    rows.iter().filter_map(|row| all.get(*row)).cloned().collect()
}

impl ColumnData {
    /// The cells of these rows alone.
    pub(super) fn rows_alone(&self, rows: &[usize]) -> Self {
        match self {
            ColumnData::Numbers(numbers) => ColumnData::Numbers(rows_alone(numbers, rows)),
            ColumnData::Text(texts) => ColumnData::Text(rows_alone(texts, rows)),
        }
    }

    /// The cells of some rows; fewer where there are no more.
    pub(super) fn cut(&self, rows: &std::ops::Range<usize>) -> Self {
        match self {
            ColumnData::Numbers(numbers) => ColumnData::Numbers(numbers.get(rows.clone()).unwrap_or_default().to_vec()),
            ColumnData::Text(texts) => ColumnData::Text(texts.get(rows.clone()).unwrap_or_default().to_vec()),
        }
    }
}

/// One named column.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// The header's name of it.
    pub name: String,
    /// Cells, one per row.
    pub data: ColumnData,
}

impl Column {
    /// Numbers; `None` where it holds text.
    pub(super) fn numbers(&self) -> Option<&[f64]> {
        match &self.data {
            ColumnData::Numbers(numbers) => Some(numbers),
            ColumnData::Text(_) => None,
        }
    }
}

/// A parsed table: times and the other columns in the file's order.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// The `time_s` column (s).
    pub time_s: Vec<f64>,
    /// Every other column.
    pub columns: Vec<Column>,
    /// Line of each row in the file, from 1.
    pub lines: Vec<u64>,
    /// Position of `time_s` among the file's columns, from 1.
    pub time_position: usize,
}

impl Table {
    /// Parses CSV bytes; `file` is the name that errors carry, `numeric` the columns that must
    /// hold numbers when they are there.
    ///
    /// Times must be finite; whether they go forward is for the caller to say.
    ///
    /// # Errors
    /// [`CsvError`] with line and column: empty file, no rows, wrong or missing header, names
    /// twice, ragged rows, NaN, infinities, text in a column of numbers, bytes that are not UTF-8.
    pub fn parse(file: &str, bytes: &[u8], numeric: &[&str]) -> Result<Self, CsvError> {
        let bytes = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
        let mut rows = Rows::new(bytes);
        let mut row = Vec::new();
        let (header_line, names) = match next_row(file, &mut rows, &mut row)? {
            Some(line) => (line, header(file, line, &row)?),
            None => return Err(CsvError::Empty { file: file.to_owned() }),
        };
        let Some(time_index) = names.iter().position(|name| name == TIME_COLUMN) else {
            return Err(CsvError::MissingColumn {
                file: file.to_owned(),
                line: Some(header_line),
                column: TIME_COLUMN.to_owned(),
                found: listed(names.iter().map(String::as_str)),
            });
        };

        let mut lines = Vec::new();
        let mut data: Vec<ColumnData> = Vec::new();
        while let Some(line) = next_row(file, &mut rows, &mut row)? {
            if row.len() != names.len() {
                return Err(ragged(file, line, &row, names.len()));
            }
            for (index, (cell, name)) in row.iter().zip(&names).enumerate() {
                let place = Place { file, line, position: index + 1, column: name };
                let text = place.text(cell)?;
                if lines.is_empty() {
                    let must = name == TIME_COLUMN || numeric.contains(&name.as_str());
                    data.push(first_cell(&place, text, must)?);
                    continue;
                }
                match data.get_mut(index) {
                    Some(ColumnData::Numbers(numbers)) => numbers.push(place.number(text)?),
                    Some(ColumnData::Text(texts)) => texts.push(text.to_owned()),
                    None => {}
                }
            }
            lines.push(line);
        }
        if lines.is_empty() {
            return Err(CsvError::NoRows { file: file.to_owned() });
        }
        let mut time_s = Vec::new();
        let mut columns = Vec::with_capacity(names.len().saturating_sub(1));
        for (index, (name, data)) in names.into_iter().zip(data).enumerate() {
            match data {
                ColumnData::Numbers(numbers) if index == time_index => time_s = numbers,
                data => columns.push(Column { name, data }),
            }
        }
        Ok(Self { time_s, columns, lines, time_position: time_index + 1 })
    }

    /// The numbers of a column; `None` when it is absent or holds text.
    pub fn numbers(&self, name: &str) -> Option<&[f64]> {
        self.columns.iter().find(|column| column.name == name).and_then(|column| match &column.data {
            ColumnData::Numbers(numbers) => Some(numbers.as_slice()),
            ColumnData::Text(_) => None,
        })
    }

    /// Position of a column in the file, from 1; `None` when it is absent.
    pub fn position(&self, name: &str) -> Option<usize> {
        if name == TIME_COLUMN {
            return Some(self.time_position);
        }
        let index = self.columns.iter().position(|column| column.name == name)?;
        // `columns` leaves time_s out, so those behind it stand one further right in the file.
        Some(if index + 1 < self.time_position { index + 1 } else { index + 2 })
    }
}

/// Writes a table as CSV text: `time_s` first, LF line ends, numbers that read back bit for bit.
pub fn to_csv(time_s: &[f64], columns: &[Column]) -> String {
    let mut out = String::with_capacity((columns.len() + 1) * (time_s.len() + 1) * 12);
    out.push_str(TIME_COLUMN);
    for column in columns {
        out.push(',');
        push_text(&mut out, &column.name);
    }
    out.push('\n');
    for (row, time) in time_s.iter().enumerate() {
        push_number(&mut out, *time);
        for column in columns {
            out.push(',');
            match &column.data {
                ColumnData::Numbers(numbers) => {
                    push_number(&mut out, numbers.get(row).copied().unwrap_or(f64::NAN));
                }
                ColumnData::Text(texts) => {
                    push_text(&mut out, texts.get(row).map_or("", String::as_str));
                }
            }
        }
        out.push('\n');
    }
    out
}

/// Where a cell stands.
struct Place<'a> {
    file: &'a str,
    line: u64,
    position: usize,
    column: &'a str,
}

impl Place<'_> {
    fn text<'c>(&self, cell: &'c [u8]) -> Result<&'c str, CsvError> {
        std::str::from_utf8(cell).map_err(|_| CsvError::NotUtf8 {
            file: self.file.to_owned(),
            line: self.line,
            position: self.position,
        })
    }

    fn number(&self, cell: &str) -> Result<f64, CsvError> {
        match cell.parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(number),
            Ok(_) => Err(CsvError::NotFinite {
                file: self.file.to_owned(),
                line: self.line,
                position: self.position,
                column: self.column.to_owned(),
                cell: shown(cell),
            }),
            Err(_) => Err(CsvError::NotANumber {
                file: self.file.to_owned(),
                line: self.line,
                position: self.position,
                column: self.column.to_owned(),
                cell: shown(cell),
            }),
        }
    }
}

/// The first cell of a column decides what the column holds.
fn first_cell(place: &Place<'_>, text: &str, must: bool) -> Result<ColumnData, CsvError> {
    match place.number(text) {
        Ok(number) => Ok(ColumnData::Numbers(vec![number])),
        Err(CsvError::NotANumber { .. }) if !must => Ok(ColumnData::Text(vec![text.to_owned()])),
        Err(error) => Err(error),
    }
}

fn header(file: &str, line: u64, row: &[Cow<'_, [u8]>]) -> Result<Vec<String>, CsvError> {
    let mut names: Vec<String> = Vec::with_capacity(row.len());
    let mut seen = HashSet::new();
    for (index, cell) in row.iter().enumerate() {
        let position = index + 1;
        let place = Place { file, line, position, column: "" };
        let name = place.text(cell)?;
        if row.len() == 1 {
            let separator = match name {
                _ if name.contains(';') => Some("semicolons"),
                _ if name.contains('\t') => Some("tabs"),
                _ => None,
            };
            if let Some(separator) = separator {
                return Err(CsvError::Separator { file: file.to_owned(), line, separator });
            }
        }
        if name.parse::<f64>().is_ok() {
            return Err(CsvError::NoHeader { file: file.to_owned(), line, cell: shown(name), mend: "" });
        }
        if name.is_empty() {
            return Err(CsvError::UnnamedColumn { file: file.to_owned(), line, position });
        }
        if !seen.insert(name) {
            let column = shown(name);
            return Err(CsvError::DuplicateColumn {
                file: file.to_owned(),
                line,
                position,
                column,
                mend: String::new(),
            });
        }
        names.push(name.to_owned());
    }
    Ok(names)
}

/// Hint for a row of whole numbers that may be the halves of numbers with decimal commas, or a row of more columns.
pub(super) const MAY_BE_HALVES: &str = "; where these are halves of numbers with decimal commas, write points";

/// The error of a row of so many cells too few or too many.
pub(super) fn ragged<C: AsRef<[u8]>>(file: &str, line: u64, row: &[C], expected: usize) -> CsvError {
    let is_whole = |cell: &C| {
        let digits = cell.as_ref().trim_ascii();
        let digits = digits.strip_prefix(b"-").unwrap_or(digits);
        !digits.is_empty() && digits.iter().all(u8::is_ascii_digit)
    };
    // Two cells of each number with a comma in it, one of each that is whole.
    let are_halves = row.len() > expected && row.len() <= 2 * expected && row.iter().all(is_whole);
    let hint = match row {
        [only] if only.as_ref().contains(&b';') => "; separate cells by commas",
        row if expected > 1 && row.len() == 2 * expected => "; write numbers with a point, not a comma",
        _ if are_halves => MAY_BE_HALVES,
        _ => "",
    };
    CsvError::Ragged { file: file.to_owned(), line, found: row.len(), expected, hint: hint.to_owned() }
}

fn next_row<'a>(file: &str, rows: &mut Rows<'a>, row: &mut Vec<Cow<'a, [u8]>>) -> Result<Option<u64>, CsvError> {
    rows.next_row(row).map_err(|Broken { line, position, open }| {
        let file = file.to_owned();
        if open {
            CsvError::OpenQuote { file, line, position }
        } else {
            CsvError::TextAfterQuote { file, line, position }
        }
    })
}

/// Names of columns for an error, cut where they would run on.
pub(crate) fn listed<'a>(names: impl Iterator<Item = &'a str>) -> String {
    const MOST: usize = 16;
    let names: Vec<String> = names.take(MOST + 1).map(shown).collect();
    match names.get(..MOST) {
        Some(head) if names.len() > MOST => format!("{}, …", head.join(",")),
        _ => names.join(","),
    }
}

/// A cell short enough for one line of an error.
pub(crate) fn shown(cell: &str) -> String {
    const MOST: usize = 40;
    if cell.chars().count() <= MOST {
        return escaped(cell);
    }
    let head: String = cell.chars().take(MOST).collect();
    format!("{}…", escaped(&head))
}

/// A name as a string of TOML, to be pasted into a rig file.
pub(crate) fn toml_text(name: &str) -> String {
    format!("\"{}\"", escaped(name))
}

/// A text on one line, in which nothing is escaped that TOML would not have escaped: an apostrophe stays as it is.
fn escaped(text: &str) -> String {
    let letter = |c: char| match c {
        '\'' => "'".to_owned(),
        '"' | '\\' | '\t' | '\n' | '\r' => c.escape_default().to_string(),
        c if c.escape_debug().len() > 1 => format!("\\U{:08X}", u32::from(c)),
        c => c.to_string(),
    };
    text.chars().map(letter).collect()
}

fn push_number(out: &mut String, number: f64) {
    use std::fmt::Write;
    // Writing to a String cannot fail. `{:?}` is the shortest text that parses back to the same
    // bits and switches to an exponent where plain digits would run to hundreds.
    let _ = if number == number.trunc() && number.abs() < 1e15 {
        write!(out, "{number}")
    } else {
        write!(out, "{number:?}")
    };
}

fn push_text(out: &mut String, text: &str) {
    if text.contains(['"', ',', '\n', '\r']) || text.trim() != text {
        out.push('"');
        out.push_str(&text.replace('"', "\"\""));
        out.push('"');
    } else {
        out.push_str(text);
    }
}
