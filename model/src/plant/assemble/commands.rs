//! From a column of commands to what acts on a valve or a pump.

use super::{Assembly, input, mechanisms_on};
use crate::mechanism::{Lags, Mechanism, Rubs};
use crate::plant::command::{CommandPath, Stage};
use crate::plant::unobserved::{Placed, Slot, UnobservedInitialState};

impl Assembly<'_> {
    /// The path of a command that input `column` carries to `component`; its index.
    pub(super) fn command_path(&mut self, component: &str, column: &str, on_supply: bool) -> usize {
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
                Stage::Stick(_) => ("stick", -1.0, 0.0, Slot::Stick { path: index }),
                _ => continue,
            };
            let unknown = UnobservedInitialState { name: format!("{what}:{component}"), low, high: 1.0, usual };
            self.plant.unknowns.push(Placed { unknown, slot });
        }
        self.memory += path.stages.iter().map(Stage::memory_len).sum::<usize>();
        self.plant.commands.push(path);
        index
    }
}
