//! A recording as a table: times and named columns, whatever file it came from.
//!
//! Row *k* holds the reading at `t_k` and the command applied from `t_k` to `t_{k+1}`. Rows are
//! 20 ms apart. Two rules say how exactly:
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

use std::ops::Range;
use std::path::Path;

use super::csv::{self, Column, ColumnData, CsvError, Table};
use super::mcap_reader::{ReadMcapError, parse_mcap};
use super::mcap_writer::{Event, EventLevel, VERDICT};
use super::tick::TickRecord;
use crate::atomic_file::{self, AtomicFileError};

/// Nominal time between rows (s).
pub const PERIOD_S: f64 = 0.02;
/// The longest step within a segment (s); beyond it is a gap.
pub const MAX_STEP_S: f64 = 0.03;

/// The least that a reading of a gauge pressure may be (kPa): no pressure is below vacuum, but a line that rings, or a zero that is
/// off, is read there. Beyond it lie the usual vacuums in mbar, hPa, mmHg and Pa.
const LEAST_READING_KPA: f64 = -200.0;

/// Columns whose meaning is fixed: must be numbers, within (least, largest).
const KNOWN: [(&str, f64, f64); 7] = [
    ("u_pos", 0.0, 1.0),
    ("u_neg", 0.0, 1.0),
    ("p_pos_kpa", LEAST_READING_KPA, f64::MAX),
    ("p_neg_kpa", LEAST_READING_KPA, f64::MAX),
    ("ref_pos_kpa", -101.325, f64::MAX),
    ("ref_neg_kpa", -101.325, f64::MAX),
    ("pump_on", 0.0, 1.0),
];

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
    notes: Vec<String>,
}

/// What is wrong with a recording.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The file cannot be read.
    #[error("{file}: cannot read the recording: {source}")]
    Read {
        /// The file.
        file: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// The CSV content is wrong.
    #[error(transparent)]
    Csv(#[from] CsvError),
    /// The MCAP content is wrong.
    #[error(transparent)]
    Mcap(#[from] ReadMcapError),
    /// The rows have another rate.
    #[error("{file}: rows are {median_ms} ms apart (median of time_s); a recording has a row every 20 ms{hint}")]
    WrongRate {
        /// The file or where the recording comes from.
        file: String,
        /// Median step (ms).
        median_ms: f64,
        /// The mend.
        hint: &'static str,
    },
    /// A column that the caller needs is a column of text.
    #[error("{file}: column {column} holds text; numbers are needed")]
    TextColumn {
        /// The file or where the recording comes from.
        file: String,
        /// The column.
        column: String,
    },
    /// Columns of different lengths were put together.
    #[error("{file}: column {column} has {found} rows, time_s has {expected}")]
    ColumnLength {
        /// Where the recording comes from.
        file: String,
        /// The column.
        column: String,
        /// Its rows.
        found: usize,
        /// The rows of `time_s`.
        expected: usize,
    },
    /// No tick of an MCAP recording has a sound reading.
    #[error("{file}: none of the {ticks} recorded ticks has a sound reading and a command")]
    NoReadings {
        /// The file or where the recording comes from.
        file: String,
        /// Ticks in it.
        ticks: usize,
    },
    /// The recording cannot be written.
    #[error(transparent)]
    Write(#[from] AtomicFileError),
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
        Self::from_table(source, Table { time_s, columns, lines, time_position: 1, time: csv::TIME_COLUMN.to_owned() })
    }

    /// Reads a recording, MCAP or CSV: by its first bytes, whatever it is called.
    ///
    /// # Errors
    /// The file cannot be read, or its content is wrong: one line with file, line and column.
    pub fn read(path: &Path) -> Result<Self, RecordingError> {
        let file = path.display().to_string();
        let bytes = std::fs::read(path).map_err(|source| RecordingError::Read { file: file.clone(), source })?;
        let named_mcap = path.extension().is_some_and(|end| end.eq_ignore_ascii_case("mcap"));
        if bytes.starts_with(mcap::MAGIC) || named_mcap {
            let content = parse_mcap(&file, &bytes)?;
            let mut recording = Self::from_ticks(&file, &content.ticks)?;
            let unfinished = |event: &&Event| event.part == VERDICT && event.level == EventLevel::Error;
            let aborted = content.events.iter().filter(unfinished).map(|event| format!("{file}: {}", event.message));
            recording.notes.splice(0..0, content.notes.into_iter().chain(aborted));
            Ok(recording)
        } else {
            Self::parse_csv(&file, &bytes)
        }
    }

    /// Parses the bytes of a CSV recording; `file` is the name that errors carry.
    ///
    /// # Errors
    /// As [`Recording::read`].
    pub fn parse_csv(file: &str, bytes: &[u8]) -> Result<Self, RecordingError> {
        let names = KNOWN.map(|(name, ..)| name);
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
        super::from_ticks::recording(source, ticks)
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

    /// Stretches of rows without a gap: in order, none empty, together all rows.
    pub fn segments(&self) -> &[Range<usize>] {
        &self.segments
    }

    /// What a person should know, a line each: a truncated end, damaged chunks, left-out ticks, an aborted experiment.
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

    pub(super) fn with_notes(mut self, notes: Vec<String>) -> Self {
        self.notes.extend(notes);
        self
    }

    fn require_one(&self, name: &str) -> Result<&[f64], RecordingError> {
        let column = self.columns.iter().find(|column| column.name == name);
        match column.map(|column| &column.data) {
            Some(ColumnData::Numbers(numbers)) => Ok(numbers),
            Some(ColumnData::Text(_)) => {
                Err(RecordingError::TextColumn { file: self.source.clone(), column: name.to_owned() })
            }
            None => Err(CsvError::MissingColumn {
                file: self.source.clone(),
                line: self.header_line,
                column: name.to_owned(),
                found: csv::listed(std::iter::once(csv::TIME_COLUMN).chain(self.names())),
            }
            .into()),
        }
    }

    fn from_table(file: &str, table: Table) -> Result<Self, RecordingError> {
        check_names_and_numbers(file, &table)?;
        check_time(file, &table)?;
        for (name, low, high) in KNOWN {
            check_range(file, &table, name, low, high)?;
        }
        let segments = segments(&table.time_s);
        Ok(Self {
            source: file.to_owned(),
            header_line: None,
            time_s: table.time_s,
            columns: table.columns,
            segments,
            notes: Vec::new(),
        })
    }
}

/// What `Table::parse` sees to for files, for tables that did not come from one.
fn check_names_and_numbers(file: &str, table: &Table) -> Result<(), CsvError> {
    let mut seen = std::collections::HashSet::from([csv::TIME_COLUMN]);
    for (index, column) in table.columns.iter().enumerate() {
        let position = table.position(&column.name).unwrap_or(index + 2);
        if !seen.insert(&column.name) {
            return Err(CsvError::DuplicateColumn {
                file: file.to_owned(),
                line: 1,
                position: index + 2,
                column: column.name.clone(),
            });
        }
        if let ColumnData::Numbers(numbers) = &column.data {
            all_finite(file, table, numbers, &column.name, position)?;
        }
    }
    all_finite(file, table, &table.time_s, csv::TIME_COLUMN, table.time_position)
}

fn all_finite(file: &str, table: &Table, numbers: &[f64], name: &str, position: usize) -> Result<(), CsvError> {
    match numbers.iter().zip(&table.lines).find(|(number, _)| !number.is_finite()) {
        None => Ok(()),
        Some((number, line)) => Err(CsvError::NotFinite {
            file: file.to_owned(),
            line: *line,
            position,
            column: name.to_owned(),
            cell: number.to_string(),
        }),
    }
}

fn check_time(file: &str, table: &Table) -> Result<(), RecordingError> {
    if table.time_s.is_empty() {
        return Err(CsvError::NoRows { file: file.to_owned() }.into());
    }
    let pairs = table.time_s.iter().zip(table.time_s.iter().skip(1));
    for ((previous, value), line) in pairs.clone().zip(table.lines.iter().skip(1)) {
        if value <= previous {
            return Err(CsvError::TimeNotForward {
                file: file.to_owned(),
                line: *line,
                position: table.time_position,
                value: *value,
                previous: *previous,
            }
            .into());
        }
    }
    let mut steps: Vec<f64> = pairs.map(|(previous, value)| value - previous).collect();
    let middle = steps.len() / 2;
    if steps.is_empty() {
        return Ok(());
    }
    let (_, median, _) = steps.select_nth_unstable_by(middle, f64::total_cmp);
    let median_s = *median;
    if (median_s / PERIOD_S - 1.0).abs() <= 0.05 {
        return Ok(());
    }
    Err(RecordingError::WrongRate {
        file: file.to_owned(),
        // Three digits are enough to see what it is; the full f64 is noise in a message.
        median_ms: (median_s * 1e6).round() / 1e3,
        hint: time_hint(median_s),
    })
}

/// What 20 ms are taken for where `time_s` is not in seconds; the mend.
fn time_hint(median_s: f64) -> &'static str {
    const OTHERS: [(f64, &str); 6] = [
        (1e3, "; time_s seems to be in milliseconds: divide it by 1000"),
        (1e6, "; time_s seems to be in microseconds: divide it by 1e6"),
        (1e9, "; time_s seems to be in nanoseconds: divide it by 1e9"),
        (50.0, "; time_s seems to count rows: multiply it by 0.02"),
        (1.0 / 60.0, "; time_s seems to be in minutes: multiply it by 60"),
        (1.0 / 3600.0, "; time_s seems to be in hours: multiply it by 3600"),
    ];
    let taken_for = |(factor, _): &&(f64, &str)| (median_s / (factor * PERIOD_S) - 1.0).abs() <= 0.05;
    OTHERS.iter().find(taken_for).map_or("; resample it to 50 Hz", |(_, hint)| hint)
}

fn check_range(file: &str, table: &Table, name: &str, low: f64, high: f64) -> Result<(), CsvError> {
    let Some(numbers) = table.numbers(name) else { return Ok(()) };
    for (number, line) in numbers.iter().zip(&table.lines) {
        let wrong = !(low..=high).contains(number);
        let not_a_switch = name == "pump_on" && *number != 0.0 && *number != 1.0;
        if wrong || not_a_switch {
            return Err(CsvError::OutOfRange {
                file: file.to_owned(),
                line: *line,
                position: table.position(name).unwrap_or(0),
                column: name.to_owned(),
                value: *number,
                low,
                high,
                hint: match name {
                    "u_pos" | "u_neg" => "; a duty is a share, not a percentage",
                    "pump_on" => "; the pump is on (1) or off (0)",
                    // A vacuum of some tens of kPa, in units that are smaller.
                    _ if *number < -2_000.0 => "; pressures are gauge kPa, and this seems to be Pa",
                    _ if *number < -200.0 => "; pressures are gauge kPa, and this seems to be mbar, hPa or mmHg",
                    _ => "; pressures are gauge kPa, and nothing is so far below vacuum",
                },
            });
        }
    }
    Ok(())
}

/// Cuts the rows wherever a step is longer than [`MAX_STEP_S`].
fn segments(time_s: &[f64]) -> Vec<Range<usize>> {
    // A written 30 ms step may read back a rounding error longer.
    const SLACK_S: f64 = 1e-6;
    let mut segments = Vec::new();
    let mut start = 0;
    for (row, (previous, time)) in time_s.iter().zip(time_s.iter().skip(1)).enumerate() {
        if time - previous > MAX_STEP_S + SLACK_S {
            segments.push(start..row + 1);
            start = row + 1;
        }
    }
    segments.push(start..time_s.len());
    segments
}
