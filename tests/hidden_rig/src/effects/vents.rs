//! Effects around the vent valves: tubes, silencers, the throat.

use serde::{Deserialize, Serialize};

use super::{ANY, EITHER, Mechanism, Place, middle};
use crate::orifice::sonic_conductance;
use crate::rng::Draws;
use crate::run::Rig;
use crate::valve::{Muffler, Tube};

/// A tube between chamber and valve: an isothermal line with laminar and turbulent loss.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LineLoss {
    /// Flow area whose dynamic pressure is lost once over the tube (m²).
    pub area_m2: f64,
    /// Share of the loss that is laminar at 0.5 g/s.
    pub laminar_share: f64,
}

impl Mechanism for LineLoss {
    const PLACES: &'static [Place] = EITHER;
    /// Inverse areas (1/m²): from 100 mm² to 1 mm².
    const STRENGTHS: (f64, f64) = (1e4, 1e6);

    fn draw(draws: &mut Draws) -> Self {
        Self { area_m2: 1.0 / middle(Self::STRENGTHS), laminar_share: draws.between(0.05, 0.35) }
    }
    fn strength(&self) -> f64 {
        1.0 / self.area_m2
    }
    fn set_strength(&mut self, strength: f64) {
        self.area_m2 = 1.0 / strength;
    }
    fn install(&self, place: Place, rig: &mut Rig) {
        const USUAL_KG_S: f64 = 5e-4;
        let turbulent = USUAL_KG_S / (self.area_m2 * self.area_m2);
        for &c in place.channels() {
            let laminar = turbulent * self.laminar_share / (1.0 - self.laminar_share);
            rig.plant.vents[c].tube = Some(Tube { laminar, area_m2: self.area_m2 });
        }
    }
    fn note(&self) -> String {
        format!("tube to the valve like an area of {:.2} mm^2", 1e6 * self.area_m2)
    }
}

/// A silencer on the positive valve, a filter on the negative one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Exhaust {
    /// Effective area (m²).
    pub area_m2: f64,
    /// Critical ratio.
    pub critical_ratio: f64,
}

impl Mechanism for Exhaust {
    const PLACES: &'static [Place] = EITHER;
    /// Inverse areas (1/m²): from 100 mm² to 1.5 mm².
    const STRENGTHS: (f64, f64) = (1e4, 6.7e5);

    fn draw(draws: &mut Draws) -> Self {
        Self { area_m2: 1.0 / middle(Self::STRENGTHS), critical_ratio: draws.between(0.3, 0.5) }
    }
    fn strength(&self) -> f64 {
        1.0 / self.area_m2
    }
    fn set_strength(&mut self, strength: f64) {
        self.area_m2 = 1.0 / strength;
    }
    fn install(&self, place: Place, rig: &mut Rig) {
        for &c in place.channels() {
            rig.plant.vents[c].muffler =
                Some(Muffler { conductance: sonic_conductance(self.area_m2), critical_ratio: self.critical_ratio });
        }
    }
    fn note(&self) -> String {
        format!("restriction of {:.2} mm^2 between valve and atmosphere", 1e6 * self.area_m2)
    }
}

/// Vent valves that choke at a lower ratio than an ideal nozzle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Ratio {
    /// Critical ratio b of ISO 6358.
    pub critical_ratio: f64,
}

/// The ideal nozzle's.
const IDEAL: f64 = 0.5283;

impl Mechanism for Ratio {
    const PLACES: &'static [Place] = ANY;
    /// Range of the share by which it is below the ideal nozzle's.
    const STRENGTHS: (f64, f64) = (0.02, 0.45);

    fn draw(_draws: &mut Draws) -> Self {
        Self { critical_ratio: IDEAL - middle(Self::STRENGTHS) }
    }
    fn strength(&self) -> f64 {
        IDEAL - self.critical_ratio
    }
    fn set_strength(&mut self, strength: f64) {
        self.critical_ratio = IDEAL - strength;
    }
    fn install(&self, place: Place, rig: &mut Rig) {
        for &c in place.channels() {
            rig.plant.vents[c].critical_ratio = self.critical_ratio;
        }
    }
    fn note(&self) -> String {
        format!("b = {:.3}", self.critical_ratio)
    }
}
