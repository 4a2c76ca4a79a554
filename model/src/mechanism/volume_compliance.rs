//! `volume_compliance`: a chamber grows with its pressure; hoses balloon.
//!
//! ```text
//! V = V₀ + c (P − P_atm),      Ṗ (V + c P) = R T Σṁ
//! ```
//!
//! with `V₀` the stated volume (at atmospheric pressure) and `c` in mL/kPa. The growing wall takes `P V̇` out of
//! the balance, which is the second `c P`. Polyurethane hose gives 0.1 … 0.5 % of its volume per kPa, a thin
//! plastic bottle as much; a steel tank nothing. Slower response at high pressure than at low tells it from a
//! larger volume.

use serde::{Deserialize, Serialize};

use super::{Form, Mechanism, Physics, Place};
use crate::rig::{Number, Rig, RigError, numbers};

/// A chamber's growth with pressure, on top of what its volume states.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VolumeCompliance {
    /// c in mL/kPa.
    pub compliance_ml_per_kpa: f64,
}

numbers!(VolumeCompliance {
    compliance_ml_per_kpa: Number::new("mL/kPa", 0.0, 1e4)
        .plausible(0.0, 10.0)
        .starts(&[0.1, 0.5, 1.5])
        .hint("growth of the whole chamber for each kPa"),
});

impl Physics for VolumeCompliance {
    const ID: &'static str = "volume_compliance";
    const PLACES: &'static [Place] = &[Place::Volume];
    const SETTLED: bool = false;

    fn check(&self, rig: &Rig, component: &str, key: &str) -> Result<(), RigError> {
        let volume = rig.volumes.get(component).map_or(f64::NAN, |v| 1e3 * v.volume_l);
        let most = volume / rig.atmosphere.pressure_kpa_abs;
        if self.compliance_ml_per_kpa < most {
            return Ok(());
        }
        Err(RigError::at(
            format!("{key}.compliance_ml_per_kpa"),
            format!(
                "{} mL/kPa would leave nothing of the {volume} mL of `{component}` in a vacuum; less than {most:.3} mL/kPa",
                self.compliance_ml_per_kpa
            ),
        ))
    }

    fn forms(rig: &Rig, component: &str) -> Vec<Form> {
        let rigid = Mechanism::VolumeCompliance(VolumeCompliance { compliance_ml_per_kpa: 0.0 });
        let ml = rig.volumes.get(component).map_or(0.0, |v| 1e3 * v.volume_l);
        // 1, 5 and 20 % of the volume per bar; nothing keeps its shape and gives half of it.
        let starts = [1e-4, 5e-4, 2e-3].map(|share| share * ml).to_vec();
        vec![Form::of("", rigid, &[0]).ranging(0, [0.0, 5e-3 * ml], starts)]
    }
}
