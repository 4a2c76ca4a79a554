//! Flows that a piston pump draws and delivers while its chambers' pressures do what was recorded.
//!
//! The valves' regression needs the pump's flow, and a table of it over settled pressures will not do: the outlet valve
//! is tight, a revolution forgets only a third of the cylinders' content, and while the negative chamber's pressure
//! rises the cylinders swallow as much gas as 40 % more volume would (measured: the regression then finds 0.57 L for
//! 0.40 L). So the pump is simulated stroke by stroke between two chambers so large that it cannot move them, whose pressures
//! are set to the recorded ones row by row; what it draws from one and delivers to the other is read off their
//! pressures. (Chambers of the rig's own size breathe with every stroke, which this leaves out: 0.6 % of the flow.)

use std::sync::Arc;

use model::plant::{Plant, Simulation};
use model::rig::{PistonPump, Pump, Rig, RigError};
use proto::recording::PERIOD_S;

/// Volume of the chambers, in litres: a revolution moves them by a few Pa.
const HELD_L: f64 = 100.0;
/// Rows before the first that counts: the cylinders' start is forgotten to 5e-6.
const SETTLING: usize = 30;
/// Step of the integrator in ms: flows are good to 0.1 %.
const STEP_MS: f64 = 0.4;

/// A pump between two chambers of given pressures.
#[derive(Debug, Clone)]
pub struct DrivenPump {
    plant: Arc<Plant<f64>>,
    ticks_per_row: usize,
    /// Nodes of the chambers at inlet and outlet.
    nodes: [usize; 2],
    /// kg per Pa of both chambers.
    capacity: [f64; 2],
}

impl DrivenPump {
    /// Takes the pump of this name out of a rig.
    ///
    /// # Errors
    /// There is no such piston pump between two volumes, or its numbers are unsound.
    pub fn new(rig: &Rig, name: &str) -> Result<Self, RigError> {
        let Some(Pump::Piston(pump)) = rig.pumps.get(name) else {
            return Err(RigError::at(format!("pumps.{name}"), "no piston pump of this name"));
        };
        let bench = bench(rig, name, pump)?;
        let plant = Plant::new(&bench)?;
        let ends = [&pump.inlet, &pump.outlet];
        let capacity = ends.map(|end| {
            let kelvin = bench.volumes.get(end).map_or(f64::NAN, |v| v.temperature_k);
            HELD_L * 1e-3 / (bench.gas.gas_constant_j_per_kg_k * kelvin)
        });
        let nodes = ends.map(|end| bench.volumes.get_index_of(end).unwrap_or(0));
        let ticks_per_row = (PERIOD_S / plant.tick_s()).round().max(1.0) as usize;
        Ok(DrivenPump { plant: Arc::new(plant), ticks_per_row, nodes, capacity })
    }

    /// Mass flows drawn and delivered in kg/s, by row, under absolute pressures at inlet and outlet in Pa; the pump runs
    /// in rows where `on` says so.
    pub fn flows_kg_per_s(&self, pressures_pa: &[[f64; 2]], on: impl Fn(usize) -> bool) -> Vec<[f64; 2]> {
        let mut simulation = Simulation::new(Arc::clone(&self.plant));
        let mut row = |pressures: [f64; 2], on: bool| {
            for (node, pressure) in self.nodes.into_iter().zip(pressures) {
                simulation.set_pressure_pa(node, pressure);
            }
            // The pump's relay is the only input there is.
            for _ in 0..self.ticks_per_row {
                simulation.tick(&[f64::from(u8::from(on))]);
            }
            let moved = |end: usize| simulation.pressure_pa(self.nodes[end]) - pressures[end];
            [-moved(0) * self.capacity[0] / PERIOD_S, moved(1) * self.capacity[1] / PERIOD_S]
        };
        if let Some(first) = pressures_pa.first() {
            for _ in 0..SETTLING {
                row(*first, on(0));
            }
        }
        pressures_pa.iter().enumerate().map(|(k, pressures)| row(*pressures, on(k))).collect()
    }
}

/// The rig with nothing but the pump between two huge chambers.
fn bench(rig: &Rig, name: &str, pump: &PistonPump) -> Result<Rig, RigError> {
    let mut bench = rig.without_mechanisms();
    bench.pumps.retain(|other, _| other == name);
    bench.valves.clear();
    bench.lines.clear();
    bench.sources.clear();
    for end in [&pump.inlet, &pump.outlet] {
        let Some(volume) = bench.volumes.get_mut(end) else {
            let problem = "the pump does not join two volumes; its flow cannot be told from their pressures";
            return Err(RigError::at(format!("pumps.{name}"), problem));
        };
        volume.volume_l = HELD_L;
        volume.compliance_ml_per_kpa = 0.0;
    }
    if bench.integrator.step_ms < STEP_MS {
        bench.integrator.step_ms = bench.integrator.tick_ms / (bench.integrator.tick_ms / STEP_MS).round().max(1.0);
    }
    Ok(bench)
}

#[cfg(test)]
mod tests {
    use super::*;
    use model::steady::SteadyMap;

    /// Settled flows are those of the map that the model makes for itself, at points of its grid.
    #[test]
    fn settled_flows_are_those_of_the_steady_map() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        let pump = DrivenPump::new(&rig, "pump").unwrap();
        // The map lets the ports breathe as the rig's own chambers do (0.6 % more drawn); here they stand still.
        let mut still = rig.clone();
        still.volumes.values_mut().for_each(|volume| volume.volume_l = HELD_L);
        let map = SteadyMap::new(&still).unwrap();
        for (positive, negative) in [(80.0, -70.0), (100.0, -75.0), (120.0, -80.0)] {
            let pressures = [(101.325 + negative) * 1e3, (101.325 + positive) * 1e3];
            let flows = pump.flows_kg_per_s(&[pressures; 10], |_| true);
            let [drawn, delivered] = flows[9];
            let [gained, lost] = map.flows([positive, negative]);
            // Steps of 0.4 ms against 0.1 ms; with both flows so close to the map's, what is drawn is delivered.
            assert!((delivered / gained - 1.0).abs() < 2e-3 && (drawn / -lost - 1.0).abs() < 2e-3, "{drawn} {lost}");
        }
        let off = pump.flows_kg_per_s(&[[3e4, 1.8e5]; 40], |_| false);
        assert!(off[39][0].abs() < 1e-12 && off[39][1].abs() < 1e-12, "a pump at rest moves nothing: {:?}", off[39]);
    }
}
