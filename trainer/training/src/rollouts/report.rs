//! A run of rollouts as a page.

use report::{Color, KeyFigure, Line, Panel, Plot, Report, Table};

use super::outcome::{RolloutSummary, Round};
use crate::metrics::Evaluated;
use crate::settings::TrainingSettings;

/// Renders the page of a run.
pub(super) fn page(settings: &TrainingSettings, summary: &RolloutSummary) -> String {
    let kept = &summary.kept;
    let began = summary.curve.first().copied().unwrap_or(*kept);
    let mut page = Report::new(&format!("Improved by rollouts: {} rounds", summary.rounds))
        .subtitle(&format!("{}; seed {}; {:.0} s of work", summary.taken, summary.seed, summary.wall_s));
    let figure = |name: &str, rmse_kpa: [f64; 2], note: &str| {
        KeyFigure::new(name, &format!("{:.3} / {:.3} kPa", rmse_kpa[0], rmse_kpa[1])).note(note)
    };
    page = page.summary([
        figure(
            "Kept, on rigs set aside",
            kept.rmse_kpa,
            &format!("positive / negative, geometric mean of the RMSE; after round {}", kept.round),
        ),
        figure("Began with", began.rmse_kpa, "the same rigs, references and noise"),
    ]);
    if let Some(fallback_kpa) = summary.fallback_kpa {
        page = page.summary([figure("Fallback", fallback_kpa, "the same rigs, references and noise")]);
    }
    let x: Vec<f64> = summary.curve.iter().map(|r| r.round as f64).collect();
    let mut plot = Plot::new("On rigs set aside", "round").caption(
        "Geometric mean of the RMSE over randomised rigs that nothing is learned on. Dashed: the fallback. Round 0 is the \
         policy that the run began with.",
    );
    for (c, channel) in ["positive RMSE (kPa)", "negative RMSE (kPa)"].into_iter().enumerate() {
        let y: Vec<f64> = summary.curve.iter().map(|r: &Round| r.rmse_kpa[c]).collect();
        let mut panel = Panel::new(channel).log_y().line(Line::new("policy", &x, &y).color(Color::Blue));
        if let Some(fallback_kpa) = summary.fallback_kpa {
            let flat = vec![fallback_kpa[c]; x.len()];
            panel = panel.line(Line::new("fallback", &x, &flat).color(Color::Black).dashed());
        }
        plot = plot.panel(panel);
    }
    page = page.heading("Rounds").plot(plot);
    let mut table =
        Table::new(["rig", "who", "RMSE pos (kPa)", "RMSE neg (kPa)", "duty change pos", "duty change neg"]);
    for (who, e) in summary.by_rig() {
        table.push(row(who, e));
    }
    page = page.heading("On the paper's reference, after 5 s").table(table);
    page.heading("Settings").verbatim("settings.toml", &settings.to_toml().unwrap_or_default()).to_html()
}

fn row(who: &str, e: &Evaluated) -> [String; 6] {
    [
        e.rig.clone(),
        who.to_owned(),
        format!("{:.3}", e.rmse_kpa[0]),
        format!("{:.3}", e.rmse_kpa[1]),
        format!("{:.4}", e.duty_change_rms[0]),
        format!("{:.4}", e.duty_change_rms[1]),
    ]
}
