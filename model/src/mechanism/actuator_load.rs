//! `actuator_load`: a hyperbaric vacuum muscle that lifts a weight hangs on both chambers.
//!
//! The muscle (Coutinho et al., *Adv. Intell. Syst.* 5, 2022, 2200090) is a bellows under vacuum inside a shell under
//! pressure: contracting by `x` it squeezes `A x` out of the inner space, which belongs to the negative chamber, and
//! gives `A x` to the outer one, which belongs to the positive. By virtual work its pull is `A (P_pos − P_neg)`. A
//! weight and the bellows' own stiffness hold against it:
//!
//! ```text
//! x_eq = (A (P_pos − P_neg) − m g)/k          within 0 … stroke
//! τ ẋ = x_eq − x
//! V_pos = V₀ + A x,    V_neg = V₀ − A x,    d(P V)/dt = R T Σṁ   (with P V̇ in the balance)
//! ```
//!
//! Both stated volumes are those with the muscle hanging long (`x = 0`). The paper gives no numbers for its muscle.
//! Assumed: 20 kg is what it cannot move at the paper's references (90 and −72 kPa, 162 kPa apart), so
//! `A = 196 N/162 kPa = 12.1 cm²`; without a load it just contracts fully there, 60 mm, so `k = 3.3 N/mm`; the weight
//! follows within 80 ms. Between the extremes it moves 73 mL from one chamber to the other, a tenth of the positive and
//! a fifth of the negative one. Friction, the bellows' change of area and the weight's own swing are left out.
//!
//! It acts while something changes: a muscle at rest moves no gas.

use serde::{Deserialize, Serialize};

use super::{Form, Physics, Place};
use crate::rig::{Number, Rig, RigError, names, numbers};

/// A muscle between two chambers that lifts a weight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActuatorLoad {
    /// The chamber that the inner space belongs to; the mechanism's component is the other.
    pub vacuum: String,
    /// m: the weight's mass in kg.
    pub payload_kg: f64,
    /// A: effective area in cm².
    #[serde(default = "area")]
    pub area_cm2: f64,
    /// k: stiffness against contraction in N/mm.
    #[serde(default = "stiffness")]
    pub stiffness_n_per_mm: f64,
    /// The longest contraction in mm.
    #[serde(default = "stroke")]
    pub stroke_mm: f64,
    /// τ: time constant of the motion in ms.
    #[serde(default = "time_constant")]
    pub time_constant_ms: f64,
}

fn area() -> f64 {
    12.1
}

fn stiffness() -> f64 {
    3.3
}

fn stroke() -> f64 {
    60.0
}

fn time_constant() -> f64 {
    80.0
}

numbers!(ActuatorLoad {
    payload_kg: Number::new("kg", 0.0, 1000.0).plausible(0.0, 25.0).hint("the weight's mass"),
    area_cm2: Number::new("cm²", 1e-3, 1e4).plausible(1.0, 50.0),
    stiffness_n_per_mm: Number::new("N/mm", 1e-3, 1e5).plausible(0.3, 30.0),
    stroke_mm: Number::new("mm", 0.01, 1e4).plausible(5.0, 200.0),
    // Below, the weight would move within a step of the integrator.
    time_constant_ms: Number::new("ms", 1.0, 1e5).plausible(20.0, 500.0),
});

impl Physics for ActuatorLoad {
    const ID: &'static str = "actuator_load";
    const PLACES: &'static [Place] = &[Place::Volume];
    const SETTLED: bool = false;

    fn check(&self, rig: &Rig, component: &str, key: &str) -> Result<(), RigError> {
        let Some(vacuum) = rig.volumes.get(&self.vacuum).filter(|_| self.vacuum != component) else {
            return Err(RigError::at(
                format!("{key}.vacuum"),
                format!(
                    "`{}` is no other volume than `{component}`; there are {}",
                    self.vacuum,
                    names(rig.volumes.keys().filter(|name| *name != component))
                ),
            ));
        };
        let swept_l = self.area_cm2 * self.stroke_mm * 1e-4;
        if swept_l <= 0.9 * vacuum.volume_l {
            return Ok(());
        }
        Err(RigError::at(
            format!("{key}.stroke_mm"),
            format!("area times stroke is {swept_l} L of the {} L of `{}`; 90 % at most", vacuum.volume_l, self.vacuum),
        ))
    }

    /// None: one knows whether a muscle is attached.
    fn forms(_rig: &Rig, _component: &str) -> Vec<Form> {
        Vec::new()
    }
}
