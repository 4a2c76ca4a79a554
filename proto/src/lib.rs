//! See the crate's description in Cargo.toml.

pub mod atomic_file;
pub mod diagnosis;
pub mod emulator;
pub mod first_signal;
mod fnv1a;
pub mod live_line;
pub mod output;
pub mod parent_process;
pub mod policy_metadata;
pub mod recording;
pub mod reference;
pub mod regular_file;
pub mod rig_file;
pub mod split_mix;
pub mod stream;
pub mod terminal_lines;
pub mod wire;
