//! `sensor_gain`: a reading is off by a factor.
//!
//! ```text
//! y = g P        (gauge)
//! ```
//!
//! Span error of the sensor, a wrong range in the converter's settings. Class 1 sensors stay within ±1 %. It is
//! nothing at the atmosphere and grows with gauge pressure, unlike a bias.

use serde::{Deserialize, Serialize};

use super::{Form, Mechanism, Physics, Place};
use crate::rig::{Number, Rig, numbers};

/// A factor on a reading.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorGain {
    /// g, a bare number; 1 is right.
    pub gain: f64,
}

numbers!(SensorGain {
    gain: Number::new("", 0.01, 100.0)
        .plausible(0.9, 1.1)
        .starts(&[0.995, 1.005, 0.98, 1.02, 0.95, 1.05])
        .hint("1 reads right"),
});

impl Physics for SensorGain {
    const ID: &'static str = "sensor_gain";
    const PLACES: &'static [Place] = &[Place::Sensor];
    const SETTLED: bool = false;

    fn forms(_rig: &Rig, _component: &str) -> Vec<Form> {
        vec![Form::of("", Mechanism::SensorGain(SensorGain { gain: 1.0 }), &[0])]
    }
}
