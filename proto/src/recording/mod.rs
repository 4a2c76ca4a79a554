//! Recordings: what the daemon writes, what every offline command reads.
//!
//! | part | what |
//! | --- | --- |
//! | [`TickRecord`] | one tick of the daemon, plain data for a lock-free queue |
//! | [`RecordingWriter`] | `TickRecord`s to an MCAP file, a second at a time |
//! | [`read_mcap`] | an MCAP file, whole or truncated, back to the same `TickRecord`s |
//! | [`McapFollower`] | the same, while the file grows |
//! | [`Recording`] | a table of named columns over time, from MCAP or CSV |
//! | `read_for` | [`Recording::read_for`]: any file for a rig, as its `[recording]` table says; the way in of every command |
//! | `logger_text`, `labview`, `mat5`, `hdf5` | what loggers, LabVIEW, MATLAB and HDF5's users write, to a `sheet` of named columns |
//! | `columns`, `times`, `timestamps`, `units` | a sheet's columns in the rig's units, and its times |
//! | `packed` | files that were compressed as a whole |
//! | `resample` | samples of any rate to rows of 20 ms; lost rows bridged |
//! | [`csv`] | the checked CSV table below it, used for reference files too |
//!
//! The time convention of every recording: row *k* holds the reading at `t_k` and the command
//! applied from `t_k` to `t_{k+1}`; rows are 20 ms apart; pressures are gauge kPa.
//!
//! Left out: reading MCAP files of other programs (their messages are not ours), and writing compressed ones
//! (see [`RecordingWriter`]).

mod columns;
pub mod csv;
mod logger_file;
mod mcap_file;
mod packed;
mod read_for;
mod recording_error;
mod rows;
mod short_names;
mod table;
mod times;

pub use columns::file_unit::{FileUnit, UnitSource};
pub use mcap_file::attached;
pub use mcap_file::follower::{FollowEnd, McapFollower};
pub use mcap_file::messages::{
    MessageSchema, decode_log_message, decode_tick_message, encode_log_message, encode_tick_message, message_schemas,
};
pub use mcap_file::reader::{ForeignMcap, McapContent, ReadMcapError, parse_mcap, read_mcap};
pub use mcap_file::recording_info::{Attachment, LogTime, RecordingInfo};
pub use mcap_file::tick::{
    Arrival, COMMAND_BYTES, LawParts, PLANNED_OUTPUTS, POLICY_OUTPUTS, PREDICTED_TICKS, SENSE_BYTES, TickInput,
    TickRecord, observation_hash,
};
pub use mcap_file::tick_order::TickOrder;
pub use mcap_file::tick_table::tick_table;
pub use mcap_file::wall_clock::{rfc3339, unix_ns};
pub use mcap_file::writer::{Event, EventLevel, RecordingWriter, VERDICT, WriteMcapError, unfinished_path};
pub use packed::unpacked;
pub use recording_error::RecordingError;
pub use short_names::short_name;
pub use table::{MAX_STEP_S, PERIOD_S, Recording};

/// Largest recording that is read (bytes): a week at 50 Hz has 6 GiB, and it is read into memory as a whole.
pub const MOST_BYTES: u64 = 8 << 30;
