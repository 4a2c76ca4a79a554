//! `piston_blowby`: gas slips past the piston rings, between cylinder and crankcase.
//!
//! ```text
//! ṁ = k (P_cyl² − P_atm²)
//! ```
//!
//! for each cylinder, laminar through the ring gap, the crankcase open to the air. It blows out near the end of
//! compression and lets air in while the cylinder is under vacuum. With tight outlet valves, as on the paper's rig, it
//! is a second way out: less is delivered, less stays behind in the clearance, so the pump draws more. Pressure falls
//! and vacuum deepens together, where a leak of a chamber costs either one.

use serde::{Deserialize, Serialize};

use super::{Form, Mechanism, Physics, Place};
use crate::rig::{Number, Pump, Rig, RigError, numbers};

/// A laminar leak between each cylinder of a pump and the open air.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PistonBlowby {
    /// k of each cylinder in kg/(s Pa²).
    pub conductance_kg_per_s_pa2: f64,
}

numbers!(PistonBlowby {
    conductance_kg_per_s_pa2: Number::new("kg/(s Pa²)", 0.0, 1e-11)
        .plausible(1e-17, 1e-13)
        .starts(&[2e-16, 1e-15, 5e-15, 2e-14])
        .hint("1e-15 is a good ring"),
});

impl Physics for PistonBlowby {
    const ID: &'static str = "piston_blowby";
    const PLACES: &'static [Place] = &[Place::Pump];
    const SETTLED: bool = true;

    fn check(&self, rig: &Rig, component: &str, key: &str) -> Result<(), RigError> {
        needs_pistons(Self::ID, rig, component, key)
    }

    fn forms(rig: &Rig, component: &str) -> Vec<Form> {
        let tight = Mechanism::PistonBlowby(PistonBlowby { conductance_kg_per_s_pa2: 0.0 });
        vec![Form::of("", tight, &[0]).scaled(0, super::scale::of_blowby(rig, component))]
    }
}

/// Refuses a pump without cylinders.
pub(super) fn needs_pistons(id: &str, rig: &Rig, component: &str, key: &str) -> Result<(), RigError> {
    if matches!(rig.pumps.get(component), Some(Pump::Piston(_))) {
        return Ok(());
    }
    Err(RigError::at(
        format!("{key}.component"),
        format!("`{id}` goes on a pump of kind \"piston\"; `{component}` has no cylinders"),
    ))
}
