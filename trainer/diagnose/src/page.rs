//! `report.html`.

use model::rig::ATMOSPHERE;
use proto::diagnosis::{Diagnosis, Verdict};
use report::{Band, Color, KeyFigure, Line, Panel, Plot, Report, Scatter, Table, Verdict as Sign};

use crate::figures::{Figures, held_out};
use crate::judge::MOVED;
use crate::locate::Suspect;
use crate::run::Findings;
use crate::words::{command_of, in_words, three};

/// The page.
pub(crate) fn page(findings: &Findings<'_, '_>, diagnosis: &Diagnosis, rig_toml: &str) -> String {
    let bench = findings.bench;
    let sources: Vec<String> = bench
        .records
        .records()
        .iter()
        .map(|r| {
            let name = r.source.rsplit(['/', '\\']).next().unwrap_or(&r.source).to_owned();
            let seconds = r.time_s.last().unwrap_or(&0.0) - r.time_s.first().unwrap_or(&0.0);
            format!("{name} ({seconds:.0} s)")
        })
        .collect();
    let mut report = Report::new(title(diagnosis))
        .subtitle(&format!("rig {} · {}", bench.rig.name, sources.join(", ")))
        .text(&diagnosis.summary)
        .summary(key_figures(findings, diagnosis));
    if !diagnosis.notes.is_empty() {
        report = report.heading("About the recordings").list(diagnosis.notes.clone());
    }
    if !diagnosis.mechanisms.is_empty() {
        report = report.heading("What was found").table(found_table(diagnosis));
    }
    if !diagnosis.rivals.is_empty() {
        report = report
            .heading("What these recordings cannot tell apart")
            .list(diagnosis.rivals.iter().flatten().map(|name| format!("{name}: {}", in_words(findings, name))));
    }
    let windows =
        if findings.given.one_second.is_empty() { "" } else { " 10 s, 1 s: started anew from smoothed readings." };
    report = report.heading("Before and after").text(&format!(
        "Rows that nothing was fitted to. Free run: from the start of each recording, commands alone decide.{windows}"
    ));
    report = report.table(horizons(findings)).plot(traces(findings));
    if !diagnosis.location.is_empty() {
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
            format!("{place}, {}: {:.0} % of it; {}{span}{scale}", l.enters, 100.0 * l.share_of_residual, l.region)
        }));
        report = report.table(suspects(findings));
        for plot in regions(findings, diagnosis) {
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

fn title(diagnosis: &Diagnosis) -> &'static str {
    match diagnosis.verdict {
        Verdict::Adequate => "Nothing is missing",
        Verdict::ParametersMoved => "Only parameters moved",
        Verdict::MissingPhysics => "Missing physics found",
        Verdict::Undecided => "Not decided yet: an experiment would tell",
        Verdict::UnknownMechanism => "Something unknown is missing",
    }
}

fn key_figures(findings: &Findings<'_, '_>, diagnosis: &Diagnosis) -> Vec<KeyFigure> {
    let noise = findings.bench.noise.iter().map(|n| n.sigma_kpa.powi(2)).sum::<f64>()
        / findings.bench.noise.len().max(1) as f64;
    let noise = noise.sqrt();
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
            .note(&format!("free run, held out; noise {noise:.3} kPa"))
            .verdict(sign)
    };
    let mut all = vec![figure("As given", &findings.given), figure("Parameters fitted", &findings.reidentified)];
    if shows_extended(findings) && !matches!(diagnosis.verdict, Verdict::Adequate | Verdict::ParametersMoved) {
        all.push(figure("With what was found", &findings.extended));
    }
    all
}

fn found_table(diagnosis: &Diagnosis) -> Table {
    let mut table =
        Table::new(["mechanism", "where", "parameter", "value", "90 % interval", "unit", "gain in log-likelihood"]);
    for m in &diagnosis.mechanisms {
        for (at, (name, p)) in m.parameters.iter().enumerate() {
            // What belongs to the mechanism as a whole stands once.
            let once = |text: String| if at == 0 { text } else { String::new() };
            table.push([
                once(m.id.clone()),
                once(m.component.clone()),
                name.clone(),
                three(p.value),
                format!("{} … {}", three(p.low), three(p.high)),
                p.unit.clone(),
                once(format!("{:+.0}", m.evidence.delta_log_likelihood)),
            ]);
        }
    }
    table
}

/// Whether there is an extended rig to show.
fn shows_extended(findings: &Findings<'_, '_>) -> bool {
    findings.unknown.is_some() || !findings.found.best.terms.is_empty()
}

fn horizons(findings: &Findings<'_, '_>) -> Table {
    // A quick search leaves the windows out.
    let windows = !findings.given.one_second.is_empty();
    let mut head = vec!["RMSE in kPa", "rig", "free run"];
    if windows {
        head.extend(["10 s", "1 s"]);
    }
    head.push("accuracy, free run");
    let mut table = Table::new(head);
    for (channel, column) in findings.bench.records.sensors().iter().enumerate() {
        let mut rigs = vec![("as given", &findings.given), ("parameters fitted", &findings.reidentified)];
        if shows_extended(findings) {
            rigs.push(("with what was found", &findings.extended));
        }
        for (at, (name, f)) in rigs.into_iter().enumerate() {
            let mut row = vec![if at == 0 { column.clone() } else { String::new() }, name.to_owned()];
            let horizons = [&f.free, &f.ten_seconds, &f.one_second];
            for errors in horizons.into_iter().take(if windows { 3 } else { 1 }) {
                row.push(errors.get(channel).map_or(String::new(), |e| format!("{:.3}", e.rmse_kpa)));
            }
            let accuracy = f.accuracy.get(channel).copied().filter(|a| a.is_finite());
            row.push(accuracy.map_or(String::new(), |a| format!("{:.2} %", 100.0 * a)));
            table.push(row);
        }
    }
    table
}

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

fn traces(findings: &Findings<'_, '_>) -> Plot {
    let records = findings.bench.records;
    let layout = records.layout();
    let (record, rows) = window(findings);
    let r = records.records().get(record);
    let time_s: Vec<f64> = r.and_then(|r| r.time_s.get(rows.clone())).unwrap_or_default().to_vec();
    let name = r.map_or("", |r| r.source.rsplit('/').next().unwrap_or_default());
    let mut plot = Plot::new("Recorded, and simulated from the commands alone", "time (s)").caption(&format!(
        "{name}: the held-out stretch on which the fitted rig is worst. Below each pressure: simulated less recorded."
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

fn suspects(findings: &Findings<'_, '_>) -> Table {
    let volume = |channel: &usize| {
        findings.bench.rig.sensors.values().nth(*channel).map_or_else(String::new, |s| s.volume.clone())
    };
    let mut table = Table::new(["switched on alone", "gain in log-likelihood", "time scale (s)", "size"]).caption(
        "Each equation given a free error of its own, one at a time: which one mends the most? An error that may be \
         anything at any time gains far more than a mechanism can. Time scales and sizes are the best of a coarse grid.",
    );
    for s in &findings.missing.suspicions {
        let (name, unit) = match &s.suspect {
            Suspect::Balance { channel } => (format!("mass balance, {}", volume(channel)), "kPa/s"),
            Suspect::Transfer { from, to } => (format!("pump flow {} → {}", volume(from), volume(to)), "kPa/s"),
            Suspect::Reading { channel } => (format!("reading, {}", volume(channel)), "kPa"),
        };
        table.push([name, format!("{:+.0}", s.gain), s.length_s.to_string(), format!("{} {unit}", s.size)]);
    }
    table
}

/// The error over the command of each named place, rising and falling apart, before and after.
fn regions(findings: &Findings<'_, '_>, diagnosis: &Diagnosis) -> Vec<Plot> {
    let mut plots = Vec::new();
    for location in diagnosis.location.iter().take(2) {
        let component = location.component.split(',').next().unwrap_or(ATMOSPHERE);
        let Some(command) = command_of(findings, component) else { continue };
        let volumes = crate::place::volumes_at(findings.bench.rig, component);
        let Some(channel) = volumes.iter().find_map(|v| crate::place::channel_of(findings.bench.rig, v)) else {
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
            // A little beyond the largest, whose dot would be cut in half.
            reach = y.iter().fold(reach, |a: f64, b: &f64| a.max(1.04 * b.abs()));
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
fn flows(findings: &Findings<'_, '_>) -> Option<Plot> {
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

fn tried(findings: &Findings<'_, '_>) -> Table {
    let mut table = Table::new(["on top of", "mechanism", "gain in log-likelihood", ""]).caption(
        "The best candidates of each round. Gains are those of a short fit, on the fitted rows and prior included; the \
         first was then fitted to the end.",
    );
    let name = |k: &usize| findings.candidates.get(*k).map_or_else(String::new, crate::candidate::Candidate::full_name);
    for round in &findings.found.rounds {
        let base = if round.base.is_empty() {
            "parameters alone".to_owned()
        } else {
            round.base.iter().map(name).collect::<Vec<_>>().join(" + ")
        };
        for (at, ranked) in round.ranked.iter().take(6).enumerate() {
            let taken = match (at, round.taken) {
                (0, true) => "taken",
                (0, false) => "below the bar",
                _ => "",
            };
            table.push([base.clone(), name(&ranked.candidate), format!("{:+.1}", ranked.gain), taken.to_owned()]);
        }
    }
    table
}

fn rival_name(findings: &Findings<'_, '_>, index: usize) -> String {
    findings.judgement.rivals.get(index).map_or_else(String::new, |rival| {
        if rival.terms.is_empty() {
            return MOVED.to_owned();
        }
        rival
            .terms
            .iter()
            .filter_map(|t| findings.candidates.get(*t))
            .map(crate::candidate::Candidate::full_name)
            .collect::<Vec<_>>()
            .join(" + ")
    })
}

fn separation(findings: &Findings<'_, '_>) -> Table {
    let mut table = Table::new(["one", "other", "expected difference in log-likelihood"])
        .caption("How far apart the experiment will drive them, all that either could still adjust allowed for.");
    if let Some(plan) = &findings.plan {
        for (one, other, half_d) in &plan.separation {
            table.push([rival_name(findings, *one), rival_name(findings, *other), format!("{half_d:.0}")]);
        }
    }
    table
}

fn experiment(findings: &Findings<'_, '_>) -> Plot {
    let mut plot = Plot::new("Commands, and what each rival predicts", "time (s)");
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

fn parameters(findings: &Findings<'_, '_>) -> Table {
    let extended = shows_extended(findings);
    let mut head = vec!["parameter", "given", "fitted", "± sd", "shift"];
    let mut caption = "Shift: fitted less given, in standard deviations of what was known before.".to_owned();
    if extended {
        head.extend(["found", "± sd"]);
        caption.push_str(" Found: fitted again together with what was found.");
    }
    head.push("unit");
    let mut table = Table::new(head).caption(&caption);
    let best = &findings.found.best;
    for (at, e) in findings.found.nominal.fitted.estimates.iter().enumerate() {
        let mut row = vec![
            e.parameter.path.clone(),
            three(e.parameter.mean),
            three(e.value),
            three(e.sd),
            format!("{:+.1}", e.shift),
        ];
        if extended {
            let again = best.fitted.estimates.get(at);
            row.push(again.map_or(String::new(), |e| three(e.value)));
            row.push(again.map_or(String::new(), |e| three(e.sd)));
        }
        row.push(e.parameter.unit().to_owned());
        table.push(row);
    }
    table
}
