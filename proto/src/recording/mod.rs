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
//! | `logger_text`, `labview`, `mat5` | what loggers, LabVIEW and MATLAB write, to a `sheet` of named columns |
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

pub mod attached;
mod bursts;
mod cells;
mod columns;
mod counter_wrap;
pub mod csv;
mod csv_error;
mod damaged_chunks;
mod decompress;
mod doubled;
mod file_kind;
mod file_unit;
mod from_ticks;
mod in_rig_unit;
mod labview;
mod labview_rates;
mod log_clock;
mod logger_text;
mod long_format;
mod lost_rows;
mod mat5;
mod mcap_follower;
mod mcap_reader;
mod mcap_writer;
mod messages;
mod milliseconds;
mod month_names;
mod numbers;
mod packed;
mod protobuf;
mod read_for;
mod recording_error;
mod recording_info;
mod remarks;
mod repeated;
mod resample;
mod row_names;
mod schema;
mod serial_monitor;
mod sheet;
mod short_names;
mod slower;
mod table;
mod table_head;
mod text_encoding;
mod tick;
mod tick_order;
mod tick_table;
mod time_notes;
mod times;
mod timestamps;
mod units;
mod unlikely_times;
mod wall_clock;

pub use file_unit::{FileUnit, UnitSource};
pub use mcap_follower::{FollowEnd, McapFollower};
pub use mcap_reader::{ForeignMcap, McapContent, ReadMcapError, parse_mcap, read_mcap};
pub use mcap_writer::{Event, EventLevel, RecordingWriter, VERDICT, WriteMcapError, unfinished_path};
pub use messages::{
    MessageSchema, decode_log_message, decode_tick_message, encode_log_message, encode_tick_message, message_schemas,
};
pub use packed::unpacked;
pub use recording_error::RecordingError;
pub use recording_info::{Attachment, LogTime, RecordingInfo};
pub use short_names::short_name;
pub use table::{MAX_STEP_S, PERIOD_S, Recording};
pub use tick::{
    Arrival, COMMAND_BYTES, LawParts, PLANNED_OUTPUTS, POLICY_OUTPUTS, PREDICTED_TICKS, SENSE_BYTES, TickInput,
    TickRecord, observation_hash,
};
pub use tick_order::TickOrder;
pub use tick_table::tick_table;
pub use wall_clock::rfc3339;

/// Largest recording that is read (bytes): a week at 50 Hz has 6 GiB, and it is read into memory as a whole.
pub const MOST_BYTES: u64 = 8 << 30;
