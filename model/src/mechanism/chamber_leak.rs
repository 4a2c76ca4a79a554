//! `chamber_leak`: gas passes between a chamber and the open air through a crack.
//!
//! Isothermal laminar flow through a narrow gap (compressible Poiseuille; ISO 6358 leaves it out):
//!
//! ```text
//! ṁ = k (P² − P_atm²)
//! ```
//!
//! in kg/s for `k` in kg/(s Pa²). While a valve is open a leak looks like a shift of the valve's spring
//! term; only a chamber shut in tells them apart. 1e-15 kg/(s Pa²) leaks about 3e-5 kg/s at 100 kPa gauge.

use serde::{Deserialize, Serialize};

use crate::rig::{RigError, within};

/// A laminar leak between a chamber and the atmosphere.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChamberLeak {
    /// k in kg/(s Pa²).
    pub conductance_kg_per_s_pa2: f64,
}

impl ChamberLeak {
    pub(super) fn check(&self, key: &str) -> Result<(), RigError> {
        within(
            &format!("{key}.conductance_kg_per_s_pa2"),
            self.conductance_kg_per_s_pa2,
            0.0,
            1e-12,
            "kg/(s Pa²)",
            "1e-15 is a small leak",
        )
    }
}
