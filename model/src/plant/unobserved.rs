//! Numbers that recordings do not tell about their start, for fits that free it.
//!
//! A free run starts from the first readings and the first commands. Whether coils were warm, on which side of its
//! play a flapper lay, where friction held it, and where the crank stood is not in them. Each such number has a usual
//! value that a run starts from; fits of recordings that began otherwise set it
//! ([`super::Simulation::set_unknown`]).

/// A number of a run's start that its recording does not tell.
#[derive(Debug, Clone, PartialEq)]
pub struct UnobservedInitialState {
    /// Kind and component: `heat:valve_pos` (0 cold … 1 warm), `play:valve_pos` (−1 … 1: where in its play the
    /// flapper lies), `stick:valve_pos` (−1 … 1: how far from where its command would put it friction holds it, as a share
    /// of the band), `phase:pump` (crank angle in revolutions).
    pub name: String,
    /// Lowest value.
    pub low: f64,
    /// Highest value.
    pub high: f64,
    /// Value that a run starts from unless told otherwise.
    pub usual: f64,
}

/// Where an unknown lives in the state.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Placed {
    pub(crate) unknown: UnobservedInitialState,
    pub(crate) slot: Slot,
}

/// Where it lives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Slot {
    /// The heat of a coil, in the memory.
    Heat { memory: usize },
    /// The flapper's duty in a command path that ends in play.
    Play { path: usize },
    /// The plunger's duty in a command path with dry friction, and all that follows it.
    Stick { path: usize },
    /// Place at which dry friction holds the flapper of a shaped vent.
    Held { vent: usize },
    /// The crank of a pump.
    Phase { drive: usize },
}
