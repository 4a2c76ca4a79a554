//! A diagnosis from recordings to files.

use std::path::PathBuf;

use fit::data::quality::Quality;
use fit::data::{Records, noise};
use fit::simulate::{Fidelity, tachometer};
use model::rig::{Pump, Rig};
use proto::atomic_file;
use proto::recording::Recording;

use crate::bench::{Bench, Effort, Explanation};
use crate::candidate::{Candidate, candidates};
use crate::diagnosis::{Diagnosis, Fits, Verdict};
use crate::error::DiagnoseError;
use crate::evidence::Bar;
use crate::experiment::{Plan, plan};
use crate::figures::{Figures, figures};
use crate::glance::settled;
use crate::judge::{Judgement, judge};
use crate::locate::{Missing, reconstruct};
use crate::search::{Found, SearchSettings, search};
use crate::unknown::{UnknownTerm, fit_unknown};
use crate::{page, words};

/// What is asked for.
#[derive(Debug, Clone)]
pub struct Request {
    /// The rig as it is known.
    pub rig: Rig,
    /// What was recorded on it.
    pub recordings: Vec<Recording>,
    /// Where the results go.
    pub out_dir: PathBuf,
    /// A shorter search.
    pub quick: bool,
    /// Cores; `None` for all.
    pub threads: Option<usize>,
}

/// Name of the experiment's file.
pub const NEXT_EXPERIMENT: &str = "next_experiment.csv";

/// Everything that the files are written from.
pub(crate) struct Findings<'a, 'r> {
    pub(crate) bench: &'a Bench<'r>,
    pub(crate) candidates: &'a [Candidate],
    pub(crate) found: &'a Found,
    pub(crate) judgement: &'a Judgement,
    pub(crate) missing: &'a Missing,
    pub(crate) given: Figures,
    pub(crate) reidentified: Figures,
    pub(crate) extended: Figures,
    pub(crate) unknown: Option<&'a UnknownTerm>,
    pub(crate) plan: Option<Plan>,
    pub(crate) notes: Vec<String>,
}

impl Findings<'_, '_> {
    /// The explanation that the extended rig is made from.
    pub(crate) fn extended_by(&self) -> &Explanation {
        self.unknown.map_or(&self.found.best, |term| &term.explanation)
    }
}

/// Diagnoses; writes `diagnosis.json`, `report.html`, `rig.toml` and, if undecided, `next_experiment.csv`.
///
/// `progress` is told what is being done and the share of it that is done (0 … 1).
///
/// # Errors
/// Recordings that cannot be used, a rig that cannot be simulated, files that cannot be written.
pub fn run(request: &Request, progress: &mut dyn FnMut(&str, f64)) -> Result<Diagnosis, DiagnoseError> {
    progress("reading", 0.0);
    let rig = &request.rig;
    let records = Records::new(rig, &request.recordings)?;
    let quality = Quality::of(rig, &records, &noise(&records))?;
    if let Some(refusal) = quality.refusal() {
        return Err(fit::FitError::Unusable(refusal).into());
    }
    let mut notes: Vec<String> = request.recordings.iter().flat_map(|r| r.notes().to_vec()).collect();
    notes.extend(quality.doubts().map(|finding| finding.text.clone()));
    let given = {
        // At its own step: a coarser one's error is not the rig's.
        let as_given = Bench::new(rig, &records, &quality.usable, Fidelity::Detailed, request.threads);
        figures(&as_given, rig, Fidelity::Detailed, !request.quick)?
    };
    progress("fitting the rig's own parameters", 0.0);
    let turning = turning(request, &records, &quality.usable, &mut notes)?;
    let (rig, records) = (&turning.rig, &turning.records);
    let recorded = Bench::new(rig, records, &quality.usable, Fidelity::Detailed, request.threads);
    let of = |rig: &Rig| figures(&recorded, rig, Fidelity::Detailed, !request.quick);
    let candidates = candidates(rig);
    let nominal = recorded.fit(&candidates, &[], std::slice::from_ref(&turning.point), Effort::Polish)?;
    // Everything is searched with averaged pumps, on readings that lack the strokes; what was found ends on the recordings.
    let reduced = recorded.without_strokes(&nominal)?;
    let bench = Bench::new(rig, &reduced, &quality.usable, Fidelity::Averaged, request.threads);
    let settings = SearchSettings {
        most_terms: 4,
        glanced: if request.quick { 6 } else { 14 },
        polished: if request.quick { 2 } else { 3 },
        from_prior: true,
        bar: Bar::default(),
    };
    let mut found = search(&bench, &candidates, &nominal.fitted.point, &settings, progress)?;
    progress("reconstructing what is missing", 0.0);
    let missing = reconstruct(&bench, &found.nominal.fitted.rig, &found.nominal.trace, !request.quick)?;
    let judgement = judge(&bench, &candidates, &found, &bench.free_run(rig)?, progress)?;
    let mut unknown = if judgement.verdict == Verdict::UnknownMechanism {
        progress("shaping a term for what has no name", 0.0);
        fit_unknown(&bench, &found.nominal, &missing, if request.quick { 1 } else { 3 })?
    } else {
        None
    };
    progress("planning", 0.0);
    let plan = if judgement.verdict == Verdict::Undecided {
        plan(&bench, &judgement.rivals.iter().collect::<Vec<_>>())?
    } else {
        None
    };
    progress("running before and after", 0.0);
    found.nominal = settled(&recorded, &found.nominal)?;
    found.best = if found.best.terms.is_empty() { found.nominal.clone() } else { settled(&recorded, &found.best)? };
    if let Some(term) = &mut unknown {
        term.explanation = settled(&recorded, &term.explanation)?;
    }
    let findings = Findings {
        given,
        reidentified: of(&found.nominal.fitted.rig)?,
        extended: of(unknown.as_ref().map_or(&found.best.fitted.rig, |term| &term.explanation.fitted.rig))?,
        unknown: unknown.as_ref(),
        bench: &recorded,
        candidates: &candidates,
        found: &found,
        judgement: &judgement,
        missing: &missing,
        plan,
        notes,
    };
    let diagnosis = summed_up(&findings);
    write(request, &findings, &diagnosis)?;
    Ok(diagnosis)
}

/// The rig with its pump at the speed that its ripple tells, the recordings with cranks where they stood, and the rig's
/// own parameters as fitted.
struct Turning {
    rig: Rig,
    records: Records,
    point: Vec<f64>,
}

/// Fits the rig's own parameters, and reads the pump's speed off what is left.
fn turning(
    request: &Request,
    records: &Records,
    usable: &[f64],
    notes: &mut Vec<String>,
) -> Result<Turning, DiagnoseError> {
    let bench = Bench::new(&request.rig, records, usable, Fidelity::Detailed, request.threads);
    let origin = vec![0.0; bench.nominal.len()];
    let fitted = bench.fit(&[], &[], &[origin], Effort::Full)?.fitted;
    let mut turning = Turning { rig: request.rig.clone(), records: records.clone(), point: fitted.point };
    if let Some(read) = tachometer(&bench.fast, &fitted.rig, bench.fit_weights())?
        && let Some(Pump::Piston(pump)) = turning.rig.pumps.get_mut(&read.pump)
    {
        notes.push(format!(
            "the readings swing with the pump's ripple at {:.3} Hz: {} turns at {:.2} rev/min, not at {:.2} as in the rig \
             file; taken into account",
            read.beat_hz, read.pump, read.speed_rpm, pump.speed_rpm
        ));
        pump.speed_rpm = read.speed_rpm;
        turning.records = turning.records.with_cranks(&read.crank_rev);
    }
    Ok(turning)
}

/// The diagnosis in the form of its file.
fn summed_up(findings: &Findings<'_, '_>) -> Diagnosis {
    let judgement = findings.judgement;
    let mechanisms = words::mechanisms(findings);
    let extended = if judgement.verdict == Verdict::Adequate { &findings.given } else { &findings.extended };
    Diagnosis {
        verdict: judgement.verdict,
        summary: words::summary(findings, &mechanisms),
        location: words::locations(findings),
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

fn write(request: &Request, findings: &Findings<'_, '_>, diagnosis: &Diagnosis) -> Result<(), DiagnoseError> {
    let directory = &request.out_dir;
    std::fs::create_dir_all(directory)
        .map_err(|source| DiagnoseError::Directory { directory: directory.display().to_string(), source })?;
    let put = |name: &str, text: &str| atomic_file::write(&directory.join(name), text.as_bytes());
    let json = diagnosis
        .to_json()
        .map_err(|e| DiagnoseError::Format { file: "diagnosis.json".to_owned(), problem: e.to_string() })?;
    let rig = if diagnosis.verdict == Verdict::Adequate {
        request.rig.clone()
    } else {
        findings.extended_by().fitted.rig.clone()
    };
    let toml = rig.to_toml().map_err(DiagnoseError::rig(&rig))?;
    put("rig.toml", &toml)?;
    if let Some(plan) = &findings.plan {
        put(NEXT_EXPERIMENT, &plan.to_csv())?;
    }
    put("report.html", &page::page(findings, diagnosis, &toml))?;
    put("diagnosis.json", &json)?;
    Ok(())
}
