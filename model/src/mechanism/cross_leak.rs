//! `cross_leak`: gas passes from one chamber straight into another.
//!
//! ```text
//! ṁ = k (P₁² − P₂²)
//! ```
//!
//! The same narrow gap as `chamber_leak`, through a wall that two chambers share or a manifold's gasket. What
//! one loses the other gains, which tells it from two leaks; a pump that lets gas slip back through shut
//! check valves looks the same from outside.

use serde::{Deserialize, Serialize};

use super::{Form, Mechanism, Physics, Place};
use crate::rig::{Rig, RigError, names, numbers};

/// A laminar leak between two chambers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CrossLeak {
    /// The chamber at the other end.
    pub to: String,
    /// k in kg/(s Pa²).
    pub conductance_kg_per_s_pa2: f64,
}

numbers!(CrossLeak { conductance_kg_per_s_pa2: super::chamber_leak::CONDUCTANCE });

impl Physics for CrossLeak {
    const ID: &'static str = "cross_leak";
    const PLACES: &'static [Place] = &[Place::Volume];
    const SETTLED: bool = true;

    fn check(&self, rig: &Rig, component: &str, key: &str) -> Result<(), RigError> {
        if self.to == component || !rig.volumes.contains_key(&self.to) {
            return Err(RigError::at(
                format!("{key}.to"),
                format!(
                    "`{}` is no other volume than `{component}`; there are {}",
                    self.to,
                    names(rig.volumes.keys().filter(|name| *name != component))
                ),
            ));
        }
        Ok(())
    }

    fn forms(rig: &Rig, component: &str) -> Vec<Form> {
        // Each pair once, at the chamber that the file names first.
        let others = rig.volumes.keys().skip_while(|name| *name != component).skip(1);
        others
            .map(|to| {
                let tight = CrossLeak { to: to.clone(), conductance_kg_per_s_pa2: 0.0 };
                let (range, starts) = super::chamber_leak::scaled(rig, component);
                Form::of("", Mechanism::CrossLeak(tight), &[0]).ranging(0, range, starts)
            })
            .collect()
    }
}
