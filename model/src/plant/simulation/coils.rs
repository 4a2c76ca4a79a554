//! Heat of coils where a run begins that commands have gone before.
//!
//! A coil remembers what it carried for a minute. A later part of a recording (behind a switch of the pump, a gap) that began at the
//! coil's cold, as a whole one does, would warm up once more: a free run behind a coil that rises by a tenth is off by more than 1 kPa then.

use std::sync::Arc;

use super::Simulation;
use crate::plant::INSTANTS_PER_STEP;
use crate::plant::dispatch::Simulated;

impl<R: Simulated> Simulation<R> {
    /// Tells whether something in it remembers commands for longer than a chamber does.
    pub fn has_coils_that_warm(&self) -> bool {
        self.plant.commands.iter().any(|path| path.warms())
    }

    /// Warms coils by what was commanded before the start, each tick as long as the plant's; to be called after
    /// [`Simulation::start_at`]. `commands` are those of each tick in the order of time, by input, and how much of the tick there was:
    /// 0 in lanes that begin later, 1 elsewhere. Delays and the sag of a supply are left out.
    /// Not for the daemon's tick: it takes as long as there are ticks.
    pub fn warm_coils(&mut self, ticks: usize, command: &dyn Fn(usize, usize) -> R, there: &dyn Fn(usize) -> R) {
        let plant = Arc::clone(&self.plant);
        let instants = INSTANTS_PER_STEP * plant.steps;
        for path in &plant.commands {
            path.warm(instants, ticks, &|tick| (command(path.input, tick), there(tick)), &mut self.state.memory);
        }
    }
}
