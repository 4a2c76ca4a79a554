//! Effects that the diagnosis's library does not hold.

use serde::{Deserialize, Serialize};

use super::{EITHER, Mechanism, Place, SHARED, middle};
use crate::actuation::{Clogging, HuntingSupply};
use crate::chamber::Pocket;
use crate::gas::GAS_CONSTANT;
use crate::orifice::sonic_conductance;
use crate::plant::GlandLeak;
use crate::rng::Draws;
use crate::run::Rig;
use crate::sensor::LineResonance;
use crate::valve::Ringing;

/// A lightly damped resonance of the sensing line, of which the sensor takes a share.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Resonance {
    /// Share of the ringing in the reading.
    pub gain: f64,
    /// Frequency (Hz).
    pub frequency_hz: f64,
    /// Damping ratio.
    pub damping: f64,
}

impl Mechanism for Resonance {
    const PLACES: &'static [Place] = EITHER;
    const STRENGTHS: (f64, f64) = (4e-3, 5.0);

    fn draw(draws: &mut Draws) -> Self {
        Self {
            gain: middle(Self::STRENGTHS),
            frequency_hz: draws.between(1.8, 4.5),
            damping: draws.between(0.04, 0.12),
        }
    }
    fn strength(&self) -> f64 {
        self.gain
    }
    fn set_strength(&mut self, strength: f64) {
        self.gain = strength;
    }
    fn install(&self, place: Place, rig: &mut Rig) {
        for &c in place.channels() {
            rig.plant.sensors[c].resonance =
                Some(LineResonance { frequency_hz: self.frequency_hz, damping: self.damping, gain: self.gain });
        }
    }
    fn note(&self) -> String {
        format!("resonance of the sensing line at {:.1} Hz, gain {:.3}", self.frequency_hz, self.gain)
    }
}

/// A flapper on a soft seat ring that overshoots and bounces after every change.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Bounce {
    /// Frequency (Hz).
    pub frequency_hz: f64,
    /// Damping ratio.
    pub damping: f64,
}

impl Mechanism for Bounce {
    const PLACES: &'static [Place] = EITHER;
    /// Periods (s).
    const STRENGTHS: (f64, f64) = (0.02, 0.8);

    fn draw(draws: &mut Draws) -> Self {
        Self { frequency_hz: 1.0 / middle(Self::STRENGTHS), damping: draws.between(0.08, 0.18) }
    }
    fn strength(&self) -> f64 {
        1.0 / self.frequency_hz
    }
    fn set_strength(&mut self, strength: f64) {
        self.frequency_hz = 1.0 / strength;
    }
    fn install(&self, place: Place, rig: &mut Rig) {
        for &c in place.channels() {
            rig.plant.vents[c].ringing = Some(Ringing { frequency_hz: self.frequency_hz, damping: self.damping });
        }
    }
    fn note(&self) -> String {
        format!("flapper bounces at {:.1} Hz, damping {:.2}", self.frequency_hz, self.damping)
    }
}

/// A driver that limits the slope of the current.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Slew {
    /// Time for the full scale (s).
    pub full_scale_s: f64,
}

impl Mechanism for Slew {
    const PLACES: &'static [Place] = EITHER;
    const STRENGTHS: (f64, f64) = (0.01, 5.0);

    fn draw(_draws: &mut Draws) -> Self {
        Self { full_scale_s: middle(Self::STRENGTHS) }
    }
    fn strength(&self) -> f64 {
        self.full_scale_s
    }
    fn set_strength(&mut self, strength: f64) {
        self.full_scale_s = strength;
    }
    fn install(&self, place: Place, rig: &mut Rig) {
        for &c in place.channels() {
            rig.plant.vents[c].slew_per_s = 1.0 / self.full_scale_s;
        }
    }
    fn note(&self) -> String {
        format!("current takes {:.2} s for its full scale", self.full_scale_s)
    }
}

/// Moisture that settles in the throat while air flows fast, and clears when it does not.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Moisture {
    /// Share of the throat lost in a steady flow of 0.5 g/s.
    pub share: f64,
    /// Time constant (s).
    pub time_constant_s: f64,
}

impl Mechanism for Moisture {
    const PLACES: &'static [Place] = EITHER;
    const STRENGTHS: (f64, f64) = (5e-4, 0.4);

    fn draw(draws: &mut Draws) -> Self {
        Self { share: middle(Self::STRENGTHS), time_constant_s: draws.between(3.0, 12.0) }
    }
    fn strength(&self) -> f64 {
        self.share
    }
    fn set_strength(&mut self, strength: f64) {
        self.share = strength;
    }
    fn install(&self, place: Place, rig: &mut Rig) {
        for &c in place.channels() {
            rig.actuation.clogging[c] = Some(Clogging { share: self.share, time_s: self.time_constant_s });
        }
    }
    fn note(&self) -> String {
        format!("throat loses {:.1} % to moisture, {:.1} s", 100.0 * self.share, self.time_constant_s)
    }
}

/// A gland of the pump that leaks in a band of the positive pressure.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Gland {
    /// Effective area in the middle of the band (m²).
    pub area_m2: f64,
    /// Middle of the band (kPa gauge).
    pub middle_kpa: f64,
    /// Half width (kPa).
    pub half_width_kpa: f64,
}

impl Mechanism for Gland {
    const PLACES: &'static [Place] = &[Place::Positive];
    const STRENGTHS: (f64, f64) = (2e-9, 3e-6);

    fn draw(draws: &mut Draws) -> Self {
        Self {
            area_m2: middle(Self::STRENGTHS),
            middle_kpa: draws.between(85.0, 105.0),
            half_width_kpa: draws.between(4.0, 8.0),
        }
    }
    fn strength(&self) -> f64 {
        self.area_m2
    }
    fn set_strength(&mut self, strength: f64) {
        self.area_m2 = strength;
    }
    fn install(&self, _place: Place, rig: &mut Rig) {
        rig.plant.gland_leak = Some(GlandLeak {
            conductance: sonic_conductance(self.area_m2),
            middle_pa: 1e3 * self.middle_kpa,
            half_width_pa: 1e3 * self.half_width_kpa,
        });
    }
    fn note(&self) -> String {
        format!("gland leaks around {:.0} kPa, {:.3} mm^2", self.middle_kpa, 1e6 * self.area_m2)
    }
}

/// A dead-end volume behind a capillary.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DeadEnd {
    /// Volume (m³).
    pub volume_m3: f64,
    /// Time constant at the channel's usual pressure (s).
    pub time_constant_s: f64,
}

impl Mechanism for DeadEnd {
    const PLACES: &'static [Place] = EITHER;
    const STRENGTHS: (f64, f64) = (3e-6, 6e-4);

    fn draw(draws: &mut Draws) -> Self {
        Self { volume_m3: middle(Self::STRENGTHS), time_constant_s: draws.between(0.4, 2.0) }
    }
    fn strength(&self) -> f64 {
        self.volume_m3
    }
    fn set_strength(&mut self, strength: f64) {
        self.volume_m3 = strength;
    }
    fn install(&self, place: Place, rig: &mut Rig) {
        for &c in place.channels() {
            let usual_pa = [190e3, 31e3][c];
            let chamber = &mut rig.plant.chambers[c];
            // Small differences: ṁ = 2 k p Δp, and V/(R T) of mass per pascal.
            let capillary = self.volume_m3 / (GAS_CONSTANT * chamber.wall_k * 2.0 * usual_pa * self.time_constant_s);
            chamber.pocket = Some(Pocket { volume_m3: self.volume_m3, capillary });
        }
    }
    fn note(&self) -> String {
        format!("dead end of {:.0} ml, {:.2} s", 1e6 * self.volume_m3, self.time_constant_s)
    }
}

/// A supply whose regulation hunts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Hunting {
    /// Amplitude of the voltage, relative.
    pub amplitude: f64,
    /// Frequency (Hz).
    pub frequency_hz: f64,
}

impl Mechanism for Hunting {
    const PLACES: &'static [Place] = SHARED;
    const STRENGTHS: (f64, f64) = (1e-4, 0.15);

    fn draw(draws: &mut Draws) -> Self {
        Self { amplitude: middle(Self::STRENGTHS), frequency_hz: draws.between(0.25, 0.9) }
    }
    fn strength(&self) -> f64 {
        self.amplitude
    }
    fn set_strength(&mut self, strength: f64) {
        self.amplitude = strength;
    }
    fn install(&self, _place: Place, rig: &mut Rig) {
        rig.actuation.hunting = Some(HuntingSupply { amplitude: self.amplitude, frequency_hz: self.frequency_hz });
    }
    fn note(&self) -> String {
        format!("supply hunts by {:.2} % at {:.2} Hz", 100.0 * self.amplitude, self.frequency_hz)
    }
}

/// A share of the other channel's pressure in the reading.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Crosstalk {
    /// Share.
    pub share: f64,
    /// With its sign (+1) or against it (−1).
    pub sign: f64,
}

impl Mechanism for Crosstalk {
    const PLACES: &'static [Place] = EITHER;
    const STRENGTHS: (f64, f64) = (1e-4, 0.08);

    fn draw(draws: &mut Draws) -> Self {
        Self { share: middle(Self::STRENGTHS), sign: draws.sign() }
    }
    fn strength(&self) -> f64 {
        self.share
    }
    fn set_strength(&mut self, strength: f64) {
        self.share = strength;
    }
    fn install(&self, place: Place, rig: &mut Rig) {
        for &c in place.channels() {
            rig.plant.sensors[c].crosstalk = self.sign * self.share;
        }
    }
    fn note(&self) -> String {
        format!("{:+.2} % of the other channel in the reading", 100.0 * self.sign * self.share)
    }
}
