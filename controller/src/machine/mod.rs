//! The machine below the daemon: scheduling, memory, watchdogs, signals, and whether it is fit for 50 Hz.
//!
//! | module | subject |
//! | --- | --- |
//! | [`realtime`] | scheduling, memory |
//! | [`guard`] | the watchdog thread above the tick |
//! | [`systemd`] | ready, alive, stopping |
//! | [`signals`] | what signals do |
//! | [`clock`] | the daemon's clock |
//! | [`machine_check`] | whether this machine has what a configuration names |
//! | `trial_file` | whether something can be made in a folder |
//! | [`tick_trial`] | how long a tick takes here |
//! | [`rt_test`] | how late this machine is, and why |

pub mod clock;
pub mod guard;
pub mod machine_check;
pub mod realtime;
pub mod rt_test;
pub mod signals;
pub mod systemd;
pub mod tick_trial;
pub(crate) mod trial_file;
