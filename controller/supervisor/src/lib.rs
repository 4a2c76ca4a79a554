//! States and faults of the daemon: one pure function, without socket, clock, thread or file.
//!
//! | module | subject |
//! | --- | --- |
//! | [`condition`] | everything that can be wrong, in one list from the least to the worst |
//! | [`condition_set`] | the conditions that hold in a tick, with the number behind each |
//! | [`state`] | INIT, CONNECT, STANDBY, RUN, HOLD, REVERT, VENT, FAULT, STOP |
//! | [`inputs`] | what made a call, and what is asked for |
//! | [`memory`] | what is remembered from tick to tick |
//! | [`action`] | what goes to the valves, and what a person is told |
//! | [`transition`] | [`next`]: from memory and inputs to memory and action |
//!
//! The daemon's tick collects what it found into [`Inputs`], calls [`next`] once, and does what the [`Action`] says.
//! Everything here is `Copy`, bounded and allocation-free, and may run in the tick.

pub mod action;
pub mod condition;
pub mod condition_set;
pub mod inputs;
pub mod memory;
pub mod state;
pub mod transition;

pub use action::{Acknowledgement, Action, Actuation, ControlledBy, Integration, Transition};
pub use condition::{Condition, Severity};
pub use condition_set::ConditionSet;
pub use inputs::{Arming, Inputs, Request, Tick};
pub use memory::{FRAMES_TO_ARM, Memory};
pub use state::State;
pub use transition::next;
