//! What an adaptation has done: kept after every step, so that it goes on where it was.

use std::path::{Path, PathBuf};

use proto::atomic_file;
use serde::{Deserialize, Serialize};

use crate::AdaptError;
use crate::rig_time::TICKS_PER_MIN;
use crate::settings::AdaptSettings;
use crate::tracking::Tracking;
use crate::worst::{Since, Worst};

/// Name of the file in the folder of a run.
const FILE: &str = "journal.json";

/// Name of the run along the reference before anything was changed.
pub(crate) const BEFORE: &str = "before";

/// What was there before anything was changed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Before {
    /// Policy that controlled, or `fallback`.
    pub policy: String,
    /// Model in force.
    pub model: String,
    /// The operator's reference, as the daemon names it; empty in the journal of an older program.
    #[serde(default)]
    pub reference: String,
    /// Commands that the safety filter had changed.
    pub interventions: u64,
    /// Session and tick.
    pub at: (u32, u32),
}

/// A run along the reference.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Flown {
    /// What controlled, in words.
    pub what: String,
    /// Figures.
    pub tracking: Tracking,
    /// Minutes of the rig from the beginning until it was over.
    #[serde(default)]
    pub rig_minutes: f64,
    /// Seconds after which it was ended because it tracked worse than what was there; nothing where it was not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ended_after_s: Option<f64>,
    /// Mean squares of the error of both channels together, second by second, in kPa², nothing of a second without
    /// control: what later flights are held against.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub squares: Vec<Option<f64>>,
}

/// What the daemon made of the policy.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Verdict {
    /// The policy's state when it was decided: `active`, `refused`, or `not published`.
    pub state: String,
    /// Why it was refused or not published.
    pub why: String,
}

/// What has been done.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Journal {
    /// The run.
    pub settings: AdaptSettings,
    /// What was there.
    pub before: Option<Before>,
    /// Recordings that diagnosis reads.
    pub recordings: Vec<PathBuf>,
    /// Recordings of experiments.
    pub experiments: Vec<PathBuf>,
    /// The operator's answer, once given.
    pub experiment_allowed: Option<bool>,
    /// Folder of the last diagnosis.
    pub found: Option<PathBuf>,
    /// The daemon's line on the new model, once it is in force.
    pub model_line: Option<String>,
    /// RMSE that any controller must leave on the new model, in kPa, noise included.
    #[serde(default)]
    pub optimum_kpa: Option<[f64; 2]>,
    /// The policy that was trained.
    pub trained: Option<PathBuf>,
    /// Name under which it was published.
    pub published: Option<String>,
    /// Name of what controlled when it was published.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub incumbent: Option<String>,
    /// What the daemon made of it.
    pub verdict: Option<Verdict>,
    /// Runs along the reference: before, with the model, with the policy.
    pub flown: Vec<Flown>,
    /// What controls at the end, in words.
    pub kept: Option<String>,
    /// Where the sitting under way began; a sitting that was killed leaves it behind for the next one to count from.
    #[serde(default)]
    pub since: Option<Since>,
    /// The worst pressures of all sittings that are over: highest positive, lowest negative.
    #[serde(default)]
    pub worst: Option<[Worst; 2]>,
    /// Ticks of the rig that were used.
    pub ticks: u64,
    /// Those of them that passed while this machine computed, or in lockstep beyond what real time has.
    #[serde(default)]
    pub unused_ticks: u64,
    /// Seconds that this machine computed meanwhile.
    #[serde(default)]
    pub computed_s: f64,
    /// Commands that the safety filter changed meanwhile.
    pub interventions: Option<u64>,
}

impl Journal {
    /// Nothing done yet.
    pub fn new(settings: AdaptSettings) -> Self {
        Journal {
            settings,
            before: None,
            recordings: Vec::new(),
            experiments: Vec::new(),
            experiment_allowed: None,
            found: None,
            model_line: None,
            optimum_kpa: None,
            trained: None,
            published: None,
            incumbent: None,
            verdict: None,
            flown: Vec::new(),
            kept: None,
            since: None,
            worst: None,
            ticks: 0,
            unused_ticks: 0,
            computed_s: 0.0,
            interventions: None,
        }
    }

    /// Reads that of a run.
    ///
    /// # Errors
    /// A folder without one.
    pub fn read(out: &Path) -> Result<Self, AdaptError> {
        let path = out.join(FILE);
        let text = std::fs::read_to_string(&path).map_err(|error| {
            AdaptError::file(
                &path,
                format!("cannot be read: {error}; --resume takes the folder of a run that was begun"),
            )
        })?;
        serde_json::from_str(&text).map_err(|error| AdaptError::file(&path, error))
    }

    /// Whether a folder has one.
    pub fn is_in(out: &Path) -> bool {
        out.join(FILE).exists()
    }

    /// Keeps it.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn keep(&self, out: &Path) -> Result<(), AdaptError> {
        let path = out.join(FILE);
        let text = serde_json::to_string_pretty(self).map_err(|error| AdaptError::file(&path, error))?;
        Ok(atomic_file::write(&path, format!("{text}\n").as_bytes())?)
    }

    /// Minutes of the rig that were used of so many ticks since the beginning.
    pub fn rig_minutes(&self, ticks: u64) -> f64 {
        ticks.saturating_sub(self.unused_ticks) as f64 / TICKS_PER_MIN
    }

    /// Forgets what was changed and has been put back; what was learned stays.
    pub fn forget_changes(&mut self) {
        self.model_line = None;
        self.published = None;
        self.incumbent = None;
        self.verdict = None;
        self.flown.retain(|flown| flown.what == BEFORE);
    }

    /// Figures of the run of a name, once it was made.
    pub fn flown(&self, what: &str) -> Option<Tracking> {
        self.flight(what).map(|flown| flown.tracking)
    }

    /// The run of a name, once it was made.
    pub fn flight(&self, what: &str) -> Option<&Flown> {
        self.flown.iter().find(|flown| flown.what == what)
    }
}
