//! `volume_change`: a chamber is larger or smaller than the rig file states, by a constant volume.
//!
//! ```text
//! V = V₀ + V_extra
//! ```
//!
//! A forgotten hose, a tank of another make, water in the bottom. It scales the rate of every change of the
//! chamber's pressure and changes nothing once pressures stand still; it is the same physics as another
//! `volume_l`, as a mechanism so that a diagnosis can name it. A volume that changes during a run is not this
//! one (`volume_compliance`, `actuator_load`).

use serde::{Deserialize, Serialize};

use super::{Form, Mechanism, Physics, Place};
use crate::rig::{Number, Rig, RigError, numbers};

/// Volume that a chamber has beyond (or short of) what is stated.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VolumeChange {
    /// V_extra in litres; negative where the chamber is smaller than stated.
    pub extra_volume_l: f64,
}

numbers!(VolumeChange {
    extra_volume_l: Number::new("L", -100.0, 100.0)
        .plausible(-1.0, 1.0)
        .starts(&[-0.02, 0.02, -0.1, 0.1])
        .hint("a value in mL?"),
});

impl Physics for VolumeChange {
    const ID: &'static str = "volume_change";
    const PLACES: &'static [Place] = &[Place::Volume];
    const SETTLED: bool = false;

    fn check(&self, rig: &Rig, component: &str, key: &str) -> Result<(), RigError> {
        let stated = rig.volumes.get(component).map_or(f64::NAN, |v| v.volume_l);
        if stated + self.extra_volume_l >= 0.02 * stated {
            return Ok(());
        }
        Err(RigError::at(
            format!("{key}.extra_volume_l"),
            format!("{} L would leave nothing of the {stated} L of `{component}`", self.extra_volume_l),
        ))
    }

    fn forms(rig: &Rig, component: &str) -> Vec<Form> {
        let none = Mechanism::VolumeChange(VolumeChange { extra_volume_l: 0.0 });
        let stated = rig.volumes.get(component).map_or(0.0, |v| v.volume_l);
        let starts = [-0.03, 0.03, -0.1, 0.1, -0.25, 0.3].map(|share| share * stated).to_vec();
        vec![Form::of("", none, &[0]).ranging(0, [-0.6 * stated, stated], starts)]
    }
}
