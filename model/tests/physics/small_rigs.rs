//! Rigs small enough for a formula: what they share.

use std::sync::Arc;

use model::plant::{Plant, Simulation};
use model::rig::Rig;

/// Gas constant of air in J/(kg K).
pub(crate) const R: f64 = 287.0;
/// κ of air.
pub(crate) const KAPPA: f64 = 1.4;
/// Pressure of the atmosphere in Pa.
pub(crate) const ATMOSPHERE: f64 = 101_325.0;
/// Temperature of chambers and atmosphere in K.
pub(crate) const T: f64 = 293.15;
/// Length of a tick in s.
pub(crate) const TICK_S: f64 = 0.02;

/// Φ of a choked orifice, eq. (3).
pub(crate) fn choked(kappa: f64) -> f64 {
    (kappa * (2.0 / (kappa + 1.0)).powf((kappa + 1.0) / (kappa - 1.0))).sqrt()
}

/// Pressure ratio at and below which an orifice is choked, eq. (3).
pub(crate) fn critical(kappa: f64) -> f64 {
    (2.0 / (kappa + 1.0)).powf(kappa / (kappa - 1.0))
}

/// Eq. (3) as printed, for one square metre and `R·T_up` in J/kg: kg/s.
pub(crate) fn printed_flow(kappa: f64, p_up: f64, p_down: f64, rt_up: f64) -> f64 {
    let p = p_down / p_up;
    let phi = if p > 1.0 {
        0.0
    } else if p <= critical(kappa) {
        choked(kappa)
    } else {
        (2.0 * kappa / (kappa - 1.0) * (p.powf(2.0 / kappa) - p.powf((kappa + 1.0) / kappa))).sqrt()
    };
    p_up / rt_up.sqrt() * phi
}

/// A rig in air with the given parts, in the words of a rig file.
pub(crate) fn rig(parts: &str) -> Rig {
    let text = format!(
        "format = 1\nname = \"small\"\n\
         gas = {{ gas_constant_j_per_kg_k = {R}, heat_capacity_ratio = {KAPPA} }}\n\
         atmosphere = {{ pressure_kpa_abs = 101.325, temperature_k = {T} }}\n{parts}"
    );
    Rig::from_toml(&text).unwrap_or_else(|e| panic!("{e} in\n{text}"))
}

/// A chamber of the given volume, and its sensor.
pub(crate) fn chamber(name: &str, volume_l: f64) -> String {
    format!(
        "[volumes.{name}]\nvolume_l = {volume_l}\ntemperature_k = {T}\n\
         [sensors.sensor_{name}]\nvolume = \"{name}\"\ncolumn = \"{name}_kpa\"\n\
         range_kpa_gauge = [0.0, 1000.0]\nrange_v = [1.0, 5.0]\n"
    )
}

/// A source of constant pressure (absolute, in Pa) and temperature.
pub(crate) fn source(name: &str, pressure_pa: f64, temperature_k: f64) -> String {
    let gauge = (pressure_pa - ATMOSPHERE) / 1e3;
    format!(
        "[sources.{name}]\nkind = \"pressure\"\npressure_kpa_gauge = {gauge:.17}\ntemperature_k = {temperature_k}\n"
    )
}

/// An orifice, both ways.
pub(crate) fn orifice(from: &str, to: &str, area_mm2: f64) -> String {
    format!("[lines.{from}_{to}]\nkind = \"orifice\"\nfrom = \"{from}\"\nto = \"{to}\"\narea_mm2 = {area_mm2}\n")
}

/// A valve whose area is its duty in mm², whatever the pressure.
pub(crate) fn plain_valve(name: &str, from: &str, to: &str) -> String {
    format!(
        "[valves.{name}]\nfrom = \"{from}\"\nto = \"{to}\"\ncommand = \"u_{name}\"\ninput_area_mm2 = 1.0\n\
         pressure_area_mm2_per_n = 0.0\nspring_area_mm2 = 0.0\nnozzle_diameter_mm = 1.0\n"
    )
}

/// A mechanism with its parameter.
pub(crate) fn mechanism(id: &str, component: &str, parameter: &str) -> String {
    format!("[[mechanisms]]\nid = \"{id}\"\ncomponent = \"{component}\"\n{parameter}\n")
}

/// The rig in motion, at rest so far.
pub(crate) fn simulation(rig: &Rig) -> Simulation<f64> {
    Simulation::new(Arc::new(Plant::new(rig).unwrap()))
}
