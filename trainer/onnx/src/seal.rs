//! The hash that a file carries of itself.
//!
//! Before everything else stands `export_format` = `2`, which promises the hash, and behind everything `content_sha256`,
//! the SHA-256 (FIPS 180-4) of the whole file taken with the 64 digits of that value at `0`. A reader that zeroes them
//! again finds every byte that has changed since, and a file that was cut anywhere.

use sha2::{Digest, Sha256};

use crate::protobuf::Message;

/// Digits of the hash.
const DIGITS: usize = 64;

/// Field of `metadata_props` in a model.
const METADATA: u64 = 14;

/// A model with nothing in it but the promise of a hash; fields of a message may stand in any order.
pub(crate) fn promised() -> Message {
    entry(Message::default(), "export_format", "2")
}

/// The bytes of a model that began as [`promised`], with the hash behind them.
pub(crate) fn sealed(model: Message) -> Vec<u8> {
    let mut bytes = entry(model, "content_sha256", &"0".repeat(DIGITS)).into_bytes();
    let digits: String = Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect();
    // The value stands last, nothing follows it.
    let at = bytes.len() - DIGITS;
    if let Some(value) = bytes.get_mut(at..) {
        value.copy_from_slice(digits.as_bytes());
    }
    bytes
}

fn entry(model: Message, key: &str, value: &str) -> Message {
    model.message(METADATA, Message::default().text(1, key).text(2, value))
}
