//! `pump_speed`: a pump turns at another speed than the rig file states.
//!
//! ```text
//! ω = ω₀ (1 + s a(t)),      a = 1,  or with `time_constant_s` τ   a = 1 − exp(−t/τ)
//! ```
//!
//! with `s` in percent: the slip of an asynchronous motor (2 … 5 % slow), a supply that is not at its rated
//! voltage; with τ a motor that warms from the start of a run, whose grease thins and whose winding's resistance grows (both as
//! a first-order lag). A shift of the pump's flow alone is hard to tell from other check valves; the ripple tells: at the
//! stated 3000 rev/min one revolution is one tick of 20 ms and the ripple stands still in the samples, at
//! 2950 it beats with 1.7 Hz.

use serde::{Deserialize, Serialize};

use super::{Form, Mechanism, Physics, Place, is_zero};
use crate::rig::{Number, Pump, Rig, RigError, numbers};

/// Another speed (or flow, for a pump given by its flow) than stated.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PumpSpeed {
    /// s in percent of the stated speed; negative is slower.
    pub change_percent: f64,
    /// τ in s, with which the change comes from the start of a run on; absent (or 0) means it was there all the time.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub time_constant_s: f64,
}

numbers!(PumpSpeed {
    change_percent: Number::new("%", -90.0, 200.0)
        .plausible(-15.0, 15.0)
        .starts(&[-0.3, 0.3, -1.0, 1.0, -3.0, 3.0, -8.0, 8.0])
        .hint("in percent of the stated speed, negative for slower"),
    time_constant_s: Number::new("s", 0.0, 1e6).plausible(2.0, 600.0).starts(&[50.0]).optional(),
});

impl Physics for PumpSpeed {
    const ID: &'static str = "pump_speed";
    const PLACES: &'static [Place] = &[Place::Pump];
    const SETTLED: bool = true;

    fn check(&self, rig: &Rig, component: &str, key: &str) -> Result<(), RigError> {
        match rig.pumps.get(component) {
            Some(Pump::Flow(_)) if self.time_constant_s > 0.0 => Err(RigError::at(
                format!("{key}.time_constant_s"),
                "a pump given by its flow does not warm; leave it out, or describe the pump by its pistons".to_owned(),
            )),
            _ => Ok(()),
        }
    }

    fn forms(_rig: &Rig, _component: &str) -> Vec<Form> {
        let none = PumpSpeed { change_percent: 0.0, time_constant_s: 0.0 };
        vec![Form::of("", Mechanism::PumpSpeed(none), &[0])]
    }
}

impl PumpSpeed {
    /// Factor of the stated speed, in the end.
    pub(crate) fn factor(&self) -> f64 {
        1.0 + 0.01 * self.change_percent
    }

    /// One over τ in 1/s, where the change comes during a run.
    pub(crate) fn approach_rate(&self) -> Option<f64> {
        (self.time_constant_s > 0.0).then(|| 1.0 / self.time_constant_s)
    }
}
