//! Learning curves in TensorBoard's event files.
//!
//! A file is a run of records (TFRecord): length (u64), masked CRC-32C of the length, the bytes, masked CRC-32C of
//! the bytes, all little endian. The bytes are protobuf `Event` messages, of which four fields are needed:
//! `wall_time` (1, double), `step` (2, int64), `file_version` (3, string) and `summary` (5), which holds `value`s
//! (1) of `tag` (1, string) and `simple_value` (2, float). Formats: tensorflow/core/util/event.proto and
//! tensorflow/core/lib/io/record_writer.h.

use std::io::{self, Write};

/// Writes scalars over steps.
#[derive(Debug)]
pub struct EventWriter<W> {
    out: W,
}

impl<W: Write> EventWriter<W> {
    /// Begins a file at `wall_time_s` (Unix time).
    ///
    /// # Errors
    /// Errors of the file system.
    pub fn new(out: W, wall_time_s: f64) -> io::Result<Self> {
        let mut writer = EventWriter { out };
        let mut event = Vec::new();
        double(&mut event, 1, wall_time_s);
        bytes(&mut event, 3, b"brain.Event:2");
        writer.record(&event)?;
        Ok(writer)
    }

    /// Goes on in a file that was begun before.
    pub fn resume(out: W) -> Self {
        EventWriter { out }
    }

    /// Adds scalars at a step.
    ///
    /// # Errors
    /// Errors of the file system.
    pub fn scalars(&mut self, wall_time_s: f64, step: u64, scalars: &[(&str, f64)]) -> io::Result<()> {
        let mut summary = Vec::new();
        for (tag, value) in scalars {
            let mut entry = Vec::new();
            bytes(&mut entry, 1, tag.as_bytes());
            key(&mut entry, 2, 5);
            entry.extend((*value as f32).to_le_bytes());
            bytes(&mut summary, 1, &entry);
        }
        let mut event = Vec::new();
        double(&mut event, 1, wall_time_s);
        key(&mut event, 2, 0);
        varint(&mut event, step);
        bytes(&mut event, 5, &summary);
        self.record(&event)?;
        self.out.flush()
    }

    fn record(&mut self, event: &[u8]) -> io::Result<()> {
        let length = (event.len() as u64).to_le_bytes();
        self.out.write_all(&length)?;
        self.out.write_all(&masked_crc(&length).to_le_bytes())?;
        self.out.write_all(event)?;
        self.out.write_all(&masked_crc(event).to_le_bytes())
    }
}

/// CRC-32C, rotated and shifted so that a checksum of data that hold checksums stays a good one.
fn masked_crc(data: &[u8]) -> u32 {
    crc32c::crc32c(data).rotate_right(15).wrapping_add(0xa282_ead8)
}

fn varint(out: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        out.push((value & 0x7f) as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

fn key(out: &mut Vec<u8>, field: u32, wire_type: u32) {
    varint(out, u64::from(field << 3 | wire_type));
}

fn double(out: &mut Vec<u8>, field: u32, value: f64) {
    key(out, field, 1);
    out.extend(value.to_le_bytes());
}

fn bytes(out: &mut Vec<u8>, field: u32, value: &[u8]) {
    key(out, field, 2);
    varint(out, value.len() as u64);
    out.extend(value);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The first record of every TensorBoard file, byte for byte as TensorFlow's own writer makes it at time 0, but
    /// for the checksums, which are recomputed bit by bit from the polynomial.
    #[test]
    fn records_are_framed_and_checked() {
        let mut out = Vec::new();
        EventWriter::new(&mut out, 0.0).unwrap().scalars(1.5, 300, &[("rmse", 0.25)]).unwrap();
        let mut at = 0;
        let mut events = Vec::new();
        while at < out.len() {
            let length = usize::try_from(u64::from_le_bytes(out[at..at + 8].try_into().unwrap())).unwrap();
            let crc = |from: usize| u32::from_le_bytes(out[from..from + 4].try_into().unwrap());
            assert_eq!(crc(at + 8), by_polynomial(&out[at..at + 8]));
            let event = &out[at + 12..at + 12 + length];
            assert_eq!(crc(at + 12 + length), by_polynomial(event));
            events.push(event.to_vec());
            at += 16 + length;
        }
        assert_eq!(events[0], [&[9, 0, 0, 0, 0, 0, 0, 0, 0, 0x1a, 13][..], b"brain.Event:2"].concat());
        let scalar =
            [&[9][..], &1.5f64.to_le_bytes(), &[0x10, 0xac, 2, 0x2a, 13, 0x0a, 11, 0x0a, 4], b"rmse", &[0x15]].concat();
        assert_eq!(events[1], [&scalar[..], &0.25f32.to_le_bytes()].concat());
    }

    fn by_polynomial(data: &[u8]) -> u32 {
        let mut crc = !0u32;
        for byte in data {
            crc ^= u32::from(*byte);
            for _ in 0..8 {
                crc = (crc >> 1) ^ if crc & 1 == 1 { 0x82f6_3b78 } else { 0 };
            }
        }
        (!crc).rotate_right(15).wrapping_add(0xa282_ead8)
    }
}
