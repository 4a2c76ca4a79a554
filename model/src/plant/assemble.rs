//! From a checked rig to flat arrays in SI units.

use super::command::{CommandPath, Stage};
use super::elements::{
    AveragedPump, Capillary, Compliant, Cylinder, Displacement, Drive, Feed, Given, Isothermal, Muscle, Parabolic,
    Passage, Sag, SensorPath, ShapedVent, SpringCheck, Thermal, Vent, lanes_of,
};
use super::residual::{Probe, Residual, Target, Variable};
use super::unknown::{Placed, Slot, Unknown};
use super::{Input, LAWS, MEMORY, MOST_DRIVES, MOST_GIVEN, MOST_RESIDUALS, MOST_STATES, NODES, Plant, carried};
use crate::averaged::{Machine, PumpTables};
use crate::mechanism::{self, Lags, Mechanism, PumpPort, Rubs};
use crate::orifice::FlowFunction;
use crate::real::Real;
use crate::rig::{ATMOSPHERE, Line, PistonPump, Pump, Rig, RigError, Source, Valve, Volume, WHOLE_RIG};

// SI per unit of the file.
const MM2: f64 = 1e-6;
const LITRE: f64 = 1e-3;
const KPA: f64 = 1e3;
const MS: f64 = 1e-3;
const MILLIGRAM: f64 = 1e-6;
/// In m³: a pump moves it by less than a pascal in the step of a held rig.
const HELD_VOLUME: f64 = 0.1;
/// The most of a pump's range that may be dead; the rest must hold all of its flow.
const MOST_DEAD: f64 = 0.95;
/// m/s².
const STANDARD_GRAVITY: f64 = 9.80665;

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

impl<R: Real> Plant<R> {
    /// Lays rigs of one structure side by side, one per lane; lanes beyond the last repeat it.
    ///
    /// # Errors
    /// If there are none, more than lanes, or if they differ in more than numbers.
    pub fn side_by_side(rigs: &[Rig]) -> Result<Self, RigError> {
        Self::together(rigs.iter().map(Plant::new).collect::<Result<Vec<_>, _>>()?)
    }

    /// [`Plant::averaged`] for rigs of one structure, one per lane; lanes beyond the last repeat it.
    ///
    /// # Errors
    /// As [`Plant::averaged`] and [`Plant::side_by_side`].
    pub fn averaged_side_by_side(rigs: &[Rig], step_ms: f64, tables: &PumpTables) -> Result<Self, RigError> {
        let parts = rigs.iter().map(|rig| Plant::averaged(rig, step_ms, tables)).collect::<Result<Vec<_>, _>>()?;
        Self::together(parts)
    }

    fn together(parts: Vec<Plant<f64>>) -> Result<Self, RigError> {
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
        Self::together(vec![one])
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
    /// Whether chambers keep their pressures whatever flows in.
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
        let own_state = |m: &&Mechanism| matches!(m, Mechanism::ChamberThermal(_) | Mechanism::ActuatorLoad(_));
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

    fn valves(&mut self) -> Result<(), RigError> {
        for mechanism in mechanisms_on(self.rig, WHOLE_RIG) {
            if let Mechanism::SupplySag(sag) = mechanism {
                self.plant.sags.push(Sag { loss: sag.loss_per_duty });
            }
        }
        for (name, valve) in &self.rig.valves {
            let command = self.command_path(name, &valve.command, true);
            let law = self.law_of(name)?;
            let (up, down) = (self.node(&valve.from), self.node(&valve.to));
            let nozzle = std::f64::consts::PI * (valve.nozzle_diameter_mm * 1e-3).powi(2) / 4.0;
            let vent = Vent {
                up,
                down,
                law,
                command,
                input_area: valve.input_area_mm2 * MM2,
                pressure_area: valve.pressure_area_mm2_per_n * MM2 * nozzle,
                // A dead zone is a spring by another name.
                spring_area: dead_zone(self.rig, name).mul_add(valve.input_area_mm2, valve.spring_area_mm2) * MM2,
            };
            if mechanisms_on(self.rig, name).any(extends_the_balances) {
                let shaped = self.shaped(name, valve, vent, nozzle);
                self.plant.shaped_vents.push(shaped);
            } else {
                self.plant.vents.push(vent);
            }
        }
        Ok(())
    }

    /// The path of a command that input `column` carries to `component`; its index.
    fn command_path(&mut self, component: &str, column: &str, on_supply: bool) -> usize {
        let instant_s = self.plant.instant_s();
        let mut stages: Vec<Stage<f64>> = mechanisms_on(self.rig, component)
            .filter_map(|mechanism| match mechanism {
                Mechanism::CommandDelay(m) => Some(Stage::Delay(m.operator(self.rig.integrator.tick_ms))),
                Mechanism::CoilHeating(m) => Some(Stage::Heat(m.operator(instant_s))),
                Mechanism::ValveLag(m) => Some(match m.lags {
                    Lags::Coil => Stage::Lag(m.operator(instant_s)),
                    Lags::Armature => Stage::LateArmature(m.operator(instant_s)),
                }),
                Mechanism::ValveForceCurve(m) => Some(Stage::Bend(m.operator())),
                Mechanism::ValveStiction(m) if m.rubs == Rubs::Plunger => Some(Stage::Stick(m.operator())),
                Mechanism::ValveHysteresis(m) => Some(Stage::Play(m.operator())),
                _ => None,
            })
            .collect();
        stages.sort_by_key(Stage::rank);
        let index = self.plant.commands.len();
        let input = input(&mut self.plant.inputs, column, None);
        let path = CommandPath { input, memory: self.memory, on_supply, stages };
        for (stage, memory) in path.memories() {
            let (what, low, usual, slot) = match stage {
                Stage::Heat(heat) => ("heat", 0.0, heat.initial, Slot::Heat { memory }),
                Stage::Play(_) => ("play", -1.0, 0.0, Slot::Play { path: index }),
                _ => continue,
            };
            let unknown = Unknown { name: format!("{what}:{component}"), low, high: 1.0, usual };
            self.plant.unknowns.push(Placed { unknown, slot });
        }
        self.memory += path.stages.iter().map(Stage::memory_len).sum::<usize>();
        self.plant.commands.push(path);
        index
    }

    /// The outflow function of a valve or an orifice.
    fn law_of(&mut self, component: &str) -> Result<usize, RigError> {
        let own = mechanisms_on(self.rig, component)
            .find_map(|m| if let Mechanism::CriticalRatio(m) = m { Some(m) } else { None });
        let Some(own) = own else { return Ok(0) };
        let index = self.laws;
        self.laws += 1;
        let slot = self.plant.laws.get_mut(index).ok_or_else(|| {
            RigError::at("mechanisms", format!("more than {} orifices with a critical ratio of their own", LAWS - 1))
        })?;
        *slot = own.law(self.plant.heat_capacity_ratio);
        Ok(index)
    }

    /// A valve with whatever bends its forces or lies in series with it.
    fn shaped(&mut self, name: &str, valve: &Valve, vent: Vent<f64>, nozzle: f64) -> ShapedVent<f64> {
        let mut shaped = ShapedVent::from_plain(&vent);
        let drop = |area_mm2: f64| 1.0 / (area_mm2 * MM2).powi(2);
        for mechanism in mechanisms_on(self.rig, name) {
            match mechanism {
                Mechanism::ValveForceCurve(m) => {
                    shaped.pressure_curvature = m.pressure_curvature_mm2_per_n2 * MM2 * nozzle * nozzle;
                    shaped.inverse_full_area = m.inverse_full_area_per_mm2 / MM2;
                }
                Mechanism::ValveStiction(m) if m.rubs == Rubs::Flapper => {
                    shaped.held = Some(self.memory);
                    self.memory += 1;
                    [shaped.band, shaped.short] = [m.band_duty, m.short_of_it * m.band_duty];
                }
                Mechanism::LineResistance(m) => {
                    shaped.restricted = true;
                    // On the chamber's side of the valve.
                    if self.rig.volumes.contains_key(&valve.from) {
                        shaped.upstream_drop += drop(m.area_mm2);
                    } else {
                        shaped.downstream_drop += drop(m.area_mm2);
                    }
                }
                Mechanism::ExhaustRestriction(m) => {
                    shaped.restricted = true;
                    if valve.from == ATMOSPHERE {
                        shaped.upstream_drop += drop(m.area_mm2);
                    } else {
                        shaped.downstream_drop += drop(m.area_mm2);
                    }
                }
                _ => {}
            }
        }
        shaped
    }

    fn pumps(&mut self) -> Result<(), RigError> {
        for (name, pump) in &self.rig.pumps {
            let factor = mechanisms_on(self.rig, name)
                .fold(1.0, |factor, m| if let Mechanism::PumpSpeed(m) = m { factor * m.factor() } else { factor });
            // Per bar to per Pa.
            let droop = mechanisms_on(self.rig, name)
                .find_map(|m| if let Mechanism::PumpDroop(m) = m { Some(m.speed_loss_per_bar * 1e-5) } else { None });
            match pump {
                Pump::Piston(p) => self.piston_pump(name, p, factor, droop)?,
                Pump::Flow(p) => {
                    let (up, down) = (self.node(&p.inlet), self.node(&p.outlet));
                    let late = |m: &Mechanism| matches!(m, Mechanism::CommandDelay(_) | Mechanism::ValveLag(_));
                    let path = match &p.command {
                        Some(column) if mechanisms_on(self.rig, name).any(late) => {
                            Some(self.command_path(name, column, false))
                        }
                        _ => None,
                    };
                    let command = p.command.as_deref().map(|c| input(&mut self.plant.inputs, c, None));
                    let rt = self.plant.gas_constant * self.plant.temperature.get(up).copied().unwrap_or(f64::NAN);
                    let dead_zone = (p.dead_zone_duty + dead_zone(self.rig, name)).min(MOST_DEAD);
                    self.plant.displacements.push(Displacement {
                        up,
                        down,
                        command,
                        path,
                        flow: p.flow_l_per_min * LITRE / 60.0 * factor,
                        dead_zone,
                        inverse_range: 1.0 / (1.0 - dead_zone),
                        droop: droop.unwrap_or(0.0),
                        rt,
                    });
                }
            }
        }
        Ok(())
    }

    fn piston_pump(&mut self, name: &str, p: &PistonPump, factor: f64, droop: Option<f64>) -> Result<(), RigError> {
        let (inlet, outlet) = (self.node(&p.inlet), self.node(&p.outlet));
        let machine = self.machine(name, p, factor, droop.unwrap_or(0.0));
        let drive = self.plant.drives.len();
        if drive == MOST_DRIVES {
            return Err(RigError::at(format!("pumps.{name}"), format!("more than {MOST_DRIVES} piston pumps")));
        }
        let relay = p.relay.as_deref().map(|r| input(&mut self.plant.inputs, r, Some(1.0)));
        self.plant.drives.push(Drive {
            relay,
            droops: droop.map(|_| (inlet, outlet)),
            droop: machine.droop,
            ..machine.crank().0
        });
        let unknown = Unknown { name: format!("phase:{name}"), low: 0.0, high: 1.0, usual: 0.0 };
        self.plant.unknowns.push(Placed { unknown, slot: Slot::Phase { drive } });
        let springs = mechanisms_on(self.rig, name).any(|m| matches!(m, Mechanism::CheckValveCracking(_)));
        let rings = mechanisms_on(self.rig, name).any(|m| matches!(m, Mechanism::PistonBlowby(_)));
        if let Some(tables) = self.tables {
            let content = self.plant.states;
            self.plant.states += 1;
            let memory = self.memory;
            self.memory += 1;
            self.plant.averaged.push(AveragedPump {
                inlet,
                outlet,
                content,
                drive,
                memory,
                beat: beat(&machine.phases),
                temperature: p.gas_temperature_k,
                table: tables.of(&machine),
            });
            return Ok(());
        }
        for phase in &p.phases_deg {
            let node = self.plant.states;
            self.plant.states += 1;
            if let Some(temperature) = self.plant.temperature.get_mut(node) {
                *temperature = p.gas_temperature_k;
            }
            self.plant.cylinders.push(Cylinder { node, inlet, drive, phase: phase / 360.0 });
            let ends = [(inlet, node), (node, outlet)];
            for (((up, down), area), cracking) in ends.into_iter().zip(machine.areas).zip(machine.cracking) {
                if springs {
                    self.plant.spring_checks.push(SpringCheck { up, down, law: 0, area, cracking });
                } else {
                    self.plant.passages.push(Passage { up, down, law: 0, area });
                }
            }
            if rings {
                let conductance = machine.blowby;
                self.plant.capillaries.push(Capillary { up: node, down: self.given_from, conductance });
            }
        }
        Ok(())
    }

    /// A piston pump in SI units, with what its mechanisms do to it.
    fn machine(&self, name: &str, p: &PistonPump, factor: f64, droop: f64) -> Machine {
        let gas_constant = self.plant.gas_constant;
        let temperature = |node: usize| self.plant.temperature.get(node).copied().unwrap_or(f64::NAN);
        let mut machine = Machine {
            speed: p.speed_rpm / 60.0 * factor,
            droop,
            phases: p.phases_deg.iter().map(|phase| phase / 360.0).collect(),
            crank_radius: p.crank_radius_mm * 1e-3,
            rod_length: p.rod_length_mm * 1e-3,
            effective_length: p.effective_length_mm * 1e-3,
            head_area: p.head_area_cm2 * 1e-4,
            rt: gas_constant * p.gas_temperature_k,
            areas: [p.inlet_check_area_mm2 * MM2, p.outlet_check_area_mm2 * MM2],
            cracking: [0.0; 2],
            blowby: 0.0,
            inlet_inverse_speed: 1.0 / (gas_constant * temperature(self.node(&p.inlet))).sqrt(),
            cylinder_inverse_speed: 1.0 / (gas_constant * p.gas_temperature_k).sqrt(),
            atmosphere_pa: self.plant.atmosphere_pa,
            heat_capacity_ratio: self.plant.heat_capacity_ratio,
            law: FlowFunction::nozzle(self.plant.heat_capacity_ratio),
            inlet_pa_per_kg: self.breathing(&p.inlet, None),
            outlet_pa_per_kg: self.breathing(&p.outlet, Some(p.gas_temperature_k)),
            step_s: self.rig.integrator.step_ms * MS,
        };
        for mechanism in mechanisms_on(self.rig, name) {
            match mechanism {
                Mechanism::LineResistance(m) => {
                    let port = usize::from(m.port == Some(PumpPort::Outlet));
                    if let Some(area) = machine.areas.get_mut(port) {
                        // In series with something of area A: 1/C² = 1/C_check² + 1/A².
                        *area /= (1.0 + (*area / (m.area_mm2 * MM2)).powi(2)).sqrt();
                    }
                }
                Mechanism::CheckValveCracking(m) => machine.cracking = [m.inlet_kpa * KPA, m.outlet_kpa * KPA],
                Mechanism::PistonBlowby(m) => machine.blowby = m.conductance_kg_per_s_pa2,
                _ => {}
            }
        }
        machine
    }

    /// How far a kilogram that a pump moves within a revolution moves the pressure of a place near the atmosphere's, in
    /// Pa/kg; `entering` is the temperature of what comes in, the place's own where gas leaves.
    fn breathing(&self, place: &str, entering: Option<f64>) -> f64 {
        let Some(volume) = self.rig.volumes.get(place) else { return 0.0 };
        let size = self.size(place, volume);
        let atmosphere = self.plant.atmosphere_pa;
        let rt = self.plant.gas_constant * volume.temperature_k;
        match size.wall_conductance {
            Some(_) => {
                let kappa = self.plant.heat_capacity_ratio;
                let rt = self.plant.gas_constant * entering.unwrap_or(volume.temperature_k);
                kappa * rt / (size.volume + kappa * size.compliance * atmosphere)
            }
            None => rt / (size.volume + size.compliance * atmosphere),
        }
    }

    fn lines(&mut self) -> Result<(), RigError> {
        for (name, line) in &self.rig.lines {
            match line {
                Line::Orifice { from, to, area_mm2, one_way } => {
                    let law = self.law_of(name)?;
                    let (up, down, area) = (self.node(from), self.node(to), area_mm2 * MM2);
                    self.plant.passages.push(Passage { up, down, law, area });
                    if !one_way {
                        self.plant.passages.push(Passage { up: down, down: up, law, area });
                    }
                }
                Line::Laminar { from, to, resistance_kpa_s_per_l } => {
                    let (up, down) = (self.node(from), self.node(to));
                    let rt = self.plant.gas_constant * self.plant.temperature.get(up).copied().unwrap_or(f64::NAN);
                    let linear = 2.0 * rt * (resistance_kpa_s_per_l * KPA / LITRE);
                    let in_series = mechanisms_on(self.rig, name)
                        .find_map(|m| if let Mechanism::LineResistance(m) = m { Some(m.area_mm2 * MM2) } else { None });
                    match in_series {
                        Some(area) => {
                            self.plant.parabolics.push(Parabolic { up, down, linear, quadratic: rt / area.powi(2) })
                        }
                        None => self.plant.capillaries.push(Capillary { up, down, conductance: 1.0 / linear }),
                    }
                }
            }
        }
        Ok(())
    }

    fn feeds(&mut self) -> Result<(), RigError> {
        let outside = self.rig.atmosphere.temperature_k;
        for source in self.rig.sources.values() {
            if let Source::Flow { to, flow_l_per_min, signal, offset_l_per_min } = source {
                let down = self.node(to);
                let command = signal.as_deref().map(|s| input(&mut self.plant.inputs, s, None));
                let density = self.plant.atmosphere_pa / (self.plant.gas_constant * outside);
                let [flow, offset] =
                    [*flow_l_per_min, *offset_l_per_min].map(|l_per_min| l_per_min * LITRE / 60.0 * density);
                self.plant.feeds.push(Feed { down, command, flow, offset, temperature: outside });
            }
        }
        Ok(())
    }

    fn chambers(&mut self) -> Result<(), RigError> {
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
    fn size(&self, name: &str, volume: &Volume) -> Size {
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
                Mechanism::VolumeChange(m) => volume_l += m.extra_volume_l,
                _ => {}
            }
        }
        Size { volume: volume_l * LITRE, compliance: compliance_ml_per_kpa * 1e-9, moves, wall_conductance }
    }

    fn muscles(&mut self) {
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

    fn residuals(&mut self) -> Result<(), RigError> {
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

    fn probe(&mut self, axis: &mechanism::Axis) -> Probe<f64> {
        let variable = match (axis.variable, self.rig.valves.get_full(&axis.of)) {
            (mechanism::Variable::Duty, Some((command, _, _))) => Variable::Duty { command },
            (mechanism::Variable::Difference, Some((_, _, valve))) => {
                Variable::Difference { up: self.node(&valve.from), down: self.node(&valve.to) }
            }
            _ => Variable::Pressure { node: self.node(&axis.of) },
        };
        let memory = axis.time_constant_ms.map(|_| self.memory);
        self.memory += usize::from(memory.is_some());
        let approach = axis.time_constant_ms.map_or(1.0, |lag| -(-self.plant.step_s / (lag * MS)).exp_m1());
        Probe { variable, memory, departure: axis.departure, approach }
    }

    fn sensors(&mut self) -> Result<(), RigError> {
        for (name, sensor) in &self.rig.sensors {
            let node = self.node(&sensor.volume);
            let mut path =
                SensorPath { node, memory: None, approach: 1.0, gain: 1.0, bias: 0.0, drift: 0.0, drift_end: 0.0 };
            for mechanism in mechanisms_on(self.rig, name) {
                match mechanism {
                    Mechanism::SensorLag(m) => {
                        path.memory = Some(self.memory);
                        path.approach = m.approach(self.plant.step_s);
                        self.memory += 1;
                    }
                    Mechanism::SensorGain(m) => path.gain = m.gain,
                    Mechanism::SensorBias(m) => path.bias = m.bias_kpa,
                    Mechanism::SensorDrift(m) => (path.drift, path.drift_end) = m.course(),
                    _ => {}
                }
            }
            self.plant.sensors.push(path);
        }
        self.plant.like = self.neighbours();
        Ok(())
    }

    /// Chambers without a sensor that lines join, over however many others, to one that has one: the nearest sensor.
    fn neighbours(&self) -> Vec<(usize, usize)> {
        let joins: Vec<[usize; 2]> = self
            .rig
            .lines
            .values()
            .map(|line| match line {
                Line::Orifice { from, to, .. } | Line::Laminar { from, to, .. } => [self.node(from), self.node(to)],
            })
            .filter(|ends| ends.iter().all(|node| *node < self.plant.chambers))
            .collect();
        let mut known: Vec<(usize, usize)> =
            self.plant.sensors.iter().enumerate().map(|(sensor, path)| (path.node, sensor)).collect();
        let measured = known.len();
        // One more line away with each round.
        for _ in 0..self.plant.chambers {
            let is_known = |node: usize| known.iter().find(|(other, _)| *other == node).map(|(_, sensor)| *sensor);
            let next: Vec<(usize, usize)> = joins
                .iter()
                .flat_map(|[one, other]| [(*one, *other), (*other, *one)])
                .filter(|(to, _)| is_known(*to).is_none())
                .filter_map(|(to, from)| Some((to, is_known(from)?)))
                .collect();
            for (node, sensor) in next {
                if known.iter().all(|(other, _)| *other != node) {
                    known.push((node, sensor));
                }
            }
        }
        known.split_off(measured)
    }
}

/// A chamber in SI units.
struct Size {
    /// At atmospheric pressure, in m³.
    volume: f64,
    /// dV/dP in m³/Pa.
    compliance: f64,
    /// Whether its walls move (by however little).
    moves: bool,
    /// Heat passed to the wall in W/K, where it has an energy balance.
    wall_conductance: Option<f64>,
}

/// Revolutions after which what all pistons do together repeats itself: one over their number where they are evenly
/// spaced, one otherwise.
fn beat(phases: &[f64]) -> f64 {
    let share = 1.0 / phases.len() as f64;
    let even = |phase: &f64| {
        let off = ((phase - phases.first().copied().unwrap_or(0.0)) / share).rem_euclid(1.0);
        off.min(1.0 - off) < 1e-3
    };
    if phases.iter().all(even) { share } else { 1.0 }
}

/// Whether a mechanism adds to the balances what the smallest integrator is not compiled for.
fn extends_the_balances(mechanism: &Mechanism) -> bool {
    match mechanism {
        Mechanism::ChamberThermal(_)
        | Mechanism::CheckValveCracking(_)
        | Mechanism::ValveForceCurve(_)
        | Mechanism::ExhaustRestriction(_)
        | Mechanism::ActuatorLoad(_)
        | Mechanism::ResidualFlow(_) => true,
        Mechanism::ValveStiction(m) => m.rubs == Rubs::Flapper,
        // On a pump it is a smaller check valve.
        Mechanism::LineResistance(m) => m.port.is_none(),
        _ => false,
    }
}

/// Whether a muscle hangs on a volume.
fn has_muscle(rig: &Rig, volume: &str) -> bool {
    rig.mechanisms.iter().filter(|m| m.enabled).any(|attached| match &attached.mechanism {
        Mechanism::ActuatorLoad(m) => attached.component == volume || m.vacuum == volume,
        _ => false,
    })
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
