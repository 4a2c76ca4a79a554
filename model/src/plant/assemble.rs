//! From a checked rig to flat arrays in SI units.

use super::command::{CommandPath, Stage};
use super::elements::{
    Capillary, Compliant, Cylinder, Displacement, Drive, Feed, Given, Isothermal, Passage, SensorPath, Thermal, Vent,
    lanes_of,
};
use super::{Input, LAWS, MEMORY, MOST_DRIVES, MOST_GIVEN, MOST_STATES, NODES, Plant, carried};
use crate::mechanism::Mechanism;
use crate::orifice::FlowFunction;
use crate::real::Real;
use crate::rig::{ATMOSPHERE, Attached, Line, Pump, Rig, RigError, Source};

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
        Assembly::new(rig)?.finish()
    }
}

impl<R: Real> Plant<R> {
    /// Lays rigs of one structure side by side, one per lane; lanes beyond the last repeat it.
    ///
    /// # Errors
    /// If there are none, more than lanes, or if they differ in more than numbers.
    pub fn side_by_side(rigs: &[Rig]) -> Result<Self, RigError> {
        let parts = rigs.iter().map(Plant::new).collect::<Result<Vec<_>, _>>()?;
        if parts.is_empty() || parts.len() > R::LANES {
            return Err(RigError::at("", format!("{} rigs for {} lanes", parts.len(), R::LANES)));
        }
        Self::merge(&parts).ok_or_else(|| {
            RigError::at(
                "",
                "the rigs differ in structure (components, joins or mechanisms); only numbers may differ between lanes",
            )
        })
    }

    fn merge(parts: &[Plant<f64>]) -> Option<Self> {
        let first = parts.first()?;
        macro_rules! same {
            ($($field:ident),*) => { $(if parts.iter().any(|p| p.$field != first.$field) { return None; })* };
        }
        same!(inputs, chamber_names, sensor_columns, step_s, steps, refine, states, chambers);
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
            passages: records!(passages, Passage::side_by_side),
            vents: records!(vents, Vent::side_by_side),
            capillaries: records!(capillaries, Capillary::side_by_side),
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
        })
    }
}

/// A plant in the making.
struct Assembly<'a> {
    rig: &'a Rig,
    plant: Plant<f64>,
    /// Node of the first place whose pressure is given.
    given_from: usize,
    memory: usize,
}

impl<'a> Assembly<'a> {
    fn new(rig: &'a Rig) -> Result<Self, RigError> {
        let gas_constant = rig.gas.gas_constant_j_per_kg_k;
        let kappa = rig.gas.heat_capacity_ratio;
        let steps = (rig.integrator.tick_ms / rig.integrator.step_ms).round() as usize;
        let cylinders = rig.pumps.values().map(|pump| if let Pump::Piston(p) = pump { p.phases_deg.len() } else { 0 });
        let thermal = |m: &&Attached| m.enabled && matches!(m.mechanism, Mechanism::ChamberThermal(_));
        let temperatures = rig.mechanisms.iter().filter(thermal).count();
        let states = rig.volumes.len() + cylinders.sum::<usize>() + temperatures;
        if states > MOST_STATES {
            return Err(RigError::at(
                "",
                format!("the rig has {states} states (volumes, cylinders, temperatures); {MOST_STATES} at most"),
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
            passages: Vec::new(),
            vents: Vec::new(),
            capillaries: Vec::new(),
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
        };
        let mut assembly = Assembly { rig, plant, given_from: carried(states, temperatures > 0), memory: 0 };
        assembly.places()?;
        Ok(assembly)
    }

    fn finish(mut self) -> Result<Plant<f64>, RigError> {
        self.valves()?;
        self.pumps()?;
        self.lines()?;
        self.feeds()?;
        self.chambers()?;
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

    fn valves(&mut self) -> Result<(), RigError> {
        for (name, valve) in &self.rig.valves {
            let (up, down) = (self.node(&valve.from), self.node(&valve.to));
            let nozzle = std::f64::consts::PI * (valve.nozzle_diameter_mm * 1e-3).powi(2) / 4.0;
            let mut stages: Vec<Stage<f64>> = mechanisms_on(self.rig, name)
                .filter_map(|mechanism| match mechanism {
                    Mechanism::CommandDelay(m) => Some(Stage::Delay(m.operator(self.rig.integrator.tick_ms))),
                    Mechanism::ValveLag(m) => Some(Stage::Lag(m.operator(self.plant.instant_s()))),
                    Mechanism::ValveHysteresis(m) => Some(Stage::Play(m.operator())),
                    _ => None,
                })
                .collect();
            stages.sort_by_key(Stage::rank);
            let command = self.plant.commands.len();
            let memory = self.memory;
            self.memory += stages.iter().map(Stage::memory_len).sum::<usize>();
            let input = input(&mut self.plant.inputs, &valve.command, None);
            self.plant.commands.push(CommandPath { input, memory, stages });
            self.plant.vents.push(Vent {
                up,
                down,
                law: 0,
                command,
                input_area: valve.input_area_mm2 * MM2,
                pressure_area: valve.pressure_area_mm2_per_n * MM2 * nozzle,
                spring_area: valve.spring_area_mm2 * MM2,
            });
        }
        Ok(())
    }

    fn pumps(&mut self) -> Result<(), RigError> {
        let gas_constant = self.plant.gas_constant;
        for (name, pump) in &self.rig.pumps {
            match pump {
                Pump::Piston(p) => {
                    let (inlet, outlet) = (self.node(&p.inlet), self.node(&p.outlet));
                    let drive = self.plant.drives.len();
                    if drive == MOST_DRIVES {
                        return Err(RigError::at(
                            format!("pumps.{name}"),
                            format!("more than {MOST_DRIVES} piston pumps"),
                        ));
                    }
                    let relay = p.relay.as_deref().map(|r| input(&mut self.plant.inputs, r, Some(1.0)));
                    self.plant.drives.push(Drive {
                        relay,
                        speed: p.speed_rpm / 60.0,
                        crank_radius: p.crank_radius_mm * 1e-3,
                        rod_length: p.rod_length_mm * 1e-3,
                        effective_length: p.effective_length_mm * 1e-3,
                        head_area: p.head_area_cm2 * 1e-4,
                        rt: gas_constant * p.gas_temperature_k,
                    });
                    for phase in &p.phases_deg {
                        let node = self.plant.states;
                        self.plant.states += 1;
                        if let Some(temperature) = self.plant.temperature.get_mut(node) {
                            *temperature = p.gas_temperature_k;
                        }
                        self.plant.cylinders.push(Cylinder { node, drive, phase: phase / 360.0 });
                        self.plant.passages.push(Passage {
                            up: inlet,
                            down: node,
                            law: 0,
                            area: p.inlet_check_area_mm2 * MM2,
                        });
                        self.plant.passages.push(Passage {
                            up: node,
                            down: outlet,
                            law: 0,
                            area: p.outlet_check_area_mm2 * MM2,
                        });
                    }
                }
                Pump::Flow(p) => {
                    let (up, down) = (self.node(&p.inlet), self.node(&p.outlet));
                    let command = p.command.as_deref().map(|c| input(&mut self.plant.inputs, c, None));
                    let rt = gas_constant * self.plant.temperature.get(up).copied().unwrap_or(f64::NAN);
                    self.plant.displacements.push(Displacement {
                        up,
                        down,
                        command,
                        flow: p.flow_l_per_min * LITRE / 60.0,
                        rt,
                    });
                }
            }
        }
        Ok(())
    }

    fn lines(&mut self) -> Result<(), RigError> {
        for line in self.rig.lines.values() {
            match line {
                Line::Orifice { from, to, area_mm2, one_way } => {
                    let (up, down, area) = (self.node(from), self.node(to), area_mm2 * MM2);
                    self.plant.passages.push(Passage { up, down, law: 0, area });
                    if !one_way {
                        self.plant.passages.push(Passage { up: down, down: up, law: 0, area });
                    }
                }
                Line::Laminar { from, to, resistance_kpa_s_per_l } => {
                    let (up, down) = (self.node(from), self.node(to));
                    let rt = self.plant.gas_constant * self.plant.temperature.get(up).copied().unwrap_or(f64::NAN);
                    let resistance = resistance_kpa_s_per_l * KPA / LITRE;
                    self.plant.capillaries.push(Capillary { up, down, conductance: 1.0 / (2.0 * rt * resistance) });
                }
            }
        }
        Ok(())
    }

    fn feeds(&mut self) -> Result<(), RigError> {
        let outside = self.rig.atmosphere.temperature_k;
        for source in self.rig.sources.values() {
            if let Source::Flow { to, flow_l_per_min, signal } = source {
                let down = self.node(to);
                let command = signal.as_deref().map(|s| input(&mut self.plant.inputs, s, None));
                let density = self.plant.atmosphere_pa / (self.plant.gas_constant * outside);
                let flow = flow_l_per_min * LITRE / 60.0 * density;
                self.plant.feeds.push(Feed { down, command, flow, temperature: outside });
            }
        }
        Ok(())
    }

    fn chambers(&mut self) -> Result<(), RigError> {
        for (node, (name, volume)) in self.rig.volumes.iter().enumerate() {
            let compliance = volume.compliance_ml_per_kpa * 1e-9;
            let rt = self.plant.gas_constant * volume.temperature_k;
            let volume_at_vacuum = volume.volume_l * LITRE - compliance * self.plant.atmosphere_pa;
            let mut wall_conductance = None;
            for mechanism in mechanisms_on(self.rig, name) {
                match mechanism {
                    Mechanism::ChamberThermal(m) => wall_conductance = Some(m.wall_conductance_w_per_k),
                    Mechanism::ChamberLeak(m) => self.plant.capillaries.push(Capillary {
                        up: node,
                        down: self.given_from,
                        conductance: m.conductance_kg_per_s_pa2,
                    }),
                    _ => {}
                }
            }
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
            } else if compliance > 0.0 {
                self.plant.compliant.push(Compliant { node, rt, volume_at_vacuum, compliance });
            } else {
                self.plant.isothermal.push(Isothermal { node, pressure_per_mass: rt / (volume.volume_l * LITRE) });
            }
        }
        Ok(())
    }

    fn sensors(&mut self) -> Result<(), RigError> {
        for (name, sensor) in &self.rig.sensors {
            let node = self.node(&sensor.volume);
            let lag = mechanisms_on(self.rig, name).find_map(|m| match m {
                Mechanism::SensorLag(m) => Some(m.approach(self.plant.step_s)),
                _ => None,
            });
            let memory = lag.map(|_| self.memory);
            self.memory += usize::from(lag.is_some());
            self.plant.sensors.push(SensorPath { node, memory, approach: lag.unwrap_or(1.0) });
        }
        Ok(())
    }
}

/// The mechanisms that act on a component.
fn mechanisms_on<'r>(rig: &'r Rig, component: &'r str) -> impl Iterator<Item = &'r Mechanism> {
    rig.mechanisms.iter().filter(move |m| m.enabled && m.component == component).map(|m| &m.mechanism)
}

/// The index of an input column, added where it is new.
fn input(inputs: &mut Vec<Input>, column: &str, default: Option<f64>) -> usize {
    inputs.iter().position(|i| i.column == column).unwrap_or_else(|| {
        inputs.push(Input { column: column.to_owned(), default });
        inputs.len() - 1
    })
}
