//! Chambers, what hangs on them, and tabled flows into them.

use super::{Assembly, KPA, LITRE, MM2, MS, mechanisms_on};
use crate::mechanism::{self, Mechanism};
use crate::plant::MOST_RESIDUALS;
use crate::plant::elements::{Capillary, Compliant, Isothermal, Joined, Muscle, Thermal};
use crate::plant::lag::Share;
use crate::plant::residual::{Probe, Residual, Target, Variable};
use crate::rig::{Rig, RigError, Volume};

const MILLIGRAM: f64 = 1e-6;
/// In m³: a pump moves it by less than a pascal in the step of a held rig.
const HELD_VOLUME: f64 = 0.1;
/// m/s².
const STANDARD_GRAVITY: f64 = 9.80665;

impl Assembly<'_> {
    pub(super) fn chambers(&mut self) -> Result<(), RigError> {
        for (node, (name, volume)) in self.rig.volumes.iter().enumerate() {
            for mechanism in mechanisms_on(self.rig, name) {
                let leak = match mechanism {
                    Mechanism::ChamberLeak(m) => Some((self.given_from, m.conductance_kg_per_s_pa2)),
                    Mechanism::CrossLeak(m) => Some((self.node(&m.to), m.conductance_kg_per_s_pa2)),
                    _ => None,
                };
                if let Some((down, conductance)) = leak {
                    self.plant.capillaries.push(Capillary { up: node, down, conductance });
                }
            }
            let rt = self.plant.gas_constant * volume.temperature_k;
            if self.held {
                self.plant.isothermal.push(Isothermal { node, pressure_per_mass: rt / HELD_VOLUME });
                continue;
            }
            let Size { volume: at_atmosphere, compliance, moves, wall_conductance } = self.size(name, volume);
            let volume_at_vacuum = at_atmosphere - compliance * self.plant.atmosphere_pa;
            if let Some(wall_conductance) = wall_conductance {
                let temperature = self.plant.states;
                self.plant.states += 1;
                self.plant.thermal.push(Thermal {
                    node,
                    temperature,
                    volume_at_vacuum,
                    compliance,
                    wall_conductance,
                    wall_temperature: volume.temperature_k,
                });
            } else if moves {
                self.plant.compliant.push(Compliant { node, rt, volume_at_vacuum, compliance });
            } else {
                self.plant.isothermal.push(Isothermal { node, pressure_per_mass: rt / at_atmosphere });
            }
        }
        Ok(())
    }

    /// A chamber with what its mechanisms do to it.
    pub(super) fn size(&self, name: &str, volume: &Volume) -> Size {
        let mut compliance_ml_per_kpa = volume.compliance_ml_per_kpa;
        let mut volume_l = volume.volume_l;
        let mut moves = compliance_ml_per_kpa > 0.0 || has_muscle(self.rig, name);
        let mut wall_conductance = None;
        for mechanism in mechanisms_on(self.rig, name) {
            match mechanism {
                Mechanism::ChamberThermal(m) => wall_conductance = Some(m.wall_conductance_w_per_k),
                Mechanism::VolumeCompliance(m) => {
                    compliance_ml_per_kpa += m.compliance_ml_per_kpa;
                    moves = true;
                }
                Mechanism::VolumeChange(m) if m.is_later() => moves = true,
                Mechanism::VolumeChange(m) => volume_l += m.extra_volume_l,
                _ => {}
            }
        }
        Size { volume: volume_l * LITRE, compliance: compliance_ml_per_kpa * 1e-9, moves, wall_conductance }
    }

    pub(super) fn joined(&mut self) {
        if self.held {
            return;
        }
        for attached in self.rig.mechanisms.iter().filter(|m| m.enabled) {
            let Mechanism::VolumeChange(m) = &attached.mechanism else { continue };
            if !m.is_later() {
                continue;
            }
            let volume = self.plant.states;
            self.plant.states += 1;
            let temperature = self.rig.atmosphere.temperature_k;
            self.plant.joined.push(Joined {
                node: self.node(&attached.component),
                volume,
                whole: m.extra_volume_l * LITRE,
                begins_s: m.begins_s,
                brings: m.brings_kpa_abs * KPA / (self.plant.gas_constant * temperature),
                temperature,
            });
        }
    }

    pub(super) fn muscles(&mut self) {
        for attached in self.rig.mechanisms.iter().filter(|m| m.enabled) {
            let Mechanism::ActuatorLoad(m) = &attached.mechanism else { continue };
            let contraction = self.plant.states;
            self.plant.states += 1;
            self.plant.muscles.push(Muscle {
                gains: self.node(&attached.component),
                loses: self.node(&m.vacuum),
                contraction,
                area: m.area_cm2 * 1e-4,
                weight: m.payload_kg * STANDARD_GRAVITY,
                inverse_stiffness: 1e-3 / m.stiffness_n_per_mm,
                stroke: m.stroke_mm * 1e-3,
                inverse_time: 1.0 / (m.time_constant_ms * MS),
            });
        }
    }

    pub(super) fn residuals(&mut self) -> Result<(), RigError> {
        for attached in self.rig.mechanisms.iter().filter(|m| m.enabled) {
            let Mechanism::ResidualFlow(m) = &attached.mechanism else { continue };
            let index = self.plant.residuals.len();
            if index == MOST_RESIDUALS {
                return Err(RigError::at("mechanisms", format!("more than {MOST_RESIDUALS} residual flows")));
            }
            let (target, unit) = match self.rig.volumes.get_index_of(&attached.component) {
                Some(node) => (Target::Node(node), MILLIGRAM),
                None => {
                    let command = self.rig.valves.get_index_of(&attached.component);
                    let vent = self.plant.shaped_vents.iter_mut().find(|v| Some(v.command) == command);
                    if let Some(vent) = vent {
                        vent.residual = Some(index);
                    }
                    (Target::Area, MM2)
                }
            };
            let probes = m.axes.iter().map(|axis| self.probe(axis)).collect();
            let temperature = self.rig.atmosphere.temperature_k;
            self.plant.residuals.push(Residual { target, probes, table: m.table(unit), temperature });
        }
        Ok(())
    }

    pub(super) fn probe(&mut self, axis: &mechanism::Axis) -> Probe<f64> {
        let variable = match (axis.variable, self.rig.valves.get_full(&axis.of)) {
            (mechanism::Variable::Duty, Some((command, _, _))) => Variable::Duty { command },
            (mechanism::Variable::Difference, Some((_, _, valve))) => {
                Variable::Difference { up: self.node(&valve.from), down: self.node(&valve.to) }
            }
            _ => Variable::Pressure { node: self.node(&axis.of) },
        };
        let memory = axis.time_constant_ms.map(|_| self.memory);
        self.memory += usize::from(memory.is_some());
        let Share { approach, ahead } =
            axis.time_constant_ms.map_or(Share::whole(), |lag| Share::of(lag * MS, self.plant.step_s));
        Probe { variable, memory, departure: axis.departure, approach, ahead }
    }
}

/// A chamber in SI units.
pub(super) struct Size {
    /// At atmospheric pressure, in m³.
    pub(super) volume: f64,
    /// dV/dP in m³/Pa.
    pub(super) compliance: f64,
    /// True where its walls move (by however little).
    pub(super) moves: bool,
    /// Heat passed to the wall in W/K, where it has an energy balance.
    pub(super) wall_conductance: Option<f64>,
}

/// Tells whether a muscle hangs on a volume.
fn has_muscle(rig: &Rig, volume: &str) -> bool {
    rig.mechanisms.iter().filter(|m| m.enabled).any(|attached| match &attached.mechanism {
        Mechanism::ActuatorLoad(m) => attached.component == volume || m.vacuum == volume,
        _ => false,
    })
}
