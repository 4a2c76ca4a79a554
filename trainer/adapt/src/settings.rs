//! A run as data, and the daemon's folders.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::AdaptError;
use crate::rig_time::Pacing;

/// Permission to drive the rig by a designed experiment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Experiments {
    /// Given where diagnosis needs one.
    Allowed,
    /// The operator is asked, once.
    Ask,
}

/// Thoroughness of the diagnosis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Search {
    /// `--quick`.
    Quick,
    /// All of it.
    Whole,
}

/// Condition on which a policy is trained.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Training {
    /// More is left than any controller must leave.
    #[default]
    WhereItGains,
    /// In any case.
    Always,
}

/// A run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AdaptSettings {
    /// The daemon's configuration.
    pub config: PathBuf,
    /// Longest time that a run for a figure, or for recording, takes, in s of the rig.
    pub fly_seconds: f64,
    /// The most of what was recorded that diagnosis reads, in s of the rig.
    pub diagnose_seconds: f64,
    /// Thoroughness of the diagnosis.
    pub search: Search,
    /// Permission to drive the rig by an experiment.
    pub experiments: Experiments,
    /// Condition on which a policy is trained.
    #[serde(default)]
    pub training: Training,
    /// Rounds of training at most (`trainer improve --rounds`).
    pub train_rounds: u64,
    /// Seconds of training at most, on the wall.
    pub train_seconds: u64,
    /// Time that the daemon's verdict on a policy is waited for, in s on the wall.
    pub verdict_seconds: u64,
    /// Seed of the training.
    pub seed: u64,
}

impl AdaptSettings {
    /// Defaults, taken where the command line says nothing.
    pub fn new(config: PathBuf) -> Self {
        AdaptSettings {
            config,
            fly_seconds: 60.0,
            diagnose_seconds: 120.0,
            search: Search::Quick,
            experiments: Experiments::Ask,
            training: Training::WhereItGains,
            train_rounds: 12,
            train_seconds: 240,
            verdict_seconds: 900,
            seed: 1,
        }
    }
}

/// Part of a daemon's configuration that an adaptation needs: its folders, and how its ticks pass.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DaemonFolders {
    /// Folder of its recordings.
    pub recordings: PathBuf,
    /// Folder in which policies are published.
    pub policies: PathBuf,
    /// Pacing of its ticks.
    pub pacing: Pacing,
}

impl DaemonFolders {
    /// Reads a configuration, as far as folders go; everything else is the daemon's to judge.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn read(config: &Path) -> Result<Self, AdaptError> {
        let text = std::fs::read_to_string(config)
            .map_err(|error| AdaptError::file(config, format!("cannot be read: {error}")))?;
        let table: toml::Table = toml::from_str(&text).map_err(|error| AdaptError::file(config, error.message()))?;
        let base = config.parent().unwrap_or(Path::new(""));
        let folder = |table_name: &str, default: &str| {
            let value = table.get(table_name).and_then(|table| table.get("directory")).and_then(|value| value.as_str());
            base.join(value.unwrap_or(default))
        };
        let pacing = table.get("link").and_then(|link| link.get("pacing")).and_then(|pacing| pacing.as_str());
        Ok(DaemonFolders {
            recordings: folder("record", "recordings"),
            policies: folder("policy", "policies"),
            pacing: if pacing == Some("lockstep") { Pacing::Lockstep } else { Pacing::RealTime },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_are_beside_the_configuration_unless_it_says_otherwise() {
        let folder = std::env::temp_dir().join(format!("adapt-config-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let config = folder.join("c.toml");
        std::fs::write(&config, "[link]\naddress = \"a:1\"\n[record]\ndirectory = \"/var/r\"\n").unwrap();
        let folders = DaemonFolders::read(&config).unwrap();
        assert_eq!(folders.pacing, Pacing::RealTime);
        assert_eq!((folders.recordings, folders.policies), (PathBuf::from("/var/r"), folder.join("policies")));
        std::fs::remove_dir_all(folder).unwrap();
    }
}
