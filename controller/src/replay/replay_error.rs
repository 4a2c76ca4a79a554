//! Reason why a recording cannot be replayed at all.

use model::rig::RigError;
use policy::PolicyError;
use proto::reference::ReferenceError;

use crate::config::ConfigError;
use crate::experiment::command_sequence::CommandSequenceError;

/// Reason why a recording cannot be replayed at all.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// A file is missing inside.
    #[error("{file}: the recording holds no {name}; runs recorded by this version or a later one can be replayed")]
    Missing {
        /// The recording.
        file: String,
        /// The file inside.
        name: &'static str,
    },
    /// A file inside is damaged.
    #[error("{file}: {name} inside is damaged, and without it nothing of the run can be replayed")]
    DamagedInside {
        /// The recording.
        file: String,
        /// The file inside.
        name: &'static str,
    },
    /// It holds an experiment alone, with nothing of what the run around it depended on.
    #[error(
        "{file}: holds an experiment alone, which cannot be replayed; one that a running daemon played is replayed within the recording of its run (run-….mcap): give that"
    )]
    ExperimentAlone {
        /// The recording.
        file: String,
    },
    /// The beginning of a replay could not be read.
    #[error("{note}; a run is replayed from its beginning, and that is lost here")]
    Damaged {
        /// The damage, with the recording's name.
        note: String,
    },
    /// An input of the tick was not recorded.
    #[error(
        "{file}: the recording does not begin with a session's first tick; give the recording before it first, in the order of time"
    )]
    NoBeginning {
        /// The recording.
        file: String,
    },
    /// It was given before.
    #[error("{file}: holds the same ticks as {before}, which was replayed already; give each recording once")]
    Twice {
        /// The recording.
        file: String,
        /// The one before.
        before: String,
    },
    /// A part of a run between two that were given is missing.
    #[error("{file}: part {found} of a run, after part {before}; give all parts in their order")]
    PartMissing {
        /// The recording.
        file: String,
        /// Part.
        found: u32,
        /// The part before it.
        before: u32,
    },
    /// The configuration inside is none.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The model inside is none.
    #[error("{file}: {name}: {source}")]
    Model {
        /// The recording.
        file: String,
        /// The file inside.
        name: &'static str,
        /// The problem.
        source: RigError,
    },
    /// The reference inside is none.
    #[error(transparent)]
    Reference(#[from] ReferenceError),
    /// The commands of an experiment inside are none.
    #[error(transparent)]
    Experiment(#[from] CommandSequenceError),
    /// The policy inside is refused.
    #[error(transparent)]
    Policy(#[from] PolicyError),
    /// The policy inside is another than the one that was in control.
    #[error("{file}: the policy inside has SHA-256 {found}, in control was {expected}")]
    OtherPolicy {
        /// The recording.
        file: String,
        /// Version of the file inside.
        found: String,
        /// Version of the run.
        expected: String,
    },
}
