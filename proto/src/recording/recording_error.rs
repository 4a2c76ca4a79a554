//! Why something is no recording.

use crate::atomic_file::AtomicFileError;
use crate::recording::csv::CsvError;
use crate::recording::mcap_file::reader::ReadMcapError;

/// Problem of a recording.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The file cannot be read.
    #[error("{file}: cannot read the recording: {source}")]
    Read {
        /// The file.
        file: String,
        /// Error of the system.
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
        hint: String,
    },
    /// The file is of a kind that is not read.
    #[error("{file}: {what}; {mend}")]
    Kind {
        /// The file.
        file: String,
        /// Kind of the file.
        what: String,
        /// Way to get at what is in it.
        mend: String,
    },
    /// A column is not there that a rig needs, or under another name.
    #[error("{file}: {}column {column} is missing; there are {found}; {mend}", .line.map(|line| format!("line {line}: ")).unwrap_or_default())]
    NotMapped {
        /// The file.
        file: String,
        /// Line of the header, from 1; none where there is no file of lines.
        line: Option<u64>,
        /// The missing column.
        column: String,
        /// The columns that are there.
        found: String,
        /// The key of the rig file that would help.
        mend: String,
    },
    /// Times whose steps only another unit explains.
    #[error("{file}: rows are {median_ms} ms apart (median of {column}, taken as s); {mend}")]
    TimeUnit {
        /// The file.
        file: String,
        /// Column of times.
        column: String,
        /// Their median step (ms).
        median_ms: f64,
        /// Unit that they seem to be in, and the key of the rig file that would help.
        mend: String,
    },
    /// A unit that a column cannot have.
    #[error("{file}: column {column}: {problem}")]
    Unit {
        /// The file.
        file: String,
        /// The column.
        column: String,
        /// Problem, and the mend.
        problem: String,
    },
    /// Times of writing instead of reading.
    #[error(
        "{file}: {column}: rows come in bursts, {rows} at a time, {step_ms:.1} ms apart, every {every_ms:.0} ms: these seem to be the times of writing, not of reading; say how far apart rows were read in the rig file, [recording] period_ms = {period_ms:.1}, or keep one row of each burst"
    )]
    Bursts {
        /// The file.
        file: String,
        /// The column of times.
        column: String,
        /// Rows of a burst.
        rows: usize,
        /// Distance of rows within it (ms).
        step_ms: f64,
        /// Distance of bursts (ms).
        every_ms: f64,
        /// Distance of rows that are laid out evenly (ms).
        period_ms: f64,
    },
    /// Samples too far apart to be a recording.
    #[error("{file}: samples are {step_s} s apart (median of {column}), more than {most_s} s; {mend}")]
    TooSparse {
        /// The file.
        file: String,
        /// Column of times.
        column: String,
        /// Their median step (s).
        step_s: f64,
        /// The most that is read (s).
        most_s: f64,
        /// The key of the rig file that would help.
        mend: String,
    },
    /// A column that the caller needs is a column of text.
    #[error("{file}: column {column} holds text; numbers are needed")]
    TextColumn {
        /// The file or where the recording comes from.
        file: String,
        /// The column.
        column: String,
    },
    /// A column of a file begins with text where numbers are needed.
    #[error(
        "{file}: column {column} holds text, \"{cell}\" in line {line}; numbers are needed: leave out rows without a reading, or name another column in [recording]"
    )]
    TextCells {
        /// The file.
        file: String,
        /// The column.
        column: String,
        /// Line of its first cell, from 1.
        line: u64,
        /// Cell as it stands there.
        cell: String,
    },
    /// A sensor has readings in other rows than the rest.
    #[error(
        "{file}: column {column} has readings in other rows than the other sensors ({spans}), and a run begins where all have been read; \
         where its readings stand under another title there, name that with [recording] columns.{column}, else give a file in which all are \
         read for some seconds, or a rig file without the sensors that are not"
    )]
    NeverTogether {
        /// The file.
        file: String,
        /// The column.
        column: String,
        /// Each sensor with the times from which to which it has readings.
        spans: String,
    },
    /// Columns of different lengths were put together.
    #[error("{file}: column {column} has {found} rows, time_s has {expected}")]
    ColumnLength {
        /// Where the recording comes from.
        file: String,
        /// The column.
        column: String,
        /// Rows in it.
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
