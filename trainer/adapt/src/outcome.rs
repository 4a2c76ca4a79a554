//! What came of an adaptation: text for a terminal, `adapt.json`, and a page.

use std::path::Path;

use proto::atomic_file;
use proto::diagnosis::Diagnosis;
use report::{Color, KeyFigure, Panel, Plot, Report, Scatter, Table};
use serde::Serialize;

use crate::AdaptError;
use crate::journal::{BEFORE, Flown, Journal};
use crate::tracking::Tracking;

/// What came of it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Outcome {
    /// Whether the rig tracks better than before.
    pub is_better: bool,
    /// What controls now.
    pub kept: String,
    /// The diagnosis in one sentence.
    pub missing: String,
    /// What was learned: a sentence for each mechanism, with its numbers.
    pub learned: Vec<String>,
    /// Runs along the reference, in their order.
    pub flown: Vec<Flown>,
    /// Before and as it is kept.
    pub tracking: [Option<Tracking>; 2],
    /// What any controller must leave on the model that was found, noise included, in kPa; nothing where it was not asked.
    pub optimum_kpa: Option<[f64; 2]>,
    /// The daemon's line on the model.
    pub model: Option<String>,
    /// What the daemon made of the policy.
    pub policy: Option<String>,
    /// Experiments that were played.
    pub experiments: usize,
    /// Minutes of the rig that were used, from the beginning to the end; computing is not among them.
    pub rig_minutes: f64,
    /// Minutes that this machine computed.
    pub computing_minutes: f64,
    /// Highest positive and lowest negative pressure from the first tick to the last, experiments included, in kPa
    /// gauge; nothing where no recording tells.
    pub extremes_kpa: Option<[f64; 2]>,
    /// Who was in control there: `experiment`, `policy`, `fallback` or `nobody`.
    pub extremes_by: Option<[String; 2]>,
    /// Commands that the safety filter changed meanwhile; nothing where the daemon does not say.
    pub interventions: Option<u64>,
    /// What had been concealed, in a rehearsal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub concealed: Option<Vec<String>>,
    /// The command that made this.
    pub command: String,
}

impl Outcome {
    /// Gathers it from a journal.
    ///
    /// # Errors
    /// A diagnosis that cannot be read.
    pub fn of(journal: &Journal, out: &Path) -> Result<Self, AdaptError> {
        let kept = journal.kept.clone().unwrap_or_else(|| BEFORE.to_owned());
        let (before, after) = (journal.flown(BEFORE), journal.flown(&kept));
        let diagnosis = match &journal.found {
            Some(found) => {
                let path = found.join("diagnosis.json");
                let text = std::fs::read_to_string(&path).map_err(|error| AdaptError::file(&path, error))?;
                Some(Diagnosis::from_json(&text).map_err(|error| AdaptError::file(&path, error))?)
            }
            None => None,
        };
        let learned = diagnosis.iter().flat_map(|d| &d.mechanisms).map(|m| {
            let numbers: Vec<String> =
                m.parameters.iter().map(|(name, p)| format!("{name} {:.3} {}", p.value, p.unit)).collect();
            format!("{} ({})", m.summary, numbers.join(", "))
        });
        let policy = journal.verdict.as_ref().map(|verdict| match verdict.why.as_str() {
            "" => verdict.state.clone(),
            why => format!("{} ({why})", verdict.state),
        });
        Ok(Outcome {
            is_better: before.zip(after).is_some_and(|(before, after)| after.over(&before) < 1.0),
            kept,
            missing: diagnosis.as_ref().map_or_else(String::new, |d| d.summary.clone()),
            learned: learned.collect(),
            flown: journal.flown.iter().map(|flown| Flown { squares: Vec::new(), ..flown.clone() }).collect(),
            tracking: [before, after],
            optimum_kpa: journal.optimum_kpa,
            model: journal.model_line.clone(),
            policy,
            experiments: journal.experiments.len(),
            rig_minutes: journal.rig_minutes(journal.ticks),
            computing_minutes: journal.computed_s / 60.0,
            extremes_kpa: journal.worst.as_ref().map(|worst| [worst[0].kpa, worst[1].kpa]),
            extremes_by: journal.worst.as_ref().map(|worst| worst.clone().map(|worst| worst.by)),
            interventions: journal.interventions,
            concealed: None,
            command: format!("trainer adapt --resume {}", out.display()),
        })
    }

    /// Writes `adapt.json` and `report.html`.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write(&self, out: &Path) -> Result<(), AdaptError> {
        let path = out.join("adapt.json");
        let text = serde_json::to_string_pretty(self).map_err(|error| AdaptError::file(&path, error))?;
        atomic_file::write(&path, format!("{text}\n").as_bytes())?;
        Ok(atomic_file::write(&out.join("report.html"), self.page().as_bytes())?)
    }

    /// For a terminal.
    pub fn text(&self) -> String {
        let mut text = format!("missing: {}\n", if self.missing.is_empty() { "not looked for" } else { &self.missing });
        for learned in &self.learned {
            text += &format!("learned: {learned}\n");
        }
        for concealed in self.concealed.iter().flatten() {
            text += &format!("concealed: {concealed}\n");
        }
        if let Some(policy) = &self.policy {
            text += &format!("policy:  {policy}\n");
        }
        text += &format!("\n{:<24} {:>14} {:>14}\n", "RMSE after 5 s", "positive kPa", "negative kPa");
        for Flown { what, tracking, ended_after_s, .. } in &self.flown {
            let [pos, neg] = tracking.rmse_kpa;
            let ended =
                ended_after_s.map_or_else(String::new, |s| format!("   worse than what was there after {s:.0} s"));
            text += &format!("{what:<24} {pos:>14.3} {neg:>14.3}{ended}\n");
        }
        if !self.flown.is_empty() {
            // A loop that swings passes for noise; the calmest run says most of it.
            let [pos, neg] =
                [0, 1].map(|c| self.flown.iter().map(|flown| flown.tracking.noise_kpa[c]).fold(f64::MAX, f64::min));
            text += &format!("{:<24} {pos:>14.3} {neg:>14.3}\n", "noise of the readings");
        }
        if let Some([pos, neg]) = self.optimum_kpa {
            text += &format!("{:<24} {pos:>14.3} {neg:>14.3}\n", "optimum on this model");
        }
        text += &format!(
            "\nkept: {}; {:.1} min of the rig and {:.1} min of computing, {} experiments; worst pressures: {}; commands bent by the safety filter: {}\n",
            self.kept,
            self.rig_minutes,
            self.computing_minutes,
            self.experiments,
            self.extremes(),
            self.interventions.map_or_else(|| "not known".to_owned(), |n| n.to_string()),
        );
        text
    }

    /// The worst pressures, and who was in control there.
    fn extremes(&self) -> String {
        match (&self.extremes_kpa, &self.extremes_by) {
            (Some([pos, neg]), Some([by_pos, by_neg])) => {
                format!("{pos:.1} kPa (in control: {by_pos}) and {neg:.1} kPa ({by_neg})")
            }
            _ => "not known".to_owned(),
        }
    }

    /// The page.
    fn page(&self) -> String {
        let pair = |tracking: &Option<Tracking>| {
            tracking.map_or_else(|| "–".to_owned(), |t| format!("{:.3} / {:.3} kPa", t.rmse_kpa[0], t.rmse_kpa[1]))
        };
        let [before, after] = &self.tracking;
        let mut page = Report::new("Adaptation to a rig").subtitle(&format!("kept: {}", self.kept)).summary([
            KeyFigure::new("RMSE before", &pair(before)).note("positive / negative"),
            KeyFigure::new("RMSE as kept", &pair(after)).note("positive / negative"),
            KeyFigure::new("Rig time", &format!("{:.1} min", self.rig_minutes))
                .note(&format!("and {:.1} min of computing", self.computing_minutes)),
            KeyFigure::new("Worst pressures", &self.extremes()).note("experiments included"),
        ]);
        page = page.heading("What was missing").text(&self.missing).list(self.learned.clone());
        if let Some(concealed) = &self.concealed {
            page = page.heading("What had been concealed").list(concealed.clone());
        }
        let mut table = Table::new(["run", "positive kPa", "negative kPa", "noise positive", "noise negative"]);
        for Flown { what, tracking: t, .. } in &self.flown {
            let numbers = [t.rmse_kpa[0], t.rmse_kpa[1], t.noise_kpa[0], t.noise_kpa[1]];
            table.push(std::iter::once(what.clone()).chain(numbers.map(|n| format!("{n:.3}"))));
        }
        if let Some([pos, neg]) = self.optimum_kpa {
            let dash = || "–".to_owned();
            let what = "optimum on the model that was found".to_owned();
            table.push([what, format!("{pos:.3}"), format!("{neg:.3}"), dash(), dash()]);
        }
        let x: Vec<f64> = (0..self.flown.len()).map(|n| n as f64).collect();
        let y = |c: usize| self.flown.iter().map(|flown| flown.tracking.rmse_kpa[c]).collect::<Vec<f64>>();
        let plot = Plot::new("Tracking error, run by run", "run")
            .x_names(self.flown.iter().map(|flown| flown.what.clone()))
            .panel(
                Panel::new("RMSE (kPa)")
                    .include(0.0)
                    .scatter(Scatter::new("positive", &x, &y(0)).color(Color::Blue))
                    .scatter(Scatter::new("negative", &x, &y(1)).color(Color::Vermilion)),
            );
        page = page.heading("Tracking").plot(plot).table(table);
        let lines = [
            self.model.clone().map(|line| format!("model: {line}")),
            self.policy.clone().map(|line| format!("policy: {line}")),
        ];
        page.heading("What the daemon said").list(lines.into_iter().flatten()).to_html()
    }
}
