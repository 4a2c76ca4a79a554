//! States and faults of the daemon: one pure function, without socket, clock, thread or file.
//!
//! | module | subject |
//! | --- | --- |
//! | [`condition`] | everything that can be wrong, in one list from the least to the worst |
//! | [`condition_set`] | the conditions that hold in a tick, with the number behind each |
//! | [`state`] | INIT, CONNECT, STANDBY, RUN, HOLD, REVERT, VENT, FAULT, STOP |
//! | [`transition`] | [`next`]: from memory and inputs to memory and action |
//!
//! The daemon's tick collects what it found into [`Inputs`], calls [`next`] once, and does what the [`Action`] says.
//! Everything here is `Copy`, bounded and allocation-free, and may run in the tick.

pub mod condition;
pub mod condition_set;
pub mod state;
pub mod transition;

pub use condition::{Condition, Severity};
pub use condition_set::ConditionSet;
pub use state::State;
pub use transition::{
    Action, Actuation, Arming, ControlledBy, FRAMES_TO_ARM, Inputs, Integration, Memory, Request, Tick, Transition,
    next,
};
