//! Effects that can be concealed in a rig: one type per effect, and a catalogue of them all.
//!
//! Each effect has one number that says how strong it is (a width, a time constant, an area …) with a physical range,
//! and further numbers of its shape, which are drawn. Its fields are the parameters that the truth file states; their
//! names carry the unit. The first 23 are the ids of the diagnosis's library; what follows is outside it and goes by
//! the id `unknown_mechanism` in a truth.

pub mod chambers;
pub mod drive;
pub mod outside;
pub mod pumping;
pub mod sensing;
pub mod vents;

use serde::{Deserialize, Serialize};

use crate::rng::Draws;
use crate::run::Rig;

/// Where an effect sits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Place {
    /// The positive channel; of the pump, its outlet side.
    Positive,
    /// The negative channel; of the pump, its inlet side.
    Negative,
    /// Both channels, or what they share.
    Both,
}

impl Place {
    /// Indices of the channels.
    pub fn channels(self) -> &'static [usize] {
        match self {
            Self::Positive => &[0],
            Self::Negative => &[1],
            Self::Both => &[0, 1],
        }
    }
}

/// One channel or the other.
const EITHER: &[Place] = &[Place::Positive, Place::Negative];
/// One channel, the other, or both.
const ANY: &[Place] = &[Place::Positive, Place::Negative, Place::Both];
/// The positive channel, or both.
const POSITIVE_OR_BOTH: &[Place] = &[Place::Positive, Place::Both];
/// Places of effects that both channels share.
const SHARED: &[Place] = &[Place::Both];

/// Abilities of every effect.
pub trait Mechanism: Sized {
    /// Where it may sit.
    const PLACES: &'static [Place];
    /// Physical range of its strength.
    const STRENGTHS: (f64, f64);
    /// True where its raw size says little, because the ripple that it makes beat is larger than what it does on average:
    /// a level then stands for a share of its physical range.
    const SIZED_BY_STRENGTH: bool = false;

    /// One of its kind: shape drawn, strength in the middle of the range.
    fn draw(draws: &mut Draws) -> Self;

    /// Strength: more is a larger effect.
    fn strength(&self) -> f64;

    /// Gives it another strength.
    fn set_strength(&mut self, strength: f64);

    /// Builds it into a rig.
    fn install(&self, place: Place, rig: &mut Rig);

    /// Description in a line.
    fn note(&self) -> String;
}

/// Writes the catalogue: the enum of all effects, their names, and the calls that go to whichever it is.
macro_rules! catalogue {
    ($($(#[$doc:meta])* $variant:ident($type:ty) = $name:literal, $library:literal;)*) => {
        /// Any effect. Written as `{"kind": name, "parameters": {…}}`.
        #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
        #[serde(tag = "kind", content = "parameters")]
        pub enum Effect {
            $($(#[$doc])* #[serde(rename = $name)] $variant($type),)*
        }

        /// The kinds of effects.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
        pub enum Kind {
            $($(#[$doc])* $variant,)*
        }

        impl Kind {
            /// Every kind.
            pub const ALL: &'static [Self] = &[$(Self::$variant,)*];

            /// Name.
            pub fn name(self) -> &'static str {
                match self { $(Self::$variant => $name,)* }
            }

            /// Tells whether the diagnosis's library knows it.
            pub fn in_library(self) -> bool {
                match self { $(Self::$variant => $library,)* }
            }

            /// Where it may sit.
            pub fn places(self) -> &'static [Place] {
                match self { $(Self::$variant => <$type>::PLACES,)* }
            }

            /// Physical range of its strength.
            pub fn strengths(self) -> (f64, f64) {
                match self { $(Self::$variant => <$type>::STRENGTHS,)* }
            }

            /// Tells whether a level stands for a share of its physical range: see [`Mechanism::SIZED_BY_STRENGTH`].
            pub fn sized_by_strength(self) -> bool {
                match self { $(Self::$variant => <$type>::SIZED_BY_STRENGTH,)* }
            }

            /// One of its kind, with a drawn shape.
            pub fn draw(self, draws: &mut Draws) -> Effect {
                match self { $(Self::$variant => Effect::$variant(<$type>::draw(draws)),)* }
            }
        }

        impl Effect {
            /// Kind.
            pub fn kind(&self) -> Kind {
                match self { $(Self::$variant(_) => Kind::$variant,)* }
            }

            /// Strength.
            pub fn strength(&self) -> f64 {
                match self { $(Self::$variant(effect) => effect.strength(),)* }
            }

            /// Effect at another strength, held within the physical range.
            pub fn at_strength(&self, strength: f64) -> Self {
                let (low, high) = self.kind().strengths();
                let mut other = self.clone();
                match &mut other { $(Self::$variant(effect) => effect.set_strength(strength.clamp(low, high)),)* }
                other
            }

            /// Builds it into a rig.
            pub fn install(&self, place: Place, rig: &mut Rig) {
                match self { $(Self::$variant(effect) => effect.install(place, rig),)* }
            }

            /// Description in a line.
            pub fn note(&self) -> String {
                match self { $(Self::$variant(effect) => effect.note(),)* }
            }
        }
    };
}

catalogue! {
    /// Magnetic hysteresis of a valve.
    ValveHysteresis(drive::Hysteresis) = "valve_hysteresis", true;
    /// Dry friction in a valve.
    ValveStiction(drive::Stiction) = "valve_stiction", true;
    /// A slow coil.
    ValveLag(drive::Lag) = "valve_lag", true;
    /// A force that is not linear in the duty.
    ValveForceCurve(drive::ForceCurve) = "valve_force_curve", true;
    /// Coils that warm.
    CoilHeating(drive::Heating) = "coil_heating", true;
    /// A supply that sags under both coils.
    SupplySag(drive::Sag) = "supply_sag", true;
    /// Commands that arrive late.
    CommandDelay(drive::Delay) = "command_delay", true;
    /// A chamber that leaks.
    ChamberLeak(chambers::ToAtmosphere) = "chamber_leak", true;
    /// A leak from one chamber to the other.
    CrossLeak(chambers::Cross) = "cross_leak", true;
    /// Rings that leak.
    PistonBlowby(pumping::Blowby) = "piston_blowby", true;
    /// Chambers without wool.
    ChamberThermal(chambers::Thermal) = "chamber_thermal", true;
    /// Elastic walls.
    VolumeCompliance(chambers::Compliance) = "volume_compliance", true;
    /// Another volume than the sheet's.
    VolumeChange(chambers::VolumeChange) = "volume_change", true;
    /// Loss in the tube to a valve.
    LineResistance(vents::LineLoss) = "line_resistance", true;
    /// A silencer or filter.
    ExhaustRestriction(vents::Exhaust) = "exhaust_restriction", true;
    /// Valves that choke at another ratio.
    CriticalRatio(vents::Ratio) = "critical_ratio", true;
    /// Check valves that need pressure to open.
    CheckValveCracking(pumping::Cracking) = "check_valve_cracking", true;
    /// A motor that slows under load.
    PumpDroop(pumping::Droop) = "pump_droop", true;
    /// A motor at another speed, or one that warms up.
    PumpSpeed(pumping::Speed) = "pump_speed", true;
    /// A slow sensor.
    SensorLag(sensing::Lag) = "sensor_lag", true;
    /// A zero that creeps.
    SensorDrift(sensing::Drift) = "sensor_drift", true;
    /// A zero that is off.
    SensorBias(sensing::Bias) = "sensor_bias", true;
    /// A gain that is off.
    SensorGain(sensing::Gain) = "sensor_gain", true;
    /// A sensing line that rings.
    LineResonance(outside::Resonance) = "line_resonance", false;
    /// A flapper that bounces.
    FlapperBounce(outside::Bounce) = "flapper_bounce", false;
    /// A driver that limits the slope of the current.
    SlewLimit(outside::Slew) = "slew_limit", false;
    /// A throat that clogs with moisture and clears.
    ThroatClogging(outside::Moisture) = "throat_clogging", false;
    /// A gland that leaks in a band of pressure.
    GlandLeak(outside::Gland) = "gland_leak", false;
    /// A dead-end volume behind a capillary.
    DeadEndVolume(outside::DeadEnd) = "dead_end_volume", false;
    /// A supply that hunts.
    SupplyHunting(outside::Hunting) = "supply_hunting", false;
    /// Channels that talk to each other in the wiring.
    SensorCrosstalk(outside::Crosstalk) = "sensor_crosstalk", false;
}

impl Kind {
    /// The id in a truth: its name, or `unknown_mechanism` for what the library does not know.
    pub fn id(self) -> &'static str {
        if self.in_library() { self.name() } else { "unknown_mechanism" }
    }
}

/// The middle of a range of strengths, in the logarithm.
fn middle((low, high): (f64, f64)) -> f64 {
    (low * high).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unique_and_strengths_settable() {
        let mut names: Vec<_> = Kind::ALL.iter().map(|kind| kind.name()).collect();
        assert_eq!(Kind::ALL.iter().filter(|kind| kind.in_library()).count(), 23);
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), Kind::ALL.len());
        let mut draws = Draws::new(1);
        for kind in Kind::ALL {
            let (low, high) = kind.strengths();
            let effect = kind.draw(&mut draws);
            assert!((effect.strength() / middle((low, high)) - 1.0).abs() < 1e-9, "{}", kind.name());
            assert!((effect.at_strength(0.1 * low).strength() / low - 1.0).abs() < 1e-9, "{}", kind.name());
            assert!((effect.at_strength(10.0 * high).strength() / high - 1.0).abs() < 1e-9, "{}", kind.name());
            assert!(!effect.note().is_empty());
        }
    }

    #[test]
    fn an_effect_survives_its_text() {
        let mut draws = Draws::new(2);
        for kind in Kind::ALL {
            let effect = kind.draw(&mut draws);
            let text = serde_json::to_string(&effect).unwrap();
            assert_eq!(serde_json::from_str::<Effect>(&text).unwrap(), effect, "{text}");
        }
    }
}
