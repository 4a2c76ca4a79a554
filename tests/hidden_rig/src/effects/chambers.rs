//! Effects of the chambers: leaks, heat, volumes.

use serde::{Deserialize, Serialize};

use super::{EITHER, Mechanism, POSITIVE_OR_BOTH, Place, SHARED, middle};
use crate::chamber::VolumeStep;
use crate::gas::GAS_CONSTANT;
use crate::orifice::sonic_conductance;
use crate::rng::Draws;
use crate::run::Rig;

/// Laminar conductance (kg/(s Pa²)) that passes about as much as a sharp hole of that area at this rig's pressures.
///
/// ```text
/// k = 0.685 A / (√(R · 293 K) · 200 kPa)
/// ```
pub fn laminar_like(area_m2: f64) -> f64 {
    0.685 * area_m2 / ((GAS_CONSTANT * 293.15).sqrt() * 200e3)
}

/// Law by which a leak flows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LeakLaw {
    /// A long gap: `k (p₁² − p₂²)`.
    Laminar,
    /// A hole: ISO 6358 with b = 0.4.
    Sharp,
}

/// A leak between a chamber and the atmosphere.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ToAtmosphere {
    /// Effective area of a hole that passes as much (m²).
    pub area_m2: f64,
    /// Law by which it flows.
    pub law: LeakLaw,
}

impl Mechanism for ToAtmosphere {
    const PLACES: &'static [Place] = EITHER;
    const STRENGTHS: (f64, f64) = (5e-10, 1e-6);

    fn draw(draws: &mut Draws) -> Self {
        let law = if draws.unit() < 0.5 { LeakLaw::Laminar } else { LeakLaw::Sharp };
        Self { area_m2: middle(Self::STRENGTHS), law }
    }
    fn strength(&self) -> f64 {
        self.area_m2
    }
    fn set_strength(&mut self, strength: f64) {
        self.area_m2 = strength;
    }
    fn install(&self, place: Place, rig: &mut Rig) {
        for &c in place.channels() {
            let leak = &mut rig.plant.chambers[c].leak;
            match self.law {
                LeakLaw::Laminar => leak.laminar = laminar_like(self.area_m2),
                LeakLaw::Sharp => leak.sharp = sonic_conductance(self.area_m2),
            }
        }
    }
    fn note(&self) -> String {
        match self.law {
            LeakLaw::Laminar => format!("laminar, {:.2e} kg/s/Pa^2", laminar_like(self.area_m2)),
            LeakLaw::Sharp => format!("a hole of {:.4} mm^2", 1e6 * self.area_m2),
        }
    }
}

/// A laminar leak from the positive into the negative chamber.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Cross {
    /// Effective area of a hole that passes as much (m²).
    pub area_m2: f64,
}

impl Mechanism for Cross {
    const PLACES: &'static [Place] = SHARED;
    const STRENGTHS: (f64, f64) = (2e-10, 5e-7);

    fn draw(_draws: &mut Draws) -> Self {
        Self { area_m2: middle(Self::STRENGTHS) }
    }
    fn strength(&self) -> f64 {
        self.area_m2
    }
    fn set_strength(&mut self, strength: f64) {
        self.area_m2 = strength;
    }
    fn install(&self, _place: Place, rig: &mut Rig) {
        rig.plant.cross_leak = laminar_like(self.area_m2);
    }
    fn note(&self) -> String {
        format!("laminar, {:.2e} kg/s/Pa^2 from positive to negative", laminar_like(self.area_m2))
    }
}

/// A chamber whose wool is gone: the bare wall takes the heat of compression slowly.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Thermal {
    /// Heat conductance between air and wall (W/K).
    pub wall_conductance_w_k: f64,
}

impl Mechanism for Thermal {
    /// In the negative chamber alone it moves no pressure by more than 0.15 kPa: its pump is quicker than its heat.
    const PLACES: &'static [Place] = POSITIVE_OR_BOTH;
    /// Thermal resistances (K/W): from a thin rest of wool to still air.
    const STRENGTHS: (f64, f64) = (2.5e-3, 5.0);

    fn draw(_draws: &mut Draws) -> Self {
        Self { wall_conductance_w_k: 1.0 / middle(Self::STRENGTHS) }
    }
    fn strength(&self) -> f64 {
        1.0 / self.wall_conductance_w_k
    }
    fn set_strength(&mut self, strength: f64) {
        self.wall_conductance_w_k = 1.0 / strength;
    }
    fn install(&self, place: Place, rig: &mut Rig) {
        for &c in place.channels() {
            rig.plant.chambers[c].wall_conductance_w_k = self.wall_conductance_w_k;
        }
    }
    fn note(&self) -> String {
        format!("energy balance with a wall conductance of {:.2} W/K", self.wall_conductance_w_k)
    }
}

/// Walls that give way to the pressure.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Compliance {
    /// Volume per pressure (m³/Pa).
    pub compliance_m3_pa: f64,
}

impl Mechanism for Compliance {
    /// In the negative chamber alone it hardly shows.
    const PLACES: &'static [Place] = POSITIVE_OR_BOTH;
    const STRENGTHS: (f64, f64) = (2e-11, 5e-9);

    fn draw(_draws: &mut Draws) -> Self {
        Self { compliance_m3_pa: middle(Self::STRENGTHS) }
    }
    fn strength(&self) -> f64 {
        self.compliance_m3_pa
    }
    fn set_strength(&mut self, strength: f64) {
        self.compliance_m3_pa = strength;
    }
    fn install(&self, place: Place, rig: &mut Rig) {
        for &c in place.channels() {
            // A tube in vacuum loses at most part of its volume: never more than a third here.
            let chamber = &mut rig.plant.chambers[c];
            chamber.compliance_m3_pa = self.compliance_m3_pa.min(0.33 * chamber.volume_m3 / 1e5);
        }
    }
    fn note(&self) -> String {
        format!("{:.2e} m^3/Pa", self.compliance_m3_pa)
    }
}

/// Another volume: attached before the recordings, or switched in during each of them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct VolumeChange {
    /// Relative change of the volume.
    pub relative: f64,
    /// When it comes, after the start of every recording (s); absent if it was there from the start.
    pub time_s: Option<f64>,
    /// Duration (s).
    pub duration_s: f64,
}

impl Mechanism for VolumeChange {
    const PLACES: &'static [Place] = EITHER;
    const STRENGTHS: (f64, f64) = (1e-3, 0.8);

    fn draw(draws: &mut Draws) -> Self {
        let time_s = (draws.unit() < 0.6).then(|| draws.between(20.0, 40.0));
        Self { relative: middle(Self::STRENGTHS), time_s, duration_s: draws.between(0.2, 1.0) }
    }
    fn strength(&self) -> f64 {
        self.relative
    }
    fn set_strength(&mut self, strength: f64) {
        self.relative = strength;
    }
    fn install(&self, place: Place, rig: &mut Rig) {
        for &c in place.channels() {
            let chamber = &mut rig.plant.chambers[c];
            match self.time_s {
                None => chamber.volume_m3 *= 1.0 + self.relative,
                Some(time_s) => {
                    chamber.volume_step =
                        Some(VolumeStep { relative: self.relative, time_s, duration_s: self.duration_s });
                }
            }
        }
    }
    fn note(&self) -> String {
        let when =
            self.time_s.map_or("from the start".to_owned(), |time_s| format!("{time_s:.1} s into each recording"));
        format!("volume {:+.1} %, {when}", 100.0 * self.relative)
    }
}
