//! `trainer train`: learns a policy in simulation.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;
use training::{PolicyStart, Run, RunStatus, TrainingSettings, Variant};

use crate::failure::{Failure, tell};
use crate::stdout;
use crate::stop_signal::StopSignal;
use crate::train_bar::TrainBar;

/// Largest settings file that is read (bytes); ours have some kilobytes.
const MOST_SETTINGS_BYTES: u64 = 1 << 20;

/// Learns a policy in simulation: Soft Actor-Critic with smooth actions (CAPS) and model-predicted observations.
///
/// A run is a folder: settings, learning curve (JSON lines, TensorBoard), checkpoint, policy, report. Without --config
/// it is the paper's Table IV on the paper's rig. With --rig it trains on that rig, mechanisms that diagnosis found included,
/// varied and added to as the settings say. Ctrl-C writes a checkpoint within two seconds and stops (exit status 130); --resume
/// goes on to the same result, to the byte, also to another --steps. The end exports policy.onnx, which the daemon runs.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  trainer train --out runs/first --steps 20000
  trainer train --config correction --seed 2 --out runs/correction-2
  trainer train --config paper --variant raw --rig bench --out runs/raw
  trainer train --config correction --rig found/rig.toml \\
    --from policies/default.onnx --steps 20000 --out runs/adapted
  trainer train --resume runs/first --steps 512000")]
pub(crate) struct TrainArgs {
    /// Settings: a preset (paper, paper-drawn, correction, adaptation) or a TOML file; keys that are left out have the paper's values
    #[arg(long, value_name = "PRESET|FILE", default_value = "paper", conflicts_with = "resume")]
    config: String,
    /// Folder of the new run
    #[arg(long, value_name = "DIR", required_unless_present = "resume")]
    out: Option<PathBuf>,
    /// Folder of a run to go on with
    #[arg(long, value_name = "DIR", conflicts_with_all = ["out", "seed", "variant", "rig", "model", "from"])]
    resume: Option<PathBuf>,
    /// Environment steps, instead of the settings' (512000)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=10_000_000_000))]
    steps: Option<u64>,
    /// Seed, instead of the settings' (1)
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Ablation: raw, mpobs, caps or both, instead of the settings' (both)
    #[arg(long, value_name = "VARIANT")]
    variant: Option<Variant>,
    /// Plant: the rig to train on or to randomise around, name or file, instead of the settings' (dual_pressure)
    #[arg(long, value_name = "RIG")]
    rig: Option<String>,
    /// Model: the rig that MPObs and the feed-forward know, name or file (the plant of --rig)
    #[arg(long, value_name = "RIG")]
    model: Option<String>,
    /// Policy to start from: an ONNX file that trainer wrote, or the folder of a run (nothing: fresh weights)
    #[arg(long, value_name = "POLICY")]
    from: Option<PathBuf>,
    /// Threads that learn; the result is the same with any number (all cores, 4 at most)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=64))]
    threads: Option<u64>,
    /// Print the summary as one JSON object
    #[arg(long)]
    json: bool,
}

/// More threads than this wait for each other longer than they save.
pub(crate) const MOST_THREADS: usize = 4;

pub(crate) fn run(args: &TrainArgs) -> Result<(), Failure> {
    let stop = StopSignal::listen()?;
    let cores = std::thread::available_parallelism().map_or(1, |n| n.get());
    let threads = args.threads.map_or(cores.min(MOST_THREADS), |n| usize::try_from(n).unwrap_or(1));
    let mut run = match (&args.resume, &args.out) {
        (Some(folder), _) => Run::resume(folder, args.steps, threads)?,
        (None, Some(out)) => {
            let start = args.from.as_deref().map(PolicyStart::load).transpose()?;
            Run::begin(settings(args)?, start.as_ref(), out, threads)?
        }
        // clap asks for one of the two.
        (None, None) => return Ok(()),
    };
    let taken = run.taken();
    tell(&taken);
    let mut bar = TrainBar::new(stop.clone());
    let ended = run.go(&mut bar)?;
    bar.clear();
    let summary = run.summary();
    let done = match ended {
        RunStatus::Finished => Ok(()),
        RunStatus::Stopped => Err(stop.stopped("stopped before its end")),
    };
    if args.json {
        // The status of a stop counts, whether or not its summary can be told.
        return done.and(stdout::say_json(&json!(summary)));
    }
    let mut text = match ended {
        RunStatus::Finished => format!("{} steps done in {:.0} s", summary.steps, summary.wall_s),
        RunStatus::Stopped => format!(
            "stopped after {} of {} steps, kept; go on with: trainer train --resume {}",
            summary.steps,
            summary.steps_planned,
            run.files().folder().display()
        ),
    };
    text += &format!(
        " ({:.0} steps/s, environment {:.0} % of it; {:.0} MiB)\n",
        summary.steps_per_s,
        100.0 * summary.environment_share,
        summary.memory_mib
    );
    if let Some(kept) = summary.kept {
        text += &format!(
            "kept: the policy after {} steps, the best on randomised rigs set aside ({:.3} kPa){}\n",
            kept.step,
            kept.score_kpa,
            if kept.step == 0 {
                ": the one that the run began with; nothing that was learned tracked better"
            } else {
                ""
            }
        );
    }
    // Stopped within its first evaluation it has no figures.
    if !summary.evaluated.is_empty() {
        text += "rig                        RMSE positive  RMSE negative  duty change/tick pos, neg (RMS)\n";
    }
    for (e, fallback) in summary.evaluated.iter().zip(&summary.fallback) {
        for (e, who) in [(e, "policy"), (fallback, "fallback")] {
            text += &format!(
                "{:<16} {who:<9} {:>9.3} kPa  {:>9.3} kPa  {:.4}, {:.4}\n",
                e.rig, e.rmse_kpa[0], e.rmse_kpa[1], e.duty_change_rms[0], e.duty_change_rms[1]
            );
        }
    }
    text += &format!("see {}", run.files().report().display());
    if ended == RunStatus::Finished {
        text += &format!("; run it: controller demo --policy {}", run.files().onnx().display());
    }
    done.and(stdout::say(&text))
}

fn settings(args: &TrainArgs) -> Result<TrainingSettings, Failure> {
    let mut settings = settings_of(&args.config, args.rig.as_deref(), args.model.as_deref())?;
    settings.run.steps = args.steps.unwrap_or(settings.run.steps);
    settings.run.seed = args.seed.unwrap_or(settings.run.seed);
    settings.policy.variant = args.variant.unwrap_or(settings.policy.variant);
    Ok(settings)
}

/// The settings of a preset or a file, with another rig and model where these are asked for.
pub(crate) fn settings_of(config: &str, rig: Option<&str>, model: Option<&str>) -> Result<TrainingSettings, Failure> {
    let path = std::path::Path::new(config);
    let is_file = config.contains(['/', '.']) || path.is_file();
    let mut settings = if is_file {
        let text = proto::regular_file::read_text(path, MOST_SETTINGS_BYTES).map_err(|error| {
            training::TrainingError::File { file: config.to_owned(), problem: format!("cannot be read: {error}") }
        })?;
        TrainingSettings::parse(config, &text)?
    } else {
        TrainingSettings::preset(config)?
    };
    if let Some(rig) = rig {
        rig.clone_into(&mut settings.rig.trained_on);
        settings.rig.evaluated_on = vec![rig.to_owned()];
        settings.rig.model = None;
    }
    if let Some(model) = model {
        settings.rig.model = Some(model.to_owned());
    }
    Ok(settings)
}
