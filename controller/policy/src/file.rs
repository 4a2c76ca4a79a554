//! A policy's bytes: read once, bounded, hashed; a cut or foreign file told apart before decoding.
//!
//! An ONNX file is one protobuf message without any magic number, and a decoder that meets a cut file
//! says only "buffer underflow". The scan below walks the outermost fields, which is enough to say
//! where the file ends too early or stops being ONNX. Fields of `ModelProto` (onnx.proto): 1
//! ir_version and 5 model_version are varints; 2, 3, 4, 6 strings; 7 graph; 8 opset_import; 14
//! metadata_props; 20 training_info; 25 functions; 26 configuration.

use std::fmt;
use std::fs::File;
use std::io::Read;
use std::path::Path;

use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use sha2::{Digest, Sha256};

use crate::error::Fault;

/// Largest policy file that is read, 16 MiB: fifty times a 84-256-256-12 network.
pub const MAX_FILE_BYTES: u64 = 16 << 20;

/// SHA-256 (FIPS 180-4) of a policy file's bytes: the policy's identity in recordings and logs.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct PolicyHash(pub [u8; 32]);

impl fmt::Display for PolicyHash {
    /// All 64 hexadecimal digits; `{:.12}` gives the first 12.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let digits = f.precision().unwrap_or(64);
        for byte in self.0.iter().take(digits.div_ceil(2)) {
            write!(f, "{byte:02x}")?;
        }
        Ok(())
    }
}

impl fmt::Debug for PolicyHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "PolicyHash({self})")
    }
}

/// Permission for a name to stand for a file elsewhere.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Links {
    /// A symbolic link is followed: a person named the file.
    Follow,
    /// A symbolic link is refused: the name was found in a watched directory.
    Refuse,
}

/// Reads a policy file: a regular file of at most [`MAX_FILE_BYTES`]; a pipe or a device never holds it up.
///
/// # Errors
/// [`Fault::Unreadable`], [`Fault::Link`], [`Fault::NotRegular`], [`Fault::TooLarge`], [`Fault::Empty`].
pub fn read(path: &Path, links: Links) -> Result<Vec<u8>, Fault> {
    let unreadable = |source| Fault::Unreadable { source };
    // Without O_NONBLOCK, opening a pipe waits for a writer that may never come; what kind of file it is, is asked of the
    // open file, so that nobody can put another in its place in between.
    let mut flags = OFlags::NONBLOCK | OFlags::CLOEXEC | OFlags::NOCTTY;
    if links == Links::Refuse {
        flags |= OFlags::NOFOLLOW;
    }
    let opened = rustix::fs::open(path, flags | OFlags::RDONLY, Mode::empty());
    let file = File::from(opened.map_err(|errno| match errno {
        Errno::LOOP if links == Links::Refuse => Fault::Link,
        // A socket, or a device without a driver.
        Errno::NXIO | Errno::NODEV => Fault::NotRegular,
        errno => unreadable(errno.into()),
    })?);
    let about = file.metadata().map_err(unreadable)?;
    if !about.is_file() {
        return Err(Fault::NotRegular);
    }
    let bytes = about.len();
    if bytes > MAX_FILE_BYTES {
        return Err(Fault::TooLarge { bytes });
    }
    let mut buffer = Vec::with_capacity(bytes as usize + 1);
    // One byte over the limit shows a file that grew since its size was asked.
    file.take(MAX_FILE_BYTES + 1).read_to_end(&mut buffer).map_err(unreadable)?;
    match buffer.len() as u64 {
        0 => Err(Fault::Empty),
        bytes if bytes > MAX_FILE_BYTES => Err(Fault::TooLarge { bytes }),
        _ => Ok(buffer),
    }
}

/// The identity of a file's bytes.
pub fn hash(bytes: &[u8]) -> PolicyHash {
    PolicyHash(Sha256::digest(bytes).into())
}

/// Walks the outermost protobuf fields of an ONNX model.
///
/// # Errors
/// [`Fault::NotOnnx`] at the first byte that starts no `ModelProto` field, [`Fault::Truncated`] where
/// a field runs past the end.
pub(crate) fn scan(bytes: &[u8]) -> Result<(), Fault> {
    const VARINT: u64 = 0;
    const LENGTH_DELIMITED: u64 = 2;
    let mut at = 0;
    while at < bytes.len() {
        let start = at;
        let cut = |announced: u64, from: usize| Fault::Truncated { at: start, announced, left: bytes.len() - from };
        let (tag, after_tag) = varint(bytes, at).ok_or(Fault::NotOnnx { at: start })?;
        let fits = match (tag >> 3, tag & 7) {
            (1 | 5, wire) => wire == VARINT,
            (2 | 3 | 4 | 6 | 7 | 8 | 14 | 20 | 25 | 26, wire) => wire == LENGTH_DELIMITED,
            _ => false,
        };
        if !fits {
            return Err(Fault::NotOnnx { at: start });
        }
        let (value, after_value) = varint(bytes, after_tag).ok_or(cut(1, bytes.len()))?;
        at = after_value;
        if tag & 7 == LENGTH_DELIMITED {
            let left = bytes.len() - at;
            at = match usize::try_from(value) {
                Ok(length) if length <= left => at + length,
                _ => return Err(cut(value, at)),
            };
        }
    }
    Ok(())
}

/// One base-128 number and the place after it; `None` if it does not end within ten bytes.
fn varint(bytes: &[u8], at: usize) -> Option<(u64, usize)> {
    let mut value = 0u64;
    for (i, &byte) in bytes.get(at..)?.iter().take(10).enumerate() {
        value |= u64::from(byte & 0x7f) << (7 * i);
        if byte & 0x80 == 0 {
            return Some((value, at + i + 1));
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    /// FIPS 180-4's example message "abc"; digest as published by NIST.
    #[test]
    fn hash_is_sha256() {
        let digest = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(hash(b"abc").to_string(), digest);
        assert_eq!(format!("{:.12}", hash(b"abc")), "ba7816bf8f01");
    }

    #[test]
    fn scan_tells_where_a_file_ends_too_early() {
        // ir_version 8; producer_name of 5 bytes with 3 there.
        let cut = [0x08, 0x08, 0x12, 0x05, b'a', b'b', b'c'];
        assert!(matches!(scan(&cut), Err(Fault::Truncated { at: 2, announced: 5, left: 3 })));
        assert!(matches!(scan(&cut[..3]), Err(Fault::Truncated { at: 2, announced: 1, left: 0 })));
        assert!(scan(&[0x08, 0x08, 0x12, 0x02, b'a', b'b']).is_ok());
    }

    #[test]
    fn scan_tells_a_foreign_file() {
        for foreign in [&b"PK\x03\x04"[..], b"time_s,u_pos", b"\x89HDF", &[0; 32], b"\x7fELF"] {
            assert!(matches!(scan(foreign), Err(Fault::NotOnnx { at: 0 })), "{foreign:?}");
        }
        // A length that would overflow an index.
        let huge = [0x3a, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x01];
        assert!(matches!(scan(&huge), Err(Fault::Truncated { .. })));
    }
}
