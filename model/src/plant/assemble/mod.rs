//! From a checked rig to flat arrays in SI units.

use super::elements::Given;
use super::{Input, LAWS, MEMORY, MOST_GIVEN, MOST_STATES, NODES, Plant, carried};
use crate::averaged::PumpTables;
use crate::mechanism::{Mechanism, Rubs};
use crate::orifice::FlowFunction;
use crate::rig::{ATMOSPHERE, Pump, Rig, RigError, Source};

mod bundle;
mod chambers;
mod commands;
mod flow_paths;
mod pumps;
mod sensors;

// SI per unit of the file.
const MM2: f64 = 1e-6;
const LITRE: f64 = 1e-3;
const KPA: f64 = 1e3;
const MS: f64 = 1e-3;

impl Plant<f64> {
    /// Compiles a rig.
    ///
    /// # Errors
    /// If the rig fails its checks, or has more states, places or memory than the fixed arrays hold.
    pub fn new(rig: &Rig) -> Result<Self, RigError> {
        rig.check()?;
        let steps = (rig.integrator.tick_ms / rig.integrator.step_ms).round() as usize;
        Assembly::new(rig, steps, None)?.finish()
    }

    /// Compiles a rig with its piston pumps averaged over a revolution (see [`crate::averaged`]), for steps of about
    /// `step_ms` (a whole number of them to a tick; 5 suits the paper's rig, 2 is ample).
    ///
    /// Worked-out pumps are looked for in `tables` and left there. A rig without piston pumps is compiled as it is.
    ///
    /// # Errors
    /// As [`Plant::new`], or if `step_ms` is not between 0.01 and a tick.
    pub fn averaged(rig: &Rig, step_ms: f64, tables: &PumpTables) -> Result<Self, RigError> {
        let tick_ms = rig.integrator.tick_ms;
        crate::rig::within("step_ms", step_ms, 0.01, tick_ms, "ms", "a tick at most")?;
        if !rig.pumps.values().any(|pump| matches!(pump, Pump::Piston(_))) {
            return Plant::new(rig);
        }
        rig.check()?;
        let steps = (tick_ms / step_ms).round().max(1.0) as usize;
        Assembly::new(rig, steps, Some(tables))?.finish()
    }
}

/// A plant in the making.
struct Assembly<'a> {
    rig: &'a Rig,
    plant: Plant<f64>,
    /// Node of the first place whose pressure is given.
    given_from: usize,
    memory: usize,
    /// Outflow functions in use.
    laws: usize,
    /// Where the tables of averaged pumps come from; `None` for pumps in full detail.
    tables: Option<&'a PumpTables>,
    /// True where chambers keep their pressures whatever flows in.
    held: bool,
}

impl<'a> Assembly<'a> {
    fn new(rig: &'a Rig, steps: usize, tables: Option<&'a PumpTables>) -> Result<Self, RigError> {
        let gas_constant = rig.gas.gas_constant_j_per_kg_k;
        let kappa = rig.gas.heat_capacity_ratio;
        let averaged = tables.is_some();
        let has_pistons = rig.pumps.values().any(|pump| matches!(pump, Pump::Piston(_)));
        let cylinders = rig.pumps.values().map(|pump| match pump {
            // An averaged pump has one state, the gas in it.
            Pump::Piston(_) if averaged => 1,
            Pump::Piston(p) => p.phases_deg.len(),
            Pump::Flow(_) => 0,
        });
        let enabled = || rig.mechanisms.iter().filter(|m| m.enabled).map(|m| &m.mechanism);
        let own_state = |m: &&Mechanism| match m {
            Mechanism::ChamberThermal(_) | Mechanism::ActuatorLoad(_) => true,
            Mechanism::VolumeChange(m) => m.is_later(),
            _ => false,
        };
        let states = rig.volumes.len() + cylinders.sum::<usize>() + enabled().filter(own_state).count();
        let extended = (averaged && has_pistons) || enabled().any(extends_the_balances);
        if states > MOST_STATES {
            return Err(RigError::at(
                "",
                format!(
                    "the rig has {states} states (volumes, cylinders, temperatures, muscles); {MOST_STATES} at most"
                ),
            ));
        }
        let plant = Plant {
            inputs: Vec::new(),
            chamber_names: rig.volumes.keys().cloned().collect(),
            sensor_columns: rig.sensors.values().map(|s| s.column.clone()).collect(),
            // Divided, not multiplied: 20 ms in 200 steps is 1e-4 s to the last bit.
            step_s: rig.integrator.tick_ms * MS / steps as f64,
            steps,
            refine: rig.integrator.refine_switching,
            states: 0,
            chambers: rig.volumes.len(),
            gas_constant,
            heat_capacity_ratio: kappa,
            atmosphere_pa: rig.atmosphere.pressure_kpa_abs * KPA,
            temperature: [rig.atmosphere.temperature_k; NODES],
            inverse_speed: [0.0; NODES],
            laws: [FlowFunction::nozzle(kappa); LAWS],
            extended,
            passages: Vec::new(),
            spring_checks: Vec::new(),
            vents: Vec::new(),
            shaped_vents: Vec::new(),
            capillaries: Vec::new(),
            parabolics: Vec::new(),
            residuals: Vec::new(),
            muscles: Vec::new(),
            joined: Vec::new(),
            averaged: Vec::new(),
            mean_duties: averaged && extended,
            sags: Vec::new(),
            displacements: Vec::new(),
            feeds: Vec::new(),
            given: Vec::new(),
            isothermal: Vec::new(),
            compliant: Vec::new(),
            thermal: Vec::new(),
            cylinders: Vec::new(),
            drives: Vec::new(),
            commands: Vec::new(),
            sensors: Vec::new(),
            like: Vec::new(),
            unknowns: Vec::new(),
        };
        let mut assembly =
            Assembly { rig, plant, given_from: carried(states), memory: 0, laws: 1, tables, held: false };
        assembly.places()?;
        Ok(assembly)
    }

    fn finish(mut self) -> Result<Plant<f64>, RigError> {
        self.valves()?;
        self.pumps()?;
        self.lines()?;
        self.feeds()?;
        self.chambers()?;
        self.muscles();
        self.joined();
        self.residuals()?;
        self.sensors()?;
        if self.memory > MEMORY {
            return Err(RigError::at(
                "mechanisms",
                format!("the mechanisms remember {} numbers; {MEMORY} at most", self.memory),
            ));
        }
        for (speed, temperature) in self.plant.inverse_speed.iter_mut().zip(self.plant.temperature) {
            *speed = 1.0 / (self.plant.gas_constant * temperature).sqrt();
        }
        Ok(self.plant)
    }

    /// Numbers the places: chambers from 0, given pressures after the last state that is carried.
    fn places(&mut self) -> Result<(), RigError> {
        let atmosphere = self.plant.atmosphere_pa;
        self.plant.states = self.rig.volumes.len();
        for (node, volume) in self.rig.volumes.values().enumerate() {
            if let Some(temperature) = self.plant.temperature.get_mut(node) {
                *temperature = volume.temperature_k;
            }
        }
        self.plant.given.push(Given { node: self.given_from, command: None, atmosphere, gauge: 0.0 });
        for (name, source) in &self.rig.sources {
            if let Source::Pressure { pressure_kpa_gauge, temperature_k, signal } = source {
                let node = self.given_from + self.plant.given.len();
                let slot =
                    if self.plant.given.len() < MOST_GIVEN { self.plant.temperature.get_mut(node) } else { None };
                let Some(temperature) = slot else {
                    return Err(RigError::at(
                        format!("sources.{name}"),
                        format!("more than {} pressure sources", MOST_GIVEN - 1),
                    ));
                };
                *temperature = *temperature_k;
                let command = signal.as_deref().map(|s| input(&mut self.plant.inputs, s, None));
                self.plant.given.push(Given { node, command, atmosphere, gauge: pressure_kpa_gauge * KPA });
            }
        }
        Ok(())
    }

    /// The node of a place that joins were checked against.
    fn node(&self, place: &str) -> usize {
        if place == ATMOSPHERE {
            return self.given_from;
        }
        let source = || {
            let pressures = self.rig.sources.iter().filter(|(_, s)| matches!(s, Source::Pressure { .. }));
            pressures.into_iter().position(|(name, _)| name == place).map(|i| self.given_from + 1 + i)
        };
        self.rig.volumes.get_index_of(place).or_else(source).unwrap_or(self.given_from)
    }
}

/// Tells whether a mechanism adds to the balances what the smallest integrator is not compiled for.
fn extends_the_balances(mechanism: &Mechanism) -> bool {
    match mechanism {
        Mechanism::ChamberThermal(_)
        | Mechanism::CheckValveCracking(_)
        | Mechanism::ValveForceCurve(_)
        | Mechanism::ExhaustRestriction(_)
        | Mechanism::ActuatorLoad(_)
        | Mechanism::ResidualFlow(_) => true,
        Mechanism::VolumeChange(m) => m.is_later(),
        Mechanism::ValveStiction(m) => m.rubs == Rubs::Flapper,
        // On a pump it is a smaller check valve.
        Mechanism::LineResistance(m) => m.port.is_none(),
        _ => false,
    }
}

/// The mechanisms that act on a component.
fn mechanisms_on<'r>(rig: &'r Rig, component: &'r str) -> impl Iterator<Item = &'r Mechanism> {
    rig.mechanisms.iter().filter(move |m| m.enabled && m.component == component).map(|m| &m.mechanism)
}

/// The duty below which nothing flows through a component, as its mechanisms have it.
fn dead_zone(rig: &Rig, component: &str) -> f64 {
    mechanisms_on(rig, component).map(|m| if let Mechanism::DeadZone(m) = m { m.closed_duty } else { 0.0 }).sum()
}

/// The index of an input column, added where it is new.
fn input(inputs: &mut Vec<Input>, column: &str, default: Option<f64>) -> usize {
    inputs.iter().position(|i| i.column == column).unwrap_or_else(|| {
        inputs.push(Input { column: column.to_owned(), default });
        inputs.len() - 1
    })
}
