//! `supply_sag`: the drivers' supply gives way under the current of all valves together.
//!
//! ```text
//! yᵢ = uᵢ (1 − k Σⱼ uⱼ)
//! ```
//!
//! Mean coil current goes with duty, so a supply (or its wiring) of resistance `r` that feeds coils of
//! resistance `R_c` loses the share `k = r/R_c` of its voltage per unit of total duty; 0 … 0.1 for thin wires.
//! To first order: that a sagging supply also draws less is left out. It belongs to the rig, not to one
//! valve: `component = "rig"`. What tells it apart is that one channel's opening depends on the other's duty
//! at once, without any gas in between.

use serde::{Deserialize, Serialize};

use super::{Form, Mechanism, Physics, Place};
use crate::rig::{Number, Rig, RigError, numbers};

/// A supply that sags under the valves' current.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SupplySag {
    /// k: share of the voltage lost per unit of total duty (0 … 0.5).
    pub loss_per_duty: f64,
}

numbers!(SupplySag {
    loss_per_duty: Number::new("1/duty", 0.0, 0.5)
        .plausible(0.0, 0.15)
        .starts(&[0.01, 0.03, 0.08])
        .hint("share of the voltage lost per unit of total duty"),
});

impl Physics for SupplySag {
    const ID: &'static str = "supply_sag";
    const PLACES: &'static [Place] = &[Place::Rig];
    const SETTLED: bool = true;

    fn check(&self, rig: &Rig, _component: &str, key: &str) -> Result<(), RigError> {
        if rig.valves.is_empty() {
            return Err(RigError::at(key, "the rig has no valve whose supply could sag; leave it out"));
        }
        Ok(())
    }

    fn forms(rig: &Rig, _component: &str) -> Vec<Form> {
        // With a single valve it is a curvature of that valve's force.
        if rig.valves.len() < 2 {
            return Vec::new();
        }
        vec![Form::of("", Mechanism::SupplySag(SupplySag { loss_per_duty: 0.0 }), &[0])]
    }
}
