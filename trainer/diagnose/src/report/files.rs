//! Files that a diagnosis leaves in its folder.

use std::path::Path;

use model::rig::Rig;
use proto::diagnosis::{ChannelFit, Diagnosis, Fits, RigKind, Verdict, WrittenRig};
use proto::output;
use proto::rig_file::{FitEnding, rename_fitted};

use crate::error::DiagnoseError;
use crate::judge::MOVED;
use crate::judge::extrapolated::Extrapolated;
use crate::report::figures::Figures;
use crate::report::findings::Findings;
use crate::report::localization::Place;
use crate::report::next_step::{Parameters, Situation, next_step};
use crate::report::{localization, page, summary};

/// Name of the experiment's file.
pub const NEXT_EXPERIMENT: &str = "next_experiment.csv";
/// Room in bytes that the files of an answer need: pages of an hour's recordings took 3 MB.
const ROOM: u64 = 8 << 20;

/// Multiples of the noise from which on what was found is a part of the truth (chosen; docs/diagnose.md says so,
/// where three of them are what `adapt` plays another experiment for).
const IN_PART: f64 = 10.0;

/// An answer with its files, worked out and not yet written.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// The answer.
    pub diagnosis: Diagnosis,
    json: String,
    rig_toml: String,
    page: String,
    experiment_csv: Option<String>,
}

impl Outcome {
    /// The outcome of some findings.
    ///
    /// # Errors
    /// A file cannot be put into its format.
    pub(crate) fn of(findings: &Findings<'_, '_>) -> Result<Self, DiagnoseError> {
        let places = localization::places(findings);
        let diagnosis = summed_up(findings, &places);
        let json = diagnosis
            .to_json()
            .map_err(|e| DiagnoseError::Format { file: "diagnosis.json".to_owned(), problem: e.to_string() })?;
        let rig_toml = findings.rig.to_toml().map_err(DiagnoseError::rig(&findings.rig))?;
        let page = page::page(findings, &diagnosis, &places, &rig_toml);
        let experiment_csv = findings.plan.as_ref().map(crate::experiment::Plan::to_csv);
        Ok(Outcome { diagnosis, json, rig_toml, page, experiment_csv })
    }

    /// Writes `rig.toml`, `report.html`, `next_experiment.csv` where there is one, and, when all others are there, `diagnosis.json`.
    /// Files of an older answer are replaced or removed, all or none.
    ///
    /// # Errors
    /// The folder cannot be made, or a file not be written.
    pub fn write(&self, directory: &Path) -> Result<(), DiagnoseError> {
        let files = [
            ("rig.toml", Some(self.rig_toml.as_bytes())),
            (NEXT_EXPERIMENT, self.experiment_csv.as_deref().map(str::as_bytes)),
            ("report.html", Some(self.page.as_bytes())),
            ("diagnosis.json", Some(self.json.as_bytes())),
        ];
        Ok(output::replace(directory, &files)?)
    }
}

/// Refuses a folder that no answer can be written to, before the work.
///
/// # Errors
/// It is no folder, cannot be written, or lacks room.
pub fn check_out_dir(directory: &Path) -> Result<(), DiagnoseError> {
    Ok(output::check_folder(directory, ROOM)?)
}

/// The diagnosis in the form of its file.
fn summed_up(findings: &Findings<'_, '_>, places: &[Place]) -> Diagnosis {
    let judgement = findings.judgement;
    let mechanisms = summary::mechanisms(findings);
    let rivals = shown_groups(&findings.request.rig, &judgement.groups);
    let extrapolated: Vec<String> = findings.extrapolated.iter().map(Extrapolated::in_words).collect();
    let situation = Situation {
        request: findings.request,
        verdict: judgement.verdict,
        kind: findings.kind,
        planned: findings.plan.is_some(),
        groups: &rivals,
        in_part: findings.in_part
            || !findings.doubtful.is_empty()
            || findings.unexplained.iter().any(|left| left.most_times_noise() > IN_PART),
        other_rig: findings.other_rig.as_ref(),
        extrapolated: &extrapolated,
        parameters: if findings.better_fitted().is_empty() { Parameters::AsGood } else { Parameters::ALittleOff },
    };
    let next = next_step(&situation);
    Diagnosis {
        verdict: judgement.verdict,
        summary: summary::summary(findings, &mechanisms),
        location: places.iter().map(|place| place.location.clone()).collect(),
        unnamed_terms: unnamed_terms(findings, &mechanisms),
        hypotheses: hypotheses(findings),
        mechanisms,
        fit: Fits {
            nominal: findings.given.to_fit(),
            reidentified: findings.reidentified.to_fit(),
            extended: findings.extended.to_fit(),
        },
        fit_by_channel: fit_by_channel(findings),
        rivals,
        next_experiment: findings.plan.as_ref().map(|_| NEXT_EXPERIMENT.to_owned()),
        notes: findings.notes.clone(),
        unexplained: findings.unexplained.clone(),
        doubtful_parameters: findings.doubtful.clone(),
        changes: findings.changes.clone(),
        rig: WrittenRig { name: findings.rig.name.clone(), kind: findings.kind },
        next_step: next,
    }
}

/// Groups of names that recordings do not tell apart. Moved parameters are of both sides where a rig has the paper's two, and of no side
/// elsewhere.
fn shown_groups(rig: &Rig, groups: &[Vec<String>]) -> Vec<Vec<String>> {
    let two_sides = ["positive", "negative"].iter().all(|side| rig.volumes.contains_key(*side));
    let shown = |name: &String| match name.split_once(':') {
        Some((id, _)) if name == MOVED && !two_sides => id.to_owned(),
        _ => name.clone(),
    };
    groups.iter().map(|group| group.iter().map(shown).collect()).collect()
}

/// Errors of the three rigs channel by channel.
fn fit_by_channel(findings: &Findings<'_, '_>) -> Vec<ChannelFit> {
    let of = |(index, unexplained): (usize, &proto::diagnosis::Unexplained)| {
        let rmse_kpa = |figures: &Figures| figures.free.get(index).map_or(f64::NAN, |error| error.rmse_kpa);
        ChannelFit {
            channel: unexplained.channel.clone(),
            nominal_rmse_kpa: rmse_kpa(&findings.given),
            reidentified_rmse_kpa: rmse_kpa(&findings.reidentified),
            extended_rmse_kpa: rmse_kpa(&findings.extended),
        }
    };
    findings.unexplained.iter().enumerate().map(of).collect()
}

/// Mechanisms of the written rig that neither the given one has nor the answer names, as the rig file states them.
fn unnamed_terms(findings: &Findings<'_, '_>, named: &[proto::diagnosis::FoundMechanism]) -> Vec<serde_json::Value> {
    let is_named = |m: &model::rig::MechanismInstance| {
        named.iter().any(|n| n.id == m.mechanism.id() && n.component.split(',').any(|c| c == m.component))
    };
    let given = &findings.request.rig.mechanisms;
    let new = findings.rig.mechanisms.iter().filter(|m| !given.contains(m) && !is_named(m));
    new.filter_map(|m| serde_json::to_value(m).ok()).collect()
}

/// Mechanisms that each of several hypotheses adds to the given rig.
fn hypotheses(findings: &Findings<'_, '_>) -> Vec<Vec<serde_json::Value>> {
    let given = &findings.request.rig.mechanisms;
    let of = |rival: &crate::bench::Explanation| {
        let new = rival.fitted.rig.mechanisms.iter().filter(|m| !given.contains(m));
        new.filter_map(|m| serde_json::to_value(m).ok()).collect()
    };
    let rivals = &findings.judgement.rivals;
    let undecided = findings.judgement.verdict == Verdict::Undecided && rivals.len() > 1;
    if undecided { rivals.iter().map(of).collect() } else { Vec::new() }
}

/// The rig under a name of its own, which says how it differs from the one that was given, and from what it was made.
pub(crate) fn under_its_own_name(mut rig: Rig, kind: RigKind, sources: &[String]) -> Rig {
    let (ending, what) = match kind {
        RigKind::AsGiven => return rig,
        RigKind::Fitted => (FitEnding::Fitted, "Parameters fitted"),
        RigKind::Extended => (FitEnding::Extended, "Extended by `trainer diagnose`"),
    };
    rename_fitted(&mut rig, ending, &format!("{what} from {}.", sources.join(", ")));
    rig
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moved_parameters_are_of_both_sides_only_where_there_are_two() {
        let groups = [vec![MOVED.to_owned(), "chamber_leak:cell".to_owned()]];
        let mut rig = Rig::builtin("dual_pressure").unwrap();
        assert_eq!(shown_groups(&rig, &groups)[0][0], "parameters_moved:both");
        rig.volumes.shift_remove("negative");
        assert_eq!(shown_groups(&rig, &groups)[0], ["parameters_moved", "chamber_leak:cell"]);
    }

    #[test]
    fn a_rig_that_came_out_of_a_fit_has_a_name_of_its_own_and_one_ending() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        let fitted = under_its_own_name(rig.clone(), RigKind::Fitted, &["a.csv".to_owned()]);
        assert_eq!(fitted.name, "dual_pressure_fitted");
        let extended = under_its_own_name(fitted, RigKind::Extended, &["b.csv".to_owned()]);
        assert_eq!(extended.name, "dual_pressure_extended");
        assert!(extended.description.ends_with("from b.csv."), "{}", extended.description);
        extended.check().unwrap();
        assert_eq!(under_its_own_name(rig.clone(), RigKind::AsGiven, &[]), rig);
    }
}
