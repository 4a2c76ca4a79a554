//! Duty source of a running daemon: its reference, with an experiment in between where an operator asks for one.
//!
//! ```text
//!   reference ──experiment asked for: vents open──▶ settle ▶ play ▶ rest ──played to its end, was armed──▶ armed ▶ reference
//!                                                     └──── stopped by anything ────▶ rest ──▶ standing by
//! ```
//!
//! The hand-over is at a tick's edge, with both vents open on either side: an experiment begins at rest
//! ([`OpenLoopPlayback`]), and the reference begins anew when the rig is armed after it.

use handover::{ExplorationRules, ExplorationShown};
use model::observation::Pair;
use model::rig::{Rig, RigError};
use monitor::Monitor;
use policy::Policy;
use proto::recording::TickRecord;
use proto::reference::Reference;
use safety_filter::SafetyFilter;
use supervisor::{Condition, ControlledBy, State};

use crate::cycle::arming_attempt::ArmingAttempt;
use crate::cycle::duty_source::{
    ActuatorCommand, Afterwards, DutySource, ExperimentPhase, ExperimentProgress, ModeRequest, NoticeSink, Prediction,
    SensorSample, Steering,
};
use crate::cycle::reference_tracking::ReferenceTracking;
use crate::experiment::open_loop_playback::OpenLoopPlayback;

/// Sound frames within which the rig must be armed again after an experiment: 10 s (chosen; the supervisor asks for half a
/// second of them). What keeps it from that is a person's to look at, and what bars it for half a second ends it at once.
const MOST_TICKS_TO_ARM: u32 = 500;

/// A reference, and an experiment while one is played.
pub struct RunningSource {
    tracking: ReferenceTracking,
    /// The experiment, from the tick that takes it to the one that hands it back.
    playback: Option<Box<OpenLoopPlayback>>,
    /// State that follows it.
    afterwards: Afterwards,
    /// Frames left to be armed again in, once it is over.
    to_arm: u32,
    /// Conditions that have barred arming so far.
    attempt: ArmingAttempt,
}

impl RunningSource {
    /// The loop for the rig that the model is made of; without a policy the fallback controls.
    ///
    /// # Errors
    /// As [`ReferenceTracking::new`].
    pub fn new(rig: &Rig, policy: Option<Policy>, reference: Reference) -> Result<Self, RigError> {
        Ok(RunningSource {
            tracking: ReferenceTracking::new(rig, policy, reference)?,
            playback: None,
            afterwards: Afterwards::StandingBy,
            to_arm: 0,
            attempt: ArmingAttempt::new(),
        })
    }

    /// The closed loop.
    pub fn tracking(&self) -> &ReferenceTracking {
        &self.tracking
    }

    /// The closed loop, for replays.
    pub fn tracking_mut(&mut self) -> &mut ReferenceTracking {
        &mut self.tracking
    }

    /// The experiment that has the duties now.
    fn playing(&mut self) -> Option<&mut OpenLoopPlayback> {
        self.playback.as_deref_mut().filter(|playback| !playback.is_over())
    }

    fn is_playing(&self) -> bool {
        self.playback.as_ref().is_some_and(|playback| !playback.is_over())
    }

    /// Once the rig stands at rest after an experiment that was played to its end.
    fn ended(&mut self) {
        let complete = self.playback.as_ref().is_some_and(|playback| playback.is_complete());
        if complete && self.afterwards == Afterwards::Armed {
            self.to_arm = MOST_TICKS_TO_ARM;
            self.attempt = ArmingAttempt::new();
        }
    }

    /// Request after an experiment that began under control, frame by frame until the rig is armed again.
    fn asks_to_be_armed_again(&mut self, seen: &SensorSample) -> ModeRequest {
        self.to_arm -= 1;
        if self.attempt.given_up(seen.bars_arming).is_some() {
            self.to_arm = 0;
            return ModeRequest::None;
        }
        // From anything else a person has to arm.
        if seen.state == State::Standby { ModeRequest::Arm } else { ModeRequest::None }
    }
}

impl DutySource for RunningSource {
    const ONE_SESSION: bool = false;

    fn exchange_model(
        &mut self,
        state: State,
        filter: &mut SafetyFilter,
        monitor: &mut Monitor,
        record: &mut TickRecord,
    ) {
        self.tracking.exchange_model(state, filter, monitor, record);
    }

    fn on_sample(&mut self, seen: &SensorSample) -> ModeRequest {
        if let Some(playback) = self.playing() {
            let wanted = playback.on_sample(seen);
            if playback.is_over() {
                self.ended();
            }
            return wanted;
        }
        self.tracking.on_sample(seen);
        if self.to_arm > 0 && !seen.state.is_controlling() {
            return self.asks_to_be_armed_again(seen);
        }
        ModeRequest::None
    }

    fn armed(&mut self, tick: u32, measured: Pair) {
        self.to_arm = 0;
        match self.playing() {
            Some(playback) => playback.armed(tick, measured),
            None => self.tracking.armed(tick, measured),
        }
    }

    fn predict(&mut self, measured: Pair, record: &mut TickRecord) -> Prediction {
        match self.playing() {
            Some(playback) => playback.predict(measured, record),
            None => self.tracking.predict(measured, record),
        }
    }

    fn decide(
        &mut self,
        tick: u32,
        measured: Pair,
        record: &mut TickRecord,
        tell: NoticeSink<'_>,
    ) -> Option<ActuatorCommand> {
        if self.is_playing() {
            self.tracking.looked(tick, measured);
        }
        match self.playing() {
            Some(playback) => playback.decide(tick, measured, record, tell),
            None => self.tracking.decide(tick, measured, record, tell),
        }
    }

    fn bridge(&mut self, tick: u32) -> ActuatorCommand {
        match self.playing() {
            Some(playback) => playback.bridge(tick),
            None => self.tracking.bridge(tick),
        }
    }

    fn sent(&mut self, answer: &ActuatorCommand) {
        if self.is_playing() {
            self.tracking.keep_sample(answer);
        } else {
            self.tracking.sent(answer);
        }
    }

    fn held(&mut self, answer: &ActuatorCommand) {
        if !self.is_playing() {
            self.tracking.held(answer);
        }
    }

    fn controlled_by(&mut self, controller: ControlledBy) {
        self.tracking.controlled_by(controller);
    }

    fn stopped(&mut self, cause: Option<(Condition, f64)>) {
        self.to_arm = 0;
        let Some(playback) = self.playing() else { return self.tracking.stopped(cause) };
        playback.stopped(cause);
        // Late frames while it settles only cost time; whatever else opens the vents is for a person to look at.
        let settling = playback.experiment().is_some_and(|e| e.phase == ExperimentPhase::Settling);
        if cause.is_none() || !settling {
            self.afterwards = Afterwards::StandingBy;
        }
    }

    fn is_over(&self) -> bool {
        false
    }

    fn exchange_reference(&mut self, reference: Box<Reference>, running: Option<(u32, Pair)>) -> Box<Reference> {
        // While an experiment is played the reference begins when the rig is armed after it.
        let running = running.filter(|_| !self.is_playing());
        self.tracking.exchange_reference(reference, running)
    }

    fn steering(&self) -> Steering {
        if self.is_playing() { Steering::OpenLoop } else { Steering::ClosedLoop }
    }

    fn experiment(&self) -> Option<ExperimentProgress> {
        self.playback.as_ref().and_then(|playback| playback.experiment())
    }

    fn begin_experiment(
        &mut self,
        playback: Box<OpenLoopPlayback>,
        afterwards: Afterwards,
    ) -> Result<(), Box<OpenLoopPlayback>> {
        if self.playback.is_some() {
            return Err(playback);
        }
        self.tracking.explore(None);
        self.playback = Some(playback);
        self.afterwards = afterwards;
        self.to_arm = 0;
        Ok(())
    }

    fn take_finished_experiment(&mut self) -> Option<Box<OpenLoopPlayback>> {
        self.playback.take_if(|playback| playback.is_over())
    }

    fn explore(&mut self, rules: Option<ExplorationRules>) {
        self.tracking.explore(rules.filter(|_| !self.is_playing()));
    }

    fn exploration(&self) -> Option<ExplorationShown> {
        self.tracking.exploration()
    }

    fn session_over(&mut self) {
        self.to_arm = 0;
        if let Some(playback) = self.playing() {
            playback.end();
        }
    }
}
