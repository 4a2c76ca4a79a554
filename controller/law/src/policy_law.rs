//! Law of a policy: the observation it is given, and the duty that its answer becomes.
//!
//! Under the paper's contract the policy answers duties, and the paper's integral is added (§III-B2):
//!
//! ```text
//! u = sat(a + I)
//! ```
//!
//! Under the second contract the policy answers corrections `δ` of what the fallback would do, which has an
//! integral of its own:
//!
//! ```text
//! u = sat(u_fallback + a(e) δ),      a = 1 up to E, falling to 0 at 2 E
//! ```
//!
//! The authority `a` leaves the way to a goal to the fallback: there a policy can do nothing that its range would allow
//! for, has hardly been trained, and would only make the landing worse.
//!
//! The fallback is worked out in every tick under both, and is told what was really sent: its integral stands
//! where the rig is, so it can take over within a tick. Daemon, training and evaluation fly policies through this
//! one law.

use std::sync::Arc;

use model::observation::{
    ACTION_LEN, AHEAD, ActionTrajectory, CHANNELS, CORRECTION_LIMIT, CORRECTION_OBSERVATION_LEN, GOALS_AHEAD, History,
    OBSERVATION_LEN, ObservationLayout, PAST, Pair,
};
use model::steady::SteadyMap;

use crate::direction::ReversalTravel;
use crate::fallback::{Fallback, FallbackSettings};
use crate::integral::{IntegralAction, IntegralSettings};
use crate::repetition::Left;
use crate::{ControlInput, ControlOutput, DutyTerms, saturated};

/// E: errors in kPa up to which a correction acts in full.
const AUTHORITY_KPA: Pair = [0.6, 1.5];

/// Everything around a policy but the policy itself.
#[derive(Debug, Clone)]
pub struct PolicyLaw {
    contract: ObservationLayout,
    fallback: Fallback,
    history: History,
    /// Duties that were applied, oldest first; the last was in force until now.
    applied: [Pair; PAST],
    /// Duties at which the applied ones last turned round.
    travel: [ReversalTravel; CHANNELS],
    integral: IntegralAction,
    base: ControlOutput,
    /// Error (kPa) and raw duty of the policy's last decision under the paper's contract, for the anti-windup.
    pending: Option<[(f64, f64); CHANNELS]>,
}

impl PolicyLaw {
    /// A law for the rig that `map` was made of.
    pub fn new(map: Arc<SteadyMap>, contract: ObservationLayout) -> Self {
        PolicyLaw {
            contract,
            fallback: Fallback::new(map, FallbackSettings::default()),
            history: History::default(),
            applied: [[1.0; CHANNELS]; PAST],
            travel: [ReversalTravel::default(); CHANNELS],
            integral: IntegralAction::new(IntegralSettings::default()),
            base: ControlOutput {
                parts: [DutyTerms::default(); CHANNELS],
                trajectory: ActionTrajectory::held([1.0; CHANNELS]),
            },
            pending: None,
        }
    }

    /// Copy of the law, with its past, for a policy of another layout, whose own integral begins at zero.
    ///
    /// # Real-time
    /// A copy without allocation: may run in the tick.
    #[must_use]
    pub fn for_layout(&self, contract: ObservationLayout) -> Self {
        PolicyLaw {
            contract,
            integral: IntegralAction::new(IntegralSettings::default()),
            pending: None,
            ..self.clone()
        }
    }

    /// Takes the fallback's feed-forward and gains from another model from now on, and hands back the one in force.
    ///
    /// # Real-time
    /// As [`Fallback::exchange_map`].
    pub fn exchange_map(&mut self, map: Arc<SteadyMap>) -> Arc<SteadyMap> {
        self.fallback.exchange_map(map)
    }

    /// Puts the integral that this layout acts with where it is known to have been, in duty. For a loop that is rebuilt from a
    /// recording and joins it late; not for the tick.
    pub fn set_integral(&mut self, duty: Pair) {
        match self.contract {
            ObservationLayout::Paper => self.integral.set(duty),
            ObservationLayout::Correction => self.fallback.set_integral(duty),
        }
    }

    /// Remainder of the last decision for the next flight of the reference, where it builds on the fallback.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn left(&self) -> Left {
        self.fallback.left()
    }

    /// Layout of the policy's observations and answers.
    pub fn contract(&self) -> ObservationLayout {
        self.contract
    }

    /// Starts anew with `duty` long in force; keeps what the fallback learned about the valves.
    pub fn restart(&mut self, duty: Pair) {
        self.fallback.restart();
        self.history = History::default();
        self.applied = [duty; PAST];
        self.travel = duty.map(ReversalTravel::from);
        self.integral.set([0.0; CHANNELS]);
        self.pending = None;
    }

    /// Takes in a tick and works out the fallback's decision for it.
    ///
    /// # Real-time
    /// Allocation-free and bounded: may run in the tick.
    pub fn observe(&mut self, situation: &ControlInput) -> ControlOutput {
        self.history.push(situation.measured_kpa, situation.goals_kpa[0]);
        self.base = self.fallback.decide(situation);
        self.pending = None;
        self.base
    }

    /// Writes what the policy is told, given the model's predictions for the next five ticks. The slice must hold
    /// [`ObservationLayout::observation_len`] numbers; of a shorter one only the whole groups that fit are written.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn write_observation(&self, situation: &ControlInput, predicted_kpa: &[Pair; AHEAD], observation: &mut [f32]) {
        let ahead: [Pair; GOALS_AHEAD] = std::array::from_fn(|j| situation.goals_kpa[j + 1]);
        let Some((paper, rest)) = observation.split_first_chunk_mut::<OBSERVATION_LEN>() else { return };
        self.history.observe(predicted_kpa, &ahead, paper);
        if self.contract == ObservationLayout::Correction {
            let integral = self.base.parts.map(|p| p.integral);
            let play = self.base.parts.map(|p| p.play);
            let width = self.fallback.learned_play();
            let travelled = self.travel.map(|t| t.distance());
            let few = [integral, play, width, travelled];
            let pairs = self.applied.iter().chain(&self.base.trajectory.0).chain(&few);
            for (slot, value) in rest.iter_mut().zip(pairs.flatten()) {
                *slot = *value as f32;
            }
        }
    }

    /// Share of a correction that acts, 0 … 1: all of it on the goal, nothing far from it.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn authority(situation: &ControlInput) -> Pair {
        std::array::from_fn(|c| {
            let error_kpa = situation.goals_kpa[0][c] - situation.measured_kpa[c];
            (2.0 - error_kpa.abs() / AUTHORITY_KPA[c]).clamp(0.0, 1.0)
        })
    }

    /// Turns the policy's answer into a decision.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn decide(&mut self, situation: &ControlInput, outputs: &[f32; ACTION_LEN]) -> ControlOutput {
        let actions = ActionTrajectory::from_outputs(outputs);
        match self.contract {
            ObservationLayout::Paper => {
                let integral = self.integral.duty();
                let parts: [DutyTerms; CHANNELS] = std::array::from_fn(|c| DutyTerms {
                    feed_forward: actions.now()[c],
                    integral: integral[c],
                    ..DutyTerms::default()
                });
                self.pending = Some(std::array::from_fn(|c| {
                    (situation.goals_kpa[0][c] - situation.measured_kpa[c], parts[c].raw())
                }));
                let trajectory =
                    ActionTrajectory(actions.0.map(|a| std::array::from_fn(|c| saturated(a[c] + integral[c]))));
                ControlOutput { parts, trajectory }
            }
            ObservationLayout::Correction => {
                let authority = Self::authority(situation);
                let within = |d: f64| d.clamp(-CORRECTION_LIMIT, CORRECTION_LIMIT);
                let correction = actions.0.map(|a| std::array::from_fn(|c| authority[c] * within(a[c])));
                let mut decision = self.base;
                for (parts, now) in decision.parts.iter_mut().zip(correction[0]) {
                    parts.correction = now;
                }
                let base = self.base.trajectory.0;
                decision.trajectory = ActionTrajectory(std::array::from_fn(|j| {
                    std::array::from_fn(|c| {
                        // Now counts what the limits took from the fallback; the plan starts from limited duties.
                        let from = if j == 0 { self.base.parts[c].raw() } else { base[j][c] };
                        saturated(from + correction[j][c])
                    })
                }));
                self.fallback.corrected(correction[0]);
                decision
            }
        }
    }

    /// Takes what the command that was decided for is to be moved by into the integral of whatever decided it, in duty.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn absorb(&mut self, duty: Pair) {
        match &mut self.pending {
            Some(pending) => {
                for (c, ((_, raw), duty)) in pending.iter_mut().zip(duty).enumerate() {
                    self.integral.shift(c, duty);
                    *raw += duty;
                }
            }
            None => self.fallback.absorb(duty),
        }
    }

    /// Tells what was really sent, whoever decided it.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn applied(&mut self, duty: Pair) {
        self.applied.rotate_left(1);
        self.applied[PAST - 1] = duty;
        for (travel, duty) in self.travel.iter_mut().zip(duty) {
            travel.follow(duty);
        }
        self.fallback.applied(duty);
        if let Some(pending) = self.pending {
            for (c, ((error_kpa, raw), applied)) in pending.into_iter().zip(duty).enumerate() {
                self.integral.update(c, error_kpa, raw, applied);
            }
        }
    }

    /// Half width of play that the fallback learned, in duty.
    pub fn learned_play(&self) -> Pair {
        self.fallback.learned_play()
    }
}

// The two lengths are told apart by the contract alone; a third group would be forgotten silently without this.
const _: () = assert!(CORRECTION_OBSERVATION_LEN == OBSERVATION_LEN + CHANNELS * (PAST + AHEAD + 1 + 4));

#[cfg(test)]
mod tests {
    use super::*;
    use model::rig::Rig;

    fn law(contract: ObservationLayout) -> PolicyLaw {
        let map = Arc::new(SteadyMap::new(&Rig::builtin("dual_pressure").unwrap()).unwrap());
        PolicyLaw::new(map, contract)
    }

    fn situation(measured_kpa: Pair) -> ControlInput {
        ControlInput::of_measured(measured_kpa, [[90.0, -72.0]; GOALS_AHEAD + 1])
    }

    #[test]
    fn a_correction_of_nothing_sends_what_the_fallback_would() {
        let mut law = law(ObservationLayout::Correction);
        for t in 0..50 {
            let now = situation([85.0 + 0.1 * f64::from(t), -70.0]);
            let base = law.observe(&now);
            let decision = law.decide(&now, &[0.0; ACTION_LEN]);
            assert_eq!(decision, base);
            law.applied(decision.duty());
        }
    }

    #[test]
    fn every_number_of_the_second_contract_lands_where_the_table_says() {
        let mut law = law(ObservationLayout::Correction);
        law.restart([0.5, 0.6]);
        for t in 0..10 {
            law.observe(&situation([80.0, -70.0]));
            law.applied([0.7 + 0.01 * f64::from(t), 0.8 + 0.01 * f64::from(t)]);
        }
        let now = situation([80.0, -70.0]);
        let base = law.observe(&now);
        let mut observation = [f32::NAN; CORRECTION_OBSERVATION_LEN];
        law.write_observation(&now, &[[81.0, -71.0]; AHEAD], &mut observation);
        assert_eq!(observation[22..24], [81.0, -71.0]);
        assert_eq!(observation[84..86], [0.7, 0.8]);
        assert_eq!(observation[102..104], [0.79, 0.89]);
        for (j, pair) in base.trajectory.0.iter().enumerate() {
            assert_eq!(observation[104 + 2 * j..106 + 2 * j], pair.map(|u| u as f32));
        }
        assert_eq!(observation[116..118], base.parts.map(|p| p.integral as f32));
        assert_eq!(observation[118..120], base.parts.map(|p| p.play as f32));
        assert_eq!(observation[120..122], law.learned_play().map(|w| w as f32));
        // From 0.5 and 0.6, long in force, up to 0.79 and 0.89, further than is told.
        assert_eq!(observation[122..124], [ReversalTravel::MOST as f32; 2]);
    }

    /// A correction acts in full near the goal, by half at one and a half times E, and not at all far away.
    #[test]
    fn authority_fades_with_the_error() {
        let felt = |error_kpa: f64| {
            let mut law = law(ObservationLayout::Correction);
            let now = situation([90.0 - error_kpa, -72.0 + error_kpa * AUTHORITY_KPA[1] / AUTHORITY_KPA[0]]);
            law.observe(&now);
            law.decide(&now, &[0.02; ACTION_LEN]).parts.map(|p| p.correction)
        };
        assert_eq!(felt(0.0), [f64::from(0.02f32); CHANNELS]);
        assert_eq!(felt(0.99 * AUTHORITY_KPA[0]), felt(0.0));
        let half = felt(-1.5 * AUTHORITY_KPA[0]);
        assert!(half.iter().all(|c| (c - 0.01).abs() < 1e-9), "{half:?}");
        assert_eq!(felt(40.0), [0.0; CHANNELS]);
    }

    /// A policy that is off by a constant duty: the paper's integral takes it up, and no error is left to correct.
    #[test]
    fn the_papers_integral_takes_up_a_constant_error_of_the_policy() {
        let mut law = law(ObservationLayout::Paper);
        let now = situation([91.0, -72.0]);
        let mut last = 0.0;
        for _ in 0..50 {
            law.observe(&now);
            let decision = law.decide(&now, &[0.7; ACTION_LEN]);
            law.applied(decision.duty());
            last = decision.duty()[0];
        }
        // 49 ticks of 1 kPa too much at 0.01 duty/(kPa s): the vent opens.
        assert!((last - 0.7 - 0.01 * 0.98).abs() < 1e-6, "{last}");
    }
}
