//! The plots of a flight's report.

use proto::recording::{Arrival, TickRecord};
use report::{Color, Histogram, Line, Panel, Plot, Scatter};

use crate::flight_rows::Flight;
use crate::prediction_check::{PredictionCheck, rms, rolling_rms, worst_window};
use crate::statistics::{Pacing, Stage};
use crate::wording;

/// Count, name, choice of ticks, and colour.
type Mark = (u64, &'static str, fn(&TickRecord) -> bool, Color);

/// Colours of the positive and the negative channel, everywhere.
pub(crate) const CHANNEL: [Color; 2] = [Color::Blue, Color::Vermilion];
/// Length of the close-up of the predictions (rows of 20 ms): 1.5 s, in which 5 ticks are wide enough to see.
const CLOSE_UP: usize = 75;
/// Height of a panel around zero: five marked values, so that there is always one on both sides of 0.
const CENTERED: f64 = 132.0;
/// Bins per decade of the tick times: 10 % wide.
const BINS_PER_DECADE: f64 = 24.0;

/// References, pressures, errors, duties.
pub(crate) fn pressures(flight: &Flight<'_>) -> Plot {
    let time_s = flight.time_s();
    let (ref_pos, ref_neg) = (flight.column(|tick| tick.ref_pos_kpa), flight.column(|tick| tick.ref_neg_kpa));
    let (p_pos, p_neg) = (flight.column(|tick| tick.p_pos_kpa), flight.column(|tick| tick.p_neg_kpa));
    let pressure = |name: &str, measured: &[f64], reference: &[f64], color: Color, names: Names| {
        let panel = marked(Panel::new(name).height(175.0), flight, names);
        let panel = match around(&[measured, reference], &flight.tracked(), 0.5) {
            Some((low, high)) => panel.y_range(low, high),
            None => panel,
        };
        panel
            .line(Line::new("measured", &time_s, measured).color(color))
            .line(Line::new("reference", &time_s, reference).color(Color::Black).dashed())
    };
    let error = |name: &str, measured: &[f64], reference: &[f64], color: Color| {
        let error: Vec<f64> = measured.iter().zip(reference).map(|(p, r)| p - r).collect();
        let panel = marked(Panel::new(name).height(CENTERED), flight, Names::Untold).level("", 0.0, Color::Grey);
        let panel = match scale(&error, &flight.tracked()) {
            Some(most) => panel.y_range(-most, most),
            None => panel,
        };
        panel.line(Line::new("", &time_s, &error).color(color).width(1.1))
    };
    let (u_pos, u_neg) = (flight.column(|tick| tick.u_pos), flight.column(|tick| tick.u_neg));
    let duty =
        marked(Panel::new("valve duty sent (1 = vent open)").height(130.0).y_range(-0.02, 1.04), flight, Names::Untold)
            .line(Line::new("positive", &time_s, &u_pos).color(CHANNEL[0]).stepped())
            .line(Line::new("negative", &time_s, &u_neg).color(CHANNEL[1]).stepped());
    spanned(Plot::new("Pressures, errors and valves", "time of the run (s)"), flight)
        .caption("Pressures and errors are drawn to the scale of the ticks that count; what lies beyond, as the first rise does, is cut off.")
        .panel(pressure("positive pressure (kPa gauge)", &p_pos, &ref_pos, CHANNEL[0], Names::Told))
        .panel(error("error, positive: measured − reference (kPa)", &p_pos, &ref_pos, CHANNEL[0]))
        .panel(pressure("negative pressure (kPa gauge)", &p_neg, &ref_neg, CHANNEL[1], Names::Untold))
        .panel(error("error, negative: measured − reference (kPa)", &p_neg, &ref_neg, CHANNEL[1]))
        .panel(duty)
}

/// Terms of the control law, while it steers.
pub(crate) fn law(flight: &Flight<'_>) -> Plot {
    let time_s = flight.time_s();
    let column = |value: fn(&TickRecord) -> f64| flight.column_where(|row| row.place.steered, value);
    let [ff, p, i, u]: [[Vec<f64>; 2]; 4] = [
        [column(|tick| tick.law_pos.feed_forward), column(|tick| tick.law_neg.feed_forward)],
        [column(|tick| tick.law_pos.proportional), column(|tick| tick.law_neg.proportional)],
        [column(|tick| tick.law_pos.integral), column(|tick| tick.law_neg.integral)],
        [column(|tick| tick.u_pos), column(|tick| tick.u_neg)],
    ];
    let tracked = flight.tracked();
    let mut plot = spanned(Plot::new("Control law, part by part", "time of the run (s)"), flight)
        .caption("Duty while the daemon steers: what it sent, the feed-forward (or the policy's output) it builds on, and what feedback adds to that.");
    for (((name, color), u), ((ff, p), i)) in
        [("positive", CHANNEL[0]), ("negative", CHANNEL[1])].into_iter().zip(&u).zip(ff.iter().zip(&p).zip(&i))
    {
        let both: Vec<f64> = p.iter().zip(i).map(|(p, i)| p.abs().max(i.abs())).collect();
        let feedback = Panel::new(&format!("{name}: feedback (duty)")).height(CENTERED).level("", 0.0, Color::Grey);
        let feedback = match scale(&both, &tracked) {
            Some(most) => feedback.y_range(-most, most),
            None => feedback,
        };
        let valve = Panel::new(&format!("{name} valve (duty)")).height(115.0);
        let valve = match around(&[u.as_slice(), ff.as_slice()], &tracked, 0.005) {
            Some((low, high)) => valve.y_range(low, high),
            None => valve,
        };
        plot = plot
            .panel(
                valve
                    .line(Line::new("sent", &time_s, u).color(color).stepped())
                    .line(Line::new("feed-forward", &time_s, ff).color(Color::Black).dashed()),
            )
            .panel(
                feedback
                    .line(Line::new("proportional", &time_s, p).color(Color::Sky).width(1.1))
                    .line(Line::new("integral", &time_s, i).color(Color::Green).width(1.8)),
            );
    }
    plot
}

/// Prediction errors of MPObs over the flight.
pub(crate) fn prediction_errors(flight: &Flight<'_>, checks: &[PredictionCheck; 2]) -> Plot {
    let time_s = flight.time_s();
    let tracked = flight.tracked();
    let mut plot = spanned(Plot::new("Prediction errors over the run", "time of the run (s)"), flight)
        .caption("Root of the mean square over one second of what was measured minus what MPObs had predicted for it; beside it the error of assuming that nothing changes.");
    for (name, check) in ["positive", "negative"].into_iter().zip(checks) {
        let (Some(one), Some(five)) = (check.horizon(1), check.horizon(5)) else { continue };
        let over_a_second = |errors: &[f64]| rolling_rms(errors, 50);
        let (one, unchanged) = (over_a_second(&one.error), over_a_second(&five.unchanged_error));
        let five = over_a_second(&five.error);
        let largest = |values: &[f64]| scale(values, &tracked).unwrap_or(0.0);
        let most = largest(&one).max(largest(&five)).max(largest(&unchanged));
        let panel = Panel::new(&format!("{name} (kPa RMS)")).height(120.0);
        let panel = if most > 0.0 { panel.y_range(0.0, most) } else { panel.include(0.0) };
        plot = plot.panel(
            panel
                .line(Line::new("1 tick ahead", &time_s, &one).color(Color::Sky).width(1.8))
                .line(Line::new("5 ticks ahead", &time_s, &five).color(Color::Purple).width(1.8))
                .line(Line::new("nothing changes for 5 ticks", &time_s, &unchanged).color(Color::Grey).dashed()),
        );
    }
    plot
}

/// The second and a half in which the predictions five ticks ahead were worst, against what came.
pub(crate) fn prediction_close_up(flight: &Flight<'_>, checks: &[PredictionCheck; 2]) -> Option<Plot> {
    let tracked = flight.tracked();
    let [pos, neg] = checks;
    let (five_pos, five_neg) = (pos.horizon(5)?, neg.horizon(5)?);
    // Both channels count alike, whatever their noise.
    let share = |errors: &[f64]| rms(errors, &tracked).filter(|rms| *rms > 0.0);
    let (size_pos, size_neg) = (share(&five_pos.error)?, share(&five_neg.error)?);
    let worst: Vec<f64> =
        five_pos.error.iter().zip(&five_neg.error).map(|(p, n)| (p / size_pos).hypot(n / size_neg)).collect();
    let rows = worst_window(&worst, &tracked, CLOSE_UP)?;
    let time_s = flight.time_s();
    let cut = |values: &[f64]| values.get(rows.clone()).map(<[f64]>::to_vec).unwrap_or_default();
    let time = cut(&time_s);
    let mut plot = Plot::new("Predictions against what came, close up", "time of the run (s)")
        .caption("The second and a half in which predictions five ticks ahead were worst. A line shows at each moment what had been predicted for it.");
    let references = [flight.column(|tick| tick.ref_pos_kpa), flight.column(|tick| tick.ref_neg_kpa)];
    for (((name, color), check), reference) in
        [("positive", CHANNEL[0]), ("negative", CHANNEL[1])].into_iter().zip(checks).zip(&references)
    {
        let (one, five) = (check.horizon(1)?, check.horizon(5)?);
        plot = plot.panel(
            Panel::new(&format!("{name} (kPa gauge)"))
                .height(170.0)
                .line(Line::new("reference", &time, &cut(reference)).color(Color::Black).dashed())
                .line(Line::new("predicted 1 tick ahead", &time, &cut(&one.predicted)).color(Color::Sky))
                .line(Line::new("5 ticks ahead", &time, &cut(&five.predicted)).color(Color::Purple).width(1.8))
                .scatter(Scatter::new("measured", &time, &cut(&check.measured)).color(color)),
        );
    }
    Some(plot)
}

/// Durations of ticks, whole and by stage.
pub(crate) fn tick_times(flight: &Flight<'_>, deadline_ms: Option<f64>) -> Plot {
    let mut plot = Plot::new("Time of a tick", "time (ms)").log_x().caption(
        "Both axes are logarithmic: the few slow ticks matter and would vanish otherwise. A stage counts where it ran.",
    );
    for stage in Stage::ALL {
        let whole = stage == Stage::Whole;
        let ms: Vec<f64> = flight.rows().filter_map(|row| stage.ns(row.tick)).map(|ns| f64::from(ns) / 1e6).collect();
        if ms.is_empty() {
            continue;
        }
        let ticks = wording::counted(ms.len() as u64, "tick", "ticks");
        let name = if whole { "whole tick".to_owned() } else { format!("of that: {}", stage.name()) };
        let mut panel = Panel::new(&format!("{name} ({ticks})"))
            .height(if whole { 150.0 } else { 62.0 })
            .log_y()
            .bars("", decade_bins(&ms));
        if whole {
            let at = flight.statistics.stage(stage).percentile_ns(0.999).map_or(f64::NAN, |ns| ns as f64 / 1e6);
            let (limit, limit_ms) = match deadline_ms {
                Some(limit_ms) => (format!("deadline {limit_ms} ms"), limit_ms),
                None => ("20 ms".to_owned(), 20.0),
            };
            panel = panel.moment("99.9 %", at, Color::Black).moment(&limit, limit_ms, Color::Red);
        }
        plot = plot.panel(panel);
    }
    plot
}

/// Times at which ticks were slow and frames late.
pub(crate) fn times_over_flight(flight: &Flight<'_>) -> Plot {
    let time_s = flight.time_s();
    let compute_ms = flight.column(|tick| Stage::Whole.ns(tick).map_or(f64::NAN, |ns| f64::from(ns) / 1e6));
    let where_ms = |passes: fn(&TickRecord) -> bool, value: fn(&TickRecord) -> f64| {
        flight.column_where(|row| passes(row.tick), value)
    };
    let slowest_ms = flight.statistics.stage(Stage::Whole).max_ns().map_or(1.0, |ns| ns as f64 / 1e6);
    let panel = Panel::new("whole tick (ms)").height(115.0).y_range(0.0, 1.1 * slowest_ms);
    let mut panel = panel.line(Line::new("", &time_s, &compute_ms).color(Color::Blue).width(1.0));
    let realtime = flight.statistics.options.pacing == Pacing::Realtime;
    if realtime && flight.statistics.counts().deadline_misses > 0 {
        let missed = where_ms(|tick| tick.deadline_missed, |tick| f64::from(tick.compute_ns) / 1e6);
        panel = panel.scatter(Scatter::new("deadline missed", &time_s, &missed).color(Color::Red));
    }
    let plot = spanned(Plot::new("Ticks and frames over the run", "time of the run (s)"), flight).panel(panel);
    if !realtime {
        return plot.caption("In lockstep a frame comes whenever it is ready, so there is no lateness to show.");
    }
    let came = |tick: &TickRecord| matches!(tick.arrival, Arrival::InTime | Arrival::Late);
    let lateness_ms = flight.column_where(|row| came(row.tick), |tick| tick.arrival_lateness_ns as f64 / 1e6);
    let mut panel = Panel::new("frame later than expected (ms)")
        .height(115.0)
        .line(Line::new("", &time_s, &lateness_ms).color(Color::Green).width(1.0));
    let counts = flight.statistics.counts();
    let marks: [Mark; 3] = [
        (counts.frames_late, "late", |tick| tick.arrival == Arrival::Late, Color::Ochre),
        (
            counts.frames_missing,
            "did not come",
            |tick| tick.arrival == Arrival::Missing && tick.session != 0,
            Color::Red,
        ),
        (counts.frames_damaged, "damaged", |tick| tick.arrival == Arrival::Damaged, Color::Purple),
    ];
    for (number, name, passes, color) in marks {
        if number > 0 {
            // A frame that did not come has no lateness; its mark stands at 0.
            let at = where_ms(passes, |tick| match tick.arrival {
                Arrival::Late => tick.arrival_lateness_ns as f64 / 1e6,
                _ => 0.0,
            });
            panel = panel.scatter(Scatter::new(name, &time_s, &at).color(color));
        }
    }
    plot.panel(panel)
}

/// The whole flight on the x axis, so that all plots over time can be laid on each other.
fn spanned(plot: Plot, flight: &Flight<'_>) -> Plot {
    plot.x_range(0.0, flight.statistics.seconds().max(0.02))
}

/// Names of a panel's shades, told or not.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Names {
    Told,
    Untold,
}

/// Shades what a reader must know before he judges a curve; each kind is named once, in the top panel.
fn marked(mut panel: Panel, flight: &Flight<'_>, names: Names) -> Panel {
    let faults = flight.stretches(|row| row.tick.fault != 0);
    let vented = flight.stretches(|row| !row.place.steered && row.tick.fault == 0);
    let settling = flight.stretches(|row| row.place.steered && !row.place.tracked && row.tick.fault == 0);
    for (name, stretches, color) in [
        ("fault", faults, Color::Red),
        ("not steering", vented, Color::Black),
        ("settling, not counted", settling, Color::Ochre),
    ] {
        for (index, rows) in stretches.iter().enumerate() {
            if let (Some(first), Some(last)) = (rows.first(), rows.last()) {
                let name = if names == Names::Told && index == 0 { name } else { "" };
                panel = panel.span(name, first.place.moment.time_s, last.place.moment.time_s + 0.02, color);
            }
        }
    }
    panel
}

/// Bins whose edges are the same for every stage, whatever its times, so that bars can be compared.
fn decade_bins(values: &[f64]) -> Histogram {
    let bin = |value: f64| (value.log10() * BINS_PER_DECADE).floor() as i64;
    let positive = || values.iter().copied().filter(|value| value.is_finite() && *value > 0.0);
    let (Some(first), Some(last)) = (positive().map(bin).min(), positive().map(bin).max()) else {
        return Histogram { edges: Vec::new(), counts: Vec::new() };
    };
    let edges = (first..=last + 1).map(|edge| 10_f64.powf(edge as f64 / BINS_PER_DECADE)).collect();
    let mut counts = vec![0; usize::try_from(last - first).unwrap_or(0) + 1];
    for value in positive() {
        if let Some(count) = usize::try_from(bin(value) - first).ok().and_then(|bin| counts.get_mut(bin)) {
            *count += 1;
        }
    }
    Histogram { edges, counts }
}

/// Axis ends around all that counts, with a quarter of the span to spare on both sides.
///
/// At least `least` to spare: a constant reference still gets an axis on which noise is no mountain range.
fn around(curves: &[&[f64]], counts: &[bool], least: f64) -> Option<(f64, f64)> {
    let counted = curves.iter().flat_map(|curve| curve.iter().zip(counts));
    let sound = counted.filter(|(value, counts)| **counts && value.is_finite()).map(|(value, _)| *value);
    let (low, high) = sound.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), value| (l.min(value), h.max(value)));
    let spare = (0.25 * (high - low)).max(least);
    (low <= high).then_some((low - spare, high + spare))
}

/// An axis end that holds all that counts, with a tenth to spare; `None` when nothing does.
fn scale(values: &[f64], counts: &[bool]) -> Option<f64> {
    let counted = values.iter().zip(counts).filter(|(value, counts)| **counts && value.is_finite());
    let most = counted.fold(0.0_f64, |most, (value, _)| most.max(value.abs()));
    (most > 0.0).then_some(most * 1.1)
}
