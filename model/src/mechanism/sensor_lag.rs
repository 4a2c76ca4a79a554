//! `sensor_lag`: the reading follows the pressure with a first-order lag.
//!
//! ```text
//! τ ẏ = P − y
//! ```
//!
//! The sensor's own filter, or a thin hose to it. It changes what is read and nothing else: the other
//! chamber never hears of it, which tells it from a lag of the valve.

use serde::{Deserialize, Serialize};

use super::{Form, Mechanism, Physics, Place};
use crate::rig::{Number, Rig, numbers};

/// A first-order lag of a reading behind the pressure.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorLag {
    /// Time constant τ in ms.
    pub time_constant_ms: f64,
}

numbers!(SensorLag {
    time_constant_ms: Number::new("ms", 0.01, 10_000.0).plausible(1.0, 500.0).starts(&[8.0, 25.0, 80.0, 250.0]),
});

impl Physics for SensorLag {
    const ID: &'static str = "sensor_lag";
    const PLACES: &'static [Place] = &[Place::Sensor];
    const SETTLED: bool = false;

    fn forms(_rig: &Rig, _component: &str) -> Vec<Form> {
        vec![Form::of("", Mechanism::SensorLag(SensorLag { time_constant_ms: 0.01 }), &[0])]
    }
}

impl SensorLag {
    /// Share of the distance that the reading covers in one integration step, 1 − e^(−h/τ).
    pub(crate) fn approach(&self, step_s: f64) -> f64 {
        -(-step_s / (self.time_constant_ms * 1e-3)).exp_m1()
    }
}
