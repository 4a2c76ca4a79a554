//! Reason why there is no recording, or not all of it.

use std::path::PathBuf;

use proto::recording::WriteMcapError;

/// Reason why there is no recording, or not all of it.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The file cannot be made, written or finished.
    #[error(transparent)]
    Write(#[from] WriteMcapError),
    /// Somebody removed the file.
    #[error(
        "{}: the recording was removed while it was written; leave *.partial.mcap alone until the run is over",
        .path.display()
    )]
    Removed {
        /// The file that is gone.
        path: PathBuf,
    },
    /// Somebody cut the file short.
    #[error(
        "{}: the recording was cut from {from} to {to} bytes while it was written; leave *.partial.mcap alone until the run is over",
        .path.display()
    )]
    Cut {
        /// The file that was cut.
        path: PathBuf,
        /// Length before (bytes).
        from: u64,
        /// Length now (bytes).
        to: u64,
    },
    /// The folder for recordings cannot be made.
    #[error("{}: cannot be made: {source}; set record.directory to a folder that can be written", .directory.display())]
    Directory {
        /// The folder.
        directory: PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
    /// Every name is taken.
    #[error("{}: no free name for another recording in this second", .directory.display())]
    NoName {
        /// The folder.
        directory: PathBuf,
    },
    /// The disk does not answer.
    #[error("{}: the disk has not answered for {seconds} s; what was flushed before is there", .place.display())]
    Hangs {
        /// The unfinished file, or the folder.
        place: PathBuf,
        /// Time that it was waited for (s).
        seconds: u64,
    },
    /// The recording lacks something.
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
        /// Error of the system.
        source: std::io::Error,
    },
    /// The thread is gone: a panic in the observer or in the event texts.
    #[error("the recorder's thread stopped by itself; what was flushed before is in {}", .partial.display())]
    Died {
        /// The unfinished file.
        partial: PathBuf,
    },
}
