//! Playing a command sequence: its commands row by row, open loop, once.
//!
//! ```text
//!   SETTLE ── both pressures stand still, pump off, vents open ──▶ PLAY: row k at tick n + k ──▶ REST ──▶ over
//!      │                                                            │ fault, disarmed           ▲
//!      └── no rest within 60 s; not armed then; a pump that runs on ┴───────────────────────────┘
//! ```
//!
//! The row is chosen by the cRIO's tick and nothing else, so a frame that is missing costs a reading, never the
//! place in the sequence. Every limit is the watch's ([`crate::cycle`]); what stops the sequence ends it.

use model::observation::Pair;
use proto::recording::{EventLevel, TickRecord};
use supervisor::Condition;

use crate::cycle::arming_attempt::ArmingAttempt;
use crate::cycle::duty_source::{
    ActuatorCommand, DutySource, ExperimentPhase, ExperimentProgress, ModeRequest, NoticeSink, Prediction,
    SensorSample, Steering,
};
use crate::experiment::command_sequence::Row;
use crate::experiment::pump_relay::PumpRelay;
use crate::experiment::settling::SettlingDetector;
use crate::experiment::stopped::Stopped;
use crate::operator::notice::Notice;

/// Time that the pressures may take to stand still before the first row, in ticks: 60 s.
pub(super) const LONGEST_SETTLE: u32 = 3_000;
/// Time that they may take after the last, in ticks: 20 s.
const LONGEST_REST: u32 = 1_000;
/// Frames in a row with a running pump, although it was asked to stop, that prove it cannot be: half a second.
const PUMP_STOPS: u32 = 25;
/// Distance from the atmosphere that rest may read, in kPa gauge, with the pump off: a sensor's bias, and what a vent valve keeps
/// whose spring shuts it at low pressure (10.4 kPa on a rig drawn with a sagging supply). A vent that is shut keeps 60 and more.
const REST_KPA: f64 = 20.0;

#[derive(Debug, Clone, Copy, PartialEq)]
enum Phase {
    Settle,
    Play { start_tick: u32 },
    Rest,
    Over,
}

/// A sequence under way.
#[derive(Debug)]
pub struct OpenLoopPlayback {
    rows: Box<[Row]>,
    /// Relay of the model's pump: with one the rig begins at the atmosphere's pressure.
    relay: PumpRelay,
    phase: Phase,
    calm: SettlingDetector,
    /// Conditions that have barred arming at rest so far.
    attempt: ArmingAttempt,
    /// Sound frames in this phase.
    waited: u32,
    pump_runs: u32,
    /// One past the last row that was sent.
    reached: u32,
    stopped: Option<Stopped>,
}

impl OpenLoopPlayback {
    /// A sequence that waits for rest.
    pub fn new(rows: Box<[Row]>, relay: PumpRelay) -> Self {
        OpenLoopPlayback {
            rows,
            relay,
            phase: Phase::Settle,
            calm: SettlingDetector::new(),
            attempt: ArmingAttempt::new(),
            waited: 0,
            pump_runs: 0,
            reached: 0,
            stopped: None,
        }
    }

    /// Rows of the sequence.
    pub fn rows(&self) -> u32 {
        u32::try_from(self.rows.len()).unwrap_or(u32::MAX)
    }

    /// One past the last row that was sent.
    pub fn reached(&self) -> u32 {
        self.reached
    }

    /// Tells whether every row had its turn.
    pub fn is_complete(&self) -> bool {
        self.stopped.is_none() && self.reached == self.rows()
    }

    /// Reason of the end, for the recording's last line.
    pub fn ending(&self) -> (EventLevel, String) {
        let (reached, rows) = (self.reached, self.rows());
        if self.is_complete() {
            return (EventLevel::Info, format!("experiment complete: all {rows} rows were played"));
        }
        let why = self.stopped.map_or("stopped by hand".to_owned(), |why| why.to_string());
        (EventLevel::Error, format!("EXPERIMENT ABORTED after {reached} of {rows} rows: {why}"))
    }

    /// Ends it now, without coming to rest.
    pub fn end(&mut self) {
        self.phase = Phase::Over;
    }

    /// Reason why it did not come to its end; `None` also for a flight that was ended from outside.
    pub fn why_stopped(&self) -> Option<Stopped> {
        self.stopped
    }

    fn enter(&mut self, phase: Phase) {
        self.phase = phase;
        self.waited = 0;
        self.calm = SettlingDetector::new();
    }

    fn stop(&mut self, why: Stopped) {
        // While the vents are open anyway, frames that came late end nothing: the wait for rest begins anew.
        if self.phase == Phase::Settle && matches!(why, Stopped::Vented { cause: Condition::FramesMissing, .. }) {
            self.calm = SettlingDetector::new();
            return;
        }
        if matches!(self.phase, Phase::Settle | Phase::Play { .. }) {
            self.stopped = Some(why);
            self.enter(Phase::Rest);
        }
    }

    /// Tells whether the rig stands where the sequence begins.
    fn at_rest(&mut self, measured: Pair) -> bool {
        let still = self.calm.add(measured);
        // Without a relay the pump goes on, and rest is a balance somewhere.
        still && (self.relay == PumpRelay::Absent || measured.iter().all(|p| p.abs() <= REST_KPA))
    }

    fn settle(&mut self, seen: &SensorSample) -> ModeRequest {
        self.pump_runs = if seen.pump_running { self.pump_runs + 1 } else { 0 };
        if self.relay == PumpRelay::Fitted && self.pump_runs > PUMP_STOPS {
            self.stop(Stopped::PumpRuns);
        } else if self.at_rest(seen.measured) {
            match self.attempt.given_up(seen.bars_arming) {
                None if self.waited <= LONGEST_SETTLE => return ModeRequest::Play,
                bars_arming => self.stop(Stopped::NotArmed { bars_arming }),
            }
        } else if self.waited > LONGEST_SETTLE {
            self.stop(Stopped::Restless { measured: seen.measured });
        }
        ModeRequest::None
    }

    fn row(&mut self, tick: u32) -> Option<ActuatorCommand> {
        let Phase::Play { start_tick } = self.phase else { return None };
        let number = tick.wrapping_sub(start_tick);
        let row = self.rows.get(number as usize)?;
        self.reached = self.reached.max(number + 1);
        Some(ActuatorCommand { pump_on: row.pump_on, ..ActuatorCommand::run(row.duty) })
    }
}

impl DutySource for OpenLoopPlayback {
    const ONE_SESSION: bool = true;

    fn on_sample(&mut self, seen: &SensorSample) -> ModeRequest {
        self.waited += 1;
        match self.phase {
            Phase::Settle => return self.settle(seen),
            Phase::Play { start_tick } => {
                if seen.tick.wrapping_sub(start_tick) >= self.rows() {
                    self.enter(Phase::Rest);
                    return ModeRequest::Disarm(Notice::Played { tick: seen.tick });
                }
            }
            Phase::Rest => {
                if self.at_rest(seen.measured) || self.waited > LONGEST_REST {
                    self.phase = Phase::Over;
                }
            }
            Phase::Over => {}
        }
        ModeRequest::None
    }

    fn armed(&mut self, tick: u32, _measured: Pair) {
        if self.phase == Phase::Settle {
            self.enter(Phase::Play { start_tick: tick });
        }
    }

    fn predict(&mut self, _measured: Pair, _record: &mut TickRecord) -> Prediction {
        Prediction::Sound
    }

    fn decide(
        &mut self,
        tick: u32,
        _measured: Pair,
        _record: &mut TickRecord,
        _tell: NoticeSink<'_>,
    ) -> Option<ActuatorCommand> {
        Some(self.row(tick).unwrap_or(ActuatorCommand::VENT))
    }

    fn bridge(&mut self, tick: u32) -> ActuatorCommand {
        self.row(tick).unwrap_or(ActuatorCommand::VENT)
    }

    fn sent(&mut self, _answer: &ActuatorCommand) {}

    fn stopped(&mut self, cause: Option<(Condition, f64)>) {
        self.stop(cause.map_or(Stopped::Disarmed, |(cause, value)| Stopped::Vented { cause, value }));
    }

    fn is_over(&self) -> bool {
        self.phase == Phase::Over
    }

    fn verdict(&self) -> Option<(EventLevel, String)> {
        Some(self.ending())
    }

    fn steering(&self) -> Steering {
        Steering::OpenLoop
    }

    fn experiment(&self) -> Option<ExperimentProgress> {
        let phase = match self.phase {
            Phase::Settle => ExperimentPhase::Settling,
            Phase::Play { .. } => ExperimentPhase::Playing,
            Phase::Rest => ExperimentPhase::Resting,
            Phase::Over => return None,
        };
        Some(ExperimentProgress { phase, reached: self.reached, rows: self.rows() })
    }
}

#[cfg(test)]
mod tests {
    use model::observation::CHANNELS;
    use supervisor::State;

    use super::*;

    const SHUT: Row = Row { duty: [0.25, 0.5], pump_on: true };

    fn seen(tick: u32, measured: Pair, state: State) -> SensorSample {
        SensorSample { tick, measured, pump_running: false, state, bars_arming: None }
    }

    /// Frames until it asks to be armed.
    fn settles(playing: &mut OpenLoopPlayback, pressure: impl Fn(u32) -> f64) -> Option<u32> {
        (0..2 * LONGEST_SETTLE)
            .find(|tick| playing.on_sample(&seen(*tick, [pressure(*tick), 0.0], State::Standby)) == ModeRequest::Play)
    }

    #[test]
    fn what_is_barred_at_rest_ends_it_whether_the_bar_goes_later_or_not() {
        let barred = |tick| SensorSample {
            bars_arming: Some(Condition::NotRecorded),
            ..seen(tick, [0.0; CHANNELS], State::Standby)
        };
        let mut playing = OpenLoopPlayback::new([SHUT].into(), PumpRelay::Fitted);
        let usual = settles(&mut OpenLoopPlayback::new([SHUT].into(), PumpRelay::Fitted), |_| 0.0).unwrap();
        // Half a second from rest on, as long as an order to arm counts.
        let ended = (0..LONGEST_SETTLE).find(|tick| {
            playing.on_sample(&barred(*tick));
            playing.why_stopped().is_some()
        });
        assert_eq!(ended, Some(usual + 25));
        assert_eq!(playing.why_stopped(), Some(Stopped::NotArmed { bars_arming: Some(Condition::NotRecorded) }));
        assert!(playing.verdict().is_some_and(|(_, text)| text.contains("nothing would be recorded")));
        assert_eq!(settles(&mut playing, |_| 0.0), None, "the bar is gone, and nobody asks any more");
        assert!(playing.is_over() && playing.reached() == 0);
        // A bar that goes before the rig is at rest, or within the half second, costs nothing.
        let mut playing = OpenLoopPlayback::new([SHUT].into(), PumpRelay::Fitted);
        (0..usual + 20).for_each(|tick| _ = playing.on_sample(&barred(tick)));
        assert_eq!(settles(&mut playing, |_| 0.0), Some(0));
    }

    #[test]
    fn a_rig_at_rest_that_is_never_armed_ends_it_too() {
        let mut playing = OpenLoopPlayback::new([SHUT].into(), PumpRelay::Fitted);
        for tick in 0..=LONGEST_SETTLE {
            playing.on_sample(&seen(tick, [0.0; CHANNELS], State::Vent));
        }
        assert_eq!(playing.why_stopped(), Some(Stopped::NotArmed { bars_arming: None }));
    }

    #[test]
    fn waits_until_the_pressures_stand_still() {
        // A vent of half a second's time constant from 90 kPa: below 0.1 kPa of rest after 3.4 s, 170 ticks.
        let blown = settles(&mut OpenLoopPlayback::new([SHUT].into(), PumpRelay::Fitted), |t| {
            90.0 * (-f64::from(t) / 25.0).exp()
        })
        .unwrap();
        assert!((100..250).contains(&blown), "{blown}");
        let at_once = settles(&mut OpenLoopPlayback::new([SHUT].into(), PumpRelay::Fitted), |_| 0.4).unwrap();
        assert!(at_once < 100, "{at_once}");
    }

    #[test]
    fn a_rig_that_stays_under_pressure_is_refused_and_without_a_relay_it_is_not() {
        let mut playing = OpenLoopPlayback::new([SHUT].into(), PumpRelay::Fitted);
        assert_eq!(settles(&mut playing, |_| 40.0), None);
        assert!(matches!(playing.why_stopped(), Some(Stopped::Restless { .. })));
        assert!(settles(&mut OpenLoopPlayback::new([SHUT].into(), PumpRelay::Absent), |_| 40.0).is_some());
    }

    #[test]
    fn rows_follow_the_crios_tick_whatever_is_missing() {
        let rows: Vec<Row> = (0..10).map(|k| Row { duty: [0.1 * f64::from(k), 0.5], pump_on: k % 2 == 0 }).collect();
        let mut playing = OpenLoopPlayback::new(rows.clone().into(), PumpRelay::Fitted);
        playing.armed(100, [0.0; CHANNELS]);
        for k in [0, 1, 4, 4, 9] {
            let expected = rows[k as usize];
            let answer = if k == 4 {
                playing.bridge(100 + k)
            } else {
                playing.on_sample(&seen(100 + k, [0.0; CHANNELS], State::Run));
                playing.decide(100 + k, [0.0; CHANNELS], &mut TickRecord::default(), &mut |_| ()).unwrap()
            };
            assert_eq!((answer.duty, answer.pump_on), (expected.duty, expected.pump_on), "row {k}");
        }
        assert!(playing.is_complete() && playing.why_stopped().is_none());
        assert!(matches!(
            playing.on_sample(&seen(110, [0.0; CHANNELS], State::Run)),
            ModeRequest::Disarm(Notice::Played { tick: 110 })
        ));
        assert_eq!(playing.bridge(111), ActuatorCommand::VENT);
    }

    #[test]
    fn what_stops_it_stops_it_for_good_and_the_first_reason_stays() {
        let mut playing = OpenLoopPlayback::new([SHUT; 10].into(), PumpRelay::Fitted);
        playing.armed(0, [0.0; CHANNELS]);
        playing.bridge(0);
        playing.stopped(Some((Condition::OverPressure, 161.0)));
        DutySource::stopped(&mut playing, None);
        playing.armed(1, [0.0; CHANNELS]);
        assert_eq!(playing.bridge(1), ActuatorCommand::VENT);
        let (level, text) = playing.verdict().unwrap();
        assert_eq!(level, EventLevel::Error);
        assert!(text.contains("1 of 10") && text.contains("161.0 kPa"), "{text}");
    }

    #[test]
    fn late_frames_before_the_first_row_only_cost_time() {
        let mut playing = OpenLoopPlayback::new([SHUT].into(), PumpRelay::Fitted);
        let usual = settles(&mut OpenLoopPlayback::new([SHUT].into(), PumpRelay::Fitted), |_| 0.0).unwrap();
        for tick in 0..usual {
            assert_eq!(playing.on_sample(&seen(tick, [0.0; CHANNELS], State::Standby)), ModeRequest::None);
        }
        playing.stopped(Some((Condition::FramesMissing, 26.0)));
        assert_eq!(playing.why_stopped(), None);
        assert_eq!(settles(&mut playing, |_| 0.0), Some(usual), "the whole wait again");
        playing.stopped(Some((Condition::SensorPositive, 0.0)));
        assert!(playing.why_stopped().is_some());
    }

    #[test]
    fn a_pump_that_cannot_be_stopped_is_found_before_anything_moves() {
        let running = |tick| SensorSample { pump_running: true, ..seen(tick, [40.0, -40.0], State::Standby) };
        let mut playing = OpenLoopPlayback::new([SHUT].into(), PumpRelay::Fitted);
        assert!((0..200).all(|tick| playing.on_sample(&running(tick)) == ModeRequest::None));
        assert_eq!(playing.why_stopped(), Some(Stopped::PumpRuns));
        assert_eq!(playing.reached(), 0);
    }
}
