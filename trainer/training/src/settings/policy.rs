//! Contract of the policy: what it is told and answers.

use serde::{Deserialize, Serialize};

/// The ablation's four variants.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Variant {
    /// Neither MPObs nor CAPS.
    Raw,
    /// MPObs without CAPS.
    Mpobs,
    /// CAPS without MPObs.
    Caps,
    /// Both: the paper's controller.
    Both,
}

impl Variant {
    /// All four, in the paper's order.
    pub const ALL: [Variant; 4] = [Variant::Raw, Variant::Mpobs, Variant::Caps, Variant::Both];

    /// Name in files and on command lines.
    pub fn name(self) -> &'static str {
        match self {
            Variant::Raw => "raw",
            Variant::Mpobs => "mpobs",
            Variant::Caps => "caps",
            Variant::Both => "both",
        }
    }

    /// Tells whether the policy is told predictions and paid for them.
    pub fn predicts(self) -> bool {
        matches!(self, Variant::Mpobs | Variant::Both)
    }

    /// Tells whether the policy's changes are penalised.
    pub fn smooths(self) -> bool {
        matches!(self, Variant::Caps | Variant::Both)
    }
}

impl std::str::FromStr for Variant {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let known = || Variant::ALL.map(Variant::name).join(", ");
        Variant::ALL
            .into_iter()
            .find(|v| v.name() == name)
            .ok_or_else(|| format!("`{name}` is no variant; there are {}", known()))
    }
}

/// Form in which the numbers of an observation are put to the network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Features {
    /// Each pressure and goal by itself, scaled: what the paper describes.
    Plain,
    /// Errors to the goal of the same tick, changes of the goal, and the goal itself.
    Errors,
}

/// Where the plan comes from that MPObs rolls ahead: a policy's outputs for the next five ticks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Plan {
    /// From the rewards, as in the paper.
    Learned,
    /// The actor answers for now alone; what comes later is fitted at the end to what the policy then does.
    Fitted,
}

/// Contract of the policy: what it is told and answers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PolicySettings {
    /// Version of the observation contract: 1 is the paper's, 2 corrects the fallback.
    pub contract: u32,
    /// Ablation.
    pub variant: Variant,
    /// Form in which observations are put to the network.
    pub features: Features,
    /// Where the plan comes from.
    pub plan: Plan,
    /// Units of the hidden layers.
    pub hidden: [usize; 2],
    /// Factor of the actor's last layer at the start: a small one starts with hardly any action.
    pub first_output_scale: f64,
    /// Logarithm of the actor's standard deviation at the start.
    pub first_log_std: f64,
}

impl Default for PolicySettings {
    fn default() -> Self {
        PolicySettings {
            contract: 1,
            variant: Variant::Both,
            features: Features::Plain,
            plan: Plan::Learned,
            hidden: [256, 256],
            first_output_scale: 1.0,
            first_log_std: 0.0,
        }
    }
}
