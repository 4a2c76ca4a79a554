//! Reason why a command ends without its work done: one plain line, and the exit status.

use std::io::{self, Write};
use std::process::ExitCode;

use ::adapt::AdaptError;
use ::evaluate::join::JoinError;
use ::finetune::FinetuneError;
use diagnose::DiagnoseError;
use fit::FitError;
use free_run::FreeRunError;
use proto::atomic_file::AtomicFileError;
use proto::emulator::{EmulatorError, FaultScriptError};
use proto::output::OutputError;
use proto::recording::RecordingError;
use proto::reference::ReferenceError;
use proto::rig_file::RigFileError;
use proto::terminal_lines;
use training::TrainingError;

use crate::bench::LanesDiffer;

/// Exit status of work that failed.
pub(crate) const FAILED: u8 = 1;
/// Exit status of wrong usage and bad input.
pub(crate) const BAD_INPUT: u8 = 2;

/// Reason why a command ends without its work done.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Failure {
    #[error(transparent)]
    Rig(#[from] RigFileError),
    #[error(transparent)]
    Recording(#[from] RecordingError),
    #[error(transparent)]
    Reference(#[from] ReferenceError),
    #[error(transparent)]
    FreeRun(#[from] FreeRunError),
    #[error(transparent)]
    Fit(#[from] FitError),
    #[error(transparent)]
    Diagnose(#[from] DiagnoseError),
    #[error("the answer cannot be put into JSON: {0}")]
    Json(serde_json::Error),
    #[error(transparent)]
    Faults(#[from] FaultScriptError),
    #[error(transparent)]
    Emulator(#[from] EmulatorError),
    #[error(transparent)]
    Output(#[from] OutputError),
    #[error(transparent)]
    Write(#[from] AtomicFileError),
    #[error(transparent)]
    Lanes(#[from] LanesDiffer),
    #[error(transparent)]
    Training(#[from] TrainingError),
    #[error(transparent)]
    Finetune(#[from] FinetuneError),
    #[error(transparent)]
    Rehearsal(#[from] AdaptError),
    #[error("{error}{}; go on with: trainer adapt --resume {out}", match .error { AdaptError::NotRestored(_) | AdaptError::ReferenceLeft { .. } => "", AdaptError::Changed { .. } => "; what this run had changed is put back, and what you put in place of its reference stays", _ => "; model, policy and reference are as they were" })]
    Adapt { error: AdaptError, out: String },
    #[error("{error}; nothing was changed and {out} was not begun: see to that, then give the same command again")]
    NotBegun { error: AdaptError, out: String },
    #[error("{error}; the rehearsal's rig and daemon have ended with it: begin anew, with another --out")]
    Rehearsed { error: AdaptError },
    #[error("{out}: this was a rehearsal, whose rig and daemon have ended with it; begin anew, with another --out")]
    NoRehearsal { out: String },
    #[error("the rig does not track better than before; kept: {kept}")]
    NotBetter { kept: String },
    #[error(transparent)]
    Join(#[from] JoinError),
    #[error("learning cannot be timed: {0}")]
    Learner(String),
    #[error("{out}: this is the file of --inputs, which would be lost; give --out another name")]
    OverInputs { out: String },
    #[error("--out -: the table takes standard output, where --json has no place beside it; leave out one of the two")]
    TwoOutputs,
    #[error("{out}: this is one of the recordings, which would be lost; give --out another name")]
    OverRecording { out: String },
    #[error(
        "the identified rig is off by {after_kpa:.2} kPa on validation data where the rig as it was given is off by \
         {before_kpa:.2} kPa: worse than before, so {out} is not written; `trainer diagnose` looks for what the rig file lacks"
    )]
    WorseThanBefore { before_kpa: f64, after_kpa: f64, out: String },
    #[error("not good: {why}; {out} is written all the same, `trainer diagnose` looks for what the rig file lacks")]
    InPart { why: String, out: String },
    #[error("not good: {0}; until that is fixed the figures compare different quantities")]
    NotGood(String),
    #[error("{file}: {rows} of at least {least} rows of 20 ms: too short to tell anything; are its times in seconds?")]
    TooShort { file: String, rows: usize, least: usize },
    #[error("{out}: this is the rig file that is read, which would be lost; give --out another name")]
    OverRig { out: String },
    #[error("{folder}: manual pages and completions cannot be written: {source}")]
    Generate { folder: String, source: io::Error },
    #[error("standard output cannot be written: {0}")]
    Stdout(io::Error),
    #[error("SIGINT and SIGTERM cannot be caught: {0}")]
    Signals(io::Error),
    #[error("{said}")]
    Stopped { said: String, status: u8 },
}

impl Failure {
    /// Tells whether an adaptation was stopped.
    pub(crate) fn is_stopped_adaptation(&self) -> bool {
        match self {
            Self::Rehearsal(error)
            | Self::Adapt { error, .. }
            | Self::NotBegun { error, .. }
            | Self::Rehearsed { error } => matches!(error, AdaptError::Stopped),
            _ => false,
        }
    }

    /// Exit status: 2 where the user's input is to be mended, 1 where the work failed, more where a signal stopped it.
    pub(crate) fn status(&self) -> u8 {
        match self {
            Self::Stopped { status, .. } => *status,
            Self::Training(TrainingError::Diverged { .. } | TrainingError::Write(_)) => FAILED,
            Self::Training(_) => BAD_INPUT,
            Self::Finetune(
                FinetuneError::NothingToLearn { .. }
                | FinetuneError::Publish(_)
                | FinetuneError::Training(TrainingError::Diverged { .. } | TrainingError::Write(_)),
            ) => FAILED,
            Self::Finetune(_) => BAD_INPUT,
            Self::Rehearsal(error) | Self::NotBegun { error, .. } => match error {
                AdaptError::File { .. } | AdaptError::Start { .. } => BAD_INPUT,
                _ => FAILED,
            },
            Self::Adapt { error: AdaptError::Start { .. }, .. } => BAD_INPUT,
            Self::Adapt { .. } | Self::Rehearsed { .. } | Self::NotBetter { .. } => FAILED,
            Self::Rig(RigFileError::Write(_)) | Self::Recording(RecordingError::Write(_)) => FAILED,
            Self::FreeRun(FreeRunError::NotFinite { .. }) => FAILED,
            Self::Fit(FitError::NotFinite { .. })
            | Self::Diagnose(
                DiagnoseError::Fit(FitError::NotFinite { .. })
                | DiagnoseError::Output(OutputError::Write(_) | OutputError::Remove { .. })
                | DiagnoseError::Format { .. },
            ) => FAILED,
            Self::Output(OutputError::Write(_) | OutputError::Remove { .. }) => FAILED,
            Self::Diagnose(_) | Self::Output(_) => BAD_INPUT,
            Self::Fit(_)
            | Self::Rig(_)
            | Self::Recording(_)
            | Self::Reference(_)
            | Self::FreeRun(_)
            | Self::Join(_)
            | Self::Faults(_)
            | Self::OverInputs { .. }
            | Self::OverRecording { .. }
            | Self::TwoOutputs
            | Self::OverRig { .. }
            | Self::NoRehearsal { .. }
            | Self::TooShort { .. } => BAD_INPUT,
            // `host:port` that is none, as against a port that another program has.
            Self::Emulator(EmulatorError::Bind { source, .. }) if source.kind() == io::ErrorKind::InvalidInput => {
                BAD_INPUT
            }
            Self::Emulator(_)
            | Self::Write(_)
            | Self::Lanes(_)
            | Self::Learner(_)
            | Self::Json(_)
            | Self::Generate { .. }
            | Self::Stdout(_)
            | Self::Signals(_)
            | Self::NotGood(_)
            | Self::InPart { .. }
            | Self::WorseThanBefore { .. } => FAILED,
        }
    }

    /// Tells the user, and gives the exit status.
    pub(crate) fn told(&self) -> ExitCode {
        tell(&self.to_string());
        ExitCode::from(self.status())
    }
}

/// One line on standard error, whatever is in the text; broken between words on a terminal.
pub(crate) fn tell(text: &str) {
    // A file's name may hold line ends; a message that falls apart over lines is not found again in a log.
    let line: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    let text = format!("trainer: {line}\n");
    // Where standard error is closed there is no one to tell.
    let _ = io::stderr().lock().write_all(terminal_lines::for_stream(&text, &io::stderr()).as_bytes());
}
