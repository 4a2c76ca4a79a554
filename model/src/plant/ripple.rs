//! The ripple of averaged pumps: what their strokes add to the mean pressures that are states.
//!
//! Everything is inlined into the tick and into [`super::dispatch`], so that it is compiled for their instruction set.

use super::elements::AveragedPump;
use super::sensor::Filter;
use super::{MEMORY, NODES, Plant, State};
use crate::real::Real;

impl<R: Real> Plant<R> {
    /// Gas that an averaged pump has drawn and delivered beyond the mean at a phase in revolutions, in kg.
    #[inline(always)]
    pub(super) fn moved(&self, pump: &AveragedPump<R>, x: &[R; NODES], phase: R) -> [R; 2] {
        pump.table.ripple(self.at_node(x, pump.inlet), self.at_node(x, pump.outlet), phase)
    }

    #[inline(always)]
    fn at_node(&self, x: &[R; NODES], node: usize) -> R {
        x.get(node).copied().unwrap_or(self.atmosphere_pa)
    }

    /// Pressure that gas drawn and delivered (in kg) adds to the pressures at an averaged pump's ports, in Pa.
    #[inline(always)]
    pub(super) fn ripple(&self, pump: &AveragedPump<R>, x: &[R; NODES], [drawn, delivered]: [R; 2]) -> [R; 2] {
        let leaving = match self.thermal.iter().find(|c| c.node == pump.inlet) {
            Some(chamber) => self.at_node(x, chamber.temperature),
            None => R::splat(0.0),
        };
        let inlet = -(drawn * self.pa_per_kg(pump.inlet, x, leaving));
        [inlet, delivered * self.pa_per_kg(pump.outlet, x, pump.temperature)]
    }

    /// Pressure that the ripple of all averaged pumps adds to the pressure of a chamber now, as it is seen through a filter, in Pa.
    #[inline(always)]
    pub(super) fn ripple_at(&self, state: &State<R>, speeds: &[R], node: usize, seen: &Filter<R>) -> R {
        let zero = R::splat(0.0);
        let mut sum = zero;
        for pump in self.averaged.iter().filter(|pump| pump.inlet == node || pump.outlet == node) {
            let mut phase = state.phase.get(pump.drive).copied().unwrap_or(zero);
            let running = state.memory.get(pump.memory).copied().unwrap_or(zero);
            let mut left = running;
            // Of the answer to the ripple only that to its fundamental matters.
            let turn = std::f64::consts::TAU / pump.beat;
            let speed = speeds.get(pump.drive).copied().unwrap_or(zero);
            if let Some((gain, late)) = seen.at(speed * R::splat(turn)) {
                left = gain * running;
                phase = phase - late * R::splat(1.0 / turn);
            }
            let [inlet, outlet] = self.ripple(pump, &state.x, self.moved(pump, &state.x, phase));
            for (port, ripple) in [(pump.inlet, inlet), (pump.outlet, outlet)] {
                if port == node {
                    sum += left * ripple;
                }
            }
        }
        sum
    }

    /// By how much the ripple of averaged pumps takes the difference between two chambers below and above its mean within a
    /// revolution, in Pa.
    #[inline(always)]
    pub(super) fn swing(&self, up: usize, down: usize, x: &[R; NODES], memory: &[R; MEMORY]) -> [R; 2] {
        let mut swing = [R::splat(0.0); 2];
        for pump in &self.averaged {
            let running = memory.get(pump.memory).copied().unwrap_or(R::splat(0.0));
            let [drawn, delivered] = pump.table.swing(self.at_node(x, pump.inlet), self.at_node(x, pump.outlet));
            let [inlet_high, outlet_low] = self.ripple(pump, x, [drawn[0], delivered[0]]);
            let [inlet_low, outlet_high] = self.ripple(pump, x, [drawn[1], delivered[1]]);
            for (node, [low, high]) in [(pump.inlet, [inlet_low, inlet_high]), (pump.outlet, [outlet_low, outlet_high])]
            {
                if node == up {
                    swing = [swing[0] + running * low, swing[1] + running * high];
                } else if node == down {
                    swing = [swing[0] - running * high, swing[1] - running * low];
                }
            }
        }
        swing
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::averaged::PumpTables;
    use crate::rig::Rig;

    /// The swing is the ripple's own range: reached at some phase, exceeded at none.
    #[test]
    fn ripple_stays_within_its_swing() {
        let plant = Plant::averaged(&Rig::builtin("dual_pressure").unwrap(), 10.0, &PumpTables::new()).unwrap();
        let pump = &plant.averaged[0];
        let mut x = [plant.atmosphere_pa; NODES];
        let mut memory = [0.0; MEMORY];
        memory[pump.memory] = 1.0;
        // Well apart from a node of the table, and on its way to the stall.
        for [inlet_kpa, outlet_kpa] in [[30.0, 195.0], [41.3, 181.7], [101.0, 102.0]] {
            (x[pump.inlet], x[pump.outlet]) = (1e3 * inlet_kpa, 1e3 * outlet_kpa);
            let seen: Vec<f64> = (0..1000)
                .map(|k| {
                    let moved = plant.moved(pump, &x, f64::from(k) / 1000.0);
                    plant.ripple(pump, &x, moved)[1]
                })
                .collect();
            let [low, high] = plant.swing(pump.outlet, NODES, &x, &memory);
            let (least, most) = seen.iter().fold((0.0f64, 0.0f64), |(l, m), v| (l.min(*v), m.max(*v)));
            // Phases are tabled 64 to a revolution, and straight lines between two nodes meet neither's peak.
            let most_off = 0.05 * (high - low);
            assert!(low <= least + 1e-9 && high >= most - 1e-9, "{low} … {high} Pa, seen {least} … {most}");
            assert!(least - low < most_off && high - most < most_off, "{low} … {high} Pa, seen {least} … {most}");
            assert!(high - low > 100.0, "hundreds of pascals, as the study has measured");
            // A vent to the other side of the chamber sees it upside down, and a pump at rest makes none.
            assert_eq!(plant.swing(NODES, pump.outlet, &x, &memory), [-high, -low]);
        }
        memory[pump.memory] = 0.0;
        assert_eq!(plant.swing(pump.outlet, NODES, &x, &memory), [0.0, 0.0]);
    }
}
