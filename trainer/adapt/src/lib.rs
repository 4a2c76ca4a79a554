//! From recordings that differ from the model to a controller that tracks better, beside a running daemon.
//!
//! | module | subject |
//! | --- | --- |
//! | [`settings`] | a run as data |
//! | [`programs`] | commands as children: shown, timed, stopped |
//! | [`daemon`] | what the running daemon is asked, through `controller` |
//! | [`recorded`] | ticks of its recordings |
//! | [`excitation`] | an experiment that moves the valves as tracking does not |
//! | [`tracking`] | how well a run tracked |
//! | [`yardstick`] | readings less reference, or less what late sensors show of it |
//! | [`journal`] | what has been done, to go on from |
//! | `paths` | where it all lies |
//! | [`run`] | the steps |
//! | `diagnosing` | what the model leaves out, with experiments where that takes them |
//! | `flight` | runs along the reference |
//! | `judging` | the yardstick that all of them are judged by |
//! | `in_force` | what must not change while a run is made |
//! | `guard` | when a run is worse than what was there |
//! | [`comparison`] | better, no different, worse |
//! | `change` | those that ask the daemon for something, and wait |
//! | `put_back` | what was changed is put back: the operator's reference at every end |
//! | [`found_in`] | what stands in the way of a new one |
//! | [`worst`] | the worst pressures meanwhile |
//! | `optimum` | what any controller must leave on the model, and whether there is anything to learn |
//! | [`rig_time`] | how much of the rig's time it takes |
//! | [`outcome`] | what came out: text, JSON, page |
//! | [`rehearsal`] | a concealed rig and a daemon on this machine |
//!
//! Every step is a command that exists by itself. The daemon is never told anything that its operator could not tell it, and
//! it judges: a model is compared before it takes over, a policy goes through the daemon's own stages. A step that fails
//! leaves model and policy as they were.

mod change;
pub mod comparison;
pub mod daemon;
mod diagnosing;
pub mod excitation;
mod flight;
pub mod found_in;
mod guard;
mod in_force;
pub mod journal;
mod judging;
mod optimum;
pub mod outcome;
mod paths;
pub mod programs;
mod put_back;
pub mod recorded;
pub mod rehearsal;
pub mod rig_time;
pub mod run;
pub mod settings;
pub mod tracking;
pub mod worst;
pub mod yardstick;

pub use outcome::Outcome;
pub use programs::Console;
pub use run::Adaptation;
pub use settings::AdaptSettings;

use std::path::{Path, PathBuf};

use proto::atomic_file::AtomicFileError;
use proto::recording::ReadMcapError;
use proto::reference::ReferenceError;
use proto::rig_file::RigFileError;

/// Why an adaptation does not come to its end.
#[derive(Debug, thiserror::Error)]
pub enum AdaptError {
    /// A file cannot be read, written or understood.
    #[error("{file}: {problem}")]
    File {
        /// The file.
        file: String,
        /// The problem and the mend.
        problem: String,
    },
    /// A file cannot be written.
    #[error(transparent)]
    Write(#[from] AtomicFileError),
    /// A recording cannot be read.
    #[error(transparent)]
    Recording(#[from] ReadMcapError),
    /// A rig file cannot be read.
    #[error(transparent)]
    Rig(#[from] RigFileError),
    /// A reference cannot be read.
    #[error(transparent)]
    Reference(#[from] ReferenceError),
    /// A command cannot be started.
    #[error(
        "`{command}` cannot be started: {source}; the programs are looked for beside this one (--controller PROGRAM)"
    )]
    Start {
        /// The command.
        command: String,
        /// The system's own words.
        source: std::io::Error,
    },
    /// A command failed.
    #[error("`{command}` failed: {said}")]
    Failed {
        /// The command.
        command: String,
        /// The last line that it said.
        said: String,
    },
    /// The rig is not being controlled.
    #[error("the rig is not being controlled ({}); {}, then go on", not_running(state, waits_for), mend(waits_for))]
    NotRunning {
        /// The daemon's state.
        state: String,
        /// Condition that a person must acknowledge first; empty where there is none.
        waits_for: String,
    },
    /// Something takes longer than it may.
    #[error("{what} after {seconds} s")]
    TooLong {
        /// Event that has not come.
        what: String,
        /// Time that was waited, in s.
        seconds: u64,
    },
    /// A step failed, and the daemon would not take back what had been changed.
    #[error("{0}; not all of what was changed could be put back")]
    NotRestored(Box<AdaptError>),
    /// The daemon would not follow the operator's reference again.
    #[error("the daemon may still follow a reference of this run ({why}); put yours back with: {command}")]
    ReferenceLeft {
        /// The command that does it.
        command: String,
        /// Reason for it.
        why: String,
    },
    /// Somebody else has changed what this run relies on.
    #[error("{what} {meanwhile}")]
    Changed {
        /// Part that was changed, from what and to what.
        what: String,
        /// Time at which it was, and what that means for the run.
        meanwhile: String,
    },
    /// Exploration is on while a flight is to be made.
    #[error(
        "exploration is on, and its noise would count as an error of the controller in `{flown}`: switch it off with `controller explore off`"
    )]
    Explores {
        /// Name of the flight.
        flown: String,
    },
    /// The user stopped it.
    #[error("stopped")]
    Stopped,
}

impl AdaptError {
    /// A file that cannot be used, with the mend.
    pub fn file(path: &Path, problem: impl std::fmt::Display) -> Self {
        AdaptError::File { file: path.display().to_string(), problem: problem.to_string() }
    }
}

/// State and what waits for a person.
fn not_running(state: &str, waits_for: &str) -> String {
    if waits_for.is_empty() { format!("state {state}") } else { format!("state {state}: {waits_for}") }
}

/// Mend that makes it control.
fn mend(waits_for: &str) -> &'static str {
    if waits_for.is_empty() {
        "`controller arm`"
    } else {
        "see that the rig is sound, `controller acknowledge` and `controller arm`"
    }
}

/// Makes a folder.
fn make_folder(path: PathBuf) -> Result<PathBuf, AdaptError> {
    std::fs::create_dir_all(&path).map_err(|error| AdaptError::file(&path, format!("cannot be made: {error}")))?;
    Ok(path)
}
