//! `trainer finetune`: the paper's sim-to-real transfer, on transitions of the running daemon.

use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use ::finetune::recording_folder::RecordingFolder;
use ::finetune::{
    FinetuneCallback, FinetuneError, FinetuneRun, FinetuneSettings, Progress, PublishedPlan, Source, Status,
};
use clap::Args;
use proto::live_line;
use serde_json::json;
use training::{PolicyStart, TrainingError};

use crate::failure::{Failure, tell};
use crate::stdout;
use crate::stop_signal::StopSignal;
use crate::train::MOST_THREADS;

/// Goes on training a policy on the running rig: Soft Actor-Critic with smooth actions on what the daemon records.
///
/// The paper's sim-to-real transfer (Table IV). Transitions are read from the recordings, also from the one that is
/// being written; the daemon notices nothing of it. Every so often a policy is published into the watched folder, and
/// the daemon examines it, ramps it up or refuses it, and goes back by itself. So many updates follow each tick, so
/// the result depends on the recordings, the settings and the seed alone. The mean action explores nothing: switch on
/// `controller explore on` meanwhile. Ctrl-C writes a checkpoint within two seconds; --resume goes on.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  trainer finetune --recordings recordings --from policies/default.onnx \\
    --publish policies --out runs/transfer
  trainer finetune --resume runs/transfer
  trainer finetune --offline --recordings recordings \\
    --from policies/default.onnx --publish out --out runs/again")]
pub(crate) struct FinetuneArgs {
    /// Folder that the daemon records into (record.directory)
    #[arg(long, value_name = "DIR", required_unless_present = "resume")]
    recordings: Option<PathBuf>,
    /// Policy to begin from: the ONNX file that controls, or the folder of a run
    #[arg(long, value_name = "POLICY", required_unless_present = "resume")]
    from: Option<PathBuf>,
    /// Folder to publish into, which must be there: the daemon's policy.directory, or another one with --offline
    #[arg(long, value_name = "DIR", required_unless_present = "resume")]
    publish: Option<PathBuf>,
    /// Folder of the new run
    #[arg(long, value_name = "DIR", required_unless_present = "resume")]
    out: Option<PathBuf>,
    /// Folder of a run to go on with
    #[arg(long, value_name = "DIR", conflicts_with_all = ["recordings", "from", "publish", "out", "seed", "updates_per_tick", "publish_every", "warm_up", "remember", "hold_plan", "name"])]
    resume: Option<PathBuf>,
    /// Use the recordings that are there, and end with them, instead of waiting for more
    #[arg(long)]
    offline: bool,
    /// Ticks to learn from, instead of the paper's (102400, 34 min)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=100_000_000))]
    steps: Option<u64>,
    /// Updates after each tick
    #[arg(long, value_name = "N", default_value_t = FinetuneSettings::UPDATES_PER_TICK, value_parser = clap::value_parser!(u64).range(1..=100))]
    updates_per_tick: u64,
    /// Ticks between two published policies
    #[arg(long, value_name = "N", default_value_t = FinetuneSettings::PUBLISH_EVERY_STEPS, value_parser = clap::value_parser!(u64).range(1..))]
    publish_every: u64,
    /// First ticks in which the critics alone learn
    #[arg(long, value_name = "N", default_value_t = FinetuneSettings::CRITIC_WARM_UP_STEPS)]
    warm_up: u64,
    /// Transitions that are remembered of the run whose folder --from is: they say what to do far from the goal
    #[arg(long, value_name = "N", default_value_t = FinetuneSettings::REMEMBERED)]
    remember: u64,
    /// Publish with a plan that holds the duties of now, instead of fitting it to what the policy then does
    #[arg(long)]
    hold_plan: bool,
    /// Beginning of published files' names
    #[arg(long, value_name = "NAME", default_value = "finetuned", value_parser = name)]
    name: String,
    /// Seed
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Threads that learn; the result is the same with any number (all cores but one, 4 at most)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=64))]
    threads: Option<u64>,
    /// Print the summary as one JSON object
    #[arg(long)]
    json: bool,
}

/// Least claim on the processor: the daemon's thread and everything else comes first.
const NICEST: i32 = 19;

/// A name that the watched folder takes.
fn name(text: &str) -> Result<String, String> {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "._-".contains(c);
    if !text.is_empty() && !text.starts_with('.') && text.chars().all(is_plain) {
        Ok(text.to_owned())
    } else {
        Err("letters, digits, `.`, `_` and `-`, no dot in front".to_owned())
    }
}

pub(crate) fn run(args: &FinetuneArgs) -> Result<(), Failure> {
    let stop = StopSignal::listen()?;
    if rustix::process::nice(NICEST).is_err() {
        tell("runs at the usual priority: the system does not let it step back");
    }
    let cores = std::thread::available_parallelism().map_or(1, |n| n.get());
    let spare = cores.saturating_sub(usize::from(!args.offline)).clamp(1, MOST_THREADS);
    let threads = args.threads.map_or(spare, |n| usize::try_from(n).unwrap_or(1));
    let mut run = begin(args, threads)?;
    let source = if args.offline { Source::Recordings } else { Source::Daemon };
    let mut bar =
        Bar { stop: stop.clone(), terminal: std::io::stderr().is_terminal(), next: Instant::now(), is_shown: false };
    let ended = run.go(source, &mut bar)?;
    bar.clear();
    let summary = run.summary();
    let done = match ended {
        Status::Finished | Status::UsedUp => Ok(()),
        Status::Stopped => Err(stop.stopped("stopped before its end")),
    };
    if args.json {
        // The status of a stop counts, whether or not its summary can be told.
        return done.and(stdout::say_json(&json!(summary)));
    }
    let folder = run.files().folder().display();
    let mut text = match ended {
        Status::Finished => format!("{} ticks learned from", summary.steps),
        Status::UsedUp => format!(
            "{} of {} ticks learned from, the recordings are used up; go on with more: trainer finetune --offline --resume {folder}",
            summary.steps, summary.steps_planned
        ),
        Status::Stopped => format!(
            "stopped after {} of {} ticks, kept; go on with: trainer finetune --resume {folder}",
            summary.steps, summary.steps_planned
        ),
    };
    text += &format!(
        "\n{} updates in {:.0} s, lambda_T {:.3}; {}\n",
        summary.updates,
        summary.wall_s,
        summary.lambda_temporal,
        match summary.rmse_kpa {
            Some(_) =>
                format!("RMSE of the last {:.0} s under control {}", summary.rmse_over_s, error_text(summary.rmse_kpa)),
            None =>
                "RMSE not known yet: it counts from 5 s after an arming or a jump of the goal, and takes 1 s".to_owned(),
        }
    );
    let tally = &summary.tally;
    text += &format!(
        "{} ticks read; {} of {} observations are to the bit what the daemon's policy was shown\n",
        tally.ticks, tally.same_observations, tally.compared_observations
    );
    for (reason, count) in &tally.left_out {
        text += &format!("left out: {count} {reason}\n");
    }
    if let Some(last) = &summary.last_published {
        text += &format!("published last: {}", run.settings().publish.join(last).display());
    }
    done.and(stdout::say(text.trim_end()))
}

fn begin(args: &FinetuneArgs, threads: usize) -> Result<FinetuneRun, Failure> {
    if let Some(folder) = &args.resume {
        return Ok(FinetuneRun::resume(folder, args.steps, threads)?);
    }
    // clap asks for all of them.
    let missing = || Failure::Learner("--recordings, --from, --publish and --out are needed".to_owned());
    let [recordings, from, publish, out] =
        [&args.recordings, &args.from, &args.publish, &args.out].map(|path| path.as_deref().ok_or_else(missing));
    let (recordings, from, publish, out) = (recordings?, from?, publish?, out?);
    for (folder, problem) in [
        (recordings, "is no folder; give the one that the daemon records into (record.directory)"),
        (publish, "is no folder; make it, or give the one that the daemon watches (policy.directory)"),
    ] {
        if !folder.is_dir() {
            return Err(TrainingError::file(folder, problem).into());
        }
    }
    // Before anything is made: of a folder without recordings nothing would come but an empty run.
    if args.offline
        && let Some(holds) = RecordingFolder::lacks_recordings(recordings)?
    {
        let folder = recordings.display().to_string();
        return Err(FinetuneError::NothingToLearn { folder, ticks: 0, reasons: format!(": it holds {holds}") }.into());
    }
    let start = PolicyStart::load(from)?;
    let settings = FinetuneSettings {
        recordings: absolute(recordings)?,
        publish: absolute(publish)?,
        name: args.name.clone(),
        from_crc32c: start.crc32c(),
        steps: args.steps.unwrap_or(FinetuneSettings::PAPER_STEPS),
        updates_per_tick: args.updates_per_tick,
        publish_every_steps: args.publish_every,
        critic_warm_up_steps: args.warm_up,
        remembered: args.remember,
        lambda_temporal: FinetuneSettings::PAPER_LAMBDA,
        plan: if args.hold_plan { PublishedPlan::Held } else { PublishedPlan::Fitted },
        seed: args.seed,
    };
    Ok(FinetuneRun::begin(settings, &start, out, threads)?)
}

fn absolute(path: &Path) -> Result<PathBuf, Failure> {
    std::path::absolute(path).map_err(|error| TrainingError::file(path, &format!("has no place: {error}")).into())
}

/// RMSE of both channels, where it is known.
fn error_text(rmse_kpa: Option<[f64; 2]>) -> String {
    rmse_kpa.map_or_else(|| "not known".to_owned(), |[pos, neg]| format!("{pos:.3}/{neg:.3} kPa"))
}

const BAR_EVERY: Duration = Duration::from_millis(200);
const LINE_EVERY: Duration = Duration::from_secs(15);
const BAR_WIDTH: usize = 20;

/// Progress: one bar over all ticks on a terminal, plain lines elsewhere.
struct Bar {
    stop: StopSignal,
    terminal: bool,
    next: Instant,
    is_shown: bool,
}

impl Bar {
    /// Leaves a clean line.
    fn clear(&mut self) {
        if std::mem::take(&mut self.is_shown) {
            write(live_line::CLEARED);
        }
    }
}

impl FinetuneCallback for Bar {
    fn progress(&mut self, p: &Progress) {
        if Instant::now() < self.next {
            return;
        }
        let percent = 100 * p.steps / p.steps_planned.max(1);
        let figures = format!("{}, {:.0} updates/s, RMSE {}", p.doing, p.updates_per_s, error_text(p.rmse_kpa));
        if self.terminal {
            let full = BAR_WIDTH * usize::try_from(percent.min(100)).unwrap_or(100) / 100;
            let bar = format!("[{}{}]", "#".repeat(full), "-".repeat(BAR_WIDTH - full));
            write(&live_line::written_over(&format!("{bar} {percent:3} % {figures}")));
            self.is_shown = true;
            self.next = Instant::now() + BAR_EVERY;
        } else {
            write(&format!("tick {} of {}: {figures}\n", p.steps, p.steps_planned));
            self.next = Instant::now() + LINE_EVERY;
        }
    }

    fn stop(&self) -> bool {
        self.stop.has_come()
    }

    fn is_kept(&mut self) {
        self.stop.may_end();
    }

    fn say(&mut self, text: &str) {
        self.clear();
        tell(text);
    }
}

fn write(text: &str) {
    // Progress that cannot be shown is no reason to stop the work.
    let _ = std::io::stderr().lock().write_all(text.as_bytes());
}
