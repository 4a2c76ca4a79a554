//! `trainer validate`: how well a rig's model tells recorded pressures from the commands alone.

use std::path::PathBuf;

use clap::Args;
use fit::FitError;
use fit::data::quality::{Finding, Quality, Trouble, seconds_are_no_count, within_ranges};
use fit::data::{Records, each_once, noise};
use fit::simulate::{Arcs, Fidelity, Flapper, Look, Run, Simulator, flappers_of};
use free_run::{Began, FreeRun, FreeRunError};
use model::plant::Plant;
use model::rig::Rig;
use proto::recording::{PERIOD_S, Recording, short_name};
use proto::rig_file::RigFileError;
use serde_json::{Map, Value, json};

use crate::accuracy::{Compared, Errors};
use crate::failure::{Failure, tell};
use crate::progress::Progress;
use crate::rig_choice::RigChoice;
use crate::stdout;

/// Compares a rig's open-loop simulation with recorded pressures, channel by channel.
///
/// The run starts at the first row's pressures, then only the commands count. Accuracy is 1 minus the mean absolute
/// percentage error of gauge pressures (the paper's figure); rows nearer to the atmosphere than --least-kpa are left out
/// of it, for a percentage of nearly nothing says nothing, and are counted under `near 0`. RMSE and the largest error
/// are over all rows with a sound reading: those of a sensor that stands still, is clipped or jumps for a row are left out, and told.
/// Where a valve's flapper with backlash or friction lay when a recording began is told by no reading: it is placed where the first
/// 20 s come out best, and said.
///
/// Recordings of any rate are brought to rows of 20 ms; only rows with a sample are compared. Lost samples are bridged where those
/// around them are 0.1 s apart at most, or two and a half times their usual distance; at a longer gap the run begins anew from the
/// recorded pressures, which makes its error smaller: the column `anew` counts that. A recording that is given twice counts once.
#[derive(Debug, Args)]
#[command(after_help = "Exit status: 0 compared; 1 compared, and the recording does not hold what the rig file says
(another unit, swapped columns, a command turned round); 2 wrong use or input.

Example:
  trainer validate --rig dual_pressure run1.mcap run2.csv --json")]
pub(crate) struct ValidateArgs {
    #[command(flatten)]
    rig: RigChoice,
    /// Recordings: the daemon's MCAP, what loggers write as text, LabVIEW or MATLAB files; columns under the rig's names
    /// (time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa: s, duty 0 to 1, gauge kPa) or as the rig file's `[recording]` says
    #[arg(value_name = "RECORDING", required = true)]
    recordings: Vec<PathBuf>,
    /// Smallest recorded pressure, in kPa above or below the atmosphere, that counts for the accuracy [default: 5, or a tenth of the
    /// largest one where that is less]
    #[arg(long, value_name = "KPA", value_parser = least_kpa)]
    least_kpa: Option<f64>,
    /// Print the figures as one JSON object instead of a table
    #[arg(long)]
    json: bool,
}

/// One line of the result: a recording, or all of them.
struct Figures {
    /// The recording's file; `None` for all recordings together.
    file: Option<String>,
    recordings: usize,
    segments: usize,
    /// Rows without a sample.
    not_measured: usize,
    /// Places where flappers lay, by stretch.
    began: Began,
    /// By sensor of the rig.
    channels: Vec<Errors>,
}

/// Rows with fewer of which a run begins at the readings and ends before it can leave them: its errors say nothing.
const LEAST_ROWS: usize = 3;

pub(crate) fn run(args: &ValidateArgs) -> Result<(), Failure> {
    let (rig, plant) = args.rig.compile()?;
    // All are read before any is run, so that a bad file shows at once.
    let recordings =
        args.recordings.iter().map(|path| Recording::read_for(path, &rig)).collect::<Result<Vec<_>, _>>()?;
    let (recordings, left_out) = each_once(recordings);
    seconds_are_no_count(&rig, &recordings)?;
    check_meaning(&rig, &recordings)?;
    let mut free_run = FreeRun::new(&rig, plant.clone())
        .map_err(|problem| RigFileError::Rig { file: args.rig.rig.clone(), problem })?;
    for recording in &recordings {
        recording.require_all(plant.sensor_columns().iter().map(String::as_str))?;
    }
    if let Some(short) = recordings.iter().find(|recording| recording.rows() < LEAST_ROWS) {
        return Err(Failure::TooShort { file: short.source().to_owned(), rows: short.rows(), least: LEAST_ROWS });
    }
    let rows: usize = recordings.iter().map(Recording::rows).sum();
    let mut looked = looked_at(&rig, &recordings)?;
    looked.doubts.extend(left_out);
    let recordings: Vec<Recording> = sound(recordings, &looked);
    let mut figures = Vec::with_capacity(recordings.len());
    {
        let mut progress = Progress::new("validating", rows as u64);
        for (recording, usable) in recordings.iter().zip(&looked.usable) {
            let began = if free_run.has_flappers() { began(&rig, recording)? } else { Began::new() };
            let rows = Judged { usable, least_kpa: args.least_kpa };
            figures.push(compare(&mut free_run, recording, began, rows, &mut progress)?);
        }
    }
    tell_all(&recordings, &looked, &figures);
    let overall = overall(&figures);
    if args.json {
        let recordings: Vec<Value> = figures.iter().map(|each| json_of(each, &plant)).collect();
        stdout::say_json(&json!({
            "rig": rig.name, "least_kpa": args.least_kpa.unwrap_or(LEAST_KPA), "recordings": recordings,
            "overall": json_of(&overall, &plant), "good": looked.unusable.is_none(), "not_good": looked.unusable,
            "doubts": looked.doubts,
        }))?;
    } else {
        let several = (figures.len() > 1).then_some(&overall);
        stdout::say(&table(figures.iter().chain(several), &plant))?;
    }
    looked.unusable.map_or(Ok(()), |why| Err(Failure::NotGood(why)))
}

/// Tells what the figures have to be read with.
fn tell_all(recordings: &[Recording], looked: &Looked, figures: &[Figures]) {
    let notes = recordings.iter().flat_map(Recording::notes);
    notes.chain(&looked.doubts).for_each(|note| tell(note));
    recordings.iter().filter_map(began_anew).for_each(|note| tell(&note));
    for each in figures {
        if let (Some(file), Some(first)) = (&each.file, each.began.first().filter(|flappers| !flappers.is_empty())) {
            let places: Vec<String> = first.iter().map(placed).collect();
            tell(&format!("{file}: by its first 20 s, {}", places.join(", ")));
        }
    }
}

/// Refuses readings that no sensor of the rig can have, with the likeliest reason.
fn check_meaning(rig: &Rig, recordings: &[Recording]) -> Result<(), Failure> {
    let Err(outside) = within_ranges(rig, recordings) else { return Ok(()) };
    // What the rig would do is the closer word, where it can be asked.
    let told = looked_at(rig, recordings).ok().and_then(|looked| looked.unusable.or(looked.doubts.into_iter().next()));
    Err(told.map_or(outside, FitError::Unusable).into())
}

/// Findings of the checks of units, signs, exchanged columns and sensors of recordings.
struct Looked {
    /// Errors that are not the model's and that no figure is worth anything with; all in one line.
    unusable: Option<String>,
    /// Errors that are not the model's and that figures have to be read with.
    doubts: Vec<String>,
    /// By recording, sensor and row, whether a sound sample was taken there.
    usable: Vec<Vec<Vec<bool>>>,
    /// By recording, the first row that its run begins at.
    first_rows: Vec<usize>,
    /// Recordings as they were read from there on, wild readings bridged.
    records: Records,
}

fn looked_at(rig: &Rig, recordings: &[Recording]) -> Result<Looked, FitError> {
    let records = Records::new(rig, recordings)?;
    let mut quality = Quality::of(rig, &records, &noise(&records))?;
    // What a fit cannot do without a comparison can.
    let of_reading = |finding: &Finding| {
        !matches!(
            finding.trouble,
            Trouble::TooShort | Trouble::Gaps | Trouble::UnevenTime | Trouble::NoExcitation | Trouble::PumpOff
        )
    };
    quality.findings.retain(of_reading);
    let (unusable, doubts) = (quality.refusal(), quality.doubts().map(ToString::to_string).collect());
    let first_rows = quality.first_rows(&records);
    let (quality, records) = quality.sound(records);
    let of = |record: usize, channel: usize| {
        let rows = quality.usable.get(records.layout().channel(record, channel)).unwrap_or_default();
        rows.iter().map(|usable| *usable > 0.0).collect()
    };
    let channels = 0..records.sensors().len();
    let usable = (0..recordings.len()).map(|record| channels.clone().map(|channel| of(record, channel)).collect());
    let usable = usable.collect();
    Ok(Looked { unusable, doubts, usable, first_rows, records })
}

/// The recordings with straight lines in place of wild readings, and from the first row at which a run can begin.
fn sound(recordings: Vec<Recording>, looked: &Looked) -> Vec<Recording> {
    let of = |(record, recording): (usize, Recording)| {
        let recording = recording.from_row(looked.first_rows.get(record).copied().unwrap_or(0));
        let columns = looked.records.sensors().iter().enumerate();
        columns.fold(recording, |recording, (channel, column)| {
            recording.with_numbers(column, looked.records.channel_kpa(record, channel))
        })
    };
    recordings.into_iter().enumerate().map(of).collect()
}

/// Rows of a recording that are compared.
#[derive(Clone, Copy)]
struct Judged<'a> {
    /// By sensor and row, whether a sound sample was taken there.
    usable: &'a [Vec<bool>],
    /// Smallest recorded pressure that counts for the accuracy (kPa), where one was asked for.
    least_kpa: Option<f64>,
}

/// The smallest recorded pressure that counts for the accuracy where nobody says one (kPa) …
const LEAST_KPA: f64 = 5.0;
/// … or this share of the largest one, on rigs of low pressures.
const LEAST_SHARE: f64 = 0.1;

/// The smallest pressure of a channel that counts for its accuracy, in kPa.
fn least_of(recorded_kpa: &[f64], usable: &[bool]) -> f64 {
    let sound = recorded_kpa.iter().zip(usable).filter(|(_, usable)| **usable);
    LEAST_KPA.min(LEAST_SHARE * sound.map(|(kpa, _)| kpa.abs()).fold(0.0, f64::max))
}

/// Number of times that a recording's run begins anew, and why; `None` where it runs through.
fn began_anew(recording: &Recording) -> Option<String> {
    let (segments, time_s) = (recording.segments(), recording.time_s());
    let gaps: Vec<(f64, f64)> = segments
        .windows(2)
        .filter_map(|w| Some((*time_s.get(w[0].end.checked_sub(1)?)?, *time_s.get(w[1].start)?)))
        .collect();
    let (from, _) = *gaps.first()?;
    let longest_s = gaps.iter().map(|(from, to)| to - from).fold(0.0, f64::max);
    let run_s = segments.iter().map(|rows| rows.len() as f64 * PERIOD_S).fold(0.0, f64::max);
    let times = if gaps.len() == 1 { "once".to_owned() } else { format!("{} times", gaps.len()) };
    Some(format!(
        "{}: the simulation began anew {times}, after gaps of up to {longest_s:.2} s (the first at {from:.2} s), from the pressures recorded \
         there; the longest run without one is {run_s:.1} s, so the errors are smaller than those of a whole run",
        recording.source()
    ))
}

/// Places where flappers lay at the first row of each stretch, by the 20 s after it.
fn began(rig: &Rig, recording: &Recording) -> Result<Began, Failure> {
    let records = Records::new(rig, std::slice::from_ref(recording))?;
    let simulator = Simulator::new(&records, Fidelity::Averaged);
    let found = flappers_of(&simulator, &[Run::from(rig.clone())], &Arcs::free(&records), Look::Closely);
    Ok(found.into_iter().next().unwrap_or_default())
}

/// A flapper's place in words.
fn placed(flapper: &Flapper) -> String {
    let (kind, valve) = flapper.unknown.split_once(':').unwrap_or(("", &flapper.unknown));
    let of = if kind == "play" { "its backlash" } else { "the band that friction holds it in" };
    format!("the flapper of {valve} lay at {:+.0} % of {of}", 100.0 * flapper.share)
}

fn compare(
    free_run: &mut FreeRun,
    recording: &Recording,
    began: Began,
    judged: Judged<'_>,
    progress: &mut Progress,
) -> Result<Figures, FreeRunError> {
    let plant = free_run.plant();
    // Without pressures a simulation would start at rest; here there would be nothing to compare it with.
    let recorded = recording.require_all(plant.sensor_columns().iter().map(String::as_str))?;
    let trace = free_run.over(recording, &began, |rows| progress.go_on(rows))?;
    let channels = recorded
        .iter()
        .zip(&trace.readings_kpa)
        .zip(judged.usable)
        .map(|((recorded_kpa, simulated_kpa), usable)| {
            let (time_s, measured) = (recording.time_s(), Some(usable.as_slice()));
            let least_kpa = judged.least_kpa.unwrap_or_else(|| least_of(recorded_kpa, usable));
            Errors::of(Compared { time_s, recorded_kpa, simulated_kpa, measured }, least_kpa)
        })
        .collect();
    let not_measured = recording.measured().map_or(0, |measured| measured.iter().filter(|m| !**m).count());
    let (file, segments) = (Some(recording.source().to_owned()), recording.segments().len());
    Ok(Figures { file, recordings: 1, segments, not_measured, began, channels })
}

impl Figures {
    /// Number of times that a simulation began anew within a recording.
    fn restarts(&self) -> usize {
        self.segments.saturating_sub(self.recordings)
    }
}

fn overall(figures: &[Figures]) -> Figures {
    let channels = figures.first().map_or(0, |first| first.channels.len());
    let sum = |channel: usize| {
        figures.iter().filter_map(|each| each.channels.get(channel)).fold(Errors::default(), |sum, next| sum.and(*next))
    };
    Figures {
        file: None,
        recordings: figures.len(),
        segments: figures.iter().map(|each| each.segments).sum(),
        not_measured: figures.iter().map(|each| each.not_measured).sum(),
        began: Began::new(),
        channels: (0..channels).map(sum).collect(),
    }
}

/// Keys by channel as in `diagnosis.json`: `pos_accuracy`, `pos_rmse_kpa` for the column `p_pos_kpa`.
fn json_of(figures: &Figures, plant: &Plant<f64>) -> Value {
    let mut object = Map::new();
    if let Some(file) = &figures.file {
        object.insert("file".to_owned(), json!(file));
    }
    object.insert("segments".to_owned(), json!(figures.segments));
    object.insert("began_anew".to_owned(), json!(figures.restarts()));
    object.insert("rows_without_sample".to_owned(), json!(figures.not_measured));
    if figures.began.iter().any(|flappers| !flappers.is_empty()) {
        let of = |flapper: &Flapper| (flapper.unknown.clone(), json!(flapper.share));
        let began = figures.began.iter().map(|flappers| Value::Object(flappers.iter().map(of).collect()));
        object.insert("flappers_began_at".to_owned(), began.collect());
    }
    for (column, errors) in plant.sensor_columns().iter().zip(&figures.channels) {
        let channel = channel(column);
        let (worst_kpa, worst_time_s) = errors.worst();
        let (rows, near_zero) = errors.rows();
        let mut put = |key: &str, value: Value| object.insert(format!("{channel}_{key}"), value);
        put("accuracy", json!(errors.accuracy()));
        put("rmse_kpa", json!(errors.rmse_kpa()));
        put("max_error_kpa", json!(worst_kpa));
        put("rows", json!(rows));
        put("rows_near_zero", json!(near_zero));
        // A time in all recordings together is in none of them.
        if figures.file.is_some() {
            put("max_error_time_s", json!(worst_time_s));
        }
    }
    Value::Object(object)
}

/// A column's channel: `pos` for `p_pos_kpa`, otherwise the column itself.
fn channel(column: &str) -> &str {
    column.strip_prefix("p_").and_then(|rest| rest.strip_suffix("_kpa")).unwrap_or(column)
}

const HEAD: [&str; 9] = ["recording", "channel", "accuracy", "RMSE kPa", "max kPa", "at s", "rows", "near 0", "anew"];

fn table<'a>(figures: impl Iterator<Item = &'a Figures>, plant: &Plant<f64>) -> String {
    let mut lines = vec![HEAD.map(str::to_owned)];
    let figures: Vec<&Figures> = figures.collect();
    // The end of a path by which files differ: whole paths make rows that no terminal holds.
    let paths = || figures.iter().filter_map(|each| each.file.as_deref());
    for each in &figures {
        for (index, (column, errors)) in plant.sensor_columns().iter().zip(&each.channels).enumerate() {
            let (worst_kpa, worst_time_s) = errors.worst();
            let (rows, near_zero) = errors.rows();
            let of_rows = |figure: String| if rows == 0 { "-".to_owned() } else { figure };
            lines.push([
                match (index, &each.file) {
                    (0, Some(file)) => short_name(file, paths()),
                    (0, None) => "all".to_owned(),
                    _ => String::new(),
                },
                channel(column).to_owned(),
                errors.accuracy().map_or("-".to_owned(), |share| format!("{:.2} %", 100.0 * share)),
                of_rows(format!("{:.4}", errors.rmse_kpa())),
                of_rows(format!("{worst_kpa:.4}")),
                each.file.as_ref().map_or("-".to_owned(), |_| of_rows(format!("{worst_time_s:.2}"))),
                rows.to_string(),
                near_zero.to_string(),
                if index == 0 { each.restarts().to_string() } else { String::new() },
            ]);
        }
    }
    aligned(&lines)
}

/// Columns of equal width, the first two to the left, numbers to the right.
fn aligned<const N: usize>(lines: &[[String; N]]) -> String {
    let width: [usize; N] =
        std::array::from_fn(|i| lines.iter().filter_map(|l| l.get(i)).map(|c| c.chars().count()).max().unwrap_or(0));
    let mut text = String::new();
    for line in lines {
        let cells: Vec<String> = line
            .iter()
            .zip(width)
            .enumerate()
            .map(|(i, (cell, width))| if i < 2 { format!("{cell:<width$}") } else { format!("{cell:>width$}") })
            .collect();
        text.push_str(cells.join("  ").trim_end());
        text.push('\n');
    }
    text
}

fn least_kpa(text: &str) -> Result<f64, &'static str> {
    match text.parse::<f64>() {
        Ok(kpa) if (0.0..=1000.0).contains(&kpa) => Ok(kpa),
        _ => Err("a pressure from 0 to 1000 kPa is meant"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_named_after_the_channel() {
        assert_eq!((channel("p_pos_kpa"), channel("p_neg_kpa"), channel("tank")), ("pos", "neg", "tank"));
    }

    #[test]
    fn numbers_stand_under_their_head() {
        let line = |a: &str, b: &str, c: &str| [a.to_owned(), b.to_owned(), c.to_owned()];
        let text = aligned(&[line("recording", "x", "accuracy"), line("a", "pos", "91.76 %"), line("", "neg", "-")]);
        assert_eq!(text, "recording  x    accuracy\na          pos   91.76 %\n           neg         -\n");
    }
}
