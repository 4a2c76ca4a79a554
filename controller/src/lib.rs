//! The daemon that flies the dual-pressure rig at 50 Hz.
//!
//! | module | subject |
//! | --- | --- |
//! | [`config`] | the configuration file |
//! | [`sensing`] | volts to pressures |
//! | [`state`] | states and what moves between them |
//! | [`cycle`] | one tick: frame in, command out; no socket, no clock |
//! | [`helm`] | who decides the duties while the rig is armed |
//! | [`following`] | a reference, closed loop |
//! | [`pilot`] | policy or fallback |
//! | [`playing`] | a programme of commands, open loop |
//! | [`calm`] | whether the pressures stand still |
//! | [`programme`], [`forecast`], [`witness`] | commands from a file; what the model says they will do; what they did |
//! | [`pacing`] | when a frame is due |
//! | [`link`] | TCP to the cRIO |
//! | [`flying`] | the tick's thread |
//! | [`realtime`] | scheduling, memory |
//! | [`panel`], [`socket`] | the operator |
//! | [`notice`] | what a person is told |
//! | [`contract`] | the observation contract for the policy loader |
//! | [`logbook`] | a flight with its recording, from the file made to the file finished |
//! | [`daemon`] | puts it all together for a reference |
//! | [`experiment`] | and for a programme |
//!
//! Beside this crate: `law` (control laws, shared with the trainer), `policy` (ONNX), `flight` (recorder,
//! figures, report). Nothing in the tick allocates, locks, or touches a file.

pub mod calm;
pub mod clock;
pub mod config;
pub mod contract;
pub mod cycle;
pub mod daemon;
pub mod experiment;
pub mod flying;
pub mod following;
pub mod forecast;
pub mod helm;
pub mod link;
pub mod logbook;
pub mod notice;
pub mod pacing;
pub mod panel;
pub mod pilot;
pub mod playing;
pub mod programme;
pub mod realtime;
pub mod sensing;
pub mod socket;
pub mod state;
pub mod witness;
