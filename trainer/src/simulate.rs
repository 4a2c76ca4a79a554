//! `trainer simulate`: an open-loop simulation of a rig under recorded or planned commands, as a CSV file.
//!
//! Written are `time_s`, the commands the rig needs, its pressures (simulated, rounded to 1e-7 kPa), and every
//! other column of the input as it was: for the paper's rig `time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa`, then
//! references, `pump_on` and the rest. Rows are those of the input.

use std::path::PathBuf;

use clap::Args;
use fit::data::quality::{seconds_are_no_count, within_ranges};
use free_run::{Began, FreeRun, Trace};
use model::plant::{FreeRunStart, Plant};
use proto::atomic_file;
use proto::recording::Recording;
use proto::recording::csv::{self, Column, ColumnData};
use proto::rig_file::RigFileError;
use serde_json::json;

use crate::failure::{Failure, tell};
use crate::interruptible::Interruptible;
use crate::progress::Progress;
use crate::rig_choice::RigChoice;
use crate::stdout;

/// Simulates a rig in open loop under given commands: starts at the first row's pressures, then only the commands count.
///
/// Row k holds the pressures at t_k and the commands from t_k to t_{k+1}, 20 ms later. A first row within 0.5 kPa of
/// the atmosphere starts a rig that stood still; any other one a rig whose pump was running, and whose valves, where they
/// have backlash or friction, lie as if the first pressures had settled before. A file without any
/// pressure column (such as next_experiment.csv) starts at rest. Lost rows are bridged where those around them are 0.1 s apart at
/// most, or two and a half times their usual distance; a longer gap starts the run anew at the next row.
#[derive(Debug, Args)]
#[command(after_help = "Example:
  trainer simulate --rig dual_pressure --inputs run.csv --out simulated.csv")]
pub(crate) struct SimulateArgs {
    #[command(flatten)]
    rig: RigChoice,
    /// Commands and first pressures: a recording, the daemon's MCAP or what a logger wrote, with columns under the rig's names
    /// (time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa: s, duty 0 to 1, gauge kPa) or as the rig file's `[recording]` says
    #[arg(long, value_name = "FILE")]
    inputs: PathBuf,
    /// CSV file to write: the same rows and columns, with simulated pressures; `-` is standard output
    #[arg(long, value_name = "CSV")]
    out: PathBuf,
    /// Print a summary as one JSON object instead of a line
    #[arg(long)]
    json: bool,
}

/// Room that a row of the result takes at most, roughly: a dozen columns of 20 digits.
const BYTES_PER_ROW: u64 = 240;
/// Digits kept behind the point of a simulated pressure in kPa: ten thousand times finer than the sensors.
const DIGITS: i32 = 7;

pub(crate) fn run(args: &SimulateArgs) -> Result<(), Failure> {
    let to_standard_output = args.out.as_os_str() == "-";
    if to_standard_output && args.json {
        return Err(Failure::TwoOutputs);
    }
    // Of a table that goes down a pipe a part may be gone already: there the signal ends the program, as it ends any other.
    let work = if to_standard_output { None } else { Some(Interruptible::begin()?) };
    let (rig, plant) = args.rig.compile()?;
    let recording = Recording::read_for(&args.inputs, &rig)?;
    seconds_are_no_count(&rig, std::slice::from_ref(&recording))?;
    within_ranges(&rig, std::slice::from_ref(&recording))?;
    if let Some(work) = &work {
        if proto::output::same_file(&args.inputs, &args.out) {
            return Err(Failure::OverInputs { out: args.out.display().to_string() });
        }
        work.undisturbed(|| proto::output::check_file(&args.out, BYTES_PER_ROW * recording.rows() as u64))?;
    }
    for note in recording.notes() {
        tell(note);
    }
    let mut free_run = FreeRun::new(&rig, plant.clone())
        .map_err(|problem| RigFileError::Rig { file: args.rig.rig.clone(), problem })?;
    let trace = {
        let mut progress = Progress::new("simulating", recording.rows() as u64);
        free_run.over(&recording, &Began::new(), |rows| progress.go_on(rows))?
    };
    if !trace.pressures_given {
        tell(&format!("{}: no column {}; starting at rest", recording.source(), plant.sensor_columns().join(" or ")));
    }
    let start = match trace.start {
        FreeRunStart::AtRest => "at rest",
        FreeRunStart::Running => "running",
    };
    let (rows, segments) = (recording.rows(), recording.segments().len());
    let columns = columns(&plant, &recording, trace);
    let table = csv::to_csv(recording.time_s(), &columns);
    let Some(work) = work else { return stdout::put(&table) };
    work.write(|| atomic_file::write(&args.out, table.as_bytes()))?;
    if args.json {
        return stdout::say_json(&json!({
            "rig": rig.name, "inputs": recording.source(), "out": args.out.display().to_string(),
            "rows": rows, "segments": segments, "start": start, "notes": recording.notes(),
        }));
    }
    let anew = match segments {
        0 | 1 => String::new(),
        2 => ", started anew after a gap".to_owned(),
        _ => format!(", started anew after {} gaps", segments - 1),
    };
    stdout::say(&format!("{}: {rows} rows of {}, started {start}{anew}", args.out.display(), rig.name))
}

/// The columns of the file to write, `time_s` aside.
fn columns(plant: &Plant<f64>, recording: &Recording, trace: Trace) -> Vec<Column> {
    let needed = plant.inputs().iter().filter(|input| input.default.is_none()).map(|input| input.column.as_str());
    let mut columns: Vec<Column> = needed.filter_map(|name| column(recording, name)).collect();
    for (name, readings) in plant.sensor_columns().iter().zip(trace.readings_kpa) {
        let numbers = readings.into_iter().map(rounded).collect();
        columns.push(Column { name: name.clone(), data: ColumnData::Numbers(numbers) });
    }
    for name in recording.names() {
        if columns.iter().all(|known| known.name != name) {
            columns.extend(column(recording, name));
        }
    }
    columns
}

fn column(recording: &Recording, name: &str) -> Option<Column> {
    let numbers = || recording.column(name).map(|numbers| ColumnData::Numbers(numbers.to_vec()));
    let texts = || recording.text_column(name).map(|texts| ColumnData::Text(texts.to_vec()));
    Some(Column { name: name.to_owned(), data: numbers().or_else(texts)? })
}

fn rounded(kpa: f64) -> f64 {
    let scale = 10.0_f64.powi(DIGITS);
    // Adding zero turns a rounded −0 into 0.
    (kpa * scale).round() / scale + 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pressures_keep_seven_digits_and_no_negative_zero() {
        assert_eq!(rounded(-70.123_456_789), -70.123_456_8);
        assert_eq!(rounded(-1e-9).to_bits(), 0.0_f64.to_bits());
    }
}
