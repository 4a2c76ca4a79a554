//! A file of another program as a sheet: named columns of cells, before anyone asks what they mean.
//!
//! Nothing is parsed that nobody asks for: a column of notes, of NaN or of another language is no matter as long as no rig
//! wants it. What is asked for must be a finite number in every row, and an error names line and column.

use std::borrow::Cow;

use model::rig::Decimal;

use super::csv::CsvError;
use super::numbers::parse;
use super::timestamps;
use super::units::Unit;

/// Cells of one column, by row.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Cells<'a> {
    /// As they stand in a text file.
    Text(Vec<Cow<'a, str>>),
    /// From a file of numbers.
    Numbers(Vec<f64>),
}

/// One column.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct SheetColumn<'a> {
    /// Its name, without a unit in brackets.
    pub(super) name: String,
    /// Its name as it stands in the file.
    pub(super) title: String,
    /// Its unit as the file writes it.
    pub(super) unit: Option<String>,
    /// Its cells.
    pub(super) cells: Cells<'a>,
}

/// A file's columns.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Sheet<'a> {
    /// The file's name, for errors.
    pub(super) file: String,
    /// Line of the names, from 1; `None` where there is none.
    pub(super) header_line: Option<u64>,
    /// Columns in the file's order.
    pub(super) columns: Vec<SheetColumn<'a>>,
    /// Line of each row, from 1.
    pub(super) lines: Vec<u64>,
    /// Mark in the file's numbers.
    pub(super) decimal: Decimal,
    /// What was found out about the file that is not plain CSV, in words.
    pub(super) manner: Vec<String>,
    /// What a person should know besides, a line each.
    pub(super) notes: Vec<String>,
}

impl<'a> SheetColumn<'a> {
    /// A column, its unit taken out of brackets behind its name.
    pub(super) fn new(title: &str, cells: Cells<'a>) -> Self {
        let (name, unit) = match Unit::in_name(title) {
            Some((name, unit)) => (name, Some(unit.to_owned())),
            None => (title, None),
        };
        SheetColumn { name: name.to_owned(), title: title.to_owned(), unit, cells }
    }
}

impl Sheet<'_> {
    /// Rows of data.
    pub(super) fn rows(&self) -> usize {
        self.lines.len()
    }

    /// Place of a column from 0, by its name with or without the unit in brackets; `None` where there is none.
    ///
    /// # Errors
    /// Two columns have this name.
    pub(super) fn find(&self, name: &str) -> Result<Option<usize>, CsvError> {
        let named = |exact: bool| {
            let same = move |column: &&SheetColumn<'_>| if exact { column.title == name } else { column.name == name };
            let mut those = self.columns.iter().enumerate().filter(move |(_, column)| same(column)).map(|(at, _)| at);
            (those.next(), those.next())
        };
        let (first, second) = match named(true) {
            (None, _) => named(false),
            found => found,
        };
        match second {
            Some(at) => Err(CsvError::DuplicateColumn {
                file: self.file.clone(),
                line: self.header_line.unwrap_or(1),
                position: at + 1,
                column: name.to_owned(),
            }),
            None => Ok(first),
        }
    }

    /// Names for an error.
    pub(super) fn listed(&self) -> String {
        super::csv::listed(self.columns.iter().map(|column| column.title.as_str()))
    }

    /// Whether the first cells of a column are dates or times of day.
    pub(super) fn is_timestamped(&self, column: usize) -> bool {
        self.first_text(column).is_some_and(timestamps::is_timestamp)
    }

    /// Whether the first cells of a column are dates without a time of day.
    pub(super) fn is_date_alone(&self, column: usize) -> bool {
        self.first_text(column).is_some_and(timestamps::is_date_alone)
    }

    /// Whether the first cells of a column are times of day without a date.
    pub(super) fn is_clock_alone(&self, column: usize) -> bool {
        self.first_text(column).is_some_and(timestamps::is_clock_alone)
    }

    fn first_text(&self, column: usize) -> Option<&str> {
        match self.columns.get(column).map(|column| &column.cells) {
            Some(Cells::Text(texts)) => texts.first().map(AsRef::as_ref),
            _ => None,
        }
    }

    /// The numbers of a column.
    ///
    /// # Errors
    /// The first cell that is no finite number, with line and column.
    pub(super) fn numbers(&self, column: usize) -> Result<Vec<f64>, CsvError> {
        let Some(of) = self.columns.get(column) else { return Ok(Vec::new()) };
        match &of.cells {
            Cells::Numbers(numbers) => numbers
                .iter()
                .enumerate()
                .map(|(row, number)| {
                    if number.is_finite() {
                        Ok(*number)
                    } else {
                        Err(self.not_finite(column, row, &number.to_string()))
                    }
                })
                .collect(),
            Cells::Text(texts) => texts
                .iter()
                .enumerate()
                .map(|(row, text)| match parse(text, self.decimal) {
                    Some(number) if number.is_finite() => Ok(number),
                    Some(_) => Err(self.not_finite(column, row, text)),
                    None => Err(self.not_a_number(column, row, text)),
                })
                .collect(),
        }
    }

    /// The times of a column in s, of numbers as they stand.
    ///
    /// # Errors
    /// As [`Sheet::numbers`].
    pub(super) fn times(&self, column: usize) -> Result<Vec<f64>, CsvError> {
        let cells = match self.columns.get(column).map(|column| &column.cells) {
            Some(Cells::Text(texts)) if self.is_timestamped(column) => texts,
            _ => return self.numbers(column),
        };
        let texts: Vec<&str> = cells.iter().map(AsRef::as_ref).collect();
        timestamps::column_s(&texts)
            .map_err(|row| self.not_a_number(column, row, texts.get(row).copied().unwrap_or_default()))
    }

    /// A column as it is kept where nobody asks for it: numbers where all cells are, text otherwise.
    pub(super) fn kept(&self, column: usize) -> super::csv::ColumnData {
        use super::csv::ColumnData;
        match (self.numbers(column), self.columns.get(column).map(|column| &column.cells)) {
            (Ok(numbers), _) => ColumnData::Numbers(numbers),
            (Err(_), Some(Cells::Text(texts))) => {
                ColumnData::Text(texts.iter().map(|t| t.clone().into_owned()).collect())
            }
            (Err(_), Some(Cells::Numbers(numbers))) => ColumnData::Text(numbers.iter().map(f64::to_string).collect()),
            (Err(_), None) => ColumnData::Text(Vec::new()),
        }
    }

    fn line(&self, row: usize) -> u64 {
        self.lines.get(row).copied().unwrap_or(0)
    }

    fn not_a_number(&self, column: usize, row: usize, cell: &str) -> CsvError {
        if cell.contains('\u{fffd}') {
            return CsvError::NotUtf8 { file: self.file.clone(), line: self.line(row), position: column + 1 };
        }
        CsvError::NotANumber {
            file: self.file.clone(),
            line: self.line(row),
            position: column + 1,
            column: self.columns.get(column).map_or_else(String::new, |column| column.title.clone()),
            cell: super::csv::shown(cell),
        }
    }

    fn not_finite(&self, column: usize, row: usize, cell: &str) -> CsvError {
        CsvError::NotFinite {
            file: self.file.clone(),
            line: self.line(row),
            position: column + 1,
            column: self.columns.get(column).map_or_else(String::new, |column| column.title.clone()),
            cell: super::csv::shown(cell),
        }
    }
}

/// Whether a cell holds a number, a time or nothing, as rows of data do.
pub(super) fn is_data(text: &str, decimal: Decimal) -> bool {
    parse(text, decimal).is_some() || timestamps::is_timestamp(text)
}
