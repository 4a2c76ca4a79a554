//! Truth files: what was concealed in a case, and all it takes to run that hidden rig again.
//!
//! Written aside of the recordings and read by the scorer alone. The first keys (`truth`, with `id`, `where` and `note`
//! per effect) are those of the open recordings; ids are the diagnosis's, and `unknown_mechanism` stands for what its
//! library does not hold (`kind` then says what it is).

use std::fs;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::build_sheet::BuildSheet;
use crate::effects::{Effect, Place};
use crate::excitation::OperatingRange;
use crate::recording::{Command, Recording, RecordingError, write_whole};
use crate::rng::{Draws, fnv1a};
use crate::run::Rig;
use crate::sizing::Size;

/// Purpose of a case.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Class {
    /// Nothing concealed, parameters as built.
    Nothing,
    /// Nothing concealed, parameters moved by 2 to 10 %.
    ParametersMoved,
    /// One effect.
    Single,
    /// Two effects.
    Pair,
    /// Three effects.
    Triple,
    /// One effect that the library does not hold.
    Outside,
}

/// An effect that sits in a rig.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Planted {
    /// The diagnosis's id for it.
    pub id: String,
    /// Kind and parameters.
    #[serde(flatten)]
    pub effect: Effect,
    /// Where it sits.
    #[serde(rename = "where")]
    pub place: Place,
    /// Description in a line.
    pub note: String,
    /// Size on the first recording, on its own.
    pub size: Size,
}

impl Planted {
    /// An effect in its place, with its size.
    pub fn new(effect: Effect, place: Place, size: Size) -> Self {
        Self { id: effect.kind().id().to_owned(), note: effect.note(), effect, place, size }
    }
}

/// Who sees a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// The diagnosis.
    Given,
    /// The scorer alone.
    HeldOut,
}

/// A recording of a case.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordingEntry {
    /// Name, the same in the case's folder and in the truth's.
    pub file: String,
    /// Kind of its excitation.
    pub excitation: String,
    /// `given` to the diagnosis, or `held_out` from it: the scorer's own.
    pub role: Role,
    /// Root mean square of what the concealed effects do in it (kPa), by channel; for the first and the last recording.
    pub effect_kpa: Option<[f64; 2]>,
    /// Root mean square of reading minus truth (kPa), by channel: no model can do better.
    pub noise_kpa: [f64; 2],
}

/// The truth of a case.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Truth {
    /// Name of the case.
    pub case: String,
    /// Seed of all its draws.
    pub seed: u64,
    /// Purpose of the case.
    pub class: Class,
    /// Raw size that the effects were given (kPa); 0 for none.
    pub level_kpa: f64,
    /// The concealed effects.
    pub truth: Vec<Planted>,
    /// Small everyday imperfections beside it.
    pub nuisances: Vec<Planted>,
    /// All nuisances together, on the first recording: what a null leaves.
    pub nuisances_together: Size,
    /// True where the motor slips, so that the ripple beats slowly.
    pub ripple_beats: bool,
    /// Distance of each identifiable parameter from the rig file's value, relative.
    pub parameter_shifts: Vec<(String, f64)>,
    /// All of the rig that is drawn.
    pub build: BuildSheet,
    /// Where it is driven.
    pub range: OperatingRange,
    /// Seed of the noise.
    pub noise_seed: u64,
    /// The recordings.
    pub recordings: Vec<RecordingEntry>,
}

/// Why a truth cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum TruthError {
    /// It cannot be read.
    #[error("{}: cannot be read: {source}", file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
    /// It is no truth.
    #[error("{}: no truth of a case: {source}; truths are written by `hidden_rig make`", file.display())]
    Parse {
        /// The file.
        file: PathBuf,
        /// Error of the JSON reader.
        source: serde_json::Error,
    },
    /// It cannot be written.
    #[error(transparent)]
    Write(#[from] RecordingError),
}

impl Truth {
    /// Reads a truth file.
    ///
    /// # Errors
    /// The file cannot be read or is no truth.
    pub fn read(file: &Path) -> Result<Self, TruthError> {
        let bytes = fs::read(file).map_err(|source| TruthError::Read { file: file.to_owned(), source })?;
        serde_json::from_slice(&bytes).map_err(|source| TruthError::Parse { file: file.to_owned(), source })
    }

    /// Writes it.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, file: &Path) -> Result<(), TruthError> {
        let mut text =
            serde_json::to_vec_pretty(self).map_err(|source| TruthError::Parse { file: file.to_owned(), source })?;
        text.push(b'\n');
        Ok(write_whole(file, &text)?)
    }

    /// The hidden rig.
    pub fn rig(&self) -> Rig {
        self.rig_with(true)
    }

    /// The hidden rig without what is concealed in it, nuisances and all.
    pub fn rig_without_effects(&self) -> Rig {
        self.rig_with(false)
    }

    fn rig_with(&self, effects: bool) -> Rig {
        let mut rig = self.build.rig();
        let planted = self.nuisances.iter().chain(self.truth.iter().filter(|_| effects));
        for planted in planted {
            planted.effect.install(planted.place, &mut rig);
        }
        rig
    }

    /// Runs an experiment on the hidden rig; the same commands give the same recording.
    ///
    /// The rig settles at the first row's duties, or, where these would shut a valve, in the middle of its range: a
    /// recording of an experiment begins at a working point.
    pub fn experiment(&self, commands: &[Command]) -> Recording {
        let first = commands.first().map_or([0.0; 2], |command| command.duty);
        let open = (0..2).all(|c| first[c] >= self.range.duty[c][0] - 0.02);
        let start = if open { first } else { self.range.rest() };
        let bytes: Vec<u8> = commands
            .iter()
            .flat_map(|command| [command.duty[0], command.duty[1], f64::from(u8::from(command.pump_on))])
            .flat_map(f64::to_le_bytes)
            .collect();
        let draws = Draws::new(self.noise_seed ^ fnv1a(&bytes)).stream("experiment");
        Recording::of_commands(&self.rig(), start, commands, draws)
    }
}
