//! `volume_change`: a chamber is larger or smaller than the rig file states, from the start or from some time on.
//!
//! ```text
//! V = V₀ + V_extra s(t),      Ṗ V = R T Σṁ + (P_brought − P) V̇
//! ```
//!
//! A forgotten hose, a tank of another make, water in the bottom; with `begins_s` one that joins (or leaves) during the
//! run, within half a second (`s` goes from 0 to 1): a cock that is opened, an actuator that is switched over. From the
//! start, it scales the rate of every change of the chamber's pressure and changes nothing once pressures stand still:
//! the same physics as another `volume_l`, as a mechanism so that a diagnosis can name it. What comes later brings its
//! gas, of pressure `P_brought`: none where a wall gives way, air of the room where a vessel is connected. A volume that
//! follows the pressures is not this one (`volume_compliance`, `actuator_load`).

use serde::{Deserialize, Serialize};

use super::{Form, Mechanism, Physics, Place, is_zero};
use crate::rig::{Number, Rig, RigError, numbers};

/// Volume that a chamber has beyond (or short of) what is stated.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VolumeChange {
    /// V_extra in litres; negative where the chamber is smaller than stated.
    pub extra_volume_l: f64,
    /// When it begins to join, in s after the start of a run; absent (or 0) means it was there all the time.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub begins_s: f64,
    /// Absolute pressure of the gas that it brings in kPa, if it comes later; 0 for a wall that gives way.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub brings_kpa_abs: f64,
}

numbers!(VolumeChange {
    extra_volume_l: Number::new("L", -100.0, 100.0)
        .plausible(-1.0, 1.0)
        .starts(&[-0.02, 0.02, -0.1, 0.1])
        .hint("a value in mL?"),
    begins_s: Number::new("s", 0.0, 1e6).plausible(0.5, 600.0).starts(&[2.0, 20.0]).optional(),
    brings_kpa_abs: Number::new("kPa", 0.0, 1000.0).plausible(0.0, 300.0).starts(&[0.0]).hint("absolute").optional(),
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
        let none =
            |begins_s| Mechanism::VolumeChange(VolumeChange { extra_volume_l: 0.0, begins_s, brings_kpa_abs: 0.0 });
        let stated = rig.volumes.get(component).map_or(0.0, |v| v.volume_l);
        let range = [-0.6 * stated, stated];
        let starts = [-0.03, 0.03, -0.1, 0.1, -0.25, 0.3].map(|share| share * stated).to_vec();
        let later = [0.1, -0.1, 0.4].map(|share| share * stated).to_vec();
        vec![
            Form::of("", none(0.0), &[0]).ranging(0, range, starts),
            Form::of("later", none(10.0), &[0, 1]).ranging(0, range, later),
        ]
    }
}

impl VolumeChange {
    /// Tells whether it joins during a run.
    pub(crate) fn is_later(&self) -> bool {
        self.begins_s > 0.0
    }
}
