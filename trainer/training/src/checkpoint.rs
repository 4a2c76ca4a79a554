//! A checkpoint: where the run stands, also within an episode, and everything that the learner knows.
//!
//! ```text
//! "DPRUN004"   position as JSON   sums since the last point of the curve as JSON   actions of the episode under way (f32)
//!              averaged network, or nothing   which policy was best, or nothing   its network, or nothing
//!              the learner but for its replay's rows   CRC-32C of everything before (u32)
//! ```
//!
//! The file itself: [`crate::checkpoint_file`].

use sac::{Learner, Network};
use serde::{Deserialize, Serialize};

use crate::TrainingError;
use crate::average::Average;
use crate::checkpoint_file::{CheckpointFormat, read_bytes, restore_learner};
use crate::checkpoint_selection::Best;
use crate::replay_files::ReplayFiles;
use crate::run::Window;
use crate::run_files::RunFiles;
use crate::settings::TrainingSettings;

const FORMAT: CheckpointFormat = CheckpointFormat { magic: *b"DPRUN004", of: "this program" };

/// Where a run stands.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(crate) struct Position {
    /// Steps done.
    pub(crate) steps: u64,
    /// Number of the episode under way, or of the next one where none is.
    pub(crate) episode: u64,
    /// Seconds of work so far.
    pub(crate) wall_s: f64,
    /// Part of them that was spent in the environment, in s.
    pub(crate) environment_s: f64,
}

/// Contents of a checkpoint besides the learner.
#[derive(Debug, Clone, Default)]
pub(crate) struct Standing {
    pub(crate) position: Position,
    pub(crate) window: Window,
    /// Actions of the episode under way, `[turns × 8 rigs × 12]`; empty between two episodes.
    pub(crate) actions: Vec<f32>,
    pub(crate) average: Average,
    pub(crate) best: Option<Best>,
}

/// Writes a checkpoint, as a whole or not at all; the rows of its replay come first.
pub(crate) fn write(
    files: &RunFiles,
    replay: &mut ReplayFiles,
    standing: &Standing,
    learner: &Learner,
) -> Result<(), TrainingError> {
    let path = files.checkpoint();
    let unwritable = |error: serde_json::Error| TrainingError::file(&path, &error.to_string());
    let saved = |network: Option<&Network>| network.map_or_else(Vec::new, Network::save);
    let best = standing.best.as_ref();
    let parts = [
        serde_json::to_vec(&standing.position).map_err(unwritable)?,
        serde_json::to_vec(&standing.window).map_err(unwritable)?,
        standing.actions.iter().flat_map(|a| a.to_le_bytes()).collect(),
        saved(standing.average.get()),
        best.map_or_else(Vec::new, Best::to_bytes),
        saved(best.map(|best| &best.network)),
    ];
    FORMAT.write(files, replay, parts, learner)
}

/// Reads a checkpoint that was written under these settings.
pub(crate) fn read(
    files: &RunFiles,
    settings: &TrainingSettings,
    threads: usize,
) -> Result<(Standing, ReplayFiles, Learner), TrainingError> {
    let path = files.checkpoint();
    let bytes = read_bytes(&path)?;
    let damaged = || FORMAT.damaged(&path);
    let ([position, window, actions, average, kept, best], core) = FORMAT.parts(&path, &bytes)?;
    let restored = |bytes: &[u8]| match bytes {
        [] => Ok(None),
        bytes => Network::restore(bytes).map(Some).map_err(|error| TrainingError::file(&path, &error.to_string())),
    };
    let best = match restored(best)? {
        Some(network) => Some(Best::from_bytes(kept, network).ok_or_else(damaged)?),
        None => None,
    };
    let standing = Standing {
        position: serde_json::from_slice(position).map_err(|_| damaged())?,
        window: serde_json::from_slice(window).map_err(|_| damaged())?,
        actions: actions.as_chunks::<4>().0.iter().map(|four| f32::from_le_bytes(*four)).collect(),
        average: Average::from(restored(average)?),
        best,
    };
    let (learner, replay) = restore_learner(files, settings, core, threads)?;
    Ok((standing, replay, learner))
}
