//! Pumps: pistons in full detail or averaged over a revolution, and flows that are commanded.

use super::{Assembly, KPA, LITRE, MM2, MS, dead_zone, input, mechanisms_on};
use crate::averaged::{PumpGeometry, Spring};
use crate::mechanism::{Mechanism, PumpPort};
use crate::orifice::FlowFunction;
use crate::plant::MOST_DRIVES;
use crate::plant::elements::{AveragedPump, Capillary, Cylinder, Displacement, Drive, Passage, SpringCheck};
use crate::plant::unobserved::{Placed, Slot, UnobservedInitialState};
use crate::rig::{PistonPump, Pump, RigError};

/// A check valve that opens over less than this opens at once.
const AT_ONCE_PA: f64 = 1e-3;

/// The most of a pump's range that may be dead; the rest must hold all of its flow.
const MOST_DEAD: f64 = 0.95;

/// Speed that `pump_speed` makes of a stated one.
#[derive(Clone, Copy)]
pub(super) struct Speed {
    /// Factor at the start of a run, and in the end.
    begun: f64,
    ended: f64,
    /// Rate in 1/s with which it goes from one to the other, where it does.
    approach_rate: Option<f64>,
}

impl Speed {
    fn of<'m>(mechanisms: impl Iterator<Item = &'m Mechanism>) -> Self {
        let mut speed = Speed { begun: 1.0, ended: 1.0, approach_rate: None };
        for mechanism in mechanisms {
            if let Mechanism::PumpSpeed(m) = mechanism {
                speed.ended *= m.factor();
                match m.approach_rate() {
                    Some(rate) => speed.approach_rate = Some(rate),
                    None => speed.begun *= m.factor(),
                }
            }
        }
        speed
    }
}

impl Assembly<'_> {
    pub(super) fn pumps(&mut self) -> Result<(), RigError> {
        for (name, pump) in &self.rig.pumps {
            let speed = Speed::of(mechanisms_on(self.rig, name));
            let factor = speed.begun;
            // Per bar to per Pa.
            let droop = mechanisms_on(self.rig, name)
                .find_map(|m| if let Mechanism::PumpDroop(m) = m { Some(m.speed_loss_per_bar * 1e-5) } else { None });
            match pump {
                Pump::Piston(p) => self.piston_pump(name, p, speed, droop)?,
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

    pub(super) fn piston_pump(
        &mut self,
        name: &str,
        p: &PistonPump,
        speed: Speed,
        droop: Option<f64>,
    ) -> Result<(), RigError> {
        let (inlet, outlet) = (self.node(&p.inlet), self.node(&p.outlet));
        let machine = self.machine(name, p, speed.begun, droop.unwrap_or(0.0));
        let warm = speed.approach_rate.map(|_| self.machine(name, p, speed.ended, droop.unwrap_or(0.0)));
        let drive = self.plant.drives.len();
        if drive == MOST_DRIVES {
            return Err(RigError::at(format!("pumps.{name}"), format!("more than {MOST_DRIVES} piston pumps")));
        }
        let relay = p.relay.as_deref().map(|r| input(&mut self.plant.inputs, r, Some(1.0)));
        self.plant.drives.push(Drive {
            relay,
            droops: droop.map(|_| (inlet, outlet)),
            warms: speed.approach_rate.is_some(),
            warm_share: speed.ended / speed.begun - 1.0,
            approach_rate: speed.approach_rate.unwrap_or(0.0),
            droop: machine.droop,
            ..machine.crank().0
        });
        let unknown = UnobservedInitialState { name: format!("phase:{name}"), low: 0.0, high: 1.0, usual: 0.0 };
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
                warm: warm.as_ref().map(|warm| tables.of(warm)),
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
            for (((up, down), area), spring) in ends.into_iter().zip(machine.areas).zip(machine.springs) {
                if springs {
                    self.plant.spring_checks.push(SpringCheck {
                        up,
                        down,
                        law: 0,
                        area,
                        cracking: spring.cracking_pa,
                        taken: spring.taken_pa,
                        inverse_opening: 1.0 / spring.opening_pa.max(AT_ONCE_PA),
                    });
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
    pub(super) fn machine(&self, name: &str, p: &PistonPump, factor: f64, droop: f64) -> PumpGeometry {
        let gas_constant = self.plant.gas_constant;
        let temperature = |node: usize| self.plant.temperature.get(node).copied().unwrap_or(f64::NAN);
        let mut machine = PumpGeometry {
            speed: p.speed_rpm / 60.0 * factor,
            droop,
            phases: p.phases_deg.iter().map(|phase| phase / 360.0).collect(),
            crank_radius: p.crank_radius_mm * 1e-3,
            rod_length: p.rod_length_mm * 1e-3,
            effective_length: p.effective_length_mm * 1e-3,
            head_area: p.head_area_cm2 * 1e-4,
            rt: gas_constant * p.gas_temperature_k,
            areas: [p.inlet_check_area_mm2 * MM2, p.outlet_check_area_mm2 * MM2],
            springs: [Spring::default(); 2],
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
                Mechanism::CheckValveCracking(m) => {
                    machine.springs = [m.inlet_kpa, m.outlet_kpa].map(|cracking_kpa| {
                        let cracking_pa = cracking_kpa * KPA;
                        match m.wide_open_share {
                            Some(share) => Spring { cracking_pa, taken_pa: 0.0, opening_pa: share * cracking_pa },
                            None => Spring { cracking_pa, taken_pa: cracking_pa, opening_pa: 0.0 },
                        }
                    });
                }
                Mechanism::PistonBlowby(m) => machine.blowby = m.conductance_kg_per_s_pa2,
                _ => {}
            }
        }
        machine
    }

    /// Rise of pressure of a place near the atmosphere's per kilogram that a pump moves within a revolution, in
    /// Pa/kg; `entering` is the temperature of what comes in, the place's own where gas leaves.
    pub(super) fn breathing(&self, place: &str, entering: Option<f64>) -> f64 {
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
