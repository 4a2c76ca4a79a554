//! What a diagnosis leaves in its folder.

use std::path::Path;

use model::rig::Rig;
use proto::atomic_file;
use proto::diagnosis::{Diagnosis, Fits, Verdict};

use crate::error::DiagnoseError;
use crate::findings::Findings;
use crate::{page, summary, whereabouts};

/// Name of the experiment's file.
pub const NEXT_EXPERIMENT: &str = "next_experiment.csv";

/// The diagnosis in the form of its file.
pub(crate) fn summed_up(findings: &Findings<'_, '_>) -> Diagnosis {
    let judgement = findings.judgement;
    let mechanisms = summary::mechanisms(findings);
    let extended = if judgement.verdict == Verdict::Adequate { &findings.given } else { &findings.extended };
    Diagnosis {
        verdict: judgement.verdict,
        summary: summary::summary(findings, &mechanisms),
        location: whereabouts::locations(findings),
        mechanisms,
        fit: Fits {
            nominal: findings.given.to_fit(),
            reidentified: findings.reidentified.to_fit(),
            extended: extended.to_fit(),
        },
        rivals: judgement.groups.clone(),
        next_experiment: findings.plan.as_ref().map(|_| NEXT_EXPERIMENT.to_owned()),
        notes: findings.notes.clone(),
    }
}

/// Writes `rig.toml`, `report.html`, `next_experiment.csv` where there is one, and, when all others are there, `diagnosis.json`.
///
/// # Errors
/// The folder cannot be made, or a file not be written.
pub(crate) fn write(
    directory: &Path,
    findings: &Findings<'_, '_>,
    diagnosis: &Diagnosis,
    rig: &Rig,
) -> Result<(), DiagnoseError> {
    std::fs::create_dir_all(directory)
        .map_err(|source| DiagnoseError::Directory { directory: directory.display().to_string(), source })?;
    let put = |name: &str, text: &str| atomic_file::write(&directory.join(name), text.as_bytes());
    let json = diagnosis
        .to_json()
        .map_err(|e| DiagnoseError::Format { file: "diagnosis.json".to_owned(), problem: e.to_string() })?;
    let toml = rig.to_toml().map_err(DiagnoseError::rig(rig))?;
    put("rig.toml", &toml)?;
    if let Some(plan) = &findings.plan {
        put(NEXT_EXPERIMENT, &plan.to_csv())?;
    }
    put("report.html", &page::page(findings, diagnosis, &toml))?;
    put("diagnosis.json", &json)?;
    Ok(())
}
