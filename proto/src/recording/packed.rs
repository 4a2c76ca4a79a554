//! Whole files that were compressed to be kept or mailed: gzip (RFC 1952) and zstd, read as what is in them.
//!
//! A gzip file may have several parts, one behind the other, as logs that were appended to have. Each ends with a checksum, which must
//! be right. A file that is cut off, as a full disk or a transfer leaves it, gives what is in it up to there; of a text the whole
//! lines, because half of a number is another number.

use std::borrow::Cow;

use miniz_oxide::inflate::stream::{InflateState, inflate};
use miniz_oxide::{DataFormat, MZError, MZFlush, MZStatus};

use crate::recording::logger_file::file_kind::MAT5;
use crate::recording::mcap_file::decompress::{Decompressed, End, FrameEnd, MOST, ZSTD, decompress, zstd_frame};
use crate::recording::recording_error::RecordingError;

const GZIP: &[u8] = b"\x1f\x8b\x08";
/// Bytes of the longest head of a zstd frame.
const LONGEST_HEAD: usize = 18;
/// Bytes unpacked at a time.
const PIECE: usize = 1 << 16;

/// Content of a file, taken out of its compression.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Unpacked<'b> {
    pub(crate) bytes: Cow<'b, [u8]>,
    /// Remark on a compressed file that is cut off.
    pub(crate) cut: Option<String>,
}

/// Content of a compressed file, as far as it goes; other files as they are.
///
/// # Errors
/// The file is damaged, is cut off before anything comes out, or grows beyond 2 GiB.
pub fn unpacked<'b>(file: &str, bytes: &'b [u8]) -> Result<Cow<'b, [u8]>, RecordingError> {
    Ok(unpacked_with_remark(file, bytes)?.bytes)
}

/// Content of a compressed file, and whether there is more that was cut off; other files as they are.
///
/// # Errors
/// As [`unpacked`].
pub(crate) fn unpacked_with_remark<'b>(file: &str, bytes: &'b [u8]) -> Result<Unpacked<'b>, RecordingError> {
    let (packed_with, tool, content) = if bytes.starts_with(GZIP) {
        ("gzip", "gunzip", gunzip(bytes))
    } else if bytes.starts_with(ZSTD) || behind_skippable(bytes).is_some() {
        ("zstd", "unzstd", unzstd(bytes))
    } else {
        return Ok(Unpacked { bytes: Cow::Borrowed(bytes), cut: None });
    };
    let whole_lines = |content: Decompressed| match content.end {
        End::Reached => content,
        End::Missing => Decompressed { bytes: without_broken_line(content.bytes), ..content },
    };
    let content = content.map(whole_lines).filter(|content| content.end == End::Reached || !content.bytes.is_empty());
    let Decompressed { bytes, end } = content.ok_or_else(|| RecordingError::Kind {
        file: file.to_owned(),
        what: format!(
            "it is compressed with {packed_with} and damaged, cut off near its beginning, or more than 2 GiB in whole"
        ),
        mend: format!("get it again, or take out what is still there with {tool}"),
    })?;
    let cut = (end == End::Missing)
        .then(|| format!("{file}: compressed with {packed_with} and cut off; what is in it up to there is read"));
    Ok(Unpacked { bytes: Cow::Owned(bytes), cut })
}

/// A text up to its last line end; what is no text as it is.
fn without_broken_line(mut bytes: Vec<u8>) -> Vec<u8> {
    if bytes.starts_with(mcap::MAGIC) || bytes.starts_with(MAT5) {
        return bytes;
    }
    // The bytes of a sign, as the mark at the beginning of the text says.
    let sign = if bytes.starts_with(b"\xff\xfe") || bytes.starts_with(b"\xfe\xff") { 2 } else { 1 };
    let is_end = |sign: &[u8]| {
        sign.iter().any(|byte| matches!(byte, b'\n' | b'\r'))
            && sign.iter().all(|byte| matches!(byte, b'\n' | b'\r' | 0))
    };
    let end = bytes.chunks_exact(sign).rposition(is_end).map_or(0, |at| sign * (at + 1));
    bytes.truncate(end);
    bytes
}

/// All frames of a zstd file, the last as far as it goes; `None` where one is damaged.
fn unzstd(bytes: &[u8]) -> Option<Decompressed> {
    let (mut out, mut rest) = (Vec::new(), bytes);
    while !rest.iter().all(|byte| *byte == 0) {
        if let Some(behind) = behind_skippable(rest) {
            rest = behind;
            continue;
        }
        let frame = zstd_frame(rest).or_else(|| {
            // Only a part of the head of a further frame is there.
            let is_begun = ZSTD.starts_with(rest) || (rest.starts_with(ZSTD) && rest.len() < LONGEST_HEAD);
            is_begun.then_some(FrameEnd::Cut { whole_blocks: 0 })
        })?;
        let (length, end) = match frame {
            FrameEnd::Whole { length } => (length, End::Reached),
            FrameEnd::Cut { .. } => (rest.len(), End::Missing),
        };
        let (frame, behind) = rest.split_at_checked(length)?;
        let content = decompress("zstd", frame, MOST - out.len() as u64).ok()?;
        out.extend_from_slice(&content.bytes);
        if out.len() as u64 >= MOST {
            return None;
        }
        if end == End::Missing {
            return Some(Decompressed { bytes: out, end });
        }
        if content.end == End::Missing {
            return None;
        }
        rest = behind;
    }
    Some(Decompressed { bytes: out, end: End::Reached })
}

/// Bytes behind a frame that holds nothing of the content (RFC 8878: 3.1.2), as `pzstd` writes them; nothing where it is cut off.
fn behind_skippable(bytes: &[u8]) -> Option<&[u8]> {
    let [0x50..=0x5F, 0x2A, 0x4D, 0x18] = bytes.first_chunk::<4>()? else { return None };
    let length = u32::from_le_bytes(*bytes.get(4..)?.first_chunk()?);
    Some(bytes.get(8 + length as usize..).unwrap_or_default())
}

/// All parts of a gzip file, the last as far as it goes; `None` where one is damaged.
fn gunzip(mut bytes: &[u8]) -> Option<Decompressed> {
    let mut out = Vec::new();
    // Zeros may fill a tape's or a disk's last block.
    while !bytes.iter().all(|byte| *byte == 0) {
        let from = out.len();
        let Some(deflated) = behind_head(bytes) else {
            let is_begun = bytes.starts_with(GZIP) || GZIP.starts_with(bytes);
            return is_begun.then_some(Decompressed { bytes: out, end: End::Missing });
        };
        let Inflated { used, end } = inflate_onto(deflated, &mut out)?;
        let behind = deflated.get(used..)?;
        let Some((checksum, rest)) = behind.split_at_checked(8).filter(|_| end == End::Reached) else {
            return Some(Decompressed { bytes: out, end: End::Missing });
        };
        let expected = u32::from_le_bytes(*checksum.first_chunk()?);
        if crc32fast::hash(out.get(from..)?) != expected {
            return None;
        }
        bytes = rest;
    }
    Some(Decompressed { bytes: out, end: End::Reached })
}

/// Bytes behind the head of a part: ten bytes, then an extra field, a name, a comment and a checksum where its flags say so.
fn behind_head(bytes: &[u8]) -> Option<&[u8]> {
    let [has_checksum, has_extra, has_name, has_comment] = [0x02, 0x04, 0x08, 0x10];
    let flags = *bytes.strip_prefix(GZIP)?.first()?;
    let mut rest = bytes.get(10..)?;
    if flags & has_extra != 0 {
        let length = u16::from_le_bytes(*rest.first_chunk()?);
        rest = rest.get(2 + usize::from(length)..)?;
    }
    for _text in [has_name, has_comment].iter().filter(|flag| flags & **flag != 0) {
        let end = rest.iter().position(|byte| *byte == 0)?;
        rest = rest.get(end + 1..)?;
    }
    if flags & has_checksum != 0 { rest.get(2..) } else { Some(rest) }
}

/// Bytes that a stream took, and whether its end was among them.
struct Inflated {
    used: usize,
    end: End,
}

/// Inflates one stream behind `out`; `None` where it is damaged or grows too large.
fn inflate_onto(deflated: &[u8], out: &mut Vec<u8>) -> Option<Inflated> {
    let mut state = InflateState::new_boxed(DataFormat::Raw);
    let mut piece = vec![0; PIECE];
    let mut used = 0;
    loop {
        let did = inflate(&mut state, deflated.get(used..)?, &mut piece, MZFlush::None);
        used += did.bytes_consumed;
        out.extend_from_slice(piece.get(..did.bytes_written)?);
        match did.status {
            Ok(MZStatus::StreamEnd) => return Some(Inflated { used, end: End::Reached }),
            Ok(_) if out.len() as u64 <= MOST && did.bytes_consumed + did.bytes_written > 0 => {}
            // All was taken, and the stream wants more.
            Err(MZError::Buf) if used == deflated.len() => return Some(Inflated { used, end: End::Missing }),
            _ => return None,
        }
    }
}
