//! One file after another: when the next begins, and what it is called.

use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use proto::recording::{Attachment, LogTime, RecordingInfo, RecordingWriter, WriteMcapError, rfc3339, unfinished_path};

use crate::disk::{Retention, make_folder};
use crate::record_error::RecordError;
use crate::tape::{McapTape, Tape};

/// Period of the ticks (ms).
const TICK_MS: u64 = 20;
/// Names tried in one second before giving up.
const MOST_NAMES: u32 = 1000;

/// A folder of recordings, and how many and how large they may be.
#[derive(Debug, Clone)]
pub struct Destination {
    /// The folder; made if it is not there.
    pub directory: PathBuf,
    /// Beginning of the files' names: `STEM-YYYYMMDD-HHMMSS.mcap`, UTC.
    pub stem: &'static str,
    /// Stems of all recordings that retention may remove here.
    pub stems: &'static [&'static str],
    /// Size at which the next file begins (bytes).
    pub most_bytes: u64,
    /// Time after which the next file begins.
    pub most_time: Duration,
    /// Free space below which nothing new is to be started (bytes).
    pub min_free_bytes: u64,
    /// Limits on older recordings that are kept.
    pub retention: Retention,
    /// The daemon's monotonic clock (ns).
    pub clock: fn() -> u64,
}

/// Source of tapes.
pub(crate) trait TapeSource: Send {
    /// The next tape, after `ticks` ticks on those before; `None` when there is no other.
    fn next(&mut self, ticks: u64) -> Option<Result<Box<dyn Tape>, RecordError>>;
    /// Place where tapes are; for messages, and to ask for free space.
    fn place(&self) -> &Path;
    /// The limits of one tape, where there are any.
    fn destination(&self) -> Option<&Destination> {
        None
    }
    /// Keeps a file for the tapes after this one, where there are any.
    fn keep(&mut self, _file: Attachment) {}
    /// Takes other limits, where there are any.
    fn redirect(&mut self, _destination: Destination) {}
}

/// A single tape, there from the start.
pub(crate) struct OneTape {
    pub(crate) tape: Option<Box<dyn Tape>>,
    pub(crate) partial: PathBuf,
}

impl TapeSource for OneTape {
    fn next(&mut self, _ticks: u64) -> Option<Result<Box<dyn Tape>, RecordError>> {
        self.tape.take().map(Ok)
    }

    fn place(&self) -> &Path {
        &self.partial
    }
}

/// Files in a folder, made when there is something to write.
pub(crate) struct Rotating {
    pub(crate) destination: Destination,
    pub(crate) info: RecordingInfo,
    pub(crate) attachments: Vec<Attachment>,
    pub(crate) part: u32,
    /// Name of the file before.
    pub(crate) previous: String,
}

impl Rotating {
    fn open(&mut self, ticks: u64) -> Result<Box<dyn Tape>, RecordError> {
        let now = SystemTime::now();
        let mut info = self.info.clone();
        if self.part > 0 {
            info.extra.insert("previous_file".to_owned(), self.previous.clone());
            match info.log_time {
                LogTime::Arrival => {
                    info.started = now;
                    info.started_ns = (self.destination.clock)();
                }
                // In lockstep the plant's time goes on where the file before ended.
                LogTime::Tick => info.started += Duration::from_millis(ticks.saturating_mul(TICK_MS)),
            }
        }
        info.extra.insert("part".to_owned(), (self.part + 1).to_string());
        let directory = &self.destination.directory;
        make_folder(directory).map_err(|source| RecordError::Directory { directory: directory.clone(), source })?;
        let path = free_name(&self.destination, now)?;
        let writer = RecordingWriter::create(&path, &info, &self.attachments)
            .inspect_err(|error| remove_what_failed(&unfinished_path(&path), error))?;
        self.part += 1;
        self.previous = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        Ok(Box::new(McapTape::new(writer, unfinished_path(&path))))
    }
}

impl TapeSource for Rotating {
    fn next(&mut self, ticks: u64) -> Option<Result<Box<dyn Tape>, RecordError>> {
        Some(self.open(ticks))
    }

    fn place(&self) -> &Path {
        &self.destination.directory
    }

    fn destination(&self) -> Option<&Destination> {
        Some(&self.destination)
    }

    fn keep(&mut self, file: Attachment) {
        self.attachments.push(file);
    }

    fn redirect(&mut self, destination: Destination) {
        self.destination = destination;
    }
}

/// `STEM-YYYYMMDD-HHMMSS.mcap` in the folder; a second one in the same second gets a number.
fn free_name(destination: &Destination, now: SystemTime) -> Result<PathBuf, RecordError> {
    let Destination { directory, stem, .. } = destination;
    let stamp = file_stamp(now.duration_since(UNIX_EPOCH).unwrap_or_default().as_secs());
    let names = std::iter::once(format!("{stem}-{stamp}.mcap"))
        .chain((2..MOST_NAMES).map(|n| format!("{stem}-{stamp}-{n}.mcap")));
    names
        .map(|name| directory.join(name))
        .find(|path| !path.exists() && !unfinished_path(path).exists())
        .ok_or_else(|| RecordError::NoName { directory: directory.clone() })
}

/// Removes a file that could not be begun and holds nothing: each try on a full disk would leave one. What was there already is
/// another recorder's.
fn remove_what_failed(partial: &Path, error: &WriteMcapError) {
    let is_empty = || std::fs::symlink_metadata(partial).is_ok_and(|about| about.is_file() && about.len() == 0);
    if !matches!(error, WriteMcapError::Exists { .. }) && is_empty() {
        // Where it cannot be removed it stays; nothing is lost with it either way.
        let _ = std::fs::remove_file(partial);
    }
}

/// UTC date and time for a file name, from seconds since 1970: RFC 3339 without its separators and milliseconds.
fn file_stamp(seconds: u64) -> String {
    let text = rfc3339(UNIX_EPOCH + Duration::from_secs(seconds));
    let whole = text.split('.').next().unwrap_or_default();
    whole.replace(['-', ':'], "").replace('T', "-")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_are_dates() {
        assert_eq!(file_stamp(0), "19700101-000000");
        assert_eq!(file_stamp(951_782_400), "20000229-000000");
        assert_eq!(file_stamp(1_795_219_199), "20261120-235959");
    }

    #[test]
    fn only_an_empty_file_of_its_own_goes_with_a_try_that_failed() {
        let folder = std::env::temp_dir().join(format!("rotation-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let partial = folder.join("experiment-20261127-084101.partial.mcap");
        // ENOSPC
        let full = || std::io::Error::from_raw_os_error(28);
        let failed = WriteMcapError::Write { path: partial.clone(), source: full() };
        let taken = WriteMcapError::Exists { path: partial.clone() };
        for (content, error, stays) in [("", &failed, false), ("", &taken, true), ("rows", &failed, true)] {
            std::fs::write(&partial, content).unwrap();
            remove_what_failed(&partial, error);
            assert_eq!(partial.exists(), stays, "{content:?} {error}");
        }
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
