//! `trainer`: simulates and validates rigs, plays the cRIO, and measures this machine.
//!
//! One file per command; what several of them need stands in a file named after it.

mod accuracy;
mod adapt;
mod bench;
mod diagnose;
mod evaluate;
mod export;
mod failure;
mod finetune;
mod identify;
mod improve;
mod interruptible;
mod progress;
mod rig;
mod rig_choice;
mod rig_log;
mod run_groups;
mod schedule;
mod simulate;
mod stdout;
mod stop_signal;
mod train;
mod train_bar;
mod validate;
mod work_shown;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{CommandFactory, Parser, Subcommand};

/// Companion of the dual-pressure controller: emulates the cRIO, simulates rigs, fits and checks a rig's model against
/// recordings, finds what the model lacks, and trains and compares policies.
///
/// Pressures are gauge kPa, times s, duties 0 (valve shut) to 1 (open). A recording is the daemon's
/// MCAP file or what a logger wrote, of any rate, its columns under the rig's names
/// (time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa) or as the rig file's `[recording]` says. Exit status: 0 good;
/// 1 the work failed or is not good; 2 wrong use or input; 130 or 143 stopped by Ctrl-C or SIGTERM before it was done.
#[derive(Debug, Parser)]
#[command(name = "trainer", version, after_help = EXAMPLES)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

const EXAMPLES: &str = "Examples:
  trainer rig --listen 127.0.0.1:50500
  trainer simulate --rig dual_pressure --inputs run.csv --out simulated.csv
  trainer identify --rig dual_pressure run1.mcap run2.csv --out lab.toml
  trainer validate --rig lab.toml run3.mcap
  trainer diagnose --rig bench run1.mcap run2.csv --out found
  trainer bench --json
  trainer train --out runs/first --steps 20000
  trainer evaluate comparison --runs runs --out tables/comparison
  trainer adapt --rehearse --out out/rehearsal";

#[derive(Debug, Subcommand)]
enum Command {
    Rig(rig::RigArgs),
    Simulate(simulate::SimulateArgs),
    Identify(identify::IdentifyArgs),
    Validate(validate::ValidateArgs),
    Diagnose(diagnose::DiagnoseArgs),
    Bench(bench::BenchArgs),
    Train(train::TrainArgs),
    Improve(improve::ImproveArgs),
    Finetune(finetune::FinetuneArgs),
    Adapt(adapt::AdaptArgs),
    Evaluate(evaluate::EvaluateArgs),
    Export(export::ExportArgs),
    /// Writes manual pages and shell completions, for packages
    #[command(hide = true)]
    Generate {
        /// Folder
        folder: PathBuf,
    },
}

fn main() -> ExitCode {
    proto::parent_process::end_with_parent();
    let cli = match manual::parse::<Cli>() {
        Ok(cli) => cli,
        Err(error) => return explain(&error),
    };
    let done = match &cli.command {
        Command::Rig(args) => rig::run(args),
        Command::Simulate(args) => simulate::run(args),
        Command::Identify(args) => identify::run(args),
        Command::Validate(args) => validate::run(args),
        Command::Diagnose(args) => diagnose::run(args),
        Command::Bench(args) => bench::run(args),
        Command::Train(args) => train::run(args),
        Command::Improve(args) => improve::run(args),
        Command::Finetune(args) => finetune::run(args),
        Command::Adapt(args) => adapt::run(args),
        Command::Evaluate(args) => evaluate::run(args),
        Command::Export(args) => export::run(args),
        Command::Generate { folder } => manual::write(Cli::command(), folder)
            .map_err(|source| failure::Failure::Generate { folder: folder.display().to_string(), source }),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => failure.told(),
    }
}

/// Help where it was asked for, two lines where the command line is wrong; the exit status.
fn explain(error: &clap::Error) -> ExitCode {
    let columns = proto::terminal_lines::width(&std::io::stdout());
    match manual::explain(&Cli::command(), error, columns) {
        manual::Explained::Help(text) => match stdout::put(&text) {
            Ok(()) => ExitCode::SUCCESS,
            Err(failure) => failure.told(),
        },
        manual::Explained::Wrong(lines) => {
            lines.iter().for_each(|line| failure::tell(line));
            ExitCode::from(failure::BAD_INPUT)
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    /// clap's own check of the whole command line: names twice, defaults that do not parse.
    #[test]
    fn the_command_line_is_sound() {
        super::Cli::command().debug_assert();
    }
}
