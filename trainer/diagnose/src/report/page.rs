//! `report.html`.

use fit::wording::percent;
use proto::diagnosis::{Diagnosis, RigKind, Verdict};
use report::{KeyFigure, Report, Table, Verdict as Sign};

use crate::report::figures::Figures;
use crate::report::findings::Findings;
use crate::report::localization::Place;
use crate::report::summary::{noise_in_words, noise_kpa};
use crate::report::unexplained;
use crate::report::wording::{in_words, short};
use plots::{experiment, flows, regions, traces};
use tables::{found_table, horizons, hypotheses, parameters, separation, suspects, tried};

mod plots;
mod tables;

/// The page.
pub(crate) fn page(findings: &Findings<'_, '_>, diagnosis: &Diagnosis, places: &[Place], rig_toml: &str) -> String {
    let bench = findings.bench;
    // A recording that is run in pieces is one recording.
    let mut seconds: Vec<(&str, f64)> = Vec::new();
    for r in bench.records.records() {
        let own_s = r.time_s.last().unwrap_or(&0.0) - r.time_s.first().unwrap_or(&0.0);
        match seconds.iter_mut().find(|(source, _)| *source == r.source) {
            Some((_, sum)) => *sum += own_s,
            None => seconds.push((&r.source, own_s)),
        }
    }
    let sources: Vec<String> =
        seconds.iter().map(|(source, s)| format!("{} ({s:.0} s)", findings.shown_as(source))).collect();
    let mut report = Report::new(title(diagnosis.verdict, diagnosis.next_experiment.as_deref()))
        .subtitle(&format!("rig {} · {}", bench.rig.name, sources.join(", ")))
        .text(&diagnosis.summary)
        .text(&format!("Next: {}", diagnosis.next_step.why))
        .commands(diagnosis.next_step.commands.clone())
        .summary(key_figures(findings, diagnosis));
    if !diagnosis.notes.is_empty() {
        report = report.heading("About the recordings").list(diagnosis.notes.clone());
    }
    if !diagnosis.mechanisms.is_empty() {
        report = report.heading("What was found").table(found_table(&diagnosis.mechanisms));
    }
    if !diagnosis.rivals.is_empty() {
        report = report
            .heading("What these recordings cannot tell apart")
            .list(diagnosis.rivals.iter().flatten().map(|name| format!("{} ({name})", in_words(findings, name))))
            .table(hypotheses(findings));
    }
    let windows =
        if findings.given.one_second.is_empty() { "" } else { " 10 s, 1 s: started anew from smoothed readings." };
    report = report.heading("Before and after").text(&format!(
        "On validation data, rows that nothing was fitted to. Open-loop simulation: from the start of each recording, commands alone \
         decide.{windows}"
    ));
    report = report.table(horizons(findings)).plot(traces(findings));
    if !diagnosis.unexplained.is_empty() {
        report = report.heading("Unexplained residual").table(left(findings, diagnosis));
    }
    if !diagnosis.location.is_empty() {
        let undecided = diagnosis.verdict == Verdict::Undecided && diagnosis.mechanisms.is_empty();
        report = report.heading("Where the mismatch lives").list(diagnosis.location.iter().map(|l| {
            // Lengths are the steps of a coarse grid; none was found where the reading itself is in doubt.
            let scale =
                if l.time_scale_s > 0.0 { format!("; time scale about {} s", l.time_scale_s) } else { String::new() };
            let place =
                if l.component == l.side { l.component.clone() } else { format!("{} ({})", l.component, l.side) };
            // An event has its times in its own words.
            let span = if l.region.starts_with("an event") {
                String::new()
            } else {
                format!("; between {:.0} and {:.0} s", l.time_s[0], l.time_s[1])
            };
            // Rivals are alternatives: each could be all of what is off where it is.
            let at_most = if undecided { "at most " } else { "" };
            let share = percent(l.share_of_residual, 0);
            format!("{place}, {}: {at_most}{share} of it; {}{span}{scale}", l.enters, l.region)
        }));
        report = report.table(suspects(findings));
        for plot in regions(findings, places) {
            report = report.plot(plot);
        }
    }
    if let Some(plot) = flows(findings) {
        report = report.plot(plot);
    }
    report = report.heading("What was tried").table(tried(findings));
    if let Some(plan) = &findings.plan {
        report = report
            .heading("The next experiment")
            .list(plan.programmes.clone())
            .table(separation(findings))
            .plot(experiment(findings));
    }
    report.heading("Parameters of the rig").table(parameters(findings)).verbatim("rig.toml", rig_toml).to_html()
}

/// Title of the page; `experiment` is the file of the one that was planned.
fn title(verdict: Verdict, experiment: Option<&str>) -> &'static str {
    match verdict {
        Verdict::Adequate => "Nothing is missing",
        Verdict::ParametersMoved => "Only parameters moved",
        Verdict::MissingPhysics => "Missing physics found",
        Verdict::Undecided if experiment.is_some() => "Not decided yet: an experiment would tell",
        Verdict::Undecided => "Not decided: these recordings do not tell",
        Verdict::UnknownMechanism => "Something unknown is missing",
    }
}

fn key_figures(findings: &Findings<'_, '_>, diagnosis: &Diagnosis) -> Vec<KeyFigure> {
    let (noise, told) = (noise_kpa(findings.bench), noise_in_words(findings.bench));
    let figure = |label: &str, figures: &Figures| {
        let kpa = figures.total_rmse_kpa();
        let sign = if kpa < 1.15 * noise {
            Sign::Good
        } else if kpa < 2.0 * noise {
            Sign::Warning
        } else {
            Sign::Bad
        };
        KeyFigure::new(label, &format!("{kpa:.3} kPa"))
            .note(&format!("open-loop simulation, validation data; {told}"))
            .verdict(sign)
    };
    let mut all = vec![figure("As given", &findings.given), figure("Parameters fitted", &findings.reidentified)];
    if shows_extended(findings) && !matches!(diagnosis.verdict, Verdict::Adequate | Verdict::ParametersMoved) {
        all.push(figure("With what was found", &findings.extended));
    }
    all
}

/// Unexplained residual by channel, on validation data and in the recording that has much more of it in its other rows.
fn left(findings: &Findings<'_, '_>, diagnosis: &Diagnosis) -> Table {
    let mut table = Table::new(["reading", "unexplained, kPa", "noise, kPa", "times the noise", "most of it at"]);
    for u in &diagnosis.unexplained {
        let [noise, times] = unexplained::cells(u.noise_kpa, u.times_noise);
        table.push([u.channel.clone(), format!("{:.3}", u.kpa), noise, times, u.region.clone()]);
        if let Some(further) = &u.further_off {
            let [noise, times] = unexplained::cells(further.noise_kpa, further.times_noise);
            let whose = format!(
                "{} in the rows of {} that are no validation data",
                u.channel,
                findings.shown_as(&further.recording)
            );
            table.push([whose, format!("{:.3}", further.kpa), noise, times, String::new()]);
        }
    }
    table
}

/// Tells whether there is an extended rig to show.
fn shows_extended(findings: &Findings<'_, '_>) -> bool {
    findings.kind == RigKind::Extended
}

/// A rival of the judgement, for tables and legends.
fn rival_name(findings: &Findings<'_, '_>, index: usize) -> String {
    findings.judgement.rivals.get(index).map_or_else(String::new, |rival| {
        if rival.terms.is_empty() {
            return "parameters alone".to_owned();
        }
        let terms = rival.terms.iter().filter_map(|t| findings.candidates.get(*t));
        terms.map(|candidate| short(findings, candidate)).collect::<Vec<_>>().join(" + ")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of moved volumes and valves with one and the same factor no pressure tells, whatever is recorded.
    #[test]
    fn an_experiment_is_promised_only_where_one_was_planned() {
        assert!(title(Verdict::Undecided, Some("next_experiment.csv")).contains("an experiment would tell"));
        assert!(!title(Verdict::Undecided, None).contains("experiment"));
    }
}
