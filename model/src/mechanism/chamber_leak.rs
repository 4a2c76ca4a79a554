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

use super::{Form, Mechanism, Physics, Place};
use crate::rig::{Number, Rig, numbers};

/// What all leaks are measured by.
pub(super) const CONDUCTANCE: Number = Number::new("kg/(s Pa²)", 0.0, 1e-12)
    .plausible(1e-17, 1e-13)
    .starts(&[1e-16, 5e-16, 2e-15, 1e-14])
    .hint("1e-15 is a small leak");

/// A laminar leak between a chamber and the atmosphere.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChamberLeak {
    /// k in kg/(s Pa²).
    pub conductance_kg_per_s_pa2: f64,
}

numbers!(ChamberLeak { conductance_kg_per_s_pa2: CONDUCTANCE });

impl Physics for ChamberLeak {
    const ID: &'static str = "chamber_leak";
    const PLACES: &'static [Place] = &[Place::Volume];
    const SETTLED: bool = true;

    fn forms(_rig: &Rig, _component: &str) -> Vec<Form> {
        vec![Form::of("", Mechanism::ChamberLeak(ChamberLeak { conductance_kg_per_s_pa2: 0.0 }), &[0])]
    }
}
