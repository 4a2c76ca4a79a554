//! All figures of a flight, tick by tick.
//!
//! # Which ticks count for tracking
//! Those in which the daemon steers (mode run or hold, a reference is active), from the settling time
//! after it began to: 5 s, as the pressures first have to get there. Vented ticks do not count, and
//! after them the settling time begins anew. That is fair only together with what the summary says
//! beside it: how long it was vented and how many faults there were.
//!
//! # Times
//! Percentiles come from bins of 0.8 % ([`DurationHistogram`]); a stage counts in the ticks in which it
//! ran. Lateness counts frames that came; an early one is 0 late.

use proto::recording::{Arrival, McapContent, TickRecord};

use crate::duration_histogram::DurationHistogram;
use crate::flight_clock::{FlightClock, Moment, RATE_HZ};
use crate::tracking::Tracking;
use crate::yardstick::RunYardstick;

/// Mode of a COMMAND that vents.
const MODE_VENT: u8 = 0;

/// Pacing of the ticks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Pacing {
    /// By the clock: deadlines count.
    #[default]
    Realtime,
    /// As fast as it goes: no deadlines, and arrival times mean nothing.
    Lockstep,
}

/// Settings by which the figures are taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StatisticsOptions {
    /// Settling time that does not count, after the daemon begins to steer (s).
    pub skip_s: f64,
    /// Pacing of the ticks.
    pub pacing: Pacing,
    /// The largest RMSE that the verdict calls good: positive, negative (kPa).
    pub rmse_limit_kpa: Option<[f64; 2]>,
    /// Yardstick of the run.
    pub yardstick: Option<RunYardstick>,
    /// Counterpart at the other end of the wire.
    pub counterpart: Counterpart,
    /// State of the file that the ticks were read from.
    pub file_state: FileState,
}

/// State of a file that ticks were read from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum FileState {
    /// Nothing between its ticks is damaged, or they come from no file.
    #[default]
    Whole,
    /// Something between them is.
    Damaged,
}

impl FileState {
    /// State of the file that a recording was read from.
    pub fn of(content: &McapContent) -> Self {
        if content.is_damaged_within { Self::Damaged } else { Self::Whole }
    }
}

/// Counterpart at the other end of the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Counterpart {
    /// A cRIO of its own.
    #[default]
    Crio,
    /// An emulated one on the same computer: what is late there is that computer's doing.
    SameComputer,
}

impl Default for StatisticsOptions {
    /// 5 s of settling, real time, no limit.
    fn default() -> Self {
        Self {
            skip_s: 5.0,
            pacing: Pacing::Realtime,
            rmse_limit_kpa: None,
            yardstick: None,
            counterpart: Counterpart::Crio,
            file_state: FileState::Whole,
        }
    }
}

/// Stages of a tick, in the order in which they run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// From the frame in hand to the command sent.
    Whole,
    /// Receiving and checking the frame.
    ReceiveCheck,
    /// MPObs.
    Predict,
    /// The control law and its limits.
    Law,
    /// Encoding and sending the command.
    Send,
}

impl Stage {
    /// All of them, the whole first.
    pub const ALL: [Self; 5] = [Self::Whole, Self::ReceiveCheck, Self::Predict, Self::Law, Self::Send];

    /// Name for people.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Whole => "whole tick",
            Self::ReceiveCheck => "receive and check",
            Self::Predict => "prediction (MPObs)",
            Self::Law => "control law",
            Self::Send => "send",
        }
    }

    /// Time in a tick (ns); `None` when it did not run.
    pub fn ns(self, tick: &TickRecord) -> Option<u32> {
        let ns = match self {
            Self::Whole => tick.compute_ns,
            Self::ReceiveCheck => tick.receive_check_ns,
            Self::Predict => tick.predict_ns,
            Self::Law => tick.law_ns,
            Self::Send => tick.send_ns,
        };
        (ns > 0).then_some(ns)
    }
}

/// Counts of ticks by what befell them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Ticks recorded.
    pub ticks: u64,
    /// Ticks that count for tracking.
    pub tracked: u64,
    /// Ticks in which the daemon steered.
    pub steered: u64,
    /// Commands that left after their deadline, or not at all.
    pub deadline_misses: u64,
    /// Frames that did not come, while there was a session.
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
    /// Ticks with a fault.
    pub fault_ticks: u64,
    /// Ticks without control since a fault, until the daemon steers again or the recording ends; none before it first
    /// steered.
    pub vented: u64,
    /// Times that the cRIO reported a trip.
    pub crio_trips: u64,
    /// Records that a full queue refused.
    pub records_dropped: u64,
}

/// Place where a tick stands in its flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Place on the time axis.
    pub moment: Moment,
    /// True where the daemon steered in it.
    pub steered: bool,
    /// True where it counts for tracking.
    pub tracked: bool,
}

/// Figures of a flight, tick by tick.
#[derive(Debug, Clone)]
pub struct FlightStatistics {
    pub(crate) options: StatisticsOptions,
    pub(crate) counts: Counts,
    pub(crate) channels: [Tracking; 2],
    pub(crate) stages: [DurationHistogram; Stage::ALL.len()],
    pub(crate) lateness: DurationHistogram,
    pub(crate) last: Option<(Moment, TickRecord)>,
    // Worst whole tick since the last live line (ns).
    pub(crate) window_max_ns: u32,
    clock: FlightClock,
    steering_since: Option<u64>,
    /// True where a fault took control away.
    vented_by_fault: bool,
}

impl Default for FlightStatistics {
    fn default() -> Self {
        Self::new(StatisticsOptions::default())
    }
}

impl FlightStatistics {
    /// Statistics that have seen no tick; allocates its 190 kB here and nothing later.
    pub fn new(options: StatisticsOptions) -> Self {
        Self {
            options,
            counts: Counts::default(),
            channels: [Tracking::new(), Tracking::new()],
            stages: std::array::from_fn(|_| DurationHistogram::new()),
            lateness: DurationHistogram::new(),
            last: None,
            window_max_ns: 0,
            clock: FlightClock::new(options.pacing),
            steering_since: None,
            vented_by_fault: false,
        }
    }

    /// All ticks of a recording at once.
    pub fn of(ticks: &[TickRecord], options: StatisticsOptions) -> Self {
        let mut statistics = Self::new(options);
        ticks.iter().for_each(|tick| {
            statistics.push(tick);
        });
        statistics
    }

    /// Takes the next tick and says where it stands in the flight.
    ///
    /// # Real-time
    /// May run in the tick: bounded work, allocates nothing; `benches/cost.rs` measures it.
    pub fn push(&mut self, tick: &TickRecord) -> Place {
        let moment = self.clock.next(tick);
        self.count(tick, moment);
        self.time(tick);
        let steered = steers(tick);
        let tracked = self.track(tick, moment, steered);
        self.last = Some((moment, *tick));
        Place { moment, steered, tracked }
    }

    /// Measures the run by what others reach.
    pub fn judge_by(&mut self, yardstick: Option<RunYardstick>) {
        self.options.yardstick = yardstick;
    }

    /// Counts of what befell the ticks so far.
    pub fn counts(&self) -> &Counts {
        &self.counts
    }

    /// Figures of a channel: 0 positive, 1 negative.
    pub fn channel(&self, channel: usize) -> Option<&Tracking> {
        self.channels.get(channel)
    }

    /// Times of a stage.
    pub fn stage(&self, stage: Stage) -> &DurationHistogram {
        let [whole, receive_check, predict, law, send] = &self.stages;
        match stage {
            Stage::Whole => whole,
            Stage::ReceiveCheck => receive_check,
            Stage::Predict => predict,
            Stage::Law => law,
            Stage::Send => send,
        }
    }

    /// Lateness of the frames; early ones count as 0.
    pub fn lateness(&self) -> &DurationHistogram {
        &self.lateness
    }

    /// Time from the first tick to the end of the last (s).
    pub fn seconds(&self) -> f64 {
        self.last.map_or(0.0, |(moment, _)| (moment.tick + 1) as f64 / RATE_HZ)
    }

    /// The settling time in ticks.
    fn skip_ticks(&self) -> u64 {
        // A duration that is no number skips nothing.
        (self.options.skip_s * RATE_HZ).round().max(0.0) as u64
    }

    fn count(&mut self, tick: &TickRecord, moment: Moment) {
        let before = self.last.map(|(_, before)| before);
        let counts = &mut self.counts;
        counts.ticks += 1;
        counts.deadline_misses += u64::from(tick.deadline_missed);
        match tick.arrival {
            Arrival::InTime => {}
            Arrival::Late => counts.frames_late += 1,
            Arrival::Missing => counts.frames_missing += u64::from(tick.session != 0),
            Arrival::Damaged => counts.frames_damaged += 1,
        }
        if moment.new_session {
            counts.sessions += u64::from(tick.session != 0);
        } else if tick.session != 0 {
            counts.ticks_skipped += moment.step.saturating_sub(1);
        }
        if tick.fault != 0 {
            counts.fault_ticks += 1;
            counts.faults += u64::from(before.is_none_or(|before| before.fault != tick.fault));
        }
        if tick.crio_trip != 0 {
            counts.crio_trips += u64::from(before.is_none_or(|before| before.crio_trip != tick.crio_trip));
        }
        // A number per session: a smaller one begins a new count.
        let dropped_before = before.map_or(0, |before| before.records_dropped);
        counts.records_dropped += u64::from(match tick.records_dropped.checked_sub(dropped_before) {
            Some(more) => more,
            None => tick.records_dropped,
        });
    }

    fn time(&mut self, tick: &TickRecord) {
        for (stage, histogram) in Stage::ALL.iter().zip(&mut self.stages) {
            if let Some(ns) = stage.ns(tick) {
                histogram.add(u64::from(ns));
            }
        }
        self.window_max_ns = self.window_max_ns.max(tick.compute_ns);
        if matches!(tick.arrival, Arrival::InTime | Arrival::Late) {
            self.lateness.add(u64::try_from(tick.arrival_lateness_ns).unwrap_or(0));
        }
    }

    /// Counts the errors of a tick; `false` when it does not count.
    fn track(&mut self, tick: &TickRecord, moment: Moment, steered: bool) -> bool {
        if !steered {
            self.steering_since = None;
            self.channels.iter_mut().for_each(Tracking::pause);
            self.vented_by_fault |= tick.fault != 0;
            self.counts.vented += u64::from(self.counts.steered > 0 && self.vented_by_fault);
            return false;
        }
        self.counts.steered += 1;
        self.vented_by_fault = false;
        let since = *self.steering_since.get_or_insert(moment.tick);
        if moment.step != 1 {
            self.channels.iter_mut().for_each(Tracking::pause);
        }
        if moment.tick - since < self.skip_ticks() {
            return false;
        }
        let [pos, neg] = &mut self.channels;
        pos.add(tick.p_pos_kpa, tick.ref_pos_kpa, tick.u_pos);
        neg.add(tick.p_neg_kpa, tick.ref_neg_kpa, tick.u_neg);
        self.counts.tracked += 1;
        true
    }
}

/// Tells whether the daemon steers in a tick: it has a reference and does not vent.
fn steers(tick: &TickRecord) -> bool {
    tick.mode != MODE_VENT && tick.ref_pos_kpa.is_finite() && tick.ref_neg_kpa.is_finite()
}
