//! Everything that a run of fine-tuning goes on from.
//!
//! ```text
//! "DPFINE01"   position as JSON   averaged network, or nothing   the learner but for its replay's rows
//!              CRC-32C of everything before (u32)
//! ```
//!
//! Each part after a u32 length, little endian; the replay's rows stand beside it ([`training::replay_files`]). The recordings
//! are read again from their beginning, and as many transitions passed over as the position says.

use sac::{Learner, Machine, Network};
use serde::{Deserialize, Serialize};
use training::average::Average;
use training::replay_files::ReplayFiles;
use training::{RunFiles, TrainingError, TrainingSettings};

const MAGIC: &[u8; 8] = b"DPFINE01";

/// Where a run stands.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Position {
    /// Transitions that were learned from.
    pub steps: u64,
    /// Updates that were made.
    pub updates: u64,
    /// Policies that were published.
    pub published: u64,
    /// Transitions at the last of them.
    pub published_at: u64,
    /// Seconds of work.
    pub wall_s: f64,
}

/// Writes a checkpoint, as a whole or not at all.
///
/// # Errors
/// If the disk is full, by file.
pub fn write(
    files: &RunFiles,
    replay: &mut ReplayFiles,
    position: &Position,
    average: &Average,
    learner: &Learner,
) -> Result<(), TrainingError> {
    let path = files.checkpoint();
    let position = serde_json::to_vec(position).map_err(|error| TrainingError::file(&path, &error.to_string()))?;
    let mut bytes = MAGIC.to_vec();
    for part in [position, average.get().map_or_else(Vec::new, Network::save), learner.save_core()] {
        bytes.extend((part.len() as u32).to_le_bytes());
        bytes.extend(part);
    }
    bytes.extend(crc32c::crc32c(&bytes).to_le_bytes());
    replay.keep_tail(learner)?;
    RunFiles::write(&path, &bytes)?;
    replay.tidy(&learner.replay_rows());
    Ok(())
}

/// What was read back.
pub struct Restored {
    /// Where the run stands.
    pub position: Position,
    /// The average.
    pub average: Average,
    /// The learner, its replay filled.
    pub learner: Learner,
    /// The replay's files.
    pub replay: ReplayFiles,
}

/// Reads a checkpoint that was written under these settings.
///
/// # Errors
/// A file that is missing or damaged, by name.
pub fn read(files: &RunFiles, settings: &TrainingSettings, threads: usize) -> Result<Restored, TrainingError> {
    let path = files.checkpoint();
    let bytes =
        std::fs::read(&path).map_err(|error| TrainingError::file(&path, &format!("cannot be read: {error}")))?;
    let damaged = || TrainingError::file(&path, "is no checkpoint of fine-tuning, or is damaged");
    let (body, crc) = bytes.split_last_chunk::<4>().ok_or_else(damaged)?;
    let rest = body.strip_prefix(MAGIC).ok_or_else(damaged)?;
    if crc32c::crc32c(body) != u32::from_le_bytes(*crc) {
        return Err(damaged());
    }
    let (position, rest) = part(rest).ok_or_else(damaged)?;
    let (average, rest) = part(rest).ok_or_else(damaged)?;
    let (core, _) = part(rest).ok_or_else(damaged)?;
    let told = |error: sac::CheckpointError| TrainingError::file(&path, &error.to_string());
    let average = if average.is_empty() { None } else { Some(Network::restore(average).map_err(told)?) };
    let (mut learner, written) = Learner::restore_core(core, Machine::with_threads(threads)).map_err(told)?;
    if *learner.shape() != settings.shape() {
        return Err(TrainingError::file(&path, "was written under other settings than those beside it"));
    }
    let capacity = settings.sac.replay;
    let replay = ReplayFiles::new(files.replay(), capacity, written);
    replay.restore(written.saturating_sub(capacity as u64)..written, &mut learner)?;
    let position = serde_json::from_slice(position).map_err(|_| damaged())?;
    Ok(Restored { position, average: Average::from(average), learner, replay })
}

/// A length and what it is the length of; the rest.
fn part(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (length, rest) = bytes.split_first_chunk::<4>()?;
    rest.split_at_checked(usize::try_from(u32::from_le_bytes(*length)).ok()?)
}
