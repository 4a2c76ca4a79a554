//! `sensor_drift`: a reading wanders off as time goes by.
//!
//! ```text
//! y = P + r t                              for ever, or
//! y = P + r τ (1 − e^(−t/τ))               coming to rest
//! ```
//!
//! from the start of the run: a sensor's bridge and its electronics warming up. It begins with rate `r` either way;
//! with a time constant it ends `r τ` off. Nothing in the rig moves with it, so the other channel does not follow,
//! which tells it from a slow change of a valve.

use serde::{Deserialize, Serialize};

use super::{Form, Mechanism, Physics, Place};
use crate::rig::{Number, Rig, numbers};

/// A bias that grows with time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorDrift {
    /// r: rate at the start in kPa/min.
    pub rate_kpa_per_min: f64,
    /// τ: time constant in s with which it comes to rest; absent (or 0) means it goes on for ever.
    #[serde(default)]
    pub time_constant_s: f64,
}

numbers!(SensorDrift {
    rate_kpa_per_min: Number::new("kPa/min", -1000.0, 1000.0)
        .plausible(-20.0, 20.0)
        .starts(&[0.1, -0.1, 0.4, -0.4, 1.5, -1.5, 5.0, -5.0]),
    time_constant_s: Number::new("s", 0.0, 1e6).plausible(5.0, 3600.0).starts(&[60.0, 20.0, 300.0]).optional(),
});

impl Physics for SensorDrift {
    const ID: &'static str = "sensor_drift";
    const PLACES: &'static [Place] = &[Place::Sensor];
    const SETTLED: bool = false;

    fn forms(rig: &Rig, component: &str) -> Vec<Form> {
        let none = |time_constant_s| Mechanism::SensorDrift(SensorDrift { rate_kpa_per_min: 0.0, time_constant_s });
        let scale = super::scale::of_sensor(rig, component);
        let [steady, relaxing] = [Form::of("steady", none(0.0), &[0]), Form::of("relaxing", none(60.0), &[0, 1])];
        vec![steady.scaled(0, scale), relaxing.scaled(0, scale)]
    }
}

impl SensorDrift {
    /// The rate in kPa/s and 1/τ in 1/s.
    pub(crate) fn course(&self) -> (f64, f64) {
        let per_s = if self.time_constant_s > 0.0 { 1.0 / self.time_constant_s } else { 0.0 };
        (self.rate_kpa_per_min / 60.0, per_s)
    }
}
