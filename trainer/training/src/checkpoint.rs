//! A checkpoint: where the run stands, and everything that the learner knows.
//!
//! ```text
//! "DPRUN002"   u32 length   position as JSON   u32 length   averaged network, or nothing   the learner
//! ```
//!
//! Network and learner are bytes of their own making, which carry their checksums.

use sac::{Learner, Machine, Network};
use serde::{Deserialize, Serialize};

use crate::TrainingError;
use crate::average::Average;
use crate::run_files::RunFiles;
use crate::settings::TrainingSettings;

const MAGIC: &[u8; 8] = b"DPRUN002";

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
pub(crate) fn write(
    files: &RunFiles,
    position: &Position,
    average: &Average,
    learner: &Learner,
) -> Result<(), TrainingError> {
    let path = files.checkpoint();
    let position = serde_json::to_vec(position).map_err(|error| TrainingError::file(&path, &error.to_string()))?;
    let mut bytes = MAGIC.to_vec();
    for part in [position, average.get().map_or_else(Vec::new, Network::save)] {
        bytes.extend((part.len() as u32).to_le_bytes());
        bytes.extend(part);
    }
    bytes.extend(learner.save());
    RunFiles::write(&path, &bytes)
}

/// Reads a checkpoint that was written under these settings.
pub(crate) fn read(
    files: &RunFiles,
    settings: &TrainingSettings,
    threads: usize,
) -> Result<(Position, Average, Learner), TrainingError> {
    let path = files.checkpoint();
    let bytes =
        std::fs::read(&path).map_err(|error| TrainingError::file(&path, &format!("cannot be read: {error}")))?;
    let damaged = || TrainingError::file(&path, "is no checkpoint of this program, or is damaged");
    let rest = bytes.strip_prefix(MAGIC).ok_or_else(damaged)?;
    let (position, rest) = part(rest).ok_or_else(damaged)?;
    let (average, saved) = part(rest).ok_or_else(damaged)?;
    let position = serde_json::from_slice(position).map_err(|_| damaged())?;
    let average = match average {
        [] => None,
        bytes => Some(Network::restore(bytes).map_err(|error| TrainingError::file(&path, &error.to_string()))?),
    };
    let learner = Learner::restore(saved, Machine::with_threads(threads))
        .map_err(|error| TrainingError::file(&path, &error.to_string()))?;
    if *learner.shape() != settings.shape() {
        return Err(TrainingError::file(&path, "was written under other settings than those beside it"));
    }
    Ok((position, Average::from(average), learner))
}

/// A length and what it is the length of; the rest.
pub(crate) fn part(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (length, rest) = bytes.split_first_chunk::<4>()?;
    rest.split_at_checked(usize::try_from(u32::from_le_bytes(*length)).ok()?)
}
