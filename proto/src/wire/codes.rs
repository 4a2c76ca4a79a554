//! The small codes of the protocol: frame types, modes, states, trip bits, reasons.
//!
//! A code the protocol does not name is an error where acting on a guess could hurt (type, mode,
//! state), and is kept as it is where it only informs (trip bits, reason of a BYE).

use std::fmt;

use super::error::WireError;
use super::{BYE_LENGTH, COMMAND_LENGTH, HELLO_LENGTH, SENSE_LENGTH};

/// The four kinds of frame; the discriminant is the code on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum FrameType {
    /// Opens a session, daemon first, then the cRIO's answer.
    Hello = 1,
    /// The cRIO's reading of one tick.
    Sense = 2,
    /// The daemon's answer to a SENSE.
    Command = 3,
    /// The end of a session, either way.
    Bye = 4,
}

impl FrameType {
    /// The type with this code, `None` for a code the protocol does not name.
    #[must_use]
    pub const fn from_code(code: u8) -> Option<Self> {
        match code {
            1 => Some(Self::Hello),
            2 => Some(Self::Sense),
            3 => Some(Self::Command),
            4 => Some(Self::Bye),
            _ => None,
        }
    }

    /// The code on the wire.
    #[must_use]
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// Length of every frame of this type in bytes, header and CRC included.
    #[must_use]
    pub const fn length(self) -> usize {
        match self {
            Self::Hello => HELLO_LENGTH,
            Self::Sense => SENSE_LENGTH,
            Self::Command => COMMAND_LENGTH,
            Self::Bye => BYE_LENGTH,
        }
    }
}

impl fmt::Display for FrameType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Hello => "HELLO",
            Self::Sense => "SENSE",
            Self::Command => "COMMAND",
            Self::Bye => "BYE",
        })
    }
}

/// Mode that a COMMAND asks of the cRIO; the discriminant is the code on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Mode {
    /// Open both vents.
    Vent = 0,
    /// Apply the duties of this command.
    Run = 1,
    /// Apply the duties of this command while the daemon bridges missing readings.
    Hold = 2,
}

impl Mode {
    /// The mode with this code.
    ///
    /// # Errors
    /// [`WireError::UnknownCode`] for a code the protocol does not name.
    pub const fn from_code(code: u8) -> Result<Self, WireError> {
        match code {
            0 => Ok(Self::Vent),
            1 => Ok(Self::Run),
            2 => Ok(Self::Hold),
            _ => Err(WireError::UnknownCode { frame: FrameType::Command, field: "mode", offset: 36, code }),
        }
    }

    /// The code on the wire.
    #[must_use]
    pub const fn code(self) -> u8 {
        self as u8
    }
}

impl fmt::Display for Mode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Vent => "vent",
            Self::Run => "run",
            Self::Hold => "hold",
        })
    }
}

/// State of the cRIO, low four bits of SENSE byte 56; the discriminant is the code on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum CrioState {
    /// Both vents open, nothing commanded.
    Idle = 0,
    /// A command of mode run is in force.
    Running = 1,
    /// A command of mode hold is in force.
    Holding = 2,
    /// Both vents open and latched so until a new HELLO.
    Tripped = 3,
}

impl CrioState {
    /// The state with this code (0 to 15).
    ///
    /// # Errors
    /// [`WireError::UnknownCode`] for a code the protocol does not name.
    pub const fn from_code(code: u8) -> Result<Self, WireError> {
        match code {
            0 => Ok(Self::Idle),
            1 => Ok(Self::Running),
            2 => Ok(Self::Holding),
            3 => Ok(Self::Tripped),
            _ => Err(WireError::UnknownCode { frame: FrameType::Sense, field: "state", offset: 56, code }),
        }
    }

    /// The code on the wire.
    #[must_use]
    pub const fn code(self) -> u8 {
        self as u8
    }
}

impl fmt::Display for CrioState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Idle => "idle",
            Self::Running => "running",
            Self::Holding => "holding",
            Self::Tripped => "tripped",
        })
    }
}

/// Why the cRIO tripped, as a set of bits; bits the protocol does not name are kept and shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct TripBits(u8);

impl TripBits {
    /// No trip.
    pub const NONE: Self = Self(0);
    /// A pressure reached the cRIO's own limit of 300 kPa.
    pub const OVER_PRESSURE: Self = Self(1);
    /// No command counted within its time to live.
    pub const COMMAND_LOST: Self = Self(2);
    /// A sensor or its wire is broken.
    pub const SENSOR: Self = Self(4);
    /// An operator pressed stop at the cRIO.
    pub const OPERATOR_STOP: Self = Self(8);

    /// The set with these bits.
    #[must_use]
    pub const fn from_bits(bits: u8) -> Self {
        Self(bits)
    }

    /// The bits on the wire.
    #[must_use]
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// True where no bit is set.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// True where every bit of `other` is set here too.
    #[must_use]
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Both sets together.
    #[must_use]
    pub const fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl fmt::Display for TripBits {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_empty() {
            return f.write_str("none");
        }
        let named = [
            (Self::OVER_PRESSURE, "over-pressure"),
            (Self::COMMAND_LOST, "command lost"),
            (Self::SENSOR, "sensor"),
            (Self::OPERATOR_STOP, "operator stop"),
        ];
        let mut separator = "";
        for (bit, name) in named {
            if self.contains(bit) {
                write!(f, "{separator}{name}")?;
                separator = ", ";
            }
        }
        let unnamed = self.0 & !0x0F;
        if unnamed != 0 {
            write!(f, "{separator}unknown bits 0x{unnamed:02X}")?;
        }
        Ok(())
    }
}

/// Why a session ends; a code the protocol does not name is kept, for a BYE ends it all the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ByeReason {
    /// The work is done.
    Normal,
    /// No common protocol version.
    Version,
    /// The peer broke the protocol.
    ProtocolError,
    /// An operator asked for it.
    Operator,
    /// A fault at the sender.
    Fault,
    /// A code the protocol does not name (5 to 255).
    Other(u8),
}

impl ByeReason {
    /// The reason with this code.
    #[must_use]
    pub const fn from_code(code: u8) -> Self {
        match code {
            0 => Self::Normal,
            1 => Self::Version,
            2 => Self::ProtocolError,
            3 => Self::Operator,
            4 => Self::Fault,
            other => Self::Other(other),
        }
    }

    /// The code on the wire.
    #[must_use]
    pub const fn code(self) -> u8 {
        match self {
            Self::Normal => 0,
            Self::Version => 1,
            Self::ProtocolError => 2,
            Self::Operator => 3,
            Self::Fault => 4,
            Self::Other(code) => code,
        }
    }
}

impl fmt::Display for ByeReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Normal => f.write_str("normal end"),
            Self::Version => f.write_str("no common protocol version"),
            Self::ProtocolError => f.write_str("protocol error"),
            Self::Operator => f.write_str("operator"),
            Self::Fault => f.write_str("fault"),
            Self::Other(code) => write!(f, "reason {code}, which the protocol does not name"),
        }
    }
}
