//! `trainer improve`: makes a policy better by trying out its answers in simulation.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;
use training::metrics::Evaluated;
use training::rollouts::Round;
use training::{RolloutCallback, RolloutRun, RolloutSummary, RunStatus};

use crate::failure::{Failure, tell};
use crate::progress::Progress;
use crate::stdout;
use crate::stop_signal::StopSignal;
use crate::train::{MOST_THREADS, settings_of};

/// Makes a policy better by trying out its answers in simulation.
///
/// Rigs are flown side by side; at some ticks the same flight is flown on with shifted answers, under the same noise. What that
/// costs says which way each answer should go, and the policy is moved there. Rigs are drawn around --rig as the settings say; the
/// policy is kept that tracks best on rigs set aside, by the geometric mean of both channels' errors. A policy that corrects the
/// fallback begins from corrections of nothing where these track better. A run is a folder. Ctrl-C keeps the rounds before;
/// --resume goes on to the same result, to the byte.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  trainer improve --from policies/default.onnx --rig found/rig.toml \\
    --out runs/better
  trainer improve --from runs/first --config correction --rounds 60 \\
    --out runs/better
  trainer improve --resume runs/better --rounds 24")]
pub(crate) struct ImproveArgs {
    /// Policy to start from: an ONNX file that trainer wrote, or the folder of a run (nothing: the fallback's own answers)
    #[arg(long, value_name = "POLICY", conflicts_with = "resume")]
    from: Option<PathBuf>,
    /// Rig to draw around, name or file, instead of the settings' (dual_pressure)
    #[arg(long, value_name = "RIG", conflicts_with = "resume")]
    rig: Option<String>,
    /// Model: the rig that MPObs and the feed-forward know, name or file (the rig of --rig)
    #[arg(long, value_name = "RIG", conflicts_with = "resume")]
    model: Option<String>,
    /// Settings: a preset (paper, paper-drawn, correction, adaptation) or a TOML file; says which rigs are drawn
    #[arg(long, value_name = "PRESET|FILE", default_value = "adaptation", conflicts_with = "resume")]
    config: String,
    /// Folder of the new run
    #[arg(long, value_name = "DIR", required_unless_present = "resume")]
    out: Option<PathBuf>,
    /// Folder of a run to go on with
    #[arg(long, value_name = "DIR", conflicts_with = "out")]
    resume: Option<PathBuf>,
    /// Rounds, instead of the settings' (12)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    rounds: Option<u64>,
    /// Seed, instead of the settings' (1)
    #[arg(long, value_name = "N", conflicts_with = "resume")]
    seed: Option<u64>,
    /// Threads that fly; the result is the same with any number (all cores, 4 at most)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=64))]
    threads: Option<u64>,
    /// Print the summary as one JSON object
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &ImproveArgs) -> Result<(), Failure> {
    let stop = StopSignal::listen()?;
    // Whatever a second signal ends, the checkpoint of the last round is whole.
    stop.may_end();
    let cores = std::thread::available_parallelism().map_or(1, |n| n.get());
    let threads = args.threads.map_or(cores.min(MOST_THREADS), |n| usize::try_from(n).unwrap_or(1));
    let mut run = match (&args.resume, &args.out) {
        (Some(folder), _) => RolloutRun::resume(folder, args.rounds, threads)?,
        (None, Some(out)) => {
            let mut settings = settings_of(&args.config, args.rig.as_deref(), args.model.as_deref())?;
            settings.run.seed = args.seed.unwrap_or(settings.run.seed);
            if let Some(rounds) = args.rounds {
                settings.rollouts.get_or_insert_default().rounds = rounds;
            }
            RolloutRun::begin(settings, args.from.as_deref(), out, threads)?
        }
        // clap asks for one of the two.
        _ => return Ok(()),
    };
    tell(&run.taken());
    let began_behind = run.rounds_done();
    let left = run.rounds().saturating_sub(began_behind);
    let progress = Progress::new("improving", left * run.episodes());
    let mut shown = Shown { stop: stop.clone(), progress, began_behind };
    let ended = run.go(&mut shown)?;
    let done = match ended {
        RunStatus::Finished => Ok(()),
        RunStatus::Stopped => Err(stop.stopped("stopped before its end")),
    };
    let folder = run.files().folder().display().to_string();
    if !run.has_begun() {
        let said = if args.json {
            stdout::say_json(&json!({ "rounds": 0, "rounds_planned": run.rounds(), "kept": null }))
        } else {
            stdout::say(&format!("stopped before anything was scored; go on with: trainer improve --resume {folder}"))
        };
        // The status of a stop counts, whether or not its summary can be told.
        return done.and(said);
    }
    let summary = match ended {
        RunStatus::Finished => run.finish()?,
        RunStatus::Stopped => {
            shown.progress.tell(
                "stopping: the rounds before are kept; fitting their policy's plan (a further Ctrl-C ends at once)",
            );
            run.leave()?
        }
    };
    if args.json {
        return done.and(stdout::say_json(&json!(summary)));
    }
    let mut text = match ended {
        RunStatus::Finished => {
            let rounds = if summary.rounds == 1 { "round" } else { "rounds" };
            format!("{} {rounds} done in {:.0} s\n", summary.rounds, summary.wall_s)
        }
        RunStatus::Stopped => format!(
            "stopped after {} of {} rounds, kept; go on with: trainer improve --resume {folder}\n",
            summary.rounds, summary.rounds_planned
        ),
    };
    text += &figures(&summary);
    text += &format!("see {}", run.files().report().display());
    text += &format!("; run it: controller demo --policy {}", run.files().onnx().display());
    done.and(stdout::say(&text))
}

/// Tables of what is kept beside what the run began with and the fallback.
fn figures(summary: &RolloutSummary) -> String {
    let kept = &summary.kept;
    let mut text = match kept.round {
        0 => "kept: what the run began with; no round made it better on rigs set aside\n".to_owned(),
        round => format!("kept: the policy after round {round}, the best on randomised rigs set aside\n"),
    };
    text += "RMSE in kPa                  positive  negative  duty change/tick (RMS)\n";
    let began = summary.curve.first().map_or(kept.rmse_kpa, |round| round.rmse_kpa);
    let aside = [("policy", Some(kept.rmse_kpa)), ("began with", Some(began)), ("fallback", summary.fallback_kpa)];
    for (who, [pos, neg]) in aside.into_iter().filter_map(|(who, rmse_kpa)| Some((who, rmse_kpa?))) {
        text += &format!("{:<16} {who:<11} {pos:>8.3}  {neg:>8.3}\n", "rigs set aside");
    }
    for (who, e) in summary.by_rig() {
        let Evaluated { rig, rmse_kpa: [pos, neg], duty_change_rms: [up, down], .. } = e;
        text += &format!("{rig:<16} {who:<11} {pos:>8.3}  {neg:>8.3}  {up:.4}, {down:.4}\n");
    }
    text
}

/// A bar over all episodes, and a line for each round.
struct Shown {
    stop: StopSignal,
    progress: Progress,
    /// Rounds that earlier sittings have done.
    began_behind: u64,
}

impl RolloutCallback for Shown {
    fn episode(&mut self) {
        self.progress.advance(1);
    }

    fn round(&mut self, round: &Round, of: u64) {
        if round.round == self.began_behind {
            // Reading, and scoring what it began with, were no steps.
            self.progress.begin_even_steps();
        }
        let [pos, neg] = round.rmse_kpa;
        self.progress.tell(&format!(
            "round {} of {of}, {:.0} s: RMSE {pos:.3}/{neg:.3} kPa on rigs set aside",
            round.round, round.wall_s
        ));
    }

    fn stop(&self) -> bool {
        self.stop.has_come()
    }
}
