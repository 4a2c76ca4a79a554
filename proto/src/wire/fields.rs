//! Writing and reading big-endian fields in the order in which they stand in a frame.
//!
//! The writer fills an array of exactly the frame's length and ends with the CRC; the reader walks
//! a body and says `Truncated` instead of reaching past its end. Neither can panic.

use super::error::WireError;
use super::{CRC_LENGTH, FrameType, MAGIC, VERSION};

/// Fills a frame of `N` bytes from its first byte on.
pub(super) struct FieldWriter<const N: usize> {
    bytes: [u8; N],
    at: usize,
}

impl<const N: usize> FieldWriter<N> {
    /// A frame that holds its header so far.
    pub(super) fn new(kind: FrameType, sequence: u32, clock_ns: u64) -> Self {
        let mut writer = Self { bytes: [0; N], at: 0 };
        writer.u32(MAGIC);
        writer.u8(VERSION);
        writer.u8(kind.code());
        // The longest frame has 64 bytes.
        writer.bytes(&(N as u16).to_be_bytes());
        writer.u32(sequence);
        writer.bytes(&clock_ns.to_be_bytes());
        writer
    }

    /// Puts bytes as they are.
    pub(super) fn bytes(&mut self, field: &[u8]) {
        let end = self.at.saturating_add(field.len());
        debug_assert!(end <= N, "a frame's fields are longer than the frame");
        if let Some(place) = self.bytes.get_mut(self.at..end) {
            place.copy_from_slice(field);
        }
        self.at = end;
    }

    pub(super) fn u8(&mut self, field: u8) {
        self.bytes(&[field]);
    }

    pub(super) fn u16(&mut self, field: u16) {
        self.bytes(&field.to_be_bytes());
    }

    pub(super) fn u32(&mut self, field: u32) {
        self.bytes(&field.to_be_bytes());
    }

    pub(super) fn f32(&mut self, field: f32) {
        self.bytes(&field.to_be_bytes());
    }

    /// Puts the CRC of everything before it and gives the whole frame.
    pub(super) fn finish(mut self) -> [u8; N] {
        debug_assert_eq!(self.at + CRC_LENGTH, N, "a frame's fields do not fill the frame");
        let crc = self.bytes.get(..N.saturating_sub(CRC_LENGTH)).map_or(0, crc32fast::hash);
        self.at = N.saturating_sub(CRC_LENGTH);
        self.u32(crc);
        self.bytes
    }
}

/// Walks the fields of a frame, from byte 8 (the sequence number) on.
pub(super) struct FieldReader<'a> {
    rest: &'a [u8],
    taken: usize,
}

impl<'a> FieldReader<'a> {
    /// Starts at the first of these bytes.
    pub(super) const fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes, taken: 0 }
    }

    /// The next `K` bytes.
    pub(super) fn bytes<const K: usize>(&mut self) -> Result<[u8; K], WireError> {
        match self.rest.split_first_chunk::<K>() {
            Some((field, rest)) => {
                self.rest = rest;
                self.taken += K;
                Ok(*field)
            }
            None => Err(WireError::Truncated { needed: self.taken + K, found: self.taken + self.rest.len() }),
        }
    }

    pub(super) fn u8(&mut self) -> Result<u8, WireError> {
        self.bytes().map(u8::from_be_bytes)
    }

    pub(super) fn u16(&mut self) -> Result<u16, WireError> {
        self.bytes().map(u16::from_be_bytes)
    }

    pub(super) fn u32(&mut self) -> Result<u32, WireError> {
        self.bytes().map(u32::from_be_bytes)
    }

    pub(super) fn u64(&mut self) -> Result<u64, WireError> {
        self.bytes().map(u64::from_be_bytes)
    }

    pub(super) fn f32(&mut self) -> Result<f32, WireError> {
        self.bytes().map(f32::from_be_bytes)
    }
}
