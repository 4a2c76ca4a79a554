//! A diagnosis from recordings to files.

use std::path::PathBuf;

use fit::data::quality::Quality;
use fit::data::{Records, noise};
use model::rig::Rig;
use proto::atomic_file;
use proto::diagnosis::{Diagnosis, Fits, Verdict};
use proto::recording::Recording;

use crate::answer::{Answer, Asked};
use crate::bench::{Bench, Explanation};
use crate::candidate::{Candidate, candidates};
use crate::closed;
use crate::error::DiagnoseError;
use crate::event::{self, Event};
use crate::evidence::{Bar, evidence, root_of_drop};
use crate::experiment::{Plan, can_be_shut_in, plan};
use crate::figures::{Figures, figures};
use crate::glance::settled;
use crate::heard::Heard;
use crate::hidden;
use crate::judge::{Judgement, MOVED, UNKNOWN_KPA, judge_without};
use crate::locate::Missing;
use crate::pieces::{pieces, taken};
use crate::search::{Found, SearchSettings, position_of};
use crate::switched;
use crate::turning::answered;
use crate::unknown::{UnknownTerm, fit_unknown, formula_for_reading};
use crate::unnamed::variance_by_the_unnamed;
use crate::{page, summary, whereabouts};

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
    /// What was read off the pump's ripple and has a name.
    pub(crate) heard: Option<&'a Heard>,
    /// What happened in a span that everything else leaves out.
    pub(crate) event: Option<Event>,
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
    let mut is_experiment = false;
    // What was checked whole is run in pieces where a meter's error would add up.
    let (records, usable) = match closed::accumulates(rig) {
        Some(source) => {
            notes.push(format!(
                "{source} fills a closed volume, in which an error of its meter adds up: free runs start anew every 4 s"
            ));
            let (pieces, places) = pieces(&records);
            let mut usable = taken(&quality.usable, &places);
            closed::without_starts(&pieces, &mut usable);
            (pieces, usable)
        }
        None => match switched::pieces(rig, &records) {
            Some((pieces, places)) => {
                is_experiment = true;
                notes.push(
                    "the pump was switched: free runs start anew 0.6 s after each change, since no motor stops or starts at once"
                        .to_owned(),
                );
                let usable = taken(&quality.usable, &places);
                (pieces, usable)
            }
            None => (records, quality.usable),
        },
    };
    let mut asked = Asked {
        given: rig,
        candidates: candidates(rig),
        settings: SearchSettings {
            most_terms: 4,
            glanced: if request.quick { 6 } else { 14 },
            polished: if request.quick { 3 } else { 4 },
            from_prior: true,
            bar: if is_experiment { Bar::of_experiments() } else { Bar::default() },
        },
        quick: request.quick,
        threads: request.threads,
    };
    progress("fitting the rig's own parameters", 0.0);
    let (turning, mut answer) = answered(&mut asked, records, &usable, progress)?;
    notes.extend(turning.note());
    let (rig, records) = (&turning.rig, &turning.records);
    let whole = turning.bench(&usable, request.threads);
    // What known physics leaves unexplained may be something that happened; then the rest is asked by itself.
    let unexplained = answer.judgement.excess_kpa[2].iter().any(|kpa| *kpa > UNKNOWN_KPA);
    let unnamed = answer.judgement.verdict == Verdict::UnknownMechanism;
    let (mut formula, mut event) = (None, None);
    if unnamed {
        let searched = Bench::new(rig, &answer.reduced, &usable, whole.fast.fidelity(), request.threads);
        formula = formula_for_reading(&searched, &answer.found.nominal);
        if unexplained && !formula.as_ref().is_some_and(|formula| formula.suffices) {
            event = event::find(&searched, &answer.found.best.trace);
        }
    }
    let (rest, rest_bench);
    let bench = match &event {
        Some(event) => {
            progress("looking at the rest", 0.0);
            let (records, places) = event::without(records, event);
            let mut usable = taken(&usable, &places);
            if closed::accumulates(rig).is_some() {
                closed::without_starts(&records, &mut usable);
            }
            rest = records;
            rest_bench = Bench::new(rig, &rest, &usable, whole.simulator.fidelity(), request.threads);
            answer = Answer::of(&rest_bench, &asked, &turning.point, progress)?;
            &rest_bench
        }
        None => &whole,
    };
    let of = |rig: &Rig| figures(bench, rig, bench.close.fidelity(), !request.quick);
    let Answer { given, reduced, mut found, mut missing, mut judgement, .. } = answer;
    let searched = Bench::new(rig, &reduced, bench.counted(), bench.fast.fidelity(), request.threads);
    progress("running before and after", 0.0);
    let found_for = evidence(&searched, &found.best, &found.nominal);
    let removed_kpa = found_for.removed_kpa;
    let nominal = settled(bench, &found.nominal)?;
    let fitted = of(&nominal.fitted.rig)?;
    let (mut best, mut extended) = if found.best.terms.is_empty() {
        (nominal.clone(), fitted.clone())
    } else {
        let best = settled(bench, &found.best)?;
        let extended = of(&best.fitted.rig)?;
        (best, extended)
    };
    let sigma_kpa = bench.sigma_kpa();
    let named = judgement.verdict == Verdict::MissingPhysics;
    let reach_kpa = if named { switched::reach_kpa(&searched, &found.best)? } else { 0.0 };
    if named && !extended.holds_against(&fitted, &sigma_kpa) {
        notes.push(format!(
            "{} fits what was fitted, but errs more than nothing on the rows kept back ({:.2} kPa instead of {:.2}, or \
             one pressure for the other): something like it, not it",
            names_of(&asked.candidates, &found.best.terms),
            extended.total_rmse_kpa(),
            fitted.total_rmse_kpa()
        ));
        judgement = judgement.of_no_name();
    } else if named && let Some(note) = too_fast(&searched, &asked.candidates, &found.best) {
        notes.push(note);
        judgement = judgement.of_no_name();
    } else if named
        && (reach_kpa < switched::REACH_KPA || removed_kpa < UNKNOWN_KPA && !found_for.shows_somewhere())
        && removed(&fitted, &extended) < KEPT_BACK_KPA
    {
        // Far from where the rig works (a shut-in, a pump at rest) every model is off a little.
        notes.push(format!(
            "{} would fit what was fitted better by {removed_kpa:.2} kPa and changes next to nothing on the rows kept back: \
             too little to be named",
            names_of(&asked.candidates, &found.best.terms)
        ));
        judgement = judge_without(&searched, &asked.candidates, &found, &searched.free_run(asked.given)?)?;
    }
    if named && judgement.verdict != Verdict::MissingPhysics {
        best = nominal.clone();
        extended = fitted.clone();
    }
    if judgement.verdict == Verdict::MissingPhysics {
        let contested = |term: &&usize| judgement.contested.iter().all(|contest| contest.term != **term);
        let beside: Vec<usize> = best.terms.iter().filter(contested).copied().collect();
        if !beside.is_empty() {
            notes.push(format!(
                "{} is in the rig file as well: it shows while the pump stands, and moves no pressure by {} kPa elsewhere",
                names_of(&asked.candidates, &beside),
                switched::REACH_KPA
            ));
        }
    }
    (found.nominal, found.best) = (nominal, best);
    turning.judged(&mut judgement);
    if found.best.jumps && judgement.verdict == Verdict::MissingPhysics {
        notes.push(
            "where a valve sticks, one jump that comes late throws the free run off until the next: what is left was judged by the \
             middle one of all stretches of 2 s"
                .to_owned(),
        );
    }
    let mut unknown = if judgement.verdict == Verdict::UnknownMechanism {
        progress("shaping a term for what has no name", 0.0);
        if event.is_some() {
            // That one was fitted to what happened as well.
            formula = formula_for_reading(&searched, &found.nominal);
        }
        fit_unknown(&searched, &found.nominal, &missing, if request.quick { 2 } else { 4 }, formula)?
    } else {
        None
    };
    if let Some(term) = &mut unknown {
        term.explanation = settled(bench, &term.explanation)?;
        let with_it = of(&term.explanation.fitted.rig)?;
        if with_it.holds_against(&fitted, &sigma_kpa) {
            extended = with_it;
        } else {
            notes.push(format!(
                "{} was tried and does not hold on the rows kept back ({:.2} kPa instead of {:.2}): it is not in the rig file",
                term.depends_on,
                with_it.total_rmse_kpa(),
                fitted.total_rmse_kpa()
            ));
            unknown = None;
        }
    }
    if let Some(channel) = unknown.as_ref().and_then(|term| term.reading) {
        missing.settle_on_reading(channel);
    }
    if matches!(judgement.verdict, Verdict::Adequate | Verdict::ParametersMoved | Verdict::MissingPhysics)
        && can_be_shut_in(rig, bench.records.inputs())
    {
        let base = if judgement.verdict == Verdict::MissingPhysics { &found.best } else { &found.nominal };
        notes.extend(hidden::in_words(&searched, &asked.candidates, base));
    }
    if let Some(group) = judgement.groups.iter_mut().find(|group| group.iter().any(|name| name == MOVED))
        && can_be_shut_in(rig, bench.records.inputs())
    {
        // The experiment ends with a shut-in in any case, and tells.
        let hide = hidden::leaks_behind(&searched, &asked.candidates, &found.nominal);
        group.extend(hide.into_iter().filter(|name| !group.contains(name)).collect::<Vec<_>>());
    }
    progress("planning", 0.0);
    let plan = if judgement.verdict == Verdict::Undecided {
        plan(bench, &judgement.rivals.iter().collect::<Vec<_>>())?
    } else {
        None
    };
    if judgement.verdict == Verdict::MissingPhysics {
        let by_the_unnamed = variance_by_the_unnamed(&searched, &asked.candidates, &found.best);
        found.best.fitted.widen(&by_the_unnamed);
    }
    if let Some(event) = &mut event {
        event.change = event::what_changed(&whole, &found.best.fitted.rig, event)?;
    }
    let findings = Findings {
        given,
        reidentified: turning.reidentified(bench, fitted, !request.quick)?,
        extended,
        unknown: unknown.as_ref(),
        bench,
        candidates: &asked.candidates,
        found: &found,
        judgement: &judgement,
        missing: &missing,
        plan,
        heard: turning.heard.as_ref(),
        event,
        notes,
    };
    let diagnosis = summed_up(&findings);
    let rig = if diagnosis.verdict == Verdict::Adequate {
        request.rig.clone()
    } else {
        turning.as_begun(&findings.extended_by().fitted.rig)
    };
    write(request, &findings, &diagnosis, &rig)?;
    Ok(diagnosis)
}

/// What must be set right on the rows kept back, in kPa, where little is set right elsewhere. A minute of rows tells the
/// root of a drop in mean squared error to a hundredth of a kPa or so.
const KEPT_BACK_KPA: f64 = 0.02;

/// Root of the drop in mean squared error, in kPa; negative if it rose.
fn removed(without: &Figures, with: &Figures) -> f64 {
    root_of_drop(without.total_rmse_kpa().powi(2) - with.total_rmse_kpa().powi(2))
}

/// What to say of a term that fits best as fast as its kind is told by not being.
fn too_fast(bench: &Bench<'_>, candidates: &[Candidate], best: &Explanation) -> Option<String> {
    best.terms.iter().find_map(|term| {
        let candidate = candidates.get(*term)?;
        let at = position_of(bench, candidates, best, *term)?;
        let estimates = best.fitted.estimates.iter().skip(at).take(candidate.len());
        let (key, least) = candidate.too_fast(&estimates.map(|estimate| estimate.value).collect::<Vec<_>>())?;
        Some(format!(
            "{} fits best with the least {key} that is plausible for it, {least}: something like it, but faster, not it",
            candidate.name()
        ))
    })
}

/// Names of terms, for notes.
fn names_of(candidates: &[Candidate], terms: &[usize]) -> String {
    terms.iter().filter_map(|t| candidates.get(*t)).map(Candidate::name).collect::<Vec<_>>().join(" with ")
}

/// The diagnosis in the form of its file.
fn summed_up(findings: &Findings<'_, '_>) -> Diagnosis {
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

fn write(
    request: &Request,
    findings: &Findings<'_, '_>,
    diagnosis: &Diagnosis,
    rig: &Rig,
) -> Result<(), DiagnoseError> {
    let directory = &request.out_dir;
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
