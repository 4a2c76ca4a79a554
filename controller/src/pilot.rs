//! What decides the duties: a policy where one flies, the fallback otherwise.
//!
//! The fallback is worked out in every tick, also while a policy flies, and is told what was really sent. So
//! its integral stands where the rig is, and it can take over within a tick.

use std::sync::Arc;

use law::{Decision, Fallback, FallbackSettings, IntegralAction, IntegralSettings, Parts, Situation, saturated};
use model::contract::{ACTION_LEN, AHEAD, ActionTrajectory, CHANNELS, GOALS_AHEAD, History, OBSERVATION_LEN, Pair};
use model::steady::SteadyMap;
use policy::Policy;

/// The control law in force, with everything it remembers.
pub struct Pilot {
    fallback: Fallback,
    policy: Option<Flying>,
    history: History,
}

/// A policy in the air.
struct Flying {
    policy: Policy,
    integral: IntegralAction,
    /// Error (kPa) and raw duty of the last decision, for the anti-windup.
    pending: [(f64, f64); CHANNELS],
}

/// A decision and who made it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piloted {
    /// The decision.
    pub decision: Decision,
    /// Whether the policy refused in this tick, which ends its flight.
    pub refused: bool,
}

impl Pilot {
    /// A pilot for the rig that `map` was made of; without a policy the fallback flies.
    pub fn new(map: Arc<SteadyMap>, policy: Option<Policy>) -> Self {
        let integral = IntegralAction::new(IntegralSettings::default());
        Pilot {
            fallback: Fallback::new(map, FallbackSettings::default()),
            policy: policy.map(|policy| Flying { policy, integral, pending: [(0.0, 0.0); CHANNELS] }),
            history: History::default(),
        }
    }

    /// Starts anew after arming.
    pub fn restart(&mut self) {
        self.fallback.restart();
        self.history = History::default();
        if let Some(flying) = &mut self.policy {
            flying.integral.set([0.0; CHANNELS]);
        }
    }

    /// Decides the duties of a tick, given the model's predictions for the next five.
    ///
    /// # Real-time
    /// Allocation-free and bounded: runs in the tick.
    pub fn decide(&mut self, situation: &Situation, predicted_kpa: &[Pair; AHEAD]) -> Piloted {
        self.history.push(situation.measured_kpa, situation.goals_kpa[0]);
        let fallback = self.fallback.decide(situation);
        let Some(flying) = &mut self.policy else { return Piloted { decision: fallback, refused: false } };
        let mut observation = [0.0; OBSERVATION_LEN];
        let ahead: [Pair; GOALS_AHEAD] = std::array::from_fn(|j| situation.goals_kpa[j + 1]);
        self.history.observe(predicted_kpa, &ahead, &mut observation);
        match flying.decide(&observation, situation) {
            Some(decision) => Piloted { decision, refused: false },
            None => {
                self.policy = None;
                Piloted { decision: fallback, refused: true }
            }
        }
    }

    /// Tells what was really sent.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn applied(&mut self, duty: Pair) {
        self.fallback.applied(duty);
        if let Some(flying) = &mut self.policy {
            for (c, ((error_kpa, raw), applied)) in flying.pending.into_iter().zip(duty).enumerate() {
                flying.integral.update(c, error_kpa, raw, applied);
            }
        }
    }

    /// Half width of play that the fallback learned, in duty.
    pub fn learned_play(&self) -> Pair {
        self.fallback.learned_play()
    }
}

impl Flying {
    /// The paper's law, u = sat(a + I); `None` if the policy refuses its inputs or answers nonsense.
    fn decide(&mut self, observation: &[f32; OBSERVATION_LEN], situation: &Situation) -> Option<Decision> {
        let mut outputs = [0.0; ACTION_LEN];
        self.policy.run(observation, &mut outputs).ok()?;
        let actions = ActionTrajectory::from_outputs(&outputs);
        let integral = self.integral.duty();
        let parts: [Parts; CHANNELS] =
            std::array::from_fn(|c| Parts { feed_forward: actions.now()[c], proportional: 0.0, integral: integral[c] });
        self.pending = std::array::from_fn(|c| (situation.goals_kpa[0][c] - situation.measured_kpa[c], parts[c].raw()));
        let trajectory = ActionTrajectory(actions.0.map(|a| std::array::from_fn(|c| saturated(a[c] + integral[c]))));
        Some(Decision { parts, trajectory })
    }
}
