//! The daemon that flies the dual-pressure rig at 50 Hz.
//!
//! | module | subject |
//! | --- | --- |
//! | [`config`] | the configuration file |
//! | [`sensing`] | volts to pressures |
//! | [`state`] | states and what moves between them |
//! | [`pilot`] | policy or fallback |
//! | [`cycle`] | one tick: frame in, command out; no socket, no clock |
//! | [`pacing`] | when a frame is due |
//! | [`link`] | TCP to the cRIO |
//! | [`flying`] | the tick's thread |
//! | [`realtime`] | scheduling, memory |
//! | [`panel`], [`socket`] | the operator |
//! | [`notice`] | what a person is told |
//! | [`contract`] | the observation contract for the policy loader |
//! | [`daemon`] | puts it all together |
//!
//! Beside this crate: `law` (control laws, shared with the trainer), `policy` (ONNX), `flight` (recorder,
//! figures, report). Nothing in the tick allocates, locks, or touches a file.

pub mod clock;
pub mod config;
pub mod contract;
pub mod cycle;
pub mod daemon;
pub mod flying;
pub mod link;
pub mod notice;
pub mod pacing;
pub mod panel;
pub mod pilot;
pub mod realtime;
pub mod sensing;
pub mod socket;
pub mod state;
