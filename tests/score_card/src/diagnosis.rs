//! `diagnosis.json`, as far as it is judged. Keys that are missing count as empty: a program that says less is judged on
//! what it says.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

/// The five answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The rig file explains the recordings.
    Adequate,
    /// Other parameters are all that is needed.
    ParametersMoved,
    /// The mechanisms named are missing.
    MissingPhysics,
    /// These recordings do not decide.
    Undecided,
    /// None of the library.
    UnknownMechanism,
}

impl Verdict {
    /// As the file writes it.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Adequate => "adequate",
            Self::ParametersMoved => "parameters_moved",
            Self::MissingPhysics => "missing_physics",
            Self::Undecided => "undecided",
            Self::UnknownMechanism => "unknown_mechanism",
        }
    }
}

/// A parameter with its interval.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Found {
    /// Value.
    pub value: f64,
    /// Unit.
    #[serde(default)]
    pub unit: String,
    /// Lower end of the 90 % interval.
    pub low: Option<f64>,
    /// Upper end.
    pub high: Option<f64>,
}

/// A mechanism that is named.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Named {
    /// Id.
    pub id: String,
    /// `positive`, `negative` or `both`.
    #[serde(rename = "where", default)]
    pub place: String,
    /// Parameters.
    #[serde(default)]
    pub parameters: BTreeMap<String, Found>,
    /// Ids (perhaps `id:where`) that would do as well.
    #[serde(default)]
    pub rivals: Vec<String>,
}

/// Parts of a diagnosis that are judged.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Diagnosis {
    /// The answer.
    pub verdict: Verdict,
    /// Named mechanisms.
    #[serde(default)]
    pub mechanisms: Vec<Named>,
    /// Explanations that the recordings do not tell apart: groups of `id:where`.
    #[serde(default)]
    pub rivals: Vec<Vec<String>>,
    /// Name of the experiment's file.
    #[serde(default)]
    pub next_experiment: Option<String>,
}

/// Why a diagnosis cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum DiagnosisError {
    /// No file.
    #[error("{}: cannot be read: {source}; diagnose writes it into --out", file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
    /// Not what the interface says.
    #[error("{}: no diagnosis: {source}", file.display())]
    Parse {
        /// The file.
        file: PathBuf,
        /// Error of the JSON reader.
        source: serde_json::Error,
    },
}

impl Diagnosis {
    /// Reads `diagnosis.json` of a folder.
    ///
    /// # Errors
    /// The file is absent or not what the interface says.
    pub fn read(folder: &Path) -> Result<Self, DiagnosisError> {
        let file = folder.join("diagnosis.json");
        let bytes = fs::read(&file).map_err(|source| DiagnosisError::Read { file: file.clone(), source })?;
        serde_json::from_slice(&bytes).map_err(|source| DiagnosisError::Parse { file, source })
    }

    /// Every explanation that is still in the race, as `id:where`: what is named, its rivals, the groups of rivals.
    pub fn in_the_race(&self) -> Vec<String> {
        let mut race: Vec<String> = self.rivals.iter().flatten().cloned().collect();
        for named in &self.mechanisms {
            race.push(format!("{}:{}", named.id, named.place));
            race.extend(
                named
                    .rivals
                    .iter()
                    .map(|rival| if rival.contains(':') { rival.clone() } else { format!("{rival}:{}", named.place) }),
            );
        }
        race.sort();
        race.dedup();
        race
    }
}
