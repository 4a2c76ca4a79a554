//! Rigs with averaged pumps behind the controller's ports, and their states: for looking ahead many times in a tick.

use super::DualPressureRig;
use crate::averaged::PumpTables;
use crate::plant::{Plant, Simulated, State};
use crate::real::Lanes;
use crate::rig::{Rig, RigError};

impl<const N: usize> DualPressureRig<Lanes<N>>
where
    Lanes<N>: Simulated,
{
    /// Compiles up to `N` rigs of one structure with their pumps averaged over a revolution, at steps of `step_ms`.
    ///
    /// A tick of such a bundle costs some µs instead of some tens; what it loses is told in [`crate::averaged`].
    ///
    /// # Errors
    /// As [`DualPressureRig::side_by_side`].
    pub fn averaged_side_by_side(rigs: &[Rig], step_ms: f64) -> Result<Self, RigError> {
        Self::of(Plant::averaged_side_by_side(rigs, step_ms, &PumpTables::new())?)
    }
}

impl<R: Simulated> DualPressureRig<R> {
    /// Everything that a later [`DualPressureRig::restore`] needs to go on from here.
    ///
    /// # Real-time
    /// A copy of some hundred bytes per rig; may run in the tick.
    pub fn state(&self) -> State<R> {
        self.simulation.state()
    }

    /// Goes back to a state of this rig.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn restore(&mut self, state: &State<R>) {
        self.simulation.restore(state);
    }
}
