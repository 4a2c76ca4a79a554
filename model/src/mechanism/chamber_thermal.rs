//! `chamber_thermal`: the gas in a chamber warms when compressed and cools through the wall.
//!
//! The first law for an open volume of ideal gas, instead of the isothermal balance of the paper's (6):
//!
//! ```text
//! Ṗ (V + κ P V') = κ R (Σ ṁ_in T_in − Σ ṁ_out T) + (κ − 1) G (T_wall − T)
//! Ṫ = T (Ṗ/P + V̇/V − ṁ R T/(P V))
//! ```
//!
//! with `V' = dV/dP` (zero for a rigid chamber) and the wall at the chamber's stated temperature.
//! `G → ∞` returns the isothermal chamber, `G = 0` the adiabatic one. Natural convection in a tank of
//! half a litre gives `G` of 0.3 … 3 W/K. Signature: overshoot after a fast change, then relaxation.

use serde::{Deserialize, Serialize};

use crate::rig::{RigError, within};

/// An energy balance for the gas in a chamber.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChamberThermal {
    /// G: heat passed to the wall per kelvin, in W/K.
    pub wall_conductance_w_per_k: f64,
}

impl ChamberThermal {
    pub(super) fn check(&self, key: &str) -> Result<(), RigError> {
        // Above, heat leaves faster than the integrator's step can follow.
        within(
            &format!("{key}.wall_conductance_w_per_k"),
            self.wall_conductance_w_per_k,
            0.0,
            1000.0,
            "W/K",
            "leave the mechanism out for an isothermal chamber",
        )
    }
}
