//! A file of another program as a sheet: named columns of cells, before anyone asks what they mean.
//!
//! Nothing is parsed that nobody asks for: a column of notes, of NaN or of another language is no matter as long as no rig
//! wants it. What is asked for must be a finite number in every row, and an error names line and column.

use std::borrow::Cow;

use model::rig::Decimal;

use crate::recording::columns::units::Unit;
use crate::recording::csv::numbers::{parse, says_nothing};
use crate::recording::csv::{CsvError, rows_alone};
use crate::recording::times::timestamps;

/// Cells of one column, by row.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Cells<'a> {
    /// As they stand in a text file.
    Text(Vec<Cow<'a, str>>),
    /// From a file of numbers.
    Numbers(Vec<f64>),
}

/// One column.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SheetColumn<'a> {
    /// Name, without a unit in brackets.
    pub(crate) name: String,
    /// Name as it stands in the file.
    pub(crate) title: String,
    /// Unit as the file writes it.
    pub(crate) unit: Option<String>,
    /// Cells by row.
    pub(crate) cells: Cells<'a>,
}

/// A file's columns.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Sheet<'a> {
    /// The file's name, for errors.
    pub(crate) file: String,
    /// Line of the names, from 1; `None` where there is none.
    pub(crate) header_line: Option<u64>,
    /// Columns in the file's order.
    pub(crate) columns: Vec<SheetColumn<'a>>,
    /// Line of each row, from 1.
    pub(crate) lines: Vec<u64>,
    /// Mark in the file's numbers.
    pub(crate) decimal: Decimal,
    /// Traits of the file that are not those of plain CSV, in words.
    pub(crate) manner: Vec<String>,
    /// Lines that a person should read besides.
    pub(crate) notes: Vec<String>,
}

impl<'a> SheetColumn<'a> {
    /// A column, its unit taken out of brackets behind its name.
    pub(crate) fn new(title: &str, cells: Cells<'a>) -> Self {
        // Brackets that are kept for a unit and empty say nothing.
        let title = ["()", "[]", "( )", "[ ]"]
            .into_iter()
            .find_map(|empty| title.trim_end().strip_suffix(empty))
            .unwrap_or(title);
        let (name, unit) = match Unit::in_name(title.trim_end()) {
            Some((name, unit)) => (name, Some(unit.to_owned())),
            None => (title.trim_end(), None),
        };
        SheetColumn { name: name.to_owned(), title: title.trim_end().to_owned(), unit, cells }
    }

    /// Takes the unit that stands behind every number of the column (`90.5 kPa`) out of the cells; cells without a number stay.
    pub(crate) fn take_units(&mut self, decimal: Decimal) {
        let Cells::Text(texts) = &self.cells else { return };
        let Some(unit) = stated_unit(texts, decimal).map(str::to_owned) else { return };
        let bare = |text: &Cow<'a, str>| match quantity(text, decimal) {
            _ if says_nothing(text) => Some(text.clone()),
            Some((bare, of)) if of == unit => Some(Cow::Owned(bare.to_owned())),
            _ => None,
        };
        if let Some(bare) = texts.iter().map(bare).collect::<Option<Vec<_>>>() {
            self.cells = Cells::Text(bare);
            self.unit = Some(unit);
        }
    }
}

/// The unit behind the first number of a column, where one stands there.
fn stated_unit<'t>(texts: &'t [Cow<'_, str>], decimal: Decimal) -> Option<&'t str> {
    let first = texts.iter().find(|text| !says_nothing(text))?;
    quantity(first, decimal).map(|(_, unit)| unit)
}

/// The keys by which a person names the columns of a file whose own lines do not.
pub(crate) fn own_names(columns: usize) -> String {
    let columns = if columns == 1 { "column".to_owned() } else { format!("{columns} columns") };
    format!(
        "name all {columns} in the rig file, [recording] names = [\"…\", …], with header_line = … for the last line above the data"
    )
}

/// The last part of a name of parts with points between them.
pub(crate) fn field(name: &str) -> Option<&str> {
    let (of, field) = name.rsplit_once('.')?;
    (!of.is_empty() && field.starts_with(|c: char| c.is_alphabetic())).then_some(field)
}

/// A number and the unit behind it, with blanks between them or without.
fn quantity(text: &str, decimal: Decimal) -> Option<(&str, &str)> {
    let text = text.trim();
    if !text.contains(|c: char| c.is_ascii_digit()) {
        return None;
    }
    let apart = text.split_once(char::is_whitespace).into_iter().chain(text.rsplit_once(char::is_whitespace));
    let apart = apart.filter(|(_, unit)| Unit::parse(unit).is_some());
    let joined =
        text.find(|c: char| c.is_alphabetic() || matches!(c, '%' | '[' | '(')).and_then(|at| text.split_at_checked(at));
    // `12a` is a name more often than 12 A.
    let joined = joined.filter(|(_, unit)| Unit::parse(unit).is_some_and(|unit| unit != Unit::Other));
    apart
        .chain(joined)
        .map(|(number, unit)| (number.trim(), unit.trim()))
        .find(|(number, _)| number.starts_with(|c: char| !c.is_alphabetic()) && parse(number, decimal).is_some())
}

impl<'a> Sheet<'a> {
    /// The sheet of these rows alone.
    pub(crate) fn rows_alone(&self, rows: &[usize]) -> Self {
        let cells = |cells: &Cells<'a>| match cells {
            Cells::Text(texts) => Cells::Text(rows_alone(texts, rows)),
            Cells::Numbers(numbers) => Cells::Numbers(rows_alone(numbers, rows)),
        };
        let columns = self.columns.iter().map(|column| SheetColumn { cells: cells(&column.cells), ..column.clone() });
        Sheet { columns: columns.collect(), lines: rows_alone(&self.lines, rows), ..self.clone() }
    }

    /// Rows of data.
    pub(crate) fn rows(&self) -> usize {
        self.lines.len()
    }

    /// Place of a column from 0, by its name with or without the unit in brackets, in other case where no name is written so, behind the
    /// name of what it is a field of (`run.p`) where none stands by itself; `None` where there is none.
    ///
    /// # Errors
    /// Two columns have this name.
    pub(crate) fn find(&self, name: &str) -> Result<Option<usize>, CsvError> {
        let named = |same: fn(&SheetColumn<'_>, &str) -> bool| {
            let mut those = self.columns.iter().enumerate().filter(|(_, one)| same(one, name)).map(|(at, _)| at);
            (those.next(), those.next())
        };
        let ways: [fn(&SheetColumn<'_>, &str) -> bool; 4] = [
            |column, name| column.title == name,
            |column, name| column.name == name,
            |column, name| column.title.eq_ignore_ascii_case(name) || column.name.eq_ignore_ascii_case(name),
            |column, name| field(&column.name) == Some(name),
        ];
        let (first, second) = ways.into_iter().map(named).find(|(first, _)| first.is_some()).unwrap_or_default();
        match second {
            Some(at) => Err(CsvError::DuplicateColumn {
                file: self.file.clone(),
                line: self.header_line.unwrap_or(1),
                position: at + 1,
                column: name.to_owned(),
                mend: format!(": {}", own_names(self.columns.len())),
            }),
            None => Ok(first),
        }
    }

    /// This mend of a column that is missing, with what else may be the reason: names that stand twice, and what was left out of the file.
    pub(crate) fn mend_of_missing(&self, mend: String) -> String {
        let all = std::iter::once(mend).chain(self.own_names()).chain(self.notes.iter().cloned());
        all.collect::<Vec<_>>().join("; ")
    }

    /// The mend of a file whose line of names has one of them twice, as where an oscilloscope writes a line of units alone.
    fn own_names(&self) -> Option<String> {
        let mut seen = std::collections::HashSet::new();
        let twice = self.columns.iter().find(|column| !seen.insert(column.title.as_str()))?;
        Some(format!("{} stands there twice: {}", twice.title, own_names(self.columns.len())))
    }

    /// Names for an error.
    pub(crate) fn listed(&self) -> String {
        crate::recording::csv::listed(self.columns.iter().map(|column| column.title.as_str()))
    }

    /// Tells whether the first cells of a column are dates or times of day.
    pub(crate) fn is_timestamped(&self, column: usize) -> bool {
        self.first_text(column).is_some_and(timestamps::is_timestamp)
    }

    /// Tells whether the first cells of a column are dates without a time of day.
    pub(crate) fn is_date_alone(&self, column: usize) -> bool {
        self.first_text(column).is_some_and(timestamps::is_date_alone)
    }

    /// Tells whether the first cells of a column are times of day without a date.
    pub(crate) fn is_clock_alone(&self, column: usize) -> bool {
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
    pub(crate) fn numbers(&self, column: usize) -> Result<Vec<f64>, CsvError> {
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
    pub(crate) fn times(&self, column: usize) -> Result<Vec<f64>, CsvError> {
        let cells = match self.columns.get(column).map(|column| &column.cells) {
            Some(Cells::Text(texts)) if self.is_timestamped(column) => texts,
            _ => return self.numbers(column),
        };
        let texts: Vec<&str> = cells.iter().map(AsRef::as_ref).collect();
        timestamps::column_s(&texts)
            .map_err(|row| self.not_a_number(column, row, texts.get(row).copied().unwrap_or_default()))
    }

    /// The times in s of a date and a time of day in two columns, as if they stood in one; `None` where they do not.
    pub(crate) fn moments(&self, places: &[usize]) -> Option<Vec<f64>> {
        let [a, b] = places else { return None };
        let (date, clock) = if self.is_date_alone(*a) { (*a, *b) } else { (*b, *a) };
        if !self.is_date_alone(date) || !self.is_clock_alone(clock) {
            return None;
        }
        let text = |column: usize| match self.columns.get(column).map(|column| &column.cells) {
            Some(Cells::Text(texts)) => Some(texts),
            _ => None,
        };
        let both: Vec<String> = text(date)?
            .iter()
            .zip(text(clock)?)
            .map(|(date, clock)| format!("{} {}", date.trim(), clock.trim()))
            .collect();
        timestamps::column_s(&both.iter().map(String::as_str).collect::<Vec<_>>()).ok()
    }

    /// A column as it is kept where nobody asks for it: numbers where all cells are, text otherwise.
    pub(crate) fn kept(&self, column: usize) -> crate::recording::csv::ColumnData {
        use crate::recording::csv::ColumnData;
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

    /// The error of the first cell that cannot be read with the others; of a column whose cells have units, the first that has another.
    fn not_a_number(&self, column: usize, row: usize, cell: &str) -> CsvError {
        match self.units_change(column) {
            Some(units_change) => units_change,
            None => self.no_number(column, row, cell),
        }
    }

    /// The error of a column whose first number has a unit, at the first cell that has another or none.
    fn units_change(&self, column: usize) -> Option<CsvError> {
        let of = self.columns.get(column)?;
        let Cells::Text(texts) = &of.cells else { return None };
        let first = stated_unit(texts, self.decimal)?;
        let is_of_it = |text: &str| quantity(text, self.decimal).is_some_and(|(_, unit)| unit == first);
        let (row, text) = texts.iter().enumerate().find(|(_, text)| !says_nothing(text) && !is_of_it(text))?;
        let other = match quantity(text, self.decimal) {
            Some((_, unit)) => unit,
            None if parse(text, self.decimal).is_some() => "none",
            None => return Some(self.no_number(column, row, text)),
        };
        Some(CsvError::UnitsChange {
            file: self.file.clone(),
            line: self.line(row),
            position: column + 1,
            column: of.title.clone(),
            units: format!("{first}, {other}"),
        })
    }

    fn no_number(&self, column: usize, row: usize, cell: &str) -> CsvError {
        if cell.contains('\u{fffd}') {
            return CsvError::NotUtf8 { file: self.file.clone(), line: self.line(row), position: column + 1 };
        }
        CsvError::NotANumber {
            file: self.file.clone(),
            line: self.line(row),
            position: column + 1,
            column: self.columns.get(column).map_or_else(String::new, |column| column.title.clone()),
            cell: crate::recording::csv::shown(cell),
        }
    }

    fn not_finite(&self, column: usize, row: usize, cell: &str) -> CsvError {
        CsvError::NotFinite {
            file: self.file.clone(),
            line: self.line(row),
            position: column + 1,
            column: self.columns.get(column).map_or_else(String::new, |column| column.title.clone()),
            cell: crate::recording::csv::shown(cell),
        }
    }
}

/// Tells whether a cell holds a number, with a unit or without, or a time, as cells of data do.
pub(crate) fn is_data(text: &str, decimal: Decimal) -> bool {
    parse(text, decimal).is_some() || timestamps::is_timestamp(text) || quantity(text, decimal).is_some()
}
