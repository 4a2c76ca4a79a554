//! Physics beyond the paper's, as named mechanisms that a rig file switches on.
//!
//! One file per mechanism, each with its formula, source, unit, range, and what tells it apart. A file
//! holds the data as the rig states it and, where the mechanism acts along the command or the reading,
//! the operator that does so. Where each plugs in:
//!
//! | place | mechanisms |
//! | --- | --- |
//! | command path of a valve, in this order | `command_delay`, `valve_lag`, `valve_hysteresis` |
//! | volume | `chamber_thermal` |
//! | flow path | `chamber_leak` |
//! | sensor | `sensor_lag` |
//!
//! The command path runs ahead of the pressures: a command is constant over a tick and nothing in the
//! path depends on pressure, so its operators fill one table of instants per tick and the integrator
//! only reads it. Volumes and flow paths are terms of the mass and energy balances. A rig without
//! mechanisms compiles to the very same arrays as if this module did not exist.
//!
//! To add one: a file here, a variant below, and a line in `plant/assemble.rs`.

mod chamber_leak;
mod chamber_thermal;
mod command_delay;
mod sensor_lag;
mod valve_hysteresis;
mod valve_lag;

pub use chamber_leak::ChamberLeak;
pub use chamber_thermal::ChamberThermal;
pub use command_delay::CommandDelay;
pub(crate) use command_delay::{Delay, LONGEST_TICKS};
pub use sensor_lag::SensorLag;
pub(crate) use valve_hysteresis::Play;
pub use valve_hysteresis::ValveHysteresis;
pub(crate) use valve_lag::Lag;
pub use valve_lag::ValveLag;

use serde::{Deserialize, Serialize};

use crate::rig::{Rig, RigError};

/// A mechanism with its parameters, as a rig file states it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "id", rename_all = "snake_case", deny_unknown_fields)]
pub enum Mechanism {
    /// The opening depends on the way the duty came.
    ValveHysteresis(ValveHysteresis),
    /// The opening follows the duty late.
    ValveLag(ValveLag),
    /// The duty arrives late.
    CommandDelay(CommandDelay),
    /// Gas escapes past the valve.
    ChamberLeak(ChamberLeak),
    /// The gas in a chamber warms and cools.
    ChamberThermal(ChamberThermal),
    /// The reading follows the pressure late.
    SensorLag(SensorLag),
}

/// What a mechanism can be attached to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// A commanded valve.
    Valve,
    /// A chamber.
    Volume,
    /// A pressure sensor.
    Sensor,
}

impl Mechanism {
    /// The mechanism's id, as in rig files and diagnoses.
    pub fn id(&self) -> &'static str {
        match self {
            Mechanism::ValveHysteresis(_) => "valve_hysteresis",
            Mechanism::ValveLag(_) => "valve_lag",
            Mechanism::CommandDelay(_) => "command_delay",
            Mechanism::ChamberLeak(_) => "chamber_leak",
            Mechanism::ChamberThermal(_) => "chamber_thermal",
            Mechanism::SensorLag(_) => "sensor_lag",
        }
    }

    /// What it can be attached to.
    pub fn place(&self) -> Place {
        match self {
            Mechanism::ValveHysteresis(_) | Mechanism::ValveLag(_) | Mechanism::CommandDelay(_) => Place::Valve,
            Mechanism::ChamberLeak(_) | Mechanism::ChamberThermal(_) => Place::Volume,
            Mechanism::SensorLag(_) => Place::Sensor,
        }
    }

    /// Whether it changes the flows of a rig whose pressures and duties stand still.
    pub fn acts_when_settled(&self) -> bool {
        matches!(self, Mechanism::ChamberLeak(_))
    }

    /// Checks the parameters and that `component` is of the right kind.
    pub(crate) fn check(&self, rig: &Rig, component: &str, key: &str) -> Result<(), RigError> {
        let (kind, known) = match self.place() {
            Place::Valve => ("valve", rig.valves.keys().cloned().collect::<Vec<_>>()),
            Place::Volume => ("volume", rig.volumes.keys().cloned().collect()),
            Place::Sensor => ("sensor", rig.sensors.keys().cloned().collect()),
        };
        if !known.iter().any(|name| name == component) {
            return Err(RigError::at(
                format!("{key}.component"),
                format!(
                    "`{}` goes on a {kind}, and `{component}` is none; there are {}",
                    self.id(),
                    crate::rig::names(known.iter())
                ),
            ));
        }
        match self {
            Mechanism::ValveHysteresis(m) => m.check(key),
            Mechanism::ValveLag(m) => m.check(key),
            Mechanism::CommandDelay(m) => m.check(key, rig.integrator.tick_ms),
            Mechanism::ChamberLeak(m) => m.check(key),
            Mechanism::ChamberThermal(m) => m.check(key),
            Mechanism::SensorLag(m) => m.check(key),
        }
    }
}
