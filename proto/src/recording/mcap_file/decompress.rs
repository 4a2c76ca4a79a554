//! Chunks that other tools compressed, whole or cut off: zstd and lz4, as the MCAP specification names them.
//!
//! A chunk that is cut gives what its whole blocks hold. lz4 frames are read block by block anyway. A zstd decoder keeps back what a
//! later block may refer to until its frame ends; so a cut frame is ended behind its last whole block (RFC 8878: blocks have a
//! header of three bytes, last, type and size).

use std::io::Read;

/// A compression that is not known.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Unknown(pub(crate) String);

/// Bytes of a chunk decompressed, as far as they go.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Decompressed {
    pub(crate) bytes: Vec<u8>,
    /// End of the decompression.
    pub(crate) end: End,
}

/// End of a decompression.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum End {
    Reached,
    Missing,
}

/// The most that one chunk or file may grow to (bytes): ten days of the daemon's own ticks as text.
pub(crate) const MOST: u64 = 2 << 30;
/// The largest window of a zstd frame (bytes): that of level 22, `--long`.
const WINDOW: u64 = 1 << 27;
/// Bytes read at a time.
const PIECE: usize = 1 << 14;

/// Decompresses the records of a chunk that should come to `size` bytes.
///
/// # Errors
/// The compression is neither `zstd` nor `lz4`.
pub(crate) fn decompress(compression: &str, bytes: &[u8], size: u64) -> Result<Decompressed, Unknown> {
    let most = size.min(MOST);
    match compression {
        "lz4" => Ok(read_all(lz4_flex::frame::FrameDecoder::new(bytes), most)),
        "zstd" => Ok(zstd(bytes, most)),
        other => Err(Unknown(other.to_owned())),
    }
}

fn zstd(bytes: &[u8], most: u64) -> Decompressed {
    let nothing = Decompressed { bytes: Vec::new(), end: End::Missing };
    let of = |bytes: &[u8]| match ruzstd::decoding::StreamingDecoder::new_with_max_window_size(bytes, WINDOW) {
        Ok(decoder) => read_all(decoder, most),
        Err(_) => nothing.clone(),
    };
    match ended(bytes) {
        Some(ended) => Decompressed { end: End::Missing, ..of(&ended) },
        None => of(bytes),
    }
}

/// A zstd frame that is cut off, ended behind its last whole block; `None` for one that is whole, is damaged, or is none.
fn ended(bytes: &[u8]) -> Option<Vec<u8>> {
    let Some(FrameEnd::Cut { whole_blocks }) = zstd_frame(bytes) else { return None };
    let mut whole = bytes.get(..whole_blocks)?.to_vec();
    // No checksum follows, and an empty raw block ends it.
    *whole.get_mut(ZSTD.len())? &= !CHECKSUM;
    whole.extend_from_slice(&[1, 0, 0]);
    Some(whole)
}

/// First bytes of a zstd frame.
pub(crate) const ZSTD: &[u8] = b"\x28\xb5\x2f\xfd";
/// Flag in a frame's descriptor: a checksum follows its last block.
const CHECKSUM: u8 = 0x04;
const CHECKSUM_BYTES: usize = 4;
/// Kinds of blocks: one byte many times, and one that no frame has.
const RUN_LENGTH: u32 = 1;
const RESERVED: u32 = 3;
/// The largest block (bytes).
const LARGEST_BLOCK: usize = 128 << 10;

/// End of a zstd frame, by the sizes of its blocks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum FrameEnd {
    /// It is there.
    Whole {
        /// Bytes of the frame.
        length: usize,
    },
    /// It is cut off.
    Cut {
        /// Bytes up to the end of its last whole block.
        whole_blocks: usize,
    },
}

/// Walks over the blocks of the zstd frame that bytes begin with; `None` where they begin with none, or with a damaged one.
pub(crate) fn zstd_frame(bytes: &[u8]) -> Option<FrameEnd> {
    let descriptor = *bytes.strip_prefix(ZSTD)?.first()?;
    let single_segment = descriptor & 0x20 != 0;
    let window = usize::from(!single_segment);
    let dictionary = [0, 1, 2, 4][usize::from(descriptor & 3)];
    let content = match descriptor >> 6 {
        0 => usize::from(single_segment),
        1 => 2,
        2 => 4,
        _ => 8,
    };
    let mut at = ZSTD.len() + 1 + window + dictionary + content;
    loop {
        let Some([low, middle, high]) = bytes.get(at..)?.first_chunk::<3>() else {
            return Some(FrameEnd::Cut { whole_blocks: at });
        };
        let header = u32::from_le_bytes([*low, *middle, *high, 0]);
        let (kind, size) = (header >> 1 & 3, (header >> 3) as usize);
        if kind == RESERVED || size > LARGEST_BLOCK {
            return None;
        }
        // Of a run-length block one byte is there, whatever its size.
        let size = if kind == RUN_LENGTH { 1 } else { size };
        let next = at + 3 + size;
        let is_last = header & 1 == 1;
        let checksum = if is_last && descriptor & CHECKSUM != 0 { CHECKSUM_BYTES } else { 0 };
        if bytes.len() < next {
            return Some(FrameEnd::Cut { whole_blocks: at });
        }
        if bytes.len() < next + checksum {
            return Some(FrameEnd::Cut { whole_blocks: next });
        }
        if is_last {
            return Some(FrameEnd::Whole { length: next + checksum });
        }
        at = next;
    }
}

fn read_all(mut from: impl Read, most: u64) -> Decompressed {
    let mut bytes = Vec::new();
    let mut piece = [0; PIECE];
    while (bytes.len() as u64) < most {
        match from.read(&mut piece) {
            Ok(0) => break,
            Ok(read) => bytes.extend_from_slice(piece.get(..read).unwrap_or_default()),
            Err(_) => return Decompressed { bytes, end: End::Missing },
        }
    }
    Decompressed { bytes, end: End::Reached }
}
