//! HELLO, 52 bytes: opens a session, daemon first, then the cRIO's answer with the same session.
//!
//! | offset | type | field |
//! | --- | --- | --- |
//! | 20 | u32 | session, fresh, random, not zero |
//! | 24 | u32 | sample rate, mHz (50000) |
//! | 28 | u8 | sensors |
//! | 29 | u8 | valves |
//! | 30 | u8 | lowest protocol version |
//! | 31 | u8 | highest protocol version |
//! | 32 | 16 bytes | name, ASCII, zero padded |
//! | 48 | u32 | CRC |

use super::error::WireError;
use super::fields::{FieldReader, FieldWriter};
use super::{ByeReason, FrameType, HELLO_LENGTH, MIN_CHANNELS, RATE_MILLIHERTZ, VERSION};

/// A HELLO frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Hello {
    /// Sequence number of the frame.
    pub sequence: u32,
    /// Sender's monotonic clock, ns.
    pub clock_ns: u64,
    /// Session, not zero.
    pub session: u32,
    /// Sample rate, mHz.
    pub rate_millihertz: u32,
    /// Sensors the sender has (cRIO) or needs (daemon).
    pub sensors: u8,
    /// Valves the sender has (cRIO) or needs (daemon).
    pub valves: u8,
    /// Lowest protocol version the sender speaks.
    pub min_version: u8,
    /// Highest protocol version the sender speaks.
    pub max_version: u8,
    /// Name of the sender, ASCII, zero padded; see [`Hello::padded_name`].
    pub name: [u8; 16],
}

/// Why a peer's HELLO cannot open a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum HelloRefusal {
    /// The version ranges do not meet.
    #[error(
        "no common protocol version: the peer speaks {min} to {max}, this program {VERSION}; bring both ends to one version"
    )]
    NoCommonVersion {
        /// Lowest version of the peer.
        min: u8,
        /// Highest version of the peer.
        max: u8,
    },
    /// The sample rates differ.
    #[error(
        "the peer samples at {found_millihertz} mHz, this program needs {RATE_MILLIHERTZ} mHz (50 Hz); set the peer's sample rate"
    )]
    Rate {
        /// The peer's rate, mHz.
        found_millihertz: u32,
    },
    /// Too few sensors.
    #[error(
        "the peer has {found} sensors, {MIN_CHANNELS} are needed (positive and negative pressure); check its channel list"
    )]
    Sensors {
        /// The peer's sensors.
        found: u8,
    },
    /// Too few valves.
    #[error(
        "the peer has {found} valves, {MIN_CHANNELS} are needed (positive and negative vent); check its channel list"
    )]
    Valves {
        /// The peer's valves.
        found: u8,
    },
    /// Session zero.
    #[error("the peer opened session 0; a session must be a fresh random number other than 0")]
    SessionZero,
}

impl HelloRefusal {
    /// The reason to put into the BYE that answers such a HELLO.
    #[must_use]
    pub const fn bye_reason(&self) -> ByeReason {
        match self {
            Self::NoCommonVersion { .. } => ByeReason::Version,
            _ => ByeReason::ProtocolError,
        }
    }
}

impl Hello {
    /// The HELLO of a sender of this version: 50 Hz, two sensors, two valves.
    #[must_use]
    pub fn new(sequence: u32, clock_ns: u64, session: u32, name: &str) -> Self {
        Self {
            sequence,
            clock_ns,
            session,
            rate_millihertz: RATE_MILLIHERTZ,
            sensors: MIN_CHANNELS,
            valves: MIN_CHANNELS,
            min_version: VERSION,
            max_version: VERSION,
            name: Self::padded_name(name),
        }
    }

    /// A name as HELLO carries it: 16 bytes, other than printable ASCII as `?`, cut or zero padded.
    #[must_use]
    pub fn padded_name(name: &str) -> [u8; 16] {
        let mut padded = [0; 16];
        for (to, from) in padded.iter_mut().zip(name.chars()) {
            *to = if from == ' ' || from.is_ascii_graphic() { from as u8 } else { b'?' };
        }
        padded
    }

    /// The name without its padding, `(unreadable)` where it is not ASCII.
    #[must_use]
    pub fn name_text(&self) -> &str {
        let length = self.name.iter().position(|byte| *byte == 0).unwrap_or(self.name.len());
        self.name
            .get(..length)
            .filter(|name| name.iter().all(|byte| *byte == b' ' || byte.is_ascii_graphic()))
            .and_then(|name| std::str::from_utf8(name).ok())
            .unwrap_or("(unreadable)")
    }

    /// Checks whether this HELLO, come from the peer, can open a session with this program.
    ///
    /// # Errors
    /// The first thing that forbids it: version, session, rate, sensors, valves.
    pub const fn check(&self) -> Result<(), HelloRefusal> {
        if self.min_version > VERSION || self.max_version < VERSION {
            return Err(HelloRefusal::NoCommonVersion { min: self.min_version, max: self.max_version });
        }
        if self.session == 0 {
            return Err(HelloRefusal::SessionZero);
        }
        if self.rate_millihertz != RATE_MILLIHERTZ {
            return Err(HelloRefusal::Rate { found_millihertz: self.rate_millihertz });
        }
        if self.sensors < MIN_CHANNELS {
            return Err(HelloRefusal::Sensors { found: self.sensors });
        }
        if self.valves < MIN_CHANNELS {
            return Err(HelloRefusal::Valves { found: self.valves });
        }
        Ok(())
    }

    /// The frame's bytes.
    ///
    /// # Real-time
    /// Allocates nothing; may run in the tick.
    #[must_use]
    pub fn encode(&self) -> [u8; HELLO_LENGTH] {
        let mut frame = FieldWriter::new(FrameType::Hello, self.sequence, self.clock_ns);
        frame.u32(self.session);
        frame.u32(self.rate_millihertz);
        frame.u8(self.sensors);
        frame.u8(self.valves);
        frame.u8(self.min_version);
        frame.u8(self.max_version);
        frame.bytes(&self.name);
        frame.finish()
    }

    /// Reads the fields from byte 8 on; header and CRC are checked by the caller.
    pub(super) fn read(mut fields: FieldReader<'_>) -> Result<Self, WireError> {
        Ok(Self {
            sequence: fields.u32()?,
            clock_ns: fields.u64()?,
            session: fields.u32()?,
            rate_millihertz: fields.u32()?,
            sensors: fields.u8()?,
            valves: fields.u8()?,
            min_version: fields.u8()?,
            max_version: fields.u8()?,
            name: fields.bytes()?,
        })
    }
}
