//! `hidden_rig`: makes suites of concealed cases, and runs experiments on the rigs that are hidden in them.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::{AtomicUsize, Ordering};

use clap::{Parser, Subcommand, ValueEnum};
use hidden_rig::case::{Case, Plan};
use hidden_rig::recording::read_commands;
use hidden_rig::sizing::larger;
use hidden_rig::suite::{Made, Suite, make_suite, seed_of};
use hidden_rig::truth::Truth;

/// A rig that shares no code with the model, with effects concealed in it.
#[derive(Parser)]
#[command(version, about)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Writes a suite: recordings under OUT/cases, truths aside under OUT/truth.
    Make {
        /// Which suite.
        #[arg(long, value_enum, default_value_t = SuiteName::Ci)]
        suite: SuiteName,
        /// Seed of all draws: a number, or a word.
        #[arg(long, default_value = "1")]
        seed: String,
        /// Folder to write into.
        #[arg(long)]
        out: PathBuf,
        /// Threads; as many as there are cores, if left out.
        #[arg(long)]
        threads: Option<usize>,
        /// No nuisance is larger than this (kPa, raw).
        #[arg(long, default_value_t = 0.06)]
        nuisance_ceiling_kpa: f64,
        /// Makes only the cases whose name contains this.
        #[arg(long)]
        only: Option<String>,
    },
    /// Runs the commands of an experiment (time_s,u_pos,u_neg,pump_on) on the rig that is hidden in a case.
    Run {
        /// The case's truth file.
        #[arg(long)]
        case_truth: PathBuf,
        /// The commands.
        #[arg(long)]
        inputs: PathBuf,
        /// The recording to write.
        #[arg(long)]
        out: PathBuf,
        /// Writes the trace without noise as well, for the scorer.
        #[arg(long)]
        clean: Option<PathBuf>,
    },
}

#[derive(Clone, Copy, ValueEnum)]
enum SuiteName {
    /// Eight cases, made in seconds.
    Ci,
    /// Some 140 cases.
    Full,
}

fn main() -> ExitCode {
    match Cli::parse().command {
        Command::Make { suite, seed, out, threads, nuisance_ceiling_kpa, only } => {
            let suite = match suite {
                SuiteName::Ci => Suite::Ci,
                SuiteName::Full => Suite::Full,
            };
            let mut plans = suite.plans(seed_of(&seed));
            if let Some(part) = only {
                plans.retain(|plan| plan.name.contains(&part));
            }
            let making = hidden_rig::case::Making { nuisance_ceiling_kpa, ..suite.making() };
            let threads = threads.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from));
            let done = AtomicUsize::new(0);
            let told = |plan: &Plan, case: Option<&Case>| {
                let done = done.fetch_add(1, Ordering::Relaxed) + 1;
                match case {
                    Some(case) => eprintln!("{}", line(done, plans.len(), case)),
                    None => eprintln!("{done}/{} {}: there already", plans.len(), plan.name),
                }
            };
            if let Err(error) = (Made { suite: suite.name().to_owned(), seed }).write(&out) {
                return failed(&error);
            }
            match make_suite(&plans, &making, &out, threads, &told) {
                Ok(()) => {
                    eprintln!(
                        "{} cases in {}; truths aside in {}",
                        plans.len(),
                        out.display(),
                        out.join("truth").display()
                    );
                    ExitCode::SUCCESS
                }
                Err(error) => failed(&error),
            }
        }
        Command::Run { case_truth, inputs, out, clean } => {
            let truth = match Truth::read(&case_truth) {
                Ok(truth) => truth,
                Err(error) => return bad_input(&error),
            };
            let commands = match read_commands(&inputs) {
                Ok(commands) => commands,
                Err(error) => return bad_input(&error),
            };
            let recording = truth.experiment(&commands);
            let written =
                recording.write(&out).and_then(|()| clean.map_or(Ok(()), |clean| recording.write_clean(&clean)));
            if let Err(error) = written {
                return failed(&error);
            }
            let [[low, high], [lowest, highest]] = recording.extremes_kpa();
            eprintln!(
                "{} rows; positive {low:.1} to {high:.1} kPa, negative {lowest:.1} to {highest:.1} kPa",
                recording.rows.len()
            );
            ExitCode::SUCCESS
        }
    }
}

/// Line on a case that is done: sizes, but not what it conceals, since the maker may be the one who diagnoses.
fn line(done: usize, of: usize, case: &Case) -> String {
    let held_out = case.truth.recordings.last().and_then(|entry| entry.effect_kpa).map_or(0.0, larger);
    format!("{done}/{of} {}: {:.2} kPa held out", case.truth.case, held_out)
}

/// The work failed: status 1.
fn failed(error: &dyn std::error::Error) -> ExitCode {
    eprintln!("hidden_rig: {error}");
    ExitCode::from(1)
}

/// Bad input: status 2, as with wrong usage.
fn bad_input(error: &dyn std::error::Error) -> ExitCode {
    eprintln!("hidden_rig: {error}");
    ExitCode::from(2)
}
