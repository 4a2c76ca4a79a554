//! A daemon's MCAP file, whole or cut short, back to the ticks that went in.
//!
//! The file is read from its beginning, without its index, so a file that a crash cut short reads
//! the same way: record by record until something is not whole. Of a chunk that is cut every whole
//! message is read. What cannot be read is said in a note; a chunk or an attachment whose CRC is wrong
//! is left out, those after it are still read. Over a stretch in which no record can be found reading
//! goes on where the index, or the CRC of a chunk, says that one begins. Ticks come back bit for bit,
//! NaN payloads included.
//!
//! Files that another tool saved again are read too: chunks compressed with zstd or lz4, other
//! channel numbers, other orders of messages (frames are put to their ticks by sequence number).
//!
//! Left out: MCAP files of other programs; the error says what is in them.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use super::gathering::{FileEnd, Gathering, Topic};
use super::recording_info::Attachment;
use super::tick::TickRecord;
use super::writer::Event;
use crate::recording::MOST_BYTES;
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
    /// The files inside: configuration, rig. Behind one that is damaged none of its name is here, as they count by their order.
    pub attachments: Vec<Attachment>,
    /// Names of files inside that are damaged.
    pub damaged_attachments: Vec<String>,
    /// Places in `ticks` before which something is damaged; none where another tool has put them in another order.
    pub lost_before: Vec<usize>,
    /// True where something between the ticks is damaged, whatever order they stand in.
    pub is_damaged_within: bool,
    /// True when the file was finished and nothing of it was left out.
    pub complete: bool,
    /// Remarks on all that could not be read, a line each.
    pub notes: Vec<String>,
    /// Places in `notes` of those on attachments whose names are known: no tick is lost with these.
    pub attachment_notes: Vec<usize>,
}

/// Why a file is no recording.
#[derive(Debug, thiserror::Error)]
pub enum ReadMcapError {
    /// The file cannot be read.
    #[error("{file}: cannot read the recording: {source}")]
    Read {
        /// The file.
        file: String,
        /// Error of the system.
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
        /// Thing that is missing.
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
    #[error("{file}: the recording holds no tick that can be read{}", .notes.first().map(|note| format!("; {note}")).unwrap_or_default())]
    NoTicks {
        /// The file.
        file: String,
        /// Remarks on all that could not be read.
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
        /// Content that it has instead.
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
    gathering.tell_damaged();
    if let FileEnd::Unreadable(problem) = &end {
        gathering.note_unreadable(problem);
    }
    let Gathering { mut content, topics, foreign_ticks, holds, ticks: places, .. } = gathering;
    let has_tick_topic = topics.values().any(|topic| *topic == Topic::Tick);
    let ticks = content.ticks.len();
    let whole = matches!(end, FileEnd::Reached);
    match end {
        FileEnd::Reached | FileEnd::Unreadable(_) => {}
        FileEnd::Missing => {
            content.notes.push(format!("{file}: not finished (its end is missing); read {ticks} ticks"))
        }
        FileEnd::Cut => content.notes.push(format!("{file}: cut short; read the {ticks} ticks that are whole")),
    }
    if foreign_ticks || (whole && !has_tick_topic && content.notes.is_empty()) {
        let problem = ForeignMcap::NoTickTopic { holds: holds.words() };
        return Err(ReadMcapError::Foreign { file: file.to_owned(), problem });
    }
    if content.ticks.is_empty() {
        return Err(ReadMcapError::NoTicks { file: file.to_owned(), notes: content.notes });
    }
    content.complete = content.notes.is_empty();
    content.is_damaged_within = !content.lost_before.is_empty();
    if into_order(&mut content.ticks, &places) == Order::Another {
        content.lost_before.clear();
    }
    Ok(content)
}

/// Order in which the ticks of a file were written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Order {
    Own,
    Another,
}

/// Puts ticks that another tool has written in another order back into their own, `places` being where each sequence number
/// stands; tells in which they were.
fn into_order(ticks: &mut Vec<TickRecord>, places: &HashMap<u32, usize>) -> Order {
    // A tool that numbers messages anew says nothing of their order.
    if places.len() != ticks.len() {
        return Order::Own;
    }
    let mut order: Vec<(u32, usize)> = places.iter().map(|(sequence, place)| (*sequence, *place)).collect();
    order.sort_unstable();
    if order.is_sorted_by_key(|(_, place)| *place) {
        return Order::Own;
    }
    *ticks = order.iter().filter_map(|(_, place)| ticks.get(*place)).copied().collect();
    Order::Another
}
