//! The daemon's states, what can be wrong, and who arms, as the rest of the daemon names them.
//!
//! All are the supervisor's ([`supervisor`]), where the one pure function stands that moves between the states.

pub use supervisor::{Arming, Condition, FRAMES_TO_ARM, State};
