//! One tick, from volts to duties, without socket, clock or thread.
//!
//! ```text
//! SENSE ─▶ observe: volts checked, limits, state ─▶ predict: MPObs ─▶ decide: law, saturation ─▶ COMMAND
//!                                                                                   │
//!                                                        settle: model and integrals move on ◀┘
//! ```
//!
//! Split in four so that the caller can stamp the time between them. What happens to the rig is never an
//! error here but a state with a defined answer: whatever is wrong, the answer is duty 1 on both valves.

use std::sync::Arc;

use law::{Approach, Situation, TICK_S};
use model::contract::{AHEAD, ActionTrajectory, CHANNELS, Pair};
use model::predict::Predictor;
use model::rig::{Rig, RigError};
use model::steady::SteadyMap;
use policy::Policy;
use proto::recording::{LawParts, TickRecord};
use proto::reference::Reference;
use proto::wire::{CrioState, Mode, Sense, TripBits};

use crate::config::Safety;
use crate::notice::{Cause, Notice};
use crate::pilot::Pilot;
use crate::sensing::Sensing;
use crate::state::{State, Supervisor, Transition};

/// Both vents open: what is sent whenever the rig is not being controlled.
pub const VENT: Pair = [1.0, 1.0];
/// Frames that may be missing in a row before the rig is vented; the plan is followed meanwhile.
const TOLERATED_MISSING: u32 = 1;

/// How often a reference is looked at for places out of reach, in s, and at how many places at most.
const REACH_EVERY_S: f64 = 0.25;
const REACH_LOOKS: f64 = 100_000.0;
/// Duty by which the model may be off before a place counts as out of reach.
const REACH_SLACK: f64 = 0.03;

/// What is to be sent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Answer {
    /// Duties, positive and negative valve.
    pub duty: Pair,
    /// Mode.
    pub mode: Mode,
    /// Whether the pump is to run.
    pub pump_on: bool,
}

impl Answer {
    const VENT: Answer = Answer { duty: VENT, mode: Mode::Vent, pump_on: false };
}

/// Where notices go; the tick calls it at most a few times.
pub type Tell<'a> = &'a mut dyn FnMut(Notice);

/// The control cycle and everything it remembers.
pub struct Cycle {
    sensing: Sensing,
    safety: Safety,
    predictor: Predictor,
    map: Arc<SteadyMap>,
    pilot: Pilot,
    supervisor: Supervisor,
    reference: Box<Reference>,
    approach: Approach,
    armed_tick: u32,
    tick: u32,
    /// Ticks after arming at which the flight ends; `None` flies on.
    flight_ticks: Option<u32>,
    over: bool,
    measured: Pair,
    predicted: [Pair; AHEAD],
    trajectory: ActionTrajectory,
    answer: Answer,
    missing: u32,
    crio_tripped: bool,
}

impl Cycle {
    /// A cycle for the rig that the model is made of.
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
        let map = Arc::new(SteadyMap::new(rig)?);
        Ok(Cycle {
            sensing: Sensing::of(rig)?,
            safety,
            predictor: Predictor::new(rig)?,
            pilot: Pilot::new(Arc::clone(&map), policy),
            map,
            supervisor: Supervisor::new(auto_arm),
            reference: Box::new(reference),
            approach: Approach::new([0.0; CHANNELS], [0.0; CHANNELS]),
            armed_tick: 0,
            tick: 0,
            flight_ticks: None,
            over: false,
            measured: [0.0; CHANNELS],
            predicted: [[f64::NAN; CHANNELS]; AHEAD],
            trajectory: ActionTrajectory::held(VENT),
            answer: Answer::VENT,
            missing: 0,
            crio_tripped: false,
        })
    }

    /// Ends the flight this long after arming.
    pub fn end_after(&mut self, seconds: f64) {
        self.flight_ticks = Some((seconds / TICK_S).round() as u32);
    }

    /// Whether the flight has come to the end set by [`Cycle::end_after`].
    pub fn is_over(&self) -> bool {
        self.over
    }

    /// The first place of the reference that no duty holds, by the model: time in s, pressures in kPa gauge.
    pub fn out_of_reach(&self) -> Option<(f64, Pair)> {
        let looks = (self.reference.end_s() / REACH_EVERY_S).ceil().min(REACH_LOOKS);
        (0..=looks as u32).map(|n| f64::from(n) * REACH_EVERY_S).find_map(|time_s| {
            let goal = self.reference.at(time_s);
            let duty = self.map.duty_for(goal, [0.0; CHANNELS]);
            let held = duty.iter().all(|u| (-REACH_SLACK..=1.0 + REACH_SLACK).contains(u));
            (!held).then_some((time_s, goal))
        })
    }

    /// The state.
    pub fn state(&self) -> State {
        self.supervisor.state()
    }

    /// Arming and disarming.
    pub fn supervisor(&mut self) -> &mut Supervisor {
        &mut self.supervisor
    }

    /// Puts in another reference, which starts at once, and hands back the old one, to be dropped elsewhere.
    pub fn exchange_reference(&mut self, reference: Box<Reference>) -> Box<Reference> {
        let old = std::mem::replace(&mut self.reference, reference);
        if self.state() == State::Run {
            self.start_reference();
        }
        old
    }

    /// A new session: nothing of the old one counts.
    pub fn session_opened(&mut self) {
        self.supervisor.session_opened();
        self.missing = 0;
        self.crio_tripped = false;
        self.answer = Answer::VENT;
    }

    /// Takes in a frame: volts, limits, state.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn observe(&mut self, sense: &Sense, record: &mut TickRecord, tell: Tell<'_>) {
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
        match self.supervisor.sound_frame() {
            Transition::None => {}
            Transition::Armed { auto } => {
                self.start_reference();
                self.predictor.restart(self.measured, VENT);
                self.pilot.restart(VENT);
                self.trajectory = ActionTrajectory::held(VENT);
                tell(Notice::Armed { tick: self.tick, auto });
            }
            Transition::Disarmed => tell(Notice::Disarmed { tick: self.tick }),
            Transition::Recovered => tell(Notice::Recovered { tick: self.tick }),
        }
        let flown = self.tick.wrapping_sub(self.armed_tick);
        if self.state() == State::Run && self.flight_ticks.is_some_and(|end| flown >= end) {
            self.over = true;
            self.supervisor.disarm();
            self.supervisor.sound_frame();
            tell(Notice::FlightOver { tick: self.tick });
        }
    }

    /// Rolls the model ahead from what was measured.
    ///
    /// # Real-time
    /// Runs in the tick; five ticks of the model.
    pub fn predict(&mut self, record: &mut TickRecord) {
        if self.state() != State::Run {
            return;
        }
        self.predictor.observe(self.measured);
        self.predicted = self.predictor.predict(&self.trajectory.remaining(), true);
        if !self.predicted.as_flattened().iter().all(|p| p.is_finite()) {
            // A diverged model must not reach the policy; "stays as it is" is the plainest forecast.
            self.predicted = [self.measured; AHEAD];
            self.predictor.restart(self.measured, self.answer.duty);
        }
        record.predicted_pos_kpa = self.predicted.map(|p| p[0]);
        record.predicted_neg_kpa = self.predicted.map(|p| p[1]);
    }

    /// Decides what to send.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn decide(&mut self, record: &mut TickRecord, tell: Tell<'_>) -> Answer {
        self.answer = Answer::VENT;
        if self.state() == State::Run {
            let time_s = f64::from(self.tick.wrapping_sub(self.armed_tick)) * TICK_S;
            let goals_kpa = std::array::from_fn(|j| {
                let at = time_s + j as f64 * TICK_S;
                let (goal, offset) = (self.reference.at(at), self.approach.offset_kpa(at));
                std::array::from_fn(|c| goal[c] + offset[c])
            });
            // What a person compares with is the reference as given, not the way to it.
            [record.ref_pos_kpa, record.ref_neg_kpa] = self.reference.at(time_s);
            let piloted = self.pilot.decide(&Situation { measured_kpa: self.measured, goals_kpa }, &self.predicted);
            if piloted.refused {
                tell(Notice::PolicyRefused { tick: self.tick });
            }
            let decision = piloted.decision;
            [record.law_pos, record.law_neg] = decision.parts.map(|p| LawParts {
                feed_forward: p.feed_forward + p.play + p.correction,
                proportional: p.proportional,
                integral: p.integral,
                u_raw: p.raw(),
            });
            if decision.raw().iter().all(|u| u.is_finite()) {
                self.trajectory = decision.trajectory;
                self.answer = Answer { duty: decision.duty(), mode: Mode::Run, pump_on: true };
            } else {
                self.vent(Cause::LawNotFinite, f64::NAN, tell);
            }
        }
        self.note_answer(record)
    }

    /// No frame came in time. Once the plan is followed; from then on the vents are open.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn frame_missing(&mut self, late_ms: f64, record: &mut TickRecord, tell: Tell<'_>) -> Answer {
        self.tick = self.tick.wrapping_add(1);
        self.missing += 1;
        if self.missing <= TOLERATED_MISSING && self.state() == State::Run {
            tell(Notice::FrameMissed { tick: self.tick, late_ms });
            let rest = self.trajectory.remaining();
            self.trajectory = ActionTrajectory(std::array::from_fn(|j| rest[j.min(AHEAD - 1)]));
            self.answer = Answer { duty: self.trajectory.now(), mode: Mode::Run, pump_on: true };
        } else {
            self.vent(Cause::FramesMissing, late_ms, tell);
        }
        self.note_answer(record)
    }

    /// The link is gone; the cRIO vents by itself.
    pub fn link_lost(&mut self, tell: Tell<'_>) {
        self.vent(Cause::LinkLost, 0.0, tell);
    }

    /// Moves model and integrals on through the tick; call it once the answer is out.
    ///
    /// # Real-time
    /// Runs in the tick; one tick of the model.
    pub fn settle(&mut self) {
        if self.state() == State::Run {
            self.pilot.applied(self.answer.duty);
            self.predictor.advance(self.answer.duty, self.answer.pump_on);
        }
    }

    /// Whether the cRIO has tripped and waits for a new session, whatever vented the rig before.
    pub fn crio_tripped(&self) -> bool {
        self.crio_tripped
    }

    /// Frames missing in a row.
    pub fn missing(&self) -> u32 {
        self.missing
    }

    /// Half width of play that the fallback learned, in duty.
    pub fn learned_play(&self) -> Pair {
        self.pilot.learned_play()
    }

    fn start_reference(&mut self) {
        self.armed_tick = self.tick;
        self.approach = Approach::new(self.measured, self.reference.at(0.0));
    }

    fn vent(&mut self, cause: Cause, value: f64, tell: Tell<'_>) {
        self.answer = Answer::VENT;
        if self.supervisor.fault(cause) {
            tell(Notice::Vented { cause, tick: self.tick, value });
        }
    }

    fn note_answer(&self, record: &mut TickRecord) -> Answer {
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
    fn answer(cycle: &mut Cycle, frame: &Sense) -> (Answer, Vec<Notice>) {
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
            assert_eq!(answer, Answer::VENT);
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
        assert_eq!((vented, record.tick), (Answer::VENT, 61));
        assert!(matches!(
            told.as_slice(),
            [Notice::FrameMissed { .. }, Notice::Vented { cause: Cause::FramesMissing, .. }]
        ));
    }
}
