//! `pump_speed`: a pump turns at another speed than the rig file states.
//!
//! ```text
//! ω = ω₀ (1 + s)
//! ```
//!
//! with `s` in percent: the slip of an asynchronous motor (2 … 5 % slow), a supply that is not at its rated
//! voltage. A shift of the pump's flow alone is hard to tell from other check valves; the ripple tells: at the
//! stated 3000 rev/min one revolution is one tick of 20 ms and the ripple stands still in the samples, at
//! 2950 it beats with 1.7 Hz.

use serde::{Deserialize, Serialize};

use super::{Form, Mechanism, Physics, Place};
use crate::rig::{Number, Rig, numbers};

/// Another speed (or flow, for a pump given by its flow) than stated.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PumpSpeed {
    /// s in percent of the stated speed; negative is slower.
    pub change_percent: f64,
}

numbers!(PumpSpeed {
    change_percent: Number::new("%", -90.0, 200.0)
        .plausible(-15.0, 15.0)
        .starts(&[-0.3, 0.3, -1.0, 1.0, -3.0, 3.0, -8.0, 8.0])
        .hint("in percent of the stated speed, negative for slower"),
});

impl Physics for PumpSpeed {
    const ID: &'static str = "pump_speed";
    const PLACES: &'static [Place] = &[Place::Pump];
    const SETTLED: bool = true;

    fn forms(_rig: &Rig, _component: &str) -> Vec<Form> {
        vec![Form::of("", Mechanism::PumpSpeed(PumpSpeed { change_percent: 0.0 }), &[0])]
    }
}

impl PumpSpeed {
    /// What the stated speed is multiplied by.
    pub(crate) fn factor(&self) -> f64 {
        1.0 + 0.01 * self.change_percent
    }
}
