//! SENSE, 64 bytes, cRIO to daemon, every tick.
//!
//! | offset | type | field |
//! | --- | --- | --- |
//! | 20 | u32 | session |
//! | 24 | u32 | tick, from 0 |
//! | 28 | u32 | sequence number of the COMMAND in force, 0: none |
//! | 32 | f32\[4\] | volts: positive sensor, negative sensor, two spare; NaN where absent |
//! | 48 | f32\[2\] | duty now applied: positive valve, negative valve |
//! | 56 | u8 | low four bits: state; bit 7: pump running |
//! | 57 | u8 | trip bits |
//! | 58 | u16 | commands missed since the session began |
//! | 60 | u32 | CRC |

use super::codes::{CrioState, TripBits};
use super::error::WireError;
use super::fields::{FieldReader, FieldWriter};
use super::{FrameType, SENSE_LENGTH};

const STATE_BITS: u8 = 0x0F;
const PUMP_BIT: u8 = 0x80;

/// A SENSE frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sense {
    /// Sequence number of the frame.
    pub sequence: u32,
    /// cRIO's monotonic clock, ns.
    pub clock_ns: u64,
    /// Session.
    pub session: u32,
    /// Tick, from 0 in every session.
    pub tick: u32,
    /// Sequence number of the COMMAND now in force, 0 where there is none.
    pub command_in_force: u32,
    /// Sensor voltages, V: positive, negative, two spare; NaN where there is no sensor.
    pub volts: [f32; 4],
    /// Duty now applied, 0 (closed) to 1 (open): positive valve, negative valve.
    pub duty: [f32; 2],
    /// State of the cRIO.
    pub state: CrioState,
    /// True while the pump runs.
    pub pump_running: bool,
    /// Why it tripped.
    pub trips: TripBits,
    /// Commands missed since the session began; stays at 65535 once there.
    pub commands_missed: u16,
}

impl Sense {
    /// The frame's bytes.
    ///
    /// # Real-time
    /// Allocates nothing; may run in the tick.
    #[must_use]
    pub fn encode(&self) -> [u8; SENSE_LENGTH] {
        let mut frame = FieldWriter::new(FrameType::Sense, self.sequence, self.clock_ns);
        frame.u32(self.session);
        frame.u32(self.tick);
        frame.u32(self.command_in_force);
        for volts in self.volts {
            frame.f32(volts);
        }
        for duty in self.duty {
            frame.f32(duty);
        }
        frame.u8(self.state.code() | if self.pump_running { PUMP_BIT } else { 0 });
        frame.u8(self.trips.bits());
        frame.u16(self.commands_missed);
        frame.finish()
    }

    /// Reads the fields from byte 8 on; header and CRC are checked by the caller.
    pub(super) fn read(mut fields: FieldReader<'_>) -> Result<Self, WireError> {
        let sequence = fields.u32()?;
        let clock_ns = fields.u64()?;
        let session = fields.u32()?;
        let tick = fields.u32()?;
        let command_in_force = fields.u32()?;
        let volts = [fields.f32()?, fields.f32()?, fields.f32()?, fields.f32()?];
        let duty = [fields.f32()?, fields.f32()?];
        let status = fields.u8()?;
        Ok(Self {
            sequence,
            clock_ns,
            session,
            tick,
            command_in_force,
            volts,
            duty,
            state: CrioState::from_code(status & STATE_BITS)?,
            pump_running: status & PUMP_BIT != 0,
            trips: TripBits::from_bits(fields.u8()?),
            commands_missed: fields.u16()?,
        })
    }
}
