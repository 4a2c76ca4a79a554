//! A recording as a table: times and named columns, whatever file it came from.
//!
//! Row *k* holds the reading at `t_k` and the command applied from `t_k` to `t_{k+1}`. Rows are
//! 20 ms apart. Two rules say how exactly, of what a program of ours writes; files of other programs are brought to such rows by
//! [`Recording::read_for`]:
//!
//! - the median step of a file must be 20 ms within 5 %, otherwise the file has another rate (or
//!   another unit) and is refused;
//! - a single step may be anything above 0 up to [`MAX_STEP_S`] (30 ms, half a period of jitter).
//!   A longer one is a gap: it ends a segment, and the next row begins another. Nothing that looks
//!   at neighbouring rows may look across segments.
//!
//! From a daemon's own MCAP file, time is the cRIO's tick times 20 ms (the cRIO is the master of
//! time; arrival times carry the network's jitter). Ticks without a sound reading leave no row.
//!
//! Known columns are `u_pos`, `u_neg` (duty, in [0, 1]), `p_pos_kpa`, `p_neg_kpa`, `ref_pos_kpa`,
//! `ref_neg_kpa` (gauge kPa, above −101.325; what a sensor reads, above −200) and `pump_on` (0 or 1). All others are kept by name:
//! numbers as numbers, texts as text (see [`csv`](super::csv)).

pub(super) mod rules;

use std::ops::Range;
use std::path::Path;

use super::MOST_BYTES;
use crate::atomic_file;
use crate::recording::columns::file_unit::FileUnit;
use crate::recording::csv::{self, Column, ColumnData, CsvError, Table};
use crate::recording::mcap_file::from_ticks::Broken;
use crate::recording::mcap_file::reader::parse_mcap;
use crate::recording::mcap_file::tick::TickRecord;
use crate::recording::mcap_file::writer::{Event, EventLevel, VERDICT};
use crate::recording::recording_error::RecordingError;
use crate::regular_file;

/// Nominal time between rows (s).
pub const PERIOD_S: f64 = 0.02;
/// The longest step within a segment (s); beyond it is a gap.
pub const MAX_STEP_S: f64 = 0.03;

/// A checked recording.
///
/// ```no_run
/// # fn main() -> Result<(), proto::recording::RecordingError> {
/// let recording = proto::recording::Recording::read("run.mcap".as_ref())?;
/// let [u_pos, p_pos_kpa] = recording.require(["u_pos", "p_pos_kpa"])?;
/// for rows in recording.segments() {
///     println!("{:?} {:?}", u_pos.get(rows.clone()), p_pos_kpa.get(rows.clone()));
/// }
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    source: String,
    // Line of the header when the recording is a CSV file.
    header_line: Option<u64>,
    time_s: Vec<f64>,
    columns: Vec<Column>,
    // Never empty, in order, together all rows.
    segments: Vec<Range<usize>>,
    // By row; empty where every row is a sample.
    measured: Vec<bool>,
    // By sensor's column; none where every reading of it is there.
    missing: Vec<(String, Vec<bool>)>,
    sampling_s: f64,
    // Whether a rig file's table of columns was asked, and a missing column may be named in it.
    asked: Asked,
    notes: Vec<String>,
    file_units: Vec<FileUnit>,
    // Whether its seconds may be a count of rows.
    may_count_rows: bool,
}

/// Whose columns a recording has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Asked {
    /// The file's.
    File,
    /// Those that a rig asked for.
    Rig,
}

/// Rows that another program's samples were brought to.
#[derive(Debug)]
pub(super) struct Rows {
    /// Time of each row (s).
    pub(super) time_s: Vec<f64>,
    /// Their columns.
    pub(super) columns: Vec<Column>,
    /// By row, whether a sample was taken there; empty where one was in all.
    pub(super) measured: Vec<bool>,
    /// Columns of sensors that lack readings; by row, whether one is missing there.
    pub(super) missing: Vec<(String, Vec<bool>)>,
    /// Usual distance of samples (s), [`PERIOD_S`] at least.
    pub(super) sampling_s: f64,
    /// Line of the file's header.
    pub(super) header_line: Option<u64>,
}

impl Recording {
    /// Puts a recording together from columns; `source` is the name that errors and reports carry.
    ///
    /// # Errors
    /// Columns of unequal length, names twice, a number that is not finite, time that does not go
    /// forward, a known column out of its range, a median step other than 20 ms. "Line" in such an
    /// error is the line that the row would have in a CSV file.
    pub fn new(source: &str, time_s: Vec<f64>, columns: Vec<Column>) -> Result<Self, RecordingError> {
        for column in &columns {
            let found = match &column.data {
                ColumnData::Numbers(numbers) => numbers.len(),
                ColumnData::Text(texts) => texts.len(),
            };
            if found != time_s.len() {
                return Err(RecordingError::ColumnLength {
                    file: source.to_owned(),
                    column: column.name.clone(),
                    found,
                    expected: time_s.len(),
                });
            }
        }
        let lines = (0..time_s.len() as u64).map(|row| row + 2).collect();
        Self::from_table(source, Table { time_s, columns, lines, time_position: 1 })
    }

    /// Reads a recording, MCAP or CSV: by its first bytes, whatever it is called.
    ///
    /// # Errors
    /// The file cannot be read, or its content is wrong: one line with file, line and column.
    pub fn read(path: &Path) -> Result<Self, RecordingError> {
        let file = path.display().to_string();
        let bytes = regular_file::read(path, MOST_BYTES)
            .map_err(|source| RecordingError::Read { file: file.clone(), source })?;
        let named_mcap = path.extension().is_some_and(|end| end.eq_ignore_ascii_case("mcap"));
        if bytes.starts_with(mcap::MAGIC) || named_mcap {
            Self::parse_mcap(&file, &bytes, Broken::NoRow)
        } else {
            Self::parse_csv(&file, &bytes)
        }
    }

    /// The recording that the bytes of a daemon's MCAP file are.
    pub(super) fn parse_mcap(file: &str, bytes: &[u8], broken: Broken) -> Result<Self, RecordingError> {
        let content = parse_mcap(file, bytes)?;
        let mut recording = crate::recording::mcap_file::from_ticks::recording(file, &content.ticks, broken)?;
        let unfinished = |event: &&Event| event.part == VERDICT && event.level == EventLevel::Error;
        let aborted = content.events.iter().filter(unfinished).map(|event| format!("{file}: {}", event.message));
        recording.notes.splice(0..0, content.notes.into_iter().chain(aborted));
        Ok(recording)
    }

    pub(super) fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// Parses the bytes of a CSV recording; `file` is the name that errors carry.
    ///
    /// # Errors
    /// As [`Recording::read`].
    ///
    /// Strict: what a program of ours writes, and what is sent to a rig row by row. Files of other programs, and any rate, are
    /// read by [`Recording::read_for`].
    pub fn parse_csv(file: &str, bytes: &[u8]) -> Result<Self, RecordingError> {
        let names = rules::KNOWN.map(|(name, ..)| name);
        let mut recording = Self::from_table(file, Table::parse(file, bytes, &names)?)?;
        recording.header_line = Some(1);
        Ok(recording)
    }

    /// The recording that a run of ticks is.
    ///
    /// A row per tick that has both pressures and a sent command; other ticks leave none, which
    /// makes a gap. Time is `0.02 · tick`, from 0 at the first row; a new session begins a new
    /// segment, later by the time that passed between the arrivals. Reference columns are there when
    /// every row has a reference.
    ///
    /// # Errors
    /// No tick has a reading; a duty outside [0, 1].
    pub fn from_ticks(source: &str, ticks: &[TickRecord]) -> Result<Self, RecordingError> {
        crate::recording::mcap_file::from_ticks::recording(source, ticks, Broken::NoRow)
    }

    /// Where the recording comes from: the file's name as it was given.
    pub fn source(&self) -> &str {
        &self.source
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.time_s.len()
    }

    /// Time of each row (s).
    pub fn time_s(&self) -> &[f64] {
        &self.time_s
    }

    /// Names of all columns but `time_s`, in the file's order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.columns.iter().map(|column| column.name.as_str())
    }

    /// The numbers of a column; `None` when it is absent or holds text.
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        self.columns.iter().find(|column| column.name == name).and_then(|column| match &column.data {
            ColumnData::Numbers(numbers) => Some(numbers.as_slice()),
            ColumnData::Text(_) => None,
        })
    }

    /// The texts of a column; `None` when it is absent or holds numbers.
    pub fn text_column(&self, name: &str) -> Option<&[String]> {
        self.columns.iter().find(|column| column.name == name).and_then(|column| match &column.data {
            ColumnData::Numbers(_) => None,
            ColumnData::Text(texts) => Some(texts.as_slice()),
        })
    }

    /// The columns that the caller needs, in the caller's order.
    ///
    /// # Errors
    /// The first column that is missing or holds text, by name, with the names that are there.
    pub fn require<const N: usize>(&self, names: [&str; N]) -> Result<[&[f64]; N], RecordingError> {
        let mut found: [&[f64]; N] = [&[]; N];
        for (slot, name) in found.iter_mut().zip(names) {
            *slot = self.require_one(name)?;
        }
        Ok(found)
    }

    /// As [`Recording::require`], for names that a rig file gives.
    ///
    /// # Errors
    /// As [`Recording::require`].
    pub fn require_all<'a>(&self, names: impl IntoIterator<Item = &'a str>) -> Result<Vec<&[f64]>, RecordingError> {
        names.into_iter().map(|name| self.require_one(name)).collect()
    }

    /// This recording with other numbers in a column; as it is where the column is missing, holds text or has another length.
    #[must_use]
    pub fn with_numbers(mut self, name: &str, numbers: &[f64]) -> Self {
        if let Some(column) = self.columns.iter_mut().find(|column| column.name == name)
            && let ColumnData::Numbers(old) = &mut column.data
            && old.len() == numbers.len()
        {
            old.copy_from_slice(numbers);
        }
        self
    }

    /// Stretches of rows without a gap: in order, none empty, together all rows.
    pub fn segments(&self) -> &[Range<usize>] {
        &self.segments
    }

    /// By row, whether a sample was taken there: 1 a sample, 0 a row between sparse samples or in the place of a lost one, whose
    /// readings are straight lines and no evidence. `None` where every row is a sample.
    pub fn measured(&self) -> Option<&[bool]> {
        (!self.measured.is_empty()).then_some(self.measured.as_slice())
    }

    /// By row, whether a sensor's reading is missing there although the rest of the row was recorded: a straight line stands in its
    /// place, which is no evidence. `None` where the column lacks none.
    pub fn missing(&self, column: &str) -> Option<&[bool]> {
        self.missing.iter().find(|(name, _)| name == column).map(|(_, missing)| missing.as_slice())
    }

    /// The recording from one of its rows on; as it is where that leaves no row.
    #[must_use]
    pub fn from_row(mut self, first: usize) -> Self {
        let rows = self.rows();
        if first == 0 || first >= rows {
            return self;
        }
        self.time_s.drain(..first);
        for column in &mut self.columns {
            column.data = column.data.cut(&(first..rows));
        }
        let without = |marks: &mut Vec<bool>| drop(marks.drain(..first.min(marks.len())));
        without(&mut self.measured);
        self.missing.iter_mut().for_each(|(_, missing)| without(missing));
        self.segments.retain(|segment| segment.end > first);
        for segment in &mut self.segments {
            *segment = segment.start.max(first) - first..segment.end - first;
        }
        self
    }

    /// Usual distance of samples (s); [`PERIOD_S`] where they are as close as rows or closer. Nothing that is faster can be told.
    pub fn sampling_s(&self) -> f64 {
        self.sampling_s
    }

    /// The unit, other than the rig's, that the file or its map says of a column, and by which it was read.
    pub fn file_unit(&self, column: &str) -> Option<&FileUnit> {
        self.file_units.iter().find(|unit| unit.column == column)
    }

    /// Lines that a person should read: a truncated end, damaged chunks, left-out ticks, an aborted experiment.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// The recording as CSV text, which [`Recording::parse_csv`] reads back bit for bit.
    pub fn to_csv(&self) -> String {
        csv::to_csv(&self.time_s, &self.columns)
    }

    /// Writes the recording as a CSV file: aside, synced, renamed.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write_csv(&self, path: &Path) -> Result<(), RecordingError> {
        Ok(atomic_file::write(path, self.to_csv().as_bytes())?)
    }

    /// Columns of sensors that lack readings; by row, whether one is missing there.
    pub(super) fn missing_columns(&self) -> &[(String, Vec<bool>)] {
        &self.missing
    }

    pub(super) fn with_missing(self, missing: Vec<(String, Vec<bool>)>) -> Self {
        Self { missing, ..self }
    }

    /// Tells whether its times are whole seconds from row to row that nobody but the column's name says to be seconds: they may be a count of
    /// rows as well, which the readings tell.
    pub fn may_count_rows(&self) -> bool {
        self.may_count_rows
    }

    pub(super) fn that_may_count_rows(self) -> Self {
        Self { may_count_rows: true, ..self }
    }

    pub(super) fn with_file_units(self, file_units: Vec<FileUnit>) -> Self {
        Self { file_units, ..self }
    }

    pub(super) fn with_notes(mut self, notes: Vec<String>) -> Self {
        self.notes.extend(notes);
        self
    }

    /// Puts a remark on the file as a whole before all others.
    pub(super) fn with_first_note(mut self, note: Option<String>) -> Self {
        self.notes.splice(..0, note);
        self
    }

    /// The recording that samples were brought to; ranges of columns are for the caller to check.
    pub(super) fn from_rows(file: &str, rows: Rows) -> Result<Self, RecordingError> {
        let Rows { time_s, columns, measured, missing, sampling_s, header_line } = rows;
        if time_s.is_empty() {
            return Err(CsvError::NoRows { file: file.to_owned() }.into());
        }
        let measured = if measured.iter().all(|measured| *measured) { Vec::new() } else { measured };
        let segments = rules::segments(&time_s);
        Ok(Self {
            source: file.to_owned(),
            header_line,
            time_s,
            columns,
            segments,
            measured,
            missing,
            sampling_s,
            asked: Asked::Rig,
            notes: Vec::new(),
            file_units: Vec::new(),
            may_count_rows: false,
        })
    }

    fn require_one(&self, name: &str) -> Result<&[f64], RecordingError> {
        let column = self.columns.iter().find(|column| column.name == name);
        match column.map(|column| &column.data) {
            Some(ColumnData::Numbers(numbers)) => Ok(numbers),
            Some(ColumnData::Text(_)) => {
                Err(RecordingError::TextColumn { file: self.source.clone(), column: name.to_owned() })
            }
            None if self.asked == Asked::Rig => Err(RecordingError::NotMapped {
                file: self.source.clone(),
                line: self.header_line,
                column: name.to_owned(),
                found: csv::listed(std::iter::once(csv::TIME_COLUMN).chain(self.names())),
                mend: self.where_it_may_be(name),
            }),
            None => Err(CsvError::MissingColumn {
                file: self.source.clone(),
                line: self.header_line,
                column: name.to_owned(),
                found: csv::listed(std::iter::once(csv::TIME_COLUMN).chain(self.names())),
            }
            .into()),
        }
    }

    /// The key for a column of another name; and what was left out of the file, which may be what is missed.
    fn where_it_may_be(&self, name: &str) -> String {
        let key = format!("where it has another name say so in the rig file: [recording] columns.{name} = \"…\"");
        let left_out = self.notes.iter().filter(|note| note.contains("left out") || note.contains("cut short"));
        std::iter::once(&key).chain(left_out).map(String::as_str).collect::<Vec<_>>().join("; ")
    }

    fn from_table(file: &str, table: Table) -> Result<Self, RecordingError> {
        let segments = rules::check(file, &table)?;
        Ok(Self {
            source: file.to_owned(),
            header_line: None,
            time_s: table.time_s,
            columns: table.columns,
            segments,
            measured: Vec::new(),
            missing: Vec::new(),
            sampling_s: PERIOD_S,
            asked: Asked::File,
            notes: Vec::new(),
            file_units: Vec::new(),
            may_count_rows: false,
        })
    }
}
