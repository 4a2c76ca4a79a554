//! `trainer adapt`: from recordings that differ to a controller that tracks better, beside a running daemon.

use std::io::{BufRead, IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::{Duration, Instant};

use ::adapt::found_in;
use ::adapt::journal::Journal;
use ::adapt::programs::Programs;
use ::adapt::rehearsal::{Rehearsal, concealed, draw_rig};
use ::adapt::run::GoesOn;
use ::adapt::settings::{Experiments, Search, Training};
use ::adapt::{AdaptError, AdaptSettings, Adaptation, Console, Outcome};
use clap::Args;
use proto::emulator::load_for_loop;
use proto::{live_line, output};
use serde_json::json;

use crate::failure::{Failure, tell};
use crate::stdout;
use crate::stop_signal::StopSignal;
use crate::work_shown::clock;

/// Adapts model and policy to the rig that a running daemon controls: the whole loop in one command.
///
/// Records, diagnoses, asks for an experiment where one is needed, gives the daemon the model that was found, runs the
/// fallback on it and the policy that controlled, trains a policy where more is left than any controller must leave,
/// publishes it, waits for the daemon's verdict, and tells what came of it. The
/// reference is begun anew for every figure, and put back at every end. A run that tracks worse than what was there is
/// ended early. Every step is a command that is shown; one that fails leaves model and
/// policy as they were, and --resume goes on from there. --rehearse does all of it against a concealed rig here.
/// Exit status: 0 it tracks better than before, 1 it does not or a step failed, 2 wrong usage, 130 or 143 stopped.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  trainer adapt --rehearse --out out/rehearsal
  trainer adapt --config controller.toml --out out/adapted --allow-experiment
  trainer adapt --resume out/adapted")]
pub(crate) struct AdaptArgs {
    /// Configuration of the running daemon
    #[arg(long, value_name = "FILE", required_unless_present_any = ["rehearse", "resume"])]
    config: Option<PathBuf>,
    /// Folder for everything that comes of it
    #[arg(long, value_name = "DIR", required_unless_present = "resume")]
    out: Option<PathBuf>,
    /// Folder of a run to go on with, as it was begun
    #[arg(long, value_name = "DIR", conflicts_with_all = ["config", "out", "rehearse", "allow_experiment", "fly_seconds", "diagnose_seconds", "thorough", "train_anyway", "train_rounds", "train_seconds", "verdict_seconds", "seed"])]
    resume: Option<PathBuf>,
    /// Start a concealed rig and a daemon on this machine, and adapt to that
    #[arg(long, conflicts_with = "config")]
    rehearse: bool,
    /// The concealed rig of the rehearsal, name or file [default: drawn by --seed]
    #[arg(long, value_name = "RIG", requires = "rehearse", conflicts_with_all = ["config", "resume"])]
    rig: Option<String>,
    /// The rig may be driven by an experiment where diagnosis needs one [default: ask once on the terminal]
    #[arg(long)]
    allow_experiment: bool,
    /// Longest run for a figure, in s of the rig, from 30 to 600; a shorter reference is run to its end
    #[arg(long = "run-seconds", alias = "fly-seconds", value_name = "S", default_value_t = 60, value_parser = clap::value_parser!(u32).range(30..=600))]
    fly_seconds: u32,
    /// The most of what was recorded that diagnosis reads, in s of the rig
    #[arg(long, value_name = "S", default_value_t = 120, value_parser = clap::value_parser!(u32).range(30..=3600))]
    diagnose_seconds: u32,
    /// Search for missing physics to the end instead of for a first look
    #[arg(long)]
    thorough: bool,
    /// Train a policy also where the best that was found leaves less than a quarter more than any controller must
    #[arg(long)]
    train_anyway: bool,
    /// Rounds of training at most
    #[arg(long, value_name = "N", default_value_t = 12, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    train_rounds: u64,
    /// Seconds of training at most
    #[arg(long, value_name = "S", default_value_t = 240, value_parser = clap::value_parser!(u64).range(1..))]
    train_seconds: u64,
    /// Seconds to wait for the daemon's verdict on a policy
    #[arg(long, value_name = "S", default_value_t = 900, value_parser = clap::value_parser!(u64).range(1..))]
    verdict_seconds: u64,
    /// Seed of the training, and of the rehearsal's rig
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// The daemon's program [default: beside this one, or on the PATH]
    #[arg(long, value_name = "PROGRAM")]
    controller: Option<PathBuf>,
    /// Print adapt.json instead of a summary
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &AdaptArgs) -> Result<(), Failure> {
    // A second signal ends nothing: what is being put back is put back.
    let stop = StopSignal::listen()?;
    adapt(args, Terminal::new(stop.clone()))
        .map_err(|failure| if failure.is_stopped_adaptation() { stop.stopped(failure.to_string()) } else { failure })
}

fn adapt(args: &AdaptArgs, mut terminal: Terminal) -> Result<(), Failure> {
    let programs = programs(args)?;
    let mut outcome = if let Some(out) = &args.resume {
        if out.join(REHEARSAL).is_dir() {
            return Err(Failure::NoRehearsal { out: out.display().to_string() });
        }
        go(Adaptation::resume(out, programs, Box::new(GoesOn))?, out, &mut terminal)?
    } else {
        // clap asks for it.
        let out = args.out.clone().unwrap_or_default();
        // Before anything is started or written.
        found_in::nothing(&out)?;
        match &args.config {
            Some(config) => {
                let config = absolute(config)?;
                output::check_folder(&out, ADAPTATION_BYTES)?;
                go(Adaptation::begin(settings(args, config), &out, programs, Box::new(GoesOn))?, &out, &mut terminal)?
            }
            None => rehearse(args, &out, programs, &mut terminal)?,
        }
    };
    terminal.clear();
    outcome.command = std::env::args().collect::<Vec<_>>().join(" ");
    let out = args.resume.clone().or(args.out.clone()).unwrap_or_default();
    outcome.write(&out)?;
    if args.json {
        stdout::say_json(&json!(outcome))?;
    } else {
        stdout::say(&format!("{}report: {}", outcome.text(), out.join("report.html").display()))?;
    }
    if outcome.is_better { Ok(()) } else { Err(Failure::NotBetter { kept: outcome.kept }) }
}

/// Runs it, and says where to go on where it fails.
fn go(mut adaptation: Adaptation, out: &Path, terminal: &mut Terminal) -> Result<Outcome, Failure> {
    adaptation.go(terminal).map_err(|error| {
        terminal.clear();
        let begun = Journal::is_in(out);
        let out = out.display().to_string();
        if begun { Failure::Adapt { error, out } } else { Failure::NotBegun { error, out } }
    })
}

/// Folder of a rehearsal's rig and daemon within that of `--out`.
const REHEARSAL: &str = "rehearsal";
/// Room that diagnoses, experiments and the run of a training need, in bytes.
const ADAPTATION_BYTES: u64 = 64 << 20;
/// Room that the daemon's recordings of a rehearsal and what is made of them need, in bytes.
const REHEARSAL_BYTES: u64 = 256 << 20;

/// A rehearsal's rig and daemon end with it, so there is nothing to go on with.
fn rehearsal_over(failure: Failure) -> Failure {
    match failure {
        Failure::Adapt { error, .. } | Failure::NotBegun { error, .. } => Failure::Rehearsed { error },
        other => other,
    }
}

fn rehearse(args: &AdaptArgs, out: &Path, programs: Programs, terminal: &mut Terminal) -> Result<Outcome, Failure> {
    let rig = match &args.rig {
        // Refused here with the reason; the emulator would only end.
        Some(rig) => load_for_loop(rig, None)?,
        None => draw_rig(args.seed)?,
    };
    output::check_folder(out, REHEARSAL_BYTES)?;
    let began = Instant::now();
    let folder = absolute(&out.join(REHEARSAL))?;
    let rehearsal = Rehearsal::start(&rig, args.seed, &folder, &programs, terminal)?;
    let mut settings = settings(args, rehearsal.config().to_owned());
    // Nobody is hurt here.
    settings.experiments = Experiments::Allowed;
    let adaptation = Adaptation::begin(settings, out, programs, rehearsal.pausable())?;
    let mut outcome = go(adaptation, out, terminal).map_err(rehearsal_over)?;
    outcome.concealed = Some(concealed(&rig));
    tell(&format!(
        "rehearsed in {:.0} s; the daemon's recordings are in {}",
        began.elapsed().as_secs_f64(),
        folder.display()
    ));
    Ok(outcome)
}

fn settings(args: &AdaptArgs, config: PathBuf) -> AdaptSettings {
    AdaptSettings {
        fly_seconds: f64::from(args.fly_seconds),
        diagnose_seconds: f64::from(args.diagnose_seconds),
        search: if args.thorough { Search::Whole } else { Search::Quick },
        experiments: if args.allow_experiment { Experiments::Allowed } else { Experiments::Ask },
        training: if args.train_anyway { Training::Always } else { Training::WhereItGains },
        train_rounds: args.train_rounds,
        train_seconds: args.train_seconds,
        verdict_seconds: args.verdict_seconds,
        seed: args.seed,
        ..AdaptSettings::new(config)
    }
}

fn absolute(path: &Path) -> Result<PathBuf, AdaptError> {
    std::path::absolute(path).map_err(|error| AdaptError::file(path, error))
}

/// This program, and the daemon's beside it or on the PATH.
fn programs(args: &AdaptArgs) -> Result<Programs, AdaptError> {
    let here = |error| AdaptError::file(Path::new("trainer"), format!("does not know where it is: {error}"));
    let trainer = std::env::current_exe().map_err(here)?;
    let beside = trainer.with_file_name("controller");
    // A bare name is looked for on the PATH, where it is started.
    if let Some(given) = args.controller.as_deref().filter(|given| given.components().count() > 1 && !given.is_file()) {
        return Err(AdaptError::file(given, "is no program; --controller takes the daemon's"));
    }
    let found = if beside.is_file() { beside } else { PathBuf::from("controller") };
    Ok(Programs { controller: args.controller.clone().unwrap_or(found), trainer })
}

const BAR_EVERY: Duration = Duration::from_millis(200);
const LINE_EVERY: Duration = Duration::from_secs(15);

/// Steps, commands, and what is being waited for; on a terminal the last in one line that is written over.
struct Terminal {
    stop: StopSignal,
    terminal: bool,
    step: String,
    began: Instant,
    next: Instant,
    is_shown: bool,
}

impl Terminal {
    fn new(stop: StopSignal) -> Self {
        let now = Instant::now();
        let terminal = std::io::stderr().is_terminal();
        Terminal { stop, terminal, step: String::new(), began: now, next: now + LINE_EVERY, is_shown: false }
    }

    fn clear(&mut self) {
        if std::mem::take(&mut self.is_shown) {
            write(live_line::CLEARED);
        }
    }
}

impl Console for Terminal {
    fn step(&mut self, number: usize, of: usize, what: &str) {
        self.clear();
        self.step = format!("{number}/{of}");
        write(&format!("\n[{} {}] {what}\n", self.step, clock(self.began.elapsed())));
    }

    fn command(&mut self, command: &str) {
        self.clear();
        write(&format!("$ {command}\n"));
    }

    fn say(&mut self, text: &str) {
        self.clear();
        tell(text);
    }

    fn waiting(&mut self, what: &str, elapsed: Duration, most: Option<Duration>) {
        let now = Instant::now();
        if now < self.next {
            return;
        }
        let most = most.map_or(String::new(), |most| format!(" of at most {}", clock(most)));
        let spent = if elapsed.is_zero() { String::new() } else { format!(", {}{most}", clock(elapsed)) };
        let line = format!("[{} {}] {what}{spent}", self.step, clock(self.began.elapsed()));
        if self.terminal {
            write(&live_line::written_over(&line));
            self.is_shown = true;
            self.next = now + BAR_EVERY;
        } else {
            write(&format!("{line}\n"));
            self.next = now + LINE_EVERY;
        }
    }

    fn stop(&self) -> bool {
        self.stop.has_come()
    }

    fn ask(&mut self, question: &str) -> bool {
        if !std::io::stdin().is_terminal() || !self.terminal {
            return false;
        }
        self.clear();
        write(&format!("{question} [y/N] "));
        // Read beside: a read does not end with a Ctrl-C, which is no answer.
        let (tell, told) = mpsc::channel();
        std::thread::spawn(move || {
            let mut answer = String::new();
            let is_yes =
                std::io::stdin().lock().read_line(&mut answer).is_ok() && answer.trim().eq_ignore_ascii_case("y");
            // Nobody waits for an answer behind a Ctrl-C.
            let _ = tell.send(is_yes);
        });
        while !self.stop() {
            match told.recv_timeout(BAR_EVERY) {
                Err(RecvTimeoutError::Timeout) => {}
                answer => return answer.unwrap_or(false),
            }
        }
        write("\n");
        false
    }
}

fn write(text: &str) {
    // What cannot be shown is no reason to stop the work.
    let _ = std::io::stderr().lock().write_all(text.as_bytes());
}
