//! `sensor_bias`: a reading is off by a constant.
//!
//! ```text
//! y = P + b
//! ```
//!
//! Zero offset of the amplifier, a converter's reference, or a barometer that is not the one stated. Data sheets of
//! the sensors' class allow ±1 % of full scale. With the port open to the air it is read off directly; while the
//! pump runs, valves' parameters take it in.

use serde::{Deserialize, Serialize};

use super::{Form, Mechanism, Physics, Place};
use crate::rig::{Number, Rig, numbers};

/// A constant offset of a reading.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorBias {
    /// b in kPa, added to the reading.
    pub bias_kpa: f64,
}

numbers!(SensorBias {
    bias_kpa: Number::new("kPa", -1000.0, 1000.0).plausible(-5.0, 5.0).starts(&[0.2, -0.2, 1.0, -1.0, 3.0, -3.0]),
});

impl Physics for SensorBias {
    const ID: &'static str = "sensor_bias";
    const PLACES: &'static [Place] = &[Place::Sensor];
    const SETTLED: bool = false;

    fn forms(rig: &Rig, component: &str) -> Vec<Form> {
        let none = Mechanism::SensorBias(SensorBias { bias_kpa: 0.0 });
        vec![Form::of("", none, &[0]).scaled(0, super::scale::of_sensor(rig, component))]
    }
}
