//! Messages of a recording on their own, for those who carry them elsewhere than in a file.

use super::schema::{self, Log};
use super::tick::TickRecord;
use super::writer::{Event, EventLevel};

/// Schema of a channel of a recording, for tools that are told before they are sent anything.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MessageSchema {
    /// Topic.
    pub topic: &'static str,
    /// Full name of the message.
    pub name: &'static str,
    /// A serialized `FileDescriptorSet`.
    pub descriptors: Vec<u8>,
}

/// The schemas of ticks and of events.
pub fn message_schemas() -> [MessageSchema; 2] {
    use crate::recording::mcap_file::writer::topic;
    [
        MessageSchema { topic: topic::TICK, name: schema::TICK, descriptors: schema::pneumatic_schema() },
        MessageSchema { topic: topic::EVENT, name: schema::LOG, descriptors: schema::log_schema() },
    ]
}

/// Appends a tick as a `pneumatic.Tick`, without its raw frames.
pub fn encode_tick_message(tick: &TickRecord, out: &mut Vec<u8>) {
    schema::encode_tick(tick, out);
}

/// Reads a `pneumatic.Tick`.
///
/// # Errors
/// Problem of the bytes.
pub fn decode_tick_message(bytes: &[u8]) -> Result<TickRecord, String> {
    schema::decode_tick(bytes).map_err(|error| error.to_string())
}

/// Appends an event as a `foxglove.Log`.
pub fn encode_log_message(unix_ns: u64, level: EventLevel, part: &str, message: &str, out: &mut Vec<u8>) {
    Log { unix_ns, level: level.code(), message: message.to_owned(), name: part.to_owned() }.encode(out);
}

/// Reads a `foxglove.Log`.
///
/// # Errors
/// Problem of the bytes.
pub fn decode_log_message(bytes: &[u8]) -> Result<Event, String> {
    let Log { unix_ns, level, message, name } = Log::decode(bytes).map_err(|error| error.to_string())?;
    Ok(Event { unix_ns, level: EventLevel::from_code(level), part: name, message })
}
