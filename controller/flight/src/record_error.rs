//! Why there is no recording, or not all of it.

use std::path::PathBuf;

use proto::recording::WriteMcapError;

/// Why there is no recording, or not all of it.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The file cannot be made, written or finished.
    #[error(transparent)]
    Write(#[from] WriteMcapError),
    /// Somebody removed the file.
    #[error(
        "{}: the recording was removed while it was written; leave *.partial.mcap alone until the flight is over",
        .path.display()
    )]
    Removed {
        /// The file that is gone.
        path: PathBuf,
    },
    /// The recording ended before the flight did.
    #[error("{first} ({written} ticks written, {lost} lost)")]
    Incomplete {
        /// The first thing that went wrong.
        first: Box<RecordError>,
        /// Ticks written before.
        written: u64,
        /// Ticks that came after.
        lost: u64,
    },
    /// The thread cannot be started.
    #[error("cannot start the recorder's thread: {source}; check the limit on threads (ulimit -u)")]
    Thread {
        /// What the system said.
        source: std::io::Error,
    },
    /// The thread is gone: a panic in the observer or in the event texts.
    #[error("the recorder's thread stopped by itself; what was flushed before is in {}", .partial.display())]
    Died {
        /// The unfinished file.
        partial: PathBuf,
    },
}
