//! The file of a checkpoint, whatever a run keeps in it, and the learner that stands at its end.
//!
//! ```text
//! eight bytes that say whose it is   parts   the learner but for its replay's rows   CRC-32C of everything before (u32)
//! ```
//!
//! Each part after a u32 length, little endian. The replay's rows stand beside it ([`crate::replay_files`]), so that a
//! checkpoint is a few megabytes at any time.

use std::path::Path;

use sac::{Learner, Machine};

use crate::TrainingError;
use crate::replay_files::ReplayFiles;
use crate::run_files::RunFiles;
use crate::settings::TrainingSettings;

/// Whose checkpoint a file is.
#[derive(Debug, Clone, Copy)]
pub struct CheckpointFormat {
    /// First bytes of the file.
    pub magic: [u8; 8],
    /// Words for it in an error, after "is no checkpoint of".
    pub of: &'static str,
}

impl CheckpointFormat {
    /// Writes a checkpoint, as a whole or not at all; the rows of its replay come first.
    ///
    /// # Errors
    /// If the disk is full, by file.
    pub fn write<const N: usize>(
        self,
        files: &RunFiles,
        replay: &mut ReplayFiles,
        parts: [Vec<u8>; N],
        learner: &Learner,
    ) -> Result<(), TrainingError> {
        let mut bytes = self.magic.to_vec();
        for part in parts.into_iter().chain([learner.save_core()]) {
            append_part(&mut bytes, &part);
        }
        bytes.extend(crc32c::crc32c(&bytes).to_le_bytes());
        replay.keep_tail(learner)?;
        RunFiles::write(&files.checkpoint(), &bytes)?;
        replay.tidy(&learner.replay_rows());
        Ok(())
    }

    /// Takes a file's bytes apart: its parts and the learner's.
    ///
    /// # Errors
    /// A file that is damaged or another's, by name.
    pub fn parts<'a, const N: usize>(
        self,
        path: &Path,
        bytes: &'a [u8],
    ) -> Result<([&'a [u8]; N], &'a [u8]), TrainingError> {
        self.split(bytes).ok_or_else(|| self.damaged(path))
    }

    fn split<const N: usize>(self, bytes: &[u8]) -> Option<([&[u8]; N], &[u8])> {
        let (body, crc) = bytes.split_last_chunk::<4>()?;
        let mut rest = body.strip_prefix(&self.magic)?;
        if crc32c::crc32c(body) != u32::from_le_bytes(*crc) {
            return None;
        }
        let mut parts = [&[] as &[u8]; N];
        for place in &mut parts {
            (*place, rest) = part(rest)?;
        }
        Some((parts, part(rest)?.0))
    }

    /// Error of a file that cannot be made sense of.
    pub fn damaged(self, path: &Path) -> TrainingError {
        TrainingError::file(path, &format!("is no checkpoint of {}, or is damaged", self.of))
    }
}

/// Reads a checkpoint's bytes.
///
/// # Errors
/// A file that is missing, by name.
pub fn read_bytes(path: &Path) -> Result<Vec<u8>, TrainingError> {
    std::fs::read(path).map_err(|error| TrainingError::file(path, &format!("cannot be read: {error}")))
}

/// Makes the learner again, its replay filled from the rows that stand beside the checkpoint.
///
/// # Errors
/// Files that are damaged, missing, or were written under other settings.
pub fn restore_learner(
    files: &RunFiles,
    settings: &TrainingSettings,
    core: &[u8],
    threads: usize,
) -> Result<(Learner, ReplayFiles), TrainingError> {
    let path = files.checkpoint();
    let (mut learner, written) = Learner::restore_core(core, Machine::with_threads(threads))
        .map_err(|error| TrainingError::file(&path, &error.to_string()))?;
    if *learner.shape() != settings.shape() {
        return Err(TrainingError::file(&path, "was written under other settings than those beside it"));
    }
    let replay = fill(files, settings.sac.replay, written, &mut learner)?;
    Ok((learner, replay))
}

/// The learner of whatever run has its checkpoint at `path`, its replay empty.
///
/// # Errors
/// A file that is missing, damaged or no checkpoint, by name.
pub fn learner_of(path: &Path, threads: usize) -> Result<Learner, TrainingError> {
    core_of(path, threads).map(|(learner, _)| learner)
}

/// The learner of whatever run is in a folder, its replay filled.
///
/// # Errors
/// A file that is missing, damaged or no checkpoint, by name.
pub fn learner_with_replay(files: &RunFiles, threads: usize) -> Result<Learner, TrainingError> {
    let (mut learner, written) = core_of(&files.checkpoint(), threads)?;
    let capacity = learner.settings().replay_capacity;
    fill(files, capacity, written, &mut learner)?;
    Ok(learner)
}

fn core_of(path: &Path, threads: usize) -> Result<(Learner, u64), TrainingError> {
    let bytes = read_bytes(path)?;
    let core = last_part(&bytes).ok_or_else(|| TrainingError::file(path, "is no checkpoint, or is damaged"))?;
    Learner::restore_core(core, Machine::with_threads(threads))
        .map_err(|error| TrainingError::file(path, &error.to_string()))
}

/// Puts the rows that stand beside a checkpoint back.
fn fill(files: &RunFiles, capacity: usize, written: u64, learner: &mut Learner) -> Result<ReplayFiles, TrainingError> {
    let replay = ReplayFiles::new(files.replay(), capacity, written);
    replay.restore(written.saturating_sub(capacity as u64)..written, learner)?;
    Ok(replay)
}

/// The last part of a checkpoint of any format.
fn last_part(bytes: &[u8]) -> Option<&[u8]> {
    let (body, crc) = bytes.split_last_chunk::<4>()?;
    let (_, mut rest) = body.split_first_chunk::<8>()?;
    if crc32c::crc32c(body) != u32::from_le_bytes(*crc) {
        return None;
    }
    loop {
        let (first, after) = part(rest)?;
        if after.is_empty() {
            return Some(first);
        }
        rest = after;
    }
}

/// Appends a part after its length.
pub(crate) fn append_part(bytes: &mut Vec<u8>, part: &[u8]) {
    bytes.extend((part.len() as u32).to_le_bytes());
    bytes.extend(part);
}

/// A length and what it is the length of; the rest.
pub(crate) fn part(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (length, rest) = bytes.split_first_chunk::<4>()?;
    rest.split_at_checked(usize::try_from(u32::from_le_bytes(*length)).ok()?)
}
