//! Errors of a fit.

use model::rig::RigError;
use proto::recording::RecordingError;

/// Reason why a fit cannot be made, in one line.
#[derive(Debug, thiserror::Error)]
pub enum FitError {
    /// A recording lacks what the rig needs.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The rig cannot be simulated.
    #[error("{rig}: {problem}")]
    Rig {
        /// The rig's name.
        rig: String,
        /// Key and problem.
        problem: RigError,
    },
    /// No recording was given.
    #[error("no recordings; name at least one file")]
    NoRecordings,
    /// The recordings are too poor to fit anything to.
    #[error("{0}")]
    Unusable(String),
    /// A start of the fit cannot be simulated.
    #[error("{rig}: the simulation leaves the numbers; check the rig's parameters")]
    NotFinite {
        /// The rig's name.
        rig: String,
    },
    /// A parameter that is not one of the rig's, or has a value it cannot have.
    #[error("parameter {path}: {problem}")]
    Parameter {
        /// Path of the parameter.
        path: String,
        /// The problem, in words.
        problem: String,
    },
    /// A system of equations without a solution.
    #[error("{what}: {problem}")]
    Singular {
        /// The unknowns that were solved for.
        what: String,
        /// The problem, in words, and what to do.
        problem: String,
    },
}

impl FitError {
    /// A problem of `rig`.
    pub(crate) fn rig(rig: &model::rig::Rig) -> impl Fn(RigError) -> Self + '_ {
        |problem| FitError::Rig { rig: rig.name.clone(), problem }
    }
}
