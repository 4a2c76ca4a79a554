//! The daemon's own recordings, MCAP with protobuf messages: written a second at a time, read whole, cut short, or while they grow.

pub mod attached;
pub(crate) mod damaged_chunks;
pub(crate) mod decompress;
mod file_index;
pub(crate) mod follower;
pub(crate) mod from_ticks;
pub(crate) mod gathering;
pub(crate) mod log_clock;
mod lost_attachments;
pub(crate) mod messages;
pub(crate) mod protobuf;
pub(crate) mod raw_record;
pub(crate) mod reader;
pub(crate) mod recording_info;
pub(crate) mod schema;
pub(crate) mod tick;
pub(crate) mod tick_order;
pub(crate) mod tick_table;
pub(crate) mod wall_clock;
mod way_through_file;
pub(crate) mod writer;
