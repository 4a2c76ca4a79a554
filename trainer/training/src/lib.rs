//! Training runs.
//!
//! | module | subject |
//! | --- | --- |
//! | [`settings`] | a run as data; presets |
//! | [`features`] | how observations are put to the network |
//! | [`run`] | acting and learning in turns; stop, checkpoint, resume |
//! | [`average`] | the actor's weights averaged over the last updates |
//! | `checkpoint`, [`checkpoint_file`], [`replay_files`] | what a run goes on from |
//! | [`policy_start`] | a policy that a run starts from |
//! | `spread` | the spread of the policy's distribution, for exploring with it on a rig |
//! | `plan_fit` | outputs for later ticks tied to what is then applied |
//! | [`run_files`] | the folder of a run |
//! | [`trained_policy`] | a policy as it was trained: network, features, contract; flown and exported |
//! | [`metrics`] | the learning curve: JSON lines, TensorBoard |
//! | [`event_file`] | TensorBoard's file format |
//! | [`run_report`] | the learning curve as a page |
//!
//! A run is a function of its settings: the same settings give the same bytes, whatever the machine does meanwhile,
//! however many threads learn, and wherever it was stopped and gone on with. An episode is drawn from seed and number; a
//! checkpoint in its midst holds the actions taken so far, from which the rigs come to stand where they stood.

pub mod average;
mod checkpoint;
pub mod checkpoint_file;
mod checkpoint_selection;
pub mod event_file;
pub mod features;
pub mod metrics;
mod plan_fit;
pub mod policy_start;
pub mod replay_files;
pub mod rollouts;
pub mod run;
pub mod run_files;
pub mod run_report;
pub mod settings;
mod spread;
pub mod trained_policy;

pub use checkpoint_selection::BestCheckpoint;
pub use policy_start::PolicyStart;
pub use rollouts::{RolloutCallback, RolloutRun, RolloutSummary};
pub use run::{Phase, Progress, Run, RunStatus, TrainingCallback};
pub use run_files::RunFiles;
pub use settings::{TrainingSettings, Variant};
pub use trained_policy::TrainedPolicy;

use environment::EnvironmentError;
use proto::atomic_file::AtomicFileError;
use proto::rig_file::RigFileError;

/// Reason why a run cannot begin or go on.
#[derive(Debug, thiserror::Error)]
pub enum TrainingError {
    /// A settings file is wrong.
    #[error("{file}{}: {problem}", line.map_or(String::new(), |line| format!(", line {line}")))]
    Settings {
        /// The file or preset.
        file: String,
        /// Line, where known.
        line: Option<usize>,
        /// Fault and its mend.
        problem: String,
    },
    /// There is no such preset.
    #[error("`{name}` is no preset and no file; presets are {known}")]
    Preset {
        /// Name that was asked for.
        name: String,
        /// Names that there are.
        known: String,
    },
    /// A file of the run cannot be read.
    #[error("{file}: {problem}")]
    File {
        /// The file.
        file: String,
        /// Fault and its mend.
        problem: String,
    },
    /// A rig cannot be read.
    #[error(transparent)]
    Rig(#[from] RigFileError),
    /// The environment cannot be made.
    #[error(transparent)]
    Environment(#[from] EnvironmentError),
    /// A file cannot be written.
    #[error(transparent)]
    Write(#[from] AtomicFileError),
    /// The folder of a new run cannot be written, or has not the room.
    #[error(transparent)]
    Output(#[from] proto::output::OutputError),
    /// A run is to end before where it stands.
    #[error(
        "{folder}: {} {} already, so {option} {asked} cannot be its end; give {} or more, or begin a new run",
        done.count, done.what, done.count
    )]
    EndsBefore {
        /// The run's folder.
        folder: String,
        /// State of the run.
        done: Done,
        /// The option that plans its end.
        option: &'static str,
        /// The end that is asked for.
        asked: u64,
    },
    /// A loss, a weight or an action is not finite.
    #[error("training diverged at step {step}: {what} is not finite; {kept}")]
    Diverged {
        /// The step.
        step: u64,
        /// Number that is not finite.
        what: String,
        /// Files that are kept, and the mend.
        kept: String,
    },
}

/// Work of a run so far, in the unit that its end is planned in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Done {
    /// Count of what is done.
    pub count: u64,
    /// Unit of the count, with its verb: "steps are done".
    pub what: &'static str,
}

impl TrainingError {
    /// An end that a run is past: its settings would say what is not true of it.
    pub fn ends_before(folder: &std::path::Path, done: Done, option: &'static str, asked: u64) -> Self {
        TrainingError::EndsBefore { folder: folder.display().to_string(), done, option, asked }
    }

    /// A file that cannot be read, with the mend.
    pub fn file(path: &std::path::Path, problem: &str) -> Self {
        TrainingError::File { file: path.display().to_string(), problem: problem.to_owned() }
    }

    /// Error for what the learner refuses.
    pub fn learner(what: &str, error: &dyn std::fmt::Display) -> Self {
        TrainingError::Settings { file: what.to_owned(), line: None, problem: error.to_string() }
    }
}
