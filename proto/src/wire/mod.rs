//! The wire between the daemon and the cRIO: four fixed-length frames over TCP.
//!
//! Every frame is a 20-byte header, a body whose length its type fixes, and a CRC-32 (IEEE 802.3, as
//! zlib's `crc32`) of everything before it. Integers and floats are big-endian, as LabVIEW's
//! *Flatten To String* writes them.
//!
//! | offset | type | header field |
//! | --- | --- | --- |
//! | 0 | u32 | magic `0x504E4555` ("PNEU") |
//! | 4 | u8 | version, 1 |
//! | 5 | u8 | type: 1 HELLO, 2 SENSE, 3 COMMAND, 4 BYE |
//! | 6 | u16 | length of the whole frame, CRC included |
//! | 8 | u32 | sequence number, per direction, from 1, wraps past `0xFFFFFFFF` to 1 |
//! | 12 | u64 | sender's monotonic clock, ns |
//!
//! The bodies stand in [`Hello`] (52 bytes), [`Sense`] (64), [`Command`] (44) and [`Bye`] (32).
//! Each has an `encode` into an array of exactly its length, to go out in one write, and the stream
//! side is [`FrameReader`], which takes bytes split and joined in any way.
//!
//! The *meaning* of a frame is not judged here: a COMMAND with a NaN duty decodes, and it is the cRIO's
//! rule (see [`crate::emulator`]) that such a command does not count. What is judged here is whether
//! the bytes are a frame at all. Bytes the protocol calls zero, and the bits it does not name, are
//! written as zero and ignored when read.
//!
//! Nothing in this module allocates, locks or blocks, and no input makes it panic: all of it may run
//! in the daemon's tick.
#![deny(clippy::indexing_slicing)]

mod bye;
mod codes;
mod command;
mod error;
mod fields;
mod frame;
mod hello;
mod reader;
mod sense;
mod sequence;

pub use bye::Bye;
pub use codes::{ByeReason, CrioState, FrameType, Mode, TripBits};
pub use command::Command;
pub use error::{Damage, HeaderBytes, WireError};
pub use frame::{Frame, RawFrame};
pub use hello::{Hello, HelloRefusal};
pub use reader::{FrameReader, Received};
pub use sense::Sense;
pub use sequence::{SequenceCounter, is_newer, sequence_distance};

/// First four bytes of every frame, "PNEU".
pub const MAGIC: u32 = 0x504E_4555;
/// The protocol version this code speaks, in every header.
pub const VERSION: u8 = 1;
/// Bytes of the header of every frame.
pub const HEADER_LENGTH: usize = 20;
/// Bytes of the CRC at the end of every frame.
pub const CRC_LENGTH: usize = 4;
/// Bytes of a HELLO frame.
pub const HELLO_LENGTH: usize = 52;
/// Bytes of a SENSE frame.
pub const SENSE_LENGTH: usize = 64;
/// Bytes of a COMMAND frame.
pub const COMMAND_LENGTH: usize = 44;
/// Bytes of a BYE frame.
pub const BYE_LENGTH: usize = 32;
/// Bytes of the longest frame.
pub const MAX_LENGTH: usize = SENSE_LENGTH;
/// The one sample rate of version 1, 50 Hz, in millihertz.
pub const RATE_MILLIHERTZ: u32 = 50_000;
/// One tick in nanoseconds.
pub const TICK_NS: u64 = 20_000_000;
/// Time to live of a COMMAND when nothing asks for another, in ticks.
pub const DEFAULT_TTL_TICKS: u8 = 2;
/// Longest time to live of a COMMAND, in ticks.
pub const MAX_TTL_TICKS: u8 = 5;
/// Fewest sensors, and fewest valves, a peer must have.
pub const MIN_CHANNELS: u8 = 2;
