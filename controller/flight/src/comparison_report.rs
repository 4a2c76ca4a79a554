//! Several runs on one page: their figures side by side, their curves over each other from arming on.

use proto::recording::TickRecord;
use report::{Color, Line, Panel, Plot, Report, Table};

use crate::flight_info::FlightInfo;
use crate::flight_rows::Flight;
use crate::summary::FlightSummary;
use crate::wording;

/// A run among others: its name, unlike that of every other, its ticks, and what is known about it.
#[derive(Debug, Clone, Copy)]
pub struct ComparedRun<'a> {
    /// Name.
    pub name: &'a str,
    /// Ticks in their order.
    pub ticks: &'a [TickRecord],
    /// Information from its recording.
    pub info: &'a FlightInfo,
}

/// A run laid out for tables and plots.
struct Laid<'a> {
    run: ComparedRun<'a>,
    flight: Flight<'a>,
    summary: FlightSummary,
    /// Time since the run was first under control (s), over its rows.
    time_s: Vec<f64>,
}

/// The report of several runs, as the bytes of an HTML file.
pub fn comparison_report(title: &str, runs: &[ComparedRun<'_>]) -> String {
    let laid: Vec<Laid<'_>> = runs.iter().map(lay).collect();
    let mut page = Report::new(title)
        .subtitle(&runs.iter().map(|run| run.name).collect::<Vec<_>>().join(" · "))
        .heading("Figures")
        .table(figures(&laid))
        .table(origins(&laid));
    if !laid.windows(2).all(|pair| pair[0].run.info.reference == pair[1].run.info.reference) {
        page = page.text("The runs follow different references: their errors are not those of one task.");
    }
    page = page.plot(rmse(&laid)).heading("Curves").plot(curves(&laid)).heading("Findings");
    for run in &laid {
        page = page.text(&format!("{}: {}. {}", run.run.name, run.summary.verdict.word(), run.summary.headline));
        if !run.summary.findings.is_empty() {
            page = page.list(&run.summary.findings);
        }
    }
    page.to_html()
}

fn lay<'a>(run: &ComparedRun<'a>) -> Laid<'a> {
    let flight = Flight::new(run.ticks, run.info.options);
    let armed_s = flight.rows().find(|row| row.place.steered).map_or(0.0, |row| row.place.moment.time_s);
    let time_s = flight.time_s().into_iter().map(|time_s| time_s - armed_s).collect();
    let summary = flight.statistics.summary();
    Laid { run: *run, flight, summary, time_s }
}

fn figures(runs: &[Laid<'_>]) -> Table {
    let names = runs.iter().map(|run| run.run.name.to_owned());
    let mut table = Table::new(std::iter::once("figure".to_owned()).chain(names))
        .caption("After the settling time, over the ticks in which the daemon was in control.");
    let mut row = |name: &str, of: &dyn Fn(&FlightSummary) -> String| {
        table.push(std::iter::once(name.to_owned()).chain(runs.iter().map(|run| of(&run.summary))));
    };
    row("RMSE positive (kPa)", &|s| wording::number(s.rmse_pos_kpa, 3));
    row("RMSE negative (kPa)", &|s| wording::number(s.rmse_neg_kpa, 3));
    row("feed-forward PI there, positive (kPa)", &|s| wording::number(s.fallback_rmse_pos_kpa, 3));
    row("feed-forward PI there, negative (kPa)", &|s| wording::number(s.fallback_rmse_neg_kpa, 3));
    row("largest error positive (kPa)", &|s| wording::number(s.max_abs_pos_kpa, 3));
    row("largest error negative (kPa)", &|s| wording::number(s.max_abs_neg_kpa, 3));
    row("mean error positive (kPa)", &|s| wording::signed(s.mean_error_pos_kpa, 3));
    row("mean error negative (kPa)", &|s| wording::signed(s.mean_error_neg_kpa, 3));
    row("valve movement per tick, positive (duty RMS)", &|s| wording::number(s.action_change_rms_pos_duty, 5));
    row("valve movement per tick, negative (duty RMS)", &|s| wording::number(s.action_change_rms_neg_duty, 5));
    row("seconds that count", &|s| format!("{:.1}", s.tracked_ticks as f64 / 50.0));
    row("faults", &|s| wording::count(s.faults));
    row("vented (s)", &|s| format!("{:.1}", s.vented_s));
    row("deadlines missed", &|s| wording::count(s.deadline_misses));
    row("frames that did not come", &|s| wording::count(s.frames_missing));
    row("slowest tick (ms)", &|s| wording::number(s.compute_us_max.map(|us| us / 1e3), 2));
    row("verdict", &|s| s.verdict.word().to_owned());
    table
}

fn origins(runs: &[Laid<'_>]) -> Table {
    let mut table = Table::new(["run", "started", "in control", "rig", "model", "reference"]);
    for Laid { run, .. } in runs {
        let control = run.info.policy.as_ref().map_or("feed-forward PI", |(name, _)| name);
        let info = run.info;
        let started = wording::instant(&info.started);
        table.push([run.name, &started, control, &info.rig, &info.model_rig, &info.reference]);
    }
    table
}

/// Tracking error of each run, both channels beside each other.
fn rmse(runs: &[Laid<'_>]) -> Plot {
    let kpa = |of: fn(&FlightSummary) -> Option<f64>| -> Vec<f64> {
        runs.iter().map(|run| of(&run.summary).unwrap_or(f64::NAN)).collect()
    };
    let [positive, negative] = [kpa(|s| s.rmse_pos_kpa), kpa(|s| s.rmse_neg_kpa)];
    let panel = Panel::new("RMSE (kPa)")
        .height(150.0)
        .include(0.0)
        .at_names(&[("positive", &positive, Color::Blue), ("negative", &negative, Color::Vermilion)]);
    Plot::new("Tracking error of each run", "run").x_names(runs.iter().map(|run| run.run.name)).panel(panel)
}

fn curves(runs: &[Laid<'_>]) -> Plot {
    type Of = fn(&TickRecord) -> f64;
    let columns: [(&str, Of, f64); 6] = [
        ("positive error: measured − reference (kPa)", |t| t.p_pos_kpa - t.ref_pos_kpa, 140.0),
        ("negative error: measured − reference (kPa)", |t| t.p_neg_kpa - t.ref_neg_kpa, 140.0),
        ("positive pressure (kPa gauge)", |t| t.p_pos_kpa, 170.0),
        ("negative pressure (kPa gauge)", |t| t.p_neg_kpa, 170.0),
        ("positive valve (duty)", |t| t.u_pos, 120.0),
        ("negative valve (duty)", |t| t.u_neg, 120.0),
    ];
    let mut plot = Plot::new("Runs over each other", "time since arming (s)")
        .caption("Only ticks under control. Errors are drawn to the scale of the ticks that count.");
    for (index, (label, of, height)) in columns.into_iter().enumerate() {
        let mut panel = Panel::new(label).height(height);
        let counted = runs.iter().flat_map(|run| {
            run.flight.column_where(|row| row.place.tracked, of).into_iter().filter(|value| value.is_finite())
        });
        let most = counted.fold(0.0_f64, |most, value| most.max(value.abs()));
        if index < 2 && most > 0.0 {
            panel = panel.y_range(-1.1 * most, 1.1 * most);
        }
        for run in runs {
            let values = run.flight.column_where(|row| row.place.steered, of);
            panel = panel.line(Line::new(run.run.name, &run.time_s, &values).width(1.2));
        }
        plot = plot.panel(panel);
    }
    plot
}
