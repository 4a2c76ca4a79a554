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

/// Conductance by which all leaks are measured.
pub(super) const CONDUCTANCE: Number = Number::new("kg/(s Pa²)", 0.0, 1e-9)
    .plausible(1e-17, 1e-13)
    .starts(&[1e-16, 5e-16, 2e-15, 1e-14])
    .hint("1e-15 is a small leak");

/// Weaker first magnitudes where nothing but the leak empties a chamber, and how much further its range goes: a
/// pressure-decay test shows what takes hours.
const WEAK_STARTS: [f64; 2] = [1e-18, 1e-17];
const WEAKER: f64 = 1e-4;

/// The conductance's range and first magnitudes, scaled to a chamber ([`super::scale`]).
pub(super) fn scaled(rig: &Rig, volume: &str) -> ([f64; 2], Vec<f64>) {
    let scale = super::scale::of_leak(rig, volume);
    let [low, high] = CONDUCTANCE.plausible;
    let starts = CONDUCTANCE.starts.iter().map(|start| scale * start);
    if super::scale::is_closed(rig, volume) {
        let weak = WEAK_STARTS.iter().map(|start| scale * start);
        ([WEAKER * scale * low, scale * high], weak.chain(starts).collect())
    } else {
        ([scale * low, scale * high], starts.collect())
    }
}

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

    fn forms(rig: &Rig, component: &str) -> Vec<Form> {
        let (range, starts) = scaled(rig, component);
        let tight = Mechanism::ChamberLeak(ChamberLeak { conductance_kg_per_s_pa2: 0.0 });
        vec![Form::of("", tight, &[0]).ranging(0, range, starts)]
    }
}
