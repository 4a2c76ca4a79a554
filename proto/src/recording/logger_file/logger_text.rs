//! The text files that loggers write, as they write them.
//!
//! Found out, unless the rig file's `[recording]` says so: the separator (tab, semicolon, bar, comma, blanks), the decimal mark, how
//! many lines stand before the one that names the columns, a row of units below it, comment lines (`#`, `%`, `//`), separators
//! at the ends of lines, text behind the data, a last row that was cut off, UTF-16, and Latin-1 where a unit has a degree sign.
//! Each is found like this:
//!
//! ```text
//! separator   the first with which the lines in the middle of the file have one number of cells, most of them numbers or times
//! decimal     a comma where cells are digits, a comma and digits, and the separator is another
//! data        rows that have that number of cells, half of them numbers or times
//! header      a row of that many cells right above data, without a number in it; above a row of units where there is one; of
//!             several the one that most data follow
//! ```

use std::borrow::Cow;

use model::rig::{Decimal, RecordingMap, Separator};

use super::labview;
use super::remarks::{Remarks, behind_the_data, counted, strip_zero, zero_bytes};
use super::row_names;
use super::second_header::{self, Repeated, SecondHeader};
use super::sheet::{Cells, Sheet, SheetColumn, is_data, own_names};
use super::table_head::Head;
use crate::recording::csv::CsvError;
use crate::recording::csv::cells::{Broken, Comments, Grammar, Rows};
use crate::recording::csv::numbers::{is_grouped, says_nothing};

/// Lines of the file's middle that its separator and decimal mark are told from.
const SAMPLE_LINES: usize = 200;
/// Share of these lines that must have the same number of cells …
const ALIKE: f64 = 0.9;
/// … and of their cells that must be numbers or times.
const NUMERIC: f64 = 0.5;

/// End of the words for a separator that is no comma.
pub(crate) const BETWEEN_CELLS: &str = "between cells";

/// A row of cells and its line.
pub(crate) type Row<'a> = (u64, Vec<Cow<'a, str>>);

/// Reads a text file into a sheet.
///
/// # Errors
/// Empty, no header, no rows, ragged rows, broken quotes: with line and column.
pub(crate) fn sheet<'a>(file: &str, text: &'a str, map: &RecordingMap) -> Result<Sheet<'a>, CsvError> {
    if text.trim().is_empty() {
        return Err(CsvError::Empty { file: file.to_owned() });
    }
    let manner = Manner::of(text, map);
    if labview::is_measurement(text) {
        return labview::sheet(file, text, map);
    }
    let grammar = Grammar { separator: manner.separator, comments: Comments::Marked };
    let AllRows { rows, comment, later_comments, zeroed, last } = rows(file, text, grammar)?;
    let head = Head::of(file, &rows, &manner, map, comment)?;
    let mut sheet = Sheet {
        file: file.to_owned(),
        header_line: head.line,
        columns: Vec::new(),
        lines: Vec::new(),
        decimal: manner.decimal,
        manner: manner.words(),
        notes: zero_bytes(file, &zeroed).into_iter().collect(),
    };
    if head.rows_above > 0 {
        sheet.manner.push(format!("{} before the header", counted(head.rows_above, "line")));
    }
    if head.in_comment {
        sheet.manner.push("names of columns in a comment line".to_owned());
        second_header::check_comments(file, &head, &later_comments, &manner)?;
    }
    let (above, body) = rows.split_at(head.first.min(rows.len()));
    let named = row_names::lifted(&head.names, body, manner.decimal);
    if named.is_some() {
        sheet.manner.push("row names in the first column, which the header has no name for, left out".to_owned());
    }
    let body = named.as_deref().unwrap_or(body);
    fill(&mut sheet, (&head, above), body, last)?;
    Ok(sheet)
}

/// State of the last row, which may have been cut off while it was written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum LastRow {
    /// A line end follows it.
    Whole,
    /// Nothing follows it.
    MayBeCut,
}

/// Separator and decimal mark, and which of them are worth a word.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Manner {
    pub(crate) separator: Separator,
    pub(crate) decimal: Decimal,
    /// Cells that most lines have.
    pub(crate) cells: usize,
}

impl Manner {
    fn of(text: &str, map: &RecordingMap) -> Self {
        let lines: Vec<&str> = text.lines().filter(|line| !line.trim().is_empty() && !is_comment(line)).collect();
        let from = (lines.len() / 2).min(lines.len().saturating_sub(1));
        let sample = lines.get(from..lines.len().min(from + SAMPLE_LINES)).unwrap_or_default();
        let candidates = match map.separator {
            Some(separator) => vec![separator],
            None => {
                vec![Separator::Tab, Separator::Semicolon, Separator::Bar, Separator::Comma, Separator::Blank]
            }
        };
        let tried: Vec<(Manner, f64, f64)> =
            candidates.into_iter().map(|separator| Self::tried(sample, separator, map.decimal)).collect();
        let splits = |(manner, alike, _): &&(Manner, f64, f64)| manner.cells > 1 && *alike >= ALIKE;
        let best = tried
            .iter()
            .find(|one| splits(one) && one.2 >= NUMERIC)
            .or_else(|| tried.iter().find(splits))
            .or_else(|| tried.iter().find(|(manner, ..)| manner.separator == Separator::Comma))
            .or_else(|| tried.first());
        best.map_or(Manner { separator: Separator::Comma, decimal: Decimal::Point, cells: 1 }, |(manner, ..)| *manner)
    }

    /// The manner of lines with one separator; the share of them that have the usual number of cells; the share of numbers.
    fn tried(sample: &[&str], separator: Separator, decimal: Option<Decimal>) -> (Self, f64, f64) {
        let split: Vec<Vec<&str>> = sample.iter().map(|line| cells_of(line, separator)).collect();
        let cells = usual(split.iter().map(Vec::len));
        let decimal = decimal.unwrap_or_else(|| decimal_of(&split, separator));
        let alike = split.iter().filter(|row| row.len() == cells).count() as f64 / split.len().max(1) as f64;
        let all: Vec<&str> = split.iter().flatten().copied().filter(|cell| !cell.is_empty()).collect();
        let data = all.iter().filter(|cell| is_data(cell, decimal)).count() as f64 / all.len().max(1) as f64;
        (Manner { separator, decimal, cells }, alike, data)
    }

    fn words(self) -> Vec<String> {
        let separator = match self.separator {
            Separator::Comma => None,
            Separator::Semicolon => Some("semicolons"),
            Separator::Tab => Some("tabs"),
            Separator::Bar => Some("bars"),
            Separator::Blank => Some("blanks"),
        };
        let separator = separator.map(|separator| format!("{separator} {BETWEEN_CELLS}"));
        let decimal = (self.decimal == Decimal::Comma).then(|| "decimal commas".to_owned());
        separator.into_iter().chain(decimal).collect()
    }
}

fn is_comment(line: &str) -> bool {
    let line = line.trim_start();
    line.starts_with('#') || line.starts_with('%') || line.starts_with("//")
}

/// Cells of a line, quotes taken off and empty ones at its end left out; good enough to count and to look at.
pub(crate) fn cells_of(line: &str, separator: Separator) -> Vec<&str> {
    let mut quoted = false;
    let split = |c: char| {
        quoted ^= c == '"';
        !quoted
            && match separator {
                Separator::Comma => c == ',',
                Separator::Semicolon => c == ';',
                Separator::Tab => c == '\t',
                Separator::Bar => c == '|',
                Separator::Blank => c == ' ' || c == '\t',
            }
    };
    let trimmed = |cell: &'_ str| -> bool { separator != Separator::Blank || !cell.is_empty() };
    let mut cells: Vec<&str> =
        line.split(split).map(|cell| cell.trim().trim_matches('"').trim()).filter(|cell| trimmed(cell)).collect();
    while cells.len() > 1 && cells.last().is_some_and(|cell| cell.is_empty()) {
        cells.pop();
    }
    cells
}

/// The number that comes most often; of several the largest.
pub(crate) fn usual(counts: impl Iterator<Item = usize>) -> usize {
    let mut seen = std::collections::BTreeMap::new();
    counts.for_each(|count| *seen.entry(count).or_insert(0_usize) += 1);
    seen.into_iter().max_by_key(|(_, times)| *times).map_or(1, |(count, _)| count)
}

fn decimal_of(rows: &[Vec<&str>], separator: Separator) -> Decimal {
    // Between commas a comma in a number stands within quotes, and there it may group thousands.
    let groups = |cell: &str| separator == Separator::Comma && is_grouped(cell, Decimal::Point);
    let marked = |cell: &str, mark: char| {
        // A unit may stand behind it.
        let number = cell.split_whitespace().next().unwrap_or_default();
        let unsigned = number.trim_start_matches(['+', '-']);
        if mark == ',' && groups(unsigned) {
            return false;
        }
        unsigned.split_once(mark).is_some_and(|(whole, broken)| {
            whole.chars().all(|c| c.is_ascii_digit() || c == '.')
                && broken.starts_with(|c: char| c.is_ascii_digit())
                && broken.chars().all(|c| c.is_ascii_digit() || matches!(c, 'e' | 'E' | '+' | '-'))
        })
    };
    let count = |mark| rows.iter().flatten().filter(|cell| marked(cell, mark)).count();
    if count(',') > count('.') { Decimal::Comma } else { Decimal::Point }
}

/// All rows of a text, and the comments beside them.
struct AllRows<'a> {
    rows: Vec<Row<'a>>,
    /// The last comment before the first row, with its line.
    comment: Option<(u64, &'a str)>,
    /// The last ones before later rows.
    later_comments: Vec<(u64, &'a str)>,
    /// Lines with zero bytes together in them, which are no rows.
    zeroed: Vec<u64>,
    last: LastRow,
}

fn rows<'a>(file: &str, text: &'a str, grammar: Grammar) -> Result<AllRows<'a>, CsvError> {
    let mut walk = Rows::with(text.as_bytes(), grammar);
    let (mut found, mut cells): (Vec<Row<'a>>, _) = (Vec::new(), Vec::new());
    let (mut comment, mut later_comments): (Option<(u64, &str)>, Vec<(u64, &str)>) = (None, Vec::new());
    let mut zeroed = Vec::new();
    while let Some(mut row) = next(file, &mut walk, &mut cells)? {
        let before = walk.last_comment().map(|(line, text)| (line, std::str::from_utf8(text).unwrap_or_default()));
        if found.is_empty() {
            comment = before;
        } else if before != later_comments.last().copied().or(comment) {
            later_comments.extend(before);
        }
        if row.1.iter().any(|cell| cell.contains("\0\0")) {
            zeroed.push(row.0);
            continue;
        }
        row.1.iter_mut().for_each(strip_zero);
        if !is_ruled(&row.1) {
            found.push(row);
        }
    }
    let last = if text.ends_with('\n') { LastRow::Whole } else { LastRow::MayBeCut };
    Ok(AllRows { rows: found, comment, later_comments, zeroed, last })
}

/// Tells whether a row is a line that somebody drew (`-----+-----` under a database's header): one cell, and no sign that says anything.
fn is_ruled(row: &[Cow<'_, str>]) -> bool {
    const SHORTEST: usize = 4;
    let [only] = row else { return false };
    only.len() >= SHORTEST && only.chars().all(|c| matches!(c, '-' | '+' | '=' | '|' | '─' | '┼'))
}

/// The next row as text.
pub(crate) fn next<'a>(
    file: &str,
    walk: &mut Rows<'a>,
    cells: &mut Vec<Cow<'a, [u8]>>,
) -> Result<Option<Row<'a>>, CsvError> {
    let line = walk.next_row(cells).map_err(|Broken { line, position, open }| {
        let file = file.to_owned();
        if open {
            CsvError::OpenQuote { file, line, position }
        } else {
            CsvError::TextAfterQuote { file, line, position }
        }
    })?;
    let text = |cell: &Cow<'a, [u8]>| match cell {
        Cow::Borrowed(bytes) => String::from_utf8_lossy(bytes),
        Cow::Owned(bytes) => Cow::Owned(String::from_utf8_lossy(bytes).into_owned()),
    };
    Ok(line.map(|line| (line, cells.iter().map(text).collect())))
}

/// Cells of a row without the empty ones at its end.
pub(crate) fn filled(row: &[Cow<'_, str>]) -> usize {
    row.iter().rposition(|cell| !cell.is_empty()).map_or(0, |at| at + 1)
}

/// The error of a row of so many cells too few or too many, among these rows, with the key that would help.
fn ragged(file: &str, (line, row): &Row<'_>, width: usize, rows: &[Row<'_>]) -> CsvError {
    let cells: Vec<&str> = row.iter().map(AsRef::as_ref).collect();
    let mut error = crate::recording::csv::ragged(file, *line, &cells, width);
    if let CsvError::Ragged { found, hint, .. } = &mut error
        && (hint.is_empty() || hint == crate::recording::csv::MAY_BE_HALVES)
    {
        let otherwise = if hint.is_empty() { "" } else { "otherwise " };
        let alike = rows.iter().filter(|(_, other)| other.len() == *found).count();
        *hint = if 2 * alike > rows.len() {
            format!(", and so have most rows{hint}; {otherwise}{}", own_names(*found))
        } else {
            let usual = usual(rows.iter().map(|(_, other)| other.len()));
            format!(
                "{hint}; {otherwise}complete the row or leave it out; where another line names the columns, say in the rig file: [recording] header_line = …; where none does, {}",
                own_names(usual)
            )
        };
    }
    error
}

/// Puts the rows below a head, with the rows that it stands in, into the columns of a sheet.
pub(crate) fn fill<'a>(
    sheet: &mut Sheet<'a>,
    (head, above): (&Head<'a>, &[Row<'a>]),
    rows: &[Row<'a>],
    last: LastRow,
) -> Result<(), CsvError> {
    let mut width = head.names.len();
    // Separators at the ends of lines make a last column that has no name and nothing in it.
    if head.names.last().is_some_and(String::is_empty)
        && rows.iter().all(|(_, row)| row.get(width - 1).is_none_or(|cell| cell.is_empty()))
    {
        width -= 1;
    }
    let remarks = Remarks::of(rows, &head.names, width, sheet.decimal);
    let mut texts: Vec<Vec<Cow<'a, str>>> = vec![Vec::with_capacity(rows.len()); width];
    let mut second_header = SecondHeader::new(head, above, sheet.decimal);
    let (mut passed_over, mut noted) = (Vec::new(), Vec::new());
    for (index, of_line) in rows.iter().enumerate() {
        let (line, row) = of_line;
        match second_header.repeated(&sheet.file, of_line)? {
            Some(Repeated::Names) => {
                sheet.notes.push(format!("{}: line {line}: the header stands here again; passed over", sheet.file));
                continue;
            }
            Some(Repeated::Beside) => continue,
            None => {}
        }
        if let Some(text) = remarks.line(row) {
            passed_over.push((*line, crate::recording::csv::shown(text)));
            continue;
        }
        let behind = rows.get(index..).unwrap_or_default();
        let begins_with_data =
            |row: &[Cow<'_, str>]| row.first().is_some_and(|cell| is_data(cell, sheet.decimal) || says_nothing(cell));
        if index > 0
            && rows.first().is_some_and(|(_, first)| begins_with_data(first))
            && behind.iter().all(|(_, row)| !begins_with_data(row))
        {
            sheet.notes.push(behind_the_data(&sheet.file, behind.len(), *line));
            break;
        }
        let short = row.len() < remarks.least_cells();
        let note = remarks.behind(row);
        let long = filled(row) > width && note.is_none();
        if short || long {
            if index > 0 && behind.iter().all(|(_, row)| row.iter().all(|cell| !is_data(cell, sheet.decimal))) {
                sheet.notes.push(behind_the_data(&sheet.file, behind.len(), *line));
                break;
            }
            if index > 0 && short && index + 1 == rows.len() && last == LastRow::MayBeCut {
                sheet.notes.push(format!("{}: line {line}: the last row is cut off; left out", sheet.file));
                break;
            }
            return Err(ragged(&sheet.file, of_line, width, rows));
        }
        noted.extend(note.map(|text| (*line, crate::recording::csv::shown(text))));
        for (column, texts) in texts.iter_mut().enumerate() {
            texts.push(row.get(column).cloned().unwrap_or_default());
        }
        sheet.lines.push(*line);
    }
    if let Some((line, text)) = passed_over.first() {
        sheet.notes.push(format!(
            "{}: {} of text among the data or behind them passed over, the first \"{text}\" in line {line}",
            sheet.file,
            counted(passed_over.len(), "line")
        ));
    }
    if let Some((line, text)) = noted.first() {
        let have = if noted.len() == 1 { "has" } else { "have" };
        sheet.notes.push(format!(
            "{}: {} {have} text behind the last column, left out, the first \"{text}\" in line {line}",
            sheet.file,
            counted(noted.len(), "row")
        ));
    }
    if sheet.lines.is_empty() {
        return Err(CsvError::NoRows { file: sheet.file.clone() });
    }
    sheet.columns = texts
        .into_iter()
        .enumerate()
        .map(|(at, texts)| {
            let title = head
                .names
                .get(at)
                .filter(|name| !name.is_empty())
                .cloned()
                .unwrap_or_else(|| format!("column {}", at + 1));
            let mut column = SheetColumn::new(&title, Cells::Text(texts));
            if let Some(unit) = head.units.get(at).filter(|unit| !unit.is_empty()) {
                column.unit = Some(unit.to_string());
            }
            column.take_units(sheet.decimal);
            column
        })
        .collect();
    Ok(())
}
