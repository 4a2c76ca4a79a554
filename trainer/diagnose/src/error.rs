//! What can go wrong in a diagnosis.

use fit::FitError;
use model::rig::RigError;
use proto::atomic_file::AtomicFileError;
use proto::recording::RecordingError;

/// Why there is no diagnosis, in one line.
#[derive(Debug, thiserror::Error)]
pub enum DiagnoseError {
    /// The recordings cannot be used, or a fit failed.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// A recording cannot be used.
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
    /// A result cannot be written.
    #[error(transparent)]
    Write(#[from] AtomicFileError),
    /// The folder for the results cannot be made.
    #[error("{directory}: {source}; give --out another folder")]
    Directory {
        /// The folder.
        directory: String,
        /// Why.
        source: std::io::Error,
    },
    /// A result cannot be put into its format.
    #[error("{file}: {problem}")]
    Format {
        /// The file.
        file: String,
        /// What is wrong.
        problem: String,
    },
}

impl DiagnoseError {
    /// A problem of `rig`.
    pub(crate) fn rig(rig: &model::rig::Rig) -> impl Fn(RigError) -> Self + '_ {
        |problem| DiagnoseError::Rig { rig: rig.name.clone(), problem }
    }
}
