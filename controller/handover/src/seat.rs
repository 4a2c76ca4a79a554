//! A policy in its law: what it is shown, what it answers, and the decision that comes of it.

use law::{ControlInput, ControlOutput, PolicyLaw};
use model::observation::{ACTION_LEN, AHEAD, CORRECTION_OBSERVATION_LEN, ObservationLayout, Pair};
use proto::recording::observation_hash;

use crate::channel::{Candidate, PolicyTag};
use crate::exploration::Noise;

/// A policy's answer, for the recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PolicyAnswer {
    /// Hash of the observation ([`observation_hash`]).
    pub observation_hash: u64,
    /// All of its outputs, without exploration: now and the next five ticks, positive and negative valve in turn.
    pub outputs: [f32; ACTION_LEN],
    /// Stage of the policy: 0 active, or one more than [`crate::StageNow::code`].
    pub stage: u8,
    /// Share of the command, 0 … 1.
    pub authority: f64,
}

/// A policy in its law; without a policy the law's fallback.
pub(crate) struct Seat {
    pub(crate) law: PolicyLaw,
    pub(crate) taken: Option<Box<Candidate>>,
}

/// Tag of a policy; the fallback's where there is none.
pub(crate) fn tag_of(candidate: Option<&Candidate>) -> PolicyTag {
    candidate.map_or(PolicyTag::FALLBACK, |candidate| candidate.tag)
}

/// A seat's answer.
pub(crate) struct Answer {
    pub(crate) decision: ControlOutput,
    pub(crate) refused: bool,
    pub(crate) policy: Option<PolicyAnswer>,
    /// Noise that exploration added to it.
    pub(crate) noise: Noise,
}

impl Seat {
    pub(crate) fn tag(&self) -> PolicyTag {
        tag_of(self.taken.as_deref())
    }

    /// Tells whether its command is the fallback's, with a correction or without.
    pub(crate) fn builds_on_fallback(&self) -> bool {
        let replaces = self.law.contract() == ObservationLayout::Paper;
        !replaces || self.taken.as_ref().is_none_or(|taken| taken.policy.is_none())
    }

    pub(crate) fn answer(&mut self, input: &ControlInput, predicted_kpa: &[Pair; AHEAD], noise: &Noise) -> Answer {
        let fallback = self.law.observe(input);
        let Some(taken) = self.taken.as_mut().and_then(|taken| taken.policy.as_mut()) else {
            return Answer { decision: fallback, refused: false, policy: None, noise: Noise::NONE };
        };
        let mut observation = [0.0; CORRECTION_OBSERVATION_LEN];
        let told = observation.get_mut(..self.law.contract().observation_len()).unwrap_or_default();
        self.law.write_observation(input, predicted_kpa, told);
        let mut outputs = [0.0; ACTION_LEN];
        match taken.run(told, &mut outputs) {
            Ok(()) => {
                let policy =
                    PolicyAnswer { observation_hash: observation_hash(told), outputs, stage: 0, authority: 1.0 };
                let noise = noise.within(&outputs, &taken.contract().outputs);
                noise.added_to(&mut outputs);
                Answer { decision: self.law.decide(input, &outputs), refused: false, policy: Some(policy), noise }
            }
            Err(_) => Answer { decision: fallback, refused: true, policy: None, noise: Noise::NONE },
        }
    }
}

/// The layout that a candidate is told the observation in; the paper's for the fallback.
pub(crate) fn layout_of(candidate: Option<&Candidate>) -> ObservationLayout {
    // A file is only ever loaded against the layouts this program offers.
    candidate
        .and_then(|c| c.policy.as_ref())
        .and_then(|p| ObservationLayout::of_version(p.contract().version))
        .unwrap_or(ObservationLayout::Paper)
}
