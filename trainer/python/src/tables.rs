//! Open-loop simulation and recordings: columns by name, in and out.

use std::borrow::Cow;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::Arc;

use fit::data::quality::{seconds_are_no_count, within_ranges};
use free_run::refine::refined;
use free_run::{Began, FreeRun};
use model::plant::Plant;
use model::rig::{Rig, RigError};
use proto::recording::csv::{Column, ColumnData};
use proto::recording::{Recording, read_mcap, tick_table};
use proto::rig_file::RigFileError;
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;

use crate::{bytes_of, doubles, refused};

/// The name that errors carry where columns come from Python and from no file.
const SOURCE: &str = "columns";
/// Rows between two looks for Ctrl-C, in calls of the simulation (64 rows each).
const CALLS_PER_LOOK: u32 = 16;

/// Columns that cross the border: name and little-endian doubles.
type Numbers = Vec<(String, Cow<'static, [u8]>)>;

/// Simulated readings of a rig in open loop under given columns, `trainer simulate` but for the rounding of its file.
///
/// `time_s` and the rig's commands are needed; with pressures the run starts at the first row's, without at rest. Columns that
/// the rig does not ask for are passed over.
///
/// # Errors
/// `ValueError` with one line: the rig, or the column and row that is wrong. `KeyboardInterrupt` on Ctrl-C.
#[pyfunction]
pub(crate) fn simulate(
    py: Python<'_>,
    rig: &str,
    columns: Vec<(String, PyBackedBytes)>,
    refine: u32,
) -> PyResult<Numbers> {
    let file = rig;
    let mut rig = proto::rig_file::load(file).map_err(refused)?;
    rig.integrator.step_ms = refined(rig.integrator.step_ms, refine);
    let wrong = |problem: RigError| refused(RigFileError::Rig { file: file.to_owned(), problem });
    let plant = Arc::new(Plant::new(&rig).map_err(wrong)?);
    let recording = asked(&rig, &plant, &columns)?;
    within_ranges(&rig, std::slice::from_ref(&recording)).map_err(refused)?;
    let mut run = FreeRun::new(&rig, Arc::clone(&plant)).map_err(wrong)?;
    let mut calls = 0;
    let mut signals = Ok(());
    let advanced = |_rows: u64| {
        calls += 1;
        if calls % CALLS_PER_LOOK == 0 {
            signals = py.check_signals();
        }
        if signals.is_ok() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    };
    let trace = run.over(&recording, &Began::new(), advanced);
    signals?;
    let readings = trace.map_err(refused)?.readings_kpa;
    let out = |(name, values): (&String, Vec<f64>)| (name.clone(), Cow::Owned(bytes_of(values, f64::to_le_bytes)));
    Ok(plant.sensor_columns().iter().zip(readings).map(out).collect())
}

/// The columns that a rig asks for as a recording.
fn asked(rig: &Rig, plant: &Plant<f64>, columns: &[(String, PyBackedBytes)]) -> PyResult<Recording> {
    let find = |name: &str| columns.iter().find(|(known, _)| known == name).map(|(_, bytes)| doubles(bytes));
    let inputs = plant.inputs().iter().map(|input| &input.column);
    let needed = plant.inputs().iter().filter(|input| input.default.is_none()).map(|input| input.column.as_str());
    if let Some(missing) = ["time_s"].into_iter().chain(needed).find(|name| find(name).is_none()) {
        let takes: Vec<&str> = inputs.clone().map(String::as_str).collect();
        let given: Vec<&str> = columns.iter().map(|(name, _)| name.as_str()).collect();
        let (takes, given) = (takes.join(", "), given.join(", "));
        return Err(refused(format!("no column {missing}; rig {} takes time_s, {takes}; given: {given}", rig.name)));
    }
    let time_s = find("time_s").unwrap_or_default();
    if time_s.is_empty() {
        return Err(refused("no rows: the columns are empty"));
    }
    let signals = rig.signals();
    let mut made = Vec::new();
    for name in inputs.clone().chain(plant.sensor_columns()) {
        let Some(numbers) = find(name) else { continue };
        if numbers.len() != time_s.len() {
            return Err(refused(format!("{name} has {} numbers, time_s has {}", numbers.len(), time_s.len())));
        }
        let is_command = inputs.clone().any(|input| input == name) && !signals.contains(name);
        let wrong = |x: &f64| !x.is_finite() || (is_command && !(0.0..=1.0).contains(x));
        if let Some(row) = numbers.iter().position(wrong) {
            let holds = if is_command { "commands are within 0 … 1" } else { "it must be a number" };
            return Err(refused(format!("{name}[{row}] is {}; {holds}", numbers[row])));
        }
        made.push(Column { name: name.clone(), data: ColumnData::Numbers(numbers) });
    }
    Recording::new(SOURCE, time_s, made).map_err(refused)
}

/// A column that crosses the border: bytes of doubles, or texts.
#[derive(IntoPyObject)]
pub(crate) enum ColumnOut {
    /// Little-endian doubles.
    Numbers(Cow<'static, [u8]>),
    /// Texts.
    Texts(Vec<String>),
}

/// A recording as it crosses the border: columns by name, `time_s` first; a byte for each row, 1 where a sample was taken; what
/// the reader has to tell, a line each.
type Read = (Vec<(String, ColumnOut)>, Cow<'static, [u8]>, Vec<String>);

/// A recording for a rig, by the reader of the programs.
///
/// # Errors
/// `ValueError` with the reader's line: file, line or column, what is wrong, and the fix.
#[pyfunction]
pub(crate) fn read_recording(py: Python<'_>, file: PathBuf, rig: &str) -> PyResult<Read> {
    let rig = proto::rig_file::load(rig).map_err(refused)?;
    let recording = py.detach(|| Recording::read_for(&file, &rig)).map_err(refused)?;
    let alone = std::slice::from_ref(&recording);
    // Whoever only reads gets the numbers as they are, and what every command of `trainer` would refuse them for.
    let doubt = py.detach(|| within_ranges(&rig, alone).and_then(|()| seconds_are_no_count(&rig, alone))).err();
    let numbers = |values: &[f64]| ColumnOut::Numbers(Cow::Owned(bytes_of(values.iter().copied(), f64::to_le_bytes)));
    let mut columns = vec![("time_s".to_owned(), numbers(recording.time_s()))];
    for name in recording.names().filter(|name| *name != "time_s") {
        if let Some(values) = recording.column(name) {
            columns.push((name.to_owned(), numbers(values)));
        } else if let Some(texts) = recording.text_column(name) {
            columns.push((name.to_owned(), ColumnOut::Texts(texts.to_vec())));
        }
    }
    let every = vec![true; recording.rows()];
    let sensors: Vec<&[bool]> = rig.sensors.values().filter_map(|sensor| recording.missing(&sensor.column)).collect();
    let is_read = |row: usize| sensors.iter().all(|missing| !missing.get(row).copied().unwrap_or(false));
    let measured = recording.measured().unwrap_or(&every).iter().enumerate();
    let measured = measured.map(|(row, measured)| u8::from(*measured && is_read(row))).collect();
    let notes = recording.notes().iter().cloned().chain(doubt.map(|doubt| doubt.to_string()));
    Ok((columns, Cow::Owned(measured), notes.collect()))
}

/// Every number of every tick of a daemon's recording by column, and what the reader has to tell.
///
/// # Errors
/// `ValueError` with the reader's line.
#[pyfunction]
pub(crate) fn read_ticks(py: Python<'_>, file: PathBuf) -> PyResult<(Numbers, Vec<String>)> {
    py.detach(|| {
        let content = read_mcap(&file).map_err(refused)?;
        let table = tick_table(&content.ticks);
        let mut lines = table.lines().map(|line| line.split(','));
        let names: Vec<&str> = lines.next().map(Iterator::collect).unwrap_or_default();
        let mut columns = vec![Vec::with_capacity(8 * content.ticks.len()); names.len()];
        for cells in lines {
            for (column, cell) in columns.iter_mut().zip(cells) {
                // A number that is none is an empty cell.
                column.extend(cell.parse().unwrap_or(f64::NAN).to_le_bytes());
            }
        }
        let columns = names.into_iter().zip(columns).map(|(name, bytes)| (name.to_owned(), Cow::Owned(bytes)));
        Ok((columns.collect(), content.notes))
    })
}
