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

use std::sync::Arc;

use law::{ControlInput, ControlOutput, DutyTerms, PolicyLaw, saturated};
use model::observation::{
    ACTION_LEN, AHEAD, ActionTrajectory, CHANNELS, CORRECTION_OBSERVATION_LEN, ObservationLayout, Pair,
};
use model::steady::SteadyMap;
use proto::recording::observation_hash;

use crate::channel::{Candidate, Command, Haste, PolicyEvent, PolicyTag, Snapshot, TickEnd};
use crate::conditions::Conditions;
use crate::exploration::{Exploration, ExplorationRules, ExplorationShown, NO_NOISE};
use crate::record::Record;
use crate::stages::{Loss, Next, Shown, StageNow, Stages};

/// Ticks over which a remainder decays.
const DECAY_TICKS: u32 = 25;
/// Seconds after arming that are not held against anybody: the rig comes from rest.
const APPROACH_TICKS: u32 = 250;
/// Duties that differ by less were not changed by anybody: roundings of a wire's f32.
const SAME_DUTY: f64 = 1e-6;

/// A decision and what came of it for the policies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArbitratedCommand {
    /// The decision.
    pub decision: ControlOutput,
    /// What happened to a policy in this tick, to be recorded.
    pub event: Option<PolicyEvent>,
    /// An order of the publishing thread was carried out in this tick.
    pub ordered: bool,
    /// What the policy was shown and answered, where one did: the candidate's where it has authority, the incumbent's
    /// otherwise.
    pub answer: Option<PolicyAnswer>,
    /// Duties that exploration added to the answer's for now.
    pub exploration: Pair,
}

/// A policy's answer, for the recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PolicyAnswer {
    /// Hash of the observation ([`observation_hash`]).
    pub observation_hash: u64,
    /// All of its outputs, without exploration: now and the next five ticks, positive and negative valve in turn.
    pub outputs: [f32; ACTION_LEN],
    /// Stage of the policy: 0 active, or one more than [`StageNow::code`].
    pub stage: u8,
    /// Its share of the command, 0 … 1.
    pub authority: f64,
}

/// A policy in its law; without a policy the law's fallback.
struct Seat {
    law: PolicyLaw,
    taken: Option<Box<Candidate>>,
}

/// A seat's answer.
struct Answer {
    decision: ControlOutput,
    refused: bool,
    policy: Option<PolicyAnswer>,
}

impl Seat {
    fn tag(&self) -> PolicyTag {
        self.taken.as_ref().map_or(PolicyTag::FALLBACK, |taken| taken.tag)
    }

    fn answer(&mut self, input: &ControlInput, predicted_kpa: &[Pair; AHEAD], noise: Pair) -> Answer {
        let fallback = self.law.observe(input);
        let Some(policy) = self.taken.as_mut().and_then(|taken| taken.policy.as_mut()) else {
            return Answer { decision: fallback, refused: false, policy: None };
        };
        let mut observation = [0.0; CORRECTION_OBSERVATION_LEN];
        let told = observation.get_mut(..self.law.contract().observation_len()).unwrap_or_default();
        self.law.write_observation(input, predicted_kpa, told);
        let mut outputs = [0.0; ACTION_LEN];
        match policy.run(told, &mut outputs) {
            Ok(()) => {
                let policy =
                    PolicyAnswer { observation_hash: observation_hash(told), outputs, stage: 0, authority: 1.0 };
                if noise != NO_NOISE {
                    for (output, noise) in outputs.iter_mut().zip(noise) {
                        *output = (f64::from(*output) + noise) as f32;
                    }
                }
                Answer { decision: self.law.decide(input, &outputs), refused: false, policy: Some(policy) }
            }
            Err(_) => Answer { decision: fallback, refused: true, policy: None },
        }
    }
}

/// Whose answers count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Trust {
    /// The policies', by their stages.
    Policies,
    /// The fallback's alone, which is worked out all along.
    FallbackOnly,
}

/// What decides the duties, with everything it remembers.
pub struct Arbiter {
    incumbent: Seat,
    candidate: Option<(Seat, Stages)>,
    /// What was active before the incumbent.
    before: Option<Box<Candidate>>,
    record: Record,
    conditions: Conditions,
    end: TickEnd,
    /// What is left of a bump, and ticks until it is gone.
    remainder: (Pair, u32),
    /// Whether the next command is the first on another model.
    on_new_model: bool,
    /// Changes of what is active since the start.
    swaps: u32,
    ticks: u32,
    kinds: [usize; CHANNELS],
    error_kpa: Pair,
    decided: Pair,
    sent: Pair,
    trust: Trust,
    exploration: Option<Exploration>,
    /// Noise of a recorded tick, in place of what would be drawn.
    imposed_noise: Option<Pair>,
    noise: Pair,
}

impl Arbiter {
    /// For the rig that `map` was made of; without a policy the fallback flies.
    pub fn new(map: Arc<SteadyMap>, active: Option<Box<Candidate>>, end: TickEnd) -> Self {
        let layout = layout_of(active.as_deref());
        // A box from the start, so that the fallback, too, can be gone back to without making one in the tick.
        let active = Some(active.unwrap_or_else(Candidate::fallback));
        Arbiter {
            incumbent: Seat { law: PolicyLaw::new(map, layout), taken: active },
            candidate: None,
            before: None,
            record: Record::default(),
            conditions: Conditions::default(),
            end,
            remainder: ([0.0; CHANNELS], 0),
            on_new_model: false,
            swaps: 0,
            ticks: 0,
            kinds: [0; CHANNELS],
            error_kpa: [0.0; CHANNELS],
            decided: [1.0; CHANNELS],
            sent: [1.0; CHANNELS],
            trust: Trust::Policies,
            exploration: None,
            imposed_noise: None,
            noise: NO_NOISE,
        }
    }

    /// Explores around the active policy from the next tick on; answers whether it does. It does not where the fallback
    /// decides or a candidate is on its way.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn explore(&mut self, rules: ExplorationRules) -> bool {
        let spread = self.incumbent.taken.as_ref().filter(|taken| taken.policy.is_some()).map(|taken| taken.spread);
        let alone = self.trust == Trust::Policies && self.candidate.is_none();
        self.exploration = spread.filter(|_| alone).map(|spread| Exploration::new(rules, &spread));
        self.exploration.is_some()
    }

    /// Explores no more.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn stop_exploring(&mut self) {
        self.exploration = None;
    }

    /// Exploration that is on.
    pub fn exploration(&self) -> Option<ExplorationShown> {
        self.exploration.as_ref().map(Exploration::shown)
    }

    /// Takes the noise of a recorded tick in place of what would be drawn, in duty: for replays.
    pub fn impose_noise(&mut self, noise: Pair) {
        self.imposed_noise = Some(noise);
    }

    /// Says whose answers count from now on; the command goes on from where it is.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn set_trust(&mut self, trust: Trust) {
        if trust != self.trust {
            self.trust = trust;
            self.stop_exploring();
            self.remainder_from_sent();
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
        self.remainder = ([0.0; CHANNELS], 0);
        self.on_new_model = false;
        self.ticks = 0;
        (self.decided, self.sent) = (duty, duty);
    }

    /// Puts another model behind both laws; the command goes on from where it is, and the integrals take over what the models
    /// differ by: the rig is the same, and so is the duty that holds it. The caller keeps the one in force, so that
    /// nothing is freed here.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn exchange_map(&mut self, map: &Arc<SteadyMap>) {
        self.stop_exploring();
        let _ = self.incumbent.law.exchange_map(Arc::clone(map));
        if let Some((seat, _)) = &mut self.candidate {
            let _ = seat.law.exchange_map(Arc::clone(map));
        }
        // The incumbent on another model is another controller: its errors are recorded anew.
        self.record = Record::default();
        self.swaps = self.swaps.wrapping_add(1);
        self.on_new_model = true;
    }

    /// The rig was vented by a fault, or disarmed: a candidate with authority has lost it, whoever was to blame.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn vented(&mut self) {
        self.stop_exploring();
        if self.candidate.as_ref().is_some_and(|(_, stages)| stages.now() != StageNow::Shadow) {
            self.lose(Loss::Vented);
        }
    }

    /// Decides the duties of a tick, given the model's predictions for the next five.
    ///
    /// # Real-time
    /// Allocation-free and bounded: two inferences where a candidate is on its way.
    pub fn decide(&mut self, input: &ControlInput, predicted_kpa: &[Pair; AHEAD]) -> ArbitratedCommand {
        let mut event = self.serve();
        let ordered = event.is_some();
        self.kinds = self.conditions.kinds(input);
        self.error_kpa = std::array::from_fn(|c| input.goals_kpa[0][c] - input.measured_kpa[c]);
        let trusted = self.trust == Trust::Policies;
        if self.candidate.is_some() {
            // A candidate is held against what the incumbent does by itself.
            self.stop_exploring();
        }
        let drawn = self.exploration.as_mut().map_or(NO_NOISE, Exploration::draw);
        let noise = self.imposed_noise.take().unwrap_or(drawn);
        let answer = if trusted {
            self.incumbent.answer(input, predicted_kpa, noise)
        } else {
            Answer { decision: self.incumbent.law.observe(input), refused: false, policy: None }
        };
        self.noise = if answer.policy.is_some() { noise } else { NO_NOISE };
        if answer.refused {
            event = self.incumbent_refused().or(event);
        }
        let mut decision = answer.decision;
        let mut shown = answer.policy;
        let mut lost = None;
        if let Some((seat, stages)) = self.candidate.as_mut().filter(|_| trusted) {
            let candidate = seat.answer(input, predicted_kpa, NO_NOISE);
            if candidate.refused {
                lost = Some(Loss::NotFinite);
            } else {
                let authority = stages.begin_tick();
                decision = blended(&decision, &candidate.decision, authority);
                if authority > 0.0 {
                    let stage = stages.now().code() + 1;
                    shown = candidate.policy.map(|answer| PolicyAnswer { stage, authority, ..answer });
                }
            }
        }
        if let Some(loss) = lost {
            self.continue_from(&decision);
            event = self.lose(loss);
        }
        if std::mem::take(&mut self.on_new_model) {
            decision = self.absorbed(decision);
        }
        decision = self.with_remainder(decision);
        self.decided = decision.duty();
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
        self.sent = duty;
    }

    /// Tells what was really sent, and moves the candidate on.
    ///
    /// # Real-time
    /// Runs in the tick, after the command is out.
    pub fn applied(&mut self, duty: Pair) -> Option<PolicyEvent> {
        let filtered = (0..CHANNELS).any(|c| (duty[c] - self.decided[c]).abs() > SAME_DUTY);
        let change_duty = std::array::from_fn(|c| duty[c] - self.sent[c]);
        self.sent = duty;
        self.incumbent.law.applied(duty);
        if let Some((seat, _)) = &mut self.candidate {
            seat.law.applied(duty);
        }
        self.ticks = self.ticks.saturating_add(1);
        if self.ticks < APPROACH_TICKS {
            return None;
        }
        let alone =
            self.candidate.as_ref().is_none_or(|(_, stages)| stages.authority() == 0.0) && self.noise == NO_NOISE;
        if alone {
            self.record.add(self.kinds, self.error_kpa, change_duty);
        }
        let shown = Shown { kinds: self.kinds, error_kpa: self.error_kpa, change_duty, filtered };
        let (seat, stages) = self.candidate.as_mut()?;
        let tag = seat.tag();
        match stages.end_tick(&shown, &self.record) {
            Next::Stay => None,
            Next::Passed(stage) => Some(self.told(PolicyEvent::Passed(tag, stage.code()))),
            Next::Active => self.promote(),
            Next::Lost(loss) => {
                self.remainder_from_sent();
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

    /// Carries out the next order of the publishing thread; there is an event for each.
    fn serve(&mut self) -> Option<PolicyEvent> {
        match self.end.command()? {
            Command::Try(candidate, haste) => {
                if self.lose(Loss::Withdrawn).is_some() {
                    self.remainder_from_sent();
                }
                let law = self.incumbent.law.for_layout(layout_of(Some(&candidate)));
                let tag = candidate.tag;
                let stages = match haste {
                    Haste::Proving => Stages::from_shadow(),
                    Haste::Straight => Stages::straight(),
                };
                self.candidate = Some((Seat { law, taken: Some(candidate) }, stages));
                Some(self.told(PolicyEvent::Taken(tag)))
            }
            Command::Rollback if self.candidate.is_some() => {
                self.remainder_from_sent();
                self.lose(Loss::Withdrawn)
            }
            Command::Rollback => match self.before.take() {
                None => Some(self.told(PolicyEvent::NothingBefore)),
                Some(before) => {
                    let law = self.incumbent.law.for_layout(layout_of(Some(&before)));
                    let tag = before.tag;
                    self.candidate = Some((Seat { law, taken: Some(before) }, Stages::straight()));
                    Some(self.told(PolicyEvent::Taken(tag)))
                }
            },
        }
    }

    /// The incumbent gave no answer: from this tick on its law's fallback decides.
    fn incumbent_refused(&mut self) -> Option<PolicyEvent> {
        self.stop_exploring();
        let taken = self.incumbent.taken.take()?;
        let tag = taken.tag;
        self.end.retire(taken);
        self.swaps = self.swaps.wrapping_add(1);
        self.remainder_from_sent();
        Some(self.told(PolicyEvent::Refused(tag)))
    }

    /// The candidate loses all authority in this tick.
    fn lose(&mut self, loss: Loss) -> Option<PolicyEvent> {
        let (seat, stages) = self.candidate.take()?;
        let tag = seat.tag();
        if let Some(taken) = seat.taken {
            self.end.retire(taken);
        }
        Some(self.told(PolicyEvent::Lost(tag, stages.now().code(), loss)))
    }

    /// The candidate becomes the incumbent; its record begins anew.
    fn promote(&mut self) -> Option<PolicyEvent> {
        let (seat, _) = self.candidate.take()?;
        let old = std::mem::replace(&mut self.incumbent, seat);
        let old = old.taken;
        if let Some(oldest) = std::mem::replace(&mut self.before, old) {
            self.end.retire(oldest);
        }
        self.record = Record::default();
        self.swaps = self.swaps.wrapping_add(1);
        Some(self.told(PolicyEvent::Active(self.incumbent.tag())))
    }

    fn told(&self, event: PolicyEvent) -> PolicyEvent {
        self.end.tell(event);
        event
    }

    fn show(&self) {
        let candidate = self.candidate.as_ref();
        self.end.show(Snapshot {
            incumbent: self.incumbent.tag(),
            candidate: candidate.map(|(seat, _)| seat.tag()),
            stage: candidate.map_or(0, |(_, stages)| stages.now().code()),
            stage_ticks: candidate.map_or(0, |(_, stages)| stages.ticks()),
            authority: candidate.map_or(0.0, |(_, stages)| stages.authority()),
            log_ratio: candidate.map_or([0.0; CHANNELS], |(_, stages)| stages.test().log_ratio()),
            incumbent_rms_kpa: self.record.rms_kpa(),
        });
    }

    /// The next tick's command goes on from the last one, whatever the incumbent would have sent.
    fn remainder_from_sent(&mut self) {
        self.remainder = ([f64::NAN; CHANNELS], DECAY_TICKS);
    }

    /// This tick's command goes on from the last one.
    fn continue_from(&mut self, decision: &ControlOutput) {
        let raw = decision.raw();
        self.remainder = (std::array::from_fn(|c| self.sent[c] - raw[c].clamp(0.0, 1.0)), DECAY_TICKS);
    }

    /// Puts into the integrals what this command is away from the last one.
    fn absorbed(&mut self, mut decision: ControlOutput) -> ControlOutput {
        let raw = decision.raw();
        let moved: Pair = std::array::from_fn(|c| self.sent[c] - raw[c].clamp(0.0, 1.0));
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

    fn with_remainder(&mut self, mut decision: ControlOutput) -> ControlOutput {
        let (remainder, left) = self.remainder;
        if left == 0 {
            return decision;
        }
        if remainder.iter().any(|r| r.is_nan()) {
            self.continue_from(&decision);
        }
        let (remainder, left) = self.remainder;
        let share = f64::from(left) / f64::from(DECAY_TICKS);
        for (parts, remainder) in decision.parts.iter_mut().zip(remainder) {
            parts.correction += share * remainder;
        }
        decision.trajectory = ActionTrajectory(std::array::from_fn(|j| {
            let ahead = (share - j as f64 / f64::from(DECAY_TICKS)).max(0.0);
            std::array::from_fn(|c| saturated(decision.trajectory.0[j][c] + ahead * remainder[c]))
        }));
        self.remainder.1 = left - 1;
        decision
    }
}

fn layout_of(candidate: Option<&Candidate>) -> ObservationLayout {
    // A file is only ever loaded against the layouts this program offers.
    candidate
        .and_then(|c| c.policy.as_ref())
        .and_then(|p| ObservationLayout::of_version(p.contract().version))
        .unwrap_or(ObservationLayout::Paper)
}

fn blended(incumbent: &ControlOutput, candidate: &ControlOutput, authority: f64) -> ControlOutput {
    // Both ends must be what either decided, to the bit.
    if authority == 0.0 {
        return *incumbent;
    }
    if authority == 1.0 {
        return *candidate;
    }
    let mix = |a: f64, b: f64| (1.0 - authority) * a + authority * b;
    ControlOutput {
        parts: std::array::from_fn(|c| {
            let (a, b) = (incumbent.parts[c], candidate.parts[c]);
            DutyTerms {
                feed_forward: mix(a.feed_forward, b.feed_forward),
                play: mix(a.play, b.play),
                correction: mix(a.correction, b.correction),
                proportional: mix(a.proportional, b.proportional),
                integral: mix(a.integral, b.integral),
            }
        }),
        trajectory: ActionTrajectory(std::array::from_fn(|j| {
            std::array::from_fn(|c| mix(incumbent.trajectory.0[j][c], candidate.trajectory.0[j][c]))
        })),
    }
}
