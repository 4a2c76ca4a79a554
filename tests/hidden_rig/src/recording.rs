//! Recordings: made on a rig, written as the project's CSV, and commands read from such files.
//!
//! Header `time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa`, with `pump_on` where the pump was ever off. Row k holds the reading
//! at t_k and the command from t_k on; gauge kPa; a row every 20 ms, stamped with the tenths of a millisecond by which
//! the reading was late.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use crate::excitation::Controller;
use crate::rng::Draws;
use crate::run::{Precision, Rig, Run, TICK_S, TICKS_PER_S};
use crate::sensor::Electronics;

/// A row of commands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Command {
    /// Duties.
    pub duty: [f64; 2],
    /// True where the pump is on.
    pub pump_on: bool,
}

/// Row of a recording: one tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// Time of the tick (s).
    pub time_s: f64,
    /// Lateness of the reading (s).
    pub late_s: f64,
    /// The command from here on.
    pub command: Command,
    /// The reading (kPa gauge), with noise and converter.
    pub read_kpa: [f64; 2],
    /// Readings of perfect electronics on the tick (kPa gauge): the trace to score against.
    pub clean_kpa: [f64; 2],
    /// Pressures in the chambers over the atmosphere (kPa).
    pub chamber_kpa: [f64; 2],
}

/// A recording.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Recording {
    /// Rows.
    pub rows: Vec<Row>,
}

/// Why a file cannot be used or written.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// It cannot be read.
    #[error("{}: cannot be read: {source}", file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// Error of the system.
        source: io::Error,
    },
    /// It cannot be written.
    #[error("{}: cannot be written: {source}", file.display())]
    Write {
        /// The file.
        file: PathBuf,
        /// Error of the system.
        source: io::Error,
    },
    /// It is no table.
    #[error("{}: no CSV table: {source}; commands are written as time_s,u_pos,u_neg,pump_on", file.display())]
    Table {
        /// The file.
        file: PathBuf,
        /// Error of the CSV reader.
        source: csv::Error,
    },
    /// A column is missing.
    #[error("{}: column {column} is missing; commands need time_s, u_pos and u_neg", file.display())]
    Column {
        /// The file.
        file: PathBuf,
        /// The column.
        column: &'static str,
    },
    /// A cell holds what it must not.
    #[error("{}: line {line}, column {column}: {text:?} {problem}", file.display())]
    Cell {
        /// The file.
        file: PathBuf,
        /// Line, from 1.
        line: usize,
        /// The column.
        column: &'static str,
        /// Text that stands there.
        text: String,
        /// Fault and its mend.
        problem: &'static str,
    },
    /// There are no rows.
    #[error("{}: no rows below the header; an experiment needs at least one", file.display())]
    Empty {
        /// The file.
        file: PathBuf,
    },
}

impl Recording {
    /// Runs commands on a rig that has settled at `start`; `draws` fix the noise.
    pub fn of_commands(rig: &Rig, start: [f64; 2], commands: &[Command], draws: Draws) -> Self {
        let mut run = Run::settled(rig, start, Precision::Fine);
        let mut electronics = Electronics::new(rig.noise, draws);
        let rows = commands.iter().map(|command| step(&mut run, &mut electronics, *command)).collect();
        Self { rows }
    }

    /// Follows references in closed loop, from a rig that has settled at `start`.
    pub fn of_references(rig: &Rig, start: [f64; 2], references_kpa: &[[f64; 2]], draws: Draws) -> Self {
        let mut run = Run::settled(rig, start, Precision::Fine);
        let mut electronics = Electronics::new(rig.noise, draws);
        let mut controller = Controller::at(start);
        let mut measured = run.clean_kpa();
        let rows = references_kpa
            .iter()
            .map(|goal| {
                // A controller works on the reading of the tick before: acquisition and sending take a while.
                let duty = controller.duties(*goal, measured);
                let row = step(&mut run, &mut electronics, Command { duty, pump_on: true });
                measured = row.read_kpa;
                row
            })
            .collect();
        Self { rows }
    }

    /// The commands.
    pub fn commands(&self) -> Vec<Command> {
        self.rows.iter().map(|row| row.command).collect()
    }

    /// The trace without noise (kPa gauge).
    pub fn clean_kpa(&self) -> Vec<[f64; 2]> {
        self.rows.iter().map(|row| row.clean_kpa).collect()
    }

    /// Reading minus truth (kPa), row by row.
    pub fn noise_kpa(&self) -> Vec<[f64; 2]> {
        let minus = |row: &Row| std::array::from_fn(|c| row.read_kpa[c] - row.clean_kpa[c]);
        self.rows.iter().map(minus).collect()
    }

    /// Lowest and highest clean pressure (kPa gauge), by channel.
    pub fn extremes_kpa(&self) -> [[f64; 2]; 2] {
        std::array::from_fn(|c| {
            self.rows.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], row| {
                [low.min(row.clean_kpa[c]), high.max(row.clean_kpa[c])]
            })
        })
    }

    /// The file that the diagnosis is given.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, file: &Path) -> Result<(), RecordingError> {
        self.write_with(file, &["p_pos_kpa", "p_neg_kpa"], |row| {
            let [pos, neg] = row.read_kpa;
            (row.time_s + row.late_s, format!("{pos:.4},{neg:.4}"))
        })
    }

    /// The file without noise, for the scorer: readings as perfect electronics give them, and the chambers' pressures.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write_clean(&self, file: &Path) -> Result<(), RecordingError> {
        self.write_with(file, &["p_pos_kpa", "p_neg_kpa", "chamber_pos_kpa", "chamber_neg_kpa"], |row| {
            let ([pos, neg], [chamber_pos, chamber_neg]) = (row.clean_kpa, row.chamber_kpa);
            (row.time_s, format!("{pos:.5},{neg:.5},{chamber_pos:.5},{chamber_neg:.5}"))
        })
    }

    fn write_with(
        &self,
        file: &Path,
        columns: &[&str],
        cells: impl Fn(&Row) -> (f64, String),
    ) -> Result<(), RecordingError> {
        let pump = self.rows.iter().any(|row| !row.command.pump_on);
        let mut text = format!("time_s,u_pos,u_neg,{}", columns.join(","));
        text.push_str(if pump { ",pump_on\n" } else { "\n" });
        for row in &self.rows {
            let (time_s, cells) = cells(row);
            let [u_pos, u_neg] = row.command.duty;
            text.push_str(&format!("{time_s:.4},{u_pos:.5},{u_neg:.5},{cells}"));
            if pump {
                text.push_str(if row.command.pump_on { ",1" } else { ",0" });
            }
            text.push('\n');
        }
        write_whole(file, text.as_bytes())
    }
}

/// Reads on the tick, then lets the command act for a tick.
fn step(run: &mut Run, electronics: &mut Electronics, command: Command) -> Row {
    let late_s = electronics.latency_s();
    let row = Row {
        time_s: run.time_s(),
        late_s,
        command,
        read_kpa: electronics.read_kpa(run.said_late_pa(late_s)),
        clean_kpa: run.clean_kpa(),
        chamber_kpa: run.chamber_kpa(),
    };
    run.tick(command.duty, command.pump_on);
    row
}

/// Commands of duties with the pump on.
pub fn pump_on(duties: &[[f64; 2]]) -> Vec<Command> {
    duties.iter().map(|duty| Command { duty: *duty, pump_on: true }).collect()
}

/// Reads commands from a CSV file with `time_s,u_pos,u_neg` and perhaps `pump_on`; other columns are left alone.
///
/// # Errors
/// The file cannot be read, lacks a column, holds text or duties outside 0 … 1, or its rows are not 20 ms apart.
pub fn read_commands(file: &Path) -> Result<Vec<Command>, RecordingError> {
    let bytes = fs::read(file).map_err(|source| RecordingError::Read { file: file.to_owned(), source })?;
    parse_commands(file, &bytes)
}

/// Commands from a file's bytes.
///
/// # Errors
/// See [`read_commands`].
pub fn parse_commands(file: &Path, bytes: &[u8]) -> Result<Vec<Command>, RecordingError> {
    let table = |source| RecordingError::Table { file: file.to_owned(), source };
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(bytes);
    let header = reader.headers().map_err(table)?.clone();
    let find = |column: &'static str| header.iter().position(|name| name.trim_start_matches('\u{feff}') == column);
    let require = |column: &'static str| find(column).ok_or(RecordingError::Column { file: file.to_owned(), column });
    let (time_at, pos_at, neg_at, pump_at) =
        (require("time_s")?, require("u_pos")?, require("u_neg")?, find("pump_on"));
    let mut commands = Vec::new();
    let mut last_s: Option<f64> = None;
    for (k, record) in reader.records().enumerate() {
        let record = record.map_err(table)?;
        let cell = |at: usize, column: &'static str, problem: &'static str, fits: &dyn Fn(f64) -> bool| {
            let text = record.get(at).unwrap_or_default();
            text.parse::<f64>().ok().filter(|value| fits(*value)).ok_or_else(|| RecordingError::Cell {
                file: file.to_owned(),
                line: k + 2,
                column,
                text: text.to_owned(),
                problem,
            })
        };
        let time_s = cell(time_at, "time_s", "is no 20 ms after the row before; rows are 20 ms apart", &|time_s| {
            time_s.is_finite() && last_s.is_none_or(|last_s| (time_s - last_s - TICK_S).abs() < 0.5 * TICK_S)
        })?;
        last_s = Some(time_s);
        let duty = |at, column| {
            cell(at, column, "is no duty; duties lie between 0 and 1", &|duty| (0.0..=1.0).contains(&duty))
        };
        let pump_on = match pump_at {
            None => true,
            Some(at) => cell(at, "pump_on", "is neither 0 nor 1", &|on| on == 0.0 || on == 1.0)? == 1.0,
        };
        commands.push(Command { duty: [duty(pos_at, "u_pos")?, duty(neg_at, "u_neg")?], pump_on });
    }
    if commands.is_empty() {
        return Err(RecordingError::Empty { file: file.to_owned() });
    }
    Ok(commands)
}

/// Number of ticks in a time.
pub fn ticks(seconds: f64) -> usize {
    (seconds * TICKS_PER_S).round().max(0.0) as usize
}

/// Writes a file so that it is there whole or not at all: aside, synced, renamed.
///
/// `proto` has the same, and more; this crate depends on nothing that depends on the model under test.
///
/// # Errors
/// The file cannot be written.
pub fn write_whole(file: &Path, bytes: &[u8]) -> Result<(), RecordingError> {
    let fail = |source| RecordingError::Write { file: file.to_owned(), source };
    if let Some(folder) = file.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        fs::create_dir_all(folder).map_err(fail)?;
    }
    let mut aside = file.as_os_str().to_owned();
    aside.push(format!(".{}.tmp", std::process::id()));
    let written = File::create(&aside).and_then(|mut open| {
        open.write_all(bytes)?;
        open.sync_all()?;
        fs::rename(&aside, file)
    });
    written.map_err(|source| {
        // The first error is the one to tell; a file that cannot be removed is only litter.
        let _ = fs::remove_file(&aside);
        fail(source)
    })
}
