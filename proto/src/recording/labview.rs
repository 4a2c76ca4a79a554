//! LabVIEW measurement files (`.lvm`), as the Write To Measurement File VI writes them.
//!
//! A header of `key<separator>value` lines says separator, decimal mark and how many columns of times there are; each segment
//! repeats a head with the channels' units and, where there is no column of times, first time and step. Rows follow a line of
//! names that begins with `X_Value`. Segments with the same names are one recording.

use std::borrow::Cow;

use model::rig::{Decimal, RecordingMap, Separator};

use super::cells::{Comments, Grammar, Rows};
use super::csv::CsvError;
use super::logger_text::{Head, LastRow, Row, fill, next};
use super::sheet::{Cells, Sheet, SheetColumn};

/// First words of such a file.
const MAGIC: &str = "LabVIEW Measurement";
/// First cell of the line that ends a head.
const END_OF_HEADER: &str = "***End_of_Header***";
/// Name of a column of times.
const TIME: &str = "X_Value";

/// Whether a text is a LabVIEW measurement file.
pub(super) fn is_measurement(text: &str) -> bool {
    text.trim_start().starts_with(MAGIC)
}

/// Times that stand in no column.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Steps {
    first_s: f64,
    step_s: f64,
}

/// Reads such a file.
///
/// # Errors
/// No names, no rows, ragged rows, one column of times per channel whose times differ.
pub(super) fn sheet<'a>(file: &str, text: &'a str, map: &RecordingMap) -> Result<Sheet<'a>, CsvError> {
    let separator = map.separator.unwrap_or(match value_of(text, "Separator") {
        Some("Comma") => Separator::Comma,
        _ => Separator::Tab,
    });
    let decimal = map.decimal.unwrap_or(match value_of(text, "Decimal_Separator") {
        Some(",") => Decimal::Comma,
        _ => Decimal::Point,
    });
    let grammar = Grammar { separator, comments: Comments::No };
    let mut walk = Rows::with(text.as_bytes(), grammar);
    let (mut cells, mut rows): (_, Vec<Row<'a>>) = (Vec::new(), Vec::new());
    let mut head = Head::default();
    let (mut in_head, mut units, mut steps, mut segments) = (true, Vec::new(), None, 0_usize);
    while let Some((line, row)) = next(file, &mut walk, &mut cells)? {
        let first = row.first().map_or("", AsRef::as_ref);
        match first {
            MAGIC | "Channels" => in_head = true,
            "Y_Unit_Label" => units = row.iter().skip(1).cloned().collect(),
            "X0" | "Delta_X" => steps = step_of(steps, first, row.get(1).map_or("", AsRef::as_ref), decimal),
            TIME => {
                in_head = false;
                segments += 1;
                if head.line.is_none() {
                    head.line = Some(line);
                    head.names = row.iter().map(ToString::to_string).collect();
                }
            }
            END_OF_HEADER => {}
            _ if !in_head => rows.push((line, row)),
            _ => {}
        }
    }
    if head.line.is_none() {
        return Err(CsvError::NoRows { file: file.to_owned() });
    }
    // Units are those of the channels, which stand behind the times.
    head.units = std::iter::once(Cow::Borrowed("s")).chain(units).collect();
    let mut sheet = Sheet {
        file: file.to_owned(),
        header_line: head.line,
        columns: Vec::new(),
        lines: Vec::new(),
        decimal,
        manner: vec!["the head of a LabVIEW measurement file".to_owned()],
        notes: Vec::new(),
    };
    if decimal == Decimal::Comma {
        sheet.manner.push("decimal commas".to_owned());
    }
    if segments > 1 {
        sheet.manner.push(format!("{segments} segments"));
    }
    let last = if text.ends_with('\n') { LastRow::Whole } else { LastRow::MayBeCut };
    fill(&mut sheet, &head, &rows, last)?;
    timed(&mut sheet, steps)?;
    Ok(sheet)
}

/// The value behind a key of the header.
fn value_of<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    text.lines()
        .take_while(|line| !line.starts_with(END_OF_HEADER))
        .find_map(|line| line.strip_prefix(key)?.strip_prefix(['\t', ',']).map(str::trim))
}

fn step_of(steps: Option<Steps>, key: &str, value: &str, decimal: Decimal) -> Option<Steps> {
    let mut of = steps.unwrap_or(Steps { first_s: 0.0, step_s: 0.0 });
    let number = super::numbers::parse(value, decimal)?;
    match key {
        "X0" => of.first_s = number,
        _ => of.step_s = number,
    }
    Some(of)
}

/// Makes the one column of times: from `X0` and `Delta_X` where it is empty; the first of several that are alike.
fn timed(sheet: &mut Sheet<'_>, steps: Option<Steps>) -> Result<(), CsvError> {
    let is_time = |column: &SheetColumn<'_>| column.title == TIME;
    let times: Vec<usize> = (0..sheet.columns.len()).filter(|at| sheet.columns.get(*at).is_some_and(is_time)).collect();
    let Some(first) = times.first().copied() else { return Ok(()) };
    let empty = |column: &SheetColumn<'_>| match &column.cells {
        Cells::Text(texts) => texts.iter().all(|text| text.is_empty()),
        Cells::Numbers(_) => false,
    };
    if sheet.columns.get(first).is_some_and(empty) {
        let Steps { first_s, step_s } = steps.unwrap_or(Steps { first_s: 0.0, step_s: 0.0 });
        let numbers = (0..sheet.rows()).map(|row| first_s + step_s * row as f64).collect();
        if let Some(column) = sheet.columns.get_mut(first) {
            column.cells = Cells::Numbers(numbers);
        }
        sheet.manner.push(format!("times from X0 and Delta_X = {step_s} s"));
        return Ok(());
    }
    for other in times.into_iter().skip(1).rev() {
        let same = sheet.columns.get(first).map(|c| &c.cells) == sheet.columns.get(other).map(|c| &c.cells);
        if !same {
            return Err(CsvError::DuplicateColumn {
                file: sheet.file.clone(),
                line: sheet.header_line.unwrap_or(1),
                position: other + 1,
                column: TIME.to_owned(),
            });
        }
        sheet.columns.remove(other);
    }
    Ok(())
}
