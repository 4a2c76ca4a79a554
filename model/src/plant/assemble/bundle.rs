//! Rigs of one structure side by side, one in each lane.

use super::Assembly;
use crate::averaged::PumpTables;
use crate::orifice::FlowFunction;
use crate::plant::Plant;
use crate::plant::command::CommandPath;
use crate::plant::elements::{
    AveragedPump, Capillary, Compliant, Cylinder, Displacement, Drive, Feed, Given, Isothermal, Joined, Muscle,
    Parabolic, Passage, Sag, ShapedVent, SpringCheck, Thermal, Vent, lanes_of,
};
use crate::plant::residual::Residual;
use crate::plant::sensor::SensorPath;
use crate::real::Real;
use crate::rig::{Rig, RigError};

impl<R: Real> Plant<R> {
    /// Lays rigs of one structure side by side, one per lane; lanes beyond the last repeat it.
    ///
    /// # Errors
    /// If there are none, more than lanes, or if they differ in more than numbers.
    pub fn side_by_side(rigs: &[Rig]) -> Result<Self, RigError> {
        Self::together(&rigs.iter().map(Plant::new).collect::<Result<Vec<_>, _>>()?)
    }

    /// [`Plant::averaged`] for rigs of one structure, one per lane; lanes beyond the last repeat it.
    ///
    /// # Errors
    /// As [`Plant::averaged`] and [`Plant::side_by_side`].
    pub fn averaged_side_by_side(rigs: &[Rig], step_ms: f64, tables: &PumpTables) -> Result<Self, RigError> {
        let parts = rigs.iter().map(|rig| Plant::averaged(rig, step_ms, tables)).collect::<Result<Vec<_>, _>>()?;
        Self::together(&parts)
    }

    /// Bundle of rigs that are compiled already.
    ///
    /// # Errors
    /// As [`Plant::side_by_side`].
    pub fn together(parts: &[Plant<f64>]) -> Result<Self, RigError> {
        if parts.is_empty() || parts.len() > R::LANES {
            return Err(RigError::at("", format!("{} rigs for {} lanes", parts.len(), R::LANES)));
        }
        Self::merge(parts).ok_or_else(|| {
            RigError::at(
                "",
                "the rigs differ in structure (components, joins or mechanisms); only numbers may differ between lanes",
            )
        })
    }

    /// A rig with averaged pumps whose chambers are all rigid and so large that nothing moves their pressures, as a
    /// meter of what flows into each; pumps breathe as in the rig itself.
    ///
    /// # Errors
    /// If the rig fails its checks, or does not fit the fixed arrays.
    pub(crate) fn held(rig: &Rig, tables: &PumpTables) -> Result<Self, RigError> {
        rig.check()?;
        let mut assembly = Assembly::new(rig, 1, Some(tables))?;
        assembly.held = true;
        // Long enough for rounding not to matter, short enough for the pressures not to.
        assembly.plant.step_s = 1e-3;
        let one = assembly.finish()?;
        Self::together(&[one])
    }

    fn merge(parts: &[Plant<f64>]) -> Option<Self> {
        let first = parts.first()?;
        macro_rules! same {
            ($($field:ident),*) => { $(if parts.iter().any(|p| p.$field != first.$field) { return None; })* };
        }
        same!(
            inputs,
            chamber_names,
            sensor_columns,
            step_s,
            steps,
            refine,
            mean_duties,
            extended,
            states,
            chambers,
            like
        );
        macro_rules! number {
            ($field:ident) => {
                lanes_of(parts, |p| p.$field)
            };
        }
        macro_rules! records {
            ($field:ident, $merge:expr) => {{
                if parts.iter().any(|p| p.$field.len() != first.$field.len()) {
                    return None;
                }
                (0..first.$field.len())
                    .map(|i| $merge(&parts.iter().filter_map(|p| p.$field.get(i).cloned()).collect::<Vec<_>>()))
                    .collect::<Option<Vec<_>>>()?
            }};
        }
        Some(Plant {
            inputs: first.inputs.clone(),
            chamber_names: first.chamber_names.clone(),
            sensor_columns: first.sensor_columns.clone(),
            step_s: first.step_s,
            steps: first.steps,
            refine: first.refine,
            states: first.states,
            chambers: first.chambers,
            gas_constant: number!(gas_constant),
            heat_capacity_ratio: number!(heat_capacity_ratio),
            atmosphere_pa: number!(atmosphere_pa),
            temperature: std::array::from_fn(|i| lanes_of(parts, |p| p.temperature[i])),
            inverse_speed: std::array::from_fn(|i| lanes_of(parts, |p| p.inverse_speed[i])),
            laws: std::array::from_fn(|i| {
                FlowFunction::from_lanes(&parts.iter().filter_map(|p| p.laws.get(i).copied()).collect::<Vec<_>>())
            }),
            extended: first.extended,
            passages: records!(passages, Passage::side_by_side),
            spring_checks: records!(spring_checks, SpringCheck::side_by_side),
            vents: records!(vents, Vent::side_by_side),
            shaped_vents: records!(shaped_vents, ShapedVent::side_by_side),
            capillaries: records!(capillaries, Capillary::side_by_side),
            parabolics: records!(parabolics, Parabolic::side_by_side),
            residuals: records!(residuals, Residual::side_by_side),
            muscles: records!(muscles, Muscle::side_by_side),
            joined: records!(joined, Joined::side_by_side),
            averaged: records!(averaged, AveragedPump::side_by_side),
            mean_duties: first.mean_duties,
            sags: records!(sags, Sag::side_by_side),
            displacements: records!(displacements, Displacement::side_by_side),
            feeds: records!(feeds, Feed::side_by_side),
            given: records!(given, Given::side_by_side),
            isothermal: records!(isothermal, Isothermal::side_by_side),
            compliant: records!(compliant, Compliant::side_by_side),
            thermal: records!(thermal, Thermal::side_by_side),
            cylinders: records!(cylinders, Cylinder::side_by_side),
            drives: records!(drives, Drive::side_by_side),
            commands: records!(commands, |paths: &[CommandPath<f64>]| CommandPath::side_by_side(
                &paths.iter().collect::<Vec<_>>()
            )),
            sensors: records!(sensors, SensorPath::side_by_side),
            like: first.like.clone(),
            unknowns: first.unknowns.clone(),
        })
    }
}
