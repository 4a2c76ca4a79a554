//! The figures of a flight as data: what `--json` prints, what table, headline and report are made of.
//!
//! Every key names its unit. A figure that could not be taken is `null`, never 0. Percentiles are at
//! most 0.8 % too large and never too small (see
//! [`duration_histogram`](crate::duration_histogram)).

use serde::Serialize;

use crate::duration_histogram::DurationHistogram;
use crate::flight_clock::RATE_HZ;
use crate::statistics::{FlightStatistics, Pacing, Stage};
use crate::tracking::Tracking;
use crate::verdict::{self, Verdict};
use crate::yardstick::OnWhichRig;

/// Figures of a flight.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FlightSummary {
    /// The flight in one sentence.
    pub headline: String,
    /// Verdict on how the flight went.
    pub verdict: Verdict,
    /// Findings that a person should look at, a sentence each; empty for a good flight.
    pub findings: Vec<String>,

    /// `realtime` or `lockstep`; in lockstep there are no deadlines and no lateness.
    pub pacing: &'static str,
    /// Ticks recorded.
    pub ticks: u64,
    /// Time from the first tick to the end of the last (s).
    pub seconds: f64,
    /// Settling time that does not count for tracking (s).
    pub settling_s: f64,
    /// Time under control (s).
    pub controlled_s: f64,
    /// Ticks that count for tracking.
    pub tracked_ticks: u64,

    /// Root of the mean squared error, measured − reference, positive channel (kPa).
    pub rmse_pos_kpa: Option<f64>,
    /// As `rmse_pos_kpa`, negative channel (kPa).
    pub rmse_neg_kpa: Option<f64>,
    /// The limit that the verdict was taken by (kPa).
    pub rmse_limit_pos_kpa: Option<f64>,
    /// The limit that the verdict was taken by (kPa).
    pub rmse_limit_neg_kpa: Option<f64>,
    /// RMSE that the feed-forward PI reaches, positive channel (kPa); `yardstick_on` says where.
    pub fallback_rmse_pos_kpa: Option<f64>,
    /// As `fallback_rmse_pos_kpa`, negative channel (kPa).
    pub fallback_rmse_neg_kpa: Option<f64>,
    /// RMSE of the clairvoyant optimum, positive channel (kPa); `null` where it is not known.
    pub optimum_rmse_pos_kpa: Option<f64>,
    /// As `optimum_rmse_pos_kpa`, negative channel (kPa).
    pub optimum_rmse_neg_kpa: Option<f64>,
    /// `the_rig` or `the_model`: what the yardstick was taken on; `null` without one.
    pub yardstick_on: Option<OnWhichRig>,
    /// Largest error without its sign, positive channel (kPa).
    pub max_abs_pos_kpa: Option<f64>,
    /// Largest error without its sign, negative channel (kPa).
    pub max_abs_neg_kpa: Option<f64>,
    /// Mean error, positive channel (kPa).
    pub mean_error_pos_kpa: Option<f64>,
    /// Mean error, negative channel (kPa).
    pub mean_error_neg_kpa: Option<f64>,
    /// Root of the mean squared change of duty per tick, positive valve.
    pub action_change_rms_pos_duty: Option<f64>,
    /// Root of the mean squared change of duty per tick, negative valve.
    pub action_change_rms_neg_duty: Option<f64>,
    /// The strongest repetition in the positive channel's error.
    pub repetition_pos: Option<RepetitionFigures>,
    /// The strongest repetition in the negative channel's error.
    pub repetition_neg: Option<RepetitionFigures>,

    /// Commands that left after their deadline, or not at all.
    pub deadline_misses: u64,
    /// Frames that did not come.
    pub frames_missing: u64,
    /// Frames after their deadline.
    pub frames_late: u64,
    /// Frames with a wrong CRC, length, session or content.
    pub frames_damaged: u64,
    /// Ticks of a session that have no record.
    pub ticks_skipped: u64,
    /// Sessions with the cRIO.
    pub sessions: u64,
    /// Times that a fault began.
    pub faults: u64,
    /// Time with a fault (s).
    pub fault_s: f64,
    /// Time without control since a fault, until the run went on or ended (s).
    pub vented_s: f64,
    /// Times that the cRIO reported a trip.
    pub crio_trips: u64,
    /// Records that a full queue refused.
    pub records_dropped: u64,

    /// From the frame in hand to the command sent, median (µs).
    pub compute_us_p50: Option<f64>,
    /// 99 % of ticks were at most as slow (µs).
    pub compute_us_p99: Option<f64>,
    /// 99.9 % of ticks were at most as slow (µs).
    pub compute_us_p999: Option<f64>,
    /// The slowest tick (µs).
    pub compute_us_max: Option<f64>,
    /// Times of the tick's stages (µs).
    pub stages_us: StageFigures,
    /// Lateness of the frames (µs); empty in lockstep.
    pub lateness_us: DurationFigures,
}

/// The strongest repetition in an error: see [`oscillation`](crate::oscillation).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RepetitionFigures {
    /// After this time it repeats itself (s).
    pub period_s: f64,
    /// Regularity: 0 for noise, 1 for a pure tone.
    pub regularity: f64,
    /// Amplitude of the part that repeats (kPa).
    pub amplitude_kpa: f64,
    /// True where that counts as an oscillation: perhaps a limit cycle.
    pub oscillating: bool,
}

/// Times of the tick's stages (µs).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct StageFigures {
    /// Receiving and checking the frame.
    pub receive_check: DurationFigures,
    /// MPObs.
    pub predict: DurationFigures,
    /// The control law and its limits.
    pub law: DurationFigures,
    /// Encoding and sending the command.
    pub send: DurationFigures,
}

/// Percentiles of a time (µs).
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct DurationFigures {
    /// Median.
    pub p50: Option<f64>,
    /// 99 % are at most as long.
    pub p99: Option<f64>,
    /// 99.9 % are at most as long.
    pub p999: Option<f64>,
    /// The longest.
    pub max: Option<f64>,
}

impl DurationFigures {
    /// The percentiles of a histogram.
    pub fn of(histogram: &DurationHistogram) -> Self {
        let us = |ns: Option<u64>| ns.map(|ns| ns as f64 / 1e3);
        let at = |share| us(histogram.percentile_ns(share));
        Self { p50: at(0.5), p99: at(0.99), p999: at(0.999), max: us(histogram.max_ns()) }
    }
}

impl FlightStatistics {
    /// The figures so far.
    ///
    /// # Real-time
    /// Not in the tick: it allocates.
    pub fn summary(&self) -> FlightSummary {
        let counts = &self.counts;
        let [pos, neg] = &self.channels;
        let [limit_pos, limit_neg] = self.options.rmse_limit_kpa.map_or([None, None], |limits| limits.map(Some));
        let yardstick = self.options.yardstick;
        let [fallback_pos, fallback_neg] = yardstick.map_or([None, None], |y| y.fallback_kpa);
        let [optimum_pos, optimum_neg] = yardstick.and_then(|y| y.optimum_kpa).map_or([None, None], |o| o.map(Some));
        let compute = DurationFigures::of(self.stage(Stage::Whole));
        let stage = |stage| DurationFigures::of(self.stage(stage));
        let realtime = self.options.pacing == Pacing::Realtime;
        let mut summary = FlightSummary {
            headline: String::new(),
            verdict: Verdict::Good,
            findings: Vec::new(),
            pacing: if realtime { "realtime" } else { "lockstep" },
            ticks: counts.ticks,
            seconds: self.seconds(),
            settling_s: self.options.skip_s,
            controlled_s: counts.steered as f64 / RATE_HZ,
            tracked_ticks: counts.tracked,
            rmse_pos_kpa: pos.rmse_kpa(),
            rmse_neg_kpa: neg.rmse_kpa(),
            rmse_limit_pos_kpa: limit_pos,
            rmse_limit_neg_kpa: limit_neg,
            fallback_rmse_pos_kpa: fallback_pos,
            fallback_rmse_neg_kpa: fallback_neg,
            optimum_rmse_pos_kpa: optimum_pos,
            optimum_rmse_neg_kpa: optimum_neg,
            yardstick_on: yardstick.map(|y| y.on),
            max_abs_pos_kpa: pos.max_abs_kpa(),
            max_abs_neg_kpa: neg.max_abs_kpa(),
            mean_error_pos_kpa: pos.mean_error_kpa(),
            mean_error_neg_kpa: neg.mean_error_kpa(),
            action_change_rms_pos_duty: pos.action_change_rms(),
            action_change_rms_neg_duty: neg.action_change_rms(),
            repetition_pos: repetition(pos),
            repetition_neg: repetition(neg),
            deadline_misses: counts.deadline_misses,
            frames_missing: counts.frames_missing,
            frames_late: counts.frames_late,
            frames_damaged: counts.frames_damaged,
            ticks_skipped: counts.ticks_skipped,
            sessions: counts.sessions,
            faults: counts.faults,
            fault_s: counts.fault_ticks as f64 / RATE_HZ,
            vented_s: counts.vented as f64 / RATE_HZ,
            crio_trips: counts.crio_trips,
            records_dropped: counts.records_dropped,
            compute_us_p50: compute.p50,
            compute_us_p99: compute.p99,
            compute_us_p999: compute.p999,
            compute_us_max: compute.max,
            stages_us: StageFigures {
                receive_check: stage(Stage::ReceiveCheck),
                predict: stage(Stage::Predict),
                law: stage(Stage::Law),
                send: stage(Stage::Send),
            },
            lateness_us: if realtime { DurationFigures::of(&self.lateness) } else { DurationFigures::default() },
        };
        let (verdict, findings) = verdict::findings(&summary, &self.options);
        (summary.verdict, summary.findings) = (verdict, findings);
        summary.headline = verdict::headline(&summary);
        summary
    }
}

impl FlightSummary {
    /// The whole tick's percentiles.
    pub fn compute_us(&self) -> DurationFigures {
        DurationFigures {
            p50: self.compute_us_p50,
            p99: self.compute_us_p99,
            p999: self.compute_us_p999,
            max: self.compute_us_max,
        }
    }

    /// Tells whether deadlines and lateness mean something.
    pub fn is_realtime(&self) -> bool {
        self.pacing == "realtime"
    }
}

fn repetition(channel: &Tracking) -> Option<RepetitionFigures> {
    channel.repetition().map(|found| RepetitionFigures {
        period_s: found.period_s,
        regularity: found.regularity,
        amplitude_kpa: found.amplitude_kpa,
        oscillating: found.is_oscillation(),
    })
}
