//! Plausibility of what the cRIO says, tick by tick: nothing is believed unchecked.
//!
//! | module | subject |
//! | --- | --- |
//! | [`frame_gate`] | sequence number, clock, tick number and sample rate of the frames |
//! | [`loss_window`] | how many of the last 100 ticks were bad |
//! | [`command_echo`] | command in force, duty echo, state, pump, trip bits |
//! | [`frozen_reading`] | a reading that stands still although it used to scatter |
//! | [`jump`] | a reading that jumps away from what it could be |
//! | `hypothesis`, [`model_residual`] | readings against what models foresaw |
//! | `reference_motion` | how fast the references have moved of late, and whether noise moved the valves |
//! | `slowness` | how many times slower a rig is than its model |
//! | `coupling` | the reading that is wrong where one contradicts its model: the pump couples the chambers |
//! | `standing` | a reading that rests where its model says that it must go on |
//! | [`monitor_models`] | the models of all that, which can be exchanged |
//! | [`lagged_command`] | a command as a slow valve follows it |
//! | [`tracking`] | pressures that stay away from their references |
//! | [`vent_check`] | whether venting is reported and the pressure falls |
//! | [`plausibility`] | all of it for one tick |
//!
//! Findings are [`supervisor::Condition`]s; what follows from them is `supervisor`'s business. No socket, no thread, no
//! clock of its own; bounded and allocation-free after construction, so all of it may run in the tick.

pub mod command_echo;
mod coupling;
pub mod frame_gate;
pub mod frozen_reading;
mod hypothesis;
pub mod jump;
pub mod lagged_command;
pub mod loss_window;
pub mod model_residual;
pub mod monitor_models;
pub mod plausibility;
mod reference_motion;
mod slowness;
mod standing;
pub mod tracking;
pub mod vent_check;

pub use command_echo::{CommandEcho, SentCommand};
pub use frame_gate::{FrameGate, Pacing, Rejection};
pub use loss_window::LossWindow;
pub use monitor_models::MonitorModels;
pub use plausibility::{Frame, Monitor};
pub use reference_motion::Excitation;
