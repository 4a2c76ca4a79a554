//! The daemon that flies the dual-pressure rig at 50 Hz.
//!
//! | module | subject |
//! | --- | --- |
//! | [`config`] | the configuration file |
//! | [`sensing`] | volts to pressures |
//! | [`state`] | states and what moves between them |
//! | [`cycle`] | one tick: frame in, command out; no socket, no clock |
//! | [`duty_source`] | who decides the duties while the rig is armed |
//! | [`reference_tracking`] | a reference, closed loop |
//! | [`open_loop_playback`] | a sequence of commands, open loop |
//! | [`running_source`] | a reference, with an experiment in between |
//! | [`settling`] | whether the pressures stand still |
//! | [`command_sequence`], [`preflight_simulation`], [`playback_report`] | commands from a file; what the model says they will do; what they did |
//! | [`pump_relay`] | whether the pump can be switched |
//! | [`pacing`] | when a frame is due |
//! | [`link`] | TCP to the cRIO |
//! | [`session`] | the tick's thread |
//! | [`replay`] | a recorded run again, bit for bit |
//! | [`run_file`] | a recorded run, read back |
//! | [`run_length`] | when a run of so many seconds is over |
//! | [`machine_check`], [`tick_trial`] | whether this machine has what a configuration needs; how long a tick takes |
//! | [`realtime`] | scheduling, memory |
//! | [`rt_test`] | how late this machine is, and why |
//! | [`live_stream`] | what live viewers are sent |
//! | [`mailbox`], [`desk`], [`socket`], `bound_socket`, [`operator_protocol`], [`peer`] | the operator |
//! | [`signals`], [`reload`], [`console`] | signals, the configuration read again, lines for a person |
//! | [`reference_limits`] | how near a reference may come to the safety envelope |
//! | [`attribution`] | what a missed deadline is put down to |
//! | [`guard`], [`systemd`] | the watchdogs |
//! | [`notice`], [`fault_text`] | what a person is told |
//! | [`policy_service`] | policies beside the tick: what controls from the start, the watched directory |
//! | [`model_change`] | another model, put in at a tick's edge |
//! | [`policy_signatures`] | the observation layouts for the policy loader |
//! | [`session_recorder`] | a flight with its recording, from the file made to the file finished |
//! | [`daemon`] | puts it all together for a reference |
//! | [`experiment`] | and for a sequence |
//! | [`experiment_log`] | the recording of a sequence that is played within a run |
//! | [`yardstick`] | what the fallback reaches on a rig and a reference |
//!
//! Beside this crate: `law` (control laws, shared with the trainer), `policy` (ONNX), `admission`, `handover` and
//! `policy_store` (from a published policy to an active one), `safety_filter`, `flight` (recorder,
//! figures, report). Nothing in the tick allocates, locks, or touches a file, but for
//! the kernel's count of stolen time once a deadline has been missed.

pub mod attribution;
mod bound_socket;
pub mod clock;
pub mod command_sequence;
pub mod config;
pub mod console;
pub mod cycle;
pub mod daemon;
pub mod desk;
pub mod duty_source;
pub mod experiment;
pub mod experiment_log;
pub mod fault_text;
pub mod guard;
pub mod link;
pub mod live_stream;
pub mod machine_check;
pub mod mailbox;
pub mod model_change;
pub mod notice;
pub mod open_loop_playback;
pub mod operator_protocol;
pub mod pacing;
pub mod peer;
pub mod playback_report;
pub mod policy_service;
pub mod policy_signatures;
pub mod preflight_simulation;
pub mod pump_relay;
pub mod realtime;
mod recorded_orders;
pub mod reference_limits;
pub mod reference_tracking;
pub mod reload;
pub mod replay;
pub mod rt_test;
pub mod run_file;
pub mod run_length;
pub mod running_source;
pub mod sensing;
pub mod session;
mod session_loop;
pub mod session_recorder;
pub mod settling;
pub mod signals;
pub mod socket;
pub mod state;
pub mod systemd;
pub mod tick_trial;
pub mod yardstick;
