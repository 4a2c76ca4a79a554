//! Physics beyond the paper's, as named mechanisms that a rig file switches on.
//!
//! One file per mechanism, each with its formula, source, unit, range, and what tells it apart. A file
//! holds the data as the rig states it and, where the mechanism acts along the command or the reading,
//! the operator that does so. Where each plugs in:
//!
//! | place | mechanisms |
//! | --- | --- |
//! | command path of a valve, in this order | `command_delay`, `supply_sag`, `coil_heating`, `valve_lag` (coil), `valve_force_curve` (coil), `valve_stiction` (plunger), `valve_hysteresis`, `valve_lag` (armature) |
//! | valve | `dead_zone`, `valve_stiction` (flapper), `valve_force_curve` (jet, full opening), `critical_ratio`, `line_resistance`, `exhaust_restriction`, `residual_flow` |
//! | volume | `chamber_thermal`, `volume_compliance`, `volume_change`, `actuator_load` |
//! | flow path | `chamber_leak`, `cross_leak`, `residual_flow`, `line_resistance` |
//! | pump | `piston_blowby`, `check_valve_cracking`, `pump_droop`, `pump_speed`, `dead_zone`, `line_resistance` |
//! | sensor | `sensor_lag`, `sensor_drift`, `sensor_bias`, `sensor_gain`, `residual_response` |
//!
//! The command path runs ahead of the pressures: a command is constant over a tick and nothing in the
//! path depends on pressure, so its operators fill one table of instants per tick and the integrator
//! only reads it. Volumes and flow paths are terms of the mass and energy balances. A rig without
//! mechanisms compiles to the very same arrays as if this module did not exist.
//!
//! To add one: a file here, a line in [`Mechanism`], and where it acts (`plant/assemble`).

mod actuator_load;
mod candidate;
mod chamber_leak;
mod chamber_thermal;
mod check_valve_cracking;
mod coil_heating;
mod command_delay;
mod critical_ratio;
mod cross_leak;
mod dead_zone;
mod exhaust_restriction;
mod line_resistance;
mod piston_blowby;
mod pump_droop;
mod pump_speed;
mod residual_flow;
mod residual_response;
mod scale;
mod sensor_bias;
mod sensor_drift;
mod sensor_gain;
mod sensor_lag;
mod supply_sag;
mod valve_force_curve;
mod valve_hysteresis;
mod valve_lag;
mod valve_stiction;
mod volume_change;
mod volume_compliance;

pub use actuator_load::ActuatorLoad;
pub(crate) use candidate::Form;
pub use candidate::{Candidate, CandidateParameter, candidates};
pub use chamber_leak::ChamberLeak;
pub use chamber_thermal::ChamberThermal;
pub use check_valve_cracking::CheckValveCracking;
pub use coil_heating::CoilHeating;
pub(crate) use coil_heating::Heat;
pub use command_delay::CommandDelay;
pub(crate) use command_delay::{Delay, LONGEST_TICKS};
pub use critical_ratio::CriticalRatio;
pub use cross_leak::CrossLeak;
pub use dead_zone::DeadZone;
pub use exhaust_restriction::ExhaustRestriction;
pub use line_resistance::{LineResistance, PumpPort};
pub use piston_blowby::PistonBlowby;
pub use pump_droop::PumpDroop;
pub use pump_speed::PumpSpeed;
pub(crate) use residual_flow::Table;
pub use residual_flow::{Axis, ResidualFlow, Shape, Variable};
pub use residual_response::{ResidualResponse, Swing};
pub use sensor_bias::SensorBias;
pub use sensor_drift::SensorDrift;
pub use sensor_gain::SensorGain;
pub use sensor_lag::SensorLag;
pub use supply_sag::SupplySag;
pub(crate) use valve_force_curve::Bend;
pub use valve_force_curve::ValveForceCurve;
pub(crate) use valve_hysteresis::Play;
pub use valve_hysteresis::{PLAYS, ValveHysteresis};
pub(crate) use valve_lag::Lag;
pub use valve_lag::{Lags, ValveLag};
pub(crate) use valve_stiction::Stick;
pub use valve_stiction::{Rubs, ValveStiction};
pub use volume_change::VolumeChange;
pub use volume_compliance::VolumeCompliance;

use serde::{Deserialize, Serialize};

use crate::rig::{MechanismInstance, Number, Numbers, Rig, RigError, WHOLE_RIG};

/// Tells whether a number is at the value that a rig file leaves out.
fn is_zero(number: &f64) -> bool {
    *number == 0.0
}

/// Kind of component that a mechanism can be attached to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// A commanded valve.
    Valve,
    /// A chamber.
    Volume,
    /// A pump.
    Pump,
    /// A passive flow path.
    Line,
    /// A pressure sensor.
    Sensor,
    /// The rig as a whole, under the name [`WHOLE_RIG`].
    Rig,
}

impl Place {
    /// Names of all components of this kind.
    fn components(self, rig: &Rig) -> Vec<String> {
        match self {
            Place::Valve => rig.valves.keys().cloned().collect(),
            Place::Volume => rig.volumes.keys().cloned().collect(),
            Place::Pump => rig.pumps.keys().cloned().collect(),
            Place::Line => rig.lines.keys().cloned().collect(),
            Place::Sensor => rig.sensors.keys().cloned().collect(),
            Place::Rig => vec![WHOLE_RIG.to_owned()],
        }
    }

    fn name(self) -> &'static str {
        match self {
            Place::Valve => "valve",
            Place::Volume => "volume",
            Place::Pump => "pump",
            Place::Line => "line",
            Place::Sensor => "sensor",
            Place::Rig => "whole rig",
        }
    }
}

/// Facts that every mechanism states of itself.
pub(crate) trait Physics: Numbers {
    /// Id in rig files and diagnoses.
    const ID: &'static str;
    /// Kinds of components that it can be attached to.
    const PLACES: &'static [Place];
    /// True where it changes the flows of a rig whose pressures and duties stand still.
    const SETTLED: bool;

    /// Checks what goes beyond the range of a number.
    fn check(&self, _rig: &Rig, _component: &str, _key: &str) -> Result<(), RigError> {
        Ok(())
    }

    /// Shapes that a search for missing physics tries at a component of one of its places.
    fn forms(rig: &Rig, component: &str) -> Vec<Form>;
}

/// Takes the id, the places and the forms of a kind of mechanism.
type Visit<'v> = &'v mut dyn FnMut(&'static str, &'static [Place], fn(&Rig, &str) -> Vec<Form>);

/// Declares the enum of all mechanisms and what is asked of each.
macro_rules! mechanisms {
    ($($(#[$doc:meta])* $name:ident,)*) => {
        /// A mechanism with its parameters, as a rig file states it.
        #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
        #[serde(tag = "id", rename_all = "snake_case", deny_unknown_fields)]
        pub enum Mechanism {
            $($(#[$doc])* $name($name),)*
        }

        impl Mechanism {
            /// The mechanism's id, as in rig files and diagnoses.
            pub fn id(&self) -> &'static str {
                match self { $(Mechanism::$name(_) => $name::ID,)* }
            }

            /// Kinds of components that it can be attached to.
            pub fn places(&self) -> &'static [Place] {
                match self { $(Mechanism::$name(_) => $name::PLACES,)* }
            }

            /// Tells whether it changes the flows of a rig whose pressures and duties stand still.
            pub fn acts_when_settled(&self) -> bool {
                match self { $(Mechanism::$name(_) => $name::SETTLED,)* }
            }

            fn check_physics(&self, rig: &Rig, component: &str, key: &str) -> Result<(), RigError> {
                match self { $(Mechanism::$name(m) => Physics::check(m, rig, component, key),)* }
            }
        }

        /// Shows every kind of mechanism to `visit`.
        fn each_kind(visit: Visit<'_>) {
            $(visit($name::ID, $name::PLACES, $name::forms);)*
        }

        impl Numbers for Mechanism {
            fn numbers(&self) -> Vec<Number> {
                match self { $(Mechanism::$name(m) => m.numbers(),)* }
            }

            fn number(&self, index: usize) -> f64 {
                match self { $(Mechanism::$name(m) => m.number(index),)* }
            }

            fn number_mut(&mut self, index: usize) -> Option<&mut f64> {
                match self { $(Mechanism::$name(m) => m.number_mut(index),)* }
            }
        }
    };
}

mechanisms! {
    /// The opening depends on the way the duty came.
    ValveHysteresis,
    /// The opening stays until the duty has moved far enough.
    ValveStiction,
    /// The opening follows the duty late.
    ValveLag,
    /// Forces on the flapper are not straight lines.
    ValveForceCurve,
    /// Nothing flows below some duty.
    DeadZone,
    /// A warm coil pulls less.
    CoilHeating,
    /// The drivers' supply gives way.
    SupplySag,
    /// The duty arrives late.
    CommandDelay,
    /// Gas escapes past the valve.
    ChamberLeak,
    /// Gas passes from one chamber into another.
    CrossLeak,
    /// Gas slips past the pistons.
    PistonBlowby,
    /// The gas in a chamber warms and cools.
    ChamberThermal,
    /// A chamber grows with its pressure.
    VolumeCompliance,
    /// A chamber is larger or smaller than stated.
    VolumeChange,
    /// A hose or fitting in series.
    LineResistance,
    /// A muffler or filter at the open end of a valve.
    ExhaustRestriction,
    /// An orifice chokes at another ratio.
    CriticalRatio,
    /// Check valves open only against a spring.
    CheckValveCracking,
    /// A pump slows down under load.
    PumpDroop,
    /// A pump turns at another speed than stated.
    PumpSpeed,
    /// The reading follows the pressure late.
    SensorLag,
    /// The reading wanders off with time.
    SensorDrift,
    /// The reading is off by a constant.
    SensorBias,
    /// The reading is off by a factor.
    SensorGain,
    /// A muscle with a weight hangs on two chambers.
    ActuatorLoad,
    /// Flow or opening without a name, as a table.
    ResidualFlow,
    /// A reading's answer without a name, as a second-order system.
    ResidualResponse,
}

impl MechanismInstance {
    /// Tells whether `other` is the same mechanism at the same place, so that only one of the two can be meant.
    pub(crate) fn is_twin_of(&self, other: &MechanismInstance) -> bool {
        let apart = match (&self.mechanism, &other.mechanism) {
            (Mechanism::CrossLeak(one), Mechanism::CrossLeak(two)) => one.to != two.to,
            (Mechanism::LineResistance(one), Mechanism::LineResistance(two)) => one.port != two.port,
            _ => false,
        };
        self.component == other.component && self.mechanism.id() == other.mechanism.id() && !apart
    }
}

impl Mechanism {
    /// Checks the parameters and that `component` is of the right kind.
    pub(crate) fn check(&self, rig: &Rig, component: &str, key: &str) -> Result<(), RigError> {
        let known: Vec<String> = self.places().iter().flat_map(|place| place.components(rig)).collect();
        let kinds = self.places().iter().map(|place| place.name()).collect::<Vec<_>>().join(" or a ");
        match known.iter().filter(|name| *name == component).count() {
            1 => {}
            0 => {
                return Err(RigError::at(
                    format!("{key}.component"),
                    format!(
                        "`{}` goes on a {kinds}, and `{component}` is none; there are {}",
                        self.id(),
                        crate::rig::names(known.iter())
                    ),
                ));
            }
            _ => {
                return Err(RigError::at(
                    format!("{key}.component"),
                    format!("`{component}` names more than one thing that `{}` goes on; rename one", self.id()),
                ));
            }
        }
        self.check_numbers(key)?;
        self.check_physics(rig, component, key)
    }
}
