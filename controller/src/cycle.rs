//! One tick, from volts to duties, without socket, clock or thread.
//!
//! ```text
//! SENSE ─▶ observe: volts, limits, plausibility, state ─▶ predict: MPObs ─▶ decide: law or sequence, filter ─▶ COMMAND
//!                                                                                      │
//!                                                           settle: models and integrals move on ◀┘
//! ```
//!
//! Split in four so that the caller can stamp the time between them. What happens to the rig is never an
//! error here but a condition: [`monitor`] and the limits find conditions, [`supervisor::next`] makes a state and an action
//! of them, and this is where the action is done. What is steered for while all is sound is its [`DutySource`].

pub mod arming_attempt;
pub mod duty_source;
pub mod reference_tracking;
pub mod running_source;
pub mod sensing;

mod construction;
mod filtering;
pub(crate) mod limits;
mod requests;
mod telling;

use handover::{ExplorationShown, PolicyEvent};
use model::observation::{CHANNELS, Pair};
use monitor::plausibility::{Foresight, Phase};
use monitor::{Excitation, Frame, Monitor, SentCommand};
use proto::recording::TickRecord;
use proto::wire::{Mode, Sense};
use safety_filter::{SafetyFilter, SlewLimit};
use supervisor::{
    Acknowledgement, Action, Actuation, Arming, Condition, ConditionSet, Inputs, Integration, Memory, Request, State,
    Tick, next,
};

use filtering::FilterWatch;
use limits::check_trips;

use crate::config::Safety;
use crate::cycle::duty_source::{
    ActuatorCommand, DutySource, ModeRequest, NoticeSink, Prediction, SensorSample, Steering,
};
use crate::cycle::running_source::RunningSource;
use crate::cycle::sensing::Sensing;
use crate::operator::latched_conditions::LatchedConditions;
use crate::operator::notice::Notice;

/// Frames that may be missing in a row before the rig is vented; the plan is followed meanwhile.
const TOLERATED_MISSING: u32 = 1;

/// The control cycle and everything it remembers.
pub struct Cycle<H = RunningSource> {
    sensing: Sensing,
    safety: Safety,
    duty_source: H,
    filter: SafetyFilter,
    filter_watch: FilterWatch,
    monitor: Monitor,
    memory: Memory,
    arming: Arming,
    request: Option<Request>,
    /// Conditions of this tick.
    conditions: ConditionSet,
    /// Conditions that the caller has found since the last tick.
    reported: ConditionSet,
    tick: u32,
    measured: Pair,
    answer: ActuatorCommand,
    action: Option<Action>,
    missing: u32,
    renew_session: bool,
    faulted_ticks: u32,
    /// Exploration as it was last told.
    exploration: Option<ExplorationShown>,
}

impl<H: DutySource> Cycle<H> {
    /// Source of the duties.
    pub fn duty_source(&self) -> &H {
        &self.duty_source
    }

    /// Source of the duties, to be set before the run.
    pub fn duty_source_mut(&mut self) -> &mut H {
        &mut self.duty_source
    }

    /// Tells whether there is nothing more to run.
    pub fn is_over(&self) -> bool {
        self.duty_source.is_over()
    }

    /// The state.
    pub fn state(&self) -> State {
        self.memory.state
    }

    /// Everything that the supervisor remembers.
    pub fn memory(&self) -> &Memory {
        &self.memory
    }

    /// Conditions of the newest tick.
    pub fn conditions(&self) -> &ConditionSet {
        &self.conditions
    }

    /// The plausibility monitor.
    pub fn monitor(&self) -> &Monitor {
        &self.monitor
    }

    /// The tick of the newest frame.
    pub fn tick(&self) -> u32 {
        self.tick
    }

    /// Tells whether the rig can be armed now.
    pub fn can_arm(&self) -> bool {
        self.memory.can_arm(&self.conditions)
    }

    /// Condition that keeps the rig from being armed, in standby.
    pub fn bars_arming(&self) -> Option<Condition> {
        Memory::bars_arming(&self.conditions).filter(|_| self.memory.state == State::Standby)
    }

    /// Tells whether a session may be opened: not while a trip of the cRIO waits for a person.
    pub fn may_open_session(&self) -> bool {
        self.memory.may_open_session()
    }

    /// Takes in what the caller has found since the last tick: deadlines, losses, rights. It counts in the next tick.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn report(&mut self, condition: Condition, value: f64) {
        self.reported.insert(condition, value);
    }

    /// A new session: nothing of the old one counts but what waits for a person.
    pub fn session_opened(&mut self) {
        self.monitor.session_opened();
        self.duty_source.session_over();
        self.missing = 0;
        self.renew_session = false;
        self.request = None;
        self.conditions = ConditionSet::EMPTY;
        self.reported = ConditionSet::EMPTY;
        self.answer = ActuatorCommand::VENT;
        self.advance_state(Tick::SessionOpened, &mut |_| ());
    }

    /// Nothing will be armed in this process, for a reason that does not go away.
    pub fn refuse(&mut self, condition: Condition) {
        self.duty_source.stopped(Some((condition, 0.0)));
    }

    /// Still without a session: requests of the operator are taken.
    pub fn waiting(&mut self, tell: NoticeSink<'_>) {
        // Without frames nothing is seen to hold; what waits for a person is remembered.
        self.conditions = std::mem::take(&mut self.reported);
        self.advance_state(Tick::Waiting, tell);
    }

    /// Takes in a frame: volts, limits, plausibility, state.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn observe(&mut self, sense: &Sense, record: &mut TickRecord, tell: NoticeSink<'_>) {
        self.tick = sense.tick;
        self.missing = 0;
        record.volts = sense.volts;
        [record.echo_pos, record.echo_neg] = sense.duty;
        record.crio_state = sense.state.code();
        record.crio_trip = sense.trips.bits();
        let mut found = std::mem::take(&mut self.reported);
        let readings_kpa = self.read(sense, &mut found);
        check_trips(sense, &mut found);
        let phase = if self.state().is_controlling() { Phase::Controlled } else { Phase::Vented };
        let believed = self.monitor.observe(&Frame { sense, readings_kpa, phase }, &mut found);
        self.conditions = found;
        if let [Some(positive), Some(negative)] = believed {
            self.measured = [positive, negative];
        }
        [record.p_pos_kpa, record.p_neg_kpa] = readings_kpa.map(|p| p.unwrap_or(f64::NAN));
        self.advance_state(Tick::Frame, tell);
        // Also while something is wrong: a sequence that was stopped comes to its end whatever the rig does.
        self.ask_duty_source(sense.pump_running, tell);
    }

    /// The duty source sees the frame and may ask for a mode.
    fn ask_duty_source(&mut self, pump_running: bool, tell: NoticeSink<'_>) {
        let seen = SensorSample {
            tick: self.tick,
            measured: self.measured,
            pump_running,
            state: self.state(),
            bars_arming: self.bars_arming(),
        };
        match self.duty_source.on_sample(&seen) {
            ModeRequest::None => {}
            ModeRequest::Play => self.ask(Request::Play),
            ModeRequest::Arm => self.ask(Request::Arm),
            ModeRequest::Disarm(notice) => {
                self.ask(Request::Disarm);
                self.advance_state(Tick::Frame, &mut |_| ());
                tell(notice);
            }
        }
    }

    /// Rolls the model ahead from what was measured.
    ///
    /// # Real-time
    /// Runs in the tick; five ticks of the model.
    pub fn predict(&mut self, record: &mut TickRecord) {
        let state = self.state();
        self.duty_source.exchange_model(state, &mut self.filter, &mut self.monitor, record);
        if self.state().is_controlling() && self.duty_source.predict(self.measured, record) == Prediction::Diverged {
            self.report(Condition::ModelDiverged, 0.0);
        }
        // Vented as well, so that it stands where the rig is when the rig is armed.
        self.filter.observe(self.measured);
    }

    /// Decides what to send.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn decide(&mut self, record: &mut TickRecord, tell: NoticeSink<'_>) -> ActuatorCommand {
        let last = std::mem::replace(&mut self.answer, ActuatorCommand::VENT);
        self.tell_exploration(tell);
        if self.state().is_controlling() {
            let mut refused = false;
            let mut note = |notice: Notice| {
                refused |= matches!(notice, Notice::Policy { event: PolicyEvent::Refused(_), .. });
                tell(notice);
            };
            let decided = self.duty_source.decide(self.tick, self.measured, record, &mut note);
            if refused {
                self.report(Condition::PolicyRefused, 0.0);
            }
            match decided {
                Some(wanted) => {
                    let held = self.held(wanted, last);
                    self.answer = self.filtered(held, record, tell);
                    let reference = [record.ref_pos_kpa, record.ref_neg_kpa];
                    let noise = [record.exploration_pos, record.exploration_neg];
                    let excitation = if noise == [0.0; CHANNELS] { Excitation::None } else { Excitation::Noise };
                    self.monitor.decided(reference, self.measured, self.answer.duty, excitation);
                }
                None => {
                    self.conditions.insert(Condition::LawNotFinite, f64::NAN);
                    self.advance_state(Tick::Frame, tell);
                }
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
        self.conditions = std::mem::take(&mut self.reported);
        let tolerated = self.missing <= TOLERATED_MISSING;
        let condition = if tolerated { Condition::FrameMissing } else { Condition::FramesMissing };
        self.conditions.insert(condition, late_ms);
        self.answer = ActuatorCommand::VENT;
        self.advance_state(Tick::Missing, tell);
        if self.action.is_some_and(|action| action.actuation == Actuation::Plan) {
            tell(Notice::FrameMissed { tick: self.tick, late_ms });
            // The plan was made to be followed, so its duties move as it says.
            let bridged = ActuatorCommand { mode: Mode::Hold, ..self.duty_source.bridge(self.tick) };
            self.answer = self.filtered(bridged, record, tell);
        }
        self.note_answer(record)
    }

    /// The link is gone, or is given up for `cause`; the cRIO vents by itself.
    pub fn link_lost(&mut self, cause: Condition, value: f64, tell: NoticeSink<'_>) {
        self.conditions = std::mem::take(&mut self.reported);
        self.conditions.insert(cause, value);
        self.answer = ActuatorCommand::VENT;
        self.advance_state(Tick::LinkGone, tell);
        self.duty_source.session_over();
    }

    /// Ends the run, by the state function as every transition: both vents are to be open, and no further tick comes.
    pub fn stop(&mut self, tell: NoticeSink<'_>) {
        self.ask(Request::Stop);
        self.conditions = std::mem::take(&mut self.reported);
        self.answer = ActuatorCommand::VENT;
        self.advance_state(Tick::Waiting, tell);
    }

    /// The command that was decided went out under this sequence number.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn sent(&mut self, sequence: u32) {
        let ActuatorCommand { duty, mode, pump_on } = self.answer;
        self.monitor.sent(SentCommand { sequence, duty, mode, pump_on });
    }

    /// Moves models and integrals on through the tick; call it once the answer is out.
    ///
    /// # Real-time
    /// Runs in the tick; two ticks of the model.
    pub fn settle(&mut self) {
        if self.state().is_controlling() {
            match self.action.map(|action| action.integration) {
                Some(Integration::Off) => self.duty_source.held(&self.answer),
                _ => self.duty_source.sent(&self.answer),
            }
        }
        self.filter.sent(self.answer.duty);
        self.monitor.advance(self.answer.duty, self.answer.pump_on);
    }

    /// Tells whether the cRIO has tripped and a new HELLO may end that now.
    pub fn renew_session(&self) -> bool {
        self.renew_session
    }

    /// Frames missing in a row.
    pub fn missing(&self) -> u32 {
        self.missing
    }

    /// Calls the supervisor and does what it says.
    fn advance_state(&mut self, tick: Tick, tell: NoticeSink<'_>) {
        let was_controlling = self.state().is_controlling();
        let arming = self.watch_as_steered();
        let inputs = Inputs { tick, conditions: &self.conditions, request: self.request.take(), arming };
        let (after, action) = next(&self.memory, &inputs);
        let waited = LatchedConditions::from(&self.memory.latched);
        self.memory = after;
        self.action = Some(action);
        self.renew_session = action.renew_session;
        if was_controlling && !after.state.is_controlling() {
            self.answer = ActuatorCommand::VENT;
            self.monitor.vented(self.measured);
        }
        self.duty_source.controlled_by(action.controlled_by);
        self.tell_transition(action.transition, tell);
        match action.acknowledgement {
            Acknowledgement::None => {}
            Acknowledgement::Cleared => tell(Notice::Acknowledged { tick: self.tick }),
            Acknowledgement::StillHolds(condition) => {
                let released = waited.without((&after.latched).into());
                let value = self.conditions.value(condition);
                tell(Notice::StillHolds { condition, tick: self.tick, value, released });
            }
        }
        self.remind(tell);
        self.tell_exploration(tell);
    }

    /// Sets the watch to what is steered for, and answers who may arm.
    fn watch_as_steered(&mut self) -> Arming {
        let (foresight, slew, arming) = match self.duty_source.steering() {
            Steering::ClosedLoop => (Foresight::Judged, SlewLimit::DEFAULT, self.arming),
            Steering::OpenLoop => (Foresight::Unjudged, SlewLimit::None, Arming::Manual),
        };
        self.monitor.set_foresight(foresight);
        self.filter.set_slew(slew);
        arming
    }

    fn note_answer(&self, record: &mut TickRecord) -> ActuatorCommand {
        record.tick = self.tick;
        [record.u_pos, record.u_neg] = self.answer.duty;
        record.mode = self.answer.mode.code();
        record.pump_on = self.answer.pump_on;
        record.state = self.state().code();
        record.fault = self.state().fault(self.memory.cause);
        record.findings = self.conditions.code_bits();
        record.experiment = self.duty_source.experiment().map_or(0, |experiment| experiment.phase.code());
        self.answer
    }
}

#[cfg(test)]
pub(crate) mod tests;
