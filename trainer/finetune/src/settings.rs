//! A run of fine-tuning as data.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use training::Variant;

/// Plan of a published policy whose actor answers for now alone: what MPObs rolls ahead.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PublishedPlan {
    /// Fitted to what the policy then does on the recorded model; half a minute of one core.
    Fitted,
    /// The duties of now, held.
    Held,
}

/// Everything that decides what a run computes, and where it reads and publishes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FinetuneSettings {
    /// Folder of the recordings that are followed.
    pub recordings: PathBuf,
    /// Folder into which policies are published: the daemon's `policy.directory`.
    pub publish: PathBuf,
    /// Beginning of published files' names.
    pub name: String,
    /// CRC-32C of the policy's file that it began from, eight hexadecimal digits.
    pub from_crc32c: String,
    /// Transitions until the end; each is a tick of the rig.
    pub steps: u64,
    /// Updates after each transition.
    pub updates_per_tick: u64,
    /// Transitions between two published policies.
    pub publish_every_steps: u64,
    /// First transitions, in which the critics alone learn what the policy is worth.
    pub critic_warm_up_steps: u64,
    /// Transitions of the run that the policy comes from that are remembered beside the rig's, at most.
    #[serde(default)]
    pub remembered: u64,
    /// λ_T: at the start, its growth a transition, and the most.
    pub lambda_temporal: [f64; 3],
    /// Plan of what is published.
    pub plan: PublishedPlan,
    /// Seed of the critics' first weights, batches and noise.
    pub seed: u64,
}

impl FinetuneSettings {
    /// Number of sim-to-real transfer steps (paper, Table IV).
    pub const PAPER_STEPS: u64 = 102_400;
    /// λ_T^min, Δλ_T, λ_T^max (paper, Table IV).
    pub const PAPER_LAMBDA: [f64; 3] = [1.0, 3.906e-5, 3.0];
    /// The aim; one core does it with the networks that ship.
    pub const UPDATES_PER_TICK: u64 = 8;
    /// A tenth of the whole: 205 s of the rig, about what the daemon takes to try one.
    pub const PUBLISH_EVERY_STEPS: u64 = 10_240;
    /// 20 s of the rig (chosen): 8,000 updates of the critics.
    pub const CRITIC_WARM_UP_STEPS: u64 = 1_000;

    /// As many as the rig brings in the paper's transfer: at first most of what is learned from, half at its end. With a quarter of that a
    /// policy of preset `paper` moved a valve the wrong way at a sixth to three quarters of the places far from its goal.
    pub const REMEMBERED: u64 = 102_400;

    /// A name for the run, the same for whoever begins it anew from the same policy with the same settings: eight
    /// hexadecimal digits. Folders, and how long it goes on, decide nothing that it computes until there.
    pub fn run_name(&self) -> String {
        let decides =
            FinetuneSettings { recordings: PathBuf::new(), publish: PathBuf::new(), steps: 0, ..self.clone() };
        format!("{:08x}", crc32c::crc32c(format!("{decides:?}").as_bytes()))
    }

    /// λ_T of a variant at a transition: none where actions are not made smooth, which the summary and the published file say too.
    pub fn lambda_at(&self, variant: Variant, step: u64) -> f32 {
        let [start, growth, most] = self.lambda_temporal;
        if variant.smooths() { (start + growth * step as f64).min(most) as f32 } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings() -> FinetuneSettings {
        FinetuneSettings {
            recordings: PathBuf::new(),
            publish: PathBuf::new(),
            name: String::new(),
            from_crc32c: String::new(),
            steps: FinetuneSettings::PAPER_STEPS,
            updates_per_tick: 8,
            publish_every_steps: 1,
            critic_warm_up_steps: 0,
            remembered: 0,
            lambda_temporal: FinetuneSettings::PAPER_LAMBDA,
            plan: PublishedPlan::Fitted,
            seed: 1,
        }
    }

    #[test]
    fn lambda_grows_as_in_table_iv() {
        let settings = settings();
        for variant in [Variant::Caps, Variant::Both] {
            assert_eq!(settings.lambda_at(variant, 0), 1.0);
            assert!((settings.lambda_at(variant, 25_600) - 2.0).abs() < 1e-4, "half way after a quarter of the steps");
            assert_eq!(settings.lambda_at(variant, 102_400), 3.0);
        }
        for variant in [Variant::Raw, Variant::Mpobs] {
            assert_eq!([0, 25_600, 102_400].map(|step| settings.lambda_at(variant, step)), [0.0; 3]);
        }
    }

    #[test]
    fn a_run_is_named_by_what_decides_its_policy() {
        let name = settings().run_name();
        assert_eq!(name.len(), 8);
        assert_eq!(name, FinetuneSettings { recordings: "elsewhere".into(), steps: 5, ..settings() }.run_name());
        assert_ne!(name, FinetuneSettings { seed: 2, ..settings() }.run_name());
        assert_ne!(name, FinetuneSettings { from_crc32c: "0badcafe".to_owned(), ..settings() }.run_name());
    }
}
