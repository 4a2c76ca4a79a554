//! Content of a rig file: one struct per kind of component, keys with their units in the name.
//!
//! These structs are the file, nothing more: numbers in the file's units, joins by name. Checks live in
//! [`super::check`], conversion to SI in [`crate::plant`]. Every optional key says what its absence means.

use indexmap::IndexMap;
use serde::{Deserialize, Serialize};

use super::recording_map::RecordingMap;
use crate::mechanism::Mechanism;

/// The name that stands for the open air wherever a component is joined to something.
pub const ATMOSPHERE: &str = "atmosphere";

/// The name that stands for the rig as a whole where a mechanism belongs to no single component.
pub const WHOLE_RIG: &str = "rig";

/// A whole rig as its file states it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rig {
    /// Version of the file format; 1.
    pub format: u32,
    /// The rig's name.
    pub name: String,
    /// One line for people.
    #[serde(default)]
    pub description: String,
    /// The gas.
    pub gas: Gas,
    /// The air around the rig.
    pub atmosphere: Atmosphere,
    /// Step and tick.
    #[serde(default)]
    pub integrator: Integrator,
    /// Chambers, by name.
    pub volumes: IndexMap<String, Volume>,
    /// Pumps, by name.
    #[serde(default, skip_serializing_if = "IndexMap::is_empty")]
    pub pumps: IndexMap<String, Pump>,
    /// Commanded valves, by name.
    #[serde(default, skip_serializing_if = "IndexMap::is_empty")]
    pub valves: IndexMap<String, Valve>,
    /// Passive flow paths, by name.
    #[serde(default, skip_serializing_if = "IndexMap::is_empty")]
    pub lines: IndexMap<String, Line>,
    /// Prescribed pressures and flows, by name.
    #[serde(default, skip_serializing_if = "IndexMap::is_empty")]
    pub sources: IndexMap<String, Source>,
    /// Pressure sensors, by name.
    pub sensors: IndexMap<String, Sensor>,
    /// Names and scales by which files that others wrote hold what this rig reads; absent where they have the rig's own columns.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recording: Option<RecordingMap>,
    /// Physics beyond the components' own.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub mechanisms: Vec<MechanismInstance>,
}

/// The gas in every part of the rig.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gas {
    /// Specific gas constant R in J/(kg K); 287 for dry air.
    pub gas_constant_j_per_kg_k: f64,
    /// κ = c_p/c_v; 1.4 for air.
    pub heat_capacity_ratio: f64,
}

/// The air around the rig.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Atmosphere {
    /// Absolute pressure in kPa; what gauge readings are relative to.
    pub pressure_kpa_abs: f64,
    /// Temperature in K.
    pub temperature_k: f64,
}

/// Steps into which time is cut.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Integrator {
    /// Runge-Kutta step in ms.
    pub step_ms: f64,
    /// Control tick in ms, a whole number of steps; commands are constant over it.
    pub tick_ms: f64,
    /// Takes a step in which a check valve opens or shuts again in two halves; off is plain RK4.
    #[serde(default = "yes", skip_serializing_if = "is_true")]
    pub refine_switching: bool,
}

impl Default for Integrator {
    fn default() -> Self {
        Integrator { step_ms: 0.1, tick_ms: 20.0, refine_switching: true }
    }
}

/// A chamber whose pressure is a state.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Volume {
    /// Volume at atmospheric pressure, in litres.
    pub volume_l: f64,
    /// Gas temperature in K (isothermal unless a mechanism says otherwise).
    pub temperature_k: f64,
    /// Growth of the volume with gauge pressure, in mL/kPa; absent means rigid.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub compliance_ml_per_kpa: f64,
}

/// A pump.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Pump {
    /// Slider-crank pistons with check valves, paper eqs. (1)-(3).
    Piston(PistonPump),
    /// A pump that displaces a given volume of inlet gas per time.
    Flow(FlowPump),
}

/// Slider-crank pistons with check valves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PistonPump {
    /// Where it draws from.
    pub inlet: String,
    /// Where it delivers to.
    pub outlet: String,
    /// Input column that switches it (0 off, 1 on); absent means always on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub relay: Option<String>,
    /// Motor speed in rev/min.
    pub speed_rpm: f64,
    /// Crank phase of each piston in degrees.
    pub phases_deg: Vec<f64>,
    /// Crank radius r in mm.
    pub crank_radius_mm: f64,
    /// Connecting rod l in mm.
    pub rod_length_mm: f64,
    /// Effective length δ of the cylinder in mm; δ − 2r is the clearance.
    pub effective_length_mm: f64,
    /// Piston head area S in cm².
    pub head_area_cm2: f64,
    /// Gas temperature in the cylinders in K.
    pub gas_temperature_k: f64,
    /// Effective area of each inlet check valve in mm².
    pub inlet_check_area_mm2: f64,
    /// Effective area of each outlet check valve in mm².
    pub outlet_check_area_mm2: f64,
}

/// A pump given by its displacement, for rigs whose pump is not worth a crank.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FlowPump {
    /// Where it draws from.
    #[serde(default = "atmosphere")]
    pub inlet: String,
    /// Where it delivers to.
    #[serde(default = "atmosphere")]
    pub outlet: String,
    /// Input column that scales the flow (0 … 1); absent means full flow.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub command: Option<String>,
    /// Volume of inlet gas displaced, in L/min at full command.
    pub flow_l_per_min: f64,
    /// Command up to which nothing flows (0 … 1); from there to 1 the flow rises linearly. Absent means none.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub dead_zone_duty: f64,
}

/// A nozzle-flapper proportional valve, paper eqs. (4)-(5).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Valve {
    /// Upstream port.
    pub from: String,
    /// Downstream port.
    pub to: String,
    /// Input column with the duty (0 … 1).
    pub command: String,
    /// Ĉ_u: effective area per duty, in mm².
    pub input_area_mm2: f64,
    /// Ĉ_P: effective area per force of the pressure on the flapper, in mm²/N.
    pub pressure_area_mm2_per_n: f64,
    /// Ĉ_k: effective area held shut by the spring, in mm².
    pub spring_area_mm2: f64,
    /// Nozzle diameter D on which the pressure acts, in mm.
    pub nozzle_diameter_mm: f64,
}

/// A passive flow path between two places.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Line {
    /// An orifice, paper eq. (3), in both directions unless `one_way`.
    Orifice {
        /// One end.
        from: String,
        /// The other end.
        to: String,
        /// Effective area in mm².
        area_mm2: f64,
        /// True where it passes only from `from` to `to`.
        #[serde(default, skip_serializing_if = "is_false")]
        one_way: bool,
    },
    /// A capillary: isothermal laminar flow, ṁ = (P₁² − P₂²)/(2 R T ζ), in both directions.
    Laminar {
        /// One end.
        from: String,
        /// The other end.
        to: String,
        /// Volumetric resistance ζ in kPa s/L.
        resistance_kpa_s_per_l: f64,
    },
}

/// Something prescribed from outside.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Source {
    /// A place whose pressure is given; other components join it by the source's name.
    Pressure {
        /// Gauge pressure in kPa (times the signal, where one is named).
        pressure_kpa_gauge: f64,
        /// Temperature in K.
        temperature_k: f64,
        /// Input column that multiplies the pressure; absent means constant.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        signal: Option<String>,
    },
    /// A flow forced into a place (negative: drawn out).
    Flow {
        /// Where it goes.
        to: String,
        /// Flow in L/min at atmospheric conditions (times the signal, where one is named).
        flow_l_per_min: f64,
        /// Input column that multiplies the flow; absent means constant.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        signal: Option<String>,
        /// Flow in L/min that comes on top of it: what a meter does not show when nothing flows. Absent means none.
        #[serde(default)]
        offset_l_per_min: f64,
    },
}

/// A pressure sensor with a linear voltage output.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sensor {
    /// The volume it is screwed into.
    pub volume: String,
    /// The column of recordings that holds its reading, in gauge kPa.
    pub column: String,
    /// Gauge pressures in kPa at the two ends of the voltage range.
    pub range_kpa_gauge: [f64; 2],
    /// Voltages at the two ends.
    pub range_v: [f64; 2],
}

/// A mechanism and the component it is attached to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MechanismInstance {
    /// Name of a volume, pump, valve, line or sensor; `rig` for what all of them share.
    pub component: String,
    /// Off keeps it in the file without effect.
    #[serde(default = "yes", skip_serializing_if = "is_true")]
    pub enabled: bool,
    /// Effect.
    #[serde(flatten)]
    pub mechanism: Mechanism,
}

fn atmosphere() -> String {
    ATMOSPHERE.to_owned()
}

fn yes() -> bool {
    true
}

fn is_true(value: &bool) -> bool {
    *value
}

fn is_false(value: &bool) -> bool {
    !*value
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}
