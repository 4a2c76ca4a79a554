//! COMMAND, 44 bytes, daemon to cRIO: the answer to a SENSE.
//!
//! | offset | type | field |
//! | --- | --- | --- |
//! | 20 | u32 | session |
//! | 24 | u32 | tick of the SENSE it answers |
//! | 28 | f32\[2\] | duty in \[0, 1\]: positive valve, negative valve |
//! | 36 | u8 | mode |
//! | 37 | u8 | time to live, ticks |
//! | 38 | u8 | digital outputs, bit 0: pump on |
//! | 39 | u8 | zero |
//! | 40 | u32 | CRC |

use super::codes::Mode;
use super::error::WireError;
use super::fields::{FieldReader, FieldWriter};
use super::{COMMAND_LENGTH, FrameType};

/// A COMMAND frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Command {
    /// Sequence number of the frame.
    pub sequence: u32,
    /// Daemon's monotonic clock, ns.
    pub clock_ns: u64,
    /// Session.
    pub session: u32,
    /// Tick of the SENSE it answers.
    pub tick: u32,
    /// Duty, 0 (closed) to 1 (open): positive valve, negative valve. Any value decodes.
    pub duty: [f32; 2],
    /// Mode that is asked of the cRIO.
    pub mode: Mode,
    /// Time to live, ticks; at most 5 by the protocol. Any value decodes.
    pub ttl_ticks: u8,
    /// Digital outputs; see [`Command::PUMP_ON`].
    pub digital_outputs: u8,
}

impl Command {
    /// Bit of the digital outputs that turns the pump on.
    pub const PUMP_ON: u8 = 1;

    /// True where the command turns the pump on.
    #[must_use]
    pub const fn pump_on(&self) -> bool {
        self.digital_outputs & Self::PUMP_ON != 0
    }

    /// The frame's bytes.
    ///
    /// # Real-time
    /// Allocates nothing; may run in the tick.
    #[must_use]
    pub fn encode(&self) -> [u8; COMMAND_LENGTH] {
        let mut frame = FieldWriter::new(FrameType::Command, self.sequence, self.clock_ns);
        frame.u32(self.session);
        frame.u32(self.tick);
        for duty in self.duty {
            frame.f32(duty);
        }
        frame.u8(self.mode.code());
        frame.u8(self.ttl_ticks);
        frame.u8(self.digital_outputs);
        frame.u8(0);
        frame.finish()
    }

    /// Reads the fields from byte 8 on; header and CRC are checked by the caller.
    pub(super) fn read(mut fields: FieldReader<'_>) -> Result<Self, WireError> {
        Ok(Self {
            sequence: fields.u32()?,
            clock_ns: fields.u64()?,
            session: fields.u32()?,
            tick: fields.u32()?,
            duty: [fields.f32()?, fields.f32()?],
            mode: Mode::from_code(fields.u8()?)?,
            ttl_ticks: fields.u8()?,
            digital_outputs: fields.u8()?,
        })
    }
}
