//! `trainer export`: a trained policy as the file that the daemon runs.

use std::path::PathBuf;

use clap::Args;
use proto::emulator::load_for_loop;
use proto::{atomic_file, output};
use serde_json::json;
use training::TrainedPolicy;

use crate::failure::Failure;
use crate::stdout;

/// Writes a trained policy as ONNX: kPa gauge in, duties out, normalisation inside the graph.
///
/// The file carries the names and units of its observation layout, where it comes from (rig and its hash, seed, steps, variant),
/// and golden pairs of inputs and answers; before it is written, the graph is compared with the trainer's own network.
#[derive(Debug, Args)]
#[command(after_help = "Example:
  trainer export runs/first --out policies/default.onnx \\
    --note commit=$(git rev-parse HEAD)")]
pub(crate) struct ExportArgs {
    /// Folder of a run, or its policy.bin
    policy: PathBuf,
    /// File to write
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Ties the plan (outputs for later ticks, what MPObs rolls ahead) to what the policy then does; half a minute
    #[arg(long)]
    fit_plan: bool,
    /// A further key and value for the file's metadata; may be given several times
    #[arg(long, value_name = "KEY=VALUE", value_parser = note)]
    note: Vec<(String, String)>,
    /// Print what was written as one JSON object
    #[arg(long)]
    json: bool,
}

fn note(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((key, value)) if !key.trim().is_empty() => Ok((key.trim().to_owned(), value.to_owned())),
        _ => Err("give it as KEY=VALUE".to_owned()),
    }
}

/// Largest file of a policy that the daemon takes, in bytes.
const POLICY_BYTES: u64 = 16 << 20;

pub(crate) fn run(args: &ExportArgs) -> Result<(), Failure> {
    output::check_file(&args.out, POLICY_BYTES)?;
    let mut policy = TrainedPolicy::load(&args.policy)?;
    if args.fit_plan {
        policy = policy.with_fitted_plan()?;
    }
    if !policy.states_spread() {
        policy = policy.with_spread_on(&load_for_loop(policy.settings().rig.model(), Some("rig.model"))?)?;
    }
    let bytes = policy.to_onnx(&args.note)?;
    atomic_file::write(&args.out, &bytes)?;
    let settings = policy.settings();
    let (contract, variant) = (settings.policy.contract, settings.policy.variant.name());
    if args.json {
        return stdout::say_json(&json!({
            "file": args.out.display().to_string(),
            "bytes": bytes.len(),
            "contract": contract,
            "variant": variant,
            "seed": settings.run.seed,
            "steps": policy.steps(),
        }));
    }
    stdout::say(&format!(
        "{}: {} bytes; observation layout v{contract}, variant {variant}, seed {}, {} steps\ncheck it: controller check-policy {}",
        args.out.display(),
        bytes.len(),
        settings.run.seed,
        policy.steps(),
        args.out.display()
    ))
}
