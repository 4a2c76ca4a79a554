//! `trainer train`: learns a policy in simulation.

use std::io::{IsTerminal, Write};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::Args;
use serde_json::json;
use signal_hook::consts::{SIGINT, SIGTERM};
use training::{Progress, Run, RunStatus, TrainingCallback, TrainingSettings, Variant};

use crate::failure::Failure;
use crate::stdout;

/// Learns a policy in simulation: Soft Actor-Critic with smooth actions (CAPS) and model-predicted observations.
///
/// A run is a folder: settings, learning curve (JSON lines, TensorBoard), checkpoint, policy, report. Without --config
/// it is the paper's Table IV on the paper's rig. Ctrl-C ends the episode (half a minute), writes a checkpoint and
/// stops, and once more stops at once; --resume goes on to the same result. The end exports policy.onnx, which the daemon flies.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  trainer train --out runs/first --steps 20000
  trainer train --config correction --seed 2 --out runs/correction-2
  trainer train --config paper --variant raw --rig bench --out runs/raw
  trainer train --resume runs/first --steps 512000")]
pub(crate) struct TrainArgs {
    /// Settings: a preset (paper, paper-drawn, correction) or a TOML file; keys that are left out have the paper's values
    #[arg(long, value_name = "PRESET|FILE", default_value = "paper", conflicts_with = "resume")]
    config: String,
    /// Folder of the new run
    #[arg(long, value_name = "DIR", required_unless_present = "resume")]
    out: Option<PathBuf>,
    /// Folder of a run to go on with
    #[arg(long, value_name = "DIR", conflicts_with_all = ["out", "seed", "variant", "rig"])]
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
    /// Rig to train on or to draw around, name or file, instead of the settings' (dual_pressure)
    #[arg(long, value_name = "RIG")]
    rig: Option<String>,
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
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        // The second signal ends the program at once: the checkpoint that is there stays as it is.
        signal_hook::flag::register_conditional_shutdown(signal, 130, Arc::clone(&stop)).map_err(Failure::Signals)?;
        signal_hook::flag::register(signal, Arc::clone(&stop)).map_err(Failure::Signals)?;
    }
    let cores = std::thread::available_parallelism().map_or(1, |n| n.get());
    let threads = args.threads.map_or(cores.min(MOST_THREADS), |n| usize::try_from(n).unwrap_or(1));
    let mut run = match (&args.resume, &args.out) {
        (Some(folder), _) => Run::resume(folder, args.steps, threads)?,
        (None, Some(out)) => Run::begin(settings(args)?, out, threads)?,
        // clap asks for one of the two.
        (None, None) => return Ok(()),
    };
    let mut bar = Bar::new(stop);
    let ended = run.go(&mut bar)?;
    bar.clear();
    let summary = run.summary()?;
    if args.json {
        return stdout::say_json(&json!(summary));
    }
    let mut text = match ended {
        RunStatus::Finished => format!("{} steps done in {:.0} s", summary.steps, summary.wall_s),
        RunStatus::Stopped => format!(
            "stopped after {} of {} steps; go on with: trainer train --resume {}",
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
            "kept: the policy after {} steps, the best on drawn rigs set aside ({:.3} kPa)\n",
            kept.step, kept.score_kpa
        );
    }
    text += "rig              RMSE positive  RMSE negative  duty change/tick pos, neg (RMS)\n";
    for e in &summary.evaluated {
        text += &format!(
            "{:<16} {:>9.3} kPa  {:>9.3} kPa  {:.4}, {:.4}\n",
            e.rig, e.rmse_kpa[0], e.rmse_kpa[1], e.duty_change_rms[0], e.duty_change_rms[1]
        );
    }
    text += &format!("see {}", run.files().report().display());
    if ended == RunStatus::Finished {
        text += &format!("; fly it: controller demo --policy {}", run.files().onnx().display());
    }
    stdout::say(&text)
}

fn settings(args: &TrainArgs) -> Result<TrainingSettings, Failure> {
    let path = std::path::Path::new(&args.config);
    let is_file = args.config.contains(['/', '.']) || path.is_file();
    let mut settings = if is_file {
        let text = std::fs::read_to_string(path).map_err(|error| training::TrainingError::File {
            file: args.config.clone(),
            problem: format!("cannot be read: {error}"),
        })?;
        TrainingSettings::parse(&args.config, &text)?
    } else {
        TrainingSettings::preset(&args.config)?
    };
    settings.run.steps = args.steps.unwrap_or(settings.run.steps);
    settings.run.seed = args.seed.unwrap_or(settings.run.seed);
    settings.policy.variant = args.variant.unwrap_or(settings.policy.variant);
    if let Some(rig) = &args.rig {
        settings.rig.trained_on.clone_from(rig);
    }
    Ok(settings)
}

/// A bar on a terminal, plain lines elsewhere.
struct Bar {
    stop: Arc<AtomicBool>,
    terminal: bool,
    next: Instant,
    shown: bool,
    told_stop: bool,
}

const BAR_EVERY: Duration = Duration::from_millis(200);
const LINE_EVERY: Duration = Duration::from_secs(15);
const BAR_WIDTH: usize = 20;

impl Bar {
    fn new(stop: Arc<AtomicBool>) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let next = Instant::now() + if terminal { BAR_EVERY } else { LINE_EVERY };
        Bar { stop, terminal, next, shown: false, told_stop: false }
    }

    fn clear(&mut self) {
        if self.shown {
            self.write("\r\x1b[K");
            self.shown = false;
        }
    }

    fn write(&self, text: &str) {
        // Progress that cannot be shown is no reason to stop the work.
        let _ = std::io::stderr().lock().write_all(text.as_bytes());
    }
}

impl TrainingCallback for Bar {
    fn progress(&mut self, p: &Progress) {
        if self.stop.load(Ordering::Relaxed) && !self.told_stop {
            self.told_stop = true;
            self.clear();
            self.write("trainer: stopping after this episode (half a minute); once more stops at once, back to the last checkpoint\n");
        }
        let now = Instant::now();
        if now < self.next {
            return;
        }
        let left =
            if p.steps_per_s > 0.0 { p.steps_planned.saturating_sub(p.steps) as f64 / p.steps_per_s } else { 0.0 };
        let evaluated = p
            .last_evaluation
            .as_ref()
            .map_or(String::new(), |e| format!(", {} {:.2}/{:.2} kPa", e.rig, e.rmse_kpa[0], e.rmse_kpa[1]));
        let figures = format!(
            "{:.0} steps/s, reward {:.3}, acting {:.2}/{:.2} kPa{evaluated}, {}:{:02} left",
            p.steps_per_s,
            p.reward,
            p.acting_rmse_kpa[0],
            p.acting_rmse_kpa[1],
            left as u64 / 60,
            left as u64 % 60
        );
        let percent = 100 * p.steps / p.steps_planned.max(1);
        if self.terminal {
            let full = BAR_WIDTH * usize::try_from(percent.min(100)).unwrap_or(100) / 100;
            self.write(&format!(
                "\r\x1b[K[{}{}] {percent:3} % {figures}",
                "#".repeat(full),
                "-".repeat(BAR_WIDTH - full)
            ));
            self.shown = true;
            self.next = now + BAR_EVERY;
        } else {
            self.write(&format!("step {} of {}: {figures}\n", p.steps, p.steps_planned));
            self.next = now + LINE_EVERY;
        }
    }

    fn stop(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}
