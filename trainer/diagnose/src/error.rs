//! Errors of a diagnosis.

use fit::FitError;
use model::rig::RigError;
use proto::output::OutputError;
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
    /// The folder for the results cannot be used, or a result not be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// Nothing in the rig can have made what was recorded.
    #[error(
        "{rig}: nothing in this rig file can move a pressure, and {channel} {moves}; name the pump, the source or the valve that did, and its column under [recording]"
    )]
    Immovable {
        /// The rig's name.
        rig: String,
        /// The column.
        channel: String,
        /// Words on what the column does.
        moves: String,
    },
    /// A result cannot be put into its format.
    #[error("{file}: {problem}")]
    Format {
        /// The file.
        file: String,
        /// The problem, in words.
        problem: String,
    },
}

impl DiagnoseError {
    /// A problem of `rig`.
    pub(crate) fn rig(rig: &model::rig::Rig) -> impl Fn(RigError) -> Self + '_ {
        |problem| DiagnoseError::Rig { rig: rig.name.clone(), problem }
    }
}
