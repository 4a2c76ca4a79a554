//! A page with everything a report can hold: `cargo run -p report --example gallery > gallery.html`.
//!
//! The data are made up by formula; the page is there to be looked at.

use report::{Band, Color, Histogram, KeyFigure, Line, Panel, Plot, Report, Scatter, Table, Verdict};

fn main() {
    let time_s: Vec<f64> = (0..3_000).map(|k| f64::from(k) / 50.0).collect();
    let wave = |period_s: f64, shift: f64| -> Vec<f64> {
        time_s.iter().map(|t| (std::f64::consts::TAU * (t - shift) / period_s).sin()).collect()
    };
    let noise = noise(3_000);
    let combine =
        |f: &dyn Fn(usize, f64) -> f64| -> Vec<f64> { time_s.iter().enumerate().map(|(k, t)| f(k, *t)).collect() };
    let (slow, late) = (wave(8.0, 0.0), wave(8.0, 0.06));
    let (slow_neg, late_neg) = (wave(10.0, 0.0), wave(10.0, 0.05));
    let ref_pos = combine(&|k, t| 80.0 + t / 3.0 + 6.0 * slow[k]);
    let ref_neg = combine(&|k, t| -70.0 - t / 12.0 + 3.0 * slow_neg[k]);
    // One second without a sensor, and one spike of a single tick.
    let measured_pos = combine(&|k, t| match k {
        1_500..1_550 => f64::NAN,
        2_222 => 112.0,
        _ => 80.0 + t / 3.0 + 6.0 * late[k] - 4.0 * (-t).exp() + 0.15 * noise[k],
    });
    let measured_neg = combine(&|k, t| -70.0 - t / 12.0 + 3.0 * late_neg[k] + 2.0 * (-t).exp() + 0.06 * noise[k]);
    let error = |a: &[f64], b: &[f64]| -> Vec<f64> { a.iter().zip(b).map(|(a, b)| a - b).collect() };
    let (error_pos, error_neg) = (error(&measured_pos, &ref_pos), error(&measured_neg, &ref_neg));
    let u_pos = combine(&|k, _| 0.78 - 0.05 * late[k] + 0.004 * noise[k]);
    let u_neg = combine(&|k, _| 0.84 + 0.03 * late_neg[k] + 0.004 * noise[k]);
    let predicted = combine(&|k, _| measured_pos[k] + 0.1 * noise[(k + 700) % 3_000]);
    let low: Vec<f64> = predicted.iter().map(|p| p - 1.2).collect();
    let high: Vec<f64> = predicted.iter().map(|p| p + 1.2).collect();
    let compute_us: Vec<f64> = noise
        .iter()
        .enumerate()
        .map(|(k, n)| 310.0 * (0.08 * n).exp() * if k % 331 == 0 { 9.0 } else { 1.0 })
        .collect();

    let page = Report::new("Gallery: 60 s on a made-up rig")
        .subtitle("2026-11-20 02:04:05 UTC · controller 0.1.0 · policy default <ab12cd34>")
        .summary([
            KeyFigure::new("RMSE positive", "0.41 kPa").note("limit 0.60 kPa").verdict(Verdict::Good),
            KeyFigure::new("RMSE negative", "0.24 kPa").note("limit 0.25 kPa").verdict(Verdict::Warning),
            KeyFigure::new("Missed deadlines", "3 of 3000").note("limit 0").verdict(Verdict::Bad),
            KeyFigure::new("Compute p99.9", "2.8 ms").note("14 % of a tick"),
        ])
        .text("The positive pressure follows its reference with a lag of three ticks; the sensor was gone for one second at 30 s.")
        .list(["a point & its <escape>", "another point"])
        .heading("Result")
        .table(
            Table::new(["channel", "RMSE (kPa)", "worst (kPa)", "share of time within 1 kPa"])
                .row(["positive", "0.41", "−4.02", "97.1 %"])
                .row(["negative", "0.24", "2.01", "99.8 %"])
                .caption("After the first 5 s."),
        )
        .heading("Plots")
        .plot(
            Plot::new("References, pressures, errors, duties", "time (s)")
                .caption("Four panels over one time axis; the gap at 30 s is the missing sensor, the spike at 44.4 s is one tick long.")
                .panel(
                    Panel::new("positive (kPa gauge)")
                        .span("sensor gone", 30.0, 31.0, Color::Red)
                        .line(Line::new("reference", &time_s, &ref_pos).color(Color::Black).dashed())
                        .line(Line::new("measured", &time_s, &measured_pos).color(Color::Blue))
                        .level("soft limit 115 kPa", 115.0, Color::Red),
                )
                .panel(
                    Panel::new("negative (kPa gauge)")
                        .line(Line::new("reference", &time_s, &ref_neg).color(Color::Black).dashed())
                        .line(Line::new("measured", &time_s, &measured_neg).color(Color::Vermilion)),
                )
                .panel(
                    Panel::new("error (kPa)")
                        .height(130.0)
                        .y_range(-3.0, 3.0)
                        .line(Line::new("positive", &time_s, &error_pos).color(Color::Blue))
                        .line(Line::new("negative", &time_s, &error_neg).color(Color::Vermilion)),
                )
                .panel(
                    Panel::new("valve duty (0 … 1)")
                        .height(130.0)
                        .line(Line::new("positive", &time_s, &u_pos).color(Color::Blue).stepped())
                        .line(Line::new("negative", &time_s, &u_neg).color(Color::Vermilion).stepped()),
                ),
        )
        .plot(
            Plot::new("Prediction against what came", "time (s)").x_range(20.0, 24.0).panel(
                Panel::new("positive (kPa gauge)")
                    .y_range(80.0, 98.0)
                    .band(Band::new("predicted ± 2 σ", &time_s, &low, &high).color(Color::Green))
                    .line(Line::new("predicted 5 ticks ahead", &time_s, &predicted).color(Color::Green))
                    .scatter(Scatter::new("measured", &time_s, &measured_pos).color(Color::Blue))
                    .moment("policy swapped", 22.0, Color::Purple),
            ),
        )
        .plot(
            Plot::new("Time to compute a tick", "time (µs)").log_x().panel(
                Panel::new("ticks")
                    .log_y()
                    .bars("3,000 ticks", Histogram::logarithmic(&compute_us, 60))
                    .moment("p99.9", 2_800.0, Color::Black)
                    .moment("deadline 14 ms", 14_000.0, Color::Red),
            ),
        )
        .plot(
            Plot::new("Eight series and long names", "step")
                .panel((1..=8).fold(Panel::new("return").height(150.0), |panel, k| {
                    let x: Vec<f64> = (0..=40).map(f64::from).collect();
                    let y: Vec<f64> = x.iter().map(|x| 1_000.0 * (1.0 - (-x / f64::from(k * 4)).exp())).collect();
                    panel.line(Line::new(&format!("seed {k} of eight, learning rate 0.000{k}"), &x, &y))
                })),
        )
        .heading("Configuration")
        .verbatim("controller.toml", "[link]\naddress = \"192.168.1.20:50500\"   # <the cRIO>\n")
        .to_html();
    print!("{page}");
}

/// Repeatable noise of about unit size: sums of a linear congruential generator's draws.
fn noise(points: usize) -> Vec<f64> {
    let mut state = 1_u64;
    let mut uniform = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    (0..points).map(|_| (0..12).map(|_| uniform()).sum::<f64>() - 6.0).collect()
}
