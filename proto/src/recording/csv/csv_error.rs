//! Problems of a CSV file: one plain line each, with file, line and column.
//!
//! Lines and columns count from 1, as an editor shows them; blank lines count.

/// Problem of a CSV file, and its place.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum CsvError {
    /// Nothing in it.
    #[error("{file}: the file is empty; it needs a header line beginning with time_s, then one row per tick")]
    Empty {
        /// The file.
        file: String,
    },
    /// A header and no rows.
    #[error("{file}: there is a header line but no row of data below it")]
    NoRows {
        /// The file.
        file: String,
    },
    /// Bytes that are not UTF-8.
    #[error("{file}: line {line}, column {position}: not UTF-8 text; save the file as UTF-8 CSV")]
    NotUtf8 {
        /// The file.
        file: String,
        /// Line, from 1.
        line: u64,
        /// Column, from 1.
        position: usize,
    },
    /// The header separates by something else.
    #[error("{file}: line {line}: columns are separated by {separator}; use commas (and points in numbers)")]
    Separator {
        /// The file.
        file: String,
        /// Line of the header, from 1.
        line: u64,
        /// Separator, in words.
        separator: &'static str,
    },
    /// The first line holds numbers.
    #[error(
        "{file}: line {line}: \"{cell}\" is a number; the first line must name the columns, beginning with time_s{mend}"
    )]
    NoHeader {
        /// The file.
        file: String,
        /// Line of the header, from 1.
        line: u64,
        /// The number found.
        cell: String,
        /// Further mend, or nothing.
        mend: &'static str,
    },
    /// A needed column is not there.
    #[error("{file}: {}column {column} is missing; there are {found}", .line.map(|line| format!("line {line}: ")).unwrap_or_default())]
    MissingColumn {
        /// The file.
        file: String,
        /// Line of the header, from 1; none where there is no file of lines.
        line: Option<u64>,
        /// The missing column.
        column: String,
        /// The columns that are there.
        found: String,
    },
    /// A name stands twice.
    #[error(
        "{file}: line {line}, column {position}: {column} stands here a second time; every column needs a name of its own{mend}"
    )]
    DuplicateColumn {
        /// The file.
        file: String,
        /// Line of the header, from 1.
        line: u64,
        /// Column, from 1.
        position: usize,
        /// Name of the column.
        column: String,
        /// Further mend, or nothing.
        mend: String,
    },
    /// A column without a name.
    #[error("{file}: line {line}, column {position}: the column has no name")]
    UnnamedColumn {
        /// The file.
        file: String,
        /// Line of the header, from 1.
        line: u64,
        /// Column, from 1.
        position: usize,
    },
    /// A row with too few or too many cells.
    #[error("{file}: line {line}: {found} cells where the header has {expected} columns{hint}")]
    Ragged {
        /// The file.
        file: String,
        /// Line, from 1.
        line: u64,
        /// Cells in the row.
        found: usize,
        /// Columns in the header.
        expected: usize,
        /// A guess at the reason and the mend, or nothing.
        hint: String,
    },
    /// A cell that is no number.
    #[error("{file}: line {line}, column {position} ({column}): \"{cell}\" is not a number{}", no_number_mend(.cell))]
    NotANumber {
        /// The file.
        file: String,
        /// Line, from 1.
        line: u64,
        /// Column, from 1.
        position: usize,
        /// Name of the column.
        column: String,
        /// Cell as it stands there.
        cell: String,
    },
    /// NaN or infinity.
    #[error(
        "{file}: line {line}, column {position} ({column}): {cell} is not a finite number; {}", not_finite_mend(.column)
    )]
    NotFinite {
        /// The file.
        file: String,
        /// Line, from 1.
        line: u64,
        /// Column, from 1.
        position: usize,
        /// Name of the column.
        column: String,
        /// Cell as it stands there.
        cell: String,
    },
    /// A number outside what its column may hold.
    #[error("{file}: line {line}, column {position} ({column}): {value} is outside {}{hint}", limits(*.low, *.high))]
    OutOfRange {
        /// The file.
        file: String,
        /// Line, from 1.
        line: u64,
        /// Column, from 1.
        position: usize,
        /// Name of the column.
        column: String,
        /// Cell as it stands there.
        value: f64,
        /// Least allowed value.
        low: f64,
        /// Largest allowed value.
        high: f64,
        /// A guess at the reason, or nothing.
        hint: String,
    },
    /// Time that does not go forward.
    #[error(
        "{file}: line {line}, column {position} ({column}): {} s does not come after {} s in the row before; {}", to_a_microsecond(*.value), to_a_microsecond(*.previous), not_forward_mend(*.value, *.previous)
    )]
    TimeNotForward {
        /// The file.
        file: String,
        /// Line, from 1.
        line: u64,
        /// Column, from 1.
        position: usize,
        /// Name of the column.
        column: String,
        /// Time of this row (s).
        value: f64,
        /// Time of the row before (s).
        previous: f64,
    },
    /// Rows that are out of order, and in order by their times.
    #[error(
        "{file}: line {line}, column {position} ({column}): {} s does not come after {} s in the row before; rows are out of order: sort them by {column}", to_a_microsecond(*.value), to_a_microsecond(*.previous)
    )]
    OutOfOrder {
        /// The file.
        file: String,
        /// Line, from 1.
        line: u64,
        /// Column, from 1.
        position: usize,
        /// Name of the column.
        column: String,
        /// Time of this row (s).
        value: f64,
        /// Time of the row before (s).
        previous: f64,
    },
    /// Times that begin anew: sorted, rows of different moments would be mixed.
    #[error(
        "{file}: line {line}, column {position} ({column}): {} s does not come after {} s in the row before{}: the clock was set back, or another run begins; where rows go on at one distance, say it in the rig file: [recording] period_ms = {period_ms:?}; where another run begins, make a file of each", to_a_microsecond(*.value), to_a_microsecond(*.previous), more_places(*.places)
    )]
    ClockSetBack {
        /// The file.
        file: String,
        /// Line, from 1.
        line: u64,
        /// Column, from 1.
        position: usize,
        /// Name of the column.
        column: String,
        /// Time of this row (s).
        value: f64,
        /// Time of the row before (s).
        previous: f64,
        /// Rows whose time is before that of the row before.
        places: usize,
        /// Usual distance of rows (ms).
        period_ms: f64,
    },
    /// A LabVIEW segment that its clock puts before the end of the one before.
    #[error(
        "{file}: line {line}: by the clock in its head, {clock}, the segment that begins here starts {} s before the one before it ends: the clock was set back{mend}; make a file of each segment, or put the right Date and Time into the heads from this one on", to_a_microsecond(*.early_s)
    )]
    SegmentClock {
        /// The file.
        file: String,
        /// Line of the segment's names, from 1.
        line: u64,
        /// Date and time in its head.
        clock: String,
        /// Time by which it begins too early (s).
        early_s: f64,
        /// A guess at the reason, or nothing.
        mend: &'static str,
    },
    /// Cells in the head of a LabVIEW segment that may be those of other channels.
    #[error(
        "{file}: line {line}: the {what} {found} do not say which of the channels {channels} each belongs to: {why}; write each in the column of its channel, or {instead}"
    )]
    ChannelCells {
        /// The file.
        file: String,
        /// Line of the cells, from 1.
        line: u64,
        /// Meaning of the cells, in words.
        what: &'static str,
        /// The cells.
        found: String,
        /// Names of the channels.
        channels: String,
        /// The reason.
        why: String,
        /// Another mend.
        instead: &'static str,
    },
    /// A second header that names other columns than the first, or other units.
    #[error(
        "{file}: line {line}: another header begins here: {found} where the first has {expected}; make a file of each"
    )]
    AnotherHeader {
        /// The file.
        file: String,
        /// Line of the second header or of its units, from 1.
        line: u64,
        /// Cells of it that differ.
        found: String,
        /// Cells of the first in their place.
        expected: String,
    },
    /// A column whose cells have several units.
    #[error("{file}: line {line}, column {position} ({column}): units change in this line ({units}); write one unit")]
    UnitsChange {
        /// The file.
        file: String,
        /// Line of the first cell that has another unit, or none, from 1.
        line: u64,
        /// Column, from 1.
        position: usize,
        /// Name of the column.
        column: String,
        /// The first cell's unit and the other one.
        units: String,
    },
    /// A second column of times whose rows are not those of the first.
    #[error(
        "{file}: {}column {position} ({column}): a second clock: this column and those to the right of it fill {own} rows and {first}, the time, fills {rows}, so that a row is not one moment; {why}; make a file of each clock", .line.map(|line| format!("line {line}, ")).unwrap_or_default()
    )]
    SecondClock {
        /// The file.
        file: String,
        /// Line of the header, from 1; none where there is none.
        line: Option<u64>,
        /// Column, from 1.
        position: usize,
        /// Name of the column.
        column: String,
        /// Rows that it fills.
        own: usize,
        /// Name of the first column of times.
        first: String,
        /// Rows that the first fills.
        rows: usize,
        /// The reason for which the two cannot be brought together.
        why: &'static str,
    },
    /// Channels with times of their own that cannot be brought together.
    #[error(
        "{file}: line {line}, column {position}: this column of times is another than the first, and cannot be brought together with it: a cell is no number, or times do not go forward; write one file per channel, or all channels at one rate"
    )]
    SeveralTimes {
        /// The file.
        file: String,
        /// Line of the header, from 1.
        line: u64,
        /// Column, from 1.
        position: usize,
    },
    /// Times that are too coarse to tell rows apart.
    #[error(
        "{file}: line {line}, column {position} ({column}): {repeats} rows have the time of the row before, the first here: the times are rounded; write them finer, or say the distance of rows in the rig file: [recording] period_ms = …"
    )]
    CoarseTimes {
        /// The file.
        file: String,
        /// Line of the first that repeats a time, from 1.
        line: u64,
        /// Column, from 1.
        position: usize,
        /// Name of the column.
        column: String,
        /// Rows that do.
        repeats: usize,
    },
    /// A cell that is no time.
    #[error(
        "{file}: line {line}, column {position} ({column}): \"{cell}\" is neither a number nor a date or time of day that is known here; write s or 2026-03-29 01:59:00.020, or say the distance of rows in the rig file: [recording] period_ms = …"
    )]
    NotATime {
        /// The file.
        file: String,
        /// Line, from 1.
        line: u64,
        /// Column, from 1.
        position: usize,
        /// Name of the column.
        column: String,
        /// Cell as it stands there.
        cell: String,
    },
    /// A quote is opened and not closed.
    #[error(
        "{file}: line {line}, column {position}: the quote that opens here is never closed; close it, or double a quote that is meant to be text"
    )]
    OpenQuote {
        /// The file.
        file: String,
        /// Line, from 1.
        line: u64,
        /// Column, from 1.
        position: usize,
    },
    /// Something follows a closing quote.
    #[error(
        "{file}: line {line}, column {position}: text follows a closing quote; double a quote that is meant to be text"
    )]
    TextAfterQuote {
        /// The file.
        file: String,
        /// Line, from 1.
        line: u64,
        /// Column, from 1.
        position: usize,
    },
}

/// A time as one reads it (s): what arithmetic and single precision leave behind a microsecond is no part of it.
fn to_a_microsecond(time_s: f64) -> f64 {
    (time_s * 1e6).round() / 1e6
}

fn more_places(places: usize) -> String {
    if places > 1 { format!(", and so in {} further rows", places - 1) } else { String::new() }
}

/// Mend where a time does not come after the one before (s).
fn not_forward_mend(value: f64, previous: f64) -> &'static str {
    /// A clock that jumps back further than this was set, or a second run begins (s).
    const SET_BACK_S: f64 = 1.0;
    if previous - value > SET_BACK_S {
        "a second run begins here or the clock was set back: make two files of it"
    } else {
        "sort the rows and leave out repeated ones"
    }
}

/// Mend where a cell is no number.
fn no_number_mend(cell: &str) -> &'static str {
    if crate::recording::csv::numbers::says_nothing(cell) { "; leave out rows without a reading" } else { "" }
}

fn not_finite_mend(column: &str) -> &'static str {
    match column {
        "u_pos" | "u_neg" => "give every row a duty, 0 … 1",
        "pump_on" => "give every row a 0 or a 1",
        _ => "leave out rows without a reading",
    }
}

/// A range in words; there is no largest pressure.
fn limits(low: f64, high: f64) -> String {
    if high == f64::MAX { format!("{low} and above") } else { format!("{low} … {high}") }
}
