//! A flight as one self-contained page: a sentence, figures, what happened, plots, and where it came from.
//!
//! Order of the page: first what a person wants to know (did it go well?), then what to look at if it
//! did not, then everything else. All figures come from [`FlightStatistics`](crate::FlightStatistics),
//! so page, table and `--json` cannot disagree.

use proto::recording::{EventLevel, TickRecord};
use report::{KeyFigure, Report, Table, Verdict as Sign};

use crate::flight_info::FlightInfo;
use crate::flight_rows::Flight;
use crate::occurrences::{Occurrence, occurrences};
use crate::prediction_check::{PredictionCheck, rms};
use crate::report_plots;
use crate::summary::{DurationFigures, FlightSummary, RepetitionFigures};
use crate::wording;

/// The report of a flight, as the bytes of an HTML file.
///
/// Takes all ticks of the flight in their order. Curves are thinned out to what a screen can show, so an
/// hour makes a page no larger than a minute does. Writing the file is the caller's business
/// ([`proto::atomic_file::write`]).
pub fn flight_report(ticks: &[TickRecord], info: &FlightInfo) -> String {
    let flight = Flight::new(ticks, info.options);
    let summary = flight.statistics.summary();
    let checks = [PredictionCheck::of(&flight, 0), PredictionCheck::of(&flight, 1)];
    let happened = occurrences(&flight, &info.codes, &info.notes);

    let mut page =
        Report::new(&info.title).subtitle(&subtitle(info)).text(&summary.headline).summary(key_figures(&summary));
    if !summary.findings.is_empty() {
        page = page.heading("Look at").list(&summary.findings);
    }
    page = page.heading("Run").plot(report_plots::pressures(&flight));
    page = page.heading("What happened").table(happened_table(&happened));
    page = page.heading("Predictions (MPObs)").table(prediction_table(&flight, &checks));
    let [pos, neg] = checks.each_ref().map(|check| check.loses_to_nothing(&flight.tracked()));
    let off = match (pos, neg) {
        (true, true) => Some("Both channels"),
        (true, false) => Some("The positive channel"),
        (false, true) => Some("The negative channel"),
        (false, false) => None,
    };
    if let Some(channels) = off {
        page = page.text(&why_predictions_are_off(channels, info));
    }
    if let Some(plot) = report_plots::prediction_close_up(&flight, &checks) {
        page = page.plot(plot);
    }
    page = page
        .plot(report_plots::prediction_errors(&flight, &checks))
        .heading("Control law")
        .plot(report_plots::law(&flight))
        .heading("Time and link")
        .table(time_table(&summary))
        .plot(report_plots::tick_times(&flight, info.deadline_ms))
        .plot(report_plots::times_over_flight(&flight))
        .table(link_table(&summary))
        .heading("All tracking figures")
        .table(tracking_table(&summary))
        .heading("Where this comes from")
        .table(provenance(info));
    for (name, text) in &info.files {
        page = page.verbatim(name, text);
    }
    page.to_html()
}

/// Reason why predictions may be worse than none, as far as the recording tells.
fn why_predictions_are_off(channels: &str, info: &FlightInfo) -> String {
    let begin = format!(
        "{channels}: five ticks ahead, MPObs is further off than assuming that nothing changes. Predictions roll the model from the plan of the tick before, so they miss"
    );
    let rig = info.rig.trim_end_matches(" (emulated)");
    if !rig.is_empty() && !info.model_rig.is_empty() && rig != info.model_rig {
        return format!(
            "{begin} what the rig {rig} has and the model {} does not know, and what the controller then did otherwise than planned. Here that is on purpose: the run shows a controller whose model is not the rig. With --model {rig} the model is the rig.",
            info.model_rig
        );
    }
    let fit = if rig.is_empty() {
        " Whether the model fits this rig is what `trainer validate` says, and `trainer diagnose` what it lacks."
    } else {
        ""
    };
    format!(
        "{begin} what the model does not know of the rig, and what the controller then did otherwise than planned.{fit}"
    )
}

fn subtitle(info: &FlightInfo) -> String {
    let policy = info.policy.as_ref().map(|(name, _)| format!("policy {name}"));
    let rig = Some(&info.rig).filter(|rig| !rig.is_empty()).map(|rig| format!("rig {rig}"));
    let started = wording::instant(&info.started);
    let parts = [started, info.program.clone(), rig.unwrap_or_default(), policy.unwrap_or_default()];
    parts.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(" · ")
}

fn key_figures(summary: &FlightSummary) -> Vec<KeyFigure> {
    let rmse = |name: &str, rmse: Option<f64>, limit: Option<f64>, others: String| {
        let note = match limit {
            Some(limit) => format!("limit {limit:.2} kPa, {others}"),
            None => others,
        };
        let figure = KeyFigure::new(&format!("RMSE {name}"), &unit(wording::number(rmse, 3), "kPa")).note(&note);
        match (rmse, limit) {
            (Some(rmse), Some(limit)) if rmse > limit => figure.verdict(Sign::Bad),
            (Some(_), Some(_)) => figure.verdict(Sign::Good),
            (None, _) => figure.verdict(Sign::Bad),
            (Some(_), None) => figure,
        }
    };
    let others = |most: Option<f64>, fallback: Option<f64>, optimum: Option<f64>| {
        let mut parts = vec![format!("largest error {} kPa", wording::number(most, 2))];
        let by = [("feed-forward PI", fallback), ("optimum", optimum)];
        parts.extend(by.into_iter().filter_map(|(who, kpa)| Some(format!("{who} {:.3}", kpa?))));
        parts.join("; ")
    };
    let pos = others(summary.max_abs_pos_kpa, summary.fallback_rmse_pos_kpa, summary.optimum_rmse_pos_kpa);
    let neg = others(summary.max_abs_neg_kpa, summary.fallback_rmse_neg_kpa, summary.optimum_rmse_neg_kpa);
    let none_is_good = |number: u64| if number == 0 { Sign::Good } else { Sign::Bad };
    let deadlines = if summary.is_realtime() {
        KeyFigure::new("Deadlines missed", &wording::count(summary.deadline_misses))
            .note(&format!("of {}", wording::counted(summary.ticks, "tick", "ticks")))
            .verdict(none_is_good(summary.deadline_misses))
    } else {
        KeyFigure::new("Deadlines", "none")
            .note(&format!("lockstep, {}", wording::counted(summary.ticks, "tick", "ticks")))
    };
    let faults = KeyFigure::new("Faults", &wording::count(summary.faults))
        .note(&match summary.vented_s {
            0.0 => "never vented while in control".to_owned(),
            vented_s => match summary.crio_trips {
                0 => format!("vented for {} of the run", wording::seconds(vented_s)),
                trips => format!(
                    "vented for {} of the run; the cRIO reported {}",
                    wording::seconds(vented_s),
                    wording::counted(trips, "trip", "trips")
                ),
            },
        })
        .verdict(match (summary.faults + summary.crio_trips, summary.vented_s > 0.0) {
            (0, false) => Sign::Good,
            _ => Sign::Bad,
        });
    let slowest = KeyFigure::new("Slowest tick", &wording::short_time(summary.compute_us_max))
        .note(&format!("of 20 ms; median {}", wording::short_time(summary.compute_us_p50)));
    vec![
        rmse("positive", summary.rmse_pos_kpa, summary.rmse_limit_pos_kpa, pos),
        rmse("negative", summary.rmse_neg_kpa, summary.rmse_limit_neg_kpa, neg),
        deadlines,
        slowest,
        faults,
    ]
}

fn happened_table(happened: &[Occurrence]) -> Table {
    let mut table = Table::new(["at", "for", "", "part", "what"]);
    for entry in happened {
        let level = match entry.level {
            EventLevel::Info => "",
            EventLevel::Warning => "!",
            EventLevel::Error => "✗",
        };
        let length = entry.length_s.map_or_else(String::new, |length_s| format!("{length_s:.2} s"));
        table.push([
            format!("{:.2} s", entry.from_s),
            length,
            level.to_owned(),
            entry.part.clone(),
            entry.text.clone(),
        ]);
    }
    table
}

fn prediction_table(flight: &Flight<'_>, checks: &[PredictionCheck; 2]) -> Table {
    let tracked = flight.tracked();
    let mut table = Table::new([
        "ahead",
        "positive: MPObs (kPa)",
        "nothing changes (kPa)",
        "negative: MPObs (kPa)",
        "nothing changes (kPa)",
    ])
    .caption("RMS of what was measured minus what had been predicted, over the ticks that count, beside the error of assuming that nothing changes. Both hold the sensor's noise twice.");
    let [pos, neg] = checks;
    for (index, (pos, neg)) in pos.horizons().zip(neg.horizons()).enumerate() {
        let ticks = index + 1;
        let cell = |values: &[f64]| wording::number(rms(values, &tracked), 3);
        table.push([
            format!("{ticks} {} ({} ms)", if ticks == 1 { "tick" } else { "ticks" }, 20 * ticks),
            cell(&pos.error),
            cell(&pos.unchanged_error),
            cell(&neg.error),
            cell(&neg.unchanged_error),
        ]);
    }
    table
}

fn time_table(summary: &FlightSummary) -> Table {
    let mut table = Table::new(["time", "median", "99 %", "99.9 %", "largest"])
        .caption("Percentiles are at most 0.8 % too large and never too small.");
    let mut row = |name: &str, figures: DurationFigures| {
        let cells = [figures.p50, figures.p99, figures.p999, figures.max].map(wording::time_ms);
        table.push(std::iter::once(name.to_owned()).chain(cells));
    };
    row("whole tick: frame in hand to command sent", summary.compute_us());
    row("— receive and check", summary.stages_us.receive_check);
    row("— prediction (MPObs)", summary.stages_us.predict);
    row("— control law and limits", summary.stages_us.law);
    row("— send", summary.stages_us.send);
    if summary.is_realtime() {
        row("frame later than expected (early is 0)", summary.lateness_us);
    }
    table
}

fn link_table(summary: &FlightSummary) -> Table {
    let share = |number: u64| match summary.ticks {
        0 => String::new(),
        ticks => format!("{:.3} %", 100.0 * number as f64 / ticks as f64),
    };
    let mut table = Table::new(["link and recorder", "number", "share of ticks"]);
    let mut row = |name: &str, number: u64, share: String| table.push([name.to_owned(), wording::count(number), share]);
    row("ticks", summary.ticks, String::new());
    row("sessions with the cRIO", summary.sessions, String::new());
    for (name, number) in [
        ("frames that did not come", summary.frames_missing),
        ("frames that came late", summary.frames_late),
        ("frames that came damaged", summary.frames_damaged),
        ("deadlines missed", summary.deadline_misses),
        ("ticks without a record", summary.ticks_skipped),
        ("records refused by a full queue", summary.records_dropped),
    ] {
        row(name, number, share(number));
    }
    table
}

fn tracking_table(summary: &FlightSummary) -> Table {
    let mut table = Table::new(["figure", "positive", "negative"]).caption(&format!(
        "Over {} in which the daemon steered, from {} after it began to.",
        wording::counted(summary.tracked_ticks, "tick", "ticks"),
        wording::seconds(summary.settling_s)
    ));
    let mut row = |name: &str, pos: String, neg: String| table.push([name.to_owned(), pos, neg]);
    let kpa = |value| unit(wording::number(value, 3), "kPa");
    row("RMSE (measured − reference)", kpa(summary.rmse_pos_kpa), kpa(summary.rmse_neg_kpa));
    if summary.rmse_limit_pos_kpa.is_some() || summary.rmse_limit_neg_kpa.is_some() {
        row("limit", kpa(summary.rmse_limit_pos_kpa), kpa(summary.rmse_limit_neg_kpa));
    }
    if let Some(on) = summary.yardstick_on {
        let (pos, neg) = (kpa(summary.fallback_rmse_pos_kpa), kpa(summary.fallback_rmse_neg_kpa));
        row(&format!("RMSE of the feed-forward PI {}", on.words()), pos, neg);
        if summary.optimum_rmse_pos_kpa.is_some() {
            let (pos, neg) = (kpa(summary.optimum_rmse_pos_kpa), kpa(summary.optimum_rmse_neg_kpa));
            row("RMSE of the clairvoyant optimum (rig and reference known in advance)", pos, neg);
        }
    }
    row("largest error", kpa(summary.max_abs_pos_kpa), kpa(summary.max_abs_neg_kpa));
    let signed = |value| unit(wording::signed(value, 3).replace('-', "−"), "kPa");
    row("mean error", signed(summary.mean_error_pos_kpa), signed(summary.mean_error_neg_kpa));
    let duty = |value| unit(wording::number(value, 5), "duty");
    row(
        "valve movement per tick, RMS",
        duty(summary.action_change_rms_pos_duty),
        duty(summary.action_change_rms_neg_duty),
    );
    row("oscillation faster than 3 s", oscillation(summary.repetition_pos), oscillation(summary.repetition_neg));
    table
}

fn oscillation(repetition: Option<RepetitionFigures>) -> String {
    match repetition {
        Some(RepetitionFigures { oscillating: true, period_s, amplitude_kpa, .. }) => {
            format!("±{amplitude_kpa:.2} kPa every {period_s:.2} s")
        }
        Some(RepetitionFigures { regularity, .. }) => format!("none (regularity {regularity:.2})"),
        None => "none".to_owned(),
    }
}

fn provenance(info: &FlightInfo) -> Table {
    let mut table = Table::new(["", ""]);
    let policy = match &info.policy {
        Some((name, sha256)) => format!("{name} (SHA-256 {sha256})"),
        None => "none: the built-in control law".to_owned(),
    };
    let known = [
        ("started", &info.started),
        ("program", &info.program),
        ("command", &info.command),
        ("rig", &info.rig),
        ("model behind MPObs and feed-forward", &info.model_rig),
        ("reference", &info.reference),
        ("policy", &policy),
    ];
    for (name, value) in known.into_iter().filter(|(_, value)| !value.is_empty()) {
        table.push([name, value.as_str()]);
    }
    for (name, value) in &info.extra {
        table.push([name, value]);
    }
    table
}

fn unit(number: String, unit: &str) -> String {
    if number == "n/a" { number } else { format!("{number} {unit}") }
}
