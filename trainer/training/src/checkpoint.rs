//! A checkpoint: where the run stands, and everything that the learner knows.
//!
//! ```text
//! "DPRUN003"   u32 length   position as JSON   u32 length   averaged network, or nothing
//!              u32 length   which policy was best as JSON, or null   u32 length   its network, or nothing   the learner
//! ```
//!
//! Network and learner are bytes of their own making, which carry their checksums.

use sac::{Learner, Machine, Network};
use serde::{Deserialize, Serialize};

use crate::TrainingError;
use crate::average::Average;
use crate::checkpoint_selection::BestCheckpoint;
use crate::run_files::RunFiles;
use crate::settings::TrainingSettings;

const MAGIC: &[u8; 8] = b"DPRUN003";

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
    best: Option<&(BestCheckpoint, Network)>,
    learner: &Learner,
) -> Result<(), TrainingError> {
    let path = files.checkpoint();
    let unwritable = |error: serde_json::Error| TrainingError::file(&path, &error.to_string());
    let position = serde_json::to_vec(position).map_err(unwritable)?;
    let kept = serde_json::to_vec(&best.map(|(kept, _)| kept)).map_err(unwritable)?;
    let saved = |network: Option<&Network>| network.map_or_else(Vec::new, Network::save);
    let mut bytes = MAGIC.to_vec();
    for part in [position, saved(average.get()), kept, saved(best.map(|(_, network)| network))] {
        bytes.extend((part.len() as u32).to_le_bytes());
        bytes.extend(part);
    }
    bytes.extend(learner.save());
    RunFiles::write(&path, &bytes)
}

/// What a checkpoint holds.
pub(crate) struct Checkpoint {
    pub(crate) position: Position,
    pub(crate) average: Average,
    pub(crate) best: Option<(BestCheckpoint, Network)>,
    pub(crate) learner: Learner,
}

/// Reads a checkpoint that was written under these settings.
pub(crate) fn read(files: &RunFiles, settings: &TrainingSettings, threads: usize) -> Result<Checkpoint, TrainingError> {
    let path = files.checkpoint();
    let bytes =
        std::fs::read(&path).map_err(|error| TrainingError::file(&path, &format!("cannot be read: {error}")))?;
    let damaged = || TrainingError::file(&path, "is no checkpoint of this program, or is damaged");
    let rest = bytes.strip_prefix(MAGIC).ok_or_else(damaged)?;
    let (position, rest) = part(rest).ok_or_else(damaged)?;
    let (average, rest) = part(rest).ok_or_else(damaged)?;
    let (kept, rest) = part(rest).ok_or_else(damaged)?;
    let (best, saved) = part(rest).ok_or_else(damaged)?;
    let position = serde_json::from_slice(position).map_err(|_| damaged())?;
    let kept: Option<BestCheckpoint> = serde_json::from_slice(kept).map_err(|_| damaged())?;
    let restored = |bytes: &[u8]| match bytes {
        [] => Ok(None),
        bytes => Network::restore(bytes).map(Some).map_err(|error| TrainingError::file(&path, &error.to_string())),
    };
    let average = Average::from(restored(average)?);
    let best = kept.zip(restored(best)?);
    let learner = Learner::restore(saved, Machine::with_threads(threads))
        .map_err(|error| TrainingError::file(&path, &error.to_string()))?;
    if *learner.shape() != settings.shape() {
        return Err(TrainingError::file(&path, "was written under other settings than those beside it"));
    }
    Ok(Checkpoint { position, average, best, learner })
}

/// A length and what it is the length of; the rest.
pub(crate) fn part(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (length, rest) = bytes.split_first_chunk::<4>()?;
    rest.split_at_checked(usize::try_from(u32::from_le_bytes(*length)).ok()?)
}
