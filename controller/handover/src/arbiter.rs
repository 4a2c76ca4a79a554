//! Incumbent and candidate side by side, tick by tick.
//!
//! Both are computed in every tick, each in a law of its own that is told what was really sent: so the integral of either
//! stands where the rig is (back-calculation), and either can take over within a tick. The command is
//!
//! ```text
//! u = (1 − a) u_incumbent + a u_candidate + r
//! ```
//!
//! with the candidate's authority `a` ([`crate::stages`]) and a remainder `r`, which makes the command go on from where
//! it was when a candidate loses its authority at once, and decays over half a second.
//!
//! Both are judged by the readings less what the sensors would show of chambers on the reference
//! ([`model::shown_reference`]): behind a late sensor readings less reference would favour whoever drives the chamber ahead
//! of it.

mod exploring;
mod learning;
mod succession;

use std::sync::Arc;

use law::{ControlInput, ControlOutput, Left, PolicyLaw, Repetitions, saturated};
use model::observation::{AHEAD, ActionTrajectory, CHANNELS, Pair};
use model::shown_reference::ShownReference;
use model::steady::SteadyMap;

use crate::blend::blended;
use crate::channel::{Candidate, PolicyEvent, PolicyTag, TickEnd};
use crate::conditions::Conditions;
use crate::conduct::Shown;
use crate::exploration::{Exploration, Noise};
use crate::loss::Loss;
use crate::record::Record;
use crate::remainder::{Remainder, away};
use crate::seat::{Answer, PolicyAnswer, Seat, layout_of};
use crate::stages::{Next, Stages};
use succession::Before;

/// Seconds after arming that are not held against anybody: the rig comes from rest.
const APPROACH_TICKS: u32 = 250;
/// Ticks after arming before errors are recorded: the fallback learns the valves' backlash, and errs up to five times what it does
/// a minute later.
const LEARNING_TICKS: u32 = 3000;
/// Ticks beyond which a gap in the frames counts no further for what late sensors show: its cost in the tick is bounded.
const MOST_SHOWN_TICKS: u32 = 10;
/// Duties that differ by less were not changed by anybody: roundings of a wire's f32.
const SAME_DUTY: f64 = 1e-6;

/// A decision and what came of it for the policies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArbitratedCommand {
    /// The decision.
    pub decision: ControlOutput,
    /// Event of a policy in this tick, to be recorded.
    pub event: Option<PolicyEvent>,
    /// An order of the publishing thread was carried out in this tick.
    pub ordered: bool,
    /// Observation and answer of the policy, where there is one: the candidate's where it has authority, the incumbent's
    /// otherwise.
    pub answer: Option<PolicyAnswer>,
    /// Noise that exploration added to the answer.
    pub exploration: Noise,
}

/// Whose answers count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Trust {
    /// The policies', by their stages.
    Policies,
    /// The fallback's alone, which is worked out all along.
    FallbackOnly,
}

/// Arbiter that decides the duties, with everything it remembers.
pub struct Arbiter {
    incumbent: Seat,
    candidate: Option<(Seat, Stages)>,
    before: Before,
    record: Record,
    conditions: Conditions,
    end: TickEnd,
    /// Remainder of a bump.
    remainder: Remainder,
    /// True where the next command is the first on another model.
    on_new_model: bool,
    /// Changes of what is active since the start.
    swaps: u32,
    ticks: u32,
    kinds: [usize; CHANNELS],
    /// Readings of the model's sensors with the chambers on the goals.
    shown_reference: ShownReference,
    /// Ticks since it was last asked, frames that are missing included.
    since_shown: u32,
    error_kpa: Pair,
    decided: Pair,
    /// Part of the last decision that is the candidate's.
    part_duty: Pair,
    sent: Pair,
    trust: Trust,
    exploration: Option<Exploration>,
    /// Noise of a recorded tick, in place of what would be drawn.
    imposed_noise: Option<Noise>,
    noise: Noise,
    /// Store of what earlier flights of each reference have taught, where that is learned.
    repetitions: Option<Box<Repetitions>>,
    /// Error that the last decision leaves for the next flight.
    left: Left,
}

impl Arbiter {
    /// For the rig that `map` was made of and whose sensors show what `shown_reference` says; without a policy the fallback flies.
    pub fn new(
        map: Arc<SteadyMap>,
        shown_reference: ShownReference,
        active: Option<Box<Candidate>>,
        end: TickEnd,
    ) -> Self {
        let layout = layout_of(active.as_deref());
        Arbiter {
            incumbent: Seat { law: PolicyLaw::new(map, layout), taken: active },
            candidate: None,
            before: Before::Nothing,
            record: Record::default(),
            conditions: Conditions::default(),
            end,
            remainder: Remainder::NONE,
            on_new_model: false,
            swaps: 0,
            ticks: 0,
            kinds: [0; CHANNELS],
            shown_reference,
            since_shown: 0,
            error_kpa: [0.0; CHANNELS],
            decided: [1.0; CHANNELS],
            part_duty: [0.0; CHANNELS],
            sent: [1.0; CHANNELS],
            trust: Trust::Policies,
            exploration: None,
            imposed_noise: None,
            noise: Noise::NONE,
            repetitions: None,
            left: Left::NOTHING,
        }
    }

    /// Says whose answers count from now on; the command goes on from where it is.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn set_trust(&mut self, trust: Trust) {
        if trust != self.trust {
            self.trust = trust;
            self.stop_exploring();
            self.remainder = Remainder::FROM_SENT;
        }
    }

    /// Starts anew after arming, with `duty` long in force.
    ///
    /// # Real-time
    /// Runs in the tick of arming.
    pub fn restart(&mut self, duty: Pair) {
        self.stop_exploring();
        self.incumbent.law.restart(duty);
        if let Some((seat, stages)) = &mut self.candidate {
            seat.law.restart(duty);
            *stages = stages.anew();
        }
        self.conditions = Conditions::default();
        self.shown_reference.restart();
        self.remainder = Remainder::NONE;
        self.on_new_model = false;
        self.ticks = 0;
        (self.decided, self.sent) = (duty, duty);
    }

    /// Puts another model behind both laws, and its sensors behind what is judged; the command goes on from where it is, and
    /// the integrals take over what the models differ by: the rig is the same, and so is the duty that holds it. The caller
    /// keeps the one in force, so that nothing is freed here.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn exchange_model(&mut self, map: &Arc<SteadyMap>, shown_reference: &ShownReference) {
        self.stop_exploring();
        let _ = self.incumbent.law.exchange_map(Arc::clone(map));
        if let Some((seat, _)) = &mut self.candidate {
            let _ = seat.law.exchange_map(Arc::clone(map));
        }
        self.shown_reference.clone_from(shown_reference);
        // The incumbent on another model is another controller: its errors are recorded anew.
        self.record = Record::default();
        self.swaps = self.swaps.wrapping_add(1);
        self.on_new_model = true;
    }

    /// The rig was vented by a fault, or disarmed: a candidate with authority has lost it, whoever was to blame. The fallback
    /// has all of it from now on: what it was to replace must not control again because of a venting.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn vented(&mut self) {
        self.stop_exploring();
        match &self.candidate {
            Some((_, stages)) if stages.authority() == 0.0 => {}
            Some((seat, _)) if seat.tag() == PolicyTag::FALLBACK => {
                self.promote();
            }
            Some(_) => {
                self.lose(Loss::Vented);
            }
            None => {}
        }
    }

    /// Decides the duties of a tick, given the model's predictions for the next five.
    ///
    /// # Real-time
    /// Allocation-free and bounded: two inferences where a candidate is on its way.
    pub fn decide(&mut self, input: &ControlInput, predicted_kpa: &[Pair; AHEAD]) -> ArbitratedCommand {
        let learned_duty = self.repetitions.as_ref().and_then(|repetitions| repetitions.learned());
        let input = &ControlInput { learned_duty, ..*input };
        let mut event = self.serve();
        let ordered = event.is_some();
        self.kinds = self.conditions.kinds(input);
        let since = std::mem::take(&mut self.since_shown).min(MOST_SHOWN_TICKS);
        let shown_kpa = self.shown_reference.next_kpa(since, input.goals_kpa[0]);
        self.error_kpa = std::array::from_fn(|c| shown_kpa[c] - input.measured_kpa[c]);
        let trusted = self.trust == Trust::Policies;
        if self.candidate.is_some() {
            // A candidate is held against what the incumbent does by itself.
            self.stop_exploring();
        }
        let drawn = self.exploration.as_mut().map_or(Noise::NONE, Exploration::draw);
        let noise = self.imposed_noise.take().unwrap_or(drawn);
        let answer = if trusted {
            self.incumbent.answer(input, predicted_kpa, &noise)
        } else {
            Answer { decision: self.incumbent.law.observe(input), refused: false, policy: None, noise: Noise::NONE }
        };
        self.noise = answer.noise;
        if answer.refused {
            event = self.incumbent_refused().or(event);
        }
        let mut decision = answer.decision;
        let mut shown = answer.policy;
        let mut lost = None;
        self.part_duty = [0.0; CHANNELS];
        if let Some((seat, stages)) = self.candidate.as_mut().filter(|_| trusted) {
            let candidate = seat.answer(input, predicted_kpa, &Noise::NONE);
            if candidate.refused {
                lost = Some(Loss::NotFinite);
            } else {
                let authority = stages.begin_tick();
                let by_itself = decision.duty();
                decision = blended(&decision, &candidate.decision, authority);
                let shared = decision.duty();
                self.part_duty = std::array::from_fn(|c| shared[c] - by_itself[c]);
                if authority > 0.0 {
                    let stage = stages.now().code() + 1;
                    shown = candidate.policy.map(|answer| PolicyAnswer { stage, authority, ..answer });
                }
            }
        }
        if let Some(loss) = lost {
            self.remainder = Remainder::between(self.sent, &decision);
            event = self.lose(loss);
        }
        if std::mem::take(&mut self.on_new_model) {
            decision = self.absorbed(decision);
        }
        decision = self.remainder.add_to(decision, self.sent);
        self.decided = decision.duty();
        self.left = if self.builds_on_fallback() { self.incumbent.law.left() } else { Left::NOTHING };
        self.show();
        ArbitratedCommand { decision, event, ordered, answer: shown, exploration: self.noise }
    }

    /// Tells that nothing was decided in this tick, because its frame is missing: the plan was followed.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn bridged(&mut self, duty: Pair) {
        self.decided = duty;
    }

    /// Tells what was really sent in a tick in which nothing learns or integrates: whatever takes over next goes on from there.
    ///
    /// # Real-time
    /// Runs in the tick, after the command is out.
    pub fn held(&mut self, duty: Pair) {
        self.since_shown = self.since_shown.saturating_add(1);
        self.sent = duty;
        self.learn(&Left::NOTHING);
    }

    /// Tells what was really sent, and moves the candidate on.
    ///
    /// # Real-time
    /// Runs in the tick, after the command is out.
    pub fn applied(&mut self, duty: Pair) -> Option<PolicyEvent> {
        self.since_shown = self.since_shown.saturating_add(1);
        let filtered = (0..CHANNELS).any(|c| (duty[c] - self.decided[c]).abs() > SAME_DUTY);
        let change_duty = std::array::from_fn(|c| duty[c] - self.sent[c]);
        self.sent = duty;
        let left = std::mem::replace(&mut self.left, Left::NOTHING);
        self.learn(if filtered { &Left::NOTHING } else { &left });
        self.incumbent.law.applied(duty);
        if let Some((seat, _)) = &mut self.candidate {
            seat.law.applied(duty);
        }
        self.ticks = self.ticks.saturating_add(1);
        if self.ticks < APPROACH_TICKS {
            return None;
        }
        let alone =
            self.candidate.as_ref().is_none_or(|(_, stages)| stages.incumbent_alone()) && self.noise == Noise::NONE;
        if alone && self.ticks >= LEARNING_TICKS {
            self.record.add(self.kinds, self.error_kpa, change_duty, filtered);
        }
        let (decided, part_duty) = (self.decided, self.part_duty);
        let (seat, stages) = self.candidate.as_mut()?;
        let tag = seat.tag();
        // Of a command that is all its own a candidate answers for whatever is bent.
        let filtered = filtered && (stages.authority() >= 1.0 || is_bent_for(&part_duty, &decided, &duty));
        let shown = Shown { kinds: self.kinds, error_kpa: self.error_kpa, change_duty, filtered, part_duty };
        match stages.end_tick(&shown, &self.record) {
            Next::Stay => None,
            Next::Passed(stage) => Some(self.told(PolicyEvent::Passed(tag, stage.code()))),
            Next::Active => self.promote(),
            Next::Lost(loss) => {
                self.remainder = Remainder::FROM_SENT;
                self.lose(loss)
            }
        }
    }

    /// The tag of what is active.
    pub fn active(&self) -> PolicyTag {
        self.incumbent.tag()
    }

    /// Changes of what is active since the start.
    pub fn swaps(&self) -> u32 {
        self.swaps
    }

    /// Puts into the integrals what this command is away from the last one.
    fn absorbed(&mut self, mut decision: ControlOutput) -> ControlOutput {
        let moved = away(self.sent, &decision);
        self.incumbent.law.absorb(moved);
        if let Some((seat, _)) = &mut self.candidate {
            seat.law.absorb(moved);
        }
        for (parts, moved) in decision.parts.iter_mut().zip(moved) {
            parts.integral += moved;
        }
        let planned = decision.trajectory.0;
        decision.trajectory =
            ActionTrajectory(planned.map(|duty| std::array::from_fn(|c| saturated(duty[c] + moved[c]))));
        decision
    }
}

/// Tells whether a command was bent, by the slew limit or the safety filter, because of the part that a candidate had in it: without that
/// part what was `decided` would have stood on the right side of what was `sent`.
fn is_bent_for(part: &Pair, decided: &Pair, sent: &Pair) -> bool {
    (0..CHANNELS).any(|c| {
        let bent = sent[c] - decided[c];
        let without = bent + part[c];
        bent.abs() > SAME_DUTY && without * bent.signum() <= SAME_DUTY
    })
}

#[cfg(test)]
mod tests;
