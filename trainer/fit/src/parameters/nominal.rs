//! The parameters of the paper's physics, with priors from what such parts scatter by.
//!
//! A prior is what a build sheet would say. It matters only along combinations that the recordings do not determine
//! (volume over gas temperature; speed times piston area), where it keeps the fit at what was built instead of
//! anywhere on a line. What two parameters do in exactly the same way is therefore freed in one of them only:
//! chamber temperature acts as volume, nozzle diameter as Ĉ_P, piston area as speed.

use model::rig::{Line, Pump, Rig, Source};

use super::parameter::Parameter;

/// Scatter of parts, as shares unless a unit is named.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scatter {
    /// Chambers: fittings and hoses add a few per cent.
    pub volume: f64,
    /// Each of Ĉ_u, Ĉ_P and Ĉ_k: coil resistance, nozzle, spring preload.
    pub valve: f64,
    /// Check-valve areas: reeds scatter from piece to piece.
    pub check_valve: f64,
    /// Displacement (piston area).
    pub displacement: f64,
    /// Clearance δ − 2r at dead centre.
    pub clearance: f64,
    /// Gas temperature in the cylinders.
    pub pump_temperature: f64,
    /// Pressure of the atmosphere in kPa: weather and height.
    pub atmosphere_kpa: f64,
    /// Areas and resistances of lines, flows of pumps given by their displacement.
    pub line: f64,
    /// Compliance of walls, where they give way: rubber, or the spring of a test lung.
    pub compliance: f64,
    /// Zero of a flow meter, as a share of what it shows at a signal of 1.
    pub meter_zero: f64,
}

impl Default for Scatter {
    fn default() -> Self {
        Scatter {
            volume: 0.05,
            valve: 0.05,
            check_valve: 0.10,
            displacement: 0.03,
            clearance: 0.10,
            pump_temperature: 0.03,
            atmosphere_kpa: 0.5,
            line: 0.3,
            compliance: 0.1,
            meter_zero: 0.01,
        }
    }
}

/// The free parameters of a rig without its mechanisms.
pub fn nominal(rig: &Rig, scatter: Scatter) -> Vec<Parameter> {
    let mut parameters = Vec::new();
    for (name, volume) in &rig.volumes {
        parameters.push(Parameter::log(format!("volumes.{name}.volume_l"), volume.volume_l, scatter.volume));
        let compliance = volume.compliance_ml_per_kpa;
        let key = format!("volumes.{name}.compliance_ml_per_kpa");
        // Left out of a rig file it is not zero by measurement, but a wall taken to be rigid: a mechanism's matter.
        parameters.push(Parameter::log(key, compliance, scatter.compliance));
    }
    for (name, valve) in &rig.valves {
        for (key, mean) in [
            ("input_area_mm2", valve.input_area_mm2),
            ("pressure_area_mm2_per_n", valve.pressure_area_mm2_per_n),
            ("spring_area_mm2", valve.spring_area_mm2),
        ] {
            if mean > 0.0 {
                parameters.push(Parameter::log(format!("valves.{name}.{key}"), mean, scatter.valve));
            }
        }
    }
    for (name, pump) in &rig.pumps {
        match pump {
            Pump::Piston(p) => {
                let dead_mm = p.effective_length_mm - 2.0 * p.crank_radius_mm;
                let clearance = format!("pumps.{name}.effective_length_mm");
                parameters.extend([
                    Parameter::log(
                        format!("pumps.{name}.inlet_check_area_mm2"),
                        p.inlet_check_area_mm2,
                        scatter.check_valve,
                    ),
                    Parameter::log(
                        format!("pumps.{name}.outlet_check_area_mm2"),
                        p.outlet_check_area_mm2,
                        scatter.check_valve,
                    ),
                    Parameter::log(format!("pumps.{name}.head_area_cm2"), p.head_area_cm2, scatter.displacement),
                    // A cylinder whose clearance is gone would compress to nothing.
                    Parameter::linear(clearance, p.effective_length_mm, scatter.clearance * dead_mm)
                        .within(p.effective_length_mm - 0.7 * dead_mm, p.effective_length_mm + 2.0 * dead_mm),
                    Parameter::log(
                        format!("pumps.{name}.gas_temperature_k"),
                        p.gas_temperature_k,
                        scatter.pump_temperature,
                    )
                    .within(250.0, 450.0),
                ]);
            }
            Pump::Flow(p) => {
                parameters.push(Parameter::log(format!("pumps.{name}.flow_l_per_min"), p.flow_l_per_min, scatter.line));
            }
        }
    }
    for (name, line) in &rig.lines {
        parameters.push(match line {
            Line::Orifice { area_mm2, .. } => Parameter::log(format!("lines.{name}.area_mm2"), *area_mm2, scatter.line),
            Line::Laminar { resistance_kpa_s_per_l, .. } => {
                Parameter::log(format!("lines.{name}.resistance_kpa_s_per_l"), *resistance_kpa_s_per_l, scatter.line)
            }
        });
    }
    for (name, source) in &rig.sources {
        if let Source::Flow { signal: Some(_), flow_l_per_min, offset_l_per_min, .. } = source {
            // An error of its gain acts as another volume and resistance; its zero acts as nothing else does.
            let sd = scatter.meter_zero * flow_l_per_min.abs();
            parameters.push(Parameter::linear(format!("sources.{name}.offset_l_per_min"), *offset_l_per_min, sd));
        }
    }
    let open = rig.valves.len() + rig.lines.len() > 0;
    if open {
        let kpa = rig.atmosphere.pressure_kpa_abs;
        parameters.push(Parameter::linear("atmosphere.pressure_kpa_abs", kpa, scatter.atmosphere_kpa));
    }
    parameters.retain(|p| p.transform == super::Transform::Linear || p.mean > 0.0);
    parameters.into_iter().map(|parameter| accepted(rig, parameter)).collect()
}

/// The factor by which an end of a range is brought nearer until a rig file may hold it.
const NEARER: f64 = 1.25;

/// A parameter with its bounds where a rig file may hold them.
fn accepted(rig: &Rig, mut parameter: Parameter) -> Parameter {
    if parameter.transform == super::Transform::Linear {
        return parameter;
    }
    let mean = parameter.mean;
    let holds = |value: f64| rig.clone().set_value(&parameter.path, value).is_ok();
    let [mut low, mut high] = parameter.bounds;
    while low < mean && !holds(low) {
        low = (low * NEARER).min(mean);
    }
    while high > mean && !holds(high) {
        high = (high / NEARER).max(mean);
    }
    parameter.bounds = [low, high];
    parameter
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameters::ParameterSet;

    #[test]
    fn every_parameter_is_one_of_the_rigs_and_stands_at_its_value() {
        for name in Rig::BUILTIN {
            let rig = Rig::builtin(name).unwrap();
            let set = ParameterSet::new(&rig, nominal(&rig, Scatter::default())).unwrap();
            // Two volumes, three coefficients of each valve, five of the pump, the atmosphere.
            assert_eq!(set.len(), 14);
            assert_eq!(set.rig_at(&set.origin()).unwrap(), rig);
            let shifted = set.rig_at(&vec![0.5; set.len()]).unwrap();
            for z in set.point_of(&shifted).unwrap() {
                assert!((z - 0.5).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn bounds_are_wide_and_a_rig_file_may_hold_them() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        for parameter in nominal(&rig, Scatter::default()) {
            for bound in parameter.bounds {
                let mut with = rig.clone();
                with.set_value(&parameter.path, bound).unwrap();
            }
        }
        let volume = nominal(&rig, Scatter::default()).swap_remove(0);
        // 100 L is the most that a rig file holds.
        assert!(volume.path == "volumes.positive.volume_l" && (80.0..=100.0).contains(&volume.bounds[1]), "{volume:?}");
    }
}
