//! The learning curve as a page.

use report::{Color, KeyFigure, Line, Panel, Plot, Report, Table};

use crate::metrics::Point;
use crate::run::Summary;
use crate::settings::TrainingSettings;

/// Renders the page of a run.
pub fn page(settings: &TrainingSettings, summary: &Summary, points: &[Point]) -> String {
    let title = format!("Training: variant {}, {} steps", summary.variant, summary.steps);
    let mut page = Report::new(&title).subtitle(&format!(
        "{}; seed {}; {:.0} steps/s with {}, environment {:.0} % of the time; {:.0} MiB",
        summary.taken,
        summary.seed,
        summary.steps_per_s,
        if summary.threads == 1 { "1 thread".to_owned() } else { format!("{} threads", summary.threads) },
        100.0 * summary.environment_share,
        summary.memory_mib
    ));
    page = page.summary(summary.evaluated.iter().enumerate().map(|(n, e)| {
        let fallback = summary.fallback.get(n);
        let than =
            fallback.map_or(String::new(), |f| format!("; fallback {:.3} / {:.3}", f.rmse_kpa[0], f.rmse_kpa[1]));
        KeyFigure::new(&format!("RMSE on {}", e.rig), &format!("{:.3} / {:.3} kPa", e.rmse_kpa[0], e.rmse_kpa[1]))
            .note(&format!("positive / negative, paper's reference after 5 s{than}"))
    }));
    if let Some(kept) = summary.kept {
        let note = format!("after {} steps; geometric mean RMSE on randomised rigs set aside for that", kept.step);
        page = page.summary([KeyFigure::new("Best checkpoint", &format!("{:.3} kPa", kept.score_kpa)).note(&note)]);
    }
    let x: Vec<f64> = points.iter().map(|p| p.step as f64 / 1000.0).collect();
    let curve = |value: &dyn Fn(&Point) -> f64| points.iter().map(value).collect::<Vec<f64>>();
    let colors = [Color::Blue, Color::Vermilion, Color::Green, Color::Purple, Color::Black];
    let dashed =
        if summary.fallback.is_empty() { "" } else { " Dashed: the fallback on the same rig under the same noise." };
    let mut evaluation = Plot::new("Evaluated on the paper's reference", "thousand steps").caption(&format!(
        "RMSE of the measured pressures after the first 5 s, mean action, without exploration.{dashed}"
    ));
    for (c, channel) in ["positive RMSE (kPa)", "negative RMSE (kPa)"].into_iter().enumerate() {
        let mut panel = Panel::new(channel).log_y();
        for (n, e) in summary.evaluated.iter().enumerate() {
            let y = curve(&|p| p.evaluated.get(n).map_or(f64::NAN, |e| e.rmse_kpa[c]));
            let color = colors.get(n).copied().unwrap_or(Color::Black);
            panel = panel.line(Line::new(&e.rig, &x, &y).color(color));
            if let Some(f) = summary.fallback.get(n) {
                let flat = vec![f.rmse_kpa[c]; x.len()];
                panel = panel.line(Line::new(&format!("{}, fallback", e.rig), &x, &flat).color(color).dashed());
            }
        }
        evaluation = evaluation.panel(panel);
    }
    let mut change = Panel::new("duty change per tick (RMS)").log_y();
    for (n, e) in summary.evaluated.iter().enumerate() {
        for (c, name) in ["pos", "neg"].into_iter().enumerate() {
            let y = curve(&|p| p.evaluated.get(n).map_or(f64::NAN, |e| e.duty_change_rms[c]));
            let color = colors.get(2 * n + c).copied().unwrap_or(Color::Black);
            change = change.line(Line::new(&format!("{} {name}", e.rig), &x, &y).color(color));
        }
    }
    page = page.heading("Learning curve").plot(evaluation.panel(change));
    // Before the first step nothing has acted and nothing has been learned: there is no such figure, and none is drawn.
    let since = |value: &dyn Fn(&Point) -> f64| curve(&|p| if p.step > 0 { value(p) } else { f64::NAN });
    let line = |name: &str, value: &dyn Fn(&Point) -> f64, color| Line::new(name, &x, &since(value)).color(color);
    page = page.plot(
        Plot::new("While acting, with exploration, on random references", "thousand steps")
            .panel(Panel::new("mean reward").line(line("reward", &|p| p.reward, Color::Blue)))
            .panel(
                Panel::new("RMSE (kPa)")
                    .log_y()
                    .line(line("positive", &|p| p.acting_rmse_kpa[0], Color::Blue))
                    .line(line("negative", &|p| p.acting_rmse_kpa[1], Color::Vermilion)),
            ),
    );
    page = page.plot(
        Plot::new("Learning", "thousand steps")
            .panel(Panel::new("critic loss").log_y().line(line("critic", &|p| p.critic_loss, Color::Blue)))
            .panel(Panel::new("mean Q").line(line("Q", &|p| p.mean_q, Color::Blue)))
            .panel(Panel::new("temperature").log_y().line(line("α", &|p| p.temperature, Color::Blue)))
            .panel(Panel::new("entropy (nats)").line(line("entropy", &|p| p.entropy, Color::Blue)))
            .panel(Panel::new("CAPS terms").line(line("temporal", &|p| p.caps_temporal, Color::Blue)).line(line(
                "spatial",
                &|p| p.caps_spatial,
                Color::Vermilion,
            ))),
    );
    let mut table = Table::new([
        "steps",
        "rig",
        "RMSE pos (kPa)",
        "RMSE neg (kPa)",
        "offset pos (kPa)",
        "offset neg (kPa)",
        "tripped",
    ]);
    for point in points {
        for e in &point.evaluated {
            table.push([
                point.step.to_string(),
                e.rig.clone(),
                format!("{:.3}", e.rmse_kpa[0]),
                format!("{:.3}", e.rmse_kpa[1]),
                format!("{:+.3}", e.offset_kpa[0]),
                format!("{:+.3}", e.offset_kpa[1]),
                point.tripped.to_string(),
            ]);
        }
    }
    page = page.heading("Points").table(table);
    let text = settings.to_toml().unwrap_or_default();
    page.heading("Settings").verbatim("settings.toml", &text).to_html()
}
