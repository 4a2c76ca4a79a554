//! The control loop of a recording, rebuilt tick by tick: what the policy was shown, and what the loop made of its answer.
//!
//! A recording holds readings, predictions, the policy's answer and the duties that were sent, but not what the policy was
//! shown. That is rebuilt by the daemon's own law ([`law::PolicyLaw`]) and model from the files inside the recording, and
//! checked in every tick against what was recorded:
//!
//! * the hash of the observation, where a policy was asked: equal to the bit as long as everything since the daemon's start
//!   is known;
//! * every term of the control law, within [`LAW_AGREES_DUTY`]: otherwise the tick says nothing and is left out.
//!
//! After a policy was exchanged the new one's law has gone its own way while in shadow; its integral is then taken from the
//! recording, and the rest follows from what was applied.

use std::sync::Arc;

use law::{
    AfterEnd, ControlInput, ControlOutput, Course, FallbackSettings, Left, PolicyLaw, RepetitionLearning, Repetitions,
};
use model::observation::{ACTION_LEN, AHEAD, CHANNELS, ObservationLayout, Pair};
use model::predict::Predictor;
use model::rig::Rig;
use model::shown_reference::ShownReference;
use model::steady::SteadyMap;
use proto::recording::{Arrival, LawParts, TickRecord, observation_hash};
use proto::reference::Reference;

use crate::FinetuneError;

/// Duty by which a rebuilt term of the law may be off: a thousandth of what a policy adds (chosen; rounding is 1e-15).
pub const LAW_AGREES_DUTY: f64 = 1e-5;
/// Codes of the daemon's states, as recordings carry them (docs/recordings.md).
const RUN: u8 = 1;
const HOLD: u8 = 3;
const REVERT: u8 = 4;
/// Both vents open.
const VENT: Pair = [1.0; CHANNELS];

/// Who controlled in a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ControlledBy {
    /// A policy of this layout, with full authority.
    Policy(ObservationLayout),
    /// A candidate and the incumbent together.
    Both,
    /// The fallback.
    Fallback,
}

/// Why nothing is learned from a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum LeftOut {
    /// The state is not RUN, or a frame is missing.
    NotRunning,
    /// The safety filter changed the command.
    Filtered,
    /// A candidate had a part of the command: nobody's answer is what was applied.
    Shared,
    /// The controller has another observation layout, or is the fallback where a policy replaces it.
    OtherLayout,
    /// The answer is beyond the range of the policy that is trained.
    BeyondRange,
    /// The rebuilt law is not the recorded one: another model took over that the recording does not hold, or ticks are missing.
    LawDiffers,
}

impl LeftOut {
    /// Words that a person is told.
    pub const fn words(self) -> &'static str {
        match self {
            LeftOut::NotRunning => "not running",
            LeftOut::Filtered => "changed by the safety filter",
            LeftOut::Shared => "shared between two policies",
            LeftOut::OtherLayout => "under a controller of another kind",
            LeftOut::BeyondRange => "answers beyond the policy's range",
            LeftOut::LawDiffers => "not explained by the recorded model",
        }
    }
}

/// A tick as a policy of the learner's layout saw it.
#[derive(Debug, Clone, PartialEq)]
pub struct RebuiltTick {
    /// Session and number.
    pub at: (u32, u32),
    /// Numbers that the policy is shown.
    pub observation: Vec<f32>,
    /// Measured pressures in kPa gauge.
    pub measured_kpa: Pair,
    /// Goals of now and the next ticks in kPa gauge.
    pub goals_kpa: Vec<Pair>,
    /// Readings with the chambers on the goals, now and in the next ticks, in kPa gauge: the goals where no sensor is late.
    pub shown_kpa: [Pair; AHEAD + 1],
    /// Predictions for the next five ticks in kPa gauge.
    pub predicted_kpa: [Pair; AHEAD],
    /// The answer that was applied, exploration included, in the contract's units, or why there is none.
    pub answer: Result<[f32; ACTION_LEN], LeftOut>,
    /// True where the recorded hash of the observation is that of the rebuilt one; nothing where none was recorded.
    pub is_same_to_the_bit: Option<bool>,
    /// True where state and law are sound, so that the observation is what follows from the tick before.
    pub is_sound: bool,
}

/// The loop of one run of the daemon.
pub struct LoopRebuild {
    layout: ObservationLayout,
    law: PolicyLaw,
    predictor: Predictor,
    model: Rig,
    reference: Reference,
    after_end: AfterEnd,
    course: Course,
    /// Flights of the reference that were over in the last tick.
    flight: u32,
    /// Lessons of flights, where the daemon learned from them.
    repetitions: Option<Repetitions>,
    /// Remains of the last decision for the next flight.
    left: Left,
    /// Readings of the model's sensors with the chambers on the goals.
    shown_reference: ShownReference,
    /// Ticks since it was last asked.
    since_shown: u32,
    is_controlling: bool,
    measured_kpa: Pair,
    tick: u32,
    /// Times that the law's integral had to be taken from the recording.
    joined: u64,
}

impl LoopRebuild {
    /// The loop as it was when the daemon began with `model` and `reference`, for observations of `layout`.
    ///
    /// # Errors
    /// A model that cannot be run.
    pub fn new(model: Rig, reference: Reference, layout: ObservationLayout) -> Result<Self, FinetuneError> {
        let unfit = |problem| FinetuneError::Model { name: model.name.clone(), problem };
        let map = Arc::new(SteadyMap::new(&model).map_err(unfit)?);
        let mut predictor = Predictor::new(&model).map_err(unfit)?;
        predictor.restart([0.0; CHANNELS], VENT);
        Ok(LoopRebuild {
            layout,
            law: PolicyLaw::new(map, layout),
            predictor,
            shown_reference: ShownReference::of(&model),
            since_shown: 0,
            model,
            reference,
            after_end: AfterEnd::Hold,
            course: Course::at_rest(),
            flight: 0,
            repetitions: None,
            left: Left::NOTHING,
            is_controlling: false,
            measured_kpa: [0.0; CHANNELS],
            tick: 0,
            joined: 0,
        })
    }

    /// Flies the reference again at its end, and learns from its flights, as the daemon was configured to.
    ///
    /// # Errors
    /// A model that cannot be run.
    pub fn repeat(&mut self, after_end: AfterEnd, learns: RepetitionLearning) -> Result<(), FinetuneError> {
        self.after_end = after_end;
        self.repetitions = match learns {
            RepetitionLearning::Off => None,
            RepetitionLearning::On => Some(repetitions(&self.model, &self.reference)?),
        };
        Ok(())
    }

    /// The model in force.
    pub fn model(&self) -> &Rig {
        &self.model
    }

    /// Times that the law's integral had to be taken from the recording: 0 for a run without exchanges.
    pub fn joined(&self) -> u64 {
        self.joined
    }

    /// Another reference is followed from the next tick on.
    pub fn exchange_reference(&mut self, reference: Reference) {
        self.reference = reference;
        if let Some(repetitions) = &mut self.repetitions {
            repetitions.choose(self.reference.identity());
        }
        if self.is_controlling {
            self.start_reference(self.tick, self.measured_kpa);
        }
    }

    /// Another model is behind predictions and feed-forward from the next tick on.
    ///
    /// # Errors
    /// A model that cannot be run.
    pub fn exchange_model(&mut self, model: Rig) -> Result<(), FinetuneError> {
        let unfit = |problem| FinetuneError::Model { name: model.name.clone(), problem };
        let map = Arc::new(SteadyMap::new(&model).map_err(unfit)?);
        self.predictor = Predictor::new(&model).map_err(unfit)?;
        self.predictor.restart(self.measured_kpa, VENT);
        let _ = self.law.exchange_map(map);
        if self.repetitions.is_some() {
            self.repetitions = Some(repetitions(&model, &self.reference)?);
        }
        self.begin_flight();
        self.shown_reference = ShownReference::of(&model);
        self.model = model;
        Ok(())
    }

    /// Takes in a tick; what a policy saw in it, where anything controlled.
    pub fn follow(&mut self, record: &TickRecord) -> Option<RebuiltTick> {
        self.tick = record.tick;
        let has_reading = record.p_pos_kpa.is_finite() && record.p_neg_kpa.is_finite();
        let has_arrived = matches!(record.arrival, Arrival::InTime | Arrival::Late);
        let has_frame = has_arrived && has_reading;
        if has_frame {
            self.measured_kpa = [record.p_pos_kpa, record.p_neg_kpa];
        }
        let was_controlling = std::mem::replace(&mut self.is_controlling, is_controlled(record));
        if !self.is_controlling {
            if has_arrived {
                // As in the daemon the model follows the vented rig, so that it stands where that is when it is armed.
                self.predictor.observe(self.measured_kpa);
                self.predictor.advance(VENT, false);
            }
            return None;
        }
        if !was_controlling {
            self.start_reference(record.tick, self.measured_kpa);
            self.law.restart(VENT);
        }
        let flight = self.course.flight(record.tick);
        if flight != self.flight {
            self.flight = flight;
            self.begin_flight();
        }
        self.since_shown = self.since_shown.saturating_add(1);
        let rebuilt = has_frame.then(|| self.decide(record));
        let duty = [record.u_pos, record.u_neg];
        let left = std::mem::replace(&mut self.left, Left::NOTHING);
        let is_taught = record.state != HOLD && !record.filter_active;
        if let Some(repetitions) = &mut self.repetitions {
            repetitions.follow(if is_taught { &left } else { &Left::NOTHING });
        }
        if record.state != HOLD {
            self.law.applied(duty);
        }
        self.predictor.advance(duty, record.pump_on);
        rebuilt
    }

    fn start_reference(&mut self, tick: u32, measured_kpa: Pair) {
        let reference = (self.reference.at(0.0), self.reference.end_s());
        self.course.start(tick, measured_kpa, reference, self.after_end);
        self.flight = 0;
        self.shown_reference.restart();
        self.begin_flight();
    }

    fn begin_flight(&mut self) {
        if let Some(repetitions) = &mut self.repetitions {
            repetitions.begin(self.course.period_ticks());
        }
    }

    fn decide(&mut self, record: &TickRecord) -> RebuiltTick {
        let input = self.input(record.tick);
        let since = std::mem::take(&mut self.since_shown);
        let shown_kpa = self.shown_reference.goals_kpa(since, &input.goals_kpa);
        let predicted_kpa: [Pair; AHEAD] =
            std::array::from_fn(|j| [record.predicted_pos_kpa[j], record.predicted_neg_kpa[j]]);
        let controlled_by = controlled_by(record);
        let is_own = controlled_by == ControlledBy::Policy(self.layout)
            || (controlled_by == ControlledBy::Fallback && self.layout == ObservationLayout::Correction);
        let before = self.law.clone();
        let mut decision = self.answer(&input, record, controlled_by);
        if is_own && !integral_agrees(record, &decision) {
            // The law of a policy that came later: from where it stood.
            self.law = before;
            self.law.set_integral([record.law_pos.integral, record.law_neg.integral]);
            self.joined += 1;
            decision = self.answer(&input, record, controlled_by);
        }
        self.left = match controlled_by {
            // It decides without the fallback.
            ControlledBy::Policy(ObservationLayout::Paper) => Left::NOTHING,
            _ => self.law.left(),
        };
        let mut observation = vec![0.0; self.layout.observation_len()];
        self.law.write_observation(&input, &predicted_kpa, &mut observation);
        let is_law = is_own && law_agrees(record, &decision);
        let is_running = record.state == RUN && predicted_kpa.as_flattened().iter().all(|p| p.is_finite());
        let answer = match controlled_by {
            _ if !is_running => Err(LeftOut::NotRunning),
            _ if record.filter_active => Err(LeftOut::Filtered),
            ControlledBy::Both => Err(LeftOut::Shared),
            _ if !is_own => Err(LeftOut::OtherLayout),
            _ if !is_law => Err(LeftOut::LawDiffers),
            ControlledBy::Policy(_) => Ok(explored(record)),
            // The fallback alone is a policy that corrects nothing.
            ControlledBy::Fallback => Ok([0.0; ACTION_LEN]),
        };
        let asked = controlled_by == ControlledBy::Policy(self.layout);
        RebuiltTick {
            at: (record.session, record.tick),
            is_same_to_the_bit: asked.then(|| observation_hash(&observation) == record.observation_hash),
            observation,
            measured_kpa: input.measured_kpa,
            goals_kpa: input.goals_kpa.to_vec(),
            shown_kpa,
            predicted_kpa,
            answer,
            is_sound: is_running && is_law,
        }
    }

    /// Input of the law.
    fn input(&mut self, tick: u32) -> ControlInput {
        let measured_kpa = self.measured_kpa;
        let observed = self.predictor.observe(measured_kpa);
        let undelayed_kpa = if observed.iter().all(|p| p.is_finite()) { observed } else { measured_kpa };
        let goals_kpa = self.course.goals_kpa(tick, |time_s| self.reference.at(time_s));
        let learned_duty = self.repetitions.as_ref().and_then(Repetitions::learned);
        ControlInput { measured_kpa, undelayed_kpa, goals_kpa, learned_duty }
    }

    fn answer(&mut self, input: &ControlInput, record: &TickRecord, controlled_by: ControlledBy) -> ControlOutput {
        let base = self.law.observe(input);
        match controlled_by {
            ControlledBy::Policy(layout) if layout == self.layout => self.law.decide(input, &explored(record)),
            _ => base,
        }
    }
}

/// Learning from flights on a model, with a reference to begin with.
fn repetitions(model: &Rig, reference: &Reference) -> Result<Repetitions, FinetuneError> {
    let map = SteadyMap::new(model).map_err(|problem| FinetuneError::Model { name: model.name.clone(), problem })?;
    let mut repetitions = FallbackSettings::default().repetitions(&map);
    repetitions.choose(reference.identity());
    Ok(repetitions)
}

/// The policy's answer with what exploration added to it, in the bits in which the law was told it.
fn explored(record: &TickRecord) -> [f32; ACTION_LEN] {
    let mut outputs = record.policy_output;
    let later = record.exploration_plan.iter().map(|noise| f64::from(*noise));
    let noise = [record.exploration_pos, record.exploration_neg].into_iter().chain(later);
    for (output, noise) in outputs.iter_mut().zip(noise).filter(|(_, noise)| *noise != 0.0) {
        *output = (f64::from(*output) + noise) as f32;
    }
    outputs
}

/// Tells whether anything controls in a tick.
pub(crate) fn is_controlled(record: &TickRecord) -> bool {
    matches!(record.state, RUN | HOLD | REVERT)
}

fn controlled_by(record: &TickRecord) -> ControlledBy {
    if record.observation_hash == 0 || !record.policy_output.iter().all(|x| x.is_finite()) {
        return ControlledBy::Fallback;
    }
    if record.authority < 1.0 {
        return ControlledBy::Both;
    }
    // Under the paper's layout the policy decides alone, and an integral is all that is added.
    let is_alone = [record.law_pos, record.law_neg].iter().all(|p| p.proportional == 0.0 && p.backlash == 0.0);
    ControlledBy::Policy(if is_alone { ObservationLayout::Paper } else { ObservationLayout::Correction })
}

fn integral_agrees(record: &TickRecord, decision: &ControlOutput) -> bool {
    let recorded = [record.law_pos.integral, record.law_neg.integral];
    decision.parts.iter().zip(recorded).all(|(parts, recorded)| parts.integral.to_bits() == recorded.to_bits())
}

fn law_agrees(record: &TickRecord, decision: &ControlOutput) -> bool {
    let recorded = [record.law_pos, record.law_neg]
        .map(|LawParts { feed_forward, backlash, correction, .. }| [feed_forward, backlash, correction]);
    let rebuilt = decision.parts.map(|p| [p.feed_forward + p.play + p.correction, p.play, p.correction]);
    let raw = [record.law_pos.u_raw, record.law_neg.u_raw];
    let agrees = |a: f64, b: f64| (a - b).abs() <= LAW_AGREES_DUTY;
    recorded.as_flattened().iter().zip(rebuilt.as_flattened()).all(|(a, b)| agrees(*a, *b))
        && raw.iter().zip(decision.raw()).all(|(a, b)| agrees(*a, b))
}
