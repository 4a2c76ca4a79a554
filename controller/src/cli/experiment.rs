//! `controller experiment`: the commands of a file, played once on the rig, within the safety envelope.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use clap::Args;
use controller::config::{Config, Control};
use controller::cycle::duty_source::ExperimentPhase;
use controller::experiment::waiting::{Obstacles, waits_for};
use controller::experiment::{Experiment, ExperimentError, Options, Played};
use controller::operator::latched_conditions::LatchedConditions;
use controller::operator::socket::is_there;
use controller::session::session_recorder::SessionError;
use controller::state::{Condition, State};
use flight::Recorded;
use proto::output::check_file;
use proto::recording::{PERIOD_S, TickRecord};
use proto::wire::Mode;
use serde_json::json;
use supervisor::{ConditionSet, Memory};

use super::console::{say, tell};
use super::screen::Screen;
use super::{Failure, experiment_within_run, is_configured_wrong};

/// Plays the commands of a file once on the rig, open loop, and records what it does.
///
/// For the next_experiment.csv of `trainer diagnose`. First the file is checked and simulated on the configured rig:
/// commands that would leave the safety envelope there are refused before anything moves. Then, on the rig: vents
/// open and pump off until both pressures stand still, the rows (20 ms each) exactly as they are, vents open again.
/// Over-pressure, a lost link, a broken sensor and `controller disarm` open both vents at once, as in the daemon; what
/// was recorded until then is kept, and the exit status is 1.
///
/// Where a daemon runs (it answers on control.socket), it plays the file while it stands by or controls, on the model and
/// within the envelope that it has in force, and goes on afterwards as before: armed again on its reference if it was
/// armed, standing by if not or if anything stopped the experiment. The recording stands in the daemon's record.directory.
/// This program only looks on then: leaving it stops nothing, `controller disarm` does. Without a daemon it connects to
/// the cRIO itself, and Ctrl-C and SIGTERM stop it.
#[derive(Debug, Args)]
#[command(after_help = "Example, and what comes next:
  controller experiment found/next_experiment.csv --config controller.toml
  trainer diagnose --rig dual_pressure run1.mcap run2.mcap \\
    recordings/experiment-….mcap --out found2")]
pub(crate) struct ExperimentArgs {
    /// Commands: CSV with time_s,u_pos,u_neg (duty 0 to 1) and, where the pump is switched, pump_on (0 or 1); a row
    /// every 20 ms, 120 s at most
    #[arg(value_name = "CSV")]
    csv: PathBuf,
    /// Configuration file (TOML), needed where no daemon runs; link, rig, safety, record and control are used
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// The daemon's socket [default: control.socket of the configuration, or `controller.sock` here]
    #[arg(long, value_name = "PATH")]
    socket: Option<PathBuf>,
    /// Recording (MCAP) [default: experiment-DATE-TIME.mcap in record.directory]; of one that a daemon made, a copy
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Print one JSON object, and nothing else on standard output
    #[arg(long)]
    json: bool,
}

/// Exit status and words of what failed.
impl From<ExperimentError> for Failure {
    fn from(error: ExperimentError) -> Self {
        match error {
            ExperimentError::SessionRecorder(SessionError::Link(link)) => {
                Failure::work(format!("{link} (nothing was moved, nothing recorded)"))
            }
            ExperimentError::SessionRecorder(ref session) if is_configured_wrong(session) => Failure::input(error),
            ExperimentError::SessionRecorder(_) => Failure::work(error),
            _ => Failure::input(error),
        }
    }
}

/// Room that the recording of an experiment of two minutes needs, in bytes.
const RECORDING_BYTES: u64 = 16 << 20;

/// Refuses a place for the recording before the rig moves.
fn check_out(out: &Path) -> Result<(), Failure> {
    if out.exists() && !out.is_dir() {
        let out = out.display();
        return Err(Failure::input(format!(
            "{out}: a recording of that name is there already; it is never written over; give --out another name"
        )));
    }
    check_file(out, RECORDING_BYTES).map_err(Failure::input)
}

impl ExperimentArgs {
    pub(super) fn run(self) -> Result<(), Failure> {
        let played = self.play();
        if self.json {
            match &played {
                Ok((forecast_kpa, played)) => say(format_args!("{}", self.object(*forecast_kpa, played))),
                Err(failure) => say(format_args!("{}", json!({"completed": false, "error": failure.line}))),
            }
        }
        let (_, played) = played?;
        self.conclude(&played)
    }

    /// Checks and plays; the range foreseen by channel in kPa, and what came of it.
    fn play(&self) -> Result<([[f64; 2]; 2], Played), Failure> {
        self.out.as_deref().map_or(Ok(()), check_out)?;
        let read =
            self.config.as_ref().map(|file| Ok::<_, Failure>((file, Config::read_with_text(file)?))).transpose()?;
        let configured = read.as_ref().map(|(_, (config, _))| config.control.socket.clone());
        let socket = self.socket.clone().or(configured).unwrap_or_else(|| Control::default().socket);
        if is_there(&socket).map_err(Failure::work)? {
            let (forecast_kpa, mut played) = experiment_within_run::play(&socket, &self.csv)?;
            if let Some(out) = &self.out {
                experiment_within_run::copy(&mut played, out)?;
            }
            return Ok((forecast_kpa, played));
        }
        match read {
            Some((file, (config, text))) => self.play_alone(file, &config, text),
            None => Err(Failure::input(format!(
                "no daemon answers on {}: give --config of the one that runs, or of the rig to play it without a daemon",
                socket.display()
            ))),
        }
    }

    /// Plays it without a daemon.
    fn play_alone(
        &self,
        file: &Path,
        config: &Config,
        config_text: String,
    ) -> Result<([[f64; 2]; 2], Played), Failure> {
        let experiment = Experiment::load(config, &self.csv)?;
        let forecast_kpa = experiment.forecast.range_kpa;
        let rows = u32::try_from(experiment.sequence.rows().len()).unwrap_or(u32::MAX);
        let (name, pump_off) = (self.csv.display().to_string(), experiment.sequence.pump_off());
        tell(foreseen(&name, rows, pump_off.as_deref(), &experiment.rig.name, forecast_kpa));
        let options = Options {
            recording: self.out.clone(),
            command: format!("controller experiment {name} --config {}", file.display()),
            config_text,
            observer: Box::new(watcher(experiment.sequence.seconds())),
            stop: Arc::new(AtomicBool::new(false)),
        };
        let played = experiment.run(config, options)?;
        Ok((forecast_kpa, played))
    }

    /// The last lines, and the exit status.
    fn conclude(&self, played: &Played) -> Result<(), Failure> {
        let path = played.recording.path.display();
        let witness = &played.witness;
        if !witness.is_clean() {
            tell(format_args!(
                "{} rows have no reading, and {} commands were not in force in their tick as the cRIO reports it; the recording's commands are not the rig's there",
                witness.without_reading, witness.not_applied
            ));
        }
        if let Some(why) = &played.aborted {
            let kept = if played.reached > 0 { "what was recorded is kept" } else { "no row was played; recorded" };
            return Err(Failure::work(format!(
                "experiment aborted after {} of {} rows ({:.2} s): {why}; both vents were commanded open; {kept}: {path}",
                played.reached,
                played.rows,
                played.seconds()
            )));
        }
        if !self.json {
            let [pos, neg] = witness.range_kpa.unwrap_or_default().map(range);
            say(format_args!(
                "all {} rows played ({:.2} s): positive {pos}, negative {neg} kPa\nrecording  {path}\nnext       trainer diagnose --rig RIG EARLIER… {path} --out DIR",
                played.rows,
                played.seconds()
            ));
        }
        Ok(())
    }

    fn object(&self, forecast_kpa: [[f64; 2]; 2], played: &Played) -> serde_json::Value {
        json!({
            "completed": played.aborted.is_none(),
            "aborted": played.aborted,
            "experiment": self.csv,
            "recording": played.recording.path,
            "rows": played.rows,
            "rows_played": played.reached,
            "seconds_played": played.seconds(),
            "forecast_kpa": forecast_kpa,
            "played": played.witness,
            "ticks_recorded": played.recording.ticks,
            "ticks_dropped": played.recording.ticks_dropped,
        })
    }
}

/// Tells what is going to be played, and the model's forecast of it.
pub(super) fn foreseen(
    file: &str,
    rows: u32,
    pump_off: Option<&str>,
    model: &str,
    forecast_kpa: [[f64; 2]; 2],
) -> String {
    format!(
        "{file}: {rows} rows ({:.2} s); {}; by the model {model} positive {}, negative {} kPa",
        f64::from(rows) * PERIOD_S,
        pump_off.map_or("pump on throughout".to_owned(), |off| format!("pump off in {off}")),
        range(forecast_kpa[0]),
        range(forecast_kpa[1]),
    )
}

fn range([least, most]: [f64; 2]) -> String {
    format!("{least:.1} … {most:.1}")
}

/// Shows how far the experiment is, and what happens.
fn watcher(seconds: f64) -> impl FnMut(Recorded<'_>) + Send {
    let screen = Screen::of_stderr();
    let mut next = Instant::now();
    let mut first = None;
    move |recorded| match recorded {
        Recorded::Tick(tick) => {
            if tick.mode != Mode::Vent.code() {
                first.get_or_insert(tick.tick);
            }
            let now = Instant::now();
            if now >= next {
                next = now + screen.every();
                screen.show(&line(tick, first, seconds));
            }
        }
        Recorded::Event { message, .. } => {
            screen.clear();
            tell(format_args!("{message}"));
        }
    }
}

fn line(tick: &TickRecord, first: Option<u32>, seconds: f64) -> String {
    let what = match (first, tick.mode != Mode::Vent.code()) {
        (Some(first), true) => {
            format!("{:6.2} s of {seconds:.2} s", f64::from(tick.tick.wrapping_sub(first)) * PERIOD_S)
        }
        (None, _) if tick.experiment == ExperimentPhase::Settling.code() => {
            let state = State::from_code(tick.state).unwrap_or_default();
            let found = ConditionSet::from_code_bits(tick.findings);
            let bars_arming = Memory::bars_arming(&found).filter(|_| state == State::Standby);
            // Without a daemon nobody can acknowledge.
            waits_for(
                state,
                Obstacles { fault: Condition::from_code(tick.fault), waiting: LatchedConditions::NONE, bars_arming },
            )
        }
        _ => "vents open".to_owned(),
    };
    format!(
        "{what}  {:+7.2} {:+7.2} kPa  duty {:.3} {:.3}  pump {}",
        tick.p_pos_kpa,
        tick.p_neg_kpa,
        tick.u_pos,
        tick.u_neg,
        if tick.pump_on { "on" } else { "off" }
    )
}
