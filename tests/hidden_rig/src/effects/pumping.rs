//! Effects of the pump: rings, reeds, motor.

use serde::{Deserialize, Serialize};

use super::chambers::laminar_like;
use super::{Mechanism, Place, SHARED, middle};
use crate::rng::Draws;
use crate::run::Rig;

/// Air past the piston rings, between cylinders and crankcase: laminar.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Blowby {
    /// Effective area of a hole that passes as much, per cylinder (m²).
    pub area_m2: f64,
}

impl Mechanism for Blowby {
    const PLACES: &'static [Place] = SHARED;
    const STRENGTHS: (f64, f64) = (2e-10, 6e-7);

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
        rig.plant.pump.ring_leak = laminar_like(self.area_m2);
    }
    fn note(&self) -> String {
        format!("laminar past the rings, {:.2e} kg/s/Pa^2 per cylinder", laminar_like(self.area_m2))
    }
}

/// Reeds with a spring: shut below a pressure difference, opening over a range beyond it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Cracking {
    /// Difference at which they leave the seat (Pa).
    pub cracking_pa: f64,
    /// Range over which they open (Pa).
    pub lift_range_pa: f64,
}

impl Mechanism for Cracking {
    /// At the outlets alone it is next to nothing: the cylinders rise far above the chamber through the 1.46 mm².
    const PLACES: &'static [Place] = &[Place::Negative, Place::Both];
    const STRENGTHS: (f64, f64) = (30.0, 4e4);

    fn draw(draws: &mut Draws) -> Self {
        Self { cracking_pa: middle(Self::STRENGTHS), lift_range_pa: draws.between(300.0, 1_200.0) }
    }
    fn strength(&self) -> f64 {
        self.cracking_pa
    }
    fn set_strength(&mut self, strength: f64) {
        self.cracking_pa = strength;
    }
    fn install(&self, place: Place, rig: &mut Rig) {
        let pump = &mut rig.plant.pump;
        for &c in place.channels() {
            // The outlets face the positive chamber, the inlets the negative one.
            let reed = if c == 0 { &mut pump.outlet } else { &mut pump.inlet };
            reed.cracking_pa = self.cracking_pa;
            // The range opens with the spring: a weak spring has a short one.
            reed.lift_range_pa = self.lift_range_pa.min(0.5 * self.cracking_pa);
        }
    }
    fn note(&self) -> String {
        format!("reeds open at {:.2} kPa", 1e-3 * self.cracking_pa)
    }
}

/// A motor that slows under load: `ω → ω₀ (1 − k Δp)`, with its inertia.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Droop {
    /// Relative loss of speed per bar between the chambers.
    pub droop_per_bar: f64,
    /// Time constant by which the speed follows (s).
    pub time_constant_s: f64,
}

impl Mechanism for Droop {
    const SIZED_BY_STRENGTH: bool = true;
    const PLACES: &'static [Place] = SHARED;
    const STRENGTHS: (f64, f64) = (1e-4, 0.2);

    fn draw(draws: &mut Draws) -> Self {
        Self { droop_per_bar: middle(Self::STRENGTHS), time_constant_s: draws.between(0.05, 0.2) }
    }
    fn strength(&self) -> f64 {
        self.droop_per_bar
    }
    fn set_strength(&mut self, strength: f64) {
        self.droop_per_bar = strength;
    }
    fn install(&self, _place: Place, rig: &mut Rig) {
        rig.plant.pump.motor.droop_per_bar = self.droop_per_bar;
        rig.plant.pump.motor.spin_up_s = self.time_constant_s;
    }
    fn note(&self) -> String {
        format!("speed falls by {:.2} % per bar between the chambers", 100.0 * self.droop_per_bar)
    }
}

/// A motor at another speed: from the start, or as it warms.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Speed {
    /// Size of the relative change of speed.
    pub relative: f64,
    /// Faster (+1) or slower (−1).
    pub sign: f64,
    /// Time constant of the warming (s); absent for a speed that is off from the start.
    pub warming_time_s: Option<f64>,
}

impl Mechanism for Speed {
    const SIZED_BY_STRENGTH: bool = true;
    const PLACES: &'static [Place] = SHARED;
    const STRENGTHS: (f64, f64) = (2e-4, 0.12);

    fn draw(draws: &mut Draws) -> Self {
        let warming_time_s = (draws.unit() < 0.5).then(|| draws.between(20.0, 80.0));
        Self { relative: middle(Self::STRENGTHS), sign: draws.sign(), warming_time_s }
    }
    fn strength(&self) -> f64 {
        self.relative
    }
    fn set_strength(&mut self, strength: f64) {
        self.relative = strength;
    }
    fn install(&self, _place: Place, rig: &mut Rig) {
        let motor = &mut rig.plant.pump.motor;
        match self.warming_time_s {
            None => motor.speed_rad_s *= 1.0 + self.sign * self.relative,
            Some(time_s) => {
                motor.warming = self.sign * self.relative;
                motor.warming_time_s = time_s;
            }
        }
    }
    fn note(&self) -> String {
        let when =
            self.warming_time_s.map_or("from the start".to_owned(), |time_s| format!("as it warms, {time_s:.0} s"));
        format!("speed {:+.2} %, {when}", 100.0 * self.sign * self.relative)
    }
}
