//! A checkpoint: where the run stands, and everything that the learner knows.
//!
//! ```text
//! "DPRUN001"   u32 length   position as JSON   the learner's own bytes, which carry their checksum
//! ```

use sac::{Learner, Machine};
use serde::{Deserialize, Serialize};

use crate::TrainingError;
use crate::run_files::RunFiles;
use crate::settings::TrainingSettings;

const MAGIC: &[u8; 8] = b"DPRUN001";

/// Where a run stands, between two episodes.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(crate) struct Position {
    /// Steps done.
    pub(crate) steps: u64,
    /// Steps done before the last episode.
    pub(crate) steps_before: u64,
    /// Number of the next episode.
    pub(crate) episode: u64,
    /// Seconds of work so far.
    pub(crate) wall_s: f64,
    /// Of these in the environment.
    pub(crate) environment_s: f64,
}

/// Writes a checkpoint, as a whole or not at all.
pub(crate) fn write(files: &RunFiles, position: &Position, learner: &Learner) -> Result<(), TrainingError> {
    let path = files.checkpoint();
    let position = serde_json::to_vec(position).map_err(|error| TrainingError::file(&path, &error.to_string()))?;
    let mut bytes = MAGIC.to_vec();
    bytes.extend((position.len() as u32).to_le_bytes());
    bytes.extend(position);
    bytes.extend(learner.save());
    RunFiles::write(&path, &bytes)
}

/// Reads a checkpoint that was written under these settings.
pub(crate) fn read(
    files: &RunFiles,
    settings: &TrainingSettings,
    threads: usize,
) -> Result<(Position, Learner), TrainingError> {
    let path = files.checkpoint();
    let bytes =
        std::fs::read(&path).map_err(|error| TrainingError::file(&path, &format!("cannot be read: {error}")))?;
    let damaged = || TrainingError::file(&path, "is no checkpoint of this program, or is damaged");
    let rest = bytes.strip_prefix(MAGIC).ok_or_else(damaged)?;
    let (length, rest) = rest.split_first_chunk::<4>().ok_or_else(damaged)?;
    let length = usize::try_from(u32::from_le_bytes(*length)).map_err(|_| damaged())?;
    let (position, saved) = rest.split_at_checked(length).ok_or_else(damaged)?;
    let position = serde_json::from_slice(position).map_err(|_| damaged())?;
    let learner = Learner::restore(saved, Machine::with_threads(threads))
        .map_err(|error| TrainingError::file(&path, &error.to_string()))?;
    if *learner.shape() != settings.shape() {
        return Err(TrainingError::file(&path, "was written under other settings than those beside it"));
    }
    Ok((position, learner))
}
