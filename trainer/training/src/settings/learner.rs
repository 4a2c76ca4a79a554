//! Soft Actor-Critic, and the conditioning of what it learns.

use serde::{Deserialize, Serialize};

/// Soft Actor-Critic (paper, Table IV).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SacSettings {
    /// Adam's learning rate, of all three losses.
    pub learning_rate: f64,
    /// Share of the learning rate that is left after `annealed_over_steps`, towards which it falls linearly; the paper's
    /// rate is constant, 1.
    pub annealed_to: f64,
    /// Steps over which the learning rate falls. Not the run's length: a run must not depend on how far it was planned, or
    /// going on with it would not be the run that was planned so far at once.
    pub annealed_over_steps: u64,
    /// Discount γ.
    pub discount: f64,
    /// Target smoothing τ.
    pub soft_update: f64,
    /// Samples per update.
    pub batch: usize,
    /// Transitions that are kept.
    pub replay: usize,
    /// Entropy that the temperature aims at; the paper has −dim(a) = −12.
    pub target_entropy: f64,
    /// Temperature at the start.
    pub first_temperature: f64,
}

impl Default for SacSettings {
    fn default() -> Self {
        SacSettings {
            learning_rate: 3e-4,
            annealed_to: 1.0,
            annealed_over_steps: 512_000,
            discount: 0.9,
            soft_update: 0.005,
            batch: 128,
            replay: 500_000,
            target_entropy: -12.0,
            first_temperature: 1.0,
        }
    }
}

/// Conditioning for action policy smoothness (paper, Table IV).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CapsSettings {
    /// λ_T.
    pub temporal: f64,
    /// λ_S.
    pub spatial: f64,
    /// σ of the spatial term on pressures, in kPa.
    pub sigma_kpa: f64,
    /// σ of the spatial term on duties that the second contract tells.
    pub sigma_duty: f64,
}

impl Default for CapsSettings {
    fn default() -> Self {
        CapsSettings { temporal: 1.0, spatial: 0.4, sigma_kpa: 1.5, sigma_duty: 0.0 }
    }
}
