//! The index at the end of a recording: where its chunks and attachments begin, and how many messages each channel has.
//!
//! A recording is read from its beginning without this. Only where something is damaged does the index say where reading can
//! go on and what is lost. So one whose own CRC is missing or wrong is not used at all.

use std::collections::HashMap;

use mcap::read::parse_record;
use mcap::records::{Record, op};

use super::raw_record::{begins_with_record, next_record};

/// Bytes of the footer with its head: code, length, two offsets, CRC.
const FOOTER_BYTES: usize = 9 + 20;

/// Places in a file that its index knows.
#[derive(Debug)]
pub(super) struct FileIndex<'a> {
    /// Beginnings of chunks, attachments and metadata with their codes, in their order.
    starts: Vec<(usize, u8)>,
    /// Names of attachments, by where they begin.
    attachments: HashMap<usize, String>,
    /// Messages of each channel.
    messages: HashMap<u16, u64>,
    /// Codes and bodies of the schemas and channels, which stand once more beside the index.
    topics: Vec<(u8, &'a [u8])>,
    /// Place behind the data, where the summary begins.
    pub(super) data_end: usize,
}

impl<'a> FileIndex<'a> {
    /// The index of a file; `None` where it has none that is sound.
    pub(super) fn of(bytes: &'a [u8]) -> Option<Self> {
        let before_magic = bytes.strip_suffix(mcap::MAGIC)?;
        let footer_at = before_magic.len().checked_sub(FOOTER_BYTES)?;
        let (code, body, _) = next_record(before_magic.get(footer_at..)?)?;
        let Record::Footer(footer) = (code == op::FOOTER).then(|| parse_record(code, body).ok())?? else {
            return None;
        };
        let data_end = usize::try_from(footer.summary_start).ok().filter(|start| *start >= mcap::MAGIC.len())?;
        // The CRC covers the summary and the footer up to itself.
        let covered = before_magic.get(data_end..before_magic.len() - 4)?;
        if footer.summary_crc == 0 || footer.summary_crc != crc32fast::hash(covered) {
            return None;
        }
        let mut index = FileIndex {
            starts: Vec::new(),
            attachments: HashMap::new(),
            messages: HashMap::new(),
            topics: Vec::new(),
            data_end,
        };
        let mut rest = bytes.get(data_end..footer_at)?;
        while let Some((code, body, after)) = next_record(rest) {
            match code {
                op::SCHEMA | op::CHANNEL => index.topics.push((code, body)),
                op::CHUNK_INDEX | op::ATTACHMENT_INDEX | op::METADATA_INDEX | op::STATISTICS => {
                    index.take_in(parse_record(code, body).ok()?)?;
                }
                _ => {}
            }
            rest = after;
        }
        index.starts.sort_unstable();
        index.starts.iter().any(|(_, code)| *code == op::CHUNK).then_some(index)
    }

    /// Takes in a record of the summary; `None` for a place that cannot be.
    fn take_in(&mut self, record: Record<'_>) -> Option<()> {
        let (offset, code) = match &record {
            Record::ChunkIndex(chunk) => (chunk.chunk_start_offset, op::CHUNK),
            Record::AttachmentIndex(attachment) => (attachment.offset, op::ATTACHMENT),
            Record::MetadataIndex(metadata) => (metadata.offset, op::METADATA),
            Record::Statistics(statistics) => {
                self.messages.extend(statistics.channel_message_counts.iter().map(|(id, count)| (*id, *count)));
                return Some(());
            }
            _ => return Some(()),
        };
        let at = usize::try_from(offset).ok().filter(|at| *at < self.data_end)?;
        if let Record::AttachmentIndex(attachment) = record {
            self.attachments.insert(at, attachment.name);
        }
        self.starts.push((at, code));
        Some(())
    }

    /// Tells whether a record of this code may lie from `at` to `end` of the file: none of another code begins there, and no
    /// other one within it. An index whose places are wrong, which another tool may have written, proves nothing by them.
    pub(super) fn allows(&self, bytes: &[u8], at: usize, end: usize, code: u8) -> bool {
        let from = self.starts.partition_point(|(start, _)| *start < at);
        let mut known = self.starts.get(from..).unwrap_or_default().iter().take_while(|(start, _)| *start < end);
        let is_there = |start: usize, code: u8| {
            bytes.get(start) == Some(&code) && bytes.get(start..).is_some_and(begins_with_record)
        };
        end <= self.data_end
            && !known.any(|(start, found)| if *start == at { *found != code } else { is_there(*start, *found) })
    }

    /// Beginning of the first record behind a place that the index knows, or the end of the data.
    pub(super) fn next_behind(&self, at: usize) -> usize {
        let next = self.starts.partition_point(|(start, _)| *start <= at);
        self.starts.get(next).map_or(self.data_end, |(start, _)| *start)
    }

    /// Name of the attachment that begins at a place.
    pub(super) fn attachment_at(&self, at: usize) -> Option<&str> {
        self.attachments.get(&at).map(String::as_str)
    }

    /// Names of the attachments that begin from a place to before another.
    pub(super) fn attachments_within(&self, from: usize, to: usize) -> impl Iterator<Item = &str> {
        let starts = self.starts.iter().filter(move |(start, _)| (from..to).contains(start));
        starts.filter_map(|(start, _)| self.attachment_at(*start))
    }

    /// Messages on the channels that are asked for.
    pub(super) fn messages(&self, is_asked: impl Fn(u16) -> bool) -> u64 {
        self.messages.iter().filter(|(channel, _)| is_asked(**channel)).map(|(_, messages)| *messages).sum()
    }

    /// Codes and bodies of all schemas and, behind them, of all channels.
    pub(super) fn topics(&self) -> impl Iterator<Item = (u8, &'a [u8])> {
        let of = |wanted: u8| self.topics.iter().copied().filter(move |(code, _)| *code == wanted);
        of(op::SCHEMA).chain(of(op::CHANNEL))
    }
}
