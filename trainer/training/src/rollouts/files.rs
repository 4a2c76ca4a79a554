//! The checkpoint of a run of rollouts: where it stands, its network with what Adam remembers, and the best network.
//!
//! ```text
//! "DPROLL02"   position as JSON   network   steps of Adam (u64)   means   squares (f32)   best network   CRC-32C of everything before (u32)
//! ```

use std::path::Path;

use model::observation::Pair;
use sac::{Moments, Network};
use serde::{Deserialize, Serialize};

use super::outcome::Round;
use crate::TrainingError;
use crate::checkpoint_file::{append_part, part, read_bytes};
use crate::run_files::RunFiles;

const MAGIC: &[u8; 8] = b"DPROLL02";

/// Where a run stands.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Position {
    /// Rounds done.
    pub(super) rounds: u64,
    /// Seconds of work.
    pub(super) wall_s: f64,
    /// Every round so far; the first is the policy that the run began with.
    pub(super) curve: Vec<Round>,
    /// The one of these whose policy is the best.
    pub(super) kept: Round,
    /// The fallback on the rigs set aside, in kPa; of policies that correct it.
    pub(super) fallback_kpa: Option<Pair>,
}

/// Everything to go on from.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Standing {
    pub(super) position: Position,
    pub(super) network: Network,
    pub(super) moments: Moments,
    pub(super) best: Network,
}

/// Writes a checkpoint, as a whole or not at all.
pub(super) fn write(files: &RunFiles, standing: &Standing) -> Result<(), TrainingError> {
    let path = files.checkpoint();
    let position =
        serde_json::to_vec(&standing.position).map_err(|error| TrainingError::file(&path, &error.to_string()))?;
    let numbers = |numbers: &[f32]| numbers.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let mut bytes = MAGIC.to_vec();
    for part in [
        position,
        standing.network.save(),
        standing.moments.steps.to_le_bytes().to_vec(),
        numbers(&standing.moments.mean),
        numbers(&standing.moments.square),
        standing.best.save(),
    ] {
        append_part(&mut bytes, &part);
    }
    bytes.extend(crc32c::crc32c(&bytes).to_le_bytes());
    RunFiles::write(&path, &bytes)
}

/// Reads a checkpoint.
pub(super) fn read(path: &Path) -> Result<Standing, TrainingError> {
    let bytes = read_bytes(path)?;
    parsed(&bytes).ok_or_else(|| {
        TrainingError::file(
            path,
            "is no checkpoint of `trainer improve`, or is damaged; runs of `trainer train` go on with that",
        )
    })
}

fn parsed(bytes: &[u8]) -> Option<Standing> {
    let (body, crc) = bytes.split_last_chunk::<4>()?;
    if crc32c::crc32c(body) != u32::from_le_bytes(*crc) {
        return None;
    }
    let (position, rest) = part(body.strip_prefix(MAGIC)?)?;
    let (network, rest) = part(rest)?;
    let (steps, rest) = part(rest)?;
    let (mean, rest) = part(rest)?;
    let (square, rest) = part(rest)?;
    let (best, _) = part(rest)?;
    let position: Position = serde_json::from_slice(position).ok()?;
    let network = Network::restore(network).ok()?;
    let steps = u64::from_le_bytes(steps.try_into().ok()?);
    let numbers =
        |bytes: &[u8]| bytes.as_chunks::<4>().0.iter().map(|four| f32::from_le_bytes(*four)).collect::<Vec<f32>>();
    let moments = Moments { mean: numbers(mean), square: numbers(square), steps };
    let fits = Moments::of(&network).mean.len();
    if moments.mean.len() != fits || moments.square.len() != fits {
        return None;
    }
    let best = Network::restore(best).ok()?;
    Some(Standing { position, network, moments, best })
}
