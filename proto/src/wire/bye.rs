//! BYE, 32 bytes, either way: the end of a session.
//!
//! | offset | type | field |
//! | --- | --- | --- |
//! | 20 | u32 | session |
//! | 24 | u8 | reason |
//! | 25 | 3 bytes | zero |
//! | 28 | u32 | CRC |

use super::codes::ByeReason;
use super::error::WireError;
use super::fields::{FieldReader, FieldWriter};
use super::{BYE_LENGTH, FrameType};

/// A BYE frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Bye {
    /// Sequence number of the frame.
    pub sequence: u32,
    /// Sender's monotonic clock, ns.
    pub clock_ns: u64,
    /// Session, 0 where none was opened.
    pub session: u32,
    /// Why the session ends.
    pub reason: ByeReason,
}

impl Bye {
    /// The frame's bytes.
    ///
    /// # Real-time
    /// Allocates nothing; may run in the tick.
    #[must_use]
    pub fn encode(&self) -> [u8; BYE_LENGTH] {
        let mut frame = FieldWriter::new(FrameType::Bye, self.sequence, self.clock_ns);
        frame.u32(self.session);
        frame.u8(self.reason.code());
        frame.bytes(&[0; 3]);
        frame.finish()
    }

    /// Reads the fields from byte 8 on; header and CRC are checked by the caller.
    pub(super) fn read(mut fields: FieldReader<'_>) -> Result<Self, WireError> {
        Ok(Self {
            sequence: fields.u32()?,
            clock_ns: fields.u64()?,
            session: fields.u32()?,
            reason: ByeReason::from_code(fields.u8()?),
        })
    }
}
