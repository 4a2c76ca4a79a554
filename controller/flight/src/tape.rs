//! Place where ticks go: one file, watched while it grows.

use std::io::ErrorKind;
use std::os::unix::fs::MetadataExt;
use std::path::PathBuf;

use proto::recording::{Attachment, EventLevel, RecordingWriter, TickRecord};

use crate::record_error::RecordError;

/// Linux's number for a link that leads in a circle, which the standard library has no stable name for.
const ELOOP: i32 = 40;

/// Place where ticks go: a file, or what tests put in its place.
pub(crate) trait Tape: Send {
    fn tick(&mut self, tick: &TickRecord) -> Result<(), RecordError>;
    fn event(&mut self, at_ns: u64, level: EventLevel, part: &str, message: &str) -> Result<(), RecordError>;
    /// Puts a file inside.
    fn attach(&mut self, file: &Attachment) -> Result<(), RecordError>;
    fn flush(&mut self) -> Result<(), RecordError>;
    /// Looks whether what was written is still there.
    fn check(&mut self) -> Result<(), RecordError>;
    /// Bytes on the disk, as of the last look.
    fn bytes(&self) -> u64;
    fn finish(self: Box<Self>) -> Result<PathBuf, RecordError>;
}

/// A recording in a file.
pub(crate) struct McapTape {
    writer: RecordingWriter,
    partial: PathBuf,
    /// Device and number of the file that is written.
    file: Option<(u64, u64)>,
    /// Length at the last look; nobody but this thread makes it longer, nobody may make it shorter.
    length: u64,
}

impl McapTape {
    pub(crate) fn new(writer: RecordingWriter, partial: PathBuf) -> Self {
        let about = std::fs::metadata(&partial).ok();
        let (file, length) = about.map_or((None, 0), |a| (Some((a.dev(), a.ino())), a.len()));
        Self { writer, partial, file, length }
    }
}

impl Tape for McapTape {
    fn tick(&mut self, tick: &TickRecord) -> Result<(), RecordError> {
        Ok(self.writer.write(tick)?)
    }

    fn event(&mut self, at_ns: u64, level: EventLevel, part: &str, message: &str) -> Result<(), RecordError> {
        Ok(self.writer.event(at_ns, level, part, message)?)
    }

    fn attach(&mut self, file: &Attachment) -> Result<(), RecordError> {
        Ok(self.writer.attach(file)?)
    }

    fn flush(&mut self) -> Result<(), RecordError> {
        // Before, because writing on makes a file that was cut as long as it was, with a hole in it.
        self.check()?;
        self.writer.flush()?;
        self.check()
    }

    fn check(&mut self) -> Result<(), RecordError> {
        let about = match std::fs::metadata(&self.partial) {
            Ok(about) => about,
            // A file without a name takes every byte and keeps none, and the system reports no error. Its name is gone as well where a
            // file or a link that leads nowhere stands in the folder's place.
            Err(error)
                if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory)
                    || error.raw_os_error() == Some(ELOOP) =>
            {
                return Err(RecordError::Removed { path: self.partial.clone() });
            }
            // A folder that may not be searched, or a disk that does not answer just now, is no proof that the file is gone.
            Err(_) => return Ok(()),
        };
        if self.file.is_some_and(|file| file != (about.dev(), about.ino())) {
            return Err(RecordError::Removed { path: self.partial.clone() });
        }
        if about.len() < self.length {
            return Err(RecordError::Cut { path: self.partial.clone(), from: self.length, to: about.len() });
        }
        self.length = about.len();
        Ok(())
    }

    fn bytes(&self) -> u64 {
        self.length
    }

    fn finish(mut self: Box<Self>) -> Result<PathBuf, RecordError> {
        self.check()?;
        Ok(self.writer.finish()?)
    }
}
