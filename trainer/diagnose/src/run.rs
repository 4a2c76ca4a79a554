//! A diagnosis from recordings to files.

use std::path::PathBuf;

use model::rig::Rig;
use proto::diagnosis::{ChangeInTime, Diagnosis, RigKind, Verdict};
use proto::recording::{Recording, short_name};

use crate::bench::Bench;
use crate::decision::{Decision, Upheld};
use crate::error::DiagnoseError;
use crate::event::changes::{self, changes};
use crate::event::other_rig::{OtherRig, explained_throughout};
use crate::event::{self, Event};
use crate::experiment::plan;
use crate::judge::curved_sensor;
use crate::judge::extrapolated::extrapolated;
use crate::judge::implausible_parameters::{self, doubtful, ends_with_its_range, own, sides_alone};
use crate::judge::weakening_supply;
use crate::pump::answer::{Answer, Asked};
use crate::pump::turning::answered;
use crate::recordings::checked::{Recorded, without};
use crate::report::figures::Figures;
use crate::report::files::{Outcome, under_its_own_name};
use crate::report::findings::Findings;
use crate::report::unexplained::unexplained;
use crate::search::SearchSettings;
use crate::search::candidate::{candidates, no_faster_than};
use crate::unknown::{self, Formula};

/// Request for a diagnosis.
#[derive(Debug, Clone)]
pub struct Request {
    /// The rig as it is known.
    pub rig: Rig,
    /// Argument of `--rig`: a name or a path, for commands that are proposed.
    pub rig_argument: String,
    /// Recordings of the rig.
    pub recordings: Vec<Recording>,
    /// Where the results go.
    pub out_dir: PathBuf,
    /// A shorter search.
    pub quick: bool,
}

/// Diagnoses; writes `diagnosis.json`, `report.html`, `rig.toml` and, if undecided, `next_experiment.csv`.
///
/// `progress` is told what is being done and the share of it that is done (0 … 1).
///
/// # Errors
/// Recordings that cannot be used, a rig that cannot be simulated, files that cannot be written.
pub fn run(request: &Request, progress: &mut dyn FnMut(&str, f64)) -> Result<Diagnosis, DiagnoseError> {
    let outcome = work_out(request, progress)?;
    outcome.write(&request.out_dir)?;
    Ok(outcome.diagnosis)
}

/// Diagnoses, and writes nothing.
///
/// # Errors
/// As [`run`], but for files.
pub fn work_out(request: &Request, progress: &mut dyn FnMut(&str, f64)) -> Result<Outcome, DiagnoseError> {
    progress("reading", 0.0);
    let Recorded { records, usable, switched, mut notes } = Recorded::of(&request.rig, &request.recordings)?;
    progress("asking each recording whether it is of the rig as given", 0.0);
    let other_rig = OtherRig::find(&request.rig, &records, &usable)?;
    let (records, usable) = match &other_rig {
        Some(other) => other.left_out(&records, &usable),
        None => (records, usable),
    };
    let mut asked = asked(request, switched);
    progress("fitting the rig's own parameters", 0.0);
    let (turning, mut answer) = answered(&mut asked, records, &usable, progress)?;
    notes.extend(turning.note());
    let rig = &turning.rig;
    let whole = turning.bench(&usable, request.quick);

    let (formula, event) = something_else(&whole, &answer, &request.rig)?;
    // What known physics leaves unexplained may be something that happened; then the rest is asked by itself.
    let rest = event.as_ref().map(|event| without(event, rig, &turning.records, &usable));
    let rest = rest.as_ref().map(|(records, usable)| whole.over(records, usable, whole.simulator.fidelity()));
    if let Some(rest) = &rest {
        progress("looking at the rest", 0.0);
        answer = Answer::of(rest, &asked, &turning.point, turning.strokes_of.as_ref(), progress)?;
    }
    let bench = rest.as_ref().unwrap_or(&whole);
    let Answer { given, reduced, candidates, found, missing, judgement, .. } = answer;
    let searched = bench.reduced(&reduced);
    let mut decision =
        Decision { request, bench, searched: &searched, candidates, found, missing, judgement, formula, event, notes };

    progress("running before and after", 0.0);
    let Upheld { fitted, mut extended } = decision.upheld()?;
    turning.judged(&mut decision.judgement);
    decision.tell_of_jumps();
    let reidentified = turning.reidentified(bench, fitted.clone(), !request.quick)?;
    let mut unknown = decision.without_name([&fitted, &reidentified], progress)?.map(|term| {
        extended = term.figures;
        term.term
    });
    let kind = decision.kind_of_rig(unknown.as_ref(), [&given, &extended]);
    if kind == RigKind::AsGiven {
        (unknown, extended) = (None, given.clone());
    }
    decision.tell_what_could_hide();
    progress("planning", 0.0);
    let plan = match decision.judgement.verdict {
        Verdict::Undecided => plan(bench, &decision.judgement.rivals.iter().collect::<Vec<_>>())?,
        _ => None,
    };
    decision.hedge(turning.heard.as_ref());
    let Decision { candidates, found, missing, judgement, mut event, mut notes, .. } = decision;
    let extrapolated = extrapolated(bench, &candidates, &found.best, &judgement.named);
    notes.extend(curved_sensor::in_words(bench, &candidates, &judgement.named));
    notes.extend(weakening_supply::in_words(bench, &candidates, &judgement.named));
    if let Some(event) = &mut event {
        event.change = event::what_changed(&whole, &found.best.fitted.rig, event)?;
    }

    progress("writing", 0.0);
    let by = unknown.as_ref().map_or(&found.best, |term| &term.explanation);
    let rig = match kind {
        RigKind::AsGiven => request.rig.clone(),
        _ => under_its_own_name(turning.as_begun(&by.fitted.rig), kind, &sources(request, other_rig.as_ref())),
    };
    let (doubtful, sides_alone) = match kind {
        RigKind::AsGiven => (Vec::new(), Vec::new()),
        _ => (doubtful(&own(&by.fitted)), sides_alone(&by.fitted)),
    };
    let in_part = kind != RigKind::AsGiven && ends_with_its_range(&by.fitted);
    notes.extend(doubtful.iter().map(implausible_parameters::in_words));
    notes.extend(sides_alone.iter().cloned());
    let changes = lasting_changes(bench, &extended, [&given, &fitted]);
    let sources_of = || bench.records.records().iter().map(|r| r.source.as_str());
    notes.extend(changes.iter().skip(1).map(|c| changes::in_words(c, &short_name(&c.recording, sources_of()))));
    Outcome::of(&Findings {
        request,
        reidentified,
        unexplained: unexplained(bench, &extended),
        given,
        fitted,
        extended,
        unknown: unknown.as_ref(),
        bench,
        candidates: &candidates,
        found: &found,
        judgement: &judgement,
        missing: &missing,
        plan,
        heard: turning.heard.as_ref(),
        event,
        other_rig,
        extrapolated,
        changes,
        doubtful,
        sides_alone,
        in_part,
        rig,
        kind,
        notes,
    })
}

/// Names of the recordings' files that are not of another rig.
fn sources(request: &Request, other_rig: Option<&OtherRig>) -> Vec<String> {
    let all = || request.recordings.iter().map(Recording::source);
    let is_other = |source: &str| other_rig.is_some_and(|other| other.is_other(source));
    all().filter(|source| !is_other(source)).map(|source| short_name(source, all())).collect()
}

/// Distance of samples, in s, from which on they are further apart than rows (20 ms and half).
const SPARSE_S: f64 = 0.03;

/// Question that a search over the recordings of a request is asked; `switched` says whether a pump was switched in them.
fn asked(request: &Request, switched: bool) -> Asked<'_> {
    let sampling_s = request.recordings.iter().map(Recording::sampling_s).fold(0.0, f64::max);
    let all = candidates(&request.rig);
    Asked {
        given: &request.rig,
        candidates: if sampling_s > SPARSE_S { no_faster_than(all, sampling_s) } else { all },
        settings: if request.quick { SearchSettings::short(switched) } else { SearchSettings::whole(switched) },
        quick: request.quick,
    }
}

/// Causes that may be there beside known physics, or instead of it: a formula for a reading, or something that happened. The second
/// is looked for also where something was named and leaves much: what is named holds for all recordings.
fn something_else(
    whole: &Bench<'_>,
    answer: &Answer,
    given: &Rig,
) -> Result<(Option<Formula>, Option<Event>), DiagnoseError> {
    let left = whole.is_much(&answer.judgement.excess_kpa[2]);
    let searched = whole.reduced(&answer.reduced);
    let formula = (answer.judgement.verdict == Verdict::UnknownMechanism)
        .then(|| unknown::formula(&searched, &answer.found.nominal))
        .flatten();
    let asked = left && !formula.as_ref().is_some_and(|formula| formula.suffices);
    if !asked {
        return Ok((formula, None));
    }
    let explained = explained_throughout(&searched, &searched.free_run(given)?);
    let event = event::find(&searched, &answer.found.best.trace, &explained);
    Ok((formula, event))
}

/// Lasting changes of what the written rig is off by, where that is much; not in recordings that a rig before it explains throughout.
fn lasting_changes(bench: &Bench<'_>, written: &Figures, before: [&Figures; 2]) -> Vec<ChangeInTime> {
    if !bench.is_much(&written.beyond_noise_kpa(&bench.sigma_kpa())) {
        return Vec::new();
    }
    let explained: Vec<&str> = before.iter().flat_map(|figures| explained_throughout(bench, &figures.trace)).collect();
    changes(bench, &written.trace, &explained)
}
