//! One recording: the columns that a rig needs, as numbers.

use std::ops::Range;
use std::sync::Arc;

use proto::recording::{FileUnit, PERIOD_S};

use super::bridged::lines_over;

/// Rows in which a valve may move as of commands that were given before: 0.5 s, a delay of 100 ms and a lag of 130 ms three times over.
const LEAD_ROWS: usize = 25;
/// Ratio of a segment to its lead, at least.
const SHARE_OF_A_LEAD: usize = 4;

/// One recording: commands and readings, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    /// The file it comes from.
    pub source: String,
    /// Time of each row in s.
    pub time_s: Vec<f64>,
    /// Time at which the file begins in s, of which this may be a part.
    pub begun_s: f64,
    /// Commands by input of the rig, then by row.
    pub inputs: Vec<Vec<f64>>,
    /// Commands of the rows before the first, where it is a later part of a recording.
    pub before: Earlier,
    /// Runs of rows without a gap; in order, never empty, together all rows.
    pub segments: Vec<Range<usize>>,
    /// By row, whether a sample was taken there; empty where one was in all. Readings elsewhere are straight lines between
    /// samples and no evidence.
    pub measured: Vec<bool>,
    /// By channel and row, whether a reading is missing or left out there although the rest of the row counts; empty for a channel where
    /// none is. What stands there is a straight line.
    pub missing: Vec<Vec<bool>>,
    /// Usual distance of samples in s, 20 ms at least: nothing that is faster can be told.
    pub sampling_s: f64,
    /// Revolutions by which the pump's crank stood past its zero at the first row. No column tells it; zero until the
    /// pump's ripple has ([`crate::simulate::Tachometer`]).
    pub crank_rev: f64,
    /// Units, other than the rig's, that the file or its map says of its columns, and by which they were read.
    pub file_units: Vec<FileUnit>,
}

/// Commands and readings that went before a part of a recording.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Earlier {
    /// All commands of the recording that it is a part of, by input: shared by its parts.
    whole: Arc<Vec<Vec<f64>>>,
    /// All readings of it in kPa, by channel.
    readings_kpa: Arc<Vec<Vec<f64>>>,
    /// Number of rows of these that are before the part.
    rows: usize,
    /// Number of those, the last ones, that lead to the part without a gap.
    leading: usize,
}

impl Earlier {
    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// The command of one of them.
    pub fn command(&self, input: usize, row: usize) -> Option<f64> {
        self.whole.get(input)?.get(..self.rows)?.get(row).copied()
    }

    /// Number of rows that lead to the part without a gap.
    pub fn leading(&self) -> usize {
        self.leading
    }

    /// The reading of a channel `rows` before the part (1 is the row before it), in kPa.
    pub fn reading_kpa(&self, channel: usize, rows: usize) -> Option<f64> {
        self.readings_kpa.get(channel)?.get(self.rows.checked_sub(rows)?).copied()
    }

    /// These rows and `rows` more, of which `leading` are without a gap.
    pub(super) fn and(self, rows: usize, leading: usize) -> Self {
        let leading = if leading == rows { self.leading + rows } else { leading };
        Earlier { rows: self.rows + rows, leading, ..self }
    }
}

impl Record {
    /// Rows before its first one, in the recording that it is a part of itself; `readings_kpa` are its own by channel.
    pub(super) fn earlier(&self, readings_kpa: impl FnOnce() -> Vec<Vec<f64>>) -> Earlier {
        if self.before.whole.is_empty() {
            let (whole, readings_kpa) = (Arc::new(self.inputs.clone()), Arc::new(readings_kpa()));
            Earlier { whole, readings_kpa, ..Earlier::default() }
        } else {
            self.before.clone()
        }
    }

    /// Number of rows that lead to `row` without a gap.
    pub(super) fn leading(&self, row: usize) -> usize {
        self.segments.iter().find(|s| s.start <= row && row < s.end).map_or(0, |segment| row - segment.start)
    }

    /// Number of rows that lead into a segment which begins at `row`: a valve that is late moves in them as of commands before them, which
    /// no simulation knows. None where those were known to be the same, or where no segment begins.
    pub fn lead_rows(&self, row: usize) -> usize {
        let held = row == 0 && self.before.leading() >= LEAD_ROWS && self.is_held_before();
        let segment = self.segments.iter().find(|segment| segment.start == row && !held);
        segment.map_or(0, |segment| LEAD_ROWS.min(segment.len() / SHARE_OF_A_LEAD))
    }

    /// Tells whether as many rows as a lead has were commanded before the first row as it is itself.
    fn is_held_before(&self) -> bool {
        let rows = self.before.rows().saturating_sub(LEAD_ROWS)..self.before.rows();
        let held = |(input, numbers): (usize, &Vec<f64>)| {
            rows.clone().all(|row| self.before.command(input, row).as_ref() == numbers.first())
        };
        self.inputs.iter().enumerate().all(held)
    }

    /// The unit, other than the rig's, that the file or its map says of a column.
    pub fn file_unit(&self, column: &str) -> Option<&FileUnit> {
        self.file_units.iter().find(|unit| unit.column == column)
    }

    /// Tells whether a sample was taken at a row.
    pub fn is_measured(&self, row: usize) -> bool {
        self.measured.get(row).copied().unwrap_or(true)
    }

    /// Tells whether a channel was read at a row, and its reading was not left out.
    pub fn is_read(&self, channel: usize, row: usize) -> bool {
        self.is_measured(row) && !self.is_missing(channel, row)
    }

    /// Tells whether a channel's reading is missing or left out at a row.
    pub fn is_missing(&self, channel: usize, row: usize) -> bool {
        self.missing.get(channel).and_then(|missing| missing.get(row)).copied().unwrap_or(false)
    }

    /// Puts straight lines in place of a channel's numbers by row where its readings are missing, none of them across a gap unless a
    /// stretch between two gaps lacks all of its readings.
    pub(crate) fn over_missing(&self, channel: usize, numbers: &mut [f64]) {
        let Some(missing) = self.missing.get(channel).filter(|missing| missing.contains(&true)) else { return };
        let mut across = numbers.to_vec();
        lines_over(&mut across, missing);
        for rows in &self.segments {
            let (Some(numbers), Some(missing)) = (numbers.get_mut(rows.clone()), missing.get(rows.clone())) else {
                continue;
            };
            match (missing.contains(&false), across.get(rows.clone())) {
                (false, Some(across)) => numbers.copy_from_slice(across),
                _ => lines_over(numbers, missing),
            }
        }
    }

    /// Tells whether samples are further apart than rows.
    pub fn is_sparse(&self) -> bool {
        self.sampling_s > 1.5 * PERIOD_S
    }

    /// Seconds from the file's beginning to a row.
    pub fn elapsed_s(&self, row: usize) -> f64 {
        self.time_s.get(row).map_or(0.0, |time_s| time_s - self.begun_s)
    }
}

/// Tells whether a relay's command switches its pump on, as plants take it.
pub(super) fn is_on(relay: f64) -> bool {
    relay >= 0.5
}
