//! Everything that a run of fine-tuning goes on from.
//!
//! ```text
//! "DPFINE01"   position as JSON   averaged network, or nothing   the learner but for its replay's rows
//!              CRC-32C of everything before (u32)
//! ```
//!
//! The file itself: [`training::checkpoint_file`]. The recordings
//! are read again from their beginning, and as many transitions passed over as the position says.

use sac::{Learner, Network};
use serde::{Deserialize, Serialize};
use training::average::Average;
use training::checkpoint_file::{CheckpointFormat, read_bytes, restore_learner};
use training::replay_files::ReplayFiles;
use training::{RunFiles, TrainingError, TrainingSettings};

const FORMAT: CheckpointFormat = CheckpointFormat { magic: *b"DPFINE01", of: "fine-tuning" };

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
    /// The last of them, by its file's name.
    #[serde(default)]
    pub last_published: Option<String>,
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
    let average = average.get().map_or_else(Vec::new, Network::save);
    FORMAT.write(files, replay, [position, average], learner)
}

/// State that was read back.
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
    let bytes = read_bytes(&path)?;
    let ([position, average], core) = FORMAT.parts(&path, &bytes)?;
    let told = |error: sac::CheckpointError| TrainingError::file(&path, &error.to_string());
    let average = if average.is_empty() { None } else { Some(Network::restore(average).map_err(told)?) };
    let (learner, replay) = restore_learner(files, settings, core, threads)?;
    let position = serde_json::from_slice(position).map_err(|_| FORMAT.damaged(&path))?;
    Ok(Restored { position, average: Average::from(average), learner, replay })
}
