//! `check_valve_cracking`: a pump's check valves open only against a spring.
//!
//! ```text
//! ṁ = C P_up/√(R T) Φ(1 − d),     d = (P_up − P_down − p_c)/P_up,     shut for d ≤ 0
//! ```
//!
//! the paper's (3) with the cracking pressure `p_c` taken from the difference that drives the flow: a spring that
//! gives way as far as it must. With `wide_open_share` s the valve lifts against its stop instead, and the whole
//! difference then drives the flow:
//!
//! ```text
//! ṁ = (3 y² − 2 y³) C P_up/√(R T) Φ(1 − P_down/P_up),     y = (P_up − P_down − p_c)/(s p_c), within 0 … 1
//! ```
//!
//! as reeds and spring-loaded discs do (Costagliola's valve without its inertia). Reeds crack at 0.2 … 5 kPa,
//! spring-loaded balls at up to 20 kPa. On the inlet side it sets a floor to the vacuum and costs most at low
//! pressure; on the outlet side it is a small part of what the gas is compressed to anyway.

use serde::{Deserialize, Serialize};

use super::piston_blowby::needs_pistons;
use super::{Form, Mechanism, Physics, Place};
use crate::rig::{Number, Rig, RigError, numbers, within};

/// Cracking pressures of a pump's check valves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CheckValveCracking {
    /// p_c of the inlet valves in kPa; absent means none.
    #[serde(default)]
    pub inlet_kpa: f64,
    /// p_c of the outlet valves in kPa; absent means none.
    #[serde(default)]
    pub outlet_kpa: f64,
    /// s, the share of the cracking pressure beyond it at which a valve is wide open; absent for a spring that takes its
    /// part of the difference throughout.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wide_open_share: Option<f64>,
}

/// s of the valves that a search proposes: reeds lie at their stop soon after they have left the seat.
const USUAL_SHARE: f64 = 0.1;

const PRESSURE: Number =
    Number::new("kPa", 0.0, 200.0).plausible(0.0, 20.0).hint("a difference, not an absolute pressure").optional();

numbers!(CheckValveCracking {
    inlet_kpa: PRESSURE.starts(&[0.3, 1.0, 3.0]),
    outlet_kpa: PRESSURE.starts(&[0.5, 2.0, 8.0]),
});

impl Physics for CheckValveCracking {
    const ID: &'static str = "check_valve_cracking";
    const PLACES: &'static [Place] = &[Place::Pump];
    const SETTLED: bool = true;

    fn check(&self, rig: &Rig, component: &str, key: &str) -> Result<(), RigError> {
        needs_pistons(Self::ID, rig, component, key)?;
        self.wide_open_share
            .map_or(Ok(()), |share| within(&format!("{key}.wide_open_share"), share, 0.0, 10.0, "", "a share of p_c"))
    }

    fn forms(rig: &Rig, component: &str) -> Vec<Form> {
        if needs_pistons(Self::ID, rig, component, "").is_err() {
            return Vec::new();
        }
        let none = Mechanism::CheckValveCracking(CheckValveCracking {
            inlet_kpa: 0.0,
            outlet_kpa: 0.0,
            wide_open_share: Some(USUAL_SHARE),
        });
        vec![
            Form::of("both", none.clone(), &[0, 1]),
            Form::of("inlet", none.clone(), &[0]),
            Form::of("outlet", none, &[1]),
        ]
    }
}
