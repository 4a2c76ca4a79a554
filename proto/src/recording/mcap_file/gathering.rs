//! The content of a recording, gathered record by record.

use std::collections::HashMap;

use mcap::read::parse_record;
use mcap::records::{Record, op};

use super::attached;
use super::damaged_chunks::{self, Damaged};
use super::decompress::{End, decompress};
use super::lost_attachments::LostAttachments;
use super::protobuf::DecodeError;
use super::raw_record::{Chunk, cut_record, next_record};
use super::reader::{ForeignMcap, McapContent, ReadMcapError};
use super::recording_info::{Attachment, FORMAT, METADATA};
use super::schema::{self, Log};
use super::tick::{COMMAND_BYTES, SENSE_BYTES};
use super::way_through_file::Stretch;
use super::writer::{Event, EventLevel, topic};

/// End of the file.
#[derive(Debug)]
pub(super) enum FileEnd {
    /// As it should.
    Reached,
    /// Between two records.
    Missing,
    /// Within a record.
    Cut,
    /// At something that is no record.
    Unreadable(String),
}

/// Content of a file, for one that is none of ours.
#[derive(Debug, Default)]
pub(super) struct Holds {
    /// Profile and library of its writer.
    written_by: String,
    /// Topics with their types.
    topics: Vec<String>,
}

impl Holds {
    pub(super) fn words(&self) -> String {
        const TOLD: usize = 6;
        let more = if self.topics.len() > TOLD { ", …" } else { "" };
        let topics = self.topics.iter().take(TOLD).map(String::as_str).collect::<Vec<_>>().join(", ");
        let by = if self.written_by.is_empty() { String::new() } else { format!(" (written by {})", self.written_by) };
        if topics.is_empty() { format!("it has no topics{by}") } else { format!("it has {topics}{more}{by}") }
    }
}

/// Which topic a channel carries.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Topic {
    Tick,
    Sense,
    Command,
    Event,
}

#[derive(Debug, Default)]
pub(crate) struct Gathering {
    pub(crate) file: String,
    pub(crate) content: McapContent,
    schemas: HashMap<u16, String>,
    pub(super) topics: HashMap<u16, Topic>,
    pub(super) foreign_ticks: bool,
    pub(super) holds: Holds,
    // Frames of ticks that are still to come, and ticks whose frames may be, by sequence number.
    sense: HashMap<u32, [u8; SENSE_BYTES]>,
    command: HashMap<u32, [u8; COMMAND_BYTES]>,
    pub(crate) ticks: HashMap<u32, usize>,
    pub(super) damaged: Vec<Damaged>,
    // Whether what was read last is a damaged chunk, whose index follows it.
    pub(super) behind_damaged: bool,
    pub(super) lost: LostAttachments,
    // The damaged stretch behind which no tick has been read yet.
    pub(super) stretch: Option<Stretch>,
    pub(super) last_sequence: Option<u32>,
    /// Ticks that were read, those included that have been taken away.
    ticks_read: usize,
    /// Attachments before the first chunk.
    begun_with: Option<usize>,
}

impl Gathering {
    /// Nothing yet of a file of this name.
    pub(crate) fn of(file: &str) -> Self {
        Gathering { file: file.to_owned(), ..Gathering::default() }
    }

    /// Takes in a record that is whole and not the end of the data; what is wrong with one that is no record.
    pub(crate) fn whole_record(&mut self, code: u8, body: &[u8]) -> Result<Option<String>, ReadMcapError> {
        match code {
            op::CHUNK => return self.chunk(body, End::Reached).map(|()| None),
            op::ATTACHMENT => {
                self.attachment(body, None);
                return Ok(None);
            }
            _ => {}
        }
        match parse_record(code, body) {
            Ok(record) => self.record(record).map(|()| None),
            Err(error) => Ok(Some(error.to_string())),
        }
    }

    /// Takes in what is whole of a record that was cut.
    pub(crate) fn cut(&mut self, bytes: &[u8]) -> Result<(), ReadMcapError> {
        match cut_record(bytes) {
            Some((op::CHUNK, body)) => self.chunk(body, End::Missing),
            _ => Ok(()),
        }
    }

    /// Reads a chunk, and keeps in mind what is needed to say what one that is damaged lacks.
    fn chunk(&mut self, body: &[u8], end: End) -> Result<(), ReadMcapError> {
        self.begun_with.get_or_insert(self.content.attachments.len());
        let (notes, ticks) = (self.content.notes.len(), self.content.ticks.len());
        self.sound_of_chunk(body, end)?;
        let is_damaged = end == End::Reached && self.content.notes.len() > notes;
        if is_damaged && self.stretch.is_some() {
            // It belongs to the damaged stretch before it, which tells of both.
            self.content.notes.truncate(notes);
            self.behind_damaged = false;
            return Ok(());
        }
        self.behind_damaged = is_damaged;
        if self.behind_damaged {
            let read = self.content.ticks.len() - ticks;
            self.content.lost_before.push(self.content.ticks.len());
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

    pub(super) fn record(&mut self, record: Record<'_>) -> Result<(), ReadMcapError> {
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
            _ => {}
        }
        Ok(())
    }

    /// Takes in an attachment; one that is damaged is left out. `indexed` is its name by the file's index.
    pub(super) fn attachment(&mut self, body: &[u8], indexed: Option<&str>) {
        match sound_attachment(body) {
            // Those of one name count by their order, so that behind one that is lost nobody knows which one this is.
            Ok(found) if self.lost.has(&found.name) => {
                if self.lost.is_first_untold() {
                    self.note_on_attachment(&format!(
                        "the attachment {} and all behind it were left out: nothing says which attachments are lost before them",
                        found.name
                    ));
                }
            }
            Ok(found) => self.content.attachments.push(found),
            Err(problem) => {
                let own = attachment_name(body).filter(|name| attached::ALL.contains(name));
                let name = indexed.or(own);
                self.lost.add(name);
                self.content.damaged_attachments.extend(name.map(str::to_owned));
                match name {
                    Some(name) => self
                        .note_on_attachment(&format!("the attachment {name} is damaged ({problem}) and was left out")),
                    None => self.note(&format!("an attachment is damaged ({problem}) and was left out")),
                }
            }
        }
    }

    /// Attachments that the recording began with: its writer puts them before all chunks.
    pub(super) fn first_attachments(&self) -> &[Attachment] {
        let attachments = self.content.attachments.as_slice();
        self.begun_with.and_then(|count| attachments.get(..count)).unwrap_or(attachments)
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
                self.end_stretch(sequence);
                self.last_sequence = Some(sequence);
                self.ticks.insert(sequence, self.content.ticks.len());
                self.content.ticks.push(tick);
                self.ticks_read += 1;
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

    pub(super) fn note(&mut self, text: &str) {
        self.content.notes.push(format!("{}: {text}", self.file));
    }

    /// Tells whether what is lost with the last thing damaged is still to be told.
    pub(super) fn is_to_be_told(&self) -> bool {
        self.stretch.is_some() || self.behind_damaged
    }

    /// Takes the notes away, with what is known of the ticks that are lost.
    pub(super) fn take_notes(&mut self) -> Vec<String> {
        self.tell_damaged();
        self.damaged.clear();
        self.content.attachment_notes.clear();
        std::mem::take(&mut self.content.notes)
    }

    /// Puts what damaged chunks lack behind their notes.
    pub(super) fn tell_damaged(&mut self) {
        let topics = &self.topics;
        let is_of_ticks = |channel| topics.get(&channel) == Some(&Topic::Tick);
        damaged_chunks::tell(&mut self.content.notes, &self.damaged, is_of_ticks);
    }

    /// Adds the note on what stands at the end and cannot be read.
    pub(super) fn note_unreadable(&mut self, problem: &str) {
        let ticks = self.ticks_read;
        self.note(&format!("unreadable from here on ({problem}); read the {ticks} ticks before it"));
    }

    /// Adds a note on an attachment whose name is known.
    pub(super) fn note_on_attachment(&mut self, text: &str) {
        self.content.attachment_notes.push(self.content.notes.len());
        self.note(text);
    }
}

/// An attachment by its record's body.
///
/// # Errors
/// Part that is damaged.
fn sound_attachment(body: &[u8]) -> Result<Attachment, &'static str> {
    // The library reads the CRC behind the data without looking whether it is there.
    if attachment_lengths(body).is_none_or(|bytes| bytes > body.len()) {
        return Err("its lengths are wrong");
    }
    match parse_record(op::ATTACHMENT, body) {
        Ok(Record::Attachment { header, data, .. }) => {
            Ok(Attachment { name: header.name, media_type: header.media_type, data: data.into_owned() })
        }
        Err(mcap::McapError::BadAttachmentCrc { .. }) => Err("its CRC is wrong"),
        _ => Err("it cannot be read"),
    }
}

/// Bytes of an attachment's record by the lengths within it; `None` where they lead out of it.
fn attachment_lengths(body: &[u8]) -> Option<usize> {
    // Two times, the name, the media type, the data, and the CRC.
    let mut at = 8 + 8;
    for _ in 0..2 {
        let length = body.get(at..)?.first_chunk::<4>()?;
        at = at.checked_add(4)?.checked_add(usize::try_from(u32::from_le_bytes(*length)).ok()?)?;
    }
    let data = body.get(at..)?.first_chunk::<8>()?;
    at.checked_add(8 + 4)?.checked_add(usize::try_from(u64::from_le_bytes(*data)).ok()?)
}

/// Name of an attachment by its record's body.
fn attachment_name(body: &[u8]) -> Option<&str> {
    let (length, rest) = body.get(16..)?.split_first_chunk::<4>()?;
    std::str::from_utf8(rest.get(..usize::try_from(u32::from_le_bytes(*length)).ok()?)?).ok()
}
