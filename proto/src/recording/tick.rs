//! What one 50 Hz tick of the daemon leaves behind: a plain, fixed-size record.
//!
//! The real-time thread fills one [`TickRecord`] per tick and pushes it into a lock-free queue; the
//! recorder thread turns it into MCAP messages. So the record is `Copy`, holds no heap memory, and
//! making or copying one is a few hundred bytes of plain stores.
//!
//! Pressures are gauge kPa, as everywhere at an edge. Times are monotonic nanoseconds of the
//! daemon's clock; the wall clock enters only when the record is written.
//!
//! Left out on purpose: texts (the recorder has events for those) and anything that can be worked
//! out again from the raw frames, except what a person wants to plot without decoding frames.

/// Bytes of a SENSE frame on the wire.
pub const SENSE_BYTES: usize = 64;
/// Bytes of a COMMAND frame on the wire.
pub const COMMAND_BYTES: usize = 44;
/// Ticks that MPObs looks ahead.
pub const PREDICTED_TICKS: usize = model::observation::AHEAD;

/// How the SENSE frame of a tick came.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u8)]
pub enum Arrival {
    /// Before its deadline.
    InTime = 0,
    /// After its deadline, and still used.
    Late = 1,
    /// Not at all: the tick ran on the deadline without a frame.
    #[default]
    Missing = 2,
    /// A frame came, and its CRC, length, session or content was wrong.
    Damaged = 3,
}

impl Arrival {
    /// The number that recordings carry: 0 in time, 1 late, 2 missing, 3 damaged.
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// The arrival class of a recorded number; `None` for a number that is none.
    pub const fn from_code(code: u8) -> Option<Self> {
        match code {
            0 => Some(Self::InTime),
            1 => Some(Self::Late),
            2 => Some(Self::Missing),
            3 => Some(Self::Damaged),
            _ => None,
        }
    }
}

/// The parts of one channel's control law, in duty.
///
/// `u_raw` is the sum before any limit; what limits made of it is `u_pos`/`u_neg` of the record.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LawParts {
    /// Feed-forward from the rig's steady map, or the policy's output where a policy flies (duty).
    pub feed_forward: f64,
    /// Proportional part (duty).
    pub proportional: f64,
    /// Integral part (duty).
    pub integral: f64,
    /// Sum of all parts before limits (duty; may lie outside [0, 1]).
    pub u_raw: f64,
}

/// One control tick, as the real-time thread saw it.
///
/// # Real-time
/// `Copy`, fixed size, no heap: may be filled, copied and queued in the tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TickRecord {
    /// Session number that both ends agreed on (0: none yet).
    pub session: u32,
    /// Tick of the SENSE frame, counted by the cRIO from 0; the expected one when none came.
    pub tick: u32,
    /// Daemon's monotonic clock when the frame was received, or when the tick gave up waiting (ns).
    pub receive_ns: u64,
    /// How the SENSE frame came.
    pub arrival: Arrival,

    /// True when `sense` holds the bytes of a received frame, sound or damaged.
    pub sense_present: bool,
    /// The SENSE frame as received; all zero when absent.
    pub sense: [u8; SENSE_BYTES],
    /// True when a COMMAND was sent in this tick.
    pub command_present: bool,
    /// The COMMAND frame as sent; all zero when absent.
    pub command: [u8; COMMAND_BYTES],

    /// The four sensor voltages of the frame (V): positive, negative, two spare; NaN where absent.
    pub volts: [f32; 4],
    /// Duty that the cRIO says the positive valve has now; NaN without a frame.
    pub echo_pos: f32,
    /// Duty that the cRIO says the negative valve has now; NaN without a frame.
    pub echo_neg: f32,
    /// State that the cRIO reports: 0 idle and vented, 1 running, 2 holding, 3 tripped.
    pub crio_state: u8,
    /// Trip bits that the cRIO reports: 1 over-pressure, 2 command lost, 4 sensor, 8 operator stop.
    pub crio_trip: u8,

    /// Measured positive pressure (kPa gauge); NaN without a sound reading.
    pub p_pos_kpa: f64,
    /// Measured negative pressure (kPa gauge); NaN without a sound reading.
    pub p_neg_kpa: f64,
    /// Positive reference now (kPa gauge); NaN when none is active.
    pub ref_pos_kpa: f64,
    /// Negative reference now (kPa gauge); NaN when none is active.
    pub ref_neg_kpa: f64,
    /// MPObs: positive pressure predicted for the next 5 ticks, index 0 is tick + 1 (kPa gauge).
    pub predicted_pos_kpa: [f64; PREDICTED_TICKS],
    /// MPObs: negative pressure predicted for the next 5 ticks, index 0 is tick + 1 (kPa gauge).
    pub predicted_neg_kpa: [f64; PREDICTED_TICKS],

    /// Control law of the positive channel, part by part.
    pub law_pos: LawParts,
    /// Control law of the negative channel, part by part.
    pub law_neg: LawParts,
    /// Duty sent to the positive valve, after all limits, in [0, 1].
    pub u_pos: f64,
    /// Duty sent to the negative valve, after all limits, in [0, 1].
    pub u_neg: f64,
    /// Whether the pump was asked to run.
    pub pump_on: bool,

    /// Mode of the COMMAND: 0 vent, 1 run, 2 hold.
    pub mode: u8,
    /// The daemon's state; the codes are the daemon's own.
    pub state: u8,
    /// The daemon's fault, 0 for none; the codes are the daemon's own.
    pub fault: u16,

    /// How much later than expected the frame came; negative when early (ns).
    pub arrival_lateness_ns: i64,
    /// Time spent receiving and checking the frame (ns).
    pub receive_check_ns: u32,
    /// Time spent in MPObs (ns).
    pub predict_ns: u32,
    /// Time spent in the control law and its limits (ns).
    pub law_ns: u32,
    /// Time spent encoding and sending the COMMAND (ns).
    pub send_ns: u32,
    /// From the frame in hand to the COMMAND sent (ns).
    pub compute_ns: u32,
    /// True when the COMMAND left after its deadline, or not at all.
    pub deadline_missed: bool,
    /// Records that a full queue refused since the session began: says why rows are missing.
    pub records_dropped: u32,
}

impl Default for TickRecord {
    /// A tick in which nothing came and nothing was sent: numbers that were not measured are NaN.
    fn default() -> Self {
        Self {
            session: 0,
            tick: 0,
            receive_ns: 0,
            arrival: Arrival::Missing,
            sense_present: false,
            sense: [0; SENSE_BYTES],
            command_present: false,
            command: [0; COMMAND_BYTES],
            volts: [f32::NAN; 4],
            echo_pos: f32::NAN,
            echo_neg: f32::NAN,
            crio_state: 0,
            crio_trip: 0,
            p_pos_kpa: f64::NAN,
            p_neg_kpa: f64::NAN,
            ref_pos_kpa: f64::NAN,
            ref_neg_kpa: f64::NAN,
            predicted_pos_kpa: [f64::NAN; PREDICTED_TICKS],
            predicted_neg_kpa: [f64::NAN; PREDICTED_TICKS],
            law_pos: LawParts::default(),
            law_neg: LawParts::default(),
            // Both vents open is the safe state, so it is also what "nothing decided" means.
            u_pos: 1.0,
            u_neg: 1.0,
            pump_on: false,
            mode: 0,
            state: 0,
            fault: 0,
            arrival_lateness_ns: 0,
            receive_check_ns: 0,
            predict_ns: 0,
            law_ns: 0,
            send_ns: 0,
            compute_ns: 0,
            deadline_missed: false,
            records_dropped: 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrival_codes_name_every_class_and_nothing_else() {
        for code in 0..=u8::MAX {
            match Arrival::from_code(code) {
                Some(class) => assert_eq!(class.code(), code),
                None => assert!(code > 3, "code {code} has no class"),
            }
        }
    }

    #[test]
    fn the_default_record_is_a_vented_tick_without_a_frame() {
        let record = TickRecord::default();
        assert_eq!((record.u_pos, record.u_neg), (1.0, 1.0));
        assert!(!record.pump_on && !record.sense_present && !record.command_present);
        assert!(record.p_pos_kpa.is_nan() && record.predicted_neg_kpa.iter().all(|p| p.is_nan()));
        assert_eq!(record.arrival, Arrival::Missing);
    }

    #[test]
    fn a_record_stays_small_enough_for_the_queue() {
        // 4,096 records (82 s) then stay below 2 MiB of locked memory.
        assert!(size_of::<TickRecord>() <= 512, "{}", size_of::<TickRecord>());
    }
}
