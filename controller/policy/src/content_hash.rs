//! Check that a file's bytes are still those that its exporter wrote.
//!
//! The metadata may hold `content_sha256`: the SHA-256 of the whole file, taken with the 64 digits of that value itself
//! at `0`. A file of `trainer` also says `export_format` = `2`, which promises that the hash is there; so neither key can
//! be lost to a single flipped byte. Files of other programs need neither.

use sha2::{Digest, Sha256};

use crate::error::Fault;
use crate::metadata::Metadata;
use crate::wording::shown;

/// Metadata key of the hash.
pub(crate) const KEY: &str = "content_sha256";
/// Metadata key that promises it.
const FORMAT: &str = "export_format";
/// Digits of the hash.
const DIGITS: usize = 64;

/// Compares a file's bytes with the hash in its metadata, if it has one or promises one.
///
/// # Errors
/// [`Fault::ContentHash`], [`Fault::ContentHashMissing`], [`Fault::ContentHashUnreadable`], [`Fault::ContentHashUnpromised`].
pub(crate) fn check(bytes: &[u8], metadata: &Metadata) -> Result<(), Fault> {
    let Some(stated) = metadata.get(KEY) else {
        return if metadata.get(FORMAT).is_some() { Err(Fault::ContentHashMissing) } else { Ok(()) };
    };
    let Some(at) = place(bytes) else { return Err(Fault::ContentHashUnreadable { stated: shown(stated) }) };
    let found = digest(bytes, at);
    if found != stated {
        return Err(Fault::ContentHash { stated: shown(stated), found });
    }
    if metadata.get(FORMAT).is_some() { Ok(()) } else { Err(Fault::ContentHashUnpromised) }
}

/// Where the digits stand: behind the key's entry, field 2 with a length of 64.
fn place(bytes: &[u8]) -> Option<usize> {
    const LENGTH_DELIMITED_2: u8 = 2 << 3 | 2;
    let at = bytes.windows(KEY.len()).rposition(|window| window == KEY.as_bytes())? + KEY.len();
    let head = bytes.get(at..at + 2)?;
    (head == [LENGTH_DELIMITED_2, DIGITS as u8] && bytes.len() >= at + 2 + DIGITS).then_some(at + 2)
}

fn digest(bytes: &[u8], at: usize) -> String {
    let (before, rest) = bytes.split_at(at);
    let mut hash = Sha256::new();
    hash.update(before);
    hash.update([b'0'; DIGITS]);
    hash.update(rest.get(DIGITS..).unwrap_or_default());
    hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}
