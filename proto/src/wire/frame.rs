//! One frame of any type: its bytes checked and decoded, and its bytes kept as they came.
//!
//! Checks in the order in which the bytes come: magic, version, type, length, then, with the whole
//! frame there, the CRC, then the codes in the body. The first that fails is the one reported.

use std::fmt;

use super::error::{HeaderBytes, WireError};
use super::fields::FieldReader;
use super::{Bye, Command, FrameType, HEADER_LENGTH, Hello, MAGIC, MAX_LENGTH, Sense, VERSION};

/// A frame of any type.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Frame {
    /// Opens a session.
    Hello(Hello),
    /// The cRIO's reading of one tick.
    Sense(Sense),
    /// The daemon's answer to a reading.
    Command(Command),
    /// Ends a session.
    Bye(Bye),
}

impl Frame {
    /// Decodes bytes that must be one frame, no fewer and no more.
    ///
    /// # Errors
    /// The first thing that is wrong: magic, version, type, length, CRC, an unknown code.
    ///
    /// # Real-time
    /// Allocates nothing, cannot panic; may run in the tick.
    pub fn decode(bytes: &[u8]) -> Result<Self, WireError> {
        let Some(kind) = check_header(bytes)? else {
            return Err(WireError::Truncated { needed: HEADER_LENGTH, found: bytes.len() });
        };
        let needed = kind.length();
        let Some((frame, extra)) = bytes.split_at_checked(needed) else {
            return Err(WireError::Truncated { needed, found: bytes.len() });
        };
        if !extra.is_empty() {
            return Err(WireError::Trailing { frame: kind, extra: extra.len() });
        }
        decode_whole(kind, frame)
    }

    /// The frame's bytes.
    ///
    /// # Real-time
    /// Allocates nothing; may run in the tick.
    #[must_use]
    pub fn encode(&self) -> RawFrame {
        match self {
            Self::Hello(frame) => RawFrame::of(&frame.encode()),
            Self::Sense(frame) => RawFrame::of(&frame.encode()),
            Self::Command(frame) => RawFrame::of(&frame.encode()),
            Self::Bye(frame) => RawFrame::of(&frame.encode()),
        }
    }

    /// The frame's type.
    #[must_use]
    pub const fn kind(&self) -> FrameType {
        match self {
            Self::Hello(_) => FrameType::Hello,
            Self::Sense(_) => FrameType::Sense,
            Self::Command(_) => FrameType::Command,
            Self::Bye(_) => FrameType::Bye,
        }
    }

    /// The frame's sequence number.
    #[must_use]
    pub const fn sequence(&self) -> u32 {
        match self {
            Self::Hello(frame) => frame.sequence,
            Self::Sense(frame) => frame.sequence,
            Self::Command(frame) => frame.sequence,
            Self::Bye(frame) => frame.sequence,
        }
    }

    /// The frame's session.
    #[must_use]
    pub const fn session(&self) -> u32 {
        match self {
            Self::Hello(frame) => frame.session,
            Self::Sense(frame) => frame.session,
            Self::Command(frame) => frame.session,
            Self::Bye(frame) => frame.session,
        }
    }
}

/// The bytes of one frame as they went over the wire, at most 64, held without allocation.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct RawFrame {
    bytes: [u8; MAX_LENGTH],
    length: u8,
}

impl RawFrame {
    /// The first 64 of these bytes, or all of them where there are fewer.
    #[must_use]
    pub fn of(bytes: &[u8]) -> Self {
        let mut kept = [0; MAX_LENGTH];
        let length = bytes.len().min(MAX_LENGTH);
        if let (Some(to), Some(from)) = (kept.get_mut(..length), bytes.get(..length)) {
            to.copy_from_slice(from);
        }
        Self { bytes: kept, length: length as u8 }
    }

    /// The bytes.
    #[must_use]
    pub fn as_bytes(&self) -> &[u8] {
        self.bytes.get(..usize::from(self.length)).unwrap_or(&self.bytes)
    }
}

impl AsRef<[u8]> for RawFrame {
    fn as_ref(&self) -> &[u8] {
        self.as_bytes()
    }
}

impl fmt::Debug for RawFrame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("RawFrame(")?;
        for byte in self.as_bytes() {
            write!(f, "{byte:02X}")?;
        }
        f.write_str(")")
    }
}

/// Checks as much of a header as has come: its type once magic, version, type and length are there.
///
/// A wrong byte is reported as soon as it is there, so that a peer that sends a few bytes of some
/// other protocol and then waits is told apart from a slow one.
pub(super) fn check_header(bytes: &[u8]) -> Result<Option<FrameType>, WireError> {
    let magic = MAGIC.to_be_bytes();
    if bytes.iter().zip(magic).any(|(found, expected)| *found != expected) {
        return Err(WireError::Magic { header: HeaderBytes::of(bytes) });
    }
    let rest = bytes.get(magic.len()..).unwrap_or(&[]);
    let Some((&found, rest)) = rest.split_first() else {
        return Ok(None);
    };
    if found != VERSION {
        return Err(WireError::Version { found, header: HeaderBytes::of(bytes) });
    }
    let Some((&code, rest)) = rest.split_first() else {
        return Ok(None);
    };
    let Some(kind) = FrameType::from_code(code) else {
        return Err(WireError::Type { code, header: HeaderBytes::of(bytes) });
    };
    let Some(length) = rest.first_chunk::<2>() else {
        return Ok(None);
    };
    let found = u16::from_be_bytes(*length);
    if usize::from(found) != kind.length() {
        return Err(WireError::Length { frame: kind, found, header: HeaderBytes::of(bytes) });
    }
    Ok(Some(kind))
}

/// Checks the CRC of a frame whose header is sound and whose bytes are all there, and decodes it.
pub(super) fn decode_whole(kind: FrameType, bytes: &[u8]) -> Result<Frame, WireError> {
    let Some((content, crc)) = bytes.split_last_chunk::<4>() else {
        return Err(WireError::Truncated { needed: kind.length(), found: bytes.len() });
    };
    let found = u32::from_be_bytes(*crc);
    let computed = crc32fast::hash(content);
    if found != computed {
        return Err(WireError::Crc { frame: kind, found, computed, header: HeaderBytes::of(bytes) });
    }
    // Magic, version, type and length are the 8 bytes already checked.
    let fields = FieldReader::new(content.get(8..).unwrap_or(&[]));
    match kind {
        FrameType::Hello => Hello::read(fields).map(Frame::Hello),
        FrameType::Sense => Sense::read(fields).map(Frame::Sense),
        FrameType::Command => Command::read(fields).map(Frame::Command),
        FrameType::Bye => Bye::read(fields).map(Frame::Bye),
    }
}
