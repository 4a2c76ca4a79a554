//! ReferenceTracking a reference: model-predicted observations, control law, saturation.

use std::sync::Arc;

use admission::model_comparison::Sample;
use handover::{Arbiter, Candidate, ExplorationRules, ExplorationShown, Noise, PolicyEvent, StoreEnd, Trust, channel};
use law::{AfterEnd, ControlInput, Course, FallbackSettings, RepetitionLearning};
use model::observation::{AHEAD, ActionTrajectory, CHANNELS, Pair};
use model::predict::Predictor;
use model::rig::{Rig, RigError};
use model::shown_reference::ShownReference;
use model::steady::SteadyMap;
use monitor::Monitor;
use policy::Policy;
use proto::recording::{LawParts, TickInput, TickRecord};
use proto::reference::Reference;
use safety_filter::SafetyFilter;
use supervisor::{Condition, ControlledBy, State};

use crate::cycle::duty_source::{ActuatorCommand, DutySource, ModeRequest, NoticeSink, Prediction, SensorSample, VENT};
use crate::model_change::{self, ModelDesk, ModelTickEnd};
use crate::operator::notice::Notice;
use crate::reach::Reach;

/// The closed loop and everything it remembers.
pub struct ReferenceTracking {
    predictor: Predictor,
    map: Arc<SteadyMap>,
    control: Arbiter,
    /// The other end of the arbiter's queues, for whoever publishes policies.
    policies: StoreEnd,
    /// Event of a policy after the last command was out, to be told with the next.
    policy_event: Option<PolicyEvent>,
    /// Source of models, and its other end.
    models: ModelTickEnd,
    model_desk: ModelDesk,
    /// The tick and its readings, for comparisons of models.
    measured: Pair,
    tick: u32,
    reference: Box<Reference>,
    after_end: AfterEnd,
    course: Course,
    /// Flights of the reference that were over in the last tick.
    flight: u32,
    predicted: [Pair; AHEAD],
    /// Readings now of sensors that do not lag, in kPa gauge.
    undelayed: Pair,
    trajectory: ActionTrajectory,
}

impl ReferenceTracking {
    /// The loop for the rig that the model is made of; without a policy the fallback flies.
    ///
    /// # Errors
    /// If the rig cannot be flown: unsound, or without the valves and sensors the controller needs.
    pub fn new(rig: &Rig, policy: Option<Policy>, reference: Reference) -> Result<Self, RigError> {
        let map = Arc::new(SteadyMap::new(rig)?);
        let mut predictor = Predictor::new(rig)?;
        predictor.restart([0.0; CHANNELS], VENT);
        let (tick_end, policies) = channel();
        let (models, model_desk) = model_change::ends(rig, Arc::clone(&map));
        Ok(ReferenceTracking {
            predictor,
            control: Arbiter::new(Arc::clone(&map), ShownReference::of(rig), policy.map(Candidate::new), tick_end),
            policies,
            policy_event: None,
            models,
            model_desk,
            measured: [0.0; CHANNELS],
            tick: 0,
            map,
            reference: Box::new(reference),
            after_end: AfterEnd::Hold,
            course: Course::at_rest(),
            flight: 0,
            predicted: [[f64::NAN; CHANNELS]; AHEAD],
            undelayed: [f64::NAN; CHANNELS],
            trajectory: ActionTrajectory::held(VENT),
        })
    }

    /// Sets what follows the reference's end, and whether flights of it are learned from; before the run, not for the tick.
    pub fn repeat(&mut self, after_end: AfterEnd, learning: RepetitionLearning) {
        self.after_end = after_end;
        let learns = learning == RepetitionLearning::On;
        let repetitions = learns.then(|| Box::new(FallbackSettings::default().repetitions(&self.map)));
        self.models.learn_repetitions(learning);
        self.control.exchange_repetitions(repetitions, self.reference.identity());
    }

    /// Flights of the reference that were learned from; nothing where none are.
    pub fn flights(&self) -> Option<usize> {
        self.control.flights()
    }

    /// Place where policies are published to this loop.
    pub fn policies(&self) -> StoreEnd {
        self.policies.clone()
    }

    /// Place where models are changed.
    pub fn models(&self) -> ModelDesk {
        self.model_desk.clone()
    }

    /// One line about a reference that asks for more than the rig gives, by the model; before the run, not for the tick.
    pub fn beyond_reach(&self) -> Option<String> {
        self.model_desk.reach().beyond(&self.reference)
    }

    /// Range of the pressures that the rig can hold, by the model; before the run, not for the tick.
    pub fn reach(&self) -> Option<Reach> {
        self.model_desk.reach().range()
    }

    /// Takes in the tick and its readings, for comparisons of models, while something else decides the duties.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn looked(&mut self, tick: u32, measured: Pair) {
        (self.tick, self.measured) = (tick, measured);
    }

    /// Keeps what was sent, for comparisons of models.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn keep_sample(&mut self, answer: &ActuatorCommand) {
        self.models.keep(Sample {
            tick: self.tick,
            measured_kpa: self.measured,
            duty: answer.duty,
            pump_on: answer.pump_on,
        });
    }

    /// Takes the exploration of a recorded tick in place of what would be drawn: for replays.
    pub fn impose_exploration(&mut self, noise: Noise) {
        self.control.impose_noise(noise);
    }

    fn start_reference(&mut self, tick: u32, measured: Pair) {
        let reference = (self.reference.at(0.0), self.reference.end_s());
        self.course.start(tick, measured, reference, self.after_end);
        self.flight = 0;
        self.control.begin_flight(self.course.period_ticks());
    }

    /// The next flight begins where the reference begins again.
    fn follow_course(&mut self, tick: u32) {
        let flight = self.course.flight(tick);
        if flight != self.flight {
            self.flight = flight;
            self.control.begin_flight(self.course.period_ticks());
        }
    }
}

impl DutySource for ReferenceTracking {
    const ONE_SESSION: bool = false;

    fn exchange_model(
        &mut self,
        state: State,
        filter: &mut SafetyFilter,
        monitor: &mut Monitor,
        record: &mut TickRecord,
    ) {
        let Some(mut change) = self.models.take(state) else { return };
        TickInput::Model.append(&mut record.inputs);
        std::mem::swap(&mut self.predictor, &mut change.predictor);
        self.control.exchange_model(&change.map, &change.shown_reference);
        change.repetitions = self.control.exchange_repetitions(change.repetitions.take(), self.reference.identity());
        self.control.begin_flight(self.course.period_ticks());
        // What was in force goes back whole; nothing of it is freed here.
        std::mem::swap(&mut self.map, &mut change.map);
        change.filter.continue_from(filter);
        std::mem::swap(filter, &mut change.filter);
        monitor.exchange_models(&mut change.monitor);
        self.models.retire(change);
    }

    /// Follows the vented rig, so that the model stands where the rig is when that is armed: starting it anew allocates.
    fn on_sample(&mut self, seen: &SensorSample) -> ModeRequest {
        if !seen.state.is_controlling() {
            self.predictor.observe(seen.measured);
            self.predictor.advance(VENT, false);
        }
        ModeRequest::None
    }

    fn armed(&mut self, tick: u32, measured: Pair) {
        self.start_reference(tick, measured);
        self.control.restart(VENT);
        self.trajectory = ActionTrajectory::held(VENT);
    }

    fn predict(&mut self, measured: Pair, record: &mut TickRecord) -> Prediction {
        self.undelayed = self.predictor.observe(measured);
        self.predicted = self.predictor.predict(&self.trajectory.remaining(), true);
        let sound = self.predicted.as_flattened().iter().all(|p| p.is_finite());
        if !sound {
            // A diverged model must not reach the policy; "stays as it is" is the plainest forecast.
            self.predicted = [measured; AHEAD];
            self.undelayed = measured;
            self.predictor.recover(measured);
        }
        record.predicted_pos_kpa = self.predicted.map(|p| p[0]);
        record.predicted_neg_kpa = self.predicted.map(|p| p[1]);
        if sound { Prediction::Sound } else { Prediction::Diverged }
    }

    fn decide(
        &mut self,
        tick: u32,
        measured: Pair,
        record: &mut TickRecord,
        tell: NoticeSink<'_>,
    ) -> Option<ActuatorCommand> {
        self.looked(tick, measured);
        self.follow_course(tick);
        let goals_kpa = self.course.goals_kpa(tick, |time_s| self.reference.at(time_s));
        // What a person compares with is the reference as given, not the way to it.
        [record.ref_pos_kpa, record.ref_neg_kpa] = self.reference.at(self.course.time_s(tick));
        let input = ControlInput { undelayed_kpa: self.undelayed, ..ControlInput::of_measured(measured, goals_kpa) };
        let arbitrated = self.control.decide(&input, &self.predicted);
        if arbitrated.ordered {
            TickInput::Policy.append(&mut record.inputs);
        }
        for event in [self.policy_event.take(), arbitrated.event].into_iter().flatten() {
            tell(Notice::Policy { tick, event });
        }
        if let Some(answer) = arbitrated.answer {
            record.observation_hash = answer.observation_hash;
            record.policy_output = answer.outputs;
            record.policy_stage = answer.stage;
            record.authority = answer.authority;
        }
        record.swap_id = self.control.swaps();
        [record.exploration_pos, record.exploration_neg] = arbitrated.exploration.now;
        record.exploration_plan = arbitrated.exploration.plan;
        let decision = arbitrated.decision;
        [record.law_pos, record.law_neg] = decision.parts.map(|p| LawParts {
            feed_forward: p.feed_forward + p.play + p.correction,
            backlash: p.play,
            correction: p.correction,
            proportional: p.proportional,
            integral: p.integral,
            u_raw: p.raw(),
        });
        decision.raw().iter().all(|u| u.is_finite()).then(|| {
            self.trajectory = decision.trajectory;
            ActuatorCommand::run(decision.duty())
        })
    }

    /// The plan is followed.
    fn bridge(&mut self, tick: u32) -> ActuatorCommand {
        self.follow_course(tick);
        let rest = self.trajectory.remaining();
        self.trajectory = ActionTrajectory(std::array::from_fn(|j| rest[j.min(AHEAD - 1)]));
        self.control.bridged(self.trajectory.now());
        ActuatorCommand::run(self.trajectory.now())
    }

    /// Moves model and integrals on through the tick.
    fn sent(&mut self, answer: &ActuatorCommand) {
        self.policy_event = self.control.applied(answer.duty);
        self.keep_sample(answer);
        self.predictor.advance(answer.duty, answer.pump_on);
    }

    /// Only the model moves on.
    fn held(&mut self, answer: &ActuatorCommand) {
        self.control.held(answer.duty);
        self.predictor.advance(answer.duty, answer.pump_on);
    }

    fn controlled_by(&mut self, controller: ControlledBy) {
        self.control.set_trust(match controller {
            ControlledBy::Policy => Trust::Policies,
            ControlledBy::Fallback => Trust::FallbackOnly,
        });
    }

    /// A candidate that had a part in what left the envelope is refused; after anything else it begins again in shadow.
    fn stopped(&mut self, cause: Option<(Condition, f64)>) {
        self.control.stop_exploring();
        if matches!(cause, Some((Condition::OverPressure | Condition::OverVacuum | Condition::LawNotFinite, _))) {
            self.control.vented();
        }
    }

    fn explore(&mut self, rules: Option<ExplorationRules>) {
        match rules {
            Some(rules) => {
                self.control.explore(rules);
            }
            None => self.control.stop_exploring(),
        }
    }

    fn exploration(&self) -> Option<ExplorationShown> {
        self.control.exploration()
    }

    /// A reference has no end: its last row is held.
    fn is_over(&self) -> bool {
        false
    }

    fn exchange_reference(&mut self, reference: Box<Reference>, running: Option<(u32, Pair)>) -> Box<Reference> {
        let old = std::mem::replace(&mut self.reference, reference);
        self.control.choose_reference(self.reference.identity());
        if let Some((tick, measured)) = running {
            self.start_reference(tick, measured);
        }
        old
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_model_that_diverges_says_so_once_and_begins_anew() {
        // A rig whose air warms: a reading does not put that right.
        let rig = Rig::builtin("bench").unwrap();
        let mut tracking = ReferenceTracking::new(&rig, None, Reference::constant(85.0, -72.0)).unwrap();
        let mut record = TickRecord::default();
        let mut fly = |tracking: &mut ReferenceTracking, measured: Pair| {
            let prediction = tracking.predict(measured, &mut record);
            tracking.sent(&ActuatorCommand::run([0.85, 0.83]));
            (prediction, record.predicted_pos_kpa[0])
        };
        assert_eq!(fly(&mut tracking, [80.0, -70.0]).0, Prediction::Sound);
        // The sensors are sound, and the model's own state is none any more.
        tracking.predictor.observe([f64::NAN; CHANNELS]);
        tracking.predictor.advance([0.85, 0.83], true);
        let (prediction, stands_in) = fly(&mut tracking, [80.0, -70.0]);
        assert_eq!((prediction, stands_in), (Prediction::Diverged, 80.0));
        let (prediction, foreseen) = fly(&mut tracking, [80.0, -70.0]);
        assert_eq!(prediction, Prediction::Sound);
        assert!((foreseen - 80.0).abs() < 10.0, "{foreseen}");
    }
}
