//! Findings as sentences and as entries of `diagnosis.json`.

use fit::data::rms_kpa;
use fit::wording::{NO_NOISE_KPA, change_in_percent, percent};
use proto::diagnosis::{FoundEvidence, FoundMechanism, FoundParameter, RigKind, Verdict};
use std::collections::BTreeMap;

use crate::bench::Bench;
use crate::event::Event;
use crate::event::changes;
use crate::judge::extrapolated::Extrapolated;
use crate::judge::implausible_parameters;
use crate::judge::undetermined::is_undetermined;
use crate::locate::{Suspect, Suspicion};
use crate::pump::ripple::{Heard, Number, Told};
use crate::report::findings::{BetterFitted, Findings};
use crate::report::unexplained;
use crate::report::wording::{called, does, does_at, in_words, number_in_words, plain, three, with_unit};
use crate::search::place::side_of;
use crate::search::position_of;

/// The answer in a few sentences: what happened if something did, the verdict, what stays unexplained and where, and what in it nobody
/// would believe.
pub(crate) fn summary(findings: &Findings<'_, '_>, mechanisms: &[FoundMechanism]) -> String {
    let answer = verdict_in_words(findings, mechanisms);
    let mut all: Vec<String> = Vec::new();
    all.extend(findings.other_rig.iter().map(|other| other.in_words(|source| findings.shown_as(source))));
    match &findings.event {
        Some(event) => all.push(format!("{} For the rest: {answer}", happened(findings, event))),
        None => all.push(answer),
    }
    if findings.kind == RigKind::AsGiven && findings.judgement.verdict != Verdict::Adequate {
        all.push("No rig file was better on validation data: rig.toml is the rig as it was given.".to_owned());
    }
    all.extend(findings.extrapolated.iter().map(Extrapolated::in_words));
    if let Some(change) = findings.changes.first() {
        all.push(changes::in_words(change, &findings.shown_as(&change.recording)));
    }
    all.extend(unexplained::in_words(&findings.unexplained, |source| findings.shown_as(source)));
    all.extend(implausible_parameters::headline(&findings.doubtful));
    if !findings.sides_alone.is_empty() {
        all.push(format!("Of some parameters only a side is known: {}.", findings.sides_alone.join("; ")));
    }
    all.join(" ")
}

/// An event in words.
fn happened(findings: &Findings<'_, '_>, event: &Event) -> String {
    let [from, to] = event.time_s;
    let file = findings.shown_as(&event.source);
    let [inside, outside] = event.rmse_kpa;
    let span = format!("Something happened between {from:.1} and {to:.1} s of {file}");
    let off = format!("the open-loop simulation is off by {inside:.2} kPa there and by {outside:.2} kPa outside");
    match &event.change {
        Some(change) => {
            let key = change.path.rsplit('.').next().unwrap_or_default();
            format!(
                "{span}, at `{}`: with its {} at {} instead of {} the squared error there falls by {}, with any other single \
                 change by {} at most ({off}).",
                change.component,
                plain(key),
                with_unit(change.during, change.unit),
                with_unit(change.before, change.unit),
                percent(change.share, 0),
                percent(change.next_share, 0)
            )
        }
        None => format!("{span} that no single change of the rig explains ({off})."),
    }
}

/// Difference of two errors, in kPa, that two decimals do not show.
const AS_GOOD_KPA: f64 = 0.01;

/// The recording, or the piece of one, in which what was found sets most right, and how much.
fn shows_in(findings: &Findings<'_, '_>) -> Option<String> {
    let records = findings.bench.records;
    let layout = records.layout();
    let rmse = |trace: &[f64], record: usize| {
        let rows = || (0..layout.channels()).flat_map(|channel| layout.channel(record, channel));
        let off = |i: usize| trace.get(i).zip(records.readings_kpa().get(i)).map_or(0.0, |(t, r)| (t - r).powi(2));
        (rows().map(off).sum::<f64>() / rows().count().max(1) as f64).sqrt()
    };
    let [without, with] = [&findings.found.nominal, &findings.found.best];
    let pieces = records.records().iter().enumerate().map(|(at, piece)| (at, piece, rmse(&without.trace, at)));
    let drops = pieces.map(|(at, piece, before)| (piece, before, rmse(&with.trace, at)));
    let (piece, before, after) = drops.max_by(|a, b| (a.1 - a.2).total_cmp(&(b.1 - b.2)))?;
    let file = findings.shown_as(&piece.source);
    let from = piece.time_s.first().filter(|s| **s > 1.0).map_or_else(String::new, |s| format!(" from {s:.1} s on"));
    (before - after > AS_GOOD_KPA).then(|| format!("in {file}{from}: off by {after:.2} kPa instead of {before:.2} kPa"))
}

/// Times the noise up to which an error on validation data is noise (chosen: what half a noise on top of it makes is 1.1).
const NOISE_ALONE: f64 = 2.0;

/// Noise of the readings over all channels, root mean square, in kPa.
pub(crate) fn noise_kpa(bench: &Bench<'_>) -> f64 {
    rms_kpa(&bench.noise)
}

/// Noise in kPa below which two decimals do not show it.
const LITTLE_NOISE_KPA: f64 = 0.01;

/// Noise of the readings in words.
pub(crate) fn noise_in_words(bench: &Bench<'_>) -> String {
    let kpa = noise_kpa(bench);
    match kpa {
        kpa if kpa <= NO_NOISE_KPA => "the noise cannot be told".to_owned(),
        kpa if kpa < LITTLE_NOISE_KPA => format!("noise {} kPa", three(kpa)),
        kpa => format!("noise {kpa:.2} kPa"),
    }
}

fn verdict_in_words(findings: &Findings<'_, '_>, mechanisms: &[FoundMechanism]) -> String {
    let judgement = findings.judgement;
    let [before, after] = findings.before_and_after_kpa();
    let further_off = findings.unexplained.iter().any(|left| left.further_off.is_some());
    let better_fitted = findings.better_fitted();
    match judgement.verdict {
        Verdict::Adequate if !better_fitted.is_empty() => hardly_moved(&better_fitted),
        Verdict::Adequate if further_off || after > NOISE_ALONE * noise_kpa(findings.bench) => {
            "No known mechanism and no other parameters make the model better than it stands; yet it does not explain all of these \
             recordings."
                .to_owned()
        }
        Verdict::Adequate => {
            "The model as it stands explains these recordings to within their noise; nothing is missing.".to_owned()
        }
        Verdict::ParametersMoved => format!(
            "Nothing is missing, but the rig's parameters are not those of the file: with them fitted the open-loop simulation is \
             off by {before:.2} kPa instead of {:.2} kPa on validation data. {}",
            findings.given.total_rmse_kpa(),
            moved(findings)
        ),
        Verdict::MissingPhysics => {
            let what: Vec<String> = mechanisms.iter().map(|m| m.summary.clone()).collect();
            let noise = noise_in_words(findings.bench);
            let what = what.join(" ");
            match shows_in(findings) {
                Some(shows) if before - after < AS_GOOD_KPA => format!(
                    "{what} It shows {shows}; on validation data the open-loop simulation is off by {after:.2} kPa with it and by \
                     {before:.2} kPa without ({noise})."
                ),
                _ => format!(
                    "{what} With this the open-loop simulation is off by {after:.2} kPa instead of {before:.2} kPa on validation data \
                     ({noise})."
                ),
            }
        }
        Verdict::Undecided => {
            let groups: Vec<String> = judgement
                .groups
                .iter()
                .map(|group| group.iter().map(|name| in_words(findings, name)).collect::<Vec<_>>().join(", or "))
                .collect();
            let known = if mechanisms.is_empty() {
                String::new()
            } else {
                mechanisms.iter().map(|m| m.summary.clone() + " ").collect()
            };
            let next = match &findings.plan {
                Some(plan) if plan.decides() => " The experiment in next_experiment.csv will tell them apart.",
                Some(_) => " The experiment in next_experiment.csv is the best that was found to tell them apart.",
                None => "",
            };
            format!("{known}These recordings do not tell whether {}.{next}", groups.join("; nor whether "))
        }
        Verdict::UnknownMechanism => {
            let at = findings.missing.suspicions.first();
            let place = at.map_or_else(|| "its place is unclear".to_owned(), |s| place_of(findings, s));
            let figures = format!(
                "the open-loop simulation is off by {after:.2} kPa instead of {before:.2} kPa on validation data"
            );
            let stand_ins: Vec<String> = findings
                .found
                .best
                .terms
                .iter()
                .filter_map(|t| findings.candidates.get(*t))
                .map(|c| format!("{} of {}", c.id, c.component))
                .collect();
            let written = match findings.unknown {
                Some(term) => format!(" The rig file now has {}; {figures}.", term.depends_on),
                None if stand_ins.is_empty() || findings.kind == RigKind::AsGiven => String::new(),
                None => format!(
                    " The rig file has the nearest of what is known in its place ({}), which is not what it is; {figures}.",
                    stand_ins.join(", ")
                ),
            };
            // What the pump's ripple told is known all the same.
            let known: String = mechanisms.iter().map(|m| m.summary.clone() + " ").collect();
            let what = if known.is_empty() { "Something" } else { "Something else" };
            format!("{known}{what} is missing that is none of the known mechanisms: {place}.{written}")
        }
    }
}

/// Fitted parameters explain more on validation data, but by too little, or not certainly enough, for the verdict that parameters
/// moved.
fn hardly_moved(better_fitted: &[BetterFitted<'_>]) -> String {
    let told: Vec<String> = better_fitted.iter().map(BetterFitted::in_words).collect();
    format!(
        "No known mechanism makes the model better than it stands. Fitted parameters do: with them the open-loop simulation is \
         {} on validation data. rig.toml is the rig as it was given.",
        told.join(", and ")
    )
}

/// The parameters that moved most, in words.
fn moved(findings: &Findings<'_, '_>) -> String {
    let mut estimates: Vec<_> = findings.found.nominal.fitted.estimates.iter().collect();
    estimates.retain(|e| e.undetermined < 0.7);
    estimates.sort_by(|a, b| b.shift.abs().total_cmp(&a.shift.abs()));
    // What stayed within what such parts scatter by has not moved, if anything else has.
    let told: Vec<String> = estimates
        .iter()
        .enumerate()
        .filter(|(place, e)| *place == 0 || e.shift.abs() >= 1.0)
        .take(3)
        .map(|(_, e)| {
            // What was stated as nothing has no share of it.
            if e.parameter.mean == 0.0 {
                return format!("{} {} {}", e.parameter.path, three(e.value), e.parameter.unit());
            }
            format!("{} {}", e.parameter.path, change_in_percent(e.value / e.parameter.mean - 1.0, 1))
        })
        .collect();
    if told.is_empty() { String::new() } else { format!("Moved most: {}.", told.join(", ")) }
}

/// A suspicion in words.
fn place_of(findings: &Findings<'_, '_>, suspicion: &Suspicion) -> String {
    let name = |channel: &usize| {
        let sensor = findings.bench.rig.sensors.values().nth(*channel);
        sensor.map_or_else(|| format!("channel {channel}"), |s| s.volume.clone())
    };
    let pace = match suspicion.length_s {
        l if l < 0.2 => "fast",
        l if l < 1.0 => "within a second",
        l if l < 10.0 => "over seconds",
        _ => "slow",
    };
    match &suspicion.suspect {
        Suspect::Balance { channel } => {
            format!("the mass balance of the {} chamber is off, {pace}", name(channel))
        }
        Suspect::Transfer { from, to } => {
            format!("the pump moves another flow from the {} to the {} side, {pace}", name(from), name(to))
        }
        Suspect::Reading { channel } => {
            format!("the reading of the {} sensor is off while its chamber behaves, {pace}", name(channel))
        }
    }
}

/// The mechanisms that are named, those of one kind on both sides as one.
pub(crate) fn mechanisms(findings: &Findings<'_, '_>) -> Vec<FoundMechanism> {
    let mut all: Vec<FoundMechanism> = Vec::new();
    for term in &findings.judgement.named {
        let found = mechanism(findings, *term);
        match all.iter_mut().find(|known| known.id == found.id && known.side != found.side) {
            Some(twin) => join(twin, found),
            None => all.push(found),
        }
    }
    if let Some(heard) = findings.heard {
        all.extend(heard.told.iter().map(|told| heard_off_the_ripple(findings, heard, told)));
    }
    all.sort_by(|a, b| b.evidence.delta_log_likelihood.total_cmp(&a.evidence.delta_log_likelihood));
    all
}

/// Entry for a mechanism that the pump's ripple told.
fn heard_off_the_ripple(findings: &Findings<'_, '_>, heard: &Heard, told: &Told) -> FoundMechanism {
    let id = told.attached.mechanism.id();
    // Its own part: the ripple goes with it, and nothing else.
    let [before, after] = [&findings.reidentified, &findings.fitted].map(|figures| figures.total_rmse_kpa());
    let (mut parameters, mut numbers) = (BTreeMap::new(), Vec::new());
    for Number { key, unit, value, interval: [low, high] } in &told.numbers {
        let parameter = FoundParameter {
            value: *value,
            unit: (*unit).to_owned(),
            low: *low,
            high: *high,
            at_end_of_range: None,
            undetermined: false,
        };
        numbers.push(number_in_words(key, &parameter, None));
        parameters.insert((*key).to_owned(), parameter);
    }
    let numbers = numbers.join(", ");
    FoundMechanism {
        id: id.to_owned(),
        side: side_of(findings.bench.rig, &told.attached.component),
        component: told.attached.component.clone(),
        summary: format!("The pump {} ({numbers}); this was read off its ripple: {}.", does(id), told.shows),
        parameters,
        evidence: FoundEvidence {
            delta_log_likelihood: heard.log_likelihood,
            held_out_rmse_gain: 1.0 - after / before.max(1e-9),
        },
        rivals: Vec::new(),
    }
}

/// Joins a mechanism with the same one on the other side.
fn join(twin: &mut FoundMechanism, other: FoundMechanism) {
    let sides = [twin.side.clone(), other.side.clone()];
    let own = std::mem::take(&mut twin.parameters);
    twin.parameters = own.into_iter().map(|(name, p)| (format!("{name}_{}", sides[0]), p)).collect();
    twin.parameters.extend(other.parameters.into_iter().map(|(name, p)| (format!("{name}_{}", sides[1]), p)));
    twin.side = "both".to_owned();
    twin.component = format!("{},{}", twin.component, other.component);
    twin.summary = format!("{} {}", twin.summary, other.summary);
    twin.evidence.delta_log_likelihood += other.evidence.delta_log_likelihood;
    twin.evidence.held_out_rmse_gain = twin.evidence.held_out_rmse_gain.max(other.evidence.held_out_rmse_gain);
    twin.rivals.extend(other.rivals);
}

fn mechanism(findings: &Findings<'_, '_>, term: usize) -> FoundMechanism {
    let candidate = &findings.candidates[term];
    let best = &findings.found.best;
    let mut parameters = BTreeMap::new();
    let mut told = Vec::new();
    if let Some(at) = position_of(findings.bench, findings.candidates, best, term) {
        for (place, estimate) in best.fitted.estimates.iter().skip(at).take(candidate.len()).enumerate() {
            let [low, high] = estimate.interval();
            let unit = estimate.parameter.unit().to_owned();
            let key = estimate.parameter.path.rsplit('.').next().unwrap_or_default().to_owned();
            let at_end_of_range = candidate.end_of_range(place, estimate.value);
            let beyond = findings.extrapolated.iter().find(|of| of.is_of(term, &key));
            let (value, undetermined) = (estimate.value, is_undetermined(estimate));
            let number = FoundParameter { value, unit, low, high, at_end_of_range, undetermined };
            told.push(number_in_words(&key, &number, beyond.map(Extrapolated::in_brief)));
            parameters.insert(key, number);
        }
    }
    let contest = findings.judgement.contested.iter().find(|c| c.term == term);
    // Its own part, everything else fitted again without it; all that was set right where the rig cannot be run without it.
    let [before, after] = findings.before_and_after_kpa();
    let own_gain = contest.and_then(|c| c.validation_gain).unwrap_or(1.0 - after / before.max(1e-9));
    FoundMechanism {
        id: candidate.id.clone(),
        side: candidate.side.clone(),
        component: candidate.component.clone(),
        summary: format!(
            "{} {} ({}).",
            called(findings, candidate),
            does_at(findings.bench.rig, candidate),
            told.join(", ")
        ),
        parameters,
        evidence: FoundEvidence { delta_log_likelihood: contest.map_or(0.0, |c| c.gain), held_out_rmse_gain: own_gain },
        rivals: contest.map(|c| c.rivals.iter().map(|k| findings.candidates[*k].name()).collect()).unwrap_or_default(),
    }
}
