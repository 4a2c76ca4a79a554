//! Records and chunks of an MCAP file as they lie in its bytes, whole or cut.

use super::decompress::End;

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

/// The head of a chunk and its records, as they are stored.
pub(super) struct Chunk<'a> {
    /// Bytes that the records come to.
    pub(super) size: u64,
    /// CRC of these; 0 for none.
    pub(super) crc: u32,
    pub(super) compression: &'a str,
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
        Some(Chunk { size: u64::from_le_bytes(*size), crc: u32::from_le_bytes(*crc), compression, records })
    }
}
