//! Valves, lines and sources of flow: what joins the places.

use super::{Assembly, KPA, LITRE, MM2, dead_zone, extends_the_balances, input, mechanisms_on};
use crate::mechanism::{Mechanism, Rubs};
use crate::plant::LAWS;
use crate::plant::elements::{Capillary, Feed, Parabolic, Passage, Sag, ShapedVent, Vent};
use crate::plant::unobserved::{Placed, Slot, UnobservedInitialState};
use crate::rig::{ATMOSPHERE, Line, RigError, Source, Valve, WHOLE_RIG};

impl Assembly<'_> {
    pub(super) fn valves(&mut self) -> Result<(), RigError> {
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
                if shaped.held.is_some() {
                    let unknown =
                        UnobservedInitialState { name: format!("stick:{name}"), low: -1.0, high: 1.0, usual: 0.0 };
                    let vent = self.plant.shaped_vents.len();
                    self.plant.unknowns.push(Placed { unknown, slot: Slot::Held { vent } });
                }
                self.plant.shaped_vents.push(shaped);
            } else {
                self.plant.vents.push(vent);
            }
        }
        Ok(())
    }

    /// A valve with whatever bends its forces or lies in series with it.
    pub(super) fn shaped(&mut self, name: &str, valve: &Valve, vent: Vent<f64>, nozzle: f64) -> ShapedVent<f64> {
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

    /// The outflow function of a valve or an orifice.
    pub(super) fn law_of(&mut self, component: &str) -> Result<usize, RigError> {
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

    pub(super) fn lines(&mut self) -> Result<(), RigError> {
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

    pub(super) fn feeds(&mut self) -> Result<(), RigError> {
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
}
