//! A daemon's MCAP file, whole or cut short, back to the ticks that went in.
//!
//! The file is read from its beginning, without its index, so a file that a crash cut short reads
//! the same way: record by record until something is not whole. Of a chunk that is cut every whole
//! message is read. What cannot be read is said in a note; a chunk whose CRC is wrong is left out,
//! those after it are still read. Ticks come back bit for bit, NaN payloads included.
//!
//! Files that another tool saved again are read too: chunks compressed with zstd or lz4, other
//! channel numbers, other orders of messages (frames are put to their ticks by sequence number).
//!
//! Left out: MCAP files of other programs; the error says what is in them.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use mcap::read::parse_record;
use mcap::records::{Record, op};

use super::MOST_BYTES;
use super::damaged_chunks::{self, Damaged};
use super::decompress::{End, decompress};
use super::mcap_writer::{Event, EventLevel, topic};
use super::protobuf::DecodeError;
use super::recording_info::{Attachment, FORMAT, METADATA};
use super::schema::{self, Log};
use super::tick::{COMMAND_BYTES, SENSE_BYTES, TickRecord};
use crate::regular_file;

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

/// Why an MCAP file is none of ours.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ForeignMcap {
    /// No topic with ticks.
    #[error(
        "it has no topic /tick of type pneumatic.Tick; {holds}; write its topics as CSV and name the columns in the rig file, [recording]"
    )]
    NoTickTopic {
        /// What it has instead.
        holds: String,
    },
    /// Chunks compressed in a way that is not known.
    #[error("its chunks are compressed with {0}; convert it with `mcap compress --compression zstd`")]
    Compressed(String),
}

/// Reads a recording.
///
/// # Errors
/// The file cannot be read, is no MCAP file, is none of ours, or holds no tick. A damaged or
/// missing end is no error: see [`McapContent::notes`].
pub fn read_mcap(path: &Path) -> Result<McapContent, ReadMcapError> {
    let file = path.display().to_string();
    let bytes =
        regular_file::read(path, MOST_BYTES).map_err(|source| ReadMcapError::Read { file: file.clone(), source })?;
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
    let mut gathering = Gathering::of(file);
    let end = gathering.read(bytes)?;
    let Gathering { content, topics, damaged, .. } = &mut gathering;
    damaged_chunks::tell(&mut content.notes, damaged, |channel| topics.get(&channel) == Some(&Topic::Tick));
    let Gathering { mut content, topics, foreign_ticks, holds, ticks: places, .. } = gathering;
    let has_tick_topic = topics.values().any(|topic| *topic == Topic::Tick);
    let ticks = content.ticks.len();
    let whole = matches!(end, FileEnd::Reached);
    match end {
        FileEnd::Reached => {}
        FileEnd::Missing => {
            content.notes.push(format!("{file}: not finished (its end is missing); read {ticks} ticks"))
        }
        FileEnd::Cut => content.notes.push(format!("{file}: cut short; read the {ticks} ticks that are whole")),
        FileEnd::Unreadable(error) => {
            content.notes.push(format!("{file}: unreadable from here on ({error}); read the {ticks} ticks before it"));
        }
    }
    if foreign_ticks || (whole && !has_tick_topic) {
        let problem = ForeignMcap::NoTickTopic { holds: holds.words() };
        return Err(ReadMcapError::Foreign { file: file.to_owned(), problem });
    }
    if content.ticks.is_empty() {
        return Err(ReadMcapError::NoTicks { file: file.to_owned(), notes: content.notes });
    }
    content.complete = content.notes.is_empty();
    into_order(&mut content.ticks, &places);
    Ok(content)
}

/// Puts ticks that another tool has written in another order back into their own, `places` being where each sequence number stands.
fn into_order(ticks: &mut Vec<TickRecord>, places: &HashMap<u32, usize>) {
    // A tool that numbers messages anew says nothing of their order.
    if places.len() != ticks.len() {
        return;
    }
    let mut order: Vec<(u32, usize)> = places.iter().map(|(sequence, place)| (*sequence, *place)).collect();
    order.sort_unstable();
    if !order.is_sorted_by_key(|(_, place)| *place) {
        *ticks = order.iter().filter_map(|(_, place)| ticks.get(*place)).copied().collect();
    }
}

/// How the file ended.
#[derive(Debug)]
enum FileEnd {
    /// As it should.
    Reached,
    /// Between two records.
    Missing,
    /// Within a record.
    Cut,
    /// At something that is no record.
    Unreadable(String),
}

/// What a file has in it, for one that is none of ours.
#[derive(Debug, Default)]
struct Holds {
    /// Profile and library of its writer.
    written_by: String,
    /// Topics with their types.
    topics: Vec<String>,
}

impl Holds {
    fn words(&self) -> String {
        const TOLD: usize = 6;
        let more = if self.topics.len() > TOLD { ", …" } else { "" };
        let topics = self.topics.iter().take(TOLD).map(String::as_str).collect::<Vec<_>>().join(", ");
        let by = if self.written_by.is_empty() { String::new() } else { format!(" (written by {})", self.written_by) };
        if topics.is_empty() { format!("it has no topics{by}") } else { format!("it has {topics}{more}{by}") }
    }
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
pub(super) struct Gathering {
    pub(super) file: String,
    pub(super) content: McapContent,
    schemas: HashMap<u16, String>,
    topics: HashMap<u16, Topic>,
    foreign_ticks: bool,
    holds: Holds,
    // Frames of ticks that are still to come, and ticks whose frames may be, by sequence number.
    sense: HashMap<u32, [u8; SENSE_BYTES]>,
    command: HashMap<u32, [u8; COMMAND_BYTES]>,
    pub(super) ticks: HashMap<u32, usize>,
    damaged: Vec<Damaged>,
    // Whether what was read last is a damaged chunk, whose index follows it.
    behind_damaged: bool,
}

impl Gathering {
    /// Nothing yet of a file of this name.
    pub(super) fn of(file: &str) -> Self {
        Gathering { file: file.to_owned(), ..Gathering::default() }
    }

    /// Reads as far as the file goes, and tells how it ended.
    fn read(&mut self, bytes: &[u8]) -> Result<FileEnd, ReadMcapError> {
        let mut rest = bytes.get(mcap::MAGIC.len()..).unwrap_or_default();
        while !rest.is_empty() {
            let Some((code, body, after)) = next_record(rest) else {
                self.cut(rest)?;
                return Ok(FileEnd::Cut);
            };
            match code {
                // What follows is the index, which repeats what was read.
                op::DATA_END => return Ok(FileEnd::Reached),
                _ => {
                    if let Some(unreadable) = self.whole_record(code, body)? {
                        return Ok(FileEnd::Unreadable(unreadable));
                    }
                }
            }
            rest = after;
        }
        Ok(FileEnd::Missing)
    }

    /// Takes in a record that is whole and not the end of the data; what is wrong with one that is no record.
    pub(super) fn whole_record(&mut self, code: u8, body: &[u8]) -> Result<Option<String>, ReadMcapError> {
        if code == op::CHUNK {
            self.chunk(body, End::Reached)?;
            return Ok(None);
        }
        match parse_record(code, body) {
            Ok(record) => self.record(record).map(|()| None),
            Err(error) => Ok(Some(error.to_string())),
        }
    }

    /// Takes in what is whole of a record that was cut.
    pub(super) fn cut(&mut self, bytes: &[u8]) -> Result<(), ReadMcapError> {
        match cut_record(bytes) {
            Some((op::CHUNK, body)) => self.chunk(body, End::Missing),
            _ => Ok(()),
        }
    }

    /// Reads a chunk, and keeps in mind what is needed to say what one that is damaged lacks.
    fn chunk(&mut self, body: &[u8], end: End) -> Result<(), ReadMcapError> {
        let (notes, ticks) = (self.content.notes.len(), self.content.ticks.len());
        self.sound_of_chunk(body, end)?;
        self.behind_damaged = end == End::Reached && self.content.notes.len() > notes;
        if self.behind_damaged {
            let read = self.content.ticks.len() - ticks;
            let note = self.content.notes.len() - 1;
            self.damaged.push(Damaged::of(body, note, read));
        }
        Ok(())
    }

    /// Reads what is sound of a chunk: all of one that is whole, every whole message of one that is cut.
    fn sound_of_chunk(&mut self, body: &[u8], end: End) -> Result<(), ReadMcapError> {
        let Some(chunk) = Chunk::of(body, end) else {
            if end == End::Reached {
                self.note("a chunk is damaged and was left out: its head is no chunk's");
            }
            return Ok(());
        };
        if chunk.compression.is_empty() {
            return self.records(chunk.records, chunk.crc, end);
        }
        let decompressed = decompress(chunk.compression, chunk.records, chunk.size).map_err(|unknown| {
            let problem = ForeignMcap::Compressed(unknown.0);
            ReadMcapError::Foreign { file: self.file.clone(), problem }
        })?;
        if end == End::Reached && decompressed.end == End::Missing {
            self.note("a chunk is damaged and was left out: it cannot be decompressed");
            return Ok(());
        }
        self.records(&decompressed.bytes, chunk.crc, end)
    }

    /// Reads the records of a chunk.
    fn records(&mut self, bytes: &[u8], crc: u32, end: End) -> Result<(), ReadMcapError> {
        if end == End::Reached && crc != 0 && crc != crc32fast::hash(bytes) {
            self.note("a chunk is damaged (its CRC is wrong) and was left out");
            return Ok(());
        }
        let mut rest = bytes;
        while let Some((code, body, after)) = next_record(rest) {
            match parse_record(code, body) {
                Ok(record) => self.record(record)?,
                Err(error) => {
                    self.note(&format!("a chunk is damaged and was read in part: {error}"));
                    return Ok(());
                }
            }
            rest = after;
        }
        if end == End::Reached && !rest.is_empty() {
            self.note("a chunk is damaged and was read in part: its last record is cut");
        }
        Ok(())
    }

    fn record(&mut self, record: Record<'_>) -> Result<(), ReadMcapError> {
        match record {
            Record::Header(header) => {
                let words = [header.profile, header.library].into_iter().filter(|word| !word.is_empty());
                self.holds.written_by = words.collect::<Vec<_>>().join(", ");
            }
            Record::Schema { header, .. } => {
                self.schemas.insert(header.id, header.name);
            }
            Record::Channel(channel) => {
                let schema = self.schemas.get(&channel.schema_id).map(String::as_str);
                let held = format!("{} ({})", channel.topic, schema.unwrap_or(&channel.message_encoding));
                if !self.holds.topics.contains(&held) {
                    self.holds.topics.push(held);
                }
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
            Record::MessageIndex(index) if self.behind_damaged => {
                if let Some(damaged) = self.damaged.last_mut() {
                    damaged.index(index.channel_id, index.records.len());
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
                let frame = schema::decode_frame(data)?.try_into().map_err(|_| DecodeError::Value(1))?;
                match self.ticks.get(&sequence).and_then(|at| self.content.ticks.get_mut(*at)) {
                    Some(tick) if !tick.sense_present => (tick.sense_present, tick.sense) = (true, frame),
                    _ => {
                        self.sense.insert(sequence, frame);
                    }
                }
            }
            Topic::Command => {
                let frame = schema::decode_frame(data)?.try_into().map_err(|_| DecodeError::Value(1))?;
                match self.ticks.get(&sequence).and_then(|at| self.content.ticks.get_mut(*at)) {
                    Some(tick) if !tick.command_present => (tick.command_present, tick.command) = (true, frame),
                    _ => {
                        self.command.insert(sequence, frame);
                    }
                }
            }
            Topic::Tick => {
                let mut tick = schema::decode_tick(data)?;
                if let Some(frame) = self.sense.remove(&sequence) {
                    (tick.sense_present, tick.sense) = (true, frame);
                }
                if let Some(frame) = self.command.remove(&sequence) {
                    (tick.command_present, tick.command) = (true, frame);
                }
                self.ticks.insert(sequence, self.content.ticks.len());
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
        Err(ReadMcapError::Later { file: self.file.clone(), found: found.clone(), known: FORMAT })
    }

    fn note(&mut self, text: &str) {
        self.content.notes.push(format!("{}: {text}", self.file));
    }
}

/// Code, body and what follows of the whole record that bytes begin with.
pub(super) fn next_record(bytes: &[u8]) -> Option<(u8, &[u8], &[u8])> {
    let (code, rest) = bytes.split_first()?;
    let (length, rest) = rest.split_first_chunk::<8>()?;
    let (body, after) = rest.split_at_checked(usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
    Some((*code, body, after))
}

/// Code and as much of the body as there is of a record that is cut.
fn cut_record(bytes: &[u8]) -> Option<(u8, &[u8])> {
    let (code, rest) = bytes.split_first()?;
    Some((*code, rest.get(8..)?))
}

/// The head of a chunk and its records, as they are stored.
struct Chunk<'a> {
    /// Bytes that the records come to.
    size: u64,
    /// CRC of these; 0 for none.
    crc: u32,
    compression: &'a str,
    records: &'a [u8],
}

impl<'a> Chunk<'a> {
    /// Takes a chunk's body apart; `None` where it is none, or its records are not all there though it has its end.
    fn of(body: &'a [u8], end: End) -> Option<Self> {
        // Start and end of its messages' times first.
        let (size, rest) = body.get(16..)?.split_first_chunk::<8>()?;
        let (crc, rest) = rest.split_first_chunk::<4>()?;
        let (length, rest) = rest.split_first_chunk::<4>()?;
        let (compression, rest) = rest.split_at_checked(usize::try_from(u32::from_le_bytes(*length)).ok()?)?;
        let (stored, rest) = rest.split_first_chunk::<8>()?;
        let stored = usize::try_from(u64::from_le_bytes(*stored)).ok()?;
        let records = match (rest.get(..stored), end) {
            (Some(records), _) => records,
            (None, End::Missing) => rest,
            (None, End::Reached) => return None,
        };
        let compression = std::str::from_utf8(compression).ok()?;
        Some(Chunk { size: u64::from_le_bytes(*size), crc: u32::from_le_bytes(*crc), compression, records })
    }
}
