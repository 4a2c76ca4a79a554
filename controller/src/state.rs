//! The daemon's states and what can be wrong, as the rest of the daemon names them.
//!
//! Both are the supervisor's ([`supervisor`]), where the one pure function stands that moves between the states.

pub use supervisor::{Condition, FRAMES_TO_ARM, State};
