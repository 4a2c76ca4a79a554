//! `score_card`: runs a trainer's diagnose on a suite of concealed cases and writes its score card.

use std::fs::{self, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use clap::{Args, Parser, Subcommand};
use hidden_rig::recording::write_whole;
use hidden_rig::suite::Made;
use score_card::card::{Card, Provenance};
use score_card::case::{CaseScore, Scoring, score};
use score_card::markdown;
use score_card::trainer::Trainer;
use score_card::worth::Worth;

/// Judges `trainer diagnose` on a suite that `hidden_rig make` wrote.
///
/// A line of JSON a case goes into OUT/cases.jsonl; a run that was cut off goes on where it was. The score card is
/// OUT/score_card.json and OUT/score_card.md.
#[derive(Debug, Parser)]
#[command(version, args_conflicts_with_subcommands = true)]
struct Cli {
    #[command(flatten)]
    score: Option<Scored>,
    #[command(subcommand)]
    command: Option<Reading>,
}

/// Use that is made of lines that are there.
#[derive(Debug, Subcommand)]
enum Reading {
    /// Prints how often what an answer says is so, over the cases of one or more files of lines
    Worth {
        /// Files as OUT/cases.jsonl
        #[arg(required = true, value_name = "LINES")]
        lines: Vec<PathBuf>,
    },
}

/// Suite that is scored, and its cases.
#[derive(Debug, Args)]
struct Scored {
    /// The trainer that is judged: path of the program
    #[arg(long, value_name = "PROGRAM")]
    trainer: PathBuf,
    /// Folder of the suite, with cases.json, cases/ and truth/
    #[arg(long, value_name = "DIR")]
    suite: PathBuf,
    /// Folder for lines, score card and what the trainer writes
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Cases at a time; time is fairest with one
    #[arg(long, value_name = "N", default_value_t = 1)]
    jobs: usize,
    /// Only cases whose name contains this
    #[arg(long, value_name = "PART")]
    only: Option<String>,
    /// Asks for quick diagnoses
    #[arg(long)]
    quick: bool,
    /// Experiments that an undecided answer may ask for
    #[arg(long, value_name = "N", default_value_t = 1)]
    experiments: usize,
    /// Leaves out the fit of the parameters alone, and with it the share of the gain
    #[arg(long)]
    no_refit: bool,
    /// Ends a diagnosis after this long
    #[arg(long, value_name = "S", default_value_t = 1200.0)]
    limit_s: f64,
    /// Rig that every diagnosis starts from
    #[arg(long, value_name = "RIG", default_value = hidden_rig::suite::NOMINAL_RIG)]
    rig: String,
    /// Only writes the card anew from the lines that are there
    #[arg(long)]
    sum_up: bool,
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    let done = match (cli.command, cli.score) {
        (Some(Reading::Worth { lines }), _) => worth(&lines),
        (None, Some(scored)) => run(&scored),
        (None, None) => Err(Failure::Truth("no suite is given".to_owned())),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("score_card: {error}");
            ExitCode::from(error.status())
        }
    }
}

/// Why there is no score card.
#[derive(Debug, thiserror::Error)]
enum Failure {
    #[error("{}: {source}; make a suite with `hidden_rig make --suite full --seed 1 --out DIR`", file.display())]
    Suite { file: PathBuf, source: std::io::Error },
    #[error("{}: {what}", file.display())]
    Input { file: PathBuf, what: String },
    #[error("{0}; make a suite with `hidden_rig make`")]
    Truth(String),
    #[error("{0}")]
    Work(String),
}

impl Failure {
    fn status(&self) -> u8 {
        match self {
            Self::Suite { .. } | Self::Input { .. } | Self::Truth(_) => 2,
            Self::Work(_) => 1,
        }
    }
}

/// Prints what answers are worth.
fn worth(files: &[PathBuf]) -> Result<(), Failure> {
    let mut cases = Vec::new();
    for file in files {
        let text = fs::read_to_string(file).map_err(|error| {
            let what = format!("{error}; name the cases.jsonl of a score card");
            Failure::Input { file: file.clone(), what }
        })?;
        cases.extend(lines_in(file, &text)?);
    }
    println!("{} cases\n\n{}", cases.len(), Worth::of(&cases).table());
    Ok(())
}

fn run(cli: &Scored) -> Result<(), Failure> {
    let made = Made::read(&cli.suite).map_err(|error| Failure::Truth(error.to_string()))?;
    let mut names = case_names(&cli.suite)?;
    if let Some(part) = &cli.only {
        names.retain(|name| name.contains(part.as_str()));
    }
    let lines = cli.out.join("cases.jsonl");
    fs::create_dir_all(&cli.out).map_err(|source| Failure::Suite { file: cli.out.clone(), source })?;
    let mut scored = read_lines(&lines)?;
    if !cli.sum_up {
        let left: Vec<String> =
            names.iter().filter(|name| scored.iter().all(|line| line.case != **name)).cloned().collect();
        let scoring = Scoring {
            trainer: Trainer {
                program: cli.trainer.clone(),
                rig: cli.rig.clone(),
                quick: cli.quick,
                limit: Duration::from_secs_f64(cli.limit_s.max(1.0)),
            },
            suite: cli.suite.clone(),
            making: made.making(),
            work: cli.out.join("work"),
            experiments: cli.experiments,
            refit: !cli.no_refit,
        };
        scored.extend(score_all(&left, &scoring, cli.jobs, &lines)?);
    }
    scored.sort_by(|a, b| a.case.cmp(&b.case));
    let provenance = Provenance {
        command: command_line(cli, &made),
        suite: made.suite,
        seed: made.seed,
        commit: commit(),
        cores: std::thread::available_parallelism().map_or(1, usize::from),
    };
    let card = Card::of(&scored, provenance);
    let text = serde_json::to_string_pretty(&card).map_err(|error| Failure::Work(error.to_string()))? + "\n";
    let write = |name: &str, text: &str| {
        write_whole(&cli.out.join(name), text.as_bytes()).map_err(|error| Failure::Work(error.to_string()))
    };
    write("score_card.json", &text)?;
    write("score_card.md", &markdown::page(&card, &scored))?;
    eprintln!("{} cases; score card in {}", scored.len(), cli.out.join("score_card.md").display());
    Ok(())
}

/// The cases of a suite whose truths are written.
fn case_names(suite: &Path) -> Result<Vec<String>, Failure> {
    let folder = suite.join("truth");
    let entries = fs::read_dir(&folder).map_err(|source| Failure::Suite { file: folder.clone(), source })?;
    let mut names: Vec<String> = entries
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter_map(|name| name.strip_suffix(".json").map(str::to_owned))
        .filter(|name| name.starts_with("case_"))
        .collect();
    names.sort();
    Ok(names)
}

/// The lines that are there, of a file that need not be.
fn read_lines(file: &Path) -> Result<Vec<CaseScore>, Failure> {
    match fs::read_to_string(file) {
        Ok(text) => lines_in(file, &text),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(Vec::new()),
        Err(source) => Err(Failure::Suite { file: file.to_owned(), source }),
    }
}

/// The lines of a file; a last line that was cut off is left out, to be scored again.
fn lines_in(file: &Path, text: &str) -> Result<Vec<CaseScore>, Failure> {
    let mut cases: Vec<CaseScore> = Vec::new();
    for (k, line) in text.lines().enumerate() {
        match serde_json::from_str(line) {
            Ok(case) => cases.push(case),
            Err(_) if k + 1 == text.lines().count() && !text.ends_with('\n') => {}
            Err(error) => {
                let what = format!("line {}: {error}; remove the line, or the file to begin anew", k + 1);
                return Err(Failure::Input { file: file.to_owned(), what });
            }
        }
    }
    Ok(cases)
}

fn score_all(names: &[String], scoring: &Scoring, jobs: usize, lines: &Path) -> Result<Vec<CaseScore>, Failure> {
    // A line that was cut off would spoil the next one.
    let whole = read_lines(lines)?;
    let text: String = whole.iter().filter_map(|case| serde_json::to_string(case).ok()).map(|l| l + "\n").collect();
    write_whole(lines, text.as_bytes()).map_err(|error| Failure::Work(error.to_string()))?;
    let file = OpenOptions::new()
        .append(true)
        .open(lines)
        .map_err(|source| Failure::Suite { file: lines.to_owned(), source })?;
    let (next, file) = (AtomicUsize::new(0), Mutex::new((file, Vec::new(), None::<String>)));
    let work = || {
        while let Some(name) = names.get(next.fetch_add(1, Ordering::Relaxed)) {
            let result = score(name, scoring).map_err(|error| error.to_string());
            let Ok(mut held) = file.lock() else { return };
            if held.2.is_some() {
                return;
            }
            match result.and_then(|case| Ok((serde_json::to_string(&case).map_err(|error| error.to_string())?, case))) {
                Ok((line, case)) => {
                    if let Err(error) = writeln!(held.0, "{line}").and_then(|()| held.0.sync_data()) {
                        held.2 = Some(format!("{}: {error}", lines.display()));
                        return;
                    }
                    held.1.push(case);
                    // What is concealed is not said: whoever works on the diagnosis may be watching.
                    let case = &held.1[held.1.len() - 1];
                    eprintln!("{}/{} {name}: {:.0} s", held.1.len(), names.len(), case.took.wall_s);
                }
                Err(error) => held.2 = Some(error),
            }
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..jobs.max(1) {
            scope.spawn(work);
        }
    });
    let (_, cases, error) = file.into_inner().map_err(|error| Failure::Work(error.to_string()))?;
    error.map_or(Ok(cases), |error| Err(Failure::Work(error)))
}

/// The commands that make the suite and the card again, without this machine's paths.
fn command_line(cli: &Scored, made: &Made) -> String {
    let mut score =
        "cargo run --release -p score_card -- --trainer target/release/trainer --suite SUITE --out CARD".to_owned();
    if cli.quick {
        score.push_str(" --quick");
    }
    if cli.experiments != 1 {
        score.push_str(&format!(" --experiments {}", cli.experiments));
    }
    if cli.no_refit {
        score.push_str(" --no-refit");
    }
    if let Some(part) = &cli.only {
        score.push_str(&format!(" --only {part}"));
    }
    format!(
        "cargo run --release -p hidden_rig -- make --suite {} --seed {} --out SUITE\n{score}",
        made.suite, made.seed
    )
}

/// Commit of the checkout that this runs in, with `+` if tracked files had been changed since.
fn commit() -> String {
    let git = |arguments: &[&str]| {
        let output = Command::new("git").args(arguments).output().ok().filter(|output| output.status.success())?;
        Some(String::from_utf8_lossy(&output.stdout).trim().to_owned())
    };
    let Some(head) = git(&["rev-parse", "--short=12", "HEAD"]) else { return "unknown".to_owned() };
    let changed = git(&["status", "--porcelain", "--untracked-files=no"]).is_some_and(|text| !text.is_empty());
    if changed { head + "+" } else { head }
}
