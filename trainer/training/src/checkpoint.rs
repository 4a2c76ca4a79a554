//! A checkpoint: where the run stands, also within an episode, and everything that the learner knows.
//!
//! ```text
//! "DPRUN004"   position as JSON   sums since the last point of the curve as JSON   actions of the episode under way (f32)
//!              averaged network, or nothing   which policy was best, or nothing   its network, or nothing
//!              the learner but for its replay's rows   CRC-32C of everything before (u32)
//! ```
//!
//! Each part after a u32 length, little endian. The replay's rows stand beside it ([`crate::replay_files`]), so that a
//! checkpoint is a few megabytes at any time.

use sac::{Learner, Machine, Network};
use serde::{Deserialize, Serialize};

use crate::TrainingError;
use crate::average::Average;
use crate::checkpoint_selection::Best;
use crate::replay_files::ReplayFiles;
use crate::run::Window;
use crate::run_files::RunFiles;
use crate::settings::TrainingSettings;

const MAGIC: &[u8; 8] = b"DPRUN004";

/// Where a run stands.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(crate) struct Position {
    /// Steps done.
    pub(crate) steps: u64,
    /// Number of the episode under way, or of the next one where none is.
    pub(crate) episode: u64,
    /// Seconds of work so far.
    pub(crate) wall_s: f64,
    /// Of these in the environment.
    pub(crate) environment_s: f64,
}

/// What a checkpoint holds besides the learner.
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
        learner.save_core(),
    ];
    let mut bytes = MAGIC.to_vec();
    for part in parts {
        bytes.extend((part.len() as u32).to_le_bytes());
        bytes.extend(part);
    }
    bytes.extend(crc32c::crc32c(&bytes).to_le_bytes());
    replay.keep_tail(learner)?;
    RunFiles::write(&path, &bytes)?;
    replay.tidy(&learner.replay_rows());
    Ok(())
}

/// Reads a checkpoint that was written under these settings.
pub(crate) fn read(
    files: &RunFiles,
    settings: &TrainingSettings,
    threads: usize,
) -> Result<(Standing, ReplayFiles, Learner), TrainingError> {
    let path = files.checkpoint();
    let bytes =
        std::fs::read(&path).map_err(|error| TrainingError::file(&path, &format!("cannot be read: {error}")))?;
    let damaged = || TrainingError::file(&path, "is no checkpoint of this program, or is damaged");
    let (body, crc) = bytes.split_last_chunk::<4>().ok_or_else(damaged)?;
    let rest = body.strip_prefix(MAGIC).ok_or_else(damaged)?;
    if crc32c::crc32c(body) != u32::from_le_bytes(*crc) {
        return Err(damaged());
    }
    let (position, rest) = part(rest).ok_or_else(damaged)?;
    let (window, rest) = part(rest).ok_or_else(damaged)?;
    let (actions, rest) = part(rest).ok_or_else(damaged)?;
    let (average, rest) = part(rest).ok_or_else(damaged)?;
    let (kept, rest) = part(rest).ok_or_else(damaged)?;
    let (best, rest) = part(rest).ok_or_else(damaged)?;
    let (core, _) = part(rest).ok_or_else(damaged)?;
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
    let (mut learner, written) = Learner::restore_core(core, Machine::with_threads(threads))
        .map_err(|error| TrainingError::file(&path, &error.to_string()))?;
    if *learner.shape() != settings.shape() {
        return Err(TrainingError::file(&path, "was written under other settings than those beside it"));
    }
    let capacity = settings.sac.replay;
    let replay = ReplayFiles::new(files.replay(), capacity, written);
    replay.restore(written.saturating_sub(capacity as u64)..written, &mut learner)?;
    Ok((standing, replay, learner))
}

/// A length and what it is the length of; the rest.
pub(crate) fn part(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (length, rest) = bytes.split_first_chunk::<4>()?;
    rest.split_at_checked(usize::try_from(u32::from_le_bytes(*length)).ok()?)
}
