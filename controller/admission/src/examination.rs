//! The stages in their order, from a file to a policy that may go on to the rig.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use model::rig::{Rig, RigError};
use policy::{Links, Policy, PolicyHash, PolicySignature};
use serde::{Deserialize, Serialize};

use crate::answers::Answers;
use crate::signature::SignatureRule;
use crate::standing::Standing;
use crate::trial::{Limits, Tally, Trial, TrialFigures, judge};

/// Longest median of an inference, in µs: a hundredth of the tick.
const MOST_INFERENCE_US: f64 = 200.0;
/// Inferences that are timed.
const TIMED: usize = 101;

/// A stage, in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    /// Size and kind of the file.
    File,
    /// Signature.
    Signature,
    /// The network and what it says of itself.
    Network,
    /// Answers over the range of its observations.
    Answers,
    /// Closed-loop trial.
    Trial,
    /// Shadow on live readings.
    Shadow,
    /// Authority ramp.
    Ramp,
    /// Probation in full authority.
    Probation,
}

impl Stage {
    /// The word that operators read.
    pub fn name(self) -> &'static str {
        match self {
            Stage::File => "file",
            Stage::Signature => "signature",
            Stage::Network => "network",
            Stage::Answers => "answers",
            Stage::Trial => "trial",
            Stage::Shadow => "shadow",
            Stage::Ramp => "ramp",
            Stage::Probation => "probation",
        }
    }
}

/// Reason why a policy was refused.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, thiserror::Error)]
#[error("stage {}: {reason}", .stage.name())]
pub struct Refusal {
    /// At which stage.
    pub stage: Stage,
    /// Reason, one line with the fix.
    pub reason: String,
    /// SHA-256 of the file, where it could be read.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sha256: Option<String>,
    /// Figures of the trial, where it got that far.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub figures: Option<TrialFigures>,
}

/// A policy that has passed, with what was found.
pub struct Admitted {
    /// The policy.
    pub policy: Policy,
    /// Answers over the range of its observations.
    pub answers: Answers,
    /// Trial.
    pub figures: TrialFigures,
    /// Flights of the trial, to compare others with once it is the incumbent.
    pub tallies: Vec<Tally>,
    /// Median time of an inference in µs.
    pub inference_us: f64,
}

/// Means by which policies are examined: the contracts, the trial around a model, the rule on signatures.
pub struct Examiner {
    signatures: Vec<PolicySignature>,
    rule: SignatureRule,
    trial: Trial,
}

impl Examiner {
    /// Lays out the trial around `model`.
    ///
    /// # Errors
    /// If the model's rig cannot be flown.
    pub fn new(
        signatures: Vec<PolicySignature>,
        rule: SignatureRule,
        model: &Rig,
        limits: Limits,
    ) -> Result<Self, RigError> {
        Ok(Examiner { signatures, rule, trial: Trial::new(model, limits)? })
    }

    /// The fallback's flights of the trial: what a policy is compared with where none flies.
    pub fn fallback(&self) -> &[Tally] {
        self.trial.fallback()
    }

    /// Reads a file and takes it through all stages.
    ///
    /// `incumbent` are the flights of what flies now, [`Admitted::tallies`] or [`Examiner::fallback`].
    ///
    /// # Errors
    /// The stage that refused it, and why.
    pub fn examine(&self, path: &Path, links: Links, incumbent: &[Tally]) -> Result<Admitted, Refusal> {
        self.examine_file(path, links, incumbent).map(|(admitted, _)| admitted)
    }

    /// As [`Examiner::examine`], with the bytes that were read: what is examined is what is kept.
    ///
    /// # Errors
    /// The stage that refused it, and why.
    pub fn examine_file(
        &self,
        path: &Path,
        links: Links,
        incumbent: &[Tally],
    ) -> Result<(Admitted, Arc<[u8]>), Refusal> {
        let bytes = policy::read(path, links).map_err(|fault| refusal(Stage::File, fault.to_string()))?;
        let hash = policy::hash(&bytes);
        let hashed = |refusal: Refusal| Refusal { sha256: Some(hash.to_string()), ..refusal };
        self.rule.check(path, &bytes).map_err(|reason| hashed(refusal(Stage::Signature, reason)))?;
        let name = path.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
        let admitted = self.examine_bytes(name, &bytes, incumbent)?;
        Ok((admitted, bytes.into()))
    }

    /// Flies a policy that controls already through the trial and judges nothing but how it stands against the fallback;
    /// `None` where the file cannot be loaded.
    ///
    /// # Real-time
    /// About a second; not for the tick.
    pub fn stand(&self, bytes: &[u8]) -> Option<(Standing, Vec<Tally>)> {
        let mut policy = Policy::from_bytes(String::new(), bytes, &self.signatures).ok()?;
        let tallies = self.trial.fly(&mut policy);
        Some((self.standing_of(&tallies)?, tallies))
    }

    /// The standing of a policy's flights of the trial ([`Admitted::tallies`]) against the fallback.
    pub fn standing_of(&self, tallies: &[Tally]) -> Option<Standing> {
        Standing::of(tallies, self.trial.fallback(), self.trial.noise_kpa())
    }

    /// As [`Examiner::examine`], from bytes that the caller already has and trusts the origin of.
    ///
    /// # Errors
    /// The stage that refused it, and why.
    pub fn examine_bytes(&self, name: String, bytes: &[u8], incumbent: &[Tally]) -> Result<Admitted, Refusal> {
        let hash: PolicyHash = policy::hash(bytes);
        let hashed = |refusal: Refusal| Refusal { sha256: Some(hash.to_string()), ..refusal };
        let loaded = Policy::from_bytes(name, bytes, &self.signatures);
        let mut policy = loaded.map_err(|fault| hashed(refusal(Stage::Network, fault.to_string())))?;
        let inference_us = timed(&mut policy);
        if inference_us > MOST_INFERENCE_US {
            let reason = format!(
                "an inference takes {inference_us:.0} µs, allowed are {MOST_INFERENCE_US}; train a smaller network"
            );
            return Err(hashed(refusal(Stage::Network, reason)));
        }
        let answers = Answers::of(&mut policy);
        if let Some(reason) = answers.refusal() {
            return Err(hashed(refusal(Stage::Answers, reason)));
        }
        let tallies = self.trial.fly(&mut policy);
        let judgement = judge(&tallies, self.trial.fallback(), incumbent);
        match judgement.refused {
            Some(reason) => Err(Refusal { figures: Some(judgement.figures), ..hashed(refusal(Stage::Trial, reason)) }),
            None => Ok(Admitted { policy, answers, figures: judgement.figures, tallies, inference_us }),
        }
    }
}

fn refusal(stage: Stage, reason: String) -> Refusal {
    Refusal { stage, reason, sha256: None, figures: None }
}

/// The median of some inferences on the middle of the range, in µs.
fn timed(policy: &mut Policy) -> f64 {
    let middle: Vec<f32> = policy.contract().inputs.iter().map(|c| c.low + 0.5 * (c.high - c.low)).collect();
    let mut answers = vec![0.0; policy.outputs()];
    let mut times: Vec<f64> = (0..TIMED)
        .map(|_| {
            let start = Instant::now();
            let _ = std::hint::black_box(policy.run(&middle, &mut answers));
            start.elapsed().as_secs_f64() * 1e6
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times.get(TIMED / 2).copied().unwrap_or(f64::NAN)
}
