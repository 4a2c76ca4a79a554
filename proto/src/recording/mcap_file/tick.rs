//! Record that one 50 Hz tick of the daemon leaves behind: a plain, fixed-size record.
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
/// Numbers of a policy's answer that are its plan for later ticks.
pub const PLANNED_OUTPUTS: usize = POLICY_OUTPUTS - 2;
/// Numbers that a policy answers: a pair of duties or corrections for now and each of the next five ticks.
pub const POLICY_OUTPUTS: usize = model::observation::ACTION_LEN;

/// Arrival of the SENSE frame of a tick.
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
    /// Feed-forward from the rig's steady map, backlash and correction included, or the policy's output where a
    /// policy decides alone (duty).
    pub feed_forward: f64,
    /// Share of `feed_forward` that undoes the valve's backlash (duty).
    pub backlash: f64,
    /// Share of `feed_forward` that a policy adds to the fallback (duty).
    pub correction: f64,
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
    /// Arrival of the SENSE frame.
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
    /// True where the pump was asked to run.
    pub pump_on: bool,

    /// Mode of the COMMAND: 0 vent, 1 run, 2 hold.
    pub mode: u8,
    /// The daemon's state; the codes are the daemon's own.
    pub state: u8,
    /// The daemon's fault, 0 for none; the codes are the daemon's own.
    pub fault: u16,

    /// Time by which the frame came later than expected; negative when early (ns).
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

    /// Conditions that the tick found: bit n stands for the one of code n; 0 is none.
    pub findings: u64,
    /// Inputs that reached the tick before it began: codes of four bits, the first in the lowest, 0 after the last
    /// ([`TickInput`]).
    pub inputs: u32,
    /// Hash of what the policy was shown ([`observation_hash`]); 0 where none was asked.
    pub observation_hash: u64,
    /// The policy's whole answer, the plan for the next five ticks included, in its own order; NaN where none answered.
    pub policy_output: [f32; POLICY_OUTPUTS],
    /// Stage of admission of the policy that answered; the codes are the daemon's own, 0 is none.
    pub policy_stage: u8,
    /// Share of its answer that counts, 0 … 1.
    pub authority: f64,
    /// Number of the change of policy or model that is in force, 0 for what the run began with.
    pub swap_id: u32,
    /// Duties before the safety filter, positive and negative valve; NaN where nothing was filtered.
    pub command_before_filter: [f64; 2],
    /// True when the safety filter bent the command.
    pub filter_active: bool,
    /// Phase of the experiment under way: 0 none, 1 waiting for rest, 2 playing its rows, 3 coming to rest after them.
    pub experiment: u8,
    /// Share of the positive valve's duty that exploration added, before the safety filter (duty).
    pub exploration_pos: f64,
    /// Share of the negative valve's duty that exploration added, before the safety filter (duty).
    pub exploration_neg: f64,
    /// Addition of exploration to the plan, in the order of `policy_output` behind its first two (duty); it moves what MPObs
    /// foresees, and no valve.
    pub exploration_plan: [f32; PLANNED_OUTPUTS],
}

/// Inputs of the control law beside frames, as [`TickRecord::inputs`] counts it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum TickInput {
    /// The operator arms.
    Arm = 1,
    /// The operator disarms.
    Disarm = 2,
    /// Another reference is followed.
    Reference = 3,
    /// A person acknowledges a latched cause.
    Acknowledge = 4,
    /// Another policy takes part.
    Policy = 5,
    /// Another model is behind the predictions.
    Model = 6,
    /// Exploration is switched on or off.
    Explore = 7,
    /// The link was lost before this tick.
    LinkLost = 8,
    /// A session was opened before this tick.
    SessionOpened = 9,
    /// An experiment begins.
    Experiment = 10,
    /// Anything else that decides and has no code of its own; a replay stops here and says so.
    Other = 15,
}

impl TickInput {
    /// All of them.
    pub const ALL: [Self; 11] = [
        Self::Arm,
        Self::Disarm,
        Self::Reference,
        Self::Acknowledge,
        Self::Policy,
        Self::Model,
        Self::Explore,
        Self::LinkLost,
        Self::SessionOpened,
        Self::Experiment,
        Self::Other,
    ];

    /// Appends an input to those of a tick; the ninth and later ones are not kept, and the eighth says so
    /// ([`TickInput::is_overfull`]). A request that would change nothing, being the last one again, takes no room.
    ///
    /// # Real-time
    /// May run in the tick.
    pub const fn append(self, inputs: &mut u32) {
        let filled = (u32::BITS - inputs.leading_zeros()).div_ceil(4);
        let repeats = filled > 0 && *inputs >> (4 * (filled - 1)) == self as u32;
        if repeats && matches!(self, Self::Arm | Self::Disarm | Self::Acknowledge | Self::Explore) {
            return;
        }
        if filled < 8 {
            *inputs |= (self as u32) << (4 * filled);
        } else {
            *inputs |= (Self::Other as u32) << 28;
        }
    }

    /// Tells whether more reached a tick than its record holds.
    pub const fn is_overfull(inputs: u32) -> bool {
        inputs >> 28 == Self::Other as u32
    }

    /// The inputs of a tick, in their order; codes of a later version come out as [`TickInput::Other`].
    pub fn of(inputs: u32) -> impl Iterator<Item = Self> {
        (0..8).map(move |at| inputs >> (4 * at) & 15).take_while(|code| *code != 0).map(|code| {
            let known = Self::ALL.into_iter().find(|input| *input as u32 == code);
            known.unwrap_or(Self::Other)
        })
    }
}

/// Hash of what a policy was shown: FNV-1a of 64 bits (Fowler, Noll, Vo) over the numbers' bits, 0 taken as 1.
///
/// # Real-time
/// May run in the tick: a multiplication per number.
pub fn observation_hash(observation: &[f32]) -> u64 {
    crate::fnv1a::fnv1a(observation.iter().map(|value| u64::from(value.to_bits()))).max(1)
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
            findings: 0,
            inputs: 0,
            observation_hash: 0,
            policy_output: [f32::NAN; POLICY_OUTPUTS],
            policy_stage: 0,
            authority: 0.0,
            swap_id: 0,
            command_before_filter: [f64::NAN; 2],
            filter_active: false,
            experiment: 0,
            exploration_pos: 0.0,
            exploration_neg: 0.0,
            exploration_plan: [0.0; PLANNED_OUTPUTS],
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
        // 4,096 records (82 s) then stay below 3 MiB of locked memory.
        assert!(size_of::<TickRecord>() <= 768, "{}", size_of::<TickRecord>());
    }

    #[test]
    fn inputs_come_back_in_their_order_and_too_many_are_no_secret() {
        let mut inputs = 0;
        for input in [TickInput::SessionOpened, TickInput::Arm, TickInput::Disarm, TickInput::Arm] {
            input.append(&mut inputs);
        }
        let back: Vec<TickInput> = TickInput::of(inputs).collect();
        assert_eq!(back, [TickInput::SessionOpened, TickInput::Arm, TickInput::Disarm, TickInput::Arm]);
        (0..4).for_each(|_| TickInput::Reference.append(&mut inputs));
        assert_eq!(TickInput::of(inputs).count(), 8);
        assert!(!TickInput::is_overfull(inputs));
        TickInput::Disarm.append(&mut inputs);
        assert_eq!(TickInput::of(inputs).count(), 8);
        assert_eq!(TickInput::of(inputs).last(), Some(TickInput::Other));
        assert!(TickInput::is_overfull(inputs));
    }

    /// Pressed again and again while the link is away, a key leaves room for what follows.
    #[test]
    fn a_request_that_repeats_the_last_one_takes_no_room() {
        use TickInput::{Acknowledge, Disarm, LinkLost, Reference, SessionOpened};
        let mut inputs = 0;
        LinkLost.append(&mut inputs);
        (0..20).for_each(|_| Disarm.append(&mut inputs));
        (0..20).for_each(|_| Acknowledge.append(&mut inputs));
        // Each of these has a file of its own inside the recording.
        (0..2).for_each(|_| Reference.append(&mut inputs));
        SessionOpened.append(&mut inputs);
        let back: Vec<TickInput> = TickInput::of(inputs).collect();
        assert_eq!(back, [LinkLost, Disarm, Acknowledge, Reference, Reference, SessionOpened]);
    }

    #[test]
    fn the_hash_of_an_observation_is_fnv_1a_and_sees_every_bit() {
        // Worked by hand for one number, 0.0: the offset times the prime.
        assert_eq!(observation_hash(&[0.0]), 0xcbf2_9ce4_8422_2325_u64.wrapping_mul(0x0000_0100_0000_01b3));
        assert_ne!(observation_hash(&[0.0, 1.0]), observation_hash(&[1.0, 0.0]));
        assert_ne!(observation_hash(&[0.0]), observation_hash(&[-0.0]));
    }
}
