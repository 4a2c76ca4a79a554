//! A run-time assurance filter between any controller and the valves.
//!
//! The Simplex architecture (Sha, "Using simplicity to control complexity", IEEE Software 2001) with the backup
//! set of a backup control barrier function found by simulation (Hobbs et al., "Run time assurance for safety-critical
//! systems", arXiv:2110.03506; Mehmood et al., "The black-box Simplex architecture", arXiv:2102.12981). The backup
//! controller is the one that every fault ends in: both vents open.
//!
//! ```text
//! command u ─▶ slew limit ─▶ the model under u for a tick, then vented: does any of eight rigs leave the envelope?
//!                 │ none                                   │ one does
//!                 ▼                                        ▼
//!              sent as it is                 bent toward vent, u + λ (1 − u), with the least λ that does not (bisected)
//! ```
//!
//! | module | subject |
//! | --- | --- |
//! | [`hypotheses`] | the eight rigs: the model, and the model with delay, lag, closed-side error, volume, sensor error |
//! | [`actuator_path`] | what reaches the valves of each: delay, lag, offset |
//! | [`filter`] | the look ahead, the bisection, the slew limit |
//!
//! By induction the envelope is kept as long as the rig behaves within the eight: a command is only sent if venting
//! after it still keeps it, and where the next command does not pass, vent is sent. What lies outside of them (a stuck
//! valve, a sensor that lies by more) is for the monitor and for the relief valve.

pub mod actuator_path;
pub mod filter;
pub mod hypotheses;

pub use filter::{Envelope, Filtered, Intervention, SafetyFilter, SlewLimit};
