//! The paper's tables: controllers side by side on the same rigs.
//!
//! | module | subject |
//! | --- | --- |
//! | [`dob`] | the disturbance-observer controller that the paper compares with |
//! | [`mpc`] | offset-free nonlinear model-predictive control |
//! | [`optimal_open_loop`] | the clairvoyant optimum: what any controller could reach that knows rig and reference |
//! | [`comparison`] | controllers on rigs |
//! | [`table`] | tables as JSON, Markdown and page |
//! | [`join`] | tables of one kind put together |
//! | [`payload`] | rigs with an actuator that carries a load |
//! | [`rigs_around`] | rigs randomised around a given one |

pub mod comparison;
pub mod dob;
pub mod join;
pub mod mpc;
pub mod optimal_open_loop;
pub mod payload;
mod present_names;
pub mod repeated;
pub mod rigs_around;
pub mod table;

pub use dob::Dob;
pub use environment::score::SKIPPED_S;
pub use mpc::{Mpc, TickTimes};
pub use optimal_open_loop::OptimalOpenLoop;
pub use repeated::RepeatedFallback;
