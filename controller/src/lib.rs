//! The daemon that controls the dual-pressure rig at 50 Hz.
//!
//! | module | subject |
//! | --- | --- |
//! | [`config`], [`reload`] | the configuration file, and what a running daemon takes over from it |
//! | [`state`] | states and what moves between them |
//! | [`cycle`] | one tick, frame in, command out: readings, control law, safety filter; no socket, no clock |
//! | [`session`] | the tick's thread: TCP to the cRIO, pacing, recording, live stream |
//! | [`experiment`] | a sequence of commands, checked, simulated, played open loop and recorded |
//! | [`operator`] | the operator's socket and what a person is told |
//! | [`policy_service`], [`policy_signatures`] | policies beside the tick: what controls from the start, the watched directory |
//! | [`model_change`] | another model, put in at a tick's edge |
//! | [`machine`] | scheduling, memory, watchdogs, signals; whether this machine is fit |
//! | [`replay`] | a recorded run again, bit for bit |
//! | [`daemon`] | puts it all together for a reference |
//! | [`yardstick`] | what the fallback reaches on a rig and a reference |
//!
//! Beside this crate: `law` (control laws, shared with the trainer), `policy` (ONNX), `admission`, `handover` and
//! `policy_store` (from a published policy to an active one), `safety_filter`, `flight` (recorder,
//! figures, report). Nothing in the tick allocates, locks, or touches a file, but for
//! the kernel's count of stolen time once a deadline has been missed.

pub mod config;
pub mod cycle;
pub mod daemon;
pub mod experiment;
pub mod machine;
pub mod model_change;
pub mod operator;
pub mod policy_service;
pub mod policy_signatures;
pub mod reach;
pub mod reload;
pub mod replay;
pub mod session;
pub mod state;
pub mod yardstick;
