//! A diagnosis from recordings to files.

use std::path::PathBuf;

use fit::cores::side_by_side;
use model::rig::Rig;
use proto::diagnosis::{Diagnosis, RigKind, Verdict};
use proto::recording::{Recording, short_name};

use crate::bench::{Bench, Explanation};
use crate::error::DiagnoseError;
use crate::event::changes::{self, changes};
use crate::event::other_rig::{OtherRig, explained_throughout};
use crate::event::{self, Event};
use crate::experiment::{can_be_shut_in, plan};
use crate::judge::added_uncertainty::variance_beyond_noise;
use crate::judge::curved_sensor;
use crate::judge::extrapolated::extrapolated;
use crate::judge::implausible_parameters::{self, doubtful, ends_with_its_range, own, sides_alone};
use crate::judge::kind_of_rig::kind_of_rig;
use crate::judge::rejected_names::{are_leaks_too_small, objection};
use crate::judge::step_uncertainty::variance_of_steps;
use crate::judge::undetectable;
use crate::judge::undetermined::unname;
use crate::judge::{Judgement, MOVED, judge_without};
use crate::pump::answer::{Answer, Asked};
use crate::pump::switched::REACH_KPA;
use crate::pump::turning::answered;
use crate::recordings::checked::{Recorded, without};
use crate::report::figures::{Figures, figures};
use crate::report::files::{Outcome, under_its_own_name};
use crate::report::findings::Findings;
use crate::report::unexplained::unexplained;
use crate::search::SearchSettings;
use crate::search::candidate::{Candidate, candidates, names_of, no_faster_than};
use crate::search::quick_search::settled;
use crate::unknown::{self, Formula, fit_unknown};

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

    let (mut formula, mut event) = something_else(&whole, &answer, &request.rig)?;
    // What known physics leaves unexplained may be something that happened; then the rest is asked by itself.
    let rest = event.as_ref().map(|event| without(event, rig, &turning.records, &usable));
    let rest = rest.as_ref().map(|(records, usable)| whole.over(records, usable, whole.simulator.fidelity()));
    if let Some(rest) = &rest {
        progress("looking at the rest", 0.0);
        answer = Answer::of(rest, &asked, &turning.point, turning.strokes_of.as_ref(), progress)?;
    }
    let bench = rest.as_ref().unwrap_or(&whole);
    let Answer { given, reduced, candidates, mut found, mut missing, mut judgement, .. } = answer;
    let searched = bench.reduced(&reduced);

    progress("running before and after", 0.0);
    let of = |rig: &Rig| figures(bench, rig, bench.close.fidelity(), !request.quick);
    let passes = if request.quick { 1 } else { 2 };
    let shown = |explanation: &&Explanation| -> Result<(Explanation, Figures), DiagnoseError> {
        let settled = settled(bench, explanation, passes)?;
        let figures = of(&settled.fitted.rig)?;
        Ok((settled, figures))
    };
    let mut both = vec![&found.nominal];
    both.extend(Some(&found.best).filter(|best| !best.terms.is_empty()));
    let mut both = side_by_side(&both, shown).into_iter();
    let (nominal, fitted) = both.next().unwrap_or_else(|| shown(&&found.nominal))?;
    let (mut best, mut extended) = both.next().unwrap_or_else(|| Ok((nominal.clone(), fitted.clone())))?;
    if judgement.is_of_names() || are_leaks_too_small(&searched, &candidates, &found.best)? {
        if let Some(objection) = objection(&searched, &candidates, &found, [&fitted, &extended])? {
            notes.push(objection.note);
            // Where something has no name, what has none is asked as well; of the rest beside an event it is below.
            formula = match objection.formula {
                None if objection.missing && event.is_none() => unknown::formula(&searched, &found.nominal),
                explains => explains,
            };
            judgement = if objection.missing {
                judgement.of_no_name()
            } else {
                judge_without(&searched, &candidates, &found, &searched.free_run(asked.given)?)?
            };
            (best, extended) = (nominal.clone(), fitted.clone());
        } else if judgement.verdict == Verdict::MissingPhysics {
            notes.extend(beside_what_is_named(&candidates, &judgement, &best));
        }
    }
    (found.nominal, found.best) = (nominal, best);
    turning.judged(&mut judgement);
    if found.best.jumps && judgement.verdict == Verdict::MissingPhysics {
        notes.push(JUDGED_IN_THE_MIDDLE.to_owned());
    }

    let reidentified = turning.reidentified(bench, fitted.clone(), !request.quick)?;
    let mut unknown = None;
    if judgement.verdict == Verdict::UnknownMechanism {
        progress("shaping a term for what has no name", 0.0);
        if event.is_some() {
            // That one was fitted to what happened as well.
            formula = unknown::formula(&searched, &found.nominal);
        }
        unknown = fit_unknown(&searched, &found.nominal, &missing, if request.quick { 2 } else { 4 }, formula)?;
    }
    if let Some(mut term) = unknown.take() {
        term.explanation = settled(bench, &term.explanation, passes)?;
        let with_it = of(&term.explanation.fitted.rig)?;
        // Also against parameters alone, where the pump's speed was taken from its ripple. What has no name has nothing but its figures to
        // speak for it, so it must err less than they do, not just no more but for chance.
        let holds = |before: &Figures| {
            with_it.holds_against(before, &bench.sigma_kpa()) && with_it.total_rmse_kpa() < before.total_rmse_kpa()
        };
        if holds(&fitted) && holds(&reidentified) {
            extended = with_it;
            if let Some(channel) = term.reading {
                missing.settle_on_reading(channel);
            }
            unknown = Some(term);
        } else {
            let before = if holds(&fitted) { &reidentified } else { &fitted };
            notes.push(does_not_hold(&term.depends_on, [before, &with_it]));
        }
    }

    let kind = kind_of_rig(bench, &found, unknown.as_ref(), [&given, &extended], &mut judgement, &mut notes);
    if kind == RigKind::AsGiven {
        (unknown, extended) = (None, given.clone());
    }
    if can_be_shut_in(rig, bench.records.inputs()) {
        let base = if judgement.is_of_names() { &found.best } else { &found.nominal };
        tell_what_could_hide(&searched, &candidates, base, &mut judgement, &mut notes);
    }
    progress("planning", 0.0);
    let plan = match judgement.verdict {
        Verdict::Undecided => plan(bench, &judgement.rivals.iter().collect::<Vec<_>>())?,
        _ => None,
    };
    if judgement.verdict == Verdict::MissingPhysics {
        let beyond_noise = variance_beyond_noise(&searched, &candidates, &found.best);
        found.best.fitted.widen(&beyond_noise);
        let of_steps = variance_of_steps(&searched, &candidates, &found.best);
        found.best.fitted.widen(&of_steps);
        let untold = unname(&searched, &candidates, &found.best, turning.heard.is_some(), &mut judgement);
        notes.extend(may_be_nothing(&candidates, &untold));
    }
    let extrapolated = extrapolated(bench, &candidates, &found.best, &judgement.named);
    notes.extend(curved_sensor::in_words(bench, &candidates, &judgement.named));
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
    let changes = if bench.is_much(&extended.beyond_noise_kpa(&bench.sigma_kpa())) {
        let explained: Vec<&str> =
            [&given, &fitted].iter().flat_map(|figures| explained_throughout(bench, &figures.trace)).collect();
        changes(bench, &extended.trace, &explained)
    } else {
        Vec::new()
    };
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

const JUDGED_IN_THE_MIDDLE: &str = "where a valve sticks, one jump that comes late throws the open-loop simulation off until the next: what \
                                    is left was judged by the middle one of all stretches of 2 s";

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

/// Note on terms that are in the rig and have no name.
fn beside_what_is_named(candidates: &[Candidate], judgement: &Judgement, best: &Explanation) -> Option<String> {
    let contested = |term: &&usize| judgement.contested.iter().all(|contest| contest.term != **term);
    let beside: Vec<usize> = best.terms.iter().filter(contested).copied().collect();
    (!beside.is_empty()).then(|| {
        format!(
            "{} is in the rig file as well: it shows while the pump stands, and moves no pressure by {REACH_KPA} kPa elsewhere",
            names_of(candidates, &beside)
        )
    })
}

/// Note on terms that lost their name since their number may as well be nothing.
fn may_be_nothing(candidates: &[Candidate], untold: &[usize]) -> Option<String> {
    (!untold.is_empty()).then(|| {
        format!(
            "{} is in the rig file as well, since it fits better with it, and has no name: its number may as well be nothing, by what is \
             too small for a name in any rig",
            names_of(candidates, untold)
        )
    })
}

/// Note on a term without a name that makes rows worse that nothing was fitted to.
fn does_not_hold(depends_on: &str, [fitted, with_it]: [&Figures; 2]) -> String {
    format!(
        "{depends_on} was tried and does not hold on validation data ({:.2} kPa instead of {:.2}): it is not in the rig file",
        with_it.total_rmse_kpa(),
        fitted.total_rmse_kpa()
    )
}

/// Notes what could be there beside an answer without showing; leaks that could stand behind moved parameters are their rivals: the
/// experiment ends with a shut-in in any case, and tells.
fn tell_what_could_hide(
    searched: &Bench<'_>,
    candidates: &[Candidate],
    base: &Explanation,
    judgement: &mut Judgement,
    notes: &mut Vec<String>,
) {
    if matches!(judgement.verdict, Verdict::Adequate | Verdict::ParametersMoved | Verdict::MissingPhysics) {
        notes.extend(undetectable::in_words(searched, candidates, base));
    }
    if let Some(group) = judgement.groups.iter_mut().find(|group| group.iter().any(|name| name == MOVED)) {
        let hide = undetectable::leaks_behind(searched, candidates, base);
        group.extend(hide.into_iter().filter(|name| !group.contains(name)).collect::<Vec<_>>());
    }
}
