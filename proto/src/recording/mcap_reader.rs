//! A daemon's MCAP file, whole or cut short, back to the ticks that went in.
//!
//! The file is read from its beginning, without its index, so a file that a crash cut short reads
//! the same way: chunk by chunk until something is not whole. What cannot be read is said in a note;
//! a chunk whose CRC is wrong is left out, those after it are still read. Ticks come back bit for
//! bit, NaN payloads included.
//!
//! Left out: compressed chunks (our writer makes none) and MCAP files of other programs.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use mcap::McapError;
use mcap::read::{ChunkReader, LinearReader};
use mcap::records::{ChunkHeader, Record};

use super::mcap_writer::{Event, EventLevel, topic};
use super::protobuf::DecodeError;
use super::recording_info::{Attachment, FORMAT, METADATA};
use super::schema::{self, Log};
use super::tick::{COMMAND_BYTES, SENSE_BYTES, TickRecord};

/// Everything that a recording holds.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct McapContent {
    /// The ticks, in the order in which they were written.
    pub ticks: Vec<TickRecord>,
    /// The events, in the order in which they were written.
    pub events: Vec<Event>,
    /// The metadata of the run: program, start, policy, seed.
    pub metadata: BTreeMap<String, String>,
    /// The files inside: configuration, rig.
    pub attachments: Vec<Attachment>,
    /// True when the file was finished and nothing of it was left out.
    pub complete: bool,
    /// What could not be read, a line each.
    pub notes: Vec<String>,
}

/// Why a file is no recording.
#[derive(Debug, thiserror::Error)]
pub enum ReadMcapError {
    /// The file cannot be read.
    #[error("{file}: cannot read the recording: {source}")]
    Read {
        /// The file.
        file: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// Nothing in it.
    #[error("{file}: the file is empty")]
    Empty {
        /// The file.
        file: String,
    },
    /// The first bytes are not MCAP's.
    #[error("{file}: not an MCAP file: the first bytes are wrong")]
    NotMcap {
        /// The file.
        file: String,
    },
    /// An MCAP file of another program.
    #[error("{file}: an MCAP file, but not a recording of the controller: {problem}")]
    Foreign {
        /// The file.
        file: String,
        /// What is missing.
        problem: ForeignMcap,
    },
    /// A recording of a later version.
    #[error("{file}: recording format {found}; this program reads up to {known}: use a newer one")]
    Later {
        /// The file.
        file: String,
        /// The file's format.
        found: String,
        /// The latest format known here.
        known: u32,
    },
    /// A recording that ends before its first tick.
    #[error("{file}: the recording holds no tick{}", .notes.first().map(|note| format!("; {note}")).unwrap_or_default())]
    NoTicks {
        /// The file.
        file: String,
        /// What could not be read.
        notes: Vec<String>,
    },
}

/// What an MCAP file of another program lacks.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ForeignMcap {
    /// No topic with ticks.
    #[error("it has no topic /tick of type pneumatic.Tick")]
    NoTickTopic,
    /// Compressed chunks.
    #[error("its chunks are compressed with {0}; convert it with `mcap compress --compression none`")]
    Compressed(String),
}

/// Reads a recording.
///
/// # Errors
/// The file cannot be read, is no MCAP file, is none of ours, or holds no tick. A damaged or
/// missing end is no error: see [`McapContent::notes`].
pub fn read_mcap(path: &Path) -> Result<McapContent, ReadMcapError> {
    let file = path.display().to_string();
    let bytes = std::fs::read(path).map_err(|source| ReadMcapError::Read { file: file.clone(), source })?;
    parse_mcap(&file, &bytes)
}

/// Reads a recording that is in memory; `file` is the name that errors and notes carry.
///
/// # Errors
/// As [`read_mcap`].
pub fn parse_mcap(file: &str, bytes: &[u8]) -> Result<McapContent, ReadMcapError> {
    if bytes.is_empty() {
        return Err(ReadMcapError::Empty { file: file.to_owned() });
    }
    if !bytes.starts_with(mcap::MAGIC) {
        return Err(ReadMcapError::NotMcap { file: file.to_owned() });
    }
    let mut gathering = Gathering { file, ..Gathering::default() };
    let unreadable = gathering.read(bytes)?;
    let Gathering { mut content, topics, foreign_ticks, ended, .. } = gathering;
    let has_tick_topic = topics.values().any(|topic| *topic == Topic::Tick);
    if let Some(error) = unreadable {
        content.notes.push(format!("{file}: {}", cut_short(&error, content.ticks.len())));
    } else if !ended {
        let ticks = content.ticks.len();
        content.notes.push(format!("{file}: not finished (its end is missing); read {ticks} ticks"));
    }
    if foreign_ticks || (ended && !has_tick_topic) {
        let problem = ForeignMcap::NoTickTopic;
        return Err(ReadMcapError::Foreign { file: file.to_owned(), problem });
    }
    if content.ticks.is_empty() {
        return Err(ReadMcapError::NoTicks { file: file.to_owned(), notes: content.notes });
    }
    content.complete = content.notes.is_empty();
    Ok(content)
}

/// Which topic a channel carries.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Topic {
    Tick,
    Sense,
    Command,
    Event,
}

#[derive(Debug, Default)]
struct Gathering<'a> {
    file: &'a str,
    content: McapContent,
    schemas: HashMap<u16, String>,
    topics: HashMap<u16, Topic>,
    foreign_ticks: bool,
    // Frames of the tick that is still to come, with its sequence number.
    sense: Option<(u32, [u8; SENSE_BYTES])>,
    command: Option<(u32, [u8; COMMAND_BYTES])>,
    ended: bool,
}

impl Gathering<'_> {
    /// Reads as far as the file goes; returns what stopped it before its end.
    fn read(&mut self, bytes: &[u8]) -> Result<Option<McapError>, ReadMcapError> {
        let options = mcap::read::Options::IgnoreEndMagic.into();
        let records = match LinearReader::new_with_options(bytes, options) {
            Ok(records) => records,
            Err(error) => return Ok(Some(error)),
        };
        for record in records {
            match record {
                Ok(Record::Chunk { header, data }) => self.chunk(header, &data)?,
                Ok(Record::DataEnd(_)) => {
                    // What follows is the index, which repeats what was read.
                    self.ended = true;
                    return Ok(None);
                }
                Ok(record) => self.record(record)?,
                Err(error) => return Ok(Some(error)),
            }
        }
        Ok(None)
    }

    fn chunk(&mut self, header: ChunkHeader, data: &[u8]) -> Result<(), ReadMcapError> {
        if !header.compression.is_empty() {
            let problem = ForeignMcap::Compressed(header.compression);
            return Err(ReadMcapError::Foreign { file: self.file.to_owned(), problem });
        }
        let crc = header.uncompressed_crc;
        if crc != 0 && crc != crc32fast::hash(data) {
            self.note("a chunk is damaged (its CRC is wrong) and was left out");
            return Ok(());
        }
        let records = match ChunkReader::new(header, data) {
            Ok(records) => records,
            Err(error) => {
                self.note(&format!("a chunk is damaged and was left out: {error}"));
                return Ok(());
            }
        };
        for record in records {
            match record {
                Ok(record) => self.record(record)?,
                Err(error) => {
                    self.note(&format!("a chunk is damaged and was read in part: {error}"));
                    return Ok(());
                }
            }
        }
        Ok(())
    }

    fn record(&mut self, record: Record<'_>) -> Result<(), ReadMcapError> {
        match record {
            Record::Schema { header, .. } => {
                self.schemas.insert(header.id, header.name);
            }
            Record::Channel(channel) => {
                let schema = self.schemas.get(&channel.schema_id).map(String::as_str);
                let topic = match (channel.topic.as_str(), schema) {
                    (topic::TICK, Some(schema::TICK)) => Topic::Tick,
                    (topic::SENSE, Some(schema::FRAME)) => Topic::Sense,
                    (topic::COMMAND, Some(schema::FRAME)) => Topic::Command,
                    (topic::EVENT, Some(schema::LOG)) => Topic::Event,
                    (topic::TICK, _) => {
                        self.foreign_ticks = true;
                        return Ok(());
                    }
                    _ => return Ok(()),
                };
                self.topics.insert(channel.id, topic);
            }
            Record::Message { header, data } => {
                let Some(topic) = self.topics.get(&header.channel_id).copied() else {
                    return Ok(());
                };
                if let Err(error) = self.message(topic, header.sequence, &data) {
                    let sequence = header.sequence;
                    self.note(&format!("message {sequence} cannot be read: {error}"));
                }
            }
            Record::Metadata(metadata) if metadata.name == METADATA => {
                self.content.metadata = metadata.metadata;
                self.check_format()?;
            }
            Record::Attachment { header, data, .. } => {
                self.content.attachments.push(Attachment {
                    name: header.name,
                    media_type: header.media_type,
                    data: data.into_owned(),
                });
            }
            _ => {}
        }
        Ok(())
    }

    fn message(&mut self, topic: Topic, sequence: u32, data: &[u8]) -> Result<(), DecodeError> {
        match topic {
            Topic::Sense => {
                let frame = schema::decode_frame(data)?;
                self.sense = Some((sequence, frame.try_into().map_err(|_| DecodeError::Value(1))?));
            }
            Topic::Command => {
                let frame = schema::decode_frame(data)?;
                self.command = Some((sequence, frame.try_into().map_err(|_| DecodeError::Value(1))?));
            }
            Topic::Tick => {
                let mut tick = schema::decode_tick(data)?;
                if let Some((_, frame)) = self.sense.take_if(|(of, _)| *of == sequence) {
                    (tick.sense_present, tick.sense) = (true, frame);
                }
                if let Some((_, frame)) = self.command.take_if(|(of, _)| *of == sequence) {
                    (tick.command_present, tick.command) = (true, frame);
                }
                self.content.ticks.push(tick);
            }
            Topic::Event => {
                let log = Log::decode(data)?;
                let level = EventLevel::from_code(log.level);
                let Log { unix_ns, message, name, .. } = log;
                self.content.events.push(Event { unix_ns, level, part: name, message });
            }
        }
        Ok(())
    }

    fn check_format(&self) -> Result<(), ReadMcapError> {
        let Some(found) = self.content.metadata.get("format") else { return Ok(()) };
        if found.parse::<u32>().is_ok_and(|found| found <= FORMAT) {
            return Ok(());
        }
        Err(ReadMcapError::Later { file: self.file.to_owned(), found: found.clone(), known: FORMAT })
    }

    fn note(&mut self, text: &str) {
        self.content.notes.push(format!("{}: {text}", self.file));
    }
}

fn cut_short(error: &McapError, ticks: usize) -> String {
    match error {
        McapError::UnexpectedEof => format!("cut short within a chunk; read the {ticks} ticks before it"),
        error => format!("unreadable from here on ({error}); read the {ticks} ticks before it"),
    }
}
