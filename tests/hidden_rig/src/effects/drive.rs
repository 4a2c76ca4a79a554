//! Effects between the command and the flapper: magnetism, friction, copper, supply, network.

use serde::{Deserialize, Serialize};

use super::{ANY, EITHER, Mechanism, Place, SHARED, middle};
use crate::actuation::{MagneticHysteresis, StickyPlunger, WarmCoil};
use crate::rng::Draws;
use crate::run::Rig;
use crate::valve::Friction;

/// Magnetic hysteresis: a Preisach field over the duty ([`crate::preisach`]).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Hysteresis {
    /// Mean half width of the loop (duty).
    pub half_width_duty: f64,
    /// Spread of half widths around it.
    pub spread: f64,
}

impl Mechanism for Hysteresis {
    const PLACES: &'static [Place] = ANY;
    const STRENGTHS: (f64, f64) = (3e-4, 0.1);

    fn draw(draws: &mut Draws) -> Self {
        Self { half_width_duty: middle(Self::STRENGTHS), spread: draws.between(0.3, 0.6) }
    }
    fn strength(&self) -> f64 {
        self.half_width_duty
    }
    fn set_strength(&mut self, strength: f64) {
        self.half_width_duty = strength;
    }
    fn install(&self, place: Place, rig: &mut Rig) {
        for &c in place.channels() {
            rig.actuation.hysteresis[c] =
                Some(MagneticHysteresis { half_width: self.half_width_duty, spread: self.spread });
        }
    }
    fn note(&self) -> String {
        format!("Preisach relays, mean half width {:.4} of duty", self.half_width_duty)
    }
}

/// Part of a valve that friction holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FrictionOn {
    /// The plunger in its guide: only changes of the duty build up.
    Plunger,
    /// The flapper: changes of the pressure build up too.
    Flapper,
}

/// Dry friction: stuck until the balance has moved by a band, then a slip to within a share of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Stiction {
    /// Band, as the change of duty that breaks it loose.
    pub band_duty: f64,
    /// Share of the band by which a slip stops short.
    pub residual: f64,
    /// Part that sticks.
    pub on: FrictionOn,
}

impl Mechanism for Stiction {
    const PLACES: &'static [Place] = EITHER;
    const STRENGTHS: (f64, f64) = (1e-3, 0.12);

    fn draw(draws: &mut Draws) -> Self {
        let on = if draws.unit() < 0.5 { FrictionOn::Plunger } else { FrictionOn::Flapper };
        Self { band_duty: middle(Self::STRENGTHS), residual: draws.between(0.05, 0.25), on }
    }
    fn strength(&self) -> f64 {
        self.band_duty
    }
    fn set_strength(&mut self, strength: f64) {
        self.band_duty = strength;
    }
    fn install(&self, place: Place, rig: &mut Rig) {
        for &c in place.channels() {
            match self.on {
                FrictionOn::Plunger => {
                    rig.actuation.sticky[c] = Some(StickyPlunger { band: self.band_duty, residual: self.residual });
                }
                FrictionOn::Flapper => {
                    let vent = &mut rig.plant.vents[c];
                    vent.friction =
                        Some(Friction { breakaway_n: self.band_duty * vent.force_n, residual: self.residual });
                }
            }
        }
    }
    fn note(&self) -> String {
        let on = match self.on {
            FrictionOn::Plunger => "plunger",
            FrictionOn::Flapper => "flapper",
        };
        format!("dry friction of the {on}, breaks loose after {:.4} of duty", self.band_duty)
    }
}

/// A coil whose current takes time, falling a little slower than rising (free-wheel diode).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Lag {
    /// Time constant of a rising current (s).
    pub time_constant_s: f64,
    /// Time constant of a falling one, relative to it.
    pub fall_over_rise: f64,
}

impl Mechanism for Lag {
    const PLACES: &'static [Place] = ANY;
    const STRENGTHS: (f64, f64) = (1.5e-3, 0.4);

    fn draw(draws: &mut Draws) -> Self {
        Self { time_constant_s: middle(Self::STRENGTHS), fall_over_rise: draws.between(1.0, 1.15) }
    }
    fn strength(&self) -> f64 {
        self.time_constant_s
    }
    fn set_strength(&mut self, strength: f64) {
        self.time_constant_s = strength;
    }
    fn install(&self, place: Place, rig: &mut Rig) {
        for &c in place.channels() {
            rig.plant.vents[c].coil_rise_s = self.time_constant_s;
            rig.plant.vents[c].coil_fall_s = self.time_constant_s * self.fall_over_rise;
        }
    }
    fn note(&self) -> String {
        format!("coil current, first order, {:.1} ms", 1e3 * self.time_constant_s)
    }
}

/// A magnetic circuit that saturates: `f(u) = u (1 + s)/(1 + s u)`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ForceCurve {
    /// Saturation s; 0 is linear.
    pub saturation: f64,
}

impl Mechanism for ForceCurve {
    const PLACES: &'static [Place] = ANY;
    const STRENGTHS: (f64, f64) = (3e-3, 3.0);

    fn draw(_draws: &mut Draws) -> Self {
        Self { saturation: middle(Self::STRENGTHS) }
    }
    fn strength(&self) -> f64 {
        self.saturation
    }
    fn set_strength(&mut self, strength: f64) {
        self.saturation = strength;
    }
    fn install(&self, place: Place, rig: &mut Rig) {
        for &c in place.channels() {
            rig.plant.vents[c].saturation = self.saturation;
        }
    }
    fn note(&self) -> String {
        format!("force u (1 + s)/(1 + s u), s = {:.3}", self.saturation)
    }
}

/// Copper that warms: the current falls with u², with a slow body and a quicker winding.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Heating {
    /// Rise of the resistance at full duty for long, relative.
    pub resistance_rise: f64,
    /// Time constant of the body (s).
    pub time_constant_s: f64,
}

impl Mechanism for Heating {
    const PLACES: &'static [Place] = ANY;
    const STRENGTHS: (f64, f64) = (5e-4, 0.35);

    fn draw(draws: &mut Draws) -> Self {
        Self { resistance_rise: middle(Self::STRENGTHS), time_constant_s: draws.between(40.0, 150.0) }
    }
    fn strength(&self) -> f64 {
        self.resistance_rise
    }
    fn set_strength(&mut self, strength: f64) {
        self.resistance_rise = strength;
    }
    fn install(&self, place: Place, rig: &mut Rig) {
        for &c in place.channels() {
            rig.actuation.warm[c] = Some(WarmCoil { rise: self.resistance_rise, time_s: self.time_constant_s });
        }
    }
    fn note(&self) -> String {
        format!(
            "coil resistance rises by up to {:.1} %, time constant {:.0} s, driven by duty squared",
            100.0 * self.resistance_rise,
            self.time_constant_s
        )
    }
}

/// A resistance that both coils share: the more one draws, the less the other has.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Sag {
    /// Relative loss of voltage per unit of summed duty.
    pub loss_per_duty: f64,
}

impl Mechanism for Sag {
    const PLACES: &'static [Place] = SHARED;
    const STRENGTHS: (f64, f64) = (2e-4, 0.2);

    fn draw(_draws: &mut Draws) -> Self {
        Self { loss_per_duty: middle(Self::STRENGTHS) }
    }
    fn strength(&self) -> f64 {
        self.loss_per_duty
    }
    fn set_strength(&mut self, strength: f64) {
        self.loss_per_duty = strength;
    }
    fn install(&self, _place: Place, rig: &mut Rig) {
        rig.actuation.shared_resistance = self.loss_per_duty;
    }
    fn note(&self) -> String {
        format!("both coils on one resistance: voltage falls by {:.2} % per unit of duty", 100.0 * self.loss_per_duty)
    }
}

/// Commands that reach the driver late, by any time, not only whole ticks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Delay {
    /// Delay (s).
    pub delay_s: f64,
}

impl Mechanism for Delay {
    const PLACES: &'static [Place] = ANY;
    const STRENGTHS: (f64, f64) = (1e-3, 0.3);

    fn draw(_draws: &mut Draws) -> Self {
        Self { delay_s: middle(Self::STRENGTHS) }
    }
    fn strength(&self) -> f64 {
        self.delay_s
    }
    fn set_strength(&mut self, strength: f64) {
        self.delay_s = strength;
    }
    fn install(&self, place: Place, rig: &mut Rig) {
        for &c in place.channels() {
            rig.actuation.delay_s[c] = self.delay_s;
        }
    }
    fn note(&self) -> String {
        format!("commands {:.1} ms late", 1e3 * self.delay_s)
    }
}
