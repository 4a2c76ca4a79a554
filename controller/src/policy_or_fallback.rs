//! What decides the duties: a policy where one flies, the fallback otherwise.
//!
//! The fallback is worked out in every tick, also while a policy flies, and is told what was really sent. So
//! its integral stands where the rig is, and it can take over within a tick.

use std::sync::Arc;

use law::{ControlInput, ControlOutput, PolicyLaw};
use model::observation::{ACTION_LEN, AHEAD, CORRECTION_OBSERVATION_LEN, ObservationLayout, Pair};
use model::steady::SteadyMap;
use policy::Policy;
use proto::recording::observation_hash;

/// The control law in force, with everything it remembers.
pub struct PolicyOrFallback {
    law: PolicyLaw,
    policy: Option<Policy>,
}

/// A decision and who made it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArbitratedCommand {
    /// The decision.
    pub decision: ControlOutput,
    /// Whether the policy refused in this tick, which ends its flight.
    pub refused: bool,
    /// What the policy was shown and answered, where one did.
    pub answer: Option<PolicyAnswer>,
}

/// A policy's answer, for the recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PolicyAnswer {
    /// Hash of the observation ([`observation_hash`]).
    pub observation_hash: u64,
    /// All of its outputs: now and the next five ticks, positive and negative valve in turn.
    pub outputs: [f32; ACTION_LEN],
}

impl PolicyOrFallback {
    /// A pilot for the rig that `map` was made of; without a policy the fallback flies.
    pub fn new(map: Arc<SteadyMap>, policy: Option<Policy>) -> Self {
        // A file is only ever loaded against the contracts this program offers; the paper's is the first of them.
        let contract = policy.as_ref().and_then(|p| ObservationLayout::of_version(p.contract().version));
        PolicyOrFallback { law: PolicyLaw::new(map, contract.unwrap_or(ObservationLayout::Paper)), policy }
    }

    /// Starts anew after arming, with `duty` long in force.
    pub fn restart(&mut self, duty: Pair) {
        self.law.restart(duty);
    }

    /// Decides the duties of a tick, given the model's predictions for the next five.
    ///
    /// # Real-time
    /// Allocation-free and bounded: runs in the tick.
    pub fn decide(&mut self, situation: &ControlInput, predicted_kpa: &[Pair; AHEAD]) -> ArbitratedCommand {
        let fallback = self.law.observe(situation);
        let Some(policy) = &mut self.policy else {
            return ArbitratedCommand { decision: fallback, refused: false, answer: None };
        };
        let mut observation = [0.0; CORRECTION_OBSERVATION_LEN];
        let told = observation.get_mut(..self.law.contract().observation_len()).unwrap_or_default();
        self.law.write_observation(situation, predicted_kpa, told);
        let mut outputs = [0.0; ACTION_LEN];
        if policy.run(told, &mut outputs).is_err() {
            self.policy = None;
            return ArbitratedCommand { decision: fallback, refused: true, answer: None };
        }
        let answer = PolicyAnswer { observation_hash: observation_hash(told), outputs };
        ArbitratedCommand { decision: self.law.decide(situation, &outputs), refused: false, answer: Some(answer) }
    }

    /// Tells what was really sent.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn applied(&mut self, duty: Pair) {
        self.law.applied(duty);
    }
}
