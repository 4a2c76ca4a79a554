//! The paper's sim-to-real transfer (III, IV; Table IV): SAC and CAPS on transitions of the running daemon.
//!
//! | module | subject |
//! | --- | --- |
//! | [`recording_folder`] | recordings as one sequence of ticks, across rotation and restarts, as they grow |
//! | [`loop_rebuild`] | what the policy was shown, tick by tick, checked against what was recorded |
//! | [`transitions`] | observation, action, reward, next observation |
//! | [`recent_error`] | the tracking error that a run shows |
//! | [`settings`] | a run as data |
//! | [`run`] | learning, stopping, going on |
//! | `publish` | policies go out |
//! | [`callback`] | whoever looks on; how a run ends |
//! | [`checkpoint`] | what a run goes on from |
//!
//! A run is a function of the transitions, its settings and its seed: so many updates follow each transition, whenever it
//! came. So a run beside the daemon, one from its recordings alone, and one that was stopped and gone on with come to the
//! same bytes.

pub mod callback;
pub mod checkpoint;
mod files_inside;
pub mod loop_rebuild;
mod publish;
pub mod recent_error;
pub mod recording_folder;
pub mod run;
pub mod settings;
pub mod transitions;

pub use callback::{FinetuneCallback, Progress, Source, Status, Summary};
pub use run::FinetuneRun;
pub use settings::{FinetuneSettings, PublishedPlan};

use model::rig::RigError;
use proto::atomic_file::AtomicFileError;
use proto::recording::ReadMcapError;
use proto::reference::ReferenceError;
use training::TrainingError;

/// Reason why a run cannot begin or go on.
#[derive(Debug, thiserror::Error)]
pub enum FinetuneError {
    /// The folder of recordings cannot be read.
    #[error("{folder}: cannot be read: {source}; --recordings takes the daemon's record.directory")]
    Folder {
        /// The folder.
        folder: String,
        /// Error of the system.
        source: std::io::Error,
    },
    /// A recording cannot be read.
    #[error(transparent)]
    Recording(#[from] ReadMcapError),
    /// A recording does not hold what its loop is rebuilt from.
    #[error("{file}: holds no {name}; recordings of `controller run` and `demo` do")]
    Lacks {
        /// The recording.
        file: String,
        /// The file inside.
        name: &'static str,
    },
    /// A model cannot be run.
    #[error("{name}: {problem}")]
    Model {
        /// Where it stands.
        name: String,
        /// Problem.
        problem: RigError,
    },
    /// A reference cannot be read.
    #[error(transparent)]
    Reference(#[from] ReferenceError),
    /// Settings, policy, folder or files of the run.
    #[error(transparent)]
    Training(#[from] TrainingError),
    /// A policy cannot be published.
    #[error(transparent)]
    Publish(#[from] AtomicFileError),
    /// There is nothing to learn from.
    #[error("{folder}: no tick to learn from in {ticks} ticks{reasons}")]
    NothingToLearn {
        /// The folder.
        folder: String,
        /// Ticks that were read.
        ticks: u64,
        /// Why, by number.
        reasons: String,
    },
}
