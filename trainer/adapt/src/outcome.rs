//! Outcome of an adaptation: text for a terminal, `adapt.json`, and a page.

use std::path::Path;

use proto::atomic_file;
use proto::diagnosis::FoundParameter;
use report::{Color, KeyFigure, Panel, Plot, Report, Table};
use serde::Serialize;

use crate::AdaptError;
use crate::comparison::{Comparison, headline};
use crate::journal::{BEFORE, Flown, Journal, diagnosis_in};
use crate::tracking::Tracking;
use crate::yardstick::JUDGED_BEHIND_LATE_SENSORS;

/// Outcome of an adaptation.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Outcome {
    /// Verdict: the rig tracks better than before, by more than flights of one controller differ by.
    pub is_better: bool,
    /// Verdict in three answers; nothing where there is nothing to compare.
    pub verdict: Option<Comparison>,
    /// Verdict in a sentence, with its numbers.
    pub headline: String,
    /// Name of the run whose controller controls now.
    pub kept: String,
    /// The diagnosis in one sentence.
    pub missing: String,
    /// Findings: a sentence for each mechanism, with its numbers.
    pub learned: Vec<String>,
    /// Runs along the reference, in their order.
    pub flown: Vec<Flown>,
    /// Before and as it is kept.
    pub tracking: [Option<Tracking>; 2],
    /// Sentence on which of a run's two figures decides, and why; nothing where readings less reference are all there is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub judged_by: Option<String>,
    /// Least that any controller must leave on the model that was found, noise included, in kPa; nothing where it was not asked.
    pub optimum_kpa: Option<[f64; 2]>,
    /// The daemon's line on the model.
    pub model: Option<String>,
    /// The daemon's verdict on the policy.
    pub policy: Option<String>,
    /// Experiments that were played.
    pub experiments: usize,
    /// Minutes of the rig that were used, from the beginning to the end; computing is not among them. Nothing where the daemon has
    /// begun another session on the way: nobody counted then.
    pub rig_minutes: Option<f64>,
    /// Minutes that this machine computed.
    pub computing_minutes: f64,
    /// Highest positive and lowest negative pressure from the first tick to the last, experiments included, in kPa
    /// gauge; nothing where no recording tells.
    pub extremes_kpa: Option<[f64; 2]>,
    /// Name of who was in control there: `experiment`, `policy`, `fallback` or `nobody`.
    pub extremes_by: Option<[String; 2]>,
    /// Commands that the safety filter changed meanwhile; nothing where the daemon does not say.
    pub interventions: Option<u64>,
    /// Mechanisms that had been concealed, in a rehearsal.
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
        let compared = before.zip(after);
        let verdict = compared.map(|(before, after)| Comparison::of(&after, &before));
        let diagnosis = journal.found.as_deref().map(diagnosis_in).transpose()?;
        let learned = diagnosis.iter().flat_map(|d| &d.mechanisms).map(|m| {
            let numbers: Vec<String> = m.parameters.iter().map(|(name, number)| in_words(name, number)).collect();
            format!("{} ({})", m.summary, numbers.join(", "))
        });
        let policy = journal.verdict.as_ref().map(|verdict| match verdict.why.as_str() {
            "" => verdict.state.clone(),
            why => format!("{} ({why})", verdict.state),
        });
        Ok(Outcome {
            is_better: verdict == Some(Comparison::Better),
            verdict,
            headline: compared.map_or_else(
                || "no flight was made before, or none is kept: nothing can be compared".to_owned(),
                |(before, after)| headline(&after, &before, journal.optimum_kpa),
            ),
            kept,
            missing: diagnosis.as_ref().map_or_else(String::new, |d| d.summary.clone()),
            learned: learned.collect(),
            flown: journal.flown.iter().map(in_figures).collect(),
            tracking: [before, after],
            judged_by: before
                .is_some_and(|before| before.late_rmse_kpa.is_some())
                .then(|| JUDGED_BEHIND_LATE_SENSORS.to_owned()),
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
        text += &format!("\n{:<24} {:>14} {:>14}", "RMSE after 5 s", "positive kPa", "negative kPa");
        text += if self.judged_by.is_some() { "  late positive  late negative\n" } else { "\n" };
        for Flown { what, tracking, ended_after_s, .. } in &self.flown {
            let [pos, neg] = tracking.rmse_kpa;
            let late = tracking.late_rmse_kpa.map(|[pos, neg]| format!(" {pos:>14.3} {neg:>14.3}")).unwrap_or_default();
            let ended =
                ended_after_s.map_or_else(String::new, |s| format!("   worse than what was there after {s:.0} s"));
            text += &format!("{what:<24} {pos:>14.3} {neg:>14.3}{late}{ended}\n");
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
        if let Some(judged_by) = &self.judged_by {
            text += &format!("the late figures decide: {judged_by}\n");
        }
        text += &format!(
            "\n{}\nkept: {}; {} of the rig and {:.1} min of computing, {}; worst pressures: {}; commands bent by the safety filter: {}\n",
            self.headline,
            self.kept,
            self.rig_time(),
            self.computing_minutes,
            match self.experiments {
                1 => "1 experiment".to_owned(),
                number => format!("{number} experiments"),
            },
            self.extremes(),
            self.interventions.map_or_else(|| "not known".to_owned(), |n| n.to_string()),
        );
        text
    }

    /// Time of the rig in words.
    fn rig_time(&self) -> String {
        self.rig_minutes.map_or_else(|| "an unknown time".to_owned(), |minutes| format!("{minutes:.1} min"))
    }

    /// The worst pressures, and who was in control there, where they are known.
    fn known_extremes(&self) -> Option<([f64; 2], &[String; 2])> {
        self.extremes_kpa.zip(self.extremes_by.as_ref())
    }

    /// Clause on the worst pressures.
    fn extremes(&self) -> String {
        self.known_extremes().map_or_else(
            || "not known".to_owned(),
            |([pos, neg], [by_pos, by_neg])| format!("{pos:.1} kPa (in control: {by_pos}) and {neg:.1} kPa ({by_neg})"),
        )
    }

    /// Figure of the page on the worst pressures.
    fn worst(&self) -> KeyFigure {
        let (kpa, by) = self.known_extremes().map_or_else(
            || ("not known".to_owned(), String::new()),
            |([pos, neg], [by_pos, by_neg])| {
                (format!("{pos:.1} / {neg:.1} kPa"), format!("; in control there: {by_pos} / {by_neg}"))
            },
        );
        KeyFigure::new("Worst pressures", &kpa).note(&format!("experiments included{by}"))
    }

    /// The page.
    fn page(&self) -> String {
        let pair = |tracking: &Option<Tracking>| {
            let judged = tracking.as_ref().map(Tracking::judged_kpa);
            judged.map_or_else(|| "–".to_owned(), |[pos, neg]| format!("{pos:.3} / {neg:.3} kPa"))
        };
        let note = if self.judged_by.is_some() { "positive / negative, late" } else { "positive / negative" };
        let [before, after] = &self.tracking;
        let mut page =
            Report::new("Adaptation to a rig").subtitle(&format!("{}; kept: {}", self.headline, self.kept)).summary([
                KeyFigure::new("RMSE before", &pair(before)).note(note),
                KeyFigure::new("RMSE as kept", &pair(after)).note(note),
                KeyFigure::new("Rig time", &self.rig_time())
                    .note(&format!("and {:.1} min of computing", self.computing_minutes)),
                self.worst(),
            ]);
        page = page.heading("What was missing").text(&self.missing).list(self.learned.clone());
        if let Some(concealed) = &self.concealed {
            page = page.heading("What had been concealed").list(concealed.clone());
        }
        let columns = ["run", "positive kPa", "negative kPa", "noise positive", "noise negative"];
        let late_columns = self.judged_by.iter().flat_map(|_| ["late positive", "late negative"]);
        let mut table = Table::new(columns.into_iter().chain(late_columns.clone()));
        for Flown { what, tracking: t, .. } in &self.flown {
            let numbers = [t.rmse_kpa[0], t.rmse_kpa[1], t.noise_kpa[0], t.noise_kpa[1]];
            let late = t.late_rmse_kpa.into_iter().flatten();
            table.push(std::iter::once(what.clone()).chain(numbers.into_iter().chain(late).map(|n| format!("{n:.3}"))));
        }
        if let Some([pos, neg]) = self.optimum_kpa {
            let dash = || "–".to_owned();
            let what = "optimum on the model that was found".to_owned();
            let row = [what, format!("{pos:.3}"), format!("{neg:.3}"), dash(), dash()];
            table.push(row.into_iter().chain(late_columns.map(|_| dash())));
        }
        let y = |c: usize| self.flown.iter().map(|flown| flown.tracking.judged_kpa()[c]).collect::<Vec<f64>>();
        let plot = Plot::new("Tracking error, run by run", "run")
            .x_names(self.flown.iter().map(|flown| flown.what.clone()))
            .panel(
                Panel::new("RMSE (kPa)")
                    .include(0.0)
                    .at_names(&[("positive", &y(0), Color::Blue), ("negative", &y(1), Color::Vermilion)]),
            );
        page = page.heading("Tracking").plot(plot).table(table);
        if let Some(judged_by) = &self.judged_by {
            page = page.text(&format!("The late figures decide, here and in the plot: {judged_by}."));
        }
        let lines = [
            self.model.clone().map(|line| format!("model: {line}")),
            self.policy.clone().map(|line| format!("policy: {line}")),
        ];
        page.heading("What the daemon said").list(lines.into_iter().flatten()).to_html()
    }
}

/// A number of a mechanism, under its key in the diagnosis: `lag_ms 23.400 ms`.
fn in_words(key: &str, number: &FoundParameter) -> String {
    if number.undetermined {
        return format!("{key} not told");
    }
    format!("{key} {:.3} {}", number.value, number.unit)
}

/// A run's figures, without what later runs are held against.
fn in_figures(flown: &Flown) -> Flown {
    Flown { squares: Vec::new(), late_squares: Vec::new(), recorded: None, ..flown.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::journal::TickSpan;
    use crate::settings::AdaptSettings;

    /// Outcome of two runs with these figures by late sensors: the second trails the reference by more than the first.
    fn outcome(late_kpa: [Option<[f64; 2]>; 2]) -> Outcome {
        let flown = |what: &str, rmse_kpa, late_rmse_kpa| Flown {
            what: what.to_owned(),
            tracking: Tracking { rmse_kpa, late_rmse_kpa, noise_kpa: [0.06, 0.006], ticks: 2500 },
            rig_minutes: Some(1.0),
            recorded: Some(TickSpan { session: 5, start: 100, until: 3100 }),
            ended_after_s: None,
            squares: vec![Some(0.1); 55],
            late_squares: vec![Some(0.1); 55],
        };
        let mut journal = Journal::new(AdaptSettings::new("c.toml".into()));
        let [before, after] = late_kpa;
        journal.flown = vec![flown(BEFORE, [0.25, 0.125], before), flown("with the model", [0.5, 0.375], after)];
        journal.kept = Some("with the model".to_owned());
        journal.optimum_kpa = Some([0.06, 0.01]);
        Outcome::of(&journal, Path::new("out")).unwrap()
    }

    /// A daemon that was started anew on the way has counted from nothing: the ticks before it are not told as none.
    #[test]
    fn time_of_the_rig_is_not_known_behind_another_session() {
        let late = [None, None];
        assert_eq!((outcome(late).rig_minutes, outcome(late).rig_time()), (None, "an unknown time".to_owned()));
        let known = Outcome { rig_minutes: Some(5.44), ..outcome(late) };
        assert!(known.text().contains("; 5.4 min of the rig and 0.0 min of computing"), "{}", known.text());
        assert!(outcome(late).text().contains("; an unknown time of the rig"), "{}", outcome(late).text());
    }

    #[test]
    fn experiments_are_counted_in_words_that_fit() {
        for (experiments, words) in [(0, ", 0 experiments;"), (1, ", 1 experiment;"), (2, ", 2 experiments;")] {
            let text = Outcome { experiments, ..outcome([None, None]) }.text();
            assert!(text.contains(words), "{text}");
        }
    }

    /// A number that the recordings do not tell is not among what was learned.
    #[test]
    fn what_is_not_told_is_not_learned() {
        let number = |undetermined: bool| FoundParameter {
            value: 56.7,
            unit: "ms".to_owned(),
            low: 0.5,
            high: 900.0,
            at_end_of_range: None,
            undetermined,
        };
        assert_eq!(in_words("lag_ms", &number(false)), "lag_ms 56.700 ms");
        assert_eq!(in_words("lag_ms", &number(true)), "lag_ms not told");
    }

    #[test]
    fn both_figures_of_late_sensors_are_told_and_which_of_them_decides() {
        let late = outcome([Some([0.625, 0.4375]), Some([0.0625, 0.03125])]);
        assert!(late.is_better, "by readings less reference it would be worse");
        let (text, page) = (late.text(), late.page());
        let row = text.lines().find(|line| line.starts_with("with the model")).unwrap();
        let numbers: Vec<&str> = row.split_whitespace().skip(3).collect();
        assert_eq!(numbers, ["0.500", "0.375", "0.062", "0.031"], "{text}");
        assert!(text.contains(&format!("the late figures decide: {JUDGED_BEHIND_LATE_SENSORS}\n")), "{text}");
        assert!(
            page.contains(JUDGED_BEHIND_LATE_SENSORS) && page.contains("0.500") && page.contains("0.438"),
            "{page}"
        );
        let json = serde_json::to_value(&late).unwrap();
        assert_eq!(json["judged_by"], JUDGED_BEHIND_LATE_SENSORS);
        assert_eq!(json["flown"][1]["tracking"]["late_rmse_kpa"], serde_json::json!([0.0625, 0.03125]));
        assert_eq!(json["tracking"][1]["rmse_kpa"], serde_json::json!([0.5, 0.375]));
    }

    /// Half a percent is no gain, though the figure is below that of before.
    #[test]
    fn the_verdict_has_the_differences_of_one_controllers_flights_for_its_yardstick() {
        let outcome = |after: f64| outcome([Some([0.08, 0.02]), Some([after, 0.25 * after])]);
        let alike = outcome(0.0796);
        assert_eq!((alike.is_better, alike.verdict), (false, Some(Comparison::NoDifferent)));
        for told in [alike.text(), alike.page()] {
            assert!(told.contains("tracks as well as before; nothing was gained: 1.62 times the optimum"), "{told}");
        }
        let json = serde_json::to_value(&alike).unwrap();
        assert_eq!((&json["is_better"], &json["verdict"]), (&false.into(), &"no_different".into()));
        let better = outcome(0.06);
        assert_eq!((better.is_better, better.verdict), (true, Some(Comparison::Better)));
        assert!(better.text().contains("\ntracks better than before: 25 % less error"), "{}", better.text());
        assert_eq!(outcome(0.09).verdict, Some(Comparison::Worse));
    }

    #[test]
    fn where_no_sensor_is_late_nothing_is_said_of_one() {
        let as_read = outcome([None, None]);
        assert!(!as_read.is_better && as_read.judged_by.is_none());
        let json = serde_json::to_string(&as_read).unwrap();
        for told in [as_read.text(), as_read.page(), json] {
            for word in ["late positive", "late_rmse", "late_squares", "judged_by", "recorded\""] {
                assert!(!told.contains(word), "{word}: {told}");
            }
        }
    }
}
