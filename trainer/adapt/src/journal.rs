//! Record of an adaptation, kept after every step, so that it goes on where it was.

use std::path::{Path, PathBuf};

use model::observation::TICKS_PER_S;
use proto::atomic_file;
use proto::diagnosis::Diagnosis;
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

/// State of the daemon before anything was changed.
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
    /// Name of the run: what controlled, in words.
    pub what: String,
    /// Figures.
    pub tracking: Tracking,
    /// Minutes of the rig from the beginning until it was over; nothing where they are not known.
    #[serde(default)]
    pub rig_minutes: Option<f64>,
    /// Place of its ticks in the daemon's recordings; nothing in the journal of an older program.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recorded: Option<TickSpan>,
    /// Seconds after which it was ended because it tracked worse than what was there; nothing where it was not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ended_after_s: Option<f64>,
    /// Mean squares of the error of both channels together, second by second, in kPa², nothing of a second without
    /// control: what later flights are held against.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub squares: Vec<Option<f64>>,
    /// Mean squares by the found rig's late sensors ([`crate::yardstick`]); empty where no sensor is late, and before a model
    /// was found.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub late_squares: Vec<Option<f64>>,
}

impl Flown {
    /// Figures of a run that was not worse than what was there.
    pub fn sound(&self) -> Option<Tracking> {
        self.ended_after_s.is_none().then_some(self.tracking)
    }

    /// Mean squares that a later run is held against.
    pub(crate) fn judged_squares(&self) -> Vec<Option<f64>> {
        let squares = if self.tracking.late_rmse_kpa.is_some() { &self.late_squares } else { &self.squares };
        if squares.is_empty() {
            // An older program kept none.
            vec![Some(self.tracking.both_kpa().powi(2)); (self.tracking.ticks as f64 / TICKS_PER_S) as usize]
        } else {
            squares.clone()
        }
    }
}

/// Diagnosis in a folder that `trainer diagnose` has written.
///
/// # Errors
/// A file of it that cannot be read.
pub(crate) fn diagnosis_in(found: &Path) -> Result<Diagnosis, AdaptError> {
    let path = found.join("diagnosis.json");
    let text = std::fs::read_to_string(&path).map_err(|error| AdaptError::file(&path, error))?;
    Diagnosis::from_json(&text).map_err(|error| AdaptError::file(&path, error))
}

/// Ticks of a session, from one up to another.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct TickSpan {
    /// The session.
    pub session: u32,
    /// The first tick.
    pub start: u32,
    /// The tick behind the last.
    pub until: u32,
}

/// Verdict of the daemon on the policy.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Verdict {
    /// The policy's state when it was decided: `active`, `refused`, or `not published`.
    pub state: String,
    /// Why it was refused or not published.
    pub why: String,
}

/// Record of all that has been done.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Journal {
    /// The run.
    pub settings: AdaptSettings,
    /// State of the daemon before.
    pub before: Option<Before>,
    /// The reference that the operator has put in since, as the daemon names it, where he has: it is put back at the end.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub put_in_since: Option<String>,
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
    /// The daemon's verdict on it.
    pub verdict: Option<Verdict>,
    /// Runs along the reference: before, with the model, with the policy.
    pub flown: Vec<Flown>,
    /// Name of the run whose controller is kept at the end.
    pub kept: Option<String>,
    /// Beginning of the sitting under way; a sitting that was killed leaves it behind for the next one to count from.
    #[serde(default)]
    pub since: Option<Since>,
    /// The worst pressures of all sittings that are over: highest positive, lowest negative.
    #[serde(default)]
    pub worst: Option<[Worst; 2]>,
    /// Ticks of the rig that were used; 0 where the daemon has begun another session on the way.
    pub ticks: u64,
    /// Ticks among them that passed while this machine computed, or in lockstep beyond what real time has.
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
            put_in_since: None,
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
        serde_json::from_str(&text).map_err(|error| {
            AdaptError::file(
                &path,
                format!("is damaged or of another program: {error}; begin anew, with another --out"),
            )
        })
    }

    /// Tells whether a folder has one.
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

    /// Minutes of the rig that were used of so many ticks since the beginning; nothing of none, which says that they were
    /// not counted.
    pub fn rig_minutes(&self, ticks: u64) -> Option<f64> {
        (ticks > 0).then(|| ticks.saturating_sub(self.unused_ticks) as f64 / TICKS_PER_MIN)
    }

    /// Forgets what was changed and has been put back; what was learned stays.
    pub fn forget_changes(&mut self) {
        self.model_line = None;
        self.published = None;
        self.incumbent = None;
        self.verdict = None;
        self.flown.retain(|flown| flown.what == BEFORE);
        // The next model that is found may have other sensors.
        for flown in &mut self.flown {
            flown.tracking.late_rmse_kpa = None;
            flown.late_squares.clear();
        }
    }

    /// Forgets what was there before where no run has counted yet: going on looks at it anew, as it may have been changed.
    pub(crate) fn forget_before_uncounted(&mut self) {
        if self.flown.is_empty() {
            self.before = None;
            self.put_in_since = None;
        }
    }

    /// Session and tick up to which diagnosis reads: the end of the flight before, wherever the daemon is by now; nothing
    /// where the journal does not say, as that of an older program.
    pub(crate) fn diagnosed_until(&self) -> Option<(u32, u32)> {
        self.flight(BEFORE)?.recorded.map(|span| (span.session, span.until))
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A journal as programs wrote it before they knew of late sensors.
    const OLDER: &str = r#"{
        "settings": {"config": "c.toml", "fly_seconds": 20.0, "diagnose_seconds": 60.0, "search": "quick", "experiments": "ask",
            "train_rounds": 1, "train_seconds": 60, "verdict_seconds": 30, "seed": 1},
        "before": {"policy": "fallback", "model": "dual_pressure", "interventions": 3, "at": [9, 100]},
        "recordings": [], "experiments": [], "experiment_allowed": null, "found": null, "model_line": "taken", "trained": null,
        "published": null, "verdict": null, "kept": null, "ticks": 0, "interventions": null,
        "flown": [
            {"what": "before", "squares": [0.3, null, 0.4], "tracking":
                {"rmse_kpa": [0.5, 0.3], "noise_kpa": [0.06, 0.01], "ticks": 150, "extremes_kpa": [86.0, -73.0]}},
            {"what": "with the model", "tracking":
                {"rmse_kpa": [0.4, 0.3], "noise_kpa": [0.06, 0.01], "ticks": 150, "extremes_kpa": [86.0, -73.0]}}
        ]}"#;

    #[test]
    fn an_older_journal_is_read_and_its_runs_are_judged_as_they_were() {
        let folder = std::env::temp_dir().join(format!("adapt-journal-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join(FILE), OLDER).unwrap();
        let journal = Journal::read(&folder).unwrap();
        let [before, after] = &journal.flown[..] else { panic!("{journal:?}") };
        assert_eq!((before.tracking.judged_kpa(), before.recorded), ([0.5, 0.3], None));
        assert_eq!(before.judged_squares(), [Some(0.3), None, Some(0.4)]);
        // Without squares each second has those of the whole run.
        let squares = after.judged_squares();
        assert!(squares.len() == 3 && squares.iter().flatten().all(|s| (s - 0.25).abs() < 1e-12), "{squares:?}");
        journal.keep(&folder).unwrap();
        assert_eq!(Journal::read(&folder).unwrap(), journal);
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn figures_by_late_sensors_decide_until_their_model_is_forgotten() {
        let mut journal: Journal = serde_json::from_str(OLDER).unwrap();
        let before = &mut journal.flown[0];
        before.tracking.late_rmse_kpa = Some([0.03, 0.04]);
        before.late_squares = vec![Some(0.0025); 3];
        before.recorded = Some(TickSpan { session: 9, start: 100, until: 500 });
        assert_eq!((before.tracking.both_kpa(), before.judged_squares()), (0.05, vec![Some(0.0025); 3]));
        let text = serde_json::to_string(&journal).unwrap();
        assert_eq!(serde_json::from_str::<Journal>(&text).unwrap(), journal);
        journal.forget_changes();
        let [before] = &journal.flown[..] else { panic!("{journal:?}") };
        assert_eq!(
            (before.tracking.judged_kpa(), before.judged_squares()),
            ([0.5, 0.3], vec![Some(0.3), None, Some(0.4)])
        );
    }
}
