//! Entry of a policy.

use std::collections::BTreeMap;

use admission::{Refusal, Stage, Standing, TrialFigures};
use handover::{PolicyTag, StageNow};
use policy::Policy;
use serde::{Deserialize, Serialize};

/// Values of metadata that are longer than this are lists and golden pairs, which nobody reads.
const LONGEST_VALUE: usize = 80;

/// Stage at which a policy stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EntryState {
    /// Seen, and being taken through the stages.
    Checking,
    /// Through all stages before the rig, and with no part there: it waits for `swap`.
    Passed,
    /// Computed on live readings, not used.
    Shadow,
    /// Part of the command.
    Ramp,
    /// Not used for a while, so that what it is held against is measured anew.
    Recheck,
    /// Not used for a while either: it erred more, and what it is held against is measured anew before the ramp begins again.
    Retrial,
    /// All of the command, with the way back open.
    Probation,
    /// Through all stages; it flies unless a candidate has all of the command.
    Active,
    /// Active before; `rollback` goes back to it.
    Previous,
    /// Must not fly.
    Refused,
    /// The file is no longer there or holds something else; it is kept for a swap.
    Gone,
}

impl EntryState {
    /// Tells whether it is through all stages before the rig, its file there or not.
    pub(crate) fn has_passed(self) -> bool {
        matches!(self, EntryState::Passed | EntryState::Gone)
    }

    /// The state of a candidate at a stage.
    pub fn of_stage(stage: StageNow) -> Self {
        match stage {
            StageNow::Shadow => EntryState::Shadow,
            StageNow::Ramp(_) => EntryState::Ramp,
            StageNow::Recheck => EntryState::Recheck,
            StageNow::Retrial => EntryState::Retrial,
            StageNow::Probation => EntryState::Probation,
        }
    }

    /// The stage at which a candidate in this state is refused.
    pub fn stage(self) -> Stage {
        match self {
            EntryState::Ramp | EntryState::Recheck | EntryState::Retrial => Stage::Ramp,
            EntryState::Probation => Stage::Probation,
            _ => Stage::Shadow,
        }
    }

    /// Tells whether it is between the order to try it and what comes of that.
    pub fn is_on_its_way(self) -> bool {
        use EntryState::{Probation, Ramp, Recheck, Retrial, Shadow};
        matches!(self, Shadow | Ramp | Recheck | Retrial | Probation)
    }

    /// The word that operators read.
    pub fn name(self) -> &'static str {
        match self {
            EntryState::Checking => "checking",
            EntryState::Passed => "passed",
            EntryState::Shadow => "shadow",
            EntryState::Ramp => "ramp",
            EntryState::Recheck => "recheck",
            EntryState::Retrial => "retrial",
            EntryState::Probation => "probation",
            EntryState::Active => "active",
            EntryState::Previous => "previous",
            EntryState::Refused => "refused",
            EntryState::Gone => "gone",
        }
    }
}

/// A policy as operators see it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Entry {
    /// Name: the file's without `.onnx`.
    pub name: String,
    /// Stage at which it stands.
    pub state: EntryState,
    /// SHA-256 of the file; empty where it could not be read.
    #[serde(default)]
    pub sha256: String,
    /// Share of the command in percent, while it is a candidate.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub authority_percent: Option<f64>,
    /// Reason why it was refused, and at which stage.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refusal: Option<Refusal>,
    /// Errors on the model in force, where the fallback tracks clearly better there.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub behind: Option<Standing>,
    /// Figures of its closed-loop trial.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub figures: Option<TrialFigures>,
    /// Median time of an inference in µs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub inference_us: Option<f64>,
    /// Provenance by the file itself: rig, seed, steps, and so on.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub provenance: BTreeMap<String, String>,
}

impl Entry {
    /// A policy that was just seen.
    pub fn checking(name: &str) -> Self {
        Entry {
            name: name.to_owned(),
            state: EntryState::Checking,
            sha256: String::new(),
            authority_percent: None,
            refusal: None,
            behind: None,
            figures: None,
            inference_us: None,
            provenance: BTreeMap::new(),
        }
    }

    /// Tag; that of no policy where the file could not be read.
    pub fn tag(&self) -> Option<PolicyTag> {
        u64::from_str_radix(self.sha256.get(..16)?, 16).ok().map(PolicyTag)
    }
}

/// Provenance by the policy itself, without what is long.
pub fn provenance(policy: &Policy) -> BTreeMap<String, String> {
    let short = policy.metadata().iter().filter(|(_, value)| value.len() <= LONGEST_VALUE);
    short.map(|(key, value)| (key.to_owned(), value.to_owned())).collect()
}
