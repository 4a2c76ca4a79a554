//! Plots of the page.

use model::rig::ATMOSPHERE;
use proto::diagnosis::Diagnosis;
use report::{Band, Color, Line, Panel, Plot, Scatter};

use super::{rival_name, shows_extended};
use crate::report::figures::held_out;
use crate::report::findings::Findings;
use crate::report::localization::command_of;

/// The 30 held-out seconds on which the re-identified rig is worst.
fn window(findings: &Findings<'_, '_>) -> (usize, std::ops::Range<usize>) {
    const ROWS: usize = 1500;
    let layout = findings.bench.records.layout();
    let weights = held_out(findings.bench);
    let readings = findings.bench.records.readings_kpa();
    let mut best = (f64::NEG_INFINITY, 0, 0..0);
    for record in 0..layout.records() {
        let rows = layout.rows(record);
        for start in (0..rows.saturating_sub(ROWS / 2)).step_by(250) {
            let range = start..(start + ROWS).min(rows);
            let mut sum = 0.0;
            for channel in 0..layout.channels() {
                for i in layout.stretch(record, channel, range.clone()) {
                    let off = findings.reidentified.trace.get(i).unwrap_or(&0.0) - readings.get(i).unwrap_or(&0.0);
                    sum += off * off * weights.get(i).unwrap_or(&0.0);
                }
            }
            if sum > best.0 {
                best = (sum, record, range);
            }
        }
    }
    (best.1, best.2)
}

pub(super) fn traces(findings: &Findings<'_, '_>) -> Plot {
    let records = findings.bench.records;
    let layout = records.layout();
    let (record, rows) = window(findings);
    let r = records.records().get(record);
    let time_s: Vec<f64> = r.and_then(|r| r.time_s.get(rows.clone())).unwrap_or_default().to_vec();
    let name = r.map_or_else(String::new, |r| findings.shown_as(&r.source));
    let mut plot = Plot::new("Recorded, and simulated from the commands alone", "time (s)").caption(&format!(
        "{name}: the stretch of validation data on which the fitted rig is worst. Below each pressure: simulated less recorded."
    ));
    for (channel, column) in records.sensors().iter().enumerate() {
        let cut = |trace: &[f64]| -> Vec<f64> {
            trace.get(layout.stretch(record, channel, rows.clone())).unwrap_or_default().to_vec()
        };
        let recorded = cut(records.readings_kpa());
        let error = |trace: &[f64]| -> Vec<f64> { cut(trace).iter().zip(&recorded).map(|(s, r)| s - r).collect() };
        let extended = shows_extended(findings);
        let mut pressures = Panel::new(&format!("{column} (kPa gauge)"))
            // Wide, so that it is seen behind a simulation that lies on it.
            .line(Line::new("recorded", &time_s, &recorded).color(Color::Black).width(3.6))
            .line(Line::new("as given", &time_s, &cut(&findings.given.trace)).color(Color::Grey))
            .line(Line::new("parameters fitted", &time_s, &cut(&findings.reidentified.trace)).color(Color::Vermilion));
        let mut errors = Panel::new("error (kPa)").height(120.0).line(
            Line::new("parameters fitted", &time_s, &error(&findings.reidentified.trace)).color(Color::Vermilion),
        );
        if extended {
            pressures = pressures
                .line(Line::new("with what was found", &time_s, &cut(&findings.extended.trace)).color(Color::Blue));
            errors = errors
                .line(Line::new("with what was found", &time_s, &error(&findings.extended.trace)).color(Color::Blue));
        }
        plot = plot.panel(pressures).panel(errors.level("", 0.0, Color::Grey));
    }
    plot
}

/// The error over the command of each named place, rising and falling apart, before and after.
pub(super) fn regions(findings: &Findings<'_, '_>, diagnosis: &Diagnosis) -> Vec<Plot> {
    let mut plots = Vec::new();
    for location in diagnosis.location.iter().take(2) {
        let component = location.component.split(',').next().unwrap_or(ATMOSPHERE);
        let Some(command) = command_of(findings, component) else { continue };
        let volumes = crate::search::place::volumes_at(findings.bench.rig, component);
        let Some(channel) = volumes.iter().find_map(|v| crate::search::place::channel_of(findings.bench.rig, v)) else {
            continue;
        };
        let mut plot = Plot::new(&format!("Error over {command}: {}", location.region), &format!("{command} (duty)"))
            .caption("Simulated less recorded, averaged over 0.2 s; rising and falling command apart.");
        let mut rigs = vec![("parameters fitted", &findings.reidentified)];
        if shows_extended(findings) {
            rigs.push(("with what was found", &findings.extended));
        }
        let mut reach: f64 = 0.1;
        let clouds: Vec<_> = rigs.iter().map(|(_, f)| clouds(findings, &f.trace, channel, &command)).collect();
        for (_, y, _) in clouds.first().map(|c| c.to_vec()).unwrap_or_default() {
            reach = y.iter().fold(reach, |a: f64, b: &f64| a.max(b.abs()));
        }
        for ((name, _), cloud) in rigs.iter().zip(clouds) {
            let mut panel = Panel::new(&format!("{name} (kPa)")).height(150.0).y_range(-reach, reach);
            for (x, y, (label, color)) in cloud {
                panel = panel.scatter(Scatter::new(label, &x, &y).color(color));
            }
            plot = plot.panel(panel);
        }
        plots.push(plot);
    }
    plots
}

type Cloud = (Vec<f64>, Vec<f64>, (&'static str, Color));

/// Smoothed errors over a command: rising, falling, steady.
fn clouds(findings: &Findings<'_, '_>, trace: &[f64], channel: usize, command: &str) -> [Cloud; 3] {
    const ROWS: usize = 10;
    let records = findings.bench.records;
    let layout = records.layout();
    let mut out: [Cloud; 3] = [
        (Vec::new(), Vec::new(), ("rising", Color::Vermilion)),
        (Vec::new(), Vec::new(), ("falling", Color::Blue)),
        (Vec::new(), Vec::new(), ("steady", Color::Grey)),
    ];
    for record in 0..layout.records() {
        let Some(u) = records.input(record, command) else { continue };
        let range = layout.channel(record, channel);
        let simulated = trace.get(range.clone()).unwrap_or_default();
        let recorded = records.readings_kpa().get(range).unwrap_or_default();
        // One point in three: the eye sees no more.
        for (k, ((s, r), u)) in simulated.chunks(ROWS).zip(recorded.chunks(ROWS)).zip(u.chunks(ROWS)).enumerate() {
            if k % 3 != 0 || s.len() < ROWS {
                continue;
            }
            let error = s.iter().zip(r).map(|(s, r)| s - r).sum::<f64>() / ROWS as f64;
            let moved = u.last().unwrap_or(&0.0) - u.first().unwrap_or(&0.0);
            let slot = if moved > 2e-3 {
                &mut out[0]
            } else if moved < -2e-3 {
                &mut out[1]
            } else {
                &mut out[2]
            };
            slot.0.push(u.iter().sum::<f64>() / ROWS as f64);
            slot.1.push(error);
        }
    }
    out
}

/// Missing flows with their uncertainty, over the window of the traces.
pub(super) fn flows(findings: &Findings<'_, '_>) -> Option<Plot> {
    let (record, rows) = window(findings);
    let r = findings.bench.records.records().get(record)?;
    let time_s = r.time_s.get(rows.clone())?;
    let mut plot = Plot::new("Missing mass flow, reconstructed", "time (s)").caption(
        "What would have to flow into each chamber on top of the fitted rig's flows (Kalman smoother, band: two \
         standard deviations). A band around zero means that nothing is missing.",
    );
    let mut any = false;
    for flow in findings.missing.flows.iter().filter(|f| f.record == record) {
        let (Some(mean), Some(sd)) = (flow.flow_kg_s.get(rows.clone()), flow.sd_kg_s.get(rows.clone())) else {
            continue;
        };
        let mg: Vec<f64> = mean.iter().map(|v| 1e6 * v).collect();
        let low: Vec<f64> = mean.iter().zip(sd).map(|(m, s)| 1e6 * (m - 2.0 * s)).collect();
        let high: Vec<f64> = mean.iter().zip(sd).map(|(m, s)| 1e6 * (m + 2.0 * s)).collect();
        let color = if flow.channel == 0 { Color::Blue } else { Color::Vermilion };
        let name = findings.bench.rig.sensors.values().nth(flow.channel).map_or("", |s| s.volume.as_str());
        plot = plot.panel(
            Panel::new(&format!("into {name} (mg/s)"))
                .height(140.0)
                .band(Band::new("± 2 sd", time_s, &low, &high).color(color))
                .line(Line::new("missing", time_s, &mg).color(color))
                .level("", 0.0, Color::Grey),
        );
        any = true;
    }
    any.then_some(plot)
}

pub(super) fn experiment(findings: &Findings<'_, '_>) -> Plot {
    let mut plot = Plot::new("Commands, and what each competing hypothesis predicts", "time (s)");
    let Some(plan) = &findings.plan else { return plot };
    let time_s = plan.time_s();
    let rows = time_s.len();
    let mut commands = Panel::new("commands").height(110.0);
    for (name, values) in plan.columns.iter().zip(&plan.inputs) {
        commands = commands.line(Line::new(name, &time_s, values).stepped());
    }
    plot = plot.panel(commands);
    for (channel, column) in findings.bench.records.sensors().iter().enumerate() {
        let of = |trace: &Vec<f64>| trace.get(channel * rows..(channel + 1) * rows).unwrap_or_default().to_vec();
        let mut panel = Panel::new(&format!("{column} (kPa gauge)"));
        // What tells rivals apart is small beside the pressures: shown again, less the first one's.
        let mut apart = Panel::new(&format!("less {} (kPa)", rival_name(findings, 0))).height(110.0);
        let first = plan.predicted_kpa.first().map(of).unwrap_or_default();
        for (rival, trace) in plan.predicted_kpa.iter().enumerate().take(5) {
            let (name, values) = (rival_name(findings, rival), of(trace));
            let less: Vec<f64> = values.iter().zip(&first).map(|(v, f)| v - f).collect();
            panel = panel.line(Line::new(&name, &time_s, &values));
            apart = apart.line(Line::new(&name, &time_s, &less));
        }
        plot = plot.panel(panel).panel(apart);
    }
    plot
}
