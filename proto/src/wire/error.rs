//! Problems of bytes that should be a frame, and their meaning for the stream.
//!
//! Two kinds of damage. *Recoverable*: the header is plausible, so the end of the frame is known, but
//! its CRC or a code in it is wrong; drop that frame and go on. *Fatal*: magic, version, type or
//! length is wrong, so where the next frame starts is unknown; the link must be closed. An unknown
//! type is fatal because the protocol fixes a frame's length by its type.

use std::fmt;

use super::codes::FrameType;
use super::frame::RawFrame;
use super::{HEADER_LENGTH, MAGIC, VERSION};

/// The first bytes of a frame, as many as had come (at most 20), shown in hex in messages.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct HeaderBytes {
    bytes: [u8; HEADER_LENGTH],
    length: u8,
}

impl HeaderBytes {
    /// The first 20 of these bytes, or all of them where there are fewer.
    #[must_use]
    pub fn of(bytes: &[u8]) -> Self {
        let mut kept = [0; HEADER_LENGTH];
        let mut length = 0;
        for (to, from) in kept.iter_mut().zip(bytes) {
            *to = *from;
            length += 1;
        }
        Self { bytes: kept, length }
    }

    /// The bytes.
    #[must_use]
    pub fn as_bytes(&self) -> &[u8] {
        self.bytes.get(..usize::from(self.length)).unwrap_or(&self.bytes)
    }
}

impl fmt::Display for HeaderBytes {
    /// Hex, in groups of four bytes: `504E4555 01020040 …`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, byte) in self.as_bytes().iter().enumerate() {
            if index > 0 && index % 4 == 0 {
                f.write_str(" ")?;
            }
            write!(f, "{byte:02X}")?;
        }
        Ok(())
    }
}

impl fmt::Debug for HeaderBytes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "HeaderBytes({self})")
    }
}

/// Why bytes are not a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum WireError {
    /// The frame does not start with "PNEU". Fatal.
    #[error(
        "the peer does not speak this protocol: a frame must start with {MAGIC:08X} but the bytes are [{header}]; check address and port"
    )]
    Magic {
        /// The bytes found.
        header: HeaderBytes,
    },
    /// The header names another protocol version. Fatal.
    #[error(
        "the peer speaks protocol version {found}, this program version {VERSION} (header [{header}]); bring both ends to one version"
    )]
    Version {
        /// The version found.
        found: u8,
        /// The bytes found.
        header: HeaderBytes,
    },
    /// The header names a type the protocol does not have. Fatal.
    #[error("frame of unknown type {code} (header [{header}]); known are 1 HELLO, 2 SENSE, 3 COMMAND, 4 BYE")]
    Type {
        /// The type code found.
        code: u8,
        /// The bytes found.
        header: HeaderBytes,
    },
    /// The length in the header is not the one of its type. Fatal.
    #[error("a {frame} frame says it is {found} bytes long but must be {} (header [{header}])", .frame.length())]
    Length {
        /// The type of the frame.
        frame: FrameType,
        /// The length found.
        found: u16,
        /// The bytes found.
        header: HeaderBytes,
    },
    /// The CRC does not fit the bytes. Recoverable.
    #[error(
        "a {frame} frame came damaged: its CRC is {found:08X}, that of its bytes {computed:08X} (header [{header}])"
    )]
    Crc {
        /// The type of the frame.
        frame: FrameType,
        /// The CRC in the frame.
        found: u32,
        /// The CRC of its bytes.
        computed: u32,
        /// The header of the frame.
        header: HeaderBytes,
    },
    /// The CRC is right, but a field holds a code the protocol does not name. Recoverable.
    #[error("a {frame} frame holds {code} as its {field} (byte {offset}), a code the protocol does not name")]
    UnknownCode {
        /// The type of the frame.
        frame: FrameType,
        /// The field, in the protocol's words.
        field: &'static str,
        /// Where it stands in the frame, bytes from its start.
        offset: u8,
        /// The code found.
        code: u8,
    },
    /// Fewer bytes than the frame needs. A [`super::FrameReader`] never gives this: it waits.
    #[error("a frame of {needed} bytes is cut short after {found}")]
    Truncated {
        /// Bytes the frame needs (the header's 20 while its length is unknown).
        needed: usize,
        /// Bytes there are.
        found: usize,
    },
    /// More bytes than the one frame. A [`super::FrameReader`] never gives this: it goes on with them.
    #[error("{extra} bytes follow a {frame} frame where one frame alone was expected")]
    Trailing {
        /// The type of the frame.
        frame: FrameType,
        /// Bytes too many.
        extra: usize,
    },
}

impl WireError {
    /// True where the start of the next frame is unknown, so that the link must be closed.
    #[must_use]
    pub const fn is_fatal(&self) -> bool {
        matches!(self, Self::Magic { .. } | Self::Version { .. } | Self::Type { .. } | Self::Length { .. })
    }
}

/// A damaged piece of a stream: the reason, and the bytes it was found in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("{error}")]
pub struct Damage {
    /// Problem.
    pub error: WireError,
    /// The whole dropped frame; where the damage is fatal, the bytes that had come, 64 at most.
    pub raw: RawFrame,
}

impl Damage {
    /// True where the start of the next frame is unknown, so that the link must be closed.
    #[must_use]
    pub const fn is_fatal(&self) -> bool {
        self.error.is_fatal()
    }
}
