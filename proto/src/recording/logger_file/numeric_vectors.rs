//! Vectors of numbers that a file holds by name, to the columns of a sheet.
//!
//! Files of MATLAB and HDF5 hold arrays of any length beside each other. Of the lengths that occur the longest is taken for the
//! rows; an array of another length is a setting and no column, and is told.

use model::rig::Decimal;

use super::sheet::{Cells, Sheet, SheetColumn};
use crate::recording::recording_error::RecordingError;

/// A matrix wider than this is no set of columns.
pub(super) const MOST_COLUMNS: usize = 256;
/// Memory that one array may take (bytes): 16 million numbers.
pub(super) const MOST_BYTES: usize = 1 << 27;

/// Words that a kind of file is spoken of with.
#[derive(Debug, Clone, Copy)]
pub(super) struct Wording {
    /// Name of the kind, with its article.
    pub(super) kind: &'static str,
    /// Description of its vectors, in the plural.
    pub(super) vectors: &'static str,
    /// Line that makes a readable file.
    pub(super) mend: &'static str,
}

impl Wording {
    /// The error of a file in which something is wrong.
    pub(super) fn broken(&self, file: &str, what: &str) -> RecordingError {
        RecordingError::Kind {
            file: file.to_owned(),
            what: format!("{}, {what}", self.kind),
            mend: self.mend.to_owned(),
        }
    }
}

/// Vectors found so far, and what was passed over.
#[derive(Debug, Default)]
pub(super) struct NumericVectors {
    columns: Vec<(SheetColumn<'static>, usize)>,
    /// Names of what cannot be read.
    objects: Vec<String>,
    /// Remarks on parts that are missing.
    notes: Vec<String>,
}

impl NumericVectors {
    /// Takes a vector, with the unit that the file states of it.
    pub(super) fn take(&mut self, name: String, unit: Option<String>, numbers: Vec<f64>) {
        let length = numbers.len();
        self.columns.push((SheetColumn { title: name.clone(), name, unit, cells: Cells::Numbers(numbers) }, length));
    }

    /// Takes the columns of a matrix, each with its place as `place` writes it, from 0.
    pub(super) fn take_columns(
        &mut self,
        name: &str,
        unit: Option<&str>,
        columns: impl Iterator<Item = Vec<f64>>,
        place: impl Fn(usize) -> String,
    ) {
        for (at, numbers) in columns.enumerate() {
            self.take(format!("{name}{}", place(at)), unit.map(str::to_owned), numbers);
        }
    }

    /// Takes note of what is there and cannot be read.
    pub(super) fn leave_out(&mut self, name: String) {
        self.objects.push(name);
    }

    /// Takes note of what is missing from the file.
    pub(super) fn remark(&mut self, note: String) {
        self.notes.push(note);
    }

    /// Makes the sheet of the vectors that are as long as the longest.
    ///
    /// # Errors
    /// No vector of two numbers or more.
    pub(super) fn into_sheet(self, file: &str, wording: &Wording) -> Result<Sheet<'static>, RecordingError> {
        let Some(rows) = self.columns.iter().map(|(_, length)| *length).filter(|length| *length > 1).max() else {
            let objects = match self.objects.as_slice() {
                [] => String::new(),
                objects => format!(" (it holds objects: {})", objects.join(", ")),
            };
            // Arrays that were left out are why there is none.
            let left_out = self.notes.iter().map(|note| note.strip_prefix(&format!("{file}: ")).unwrap_or(note));
            let left_out: String = left_out.map(|note| format!("; {note}")).collect();
            return Err(wording.broken(file, &format!("without a numeric vector{objects}{left_out}")));
        };
        let mut notes = Vec::new();
        if !self.objects.is_empty() {
            notes.push(format!(
                "{file}: {} left out: tables, timetables and other objects cannot be read; save their columns as vectors",
                self.objects.join(", ")
            ));
        }
        let others = self.columns.iter().filter(|(_, length)| *length > 1 && *length != rows);
        let others: Vec<String> = others.map(|(column, length)| format!("{} has {length}", column.name)).collect();
        if !others.is_empty() {
            notes.push(format!("{file}: vectors of {rows} numbers are the columns; left out: {}", others.join(", ")));
        }
        notes.extend(self.notes);
        let columns = self.columns.into_iter().filter(|(_, length)| *length == rows).map(|(column, _)| column);
        Ok(Sheet {
            file: file.to_owned(),
            header_line: None,
            columns: columns.collect(),
            lines: (1..=rows as u64).collect(),
            decimal: Decimal::Point,
            manner: vec![format!("{} of {rows} rows", wording.vectors)],
            notes,
        })
    }
}
