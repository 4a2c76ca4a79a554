//! `controller report`, `controller export`: what a recording says, as a page and as a table.

use std::path::{Path, PathBuf};

use clap::Args;
use controller::replay::run_file::{RunFile, RunFileError};
use flight::{
    ComparedRun, FileState, FlightInfo, FlightStatistics, FlightSummary, StatisticsOptions, Verdict, comparison_report,
    flight_report,
};
use proto::output::check_file;
use proto::recording::{Recording, TickRecord, short_name, tick_table};
use serde_json::json;

use super::Failure;
use super::console::{say, tell};

/// The demo's report for any run, several compared on one page.
///
/// Reads recordings of the daemon (MCAP) and tables (CSV) with its columns. The page is one file that needs no other:
/// values under the pointer, zoom, series on and off, dark mode, pictures and numbers to be saved. A run is judged by
/// what the feed-forward PI reaches on the same reference: on the emulated rig where there was one, else on the model.
#[derive(Debug, Args)]
#[command(after_help = "Exit status: 0 good, 1 a run was not good (its report is written all the same), 2 wrong use.

Examples:
  controller report recordings/run-20261120-020405.mcap
  controller report monday/flight.mcap tuesday/flight.mcap --out both.html")]
pub(crate) struct ReportArgs {
    /// Recordings, MCAP or CSV
    #[arg(value_name = "RECORDING", required = true)]
    recordings: Vec<PathBuf>,
    /// The page [default: RECORDING.html beside the recording, or comparison.html beside the first]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Print the figures as one JSON object, and nothing else on standard output
    #[arg(long)]
    json: bool,
}

/// A recording as a table.
///
/// By default the rows that every other command reads: both pressures, duties, codes, 20 ms apart. References are among them
/// where at least half of the ticks have one; ticks without one (standing by, vented) are then left out, and told. With
/// --all a row for every tick, with everything that was recorded; a cell is empty where there was no number.
#[derive(Debug, Args)]
#[command(after_help = "Example:
  controller export recordings/run-20261120-020405.mcap --csv --all \\
    --out run.csv")]
pub(crate) struct ExportArgs {
    /// Recording (MCAP)
    #[arg(value_name = "RECORDING")]
    recording: PathBuf,
    /// As CSV, the one format there is
    #[arg(long, required = true)]
    csv: bool,
    /// Every tick with every field
    #[arg(long)]
    all: bool,
    /// The table; `-` is standard output [default: RECORDING.csv beside the recording]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

/// Room that a report needs, in bytes; that of an hour has six million.
const PAGE_BYTES: u64 = 8 << 20;

impl From<RunFileError> for Failure {
    fn from(error: RunFileError) -> Self {
        Failure::input(error)
    }
}

/// A run with its names and figures.
struct Judged {
    run: RunFile,
    name: String,
    info: FlightInfo,
    summary: FlightSummary,
}

impl ReportArgs {
    pub(super) fn run(self) -> Result<(), Failure> {
        let paths: Vec<String> = self.recordings.iter().map(|path| path.display().to_string()).collect();
        let page = self.page();
        if self.recordings.iter().any(|recording| proto::output::same_file(recording, &page)) {
            return Err(over_recording(&page));
        }
        check_file(&page, PAGE_BYTES).map_err(Failure::input)?;
        let mut judged = Vec::new();
        for (path, text) in self.recordings.iter().zip(&paths) {
            let name = short_name(text, paths.iter().map(String::as_str));
            judged.push(judge(RunFile::read(path)?, name));
        }
        let html = match judged.as_slice() {
            [one] => flight_report(&one.run.content.ticks, &one.info),
            several => {
                let compared = several.iter().map(|judged| ComparedRun {
                    name: &judged.name,
                    ticks: &judged.run.content.ticks,
                    info: &judged.info,
                });
                comparison_report(&format!("Comparison of {} runs", several.len()), &compared.collect::<Vec<_>>())
            }
        };
        proto::atomic_file::write(&page, html.as_bytes()).map_err(Failure::work)?;
        self.say_results(&judged, &page)
    }

    fn page(&self) -> PathBuf {
        let first = self.recordings.first().map_or(Path::new("run"), PathBuf::as_path);
        match (&self.out, self.recordings.len()) {
            (Some(out), _) => out.clone(),
            (None, 1) => first.with_extension("html"),
            (None, _) => first.with_file_name("comparison.html"),
        }
    }

    fn say_results(&self, judged: &[Judged], page: &Path) -> Result<(), Failure> {
        for note in judged.iter().flat_map(|judged| &judged.run.content.notes) {
            tell(format_args!("{note}"));
        }
        if self.json {
            let runs: Result<Vec<_>, _> = judged
                .iter()
                .map(|judged| {
                    let mut object = serde_json::to_value(&judged.summary)?;
                    object["name"] = judged.name.clone().into();
                    object["recording"] = judged.run.path.to_string_lossy().into();
                    Ok(object)
                })
                .collect::<Result<_, serde_json::Error>>();
            say(format_args!("{}", json!({"report": page, "runs": runs.map_err(Failure::work)?})));
        } else {
            for Judged { name, summary, .. } in judged {
                if judged.len() > 1 {
                    say(format_args!("{name}"));
                }
                say(format_args!("{}", summary.table()));
            }
            say(format_args!("report     {}", page.display()));
        }
        let bad = judged.iter().find(|judged| judged.summary.verdict == Verdict::Bad);
        match bad.and_then(|judged| Some((judged, judged.summary.findings.first()?))) {
            Some((judged, worst)) => Err(Failure::not_good(format!("{}: the run was not good: {worst}", judged.name))),
            None => Ok(()),
        }
    }
}

fn judge(run: RunFile, name: String) -> Judged {
    let options = StatisticsOptions {
        pacing: run.pacing(),
        yardstick: run.yardstick(),
        file_state: FileState::of(&run.content),
        ..StatisticsOptions::default()
    };
    let info = run.info(&format!("Run {name}"), options);
    let summary = FlightStatistics::of(&run.content.ticks, options).summary();
    Judged { run, name, info, summary }
}

/// The ticks that a table with references can hold, where most of a run has one: standing by has none.
fn with_references(ticks: &[TickRecord]) -> (Vec<TickRecord>, Option<String>) {
    let has = |tick: &&TickRecord| tick.ref_pos_kpa.is_finite() && tick.ref_neg_kpa.is_finite();
    let kept: Vec<TickRecord> = ticks.iter().filter(has).copied().collect();
    let left_out = ticks.len() - kept.len();
    if 2 * kept.len() < ticks.len() || left_out == 0 {
        return (ticks.to_vec(), None);
    }
    (kept, Some(format!("{left_out} ticks without a reference (standing by, vented) left out; --all has every tick")))
}

/// The error of a result that would take the place of what it is made from.
fn over_recording(out: &Path) -> Failure {
    Failure::input(format!(
        "{}: this is one of the recordings, which would be lost; give --out another name",
        out.display()
    ))
}

impl ExportArgs {
    pub(super) fn run(self) -> Result<(), Failure> {
        // The flag says the format, so that others can come beside it.
        let ExportArgs { recording, csv: _, all, out } = self;
        if !RunFile::is_of_the_daemon(&recording)? {
            return Err(Failure::input(format!(
                "{}: no recording of the daemon (MCAP); export makes tables of those, and the trainer reads tables as they are",
                recording.display()
            )));
        }
        let out = out.unwrap_or_else(|| recording.with_extension("csv"));
        let to_standard_output = out.as_os_str() == "-";
        if !to_standard_output {
            if proto::output::same_file(&recording, &out) {
                return Err(over_recording(&out));
            }
            // A row of the table takes about as much room as the tick that it is made from.
            let bytes = std::fs::metadata(&recording).map_or(0, |of| of.len());
            check_file(&out, bytes).map_err(Failure::input)?;
        }
        let run = RunFile::read(&recording)?;
        let (text, rows, notes) = if all {
            (tick_table(&run.content.ticks), run.content.ticks.len(), run.content.notes.clone())
        } else {
            let (ticks, note) = with_references(&run.content.ticks);
            let table = Recording::from_ticks(&recording.display().to_string(), &ticks).map_err(Failure::input)?;
            let notes = run.content.notes.iter().chain(table.notes()).cloned().chain(note).collect();
            (table.to_csv(), table.rows(), notes)
        };
        for note in &notes {
            tell(format_args!("{note}"));
        }
        if to_standard_output {
            say(text.trim_end());
            return Ok(());
        }
        proto::atomic_file::write(&out, text.as_bytes()).map_err(Failure::work)?;
        say(format_args!("{rows} rows in {}", out.display()));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Half of them is enough, as the help says; a table of the others tells itself which columns it lacks.
    #[test]
    fn ticks_without_a_reference_are_left_out_where_most_have_one() {
        let without = TickRecord { ref_pos_kpa: f64::NAN, ref_neg_kpa: f64::NAN, ..TickRecord::default() };
        let with = TickRecord { ref_pos_kpa: 90.0, ref_neg_kpa: -70.0, ..TickRecord::default() };
        for (ticks, rows, words) in [
            (vec![with; 3], 3, None),
            (vec![without; 3], 3, None),
            (vec![without, with, with], 2, Some("1 ticks without a reference")),
            (vec![without, with], 1, Some("1 ticks without a reference")),
            (vec![without, without, with], 3, None),
        ] {
            let (kept, note) = with_references(&ticks);
            assert_eq!((kept.len(), note.is_some()), (rows, words.is_some()), "{note:?}");
            assert!(words.is_none_or(|words| note.as_ref().is_some_and(|note| note.contains(words))), "{note:?}");
        }
    }
}
