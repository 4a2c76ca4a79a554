//! Findings in plain words.

use proto::diagnosis::{FoundEvidence, FoundMechanism, FoundParameter, Location, Verdict};
use std::collections::BTreeMap;

use crate::candidate::Candidate;
use crate::event::Event;
use crate::heard::Heard;
use crate::locate::region::{Stretch, region};
use crate::locate::{Suspect, Suspicion};
use crate::place::volumes_at;
use crate::run::Findings;
use crate::search::position_of;

/// z of a two-sided interval of 90 %.
const NINETY: f64 = 1.645;

/// What a mechanism does, to be read after the name of the component.
fn does(id: &str) -> &'static str {
    match id {
        "valve_hysteresis" => "opens less on the way up than on the way down: it has play",
        "valve_stiction" => "sticks and then jumps instead of following small changes of its command",
        "valve_lag" => "follows its command late",
        "valve_force_curve" => "is pushed open by the pressure in another way than in proportion",
        "coil_heating" => "opens less as its coil warms",
        "supply_sag" => "sags when both coils draw current, so that each valve opens less",
        "command_delay" => "acts on a command a fixed time after it was sent",
        "chamber_leak" => "leaks to the outside even when its valve is shut",
        "cross_leak" => "lets air pass back from the positive to the negative side",
        "piston_blowby" => "loses air past its piston rings",
        "chamber_thermal" => "warms when it is filled and cools afterwards, so its pressure overshoots and creeps back",
        "volume_compliance" => "grows with its pressure",
        "volume_change" => "has another volume than stated",
        "line_resistance" => "is throttled by the line to it",
        "exhaust_restriction" => "is throttled by what is fitted to its outlet",
        "critical_ratio" => "chokes at another pressure ratio than an ideal nozzle",
        "check_valve_cracking" => "has check valves that open only above a pressure difference",
        "pump_droop" => "delivers less the more it works against",
        "dead_zone" => "passes nothing until its command has reached some level",
        "pump_speed" => "runs at another speed than stated",
        "sensor_lag" => "shows the pressure late",
        "sensor_drift" => "drifts with time",
        "sensor_bias" => "reads too much or too little by a constant",
        "sensor_gain" => "reads too much or too little in proportion",
        _ => "does something that the model leaves out",
    }
}

/// What a mechanism does where it is.
fn does_at(findings: &Findings<'_, '_>, candidate: &Candidate) -> &'static str {
    let line = findings.bench.rig.lines.contains_key(&candidate.component);
    match candidate.id.as_str() {
        "line_resistance" if line => {
            "loses more pressure than in proportion to its flow: part of it grows with the square"
        }
        id => does(id),
    }
}

/// A component in words: `valve_neg` becomes `The negative valve`.
fn called(findings: &Findings<'_, '_>, candidate: &Candidate) -> String {
    let rig = findings.bench.rig;
    let component = candidate.component.as_str();
    let kind = if rig.valves.contains_key(component) {
        "valve"
    } else if rig.sensors.contains_key(component) {
        "sensor"
    } else if rig.pumps.contains_key(component) {
        return "The pump".to_owned();
    } else if rig.volumes.contains_key(component) {
        "chamber"
    } else if rig.lines.contains_key(component) {
        return format!("The line `{component}`");
    } else {
        return if candidate.id == "supply_sag" { "The valves' supply".to_owned() } else { format!("`{component}`") };
    };
    // In a rig of other sides than the paper's two, the name in its file says more.
    match candidate.side.as_str() {
        side @ ("positive" | "negative") => format!("The {side} {kind}"),
        _ => format!("The {kind} `{component}`"),
    }
}

/// A number with three significant digits.
pub(crate) fn three(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    let magnitude = value.abs().log10().floor() as i32;
    if !(-3..6).contains(&magnitude) {
        return format!("{value:.2e}");
    }
    let digits = usize::try_from((2 - magnitude).max(0)).unwrap_or(0);
    format!("{value:.digits$}")
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
    all.extend(findings.heard.map(|heard| heard_off_the_ripple(findings, heard)));
    all.sort_by(|a, b| b.evidence.delta_log_likelihood.total_cmp(&a.evidence.delta_log_likelihood));
    all
}

/// What the pump's ripple told.
fn heard_off_the_ripple(findings: &Findings<'_, '_>, heard: &Heard) -> FoundMechanism {
    let id = heard.attached.mechanism.id();
    let [low, high] = heard.interval;
    let before = findings.reidentified.total_rmse_kpa();
    let after = findings.extended.total_rmse_kpa();
    let told = format!("{} {} ({} … {}) {}", plain(heard.key), three(heard.value), three(low), three(high), heard.unit);
    let parameter = FoundParameter { value: heard.value, unit: heard.unit.to_owned(), low, high };
    FoundMechanism {
        id: id.to_owned(),
        side: side_of_pump(findings, heard),
        component: heard.attached.component.clone(),
        summary: format!("The pump {} ({told}); this was read off its ripple: {}.", does(id), heard.shows),
        parameters: BTreeMap::from([(heard.key.to_owned(), parameter)]),
        evidence: FoundEvidence {
            delta_log_likelihood: heard.log_likelihood,
            held_out_rmse_gain: 1.0 - after / before.max(1e-9),
        },
        rivals: Vec::new(),
    }
}

fn side_of_pump(findings: &Findings<'_, '_>, heard: &Heard) -> String {
    crate::place::side(findings.bench.rig, std::slice::from_ref(&heard.attached.component))
}

/// The same mechanism on the other side.
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
        for estimate in best.fitted.estimates.iter().skip(at).take(candidate.len()) {
            let z = estimate.parameter.coordinate(estimate.value);
            let [low, high] = estimate.parameter.interval(z, NINETY * estimate.undetermined);
            let unit = estimate.parameter.unit();
            let key = estimate.parameter.path.rsplit('.').next().unwrap_or_default().to_owned();
            let value = format!("{} {} ({} … {}) {unit}", plain(&key), three(estimate.value), three(low), three(high));
            // A share or a factor has no unit.
            told.push(value.trim_end().to_owned());
            parameters.insert(key, FoundParameter { value: estimate.value, unit: unit.to_owned(), low, high });
        }
    }
    let contest = findings.judgement.contested.iter().find(|c| c.term == term);
    let before = findings.reidentified.total_rmse_kpa();
    let after = findings.extended.total_rmse_kpa();
    FoundMechanism {
        id: candidate.id.clone(),
        side: candidate.side.clone(),
        component: candidate.component.clone(),
        summary: format!("{} {} ({}).", called(findings, candidate), does_at(findings, candidate), told.join(", ")),
        parameters,
        evidence: FoundEvidence {
            delta_log_likelihood: contest.map_or(0.0, |c| c.gain),
            held_out_rmse_gain: 1.0 - after / before.max(1e-9),
        },
        rivals: contest.map(|c| c.rivals.iter().map(|k| findings.candidates[*k].name()).collect()).unwrap_or_default(),
    }
}

/// A key of the rig file without its unit and underscores.
fn plain(key: &str) -> String {
    const UNITS: [&str; 17] = [
        "_kpa_per_min",
        "_mm2_per_n2",
        "_per_mm2",
        "_kg_per_s_pa2",
        "_w_per_k",
        "_ml_per_kpa",
        "_per_bar",
        "_percent",
        "_duty",
        "_mm2",
        "_kpa",
        "_rpm",
        "_ms",
        "_ml",
        "_hz",
        "_k",
        "_s",
    ];
    let bare = UNITS.iter().find_map(|unit| key.strip_suffix(unit)).unwrap_or(key);
    bare.replace('_', " ")
}

/// The answer in one sentence, after what happened if something did.
pub(crate) fn summary(findings: &Findings<'_, '_>, mechanisms: &[FoundMechanism]) -> String {
    let answer = verdict_in_words(findings, mechanisms);
    findings.event.as_ref().map_or(answer.clone(), |event| format!("{} For the rest: {answer}", happened(event)))
}

/// An event in words.
fn happened(event: &Event) -> String {
    let [from, to] = event.time_s;
    let file =
        std::path::Path::new(&event.source).file_name().map_or(event.source.clone(), |f| f.display().to_string());
    let [inside, outside] = event.rmse_kpa;
    let span = format!("Something happened between {from:.1} and {to:.1} s of {file}");
    let off = format!("the free run is off by {inside:.2} kPa there and by {outside:.2} kPa outside");
    match &event.change {
        Some(change) => {
            let key = change.path.rsplit('.').next().unwrap_or_default();
            format!(
                "{span}, at `{}`: with a {} of {} instead of {} the squared error there falls by {:.0} %, with any other \
                 single change by {:.0} % at most ({off}).",
                change.component,
                key.replace('_', " "),
                three(change.during),
                three(change.before),
                100.0 * change.share,
                100.0 * change.next_share
            )
        }
        None => format!("{span} that no single change of the rig explains ({off})."),
    }
}

fn verdict_in_words(findings: &Findings<'_, '_>, mechanisms: &[FoundMechanism]) -> String {
    let judgement = findings.judgement;
    let before = findings.reidentified.total_rmse_kpa();
    let after = findings.extended.total_rmse_kpa();
    match judgement.verdict {
        Verdict::Adequate => {
            "The model as it stands explains these recordings to within their noise; nothing is missing.".to_owned()
        }
        Verdict::ParametersMoved => format!(
            "Nothing is missing, but the rig's parameters are not those of the file: with them fitted the free run is \
             off by {before:.2} kPa instead of {:.2} kPa. {}",
            findings.given.total_rmse_kpa(),
            moved(findings)
        ),
        Verdict::MissingPhysics => {
            let what: Vec<String> = mechanisms.iter().map(|m| m.summary.clone()).collect();
            let noise = findings.bench.noise.iter().map(|n| n.sigma_kpa.powi(2)).sum::<f64>();
            let noise = (noise / findings.bench.noise.len().max(1) as f64).sqrt();
            format!(
                "{} With this the free run is off by {after:.2} kPa instead of {before:.2} kPa (noise {noise:.2} kPa).",
                what.join(" ")
            )
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
            let figures = format!("the free run is off by {after:.2} kPa instead of {before:.2} kPa");
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
                None if stand_ins.is_empty() => String::new(),
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

/// `chamber_leak:positive` becomes `the positive chamber leaks to the outside even when its valve is shut`.
pub(crate) fn in_words(findings: &Findings<'_, '_>, name: &str) -> String {
    if name == crate::judge::MOVED {
        return "only the rig's parameters are other than stated".to_owned();
    }
    match findings.candidates.iter().find(|candidate| candidate.name() == name) {
        Some(candidate) => {
            let called = called(findings, candidate);
            let lower = called.strip_prefix("The ").map_or(called.clone(), |rest| format!("the {rest}"));
            format!("{lower} {}", does_at(findings, candidate))
        }
        None => name.to_owned(),
    }
}

/// The parameters that moved most, in words.
fn moved(findings: &Findings<'_, '_>) -> String {
    let mut estimates: Vec<_> = findings.found.nominal.fitted.estimates.iter().collect();
    estimates.retain(|e| e.undetermined < 0.7);
    estimates.sort_by(|a, b| b.shift.abs().total_cmp(&a.shift.abs()));
    let told: Vec<String> = estimates
        .iter()
        .take(3)
        .map(|e| {
            // What was stated as nothing has no share of it.
            if e.parameter.mean == 0.0 {
                return format!("{} {} {}", e.parameter.path, three(e.value), e.parameter.unit());
            }
            format!("{} {:+.1} %", e.parameter.path, 100.0 * (e.value / e.parameter.mean - 1.0))
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

/// Where the mismatch lives: first the span of an event, then what is off all along.
pub(crate) fn locations(findings: &Findings<'_, '_>) -> Vec<Location> {
    let mut all: Vec<Location> = findings.event.iter().map(|event| place_of_event(findings, event)).collect();
    all.extend(lasting(findings));
    all
}

fn place_of_event(findings: &Findings<'_, '_>, event: &Event) -> Location {
    let component = event.change.as_ref().map_or_else(|| volume_of(findings, 0), |change| change.component.clone());
    let rows = event.rows as f64;
    let all = findings.bench.records.records().iter().map(|r| r.time_s.len()).sum::<usize>() as f64;
    let [inside, outside] = event.rmse_kpa.map(|kpa| kpa * kpa);
    Location {
        side: crate::place::side(findings.bench.rig, std::slice::from_ref(&component)),
        component,
        share_of_residual: rows * inside / (rows * inside + all * outside).max(1e-12),
        region: format!("an event between {:.1} and {:.1} s", event.time_s[0], event.time_s[1]),
        time_s: event.time_s,
        time_scale_s: event.time_s[1] - event.time_s[0],
        enters: "mass balance".to_owned(),
    }
}

/// Where the mismatch lives that is there all along.
fn lasting(findings: &Findings<'_, '_>) -> Vec<Location> {
    if matches!(findings.judgement.verdict, Verdict::Adequate | Verdict::ParametersMoved) {
        return Vec::new();
    }
    // The ripple of a pump that was heard is in all readings, all the time.
    let heard = findings.heard.map(|heard| Location {
        side: side_of_pump(findings, heard),
        component: heard.attached.component.clone(),
        share_of_residual: heard.share.clamp(0.0, 1.0),
        region: "everywhere".to_owned(),
        time_s: whole(findings),
        time_scale_s: proto::recording::PERIOD_S,
        enters: "mass balance".to_owned(),
    });
    if findings.judgement.named.is_empty() && findings.judgement.verdict == Verdict::MissingPhysics {
        return heard.into_iter().collect();
    }
    let total = findings.missing.all_flows_gain.max(findings.missing.suspicions.first().map_or(0.0, |s| s.gain));
    // What is named knows its component better than a balance does.
    let named: Vec<usize> = findings.judgement.contested.iter().map(|c| c.term).collect();
    let strongest = findings.missing.suspicions.first().map_or(0.0, |s| s.gain);
    let mut all: Vec<Location> = heard.into_iter().collect();
    if named.is_empty() && findings.judgement.verdict == Verdict::Undecided {
        return places_of_rivals(findings);
    }
    if !named.is_empty() {
        let gains: f64 = findings.judgement.contested.iter().map(|c| c.gain.max(0.0)).sum();
        for contest in &findings.judgement.contested {
            let candidate = &findings.candidates[contest.term];
            let component = candidate.component.clone();
            let channels = channels_of(findings, &component);
            let (region, time_s) = words_of_region(findings, &component, &channels);
            let reading = findings.bench.rig.sensors.contains_key(&component);
            all.push(Location {
                side: candidate.side.clone(),
                component: candidate.component.clone(),
                share_of_residual: contest.gain.max(0.0) / gains.max(1e-9),
                region,
                time_s,
                time_scale_s: findings.missing.suspicions.first().map_or(0.0, |s| s.length_s),
                enters: if reading { "reading" } else { "mass balance" }.to_owned(),
            });
        }
        return all;
    }
    for suspicion in findings.missing.suspicions.iter().filter(|s| s.gain > 0.3 * strongest && s.gain > 10.0).take(2) {
        let (channels, component, enters) = match &suspicion.suspect {
            Suspect::Balance { channel } => (vec![*channel], volume_of(findings, *channel), "mass balance"),
            Suspect::Transfer { from, to } => {
                let pump = findings.bench.rig.pumps.keys().next().cloned().unwrap_or_default();
                (vec![*from, *to], pump, "mass balance")
            }
            Suspect::Reading { channel } => (vec![*channel], sensor_of(findings, *channel), "reading"),
        };
        let (region, time_s) = words_of_region(findings, &component, &channels);
        all.push(Location {
            side: crate::place::side(findings.bench.rig, std::slice::from_ref(&component)),
            component,
            share_of_residual: (suspicion.gain / total.max(1e-9)).clamp(0.0, 1.0),
            region,
            time_s,
            time_scale_s: suspicion.length_s,
            enters: enters.to_owned(),
        });
    }
    all
}

/// Where the rivals of a mere shift of parameters sit. The re-identified rig has no error left that could tell where, so
/// the given one's is looked at.
fn places_of_rivals(findings: &Findings<'_, '_>) -> Vec<Location> {
    let mut all: Vec<Location> = Vec::new();
    for candidate in findings.judgement.rivals.iter().flat_map(|r| &r.terms).filter_map(|t| findings.candidates.get(*t))
    {
        if all.iter().any(|known| known.component == candidate.component) {
            continue;
        }
        let channels = channels_of(findings, &candidate.component);
        let squares = |channel: usize| findings.given.free.get(channel).map_or(0.0, |e| e.rmse_kpa.powi(2));
        let total: f64 = (0..findings.given.free.len()).map(squares).sum();
        let reading = findings.bench.rig.sensors.contains_key(&candidate.component);
        all.push(Location {
            side: candidate.side.clone(),
            component: candidate.component.clone(),
            share_of_residual: channels.iter().map(|c| squares(*c)).sum::<f64>() / total.max(1e-12),
            region: "everywhere".to_owned(),
            time_s: whole(findings),
            time_scale_s: 0.0,
            enters: if reading { "reading" } else { "mass balance" }.to_owned(),
        });
    }
    all
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

fn channels_of(findings: &Findings<'_, '_>, component: &str) -> Vec<usize> {
    volumes_at(findings.bench.rig, component)
        .iter()
        .filter_map(|volume| crate::place::channel_of(findings.bench.rig, volume))
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

fn words_of_region(findings: &Findings<'_, '_>, component: &str, channels: &[usize]) -> (String, [f64; 2]) {
    let Some(command) = command_of(findings, component) else { return ("everywhere".to_owned(), [0.0, 0.0]) };
    let energies = energies(findings, channels);
    let records = findings.bench.records;
    let stretches: Vec<Stretch<'_>> = energies
        .iter()
        .enumerate()
        .filter_map(|(record, energy)| {
            let r = records.records().get(record)?;
            Some(Stretch { energy, command: records.input(record, &command)?, time_s: &r.time_s })
        })
        .collect();
    match region(&stretches) {
        Some(found) => (found.in_words(&command), found.time_s),
        None => ("everywhere".to_owned(), [0.0, 0.0]),
    }
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
