//! `sensor_lag`: the reading follows the pressure with a lag of the first order, or with two in series.
//!
//! ```text
//! τ ẋ = P − x,        τ₂ ẏ = x − y        (y = x where there is no τ₂)
//! ```
//!
//! The sensor's own filter, or a thin hose to it; with a snubber in the hose the small room behind it fills as well, and an
//! electronic filter has its time on top. It changes what is read and nothing else: the other chamber never hears of it, which
//! tells it from a lag of the valve.

use serde::{Deserialize, Serialize};

use super::{Form, Mechanism, Physics, Place};
use crate::rig::{Number, Rig, numbers};

/// A lag of a reading behind the pressure.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorLag {
    /// Time constant τ in ms.
    pub time_constant_ms: f64,
    /// Time constant τ₂ of a second lag behind it, in ms; absent is none. Which is first makes no difference.
    #[serde(default, skip_serializing_if = "is_none")]
    pub second_time_constant_ms: f64,
}

fn is_none(time_constant_ms: &f64) -> bool {
    *time_constant_ms == 0.0
}

numbers!(SensorLag {
    time_constant_ms: Number::new("ms", 0.01, 10_000.0).plausible(1.0, 2000.0).starts(&[8.0, 25.0, 80.0, 250.0]),
    second_time_constant_ms: Number::new("ms", 0.0, 10_000.0).plausible(1.0, 500.0).starts(&[8.0, 25.0]).optional(),
});

impl Physics for SensorLag {
    const ID: &'static str = "sensor_lag";
    const PLACES: &'static [Place] = &[Place::Sensor];
    const SETTLED: bool = false;

    fn forms(_rig: &Rig, _component: &str) -> Vec<Form> {
        let lag = Mechanism::SensorLag(SensorLag { time_constant_ms: 0.01, second_time_constant_ms: 0.0 });
        vec![Form::of("", lag.clone(), &[0]), Form::of("two", lag, &[0, 1]).refinement()]
    }
}

impl SensorLag {
    /// Time constants of both lags in s; 0 where there is no second one.
    pub(crate) fn time_constants_s(&self) -> [f64; 2] {
        [1e-3 * self.time_constant_ms, 1e-3 * self.second_time_constant_ms]
    }
}
