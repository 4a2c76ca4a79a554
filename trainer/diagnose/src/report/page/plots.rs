//! Plots of the page.

use model::rig::ATMOSPHERE;
use report::{Band, Color, Line, Panel, Plot, Scatter};

use super::{rival_name, shows_extended};
use crate::locate::region::{Axis, AxisKind, Region};
use crate::recordings::axes::axes;
use crate::report::figures::held_out;
use crate::report::findings::Findings;
use crate::report::localization::{Place, channels_of, command_of};

/// The 30 s in whose held-out rows the re-identified rig is worst.
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
        "{name}: the half minute in whose validation data the fitted rig is worst. Below each pressure: simulated less recorded."
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

/// The error over the quantity on which the region of each place lies, before and after; of a place without a region over the command
/// that has to do with it.
pub(super) fn regions(findings: &Findings<'_, '_>, places: &[Place]) -> Vec<Plot> {
    let mut plots = Vec::new();
    for Place { location, region } in places.iter().take(2) {
        let component = location.component.split(',').next().unwrap_or(ATMOSPHERE);
        let Some(channel) = channels_of(findings, component).first().copied() else { continue };
        let own = command_of(findings, component);
        let every_pressure: Vec<usize> = (0..findings.bench.records.sensors().len()).collect();
        let all = axes(findings.bench, own.as_deref(), &every_pressure);
        let Some(axis) = axis_of(&all, region.as_ref()) else { continue };
        let title = match region {
            Some(_) => format!("Error over {}: {}", axis.name, location.region),
            None => format!("Error over {}", axis.name),
        };
        let (label, apart) = match axis.kind {
            AxisKind::Command => (format!("{} (duty)", axis.name), "; rising and falling command apart"),
            AxisKind::Pressure => (format!("{} (kPa gauge)", axis.name), ""),
            AxisKind::SinceChange | AxisKind::SinceStart => (format!("{} (s)", axis.name), ""),
        };
        let caption = format!("Simulated less recorded, averaged over 0.2 s{apart}.");
        let mut plot = Plot::new(&title, &label).caption(&caption);
        let mut rigs = vec![("parameters fitted", &findings.reidentified)];
        if shows_extended(findings) {
            rigs.push(("with what was found", &findings.extended));
        }
        let mut reach: f64 = 0.1;
        let clouds: Vec<_> = rigs.iter().map(|(_, f)| clouds(findings, &f.trace, channel, axis)).collect();
        for (_, y, _) in clouds.first().map(|c| c.to_vec()).unwrap_or_default() {
            reach = y.iter().fold(reach, |a: f64, b: &f64| a.max(b.abs()));
        }
        for ((name, _), cloud) in rigs.iter().zip(clouds) {
            let mut panel = Panel::new(&format!("{name} (kPa)")).height(150.0).y_range(-reach, reach);
            for (x, y, (label, color)) in cloud.into_iter().filter(|(x, ..)| !x.is_empty()) {
                panel = panel.scatter(Scatter::new(label, &x, &y).color(color));
            }
            plot = plot.panel(panel);
        }
        plots.push(plot);
    }
    plots
}

type Cloud = (Vec<f64>, Vec<f64>, (&'static str, Color));

/// The axis that a region lies on; the first one, which is the place's own command, where there is no region.
fn axis_of<'a>(axes: &'a [Axis], region: Option<&Region>) -> Option<&'a Axis> {
    match region {
        Some(region) => axes.iter().find(|axis| axis.kind == region.kind && axis.name == region.name),
        None => axes.first().filter(|axis| axis.kind == AxisKind::Command),
    }
}

/// Smoothed errors over a quantity: a command's rising, falling, steady; of any other all in the last.
fn clouds(findings: &Findings<'_, '_>, trace: &[f64], channel: usize, axis: &Axis) -> [Cloud; 3] {
    const ROWS: usize = 10;
    let records = findings.bench.records;
    let layout = records.layout();
    let mut out: [Cloud; 3] = [
        (Vec::new(), Vec::new(), ("rising", Color::Vermilion)),
        (Vec::new(), Vec::new(), ("falling", Color::Blue)),
        (Vec::new(), Vec::new(), (if axis.kind == AxisKind::Command { "steady" } else { "all" }, Color::Grey)),
    ];
    for record in 0..layout.records() {
        let Some(u) = axis.values.get(record) else { continue };
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
            let slot = if axis.kind != AxisKind::Command {
                &mut out[2]
            } else if moved > 2e-3 {
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A valve's own command comes first, and the mismatch may live on the other one's, or on a pressure.
    #[test]
    fn the_axis_of_a_plot_is_that_of_its_region() {
        let axis = |kind, name: &str| Axis { kind, name: name.to_owned(), values: Vec::new() };
        let all =
            [axis(AxisKind::Command, "u_pos"), axis(AxisKind::Command, "u_neg"), axis(AxisKind::Pressure, "p_pos_kpa")];
        for of in &all {
            let region = Region {
                kind: of.kind,
                name: of.name.clone(),
                within: [0.0, 1.0],
                way: None,
                share: 0.8,
                rows: 0.1,
                time_s: [0.0, 1.0],
            };
            assert_eq!(axis_of(&all, Some(&region)).map(|axis| axis.name.as_str()), Some(of.name.as_str()));
        }
        assert_eq!(axis_of(&all, None).map(|axis| axis.name.as_str()), Some("u_pos"));
    }
}
