//! Effects of the sensors.

use serde::{Deserialize, Serialize};

use super::{ANY, EITHER, Mechanism, Place, middle};
use crate::rng::Draws;
use crate::run::Rig;
use crate::sensor::ZeroDrift;

/// A clogged snubber before the sensor: first order, and the element's cavity ten times as fast.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Lag {
    /// Time constant (s).
    pub time_constant_s: f64,
}

impl Mechanism for Lag {
    const PLACES: &'static [Place] = ANY;
    const STRENGTHS: (f64, f64) = (1.5e-3, 0.6);

    fn draw(_draws: &mut Draws) -> Self {
        Self { time_constant_s: middle(Self::STRENGTHS) }
    }
    fn strength(&self) -> f64 {
        self.time_constant_s
    }
    fn set_strength(&mut self, strength: f64) {
        self.time_constant_s = strength;
    }
    fn install(&self, place: Place, rig: &mut Rig) {
        for &c in place.channels() {
            rig.plant.sensors[c].lag_s = self.time_constant_s;
        }
    }
    fn note(&self) -> String {
        format!("first order, {:.3} s, and a tenth of it", self.time_constant_s)
    }
}

/// A zero that creeps to another place.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Drift {
    /// Size of the creep in the end (kPa).
    pub final_kpa: f64,
    /// Up (+1) or down (−1).
    pub sign: f64,
    /// Time constant (s).
    pub time_constant_s: f64,
}

impl Mechanism for Drift {
    const PLACES: &'static [Place] = EITHER;
    const STRENGTHS: (f64, f64) = (0.02, 15.0);

    fn draw(draws: &mut Draws) -> Self {
        Self { final_kpa: middle(Self::STRENGTHS), sign: draws.sign(), time_constant_s: draws.between(30.0, 120.0) }
    }
    fn strength(&self) -> f64 {
        self.final_kpa
    }
    fn set_strength(&mut self, strength: f64) {
        self.final_kpa = strength;
    }
    fn install(&self, place: Place, rig: &mut Rig) {
        for &c in place.channels() {
            rig.plant.sensors[c].drift =
                Some(ZeroDrift { final_pa: 1e3 * self.sign * self.final_kpa, time_s: self.time_constant_s });
        }
    }
    fn note(&self) -> String {
        format!("zero creeps by {:+.2} kPa, {:.0} s", self.sign * self.final_kpa, self.time_constant_s)
    }
}

/// A zero that is off.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Bias {
    /// Size (kPa).
    pub size_kpa: f64,
    /// Reads high (+1) or low (−1).
    pub sign: f64,
}

impl Mechanism for Bias {
    const PLACES: &'static [Place] = EITHER;
    const STRENGTHS: (f64, f64) = (0.01, 6.0);

    fn draw(draws: &mut Draws) -> Self {
        Self { size_kpa: middle(Self::STRENGTHS), sign: draws.sign() }
    }
    fn strength(&self) -> f64 {
        self.size_kpa
    }
    fn set_strength(&mut self, strength: f64) {
        self.size_kpa = strength;
    }
    fn install(&self, place: Place, rig: &mut Rig) {
        for &c in place.channels() {
            rig.plant.sensors[c].bias_pa = 1e3 * self.sign * self.size_kpa;
        }
    }
    fn note(&self) -> String {
        format!("reads {:+.2} kPa", self.sign * self.size_kpa)
    }
}

/// A gain that is off.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Gain {
    /// Size, relative.
    pub relative: f64,
    /// Reads much (+1) or little (−1).
    pub sign: f64,
}

impl Mechanism for Gain {
    const PLACES: &'static [Place] = EITHER;
    const STRENGTHS: (f64, f64) = (1e-4, 0.06);

    fn draw(draws: &mut Draws) -> Self {
        Self { relative: middle(Self::STRENGTHS), sign: draws.sign() }
    }
    fn strength(&self) -> f64 {
        self.relative
    }
    fn set_strength(&mut self, strength: f64) {
        self.relative = strength;
    }
    fn install(&self, place: Place, rig: &mut Rig) {
        for &c in place.channels() {
            rig.plant.sensors[c].gain_error = self.sign * self.relative;
        }
    }
    fn note(&self) -> String {
        format!("gain {:+.2} %", 100.0 * self.sign * self.relative)
    }
}
