//! Rigs run over recordings: many at once, freely or from many starts.
//!
//! | file | subject |
//! | --- | --- |
//! | `arcs` | where simulations start: once per recording, or anew in every window |
//! | `chains` | stretches of recordings that can lie side by side |
//! | `lanes` | eight rigs of one structure, each through a stretch of its own |
//! | `simulator` | many rigs through all recordings, on all cores |
//! | `start` | starts that noise does not spoil |
//! | `ripple` | a piston pump's ripple at every reading, from runs whose cranks start at many angles |
//! | `tachometer` | how fast the pump turned, told from its ripple |
//! | `in_step` | the ripple of a speed that keeps step, as the readings have it |
//! | `track` | the course of a speed that keeps no step with the sampling |
//! | `course` | courses that a pump's speed may take |
//! | `windows` | products of readings and of a ripple that turns |
//! | `horizon` | how far off a rig is after 1 s, 10 s, or for ever |
//!
//! A fit runs the same recordings hundreds of times with parameters a little off. Eight such rigs lie side by side in
//! the lanes of the model, be it eight rigs on one recording or three on three of them; groups of eight are shared out among
//! the cores, and nothing is allocated per row.

mod arcs;
mod chains;
mod course;
mod flappers;
mod horizon;
mod in_step;
mod lanes;
mod ripple;
mod simulator;
mod start;
mod tachometer;
mod track;
mod windows;

pub use arcs::{Arc, Arcs, Flapper};
pub use course::{Course, Droop, Warming};
pub use flappers::{Look, Room, flappers_of, rooms};
pub use horizon::{ChannelError, Horizon, errors, errors_at, trace_at, traces_at};
pub use in_step::ripple_in_step;
pub use ripple::Ripple;
pub use simulator::{Fidelity, Run, Simulator};
pub(crate) use start::NUDGE_KPA;
pub use start::{refined_starts, smoothed_kpa, with_flappers};
pub use tachometer::{Tachometer, supposed, tachometer};
pub use track::{Track, track};
