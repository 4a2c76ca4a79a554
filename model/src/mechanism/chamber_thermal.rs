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

use super::{Form, Mechanism, Physics, Place};
use crate::rig::{Number, Rig, numbers};

/// An energy balance for the gas in a chamber.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChamberThermal {
    /// G: heat passed to the wall per kelvin, in W/K.
    pub wall_conductance_w_per_k: f64,
}

numbers!(ChamberThermal {
    // Above, heat leaves faster than the integrator's step can follow.
    wall_conductance_w_per_k: Number::new("W/K", 0.0, 1000.0)
        .plausible(0.02, 50.0)
        .starts(&[10.0, 3.0, 1.0, 0.3])
        .acts_with_power(-1.0)
        .hint("leave the mechanism out for an isothermal chamber"),
});

impl Physics for ChamberThermal {
    const ID: &'static str = "chamber_thermal";
    const PLACES: &'static [Place] = &[Place::Volume];
    const SETTLED: bool = false;

    fn forms(rig: &Rig, component: &str) -> Vec<Form> {
        let isothermal = Mechanism::ChamberThermal(ChamberThermal { wall_conductance_w_per_k: 1000.0 });
        vec![Form::of("", isothermal, &[0]).scaled(0, super::scale::of_wall(rig, component))]
    }
}
