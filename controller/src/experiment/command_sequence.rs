//! A sequence of commands: `time_s,u_pos,u_neg,pump_on`, a row every 20 ms, two minutes at most.
//!
//! Such a sequence is planned by `trainer diagnose` as `next_experiment.csv`. Reading it is reading a recording
//! ([`proto::recording::Recording`]) without readings, and then stricter: no gap, no jitter, no more than
//! [`LONGEST_ROWS`] rows. Other columns are passed over, so an old recording's commands can be played again.

use std::path::Path;

use model::observation::Pair;
use proto::recording::csv::{CsvError, Table};
use proto::recording::{PERIOD_S, Recording, RecordingError};
use proto::regular_file;

/// The longest sequence: 120 s.
pub const LONGEST_ROWS: usize = 6_000;
/// Distance by which a row's time may be off the 20 ms grid, in s: what rounding to milliseconds does.
const OFF_GRID_S: f64 = 1.1e-3;
/// The largest file that is read, in bytes: the 6,000 rows of two minutes are below 1 MB.
const MOST_BYTES: u64 = 32 << 20;
/// Stretches that are named before the rest is only counted.
const NAMED: usize = 3;

/// The commands of one tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// Duties, positive and negative valve.
    pub duty: Pair,
    /// True where the pump runs.
    pub pump_on: bool,
}

/// A sequence that has been checked.
#[derive(Debug, Clone, PartialEq)]
pub struct CommandSequence {
    source: String,
    bytes: Vec<u8>,
    rows: Vec<Row>,
    lines: Vec<u64>,
}

/// Reason why a sequence cannot be played.
#[derive(Debug, thiserror::Error)]
pub enum CommandSequenceError {
    /// It is no table of numbers in range, or not at 50 Hz.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// A row stands off the 20 ms grid.
    #[error(
        "{file}: line {line}, column {position} (time_s): {found} s where {expected} s is due; rows are played 20 ms apart: fill the gap or leave the row out"
    )]
    OffGrid {
        /// The file.
        file: String,
        /// Line, from 1.
        line: u64,
        /// Column, from 1.
        position: usize,
        /// Time (s).
        found: f64,
        /// The time of its place (s).
        expected: f64,
    },
    /// It lasts too long.
    #[error(
        "{file}: line {line}: {seconds:.2} s of commands; an experiment lasts 120 s at most: cut the file before this line"
    )]
    TooLong {
        /// The file.
        file: String,
        /// The first line that is too much.
        line: u64,
        /// Duration (s).
        seconds: f64,
    },
    /// The pump is to be switched and cannot be.
    #[error(
        "{file}: {stretches}: pump_on is 0, and the pump of rig {rig} has no relay; leave these rows out, or name the relay in the rig file (relay = \"pump_on\" under its pump)"
    )]
    NoRelay {
        /// The file.
        file: String,
        /// The rows, as [`CommandSequence::pump_off`] names them.
        stretches: String,
        /// The model's rig.
        rig: String,
    },
}

impl CommandSequence {
    /// Reads a sequence and checks all of it.
    ///
    /// # Errors
    /// The first thing that is wrong, in one line with file, line and column.
    pub fn read(path: &Path) -> Result<Self, CommandSequenceError> {
        let file = path.display().to_string();
        let bytes = regular_file::read(path, MOST_BYTES)
            .map_err(|source| RecordingError::Read { file: file.clone(), source })?;
        Self::parse(&file, bytes)
    }

    /// Parses a sequence; `file` is the name that errors carry.
    ///
    /// # Errors
    /// As [`CommandSequence::read`].
    pub fn parse(file: &str, bytes: Vec<u8>) -> Result<Self, CommandSequenceError> {
        let recording = Recording::parse_csv(file, &bytes)?;
        let [u_pos, u_neg] = recording.require(["u_pos", "u_neg"])?;
        // Without the column the pump runs, as everywhere.
        let pump = if recording.names().any(|name| name == "pump_on") {
            recording.require(["pump_on"])?[0].to_vec()
        } else {
            vec![1.0; recording.rows()]
        };
        let rows: Vec<Row> = u_pos
            .iter()
            .zip(u_neg)
            .zip(pump)
            .map(|((pos, neg), pump)| Row { duty: [*pos, *neg], pump_on: pump != 0.0 })
            .collect();
        // Once more for the numbers of the lines, which a recording does not keep.
        let table = Table::parse(file, &bytes, &[]).map_err(|error: CsvError| RecordingError::from(error))?;
        let sequence = CommandSequence { source: file.to_owned(), rows, lines: table.lines, bytes };
        sequence.check_times(recording.time_s(), table.time_position)?;
        Ok(sequence)
    }

    fn check_times(&self, time_s: &[f64], position: usize) -> Result<(), CommandSequenceError> {
        let start = time_s.first().copied().unwrap_or(0.0);
        for (row, found) in time_s.iter().enumerate() {
            let expected = start + row as f64 * PERIOD_S;
            if (found - expected).abs() > OFF_GRID_S {
                let expected = (expected * 1e3).round() / 1e3;
                let (file, line) = (self.source.clone(), self.line(row));
                return Err(CommandSequenceError::OffGrid { file, line, position, found: *found, expected });
            }
        }
        if self.rows.len() > LONGEST_ROWS {
            return Err(CommandSequenceError::TooLong {
                file: self.source.clone(),
                line: self.line(LONGEST_ROWS),
                seconds: self.seconds(),
            });
        }
        Ok(())
    }

    /// The file's name as it was given.
    pub fn source(&self) -> &str {
        &self.source
    }

    /// The file's bytes.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The rows.
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// Duration in s.
    pub fn seconds(&self) -> f64 {
        self.rows.len() as f64 * PERIOD_S
    }

    /// Line of a row in the file, from 1.
    pub fn line(&self, row: usize) -> u64 {
        self.lines.get(row).copied().unwrap_or(row as u64 + 2)
    }

    /// The rows with the pump off, by lines; `None` where it always runs.
    pub fn pump_off(&self) -> Option<String> {
        let mut stretches: Vec<[usize; 2]> = Vec::new();
        for (row, _) in self.rows.iter().enumerate().filter(|(_, row)| !row.pump_on) {
            match stretches.last_mut() {
                Some(last) if last[1] + 1 == row => last[1] = row,
                _ => stretches.push([row, row]),
            }
        }
        let off = self.rows.iter().filter(|row| !row.pump_on).count() as f64 * PERIOD_S;
        let named: Vec<String> = stretches
            .iter()
            .take(NAMED)
            .map(|[first, last]| format!("{}-{}", self.line(*first), self.line(*last)))
            .collect();
        let more = stretches.len().saturating_sub(NAMED);
        let more = match more {
            0 => String::new(),
            1 => " and 1 stretch more".to_owned(),
            more => format!(" and {more} stretches more"),
        };
        (!named.is_empty()).then(|| format!("lines {}{more} ({off:.2} s)", named.join(", ")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<CommandSequence, String> {
        CommandSequence::parse("e.csv", text.as_bytes().to_vec()).map_err(|error| error.to_string())
    }

    /// Rows of a good file, with one line written over.
    fn with(line: usize, text: &str) -> String {
        let mut lines = vec!["time_s,u_pos,u_neg,pump_on".to_owned()];
        lines.extend((0..50).map(|k| format!("{:.2},0.8,0.75,1", f64::from(k) * 0.02)));
        lines[line - 1] = text.to_owned();
        lines.join("\n") + "\n"
    }

    #[test]
    fn commands_come_through_bit_for_bit() {
        let sequence = parse(&with(3, "0.02,0.1234567890123,1,0")).unwrap();
        assert_eq!(sequence.rows().len(), 50);
        assert_eq!(sequence.rows()[1], Row { duty: [0.123_456_789_012_3, 1.0], pump_on: false });
        assert_eq!(sequence.pump_off().unwrap(), "lines 3-3 (0.02 s)");
        let switched = |times: usize| {
            let row = |k: usize| {
                format!("{:.2},0.8,0.75,{}\n", k as f64 * 0.02, u8::from(k.is_multiple_of(2) || k > 2 * times))
            };
            parse(&("time_s,u_pos,u_neg,pump_on\n".to_owned() + &(0..50).map(row).collect::<String>())).unwrap()
        };
        assert!(switched(NAMED + 1).pump_off().unwrap().contains(" and 1 stretch more ("));
        assert!(switched(NAMED + 2).pump_off().unwrap().contains(" and 2 stretches more ("));
        let without = parse("u_neg,time_s,u_pos,p_pos_kpa\n\n0.5,7.00,0.25,90\n0.5,7.02,0.25,90\n").unwrap();
        assert_eq!(without.rows()[1], Row { duty: [0.25, 0.5], pump_on: true });
        assert_eq!((without.pump_off(), without.line(1)), (None, 4));
    }

    #[test]
    fn bad_files_get_one_line_with_its_number() {
        let long = "time_s,u_pos,u_neg\n".to_owned()
            + &(0..6_500).map(|k| format!("{:.2},0.8,0.8\n", f64::from(k) * 0.02)).collect::<String>();
        for (text, words) in [
            (String::new(), vec!["empty"]),
            ("time_s,u_pos\n0,0.5\n".to_owned(), vec!["line 1", "u_neg", "missing"]),
            (with(7, "0.10,nan,0.75,1"), vec!["line 7", "column 2 (u_pos)", "0 … 1"]),
            (with(7, "0.10,0.8,1.02,1"), vec!["line 7", "column 3 (u_neg)", "1.02", "0 … 1"]),
            (with(7, "0.10,80,0.75,1"), vec!["line 7", "column 2 (u_pos)", "percentage"]),
            (with(7, "0.10,0.8,0.75,0.5"), vec!["line 7", "column 4 (pump_on)", "on (1) or off (0)"]),
            (with(7, "0.07,0.8,0.75,1"), vec!["line 7", "column 1 (time_s)", "does not come after"]),
            (with(7, "0.11,0.8,0.75,1"), vec!["line 7", "column 1 (time_s)", "0.11 s", "0.1 s", "20 ms"]),
            (with(7, "0.10,0.8,0.75"), vec!["line 7", "3 cells"]),
            (with(51, "9.00,0.8,0.75,1"), vec!["line 51", "9 s", "0.98 s", "fill the gap"]),
            (long, vec!["line 6002", "130.00 s", "120 s", "cut the file"]),
        ] {
            let message = parse(&text).unwrap_err();
            assert!(message.starts_with("e.csv: ") && !message.contains('\n'), "{message}");
            for word in words {
                assert!(message.contains(word), "`{word}` is not in: {message}");
            }
        }
        let ms = "time_s,u_pos,u_neg\n0,0.8,0.8\n20,0.8,0.8\n40,0.8,0.8\n";
        assert!(parse(ms).unwrap_err().contains("milliseconds"));
    }
}
