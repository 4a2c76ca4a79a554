//! Whole files that were compressed to be kept or mailed: gzip (RFC 1952) and zstd, read as what is in them.
//!
//! A gzip file may have several parts, one behind the other, as logs that were appended to have. Each ends with a checksum, which must
//! be right.

use std::borrow::Cow;

use miniz_oxide::inflate::stream::{InflateState, inflate};
use miniz_oxide::{DataFormat, MZFlush, MZStatus};

use crate::recording::mcap_file::decompress::{End, decompress};
use crate::recording::recording_error::RecordingError;

const GZIP: &[u8] = b"\x1f\x8b\x08";
const ZSTD: &[u8] = b"\x28\xb5\x2f\xfd";
/// The most that a file may grow to (bytes): ten days of the daemon's own ticks as text.
const MOST: usize = 2 << 30;
/// Bytes unpacked at a time.
const PIECE: usize = 1 << 16;

/// Content of a compressed file; other files as they are.
///
/// # Errors
/// The file is cut off or damaged, or grows beyond 2 GiB.
pub fn unpacked<'b>(file: &str, bytes: &'b [u8]) -> Result<Cow<'b, [u8]>, RecordingError> {
    let (packed_with, tool, content) = if bytes.starts_with(GZIP) {
        ("gzip", "gunzip", gunzip(bytes))
    } else if bytes.starts_with(ZSTD) {
        let out = decompress("zstd", bytes, MOST as u64).ok().filter(|out| out.end == End::Reached);
        ("zstd", "unzstd", out.map(|out| out.bytes))
    } else {
        return Ok(Cow::Borrowed(bytes));
    };
    content.map(Cow::Owned).ok_or_else(|| RecordingError::Kind {
        file: file.to_owned(),
        what: format!("it is compressed with {packed_with} and cut off, damaged, or more than 2 GiB in whole"),
        mend: format!("get it again, or take out what is still there with {tool}"),
    })
}

/// All parts of a gzip file; `None` where one is not whole.
fn gunzip(mut bytes: &[u8]) -> Option<Vec<u8>> {
    let mut out = Vec::new();
    // Zeros may fill a tape's or a disk's last block.
    while !bytes.iter().all(|byte| *byte == 0) {
        let deflated = behind_head(bytes)?;
        let from = out.len();
        let used = inflate_onto(deflated, &mut out)?;
        let (checksum, rest) = deflated.get(used..)?.split_at_checked(8)?;
        let of_part = out.get(from..)?;
        let expected = u32::from_le_bytes(*checksum.first_chunk()?);
        if crc32fast::hash(of_part) != expected {
            return None;
        }
        bytes = rest;
    }
    Some(out)
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

/// Inflates one stream behind `out`; how many bytes it took.
fn inflate_onto(deflated: &[u8], out: &mut Vec<u8>) -> Option<usize> {
    let mut state = InflateState::new_boxed(DataFormat::Raw);
    let mut piece = vec![0; PIECE];
    let mut used = 0;
    loop {
        let did = inflate(&mut state, deflated.get(used..)?, &mut piece, MZFlush::None);
        used += did.bytes_consumed;
        out.extend_from_slice(piece.get(..did.bytes_written)?);
        match did.status {
            Ok(MZStatus::StreamEnd) => return Some(used),
            Ok(_) if out.len() <= MOST && did.bytes_consumed + did.bytes_written > 0 => {}
            _ => return None,
        }
    }
}
