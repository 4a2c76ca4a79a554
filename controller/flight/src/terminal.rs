//! Text of a flight on a terminal: a line each second, and a table at the end.
//!
//! Plain ASCII in fixed columns, so that it reads the same in a log file and over a serial console.

use std::fmt::Write;

use crate::statistics::FlightStatistics;
use crate::summary::{DurationFigures, FlightSummary, RepetitionFigures};
use crate::wording;
use crate::yardstick::OnWhichRig;

/// Width of the first column: with four more of twelve letters a line has the 80 of a terminal.
const NAME: usize = 32;

impl FlightStatistics {
    /// The line that stands above the live lines.
    pub fn live_header() -> &'static str {
        "   time  positive -> ref., error  negative -> ref., error  valve duty  slowest"
    }

    /// The state of the flight now, in one line of fixed columns; begins another second.
    ///
    /// `note` stands at the end: the daemon's state or fault in a few words, or nothing. The compute time
    /// is the slowest tick since the last line; deadlines that were missed stand behind it once there are any.
    ///
    /// # Real-time
    /// Not in the tick: it allocates.
    pub fn live_line(&mut self, note: &str) -> String {
        let slowest_ms = f64::from(std::mem::take(&mut self.window_max_ns)) / 1e6;
        let Some((moment, tick)) = &self.last else {
            return format!("     0 s  no tick yet  {note}").trim_end().to_owned();
        };
        let channel = |measured: f64, reference: f64| {
            let (now, target, error) = (cell(measured, 6), cell(reference, 6), signed_cell(measured - reference));
            format!("{now} -> {target} {error}")
        };
        let missed = match self.counts.deadline_misses {
            0 => String::new(),
            misses => format!("{misses} missed"),
        };
        let note = [missed.as_str(), note].into_iter().filter(|words| !words.is_empty()).collect::<Vec<_>>().join("  ");
        format!(
            "{:>5.0} s  {}  {}  {:.3} {:.3} {slowest_ms:>4.1} ms  {note}",
            moment.time_s.floor(),
            channel(tick.p_pos_kpa, tick.ref_pos_kpa),
            channel(tick.p_neg_kpa, tick.ref_neg_kpa),
            tick.u_pos,
            tick.u_neg,
        )
        .trim_end()
        .to_owned()
    }
}

impl FlightSummary {
    /// All figures in plain words, and the verdict in the last line.
    pub fn table(&self) -> String {
        let mut out = String::new();
        self.tracking_rows(&mut out);
        self.time_rows(&mut out);
        self.count_rows(&mut out);
        // Writing to a String cannot fail.
        let _ = writeln!(out, "\nVerdict: {}. {}", self.verdict.word(), self.headline.replace('µ', "u"));
        for finding in &self.findings {
            let _ = writeln!(out, "  - {}", finding.replace('±', "+-"));
        }
        out
    }

    fn tracking_rows(&self, out: &mut String) {
        let after = format!("Tracking, after {} of settling", wording::seconds(self.settling_s));
        let _ = writeln!(out, "{after:<NAME$}{:>12}{:>12}", "positive", "negative");
        let mut row = |name: &str, pos: String, neg: String, unit: &str| {
            let _ = writeln!(out, "{:<NAME$}{pos:>12}{neg:>12}  {unit}", format!("  {name}"));
        };
        let plain = |value| wording::number(value, 3);
        row("RMSE (measured - reference)", plain(self.rmse_pos_kpa), plain(self.rmse_neg_kpa), "kPa");
        if self.rmse_limit_pos_kpa.is_some() || self.rmse_limit_neg_kpa.is_some() {
            row("limit", plain(self.rmse_limit_pos_kpa), plain(self.rmse_limit_neg_kpa), "kPa");
        }
        if let Some(on) = self.yardstick_on {
            let on = if on == OnWhichRig::TheRig { "same rig" } else { "on the model" };
            row(
                &format!("feed-forward PI, {on}"),
                plain(self.fallback_rmse_pos_kpa),
                plain(self.fallback_rmse_neg_kpa),
                "kPa",
            );
            if self.optimum_rmse_pos_kpa.is_some() {
                row("clairvoyant optimum", plain(self.optimum_rmse_pos_kpa), plain(self.optimum_rmse_neg_kpa), "kPa");
            }
        }
        row("largest error", plain(self.max_abs_pos_kpa), plain(self.max_abs_neg_kpa), "kPa");
        let signed = |value| wording::signed(value, 3);
        row("mean error", signed(self.mean_error_pos_kpa), signed(self.mean_error_neg_kpa), "kPa");
        let duty = |value| wording::number(value, 5);
        row(
            "valve movement per tick, RMS",
            duty(self.action_change_rms_pos_duty),
            duty(self.action_change_rms_neg_duty),
            "duty",
        );
        row(
            "oscillation faster than 3 s",
            oscillation(self.repetition_pos),
            oscillation(self.repetition_neg),
            "kPa / period",
        );
    }

    fn time_rows(&self, out: &mut String) {
        let _ = writeln!(
            out,
            "\n{:<NAME$}{:>12}{:>12}{:>12}{:>12}",
            "Time (a tick is 20 ms)", "median", "99 %", "99.9 %", "max"
        );
        let mut row = |name: &str, figures: DurationFigures| {
            let _ = write!(out, "{:<NAME$}", format!("  {name}"));
            for figure in [figures.p50, figures.p99, figures.p999, figures.max] {
                let _ = write!(out, "{:>12}", wording::time_ms(figure));
            }
            out.push('\n');
        };
        row("whole tick: frame to command", self.compute_us());
        row("  receive and check", self.stages_us.receive_check);
        row("  prediction (MPObs)", self.stages_us.predict);
        row("  control law and limits", self.stages_us.law);
        row("  send", self.stages_us.send);
        if self.is_realtime() {
            row("frame later than expected", self.lateness_us);
        }
    }

    fn count_rows(&self, out: &mut String) {
        let pacing = if self.is_realtime() { "real time" } else { "lockstep, no deadlines" };
        let _ = writeln!(
            out,
            "\n{} in {} ({pacing}), {} counted for tracking",
            wording::counted(self.ticks, "tick", "ticks"),
            wording::seconds(self.seconds),
            wording::count(self.tracked_ticks)
        );
        let _ = writeln!(
            out,
            "deadlines missed {}; frames missing {}, late {}, damaged {}; faults {}, cRIO trips {};\nvented {}; ticks without a record {}",
            self.deadline_misses,
            self.frames_missing,
            self.frames_late,
            self.frames_damaged,
            self.faults,
            self.crio_trips,
            wording::seconds(self.vented_s),
            self.ticks_skipped.max(self.records_dropped),
        );
    }
}

/// A pressure in a fixed width; `--` where there is none.
fn cell(kpa: f64, width: usize) -> String {
    if kpa.is_finite() { format!("{kpa:>width$.2}") } else { format!("{:>width$}", "--") }
}

fn signed_cell(kpa: f64) -> String {
    if kpa.is_finite() { format!("{kpa:>+6.2}") } else { format!("{:>6}", "--") }
}

fn oscillation(repetition: Option<RepetitionFigures>) -> String {
    match repetition {
        Some(RepetitionFigures { oscillating: true, period_s, amplitude_kpa, .. }) => {
            format!("{amplitude_kpa:.2} / {period_s:.2}s")
        }
        Some(_) | None => "none".to_owned(),
    }
}
