//! Where the mismatch lives: components, regions, spans of time.

use proto::diagnosis::{Location, Verdict};

use crate::event::Event;
use crate::locate::Suspect;
use crate::locate::region::{Region, Stretch, most_telling};
use crate::recordings::axes::axes;
use crate::report::findings::Findings;
use crate::report::unexplained::off_most;
use crate::search::place::{channel_of, side_of, volumes_at};

/// A place of the mismatch, and the region that its words say; no region where they say something else.
pub(crate) struct Place {
    /// The place.
    pub(crate) location: Location,
    /// Region of the mismatch on a command, a pressure or a time.
    pub(crate) region: Option<Region>,
}

/// Where the mismatch lives: first the span of an event, then what is off all along.
pub(crate) fn places(findings: &Findings<'_, '_>) -> Vec<Place> {
    let mut all: Vec<Place> =
        findings.event.iter().map(|event| Place { location: place_of_event(findings, event), region: None }).collect();
    all.extend(lasting(findings));
    all
}

fn place_of_event(findings: &Findings<'_, '_>, event: &Event) -> Location {
    let component = event.change.as_ref().map_or_else(|| volume_of(findings, 0), |change| change.component.clone());
    let rows = event.rows as f64;
    let all = findings.bench.records.records().iter().map(|r| r.time_s.len()).sum::<usize>() as f64;
    let [inside, outside] = event.rmse_kpa.map(|kpa| kpa * kpa);
    Location {
        side: side_of(findings.bench.rig, &component),
        component,
        share_of_residual: rows * inside / (rows * inside + all * outside).max(1e-12),
        region: format!("an event between {:.1} and {:.1} s", event.time_s[0], event.time_s[1]),
        time_s: event.time_s,
        time_scale_s: event.time_s[1] - event.time_s[0],
        enters: "mass balance".to_owned(),
    }
}

/// Where the mismatch lives that is there all along.
fn lasting(findings: &Findings<'_, '_>) -> Vec<Place> {
    if matches!(findings.judgement.verdict, Verdict::Adequate | Verdict::ParametersMoved) {
        return Vec::new();
    }
    // The ripple of a pump that was heard is in all readings, all the time.
    let told = findings.heard.and_then(|heard| Some((heard, heard.told.first()?)));
    let heard = told.map(|(heard, told)| Place {
        region: None,
        location: Location {
            side: side_of(findings.bench.rig, &told.attached.component),
            component: told.attached.component.clone(),
            share_of_residual: heard.share.clamp(0.0, 1.0),
            region: "while the pump turns".to_owned(),
            time_s: whole(findings),
            time_scale_s: proto::recording::PERIOD_S,
            enters: "mass balance".to_owned(),
        },
    });
    if findings.judgement.named.is_empty() && findings.judgement.verdict == Verdict::MissingPhysics {
        return heard.into_iter().collect();
    }
    let total = findings.missing.all_flows_gain.max(findings.missing.suspicions.first().map_or(0.0, |s| s.gain));
    // What is named knows its component better than a balance does.
    let named: Vec<usize> = findings.judgement.contested.iter().map(|c| c.term).collect();
    let strongest = findings.missing.suspicions.first().map_or(0.0, |s| s.gain);
    let mut all: Vec<Place> = heard.into_iter().collect();
    if named.is_empty() && findings.judgement.verdict == Verdict::Undecided {
        return places_of_rivals(findings);
    }
    if !named.is_empty() {
        let gains: f64 = findings.judgement.contested.iter().map(|c| c.gain.max(0.0)).sum();
        for contest in &findings.judgement.contested {
            let candidate = &findings.candidates[contest.term];
            let component = candidate.component.clone();
            let channels = channels_of(findings, &component);
            let region = region_of_missing(findings, &component, &channels);
            let reading = findings.bench.rig.sensors.contains_key(&component);
            let enters = if reading { "reading" } else { "mass balance" };
            let share = contest.gain.max(0.0) / gains.max(1e-9);
            // Two mechanisms of one valve are at one place.
            let is_there =
                |known: &&mut Place| known.location.component == component && known.location.enters == enters;
            if let Some(known) = all.iter_mut().find(is_there) {
                known.location.share_of_residual += share;
                continue;
            }
            let (words, time_s) = in_words(findings, region.as_ref());
            let location = Location {
                side: candidate.side.clone(),
                component,
                share_of_residual: share,
                region: words,
                time_s,
                time_scale_s: findings.missing.suspicions.first().map_or(0.0, |s| s.length_s),
                enters: enters.to_owned(),
            };
            all.push(Place { location, region });
        }
        return shared_out(all);
    }
    // A formula for a reading leaves nothing of its channel to another suspect.
    let settled = findings.unknown.and_then(|term| term.reading);
    let open = |suspect: &Suspect| {
        settled.is_none_or(|channel| *suspect == Suspect::Reading { channel } || !suspect.concerns(channel))
    };
    let suspicions = findings.missing.suspicions.iter().filter(|s| open(&s.suspect));
    for suspicion in suspicions.filter(|s| s.gain > 0.3 * strongest && s.gain > 10.0).take(2) {
        let (channels, component, enters) = match &suspicion.suspect {
            Suspect::Balance { channel } => (vec![*channel], volume_of(findings, *channel), "mass balance"),
            Suspect::Transfer { from, to } => {
                let pump = findings.bench.rig.pumps.keys().next().cloned().unwrap_or_default();
                (vec![*from, *to], pump, "mass balance")
            }
            Suspect::Reading { channel } => (vec![*channel], sensor_of(findings, *channel), "reading"),
        };
        let region = region_of_missing(findings, &component, &channels);
        let (words, time_s) = in_words(findings, region.as_ref());
        let location = Location {
            side: side_of(findings.bench.rig, &component),
            component,
            share_of_residual: (suspicion.gain / total.max(1e-9)).clamp(0.0, 1.0),
            region: words,
            time_s,
            time_scale_s: suspicion.length_s,
            enters: enters.to_owned(),
        };
        all.push(Place { location, region });
    }
    shared_out(all)
}

/// Places that overlap (a pump's ripple is in both chambers) claim more than there is: each its part of the whole.
fn shared_out(mut places: Vec<Place>) -> Vec<Place> {
    let total: f64 = places.iter().map(|place| place.location.share_of_residual).sum();
    for place in places.iter_mut().map(|place| &mut place.location) {
        // A share is good to a few hundredths: what more there is of digits is rounding.
        place.share_of_residual = (1e4 * place.share_of_residual / total.max(1.0)).round() / 1e4;
    }
    places
}

/// Where the rivals of a mere shift of parameters sit. The re-identified rig has no error left that could tell where, so
/// the given one's is looked at.
fn places_of_rivals(findings: &Findings<'_, '_>) -> Vec<Place> {
    let mut all: Vec<Place> = Vec::new();
    for candidate in findings.judgement.rivals.iter().flat_map(|r| &r.terms).filter_map(|t| findings.candidates.get(*t))
    {
        if all.iter().any(|known| known.location.component == candidate.component) {
            continue;
        }
        let channels = channels_of(findings, &candidate.component);
        let squares = |channel: usize| findings.given.free.get(channel).map_or(0.0, |e| e.rmse_kpa.powi(2));
        let total: f64 = (0..findings.given.free.len()).map(squares).sum();
        let reading = findings.bench.rig.sensors.contains_key(&candidate.component);
        // Where the rig as it was given is off most.
        let own = command_of(findings, &candidate.component);
        let region = off_most(findings.bench, &findings.given.trace, &channels, own.as_deref());
        let (words, time_s) = in_words(findings, region.as_ref());
        let location = Location {
            side: candidate.side.clone(),
            component: candidate.component.clone(),
            share_of_residual: channels.iter().map(|c| squares(*c)).sum::<f64>() / total.max(1e-12),
            region: words,
            time_s,
            time_scale_s: 0.0,
            enters: if reading { "reading" } else { "mass balance" }.to_owned(),
        };
        all.push(Place { location, region });
    }
    all
}

/// A region in words, and when it is; everywhere and always where there is none.
fn in_words(findings: &Findings<'_, '_>, region: Option<&Region>) -> (String, [f64; 2]) {
    region.map_or_else(|| ("everywhere alike".to_owned(), whole(findings)), |found| (found.in_words(), found.time_s))
}

/// First and last time of all recordings.
fn whole(findings: &Findings<'_, '_>) -> [f64; 2] {
    let times = || findings.bench.records.records().iter().flat_map(|r| [r.time_s.first(), r.time_s.last()]).flatten();
    [times().copied().fold(f64::INFINITY, f64::min), times().copied().fold(f64::NEG_INFINITY, f64::max)]
}

fn volume_of(findings: &Findings<'_, '_>, channel: usize) -> String {
    findings.bench.rig.sensors.values().nth(channel).map(|s| s.volume.clone()).unwrap_or_default()
}

fn sensor_of(findings: &Findings<'_, '_>, channel: usize) -> String {
    findings.bench.rig.sensors.keys().nth(channel).cloned().unwrap_or_default()
}

pub(crate) fn channels_of(findings: &Findings<'_, '_>, component: &str) -> Vec<usize> {
    volumes_at(findings.bench.rig, component)
        .iter()
        .filter_map(|volume| channel_of(findings.bench.rig, volume))
        .collect()
}

/// The command that has to do with a component: its own, or that of a valve on its volume.
pub(crate) fn command_of(findings: &Findings<'_, '_>, component: &str) -> Option<String> {
    let rig = findings.bench.rig;
    if let Some(valve) = rig.valves.get(component) {
        return Some(valve.command.clone());
    }
    let volumes = volumes_at(rig, component);
    rig.valves
        .iter()
        .find(|(name, _)| volumes_at(rig, name).iter().any(|v| volumes.contains(v)))
        .map(|(_, valve)| valve.command.clone())
        .or_else(|| findings.bench.records.inputs().first().map(|input| input.column.clone()))
}

/// Region in which most of what is missing from some channels' balances lies.
fn region_of_missing(findings: &Findings<'_, '_>, component: &str, channels: &[usize]) -> Option<Region> {
    let energies = energies(findings, channels);
    let records = findings.bench.records;
    let stretches: Vec<Stretch<'_>> = energies
        .iter()
        .enumerate()
        .filter_map(|(record, energy)| Some(Stretch { energy, time_s: &records.records().get(record)?.time_s }))
        .collect();
    let axes = axes(findings.bench, command_of(findings, component).as_deref(), channels);
    most_telling(&stretches, &axes)
}

/// Energy of what is missing from some channels' balances beyond its own uncertainty, by recording and row.
fn energies(findings: &Findings<'_, '_>, channels: &[usize]) -> Vec<Vec<f64>> {
    let layout = findings.bench.records.layout();
    (0..layout.records())
        .map(|record| {
            let mut energy = vec![0.0; layout.rows(record)];
            for flow in findings.missing.flows.iter().filter(|f| f.record == record && channels.contains(&f.channel)) {
                for ((slot, flow), sd) in energy.iter_mut().zip(&flow.flow_kg_s).zip(&flow.sd_kg_s) {
                    *slot += (flow * flow - sd * sd).max(0.0);
                }
            }
            energy
        })
        .collect()
}
