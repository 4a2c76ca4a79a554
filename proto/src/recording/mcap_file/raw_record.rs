//! Records and chunks of an MCAP file as they lie in its bytes, whole or cut.

use mcap::records::op;

use super::decompress::{End, decompress};

/// Code, body and what follows of the whole record that bytes begin with.
pub(crate) fn next_record(bytes: &[u8]) -> Option<(u8, &[u8], &[u8])> {
    let (code, rest) = bytes.split_first()?;
    let (length, rest) = rest.split_first_chunk::<8>()?;
    let (body, after) = rest.split_at_checked(usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
    Some((*code, body, after))
}

/// Code and as much of the body as there is of a record that is cut.
pub(super) fn cut_record(bytes: &[u8]) -> Option<(u8, &[u8])> {
    let (code, rest) = bytes.split_first()?;
    Some((*code, rest.get(8..)?))
}

/// Tells whether bytes begin with a whole record of a kind that the format has.
pub(super) fn begins_with_record(bytes: &[u8]) -> bool {
    next_record(bytes).is_some_and(|(code, ..)| (op::HEADER..=op::DATA_END).contains(&code))
}

/// Outcome of a search for a sound chunk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Sought {
    /// One begins there.
    Found(usize),
    /// None is there; one may turn out to begin there, and none before, once there are more bytes.
    NotYet(usize),
}

/// Searches for the first chunk from `from` on that is whole and whose CRC is right.
///
/// Nothing else is taken for a chunk: its lengths fit each other to the byte, and the CRC is that of what it holds.
pub(super) fn next_sound_chunk(bytes: &[u8], from: usize) -> Sought {
    let mut at = from;
    let mut not_whole = None;
    while let Some(ahead) = bytes.get(at..).and_then(|rest| rest.iter().position(|byte| *byte == op::CHUNK)) {
        at += ahead;
        let rest = bytes.get(at..).unwrap_or_default();
        match next_record(rest) {
            Some((_, body, _)) if is_sound_chunk(body) => return Sought::Found(at),
            None if may_become_a_chunk(rest) => not_whole = not_whole.or(Some(at)),
            _ => {}
        }
        at += 1;
    }
    Sought::NotYet(not_whole.unwrap_or(bytes.len()).max(from))
}

/// Bytes of a chunk's head: two times, a size, a CRC, and the lengths of the compression's name and of the records.
const CHUNK_HEAD: usize = 8 + 8 + 8 + 4 + 4 + 8;
/// Longest name of a compression (bytes); those of the format have four.
const LONGEST_COMPRESSION: usize = 32;

/// Tells whether bytes that are no whole record can be the beginning of a chunk.
fn may_become_a_chunk(bytes: &[u8]) -> bool {
    let Some((length, body)) = bytes.get(1..).and_then(|rest| rest.split_first_chunk::<8>()) else { return true };
    match Chunk::of(body, End::Missing) {
        Some(chunk) => {
            let all = chunk.stored.checked_add(CHUNK_HEAD + chunk.compression.len());
            chunk.crc != 0 && all.is_some_and(|all| all as u64 == u64::from_le_bytes(*length))
        }
        None => body.len() < CHUNK_HEAD + LONGEST_COMPRESSION,
    }
}

fn is_sound_chunk(body: &[u8]) -> bool {
    let Some(chunk) = Chunk::of(body, End::Reached) else { return false };
    if chunk.crc == 0 || body.len() != CHUNK_HEAD + chunk.compression.len() + chunk.records.len() {
        return false;
    }
    if chunk.compression.is_empty() {
        return chunk.crc == crc32fast::hash(chunk.records);
    }
    decompress(chunk.compression, chunk.records, chunk.size)
        .is_ok_and(|records| records.end == End::Reached && chunk.crc == crc32fast::hash(&records.bytes))
}

/// The head of a chunk and its records, as they are stored.
pub(super) struct Chunk<'a> {
    /// Bytes that the records come to.
    pub(super) size: u64,
    /// CRC of these; 0 for none.
    pub(super) crc: u32,
    pub(super) compression: &'a str,
    /// Bytes of its records as they are stored, of which some are missing where it is cut.
    stored: usize,
    pub(super) records: &'a [u8],
}

impl<'a> Chunk<'a> {
    /// Takes a chunk's body apart; `None` where it is none, or its records are not all there though it has its end.
    pub(super) fn of(body: &'a [u8], end: End) -> Option<Self> {
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
        Some(Chunk { size: u64::from_le_bytes(*size), crc: u32::from_le_bytes(*crc), compression, stored, records })
    }
}
