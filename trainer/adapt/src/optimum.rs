//! The least that any controller must leave on the model that was found, and whether there is anything to learn.
//!
//! The optimum is judged as flights on that model are: where its sensors are late, by readings less what they show of chambers
//! on the reference ([`crate::yardstick`]).

use std::path::Path;

use evaluate::table::{OPTIMUM, Table};
use serde::Deserialize;

use crate::AdaptError;
use crate::journal::Verdict;
use crate::programs::Console;
use crate::run::Adaptation;
use crate::settings::Training;
use crate::tracking::Tracking;

/// Up to this multiple of the optimum a policy is not trained (geometric mean of both channels). Chosen: on `bench`, told its own file, a policy
/// that was trained there gains a fifth over the fallback, which is at 1.1; the daemon's verdict costs more minutes of the rig than
/// all that went before.
pub(crate) const NEAR: f64 = 1.25;

/// Part of a run's summary: how long it was, and after which of its rounds it kept the policy.
#[derive(Deserialize)]
struct RunSummary {
    rounds: u64,
    kept: Kept,
}

#[derive(Deserialize)]
struct Kept {
    round: u64,
    score_kpa: f64,
}

impl Adaptation {
    /// Tells whether a controller could track better than the best so far by more than it is worth; the optimum on the model is told.
    pub(crate) fn leaves_something(&mut self, best: &Tracking, console: &mut dyn Console) -> Result<bool, AdaptError> {
        if self.journal.trained.is_some() {
            return Ok(true);
        }
        let optimum_kpa = match self.journal.optimum_kpa {
            Some(known) => known,
            None => self.work_out_optimum(console)?,
        };
        let [pos, neg] = optimum_kpa;
        let times = best.times(optimum_kpa);
        console.say(&format!(
            "what any controller must leave on this model, noise included: {pos:.3}/{neg:.3} kPa; the best so far leaves {times:.2} times as much (geometric mean of both channels)"
        ));
        if times <= NEAR && self.journal.settings.training == Training::WhereItGains {
            console.say("too little is left for a policy to learn (--train-anyway trains one)");
            return Ok(false);
        }
        Ok(true)
    }

    /// Tells whether training has made a better policy than the one that it began from: a run keeps its best by flights on rigs around the
    /// model, and that may be the first. Then there is nothing to publish, which would cost minutes of the rig.
    pub(crate) fn has_learned(&mut self, console: &mut dyn Console) -> Result<bool, AdaptError> {
        // Without a summary nothing is known of it; whether its policy is better the daemon finds out.
        let path = self.training_folder().join("summary.json");
        let Ok(text) = std::fs::read_to_string(&path) else { return Ok(true) };
        let run: RunSummary = serde_json::from_str(&text).map_err(|error| AdaptError::file(&path, error))?;
        let RunSummary { rounds, kept: Kept { round: 0, score_kpa } } = run else { return Ok(true) };
        let why = format!(
            "of {rounds} rounds of training none made it better on rigs around the model than it began ({score_kpa:.3} kPa there)"
        );
        console.say(&format!("{why}; nothing is published"));
        self.journal.verdict = Some(Verdict { state: "not published".to_owned(), why });
        self.journal.keep(&self.out)?;
        Ok(false)
    }

    fn work_out_optimum(&mut self, console: &mut dyn Console) -> Result<[f64; 2], AdaptError> {
        let text = |path: &Path| path.to_string_lossy().into_owned();
        let rig = text(&self.found_rig());
        let out = self.optimum_folder();
        let reference = text(&self.recorded_reference());
        let mut arguments = ["evaluate", "comparison", "--rig"].map(str::to_owned).to_vec();
        arguments.extend([rig.clone(), "--model".to_owned(), rig, "--reference".to_owned(), reference]);
        arguments.extend(["--seconds".to_owned(), format!("{:.0}", self.fly_s()?)]);
        arguments.extend(["--drawn", "0", "--seeds", "1", "--out"].map(str::to_owned));
        arguments.push(text(&out));
        self.computed(|this, console| this.daemon.programs.trainer(&arguments).done(console), console)?;
        let path = out.join("table.json");
        let table = std::fs::read_to_string(&path).map_err(|error| AdaptError::file(&path, error))?;
        let table: Table = serde_json::from_str(&table).map_err(|error| AdaptError::file(&path, error))?;
        let limit = table.rows.iter().find(|row| row.entrant == OPTIMUM).and_then(|row| row.cells.first());
        let optimum_kpa = limit.ok_or_else(|| AdaptError::file(&path, "has no clairvoyant optimum"))?.rmse_kpa;
        self.journal.optimum_kpa = Some(optimum_kpa);
        self.journal.keep(&self.out)?;
        Ok(optimum_kpa)
    }
}
