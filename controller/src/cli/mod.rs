//! The command line.

mod check;
mod check_policy;
mod console;
mod demo;
mod experiment;
mod experiment_within_run;
mod live;
mod policies;
mod replay;
mod report;
mod rt_test;
mod run;
mod screen;
mod talk;

use std::path::PathBuf;

use clap::{CommandFactory, Parser, Subcommand};
use controller::config::ConfigError;
use controller::daemon::DaemonError;
use controller::operator::socket::SocketError;
use controller::policy_service::ServiceError;
use controller::session::session_recorder::SessionError;

/// First steps, below the list of commands.
const EXAMPLES: &str = "Examples:
  controller demo --fast                      the whole loop, no hardware
  controller rt-test                          is this machine fit for it?
  controller check --config controller.toml   is this configuration?
  controller run --config controller.toml     the daemon, vents open
  controller arm --config controller.toml     in another terminal: start
  controller disarm --config controller.toml  vents open

Exit status: 0 good; 1 the work failed or is not good; 2 wrong use or input; 130
or 143 stopped by Ctrl-C or SIGTERM before it was done, another signal 128 and
its number (`run` without --seconds, and `live`: 0).";

/// Controls the dual-pressure rig: +100 kPa and −75 kPa from one two-piston pump, 50 times a second
#[derive(Debug, Parser)]
#[command(name = "controller", version, about, after_help = EXAMPLES)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// The whole loop on this machine: an emulated cRIO over TCP, the daemon, the paper's reference.
    Demo(demo::Demo),
    /// The daemon.
    Run {
        /// Configuration file (TOML); only link.address is needed.
        #[arg(long, value_name = "FILE")]
        config: PathBuf,
        /// End this many seconds after the first arming, whatever happens in between (a fault, standing by, arming
        /// anew); without it, run until stopped.
        #[arg(long, value_name = "S")]
        seconds: Option<f64>,
    },
    Experiment(experiment::ExperimentArgs),
    Report(report::ReportArgs),
    Export(report::ExportArgs),
    Live(live::LiveArgs),
    Replay(replay::ReplayArgs),
    /// Says what is wrong with a configuration and with everything it names, or that all is sound.
    Check {
        /// Configuration file (TOML).
        #[arg(long, value_name = "FILE")]
        config: PathBuf,
        /// Print one JSON object.
        #[arg(long)]
        json: bool,
    },
    CheckPolicy(check_policy::CheckPolicy),
    RtTest(rt_test::RtTestArgs),
    /// Shows the state of a running daemon.
    Status(talk::Target),
    /// Starts controlling the pressures.
    Arm(talk::Target),
    /// Opens both vents, and says whether they are.
    ///
    /// Exit status: 0 the cRIO reports both open; 1 it does not, or the venting is in doubt, or there is no session, or somebody has
    /// armed the rig again: the last line says which, and what is known of the pressures.
    Disarm(talk::Target),
    /// Lists the policies: state, provenance, figures, and why one was refused.
    Policies(talk::Target),
    /// Sends a policy that has passed its checks to the rig, or back to it.
    Swap {
        /// The policy's name, without .onnx, or `fallback`.
        name: String,
        #[command(flatten)]
        target: talk::Target,
    },
    /// Takes a candidate back, or goes back to what controlled before.
    Rollback(talk::Target),
    /// Puts another model behind predictions, feed-forward and safety filter.
    Model {
        /// Rig file, or the name of a built-in rig.
        file: PathBuf,
        #[command(flatten)]
        target: talk::Target,
    },
    /// Begins or ends exploring: bounded, seeded noise on the active policy's answers, as it was trained with.
    ///
    /// For learning on the rig: the recording holds what was added in each tick. Needs the rig under control by a policy with
    /// all of the command. Ends by itself with any fault, with disarming, and with another policy or model.
    Explore {
        /// Switch that begins or ends it.
        switch: controller::operator::socket::Switch,
        /// Seed of the noise; left out, one from the clock, which the answer and the recording name
        #[arg(long)]
        seed: Option<u32>,
        #[command(flatten)]
        target: talk::Target,
    },
    /// Says that a person has looked at what vented the rig; then it can be armed again.
    Acknowledge(talk::Target),
    /// Follows another reference, from its start.
    Reference {
        /// CSV file: time_s,ref_pos_kpa,ref_neg_kpa.
        file: PathBuf,
        #[command(flatten)]
        target: talk::Target,
    },
    /// Writes manual pages and shell completions, for packages.
    #[command(hide = true)]
    Generate {
        /// Folder.
        folder: PathBuf,
    },
}

/// Kind of a failure, which gives the exit status.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum FailureKind {
    /// Usage or input are wrong.
    Refused,
    /// The work was not done to its end.
    Undone,
    /// The work was done, and its result is not good.
    NotGood,
}

/// Failure of a command.
#[derive(Debug)]
pub(crate) struct Failure {
    kind: FailureKind,
    /// One or two plain lines.
    pub(crate) line: String,
}

impl Failure {
    fn input(error: impl ToString) -> Self {
        Failure { kind: FailureKind::Refused, line: error.to_string() }
    }

    fn work(error: impl ToString) -> Self {
        Failure { kind: FailureKind::Undone, line: error.to_string() }
    }

    /// A run that was stopped before these seconds were over.
    fn stopped_run(seconds: f64) -> Self {
        Failure::work(format!("stopped before its {seconds} s were over; what was recorded is kept"))
    }

    fn not_good(error: impl ToString) -> Self {
        Failure { kind: FailureKind::NotGood, line: error.to_string() }
    }

    /// Exit status. `stopped` is that of the signal which asked for the end, if one did: it is the status of work that was left undone.
    pub(crate) fn status(&self, stopped: Option<u8>) -> u8 {
        match self.kind {
            FailureKind::Refused => 2,
            FailureKind::Undone => stopped.unwrap_or(1),
            FailureKind::NotGood => 1,
        }
    }
}

impl From<ConfigError> for Failure {
    fn from(error: ConfigError) -> Self {
        Failure::input(error)
    }
}

/// Tells whether a session cannot begin because of a place that the configuration names, so that another start would end alike. A disk that is
/// full or not yet there may be better next time, and another controller may have ended by then.
fn is_configured_wrong(error: &SessionError) -> bool {
    use std::io::ErrorKind as Kind;
    let is_of_the_place = |source: &std::io::Error| {
        matches!(
            source.kind(),
            Kind::NotFound
                | Kind::NotADirectory
                | Kind::IsADirectory
                | Kind::AlreadyExists
                | Kind::PermissionDenied
                | Kind::ReadOnlyFilesystem
                | Kind::InvalidFilename
                | Kind::InvalidInput
        )
    };
    match error {
        SessionError::Socket(SocketError::NotASocket { .. } | SocketError::LongPath { .. }) => true,
        SessionError::Socket(SocketError::Make { source, .. }) | SessionError::Directory { source, .. } => {
            is_of_the_place(source)
        }
        SessionError::Stream(error) => is_of_the_place(&error.source),
        SessionError::Policies(ServiceError::Admission(_)) => true,
        _ => false,
    }
}

impl From<DaemonError> for Failure {
    fn from(error: DaemonError) -> Self {
        match error {
            DaemonError::Rig(_)
            | DaemonError::Unflyable { .. }
            | DaemonError::Reference(_)
            | DaemonError::Policy(_)
            | DaemonError::Admission(_)
            | DaemonError::NoPolicy { .. }
            | DaemonError::ReferenceBeyond { .. } => Failure::input(error),
            DaemonError::SessionRecorder(ref session) if is_configured_wrong(session) => Failure::input(error),
            _ => Failure::work(error),
        }
    }
}

impl Arguments {
    /// Tells whether this command comes to an end by itself, so that a signal can leave it undone. Another is done when it is stopped.
    pub(crate) fn has_an_end(&self) -> bool {
        !matches!(self.command, Command::Run { seconds: None, .. } | Command::Live(_))
    }

    /// Does what was asked for.
    ///
    /// # Errors
    /// The failure, with the exit status that says whose fault it is.
    pub(crate) fn run(self) -> Result<(), Failure> {
        match self.command {
            Command::Demo(demo) => demo.run(),
            Command::Run { config, seconds } => run::run(&config, seconds),
            Command::Experiment(experiment) => experiment.run(),
            Command::Report(report) => report.run(),
            Command::Export(export) => export.run(),
            Command::Live(live) => live.run(),
            Command::Replay(replay) => replay.run(),
            Command::Check { config, json } => check::check(&config, json),
            Command::CheckPolicy(check) => check.run(),
            Command::RtTest(test) => test.run(),
            Command::Status(target) => target.status(),
            Command::Arm(target) => target.arm(),
            Command::Disarm(target) => target.disarm(),
            Command::Policies(target) => target.policies(),
            Command::Swap { name, target } => target.swap(&name),
            Command::Rollback(target) => target.rollback(),
            Command::Model { file, target } => target.model(&file),
            Command::Explore { switch, seed, target } => target.explore(switch, seed),
            Command::Acknowledge(target) => target.acknowledge(),
            Command::Reference { file, target } => target.reference(&file),
            Command::Generate { folder } => manual::write(Arguments::command(), &folder)
                .map_err(|e| Failure::work(format!("{}: {e}", folder.display()))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A signal that comes while the report of a whole run is written leaves the run as good, or as bad, as it was.
    #[test]
    fn only_undone_work_has_the_status_of_the_signal_that_came() {
        for (failure, status, with_sigterm) in
            [(Failure::input("x"), 2, 2), (Failure::work("x"), 1, 143), (Failure::not_good("x"), 1, 1)]
        {
            assert_eq!((failure.status(None), failure.status(Some(143))), (status, with_sigterm), "{failure:?}");
        }
    }
}
