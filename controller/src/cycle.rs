//! One tick, from volts to duties, without socket, clock or thread.
//!
//! ```text
//! SENSE ─▶ observe: volts checked, limits, state ─▶ predict: MPObs ─▶ decide: law or sequence ─▶ safety filter ─▶ COMMAND
//!                                                                                                      │
//!                                                                           settle: model and integrals move on ◀┘
//! ```
//!
//! Split in four so that the caller can stamp the time between them. What happens to the rig is never an
//! error here but a state with a defined answer: whatever is wrong, the answer is duty 1 on both valves. This is the
//! watch; what is steered for while all is sound is its [`DutySource`].

use model::observation::{CHANNELS, Pair};
use model::rig::{Rig, RigError};
use policy::Policy;
use proto::recording::TickRecord;
use proto::reference::Reference;
use proto::wire::{CrioState, Sense, TripBits};
use safety_filter::{Envelope, Intervention, SafetyFilter, SlewLimit};

use crate::command_sequence::Row;
use crate::config::Safety;
use crate::duty_source::{ActuatorCommand, DutySource, ModeRequest, NoticeSink, SensorSample};
use crate::notice::{Cause, Notice};
use crate::open_loop_playback::OpenLoopPlayback;
use crate::reference_tracking::ReferenceTracking;
use crate::sensing::Sensing;
use crate::state::{State, Supervisor, Transition};

/// Frames that may be missing in a row before the rig is vented; the plan is followed meanwhile.
const TOLERATED_MISSING: u32 = 1;
/// Ticks without an intervention of the safety filter after which the next one is told again.
const FILTER_TOLD_AGAIN: u32 = 50;

/// The control cycle and everything it remembers.
pub struct Cycle<H = ReferenceTracking> {
    sensing: Sensing,
    safety: Safety,
    duty_source: H,
    filter: SafetyFilter,
    /// Ticks since the safety filter last changed a command, for telling each time once.
    filter_quiet: u32,
    supervisor: Supervisor,
    tick: u32,
    measured: Pair,
    answer: ActuatorCommand,
    missing: u32,
    crio_tripped: bool,
}

impl Cycle<ReferenceTracking> {
    /// A cycle that follows a reference on the rig that the model is made of.
    ///
    /// # Errors
    /// If the rig cannot be flown: unsound, or without the valves and sensors the controller needs.
    pub fn new(
        rig: &Rig,
        policy: Option<Policy>,
        reference: Reference,
        safety: Safety,
        auto_arm: bool,
    ) -> Result<Self, RigError> {
        let filter = SafetyFilter::new(rig, envelope(safety), SlewLimit::DEFAULT)?;
        let parts = Parts { sensing: Sensing::of(rig)?, filter, safety };
        Ok(Cycle::with(ReferenceTracking::new(rig, policy, reference)?, parts, auto_arm))
    }
}

impl Cycle<OpenLoopPlayback> {
    /// A cycle that plays the rows of a sequence once, from rest, and arms itself for it; `relay`: whether the rig's
    /// pump can be switched.
    ///
    /// # Errors
    /// If the rig lacks one of the two sensors.
    pub fn playing(rig: &Rig, rows: Box<[Row]>, relay: bool, safety: Safety) -> Result<Self, RigError> {
        // Rows are played as they are; only what would leave the envelope is bent.
        let filter = SafetyFilter::new(rig, envelope(safety), SlewLimit::None)?;
        let parts = Parts { sensing: Sensing::of(rig)?, filter, safety };
        Ok(Cycle::with(OpenLoopPlayback::new(rows, relay), parts, false))
    }
}

/// What the safety filter keeps: the limits beyond which the rig is vented.
fn envelope(safety: Safety) -> Envelope {
    Envelope { max_pos_kpa: safety.max_pos_kpa, min_neg_kpa: safety.min_neg_kpa }
}

/// What stands around any duty source.
struct Parts {
    sensing: Sensing,
    filter: SafetyFilter,
    safety: Safety,
}

impl<H: DutySource> Cycle<H> {
    fn with(duty_source: H, parts: Parts, auto_arm: bool) -> Self {
        let Parts { sensing, filter, safety } = parts;
        Cycle {
            sensing,
            safety,
            duty_source,
            filter,
            filter_quiet: FILTER_TOLD_AGAIN,
            supervisor: Supervisor::new(auto_arm),
            tick: 0,
            measured: [0.0; CHANNELS],
            answer: ActuatorCommand::VENT,
            missing: 0,
            crio_tripped: false,
        }
    }

    /// What is steered for.
    pub fn duty_source(&self) -> &H {
        &self.duty_source
    }

    /// What is steered for, to be set before the flight.
    pub fn duty_source_mut(&mut self) -> &mut H {
        &mut self.duty_source
    }

    /// Whether there is nothing more to fly.
    pub fn is_over(&self) -> bool {
        self.duty_source.is_over()
    }

    /// The state.
    pub fn state(&self) -> State {
        self.supervisor.state()
    }

    /// Whether the rig can be armed now.
    pub fn can_arm(&self) -> bool {
        self.supervisor.can_arm()
    }

    /// The operator asks to arm.
    pub fn arm(&mut self) {
        self.supervisor.arm();
    }

    /// The operator asks to disarm.
    pub fn disarm(&mut self) {
        self.supervisor.disarm();
        self.duty_source.stopped(None);
    }

    /// Puts in another reference, which starts at once, and hands back the old one, to be dropped elsewhere.
    pub fn exchange_reference(&mut self, reference: Box<Reference>) -> Box<Reference> {
        let running = (self.state() == State::Run).then_some((self.tick, self.measured));
        self.duty_source.exchange_reference(reference, running)
    }

    /// A new session: nothing of the old one counts.
    pub fn session_opened(&mut self) {
        self.supervisor.session_opened();
        self.missing = 0;
        self.crio_tripped = false;
        self.answer = ActuatorCommand::VENT;
    }

    /// Takes in a frame: volts, limits, state.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn observe(&mut self, sense: &Sense, record: &mut TickRecord, tell: NoticeSink<'_>) {
        self.tick = sense.tick;
        self.missing = 0;
        self.crio_tripped = sense.state == CrioState::Tripped;
        record.volts = sense.volts;
        [record.echo_pos, record.echo_neg] = sense.duty;
        record.crio_state = sense.state.code();
        record.crio_trip = sense.trips.bits();
        match self.sensing.pressures_kpa(&sense.volts) {
            Ok(pressures) => {
                self.measured = pressures;
                [record.p_pos_kpa, record.p_neg_kpa] = pressures;
            }
            Err(broken) => {
                let cause = if broken.channel == 0 { Cause::SensorPositive } else { Cause::SensorNegative };
                return self.vent(cause, broken.volts, tell);
            }
        }
        if self.crio_tripped {
            let ours = sense.trips == TripBits::COMMAND_LOST;
            let cause = if ours { Cause::CommandsLost } else { Cause::CrioTripped };
            return self.vent(cause, f64::from(sense.trips.bits()), tell);
        }
        if self.measured[0] > self.safety.max_pos_kpa {
            return self.vent(Cause::OverPressure, self.measured[0], tell);
        }
        if self.measured[1] < self.safety.min_neg_kpa {
            return self.vent(Cause::OverVacuum, self.measured[1], tell);
        }
        match self.supervisor.accept_frame() {
            Transition::None => {}
            Transition::Armed { auto } => {
                self.duty_source.armed(self.tick, self.measured);
                tell(Notice::Armed { tick: self.tick, auto });
            }
            Transition::Disarmed => tell(Notice::Disarmed { tick: self.tick }),
            Transition::Recovered => tell(Notice::Recovered { tick: self.tick }),
        }
        let seen = SensorSample {
            tick: self.tick,
            measured: self.measured,
            pump_running: sense.pump_running,
            state: self.state(),
        };
        match self.duty_source.on_sample(&seen) {
            ModeRequest::None => {}
            ModeRequest::Arm => self.supervisor.arm(),
            ModeRequest::Disarm(notice) => {
                self.supervisor.disarm();
                self.supervisor.accept_frame();
                tell(notice);
            }
        }
    }

    /// Rolls the model ahead from what was measured.
    ///
    /// # Real-time
    /// Runs in the tick; five ticks of the model.
    pub fn predict(&mut self, record: &mut TickRecord) {
        self.duty_source.exchange_model(&mut self.filter, record);
        if self.state() == State::Run {
            self.duty_source.predict(self.measured, self.answer.duty, record);
        }
        // Vented as well, so that it stands where the rig is when the rig is armed.
        self.filter.observe(self.measured);
    }

    /// Decides what to send.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn decide(&mut self, record: &mut TickRecord, tell: NoticeSink<'_>) -> ActuatorCommand {
        self.answer = ActuatorCommand::VENT;
        if self.state() == State::Run {
            match self.duty_source.decide(self.tick, self.measured, record, tell) {
                Some(answer) => self.answer = self.filtered(answer, record, tell),
                None => self.vent(Cause::LawNotFinite, f64::NAN, tell),
            }
        }
        self.note_answer(record)
    }

    /// No frame came in time. Once the plan or sequence goes on; from then on the vents are open.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn frame_missing(&mut self, late_ms: f64, record: &mut TickRecord, tell: NoticeSink<'_>) -> ActuatorCommand {
        self.tick = self.tick.wrapping_add(1);
        self.missing += 1;
        if self.missing <= TOLERATED_MISSING && self.state() == State::Run {
            tell(Notice::FrameMissed { tick: self.tick, late_ms });
            let bridged = self.duty_source.bridge(self.tick);
            self.answer = self.filtered(bridged, record, tell);
        } else {
            self.vent(Cause::FramesMissing, late_ms, tell);
        }
        self.note_answer(record)
    }

    /// The link is gone; the cRIO vents by itself.
    pub fn link_lost(&mut self, tell: NoticeSink<'_>) {
        self.vent(Cause::LinkLost, 0.0, tell);
    }

    /// Moves model and integrals on through the tick; call it once the answer is out.
    ///
    /// # Real-time
    /// Runs in the tick; one tick of the model.
    pub fn settle(&mut self) {
        if self.state() == State::Run {
            self.duty_source.sent(&self.answer);
        }
        self.filter.sent(self.answer.duty);
    }

    /// The command that may be sent in place of the one that was asked for.
    fn filtered(&mut self, asked: ActuatorCommand, record: &mut TickRecord, tell: NoticeSink<'_>) -> ActuatorCommand {
        let filtered = self.filter.limit(asked.duty);
        record.command_before_filter = asked.duty;
        record.filter_active = filtered.intervention != Intervention::None;
        if filtered.intervention > Intervention::Slew {
            if self.filter_quiet >= FILTER_TOLD_AGAIN {
                tell(Notice::Filtered { tick: self.tick, asked: asked.duty, measured: self.measured });
            }
            self.filter_quiet = 0;
        } else {
            self.filter_quiet = self.filter_quiet.saturating_add(1);
        }
        ActuatorCommand { duty: filtered.duty, ..asked }
    }

    /// Commands that the safety filter has changed since the start.
    pub fn filter_interventions(&self) -> u64 {
        self.filter.interventions()
    }

    /// Whether the cRIO has tripped and waits for a new session, whatever vented the rig before.
    pub fn crio_tripped(&self) -> bool {
        self.crio_tripped
    }

    /// Frames missing in a row.
    pub fn missing(&self) -> u32 {
        self.missing
    }

    fn vent(&mut self, cause: Cause, value: f64, tell: NoticeSink<'_>) {
        self.answer = ActuatorCommand::VENT;
        if self.supervisor.fault(cause) {
            self.duty_source.stopped(Some((cause, value)));
            tell(Notice::Vented { cause, tick: self.tick, value });
        }
    }

    fn note_answer(&self, record: &mut TickRecord) -> ActuatorCommand {
        record.tick = self.tick;
        [record.u_pos, record.u_neg] = self.answer.duty;
        record.mode = self.answer.mode.code();
        record.pump_on = self.answer.pump_on;
        record.state = self.state().code();
        record.fault = self.state().fault();
        self.answer
    }
}

#[cfg(test)]
mod tests {
    use proto::wire::Mode;

    use super::*;

    fn sense(tick: u32, volts: [f32; 2], state: CrioState, trips: TripBits) -> Sense {
        Sense {
            sequence: tick + 1,
            clock_ns: 0,
            session: 1,
            tick,
            command_in_force: 0,
            volts: [volts[0], volts[1], f32::NAN, f32::NAN],
            duty: [1.0; 2],
            state,
            pump_running: false,
            trips,
            commands_missed: 0,
        }
    }

    /// Answers one frame; the notices it made.
    fn answer(cycle: &mut Cycle, frame: &Sense) -> (ActuatorCommand, Vec<Notice>) {
        let (mut record, mut told) = (TickRecord::default(), Vec::new());
        cycle.observe(frame, &mut record, &mut |notice| told.push(notice));
        cycle.predict(&mut record);
        let answer = cycle.decide(&mut record, &mut |notice| told.push(notice));
        cycle.settle();
        (answer, told)
    }

    fn cycle() -> Cycle {
        let rig = Rig::builtin("dual_pressure").unwrap();
        Cycle::new(&rig, None, Reference::constant(85.0, -72.0), Safety::default(), true).unwrap()
    }

    const SOUND: [f32; 2] = [1.34, 3.85];

    #[test]
    fn arms_runs_and_vents_in_the_tick_of_a_fault() {
        for (volts, state, trips, cause) in [
            ([0.0, 3.85], CrioState::Running, TripBits::NONE, Cause::SensorPositive),
            ([1.34, f32::NAN], CrioState::Running, TripBits::NONE, Cause::SensorNegative),
            ([1.65, 3.85], CrioState::Running, TripBits::NONE, Cause::OverPressure),
            ([1.34, 4.8], CrioState::Running, TripBits::NONE, Cause::OverVacuum),
            (SOUND, CrioState::Tripped, TripBits::OVER_PRESSURE, Cause::CrioTripped),
            (SOUND, CrioState::Tripped, TripBits::COMMAND_LOST, Cause::CommandsLost),
        ] {
            let mut cycle = cycle();
            for tick in 0..60 {
                let (answer, _) = answer(&mut cycle, &sense(tick, SOUND, CrioState::Running, TripBits::NONE));
                assert_eq!(answer.mode == Mode::Run, tick >= 24, "tick {tick}");
            }
            let (answer, told) = answer(&mut cycle, &sense(60, volts, state, trips));
            assert_eq!(answer, ActuatorCommand::VENT);
            assert!(matches!(told.as_slice(), [Notice::Vented { cause: c, tick: 60, .. }] if *c == cause), "{told:?}");
        }
    }

    #[test]
    fn a_trip_of_the_crio_is_seen_whatever_vented_before() {
        let mut cycle = cycle();
        answer(&mut cycle, &sense(0, [0.0, 3.85], CrioState::Idle, TripBits::NONE));
        assert_eq!(cycle.state(), State::Vented(Cause::SensorPositive));
        answer(&mut cycle, &sense(1, SOUND, CrioState::Tripped, TripBits::SENSOR));
        assert!(cycle.crio_tripped());
        cycle.session_opened();
        assert!(!cycle.crio_tripped());
    }

    #[test]
    fn one_missing_frame_follows_the_plan_and_the_second_vents() {
        let mut cycle = cycle();
        for tick in 0..60 {
            answer(&mut cycle, &sense(tick, SOUND, CrioState::Running, TripBits::NONE));
        }
        let (mut record, mut told) = (TickRecord::default(), Vec::new());
        let bridged = cycle.frame_missing(26.0, &mut record, &mut |notice| told.push(notice));
        assert_eq!((bridged.mode, record.tick), (Mode::Run, 60));
        let vented = cycle.frame_missing(46.0, &mut record, &mut |notice| told.push(notice));
        assert_eq!((vented, record.tick), (ActuatorCommand::VENT, 61));
        assert!(matches!(
            told.as_slice(),
            [Notice::FrameMissed { .. }, Notice::Vented { cause: Cause::FramesMissing, .. }]
        ));
    }
}
