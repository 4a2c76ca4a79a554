//! What the daemon tells a person: numbered notices, made in the tick without text, told outside it.

use flight::Event;
use handover::stages::LEVELS;
use handover::{Loss, PolicyEvent, PolicyTag, StageNow};
use model::observation::Pair;
use proto::recording::EventLevel;
use proto::wire::TripBits;

/// Why the rig was vented.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u16)]
pub enum Cause {
    /// Frames stopped coming.
    FramesMissing = 1,
    /// A sensor's voltage is out of range or not a number; 0 positive, 1 negative.
    SensorPositive = 2,
    /// As above, negative sensor.
    SensorNegative = 3,
    /// Positive pressure above its limit.
    OverPressure = 4,
    /// Negative pressure below its limit.
    OverVacuum = 5,
    /// The cRIO tripped by itself.
    CrioTripped = 6,
    /// The link is gone.
    LinkLost = 7,
    /// The law's answer was not a number.
    LawNotFinite = 8,
    /// The cRIO vented because our commands did not reach it in time.
    CommandsLost = 9,
}

impl Cause {
    /// Whether the rig may be armed again by itself (with `auto_arm`) once this is over: only what has to
    /// do with the link, never what has to do with pressure or sensors.
    pub fn clears_by_itself(self) -> bool {
        matches!(self, Cause::FramesMissing | Cause::LinkLost | Cause::CommandsLost)
    }
}

/// Something that happened in the tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Notice {
    /// A session was opened.
    SessionOpened {
        /// The session.
        session: u32,
    },
    /// The rig was armed.
    Armed {
        /// Tick.
        tick: u32,
        /// By itself.
        auto: bool,
    },
    /// The rig was disarmed by the operator.
    Disarmed {
        /// Tick.
        tick: u32,
    },
    /// The rig was vented.
    Vented {
        /// Why.
        cause: Cause,
        /// Tick.
        tick: u32,
        /// The number behind it: volts, kPa, ms, trip bits.
        value: f64,
    },
    /// What caused the venting is over.
    Recovered {
        /// Tick.
        tick: u32,
    },
    /// A single frame was lost or late; the plan was followed.
    FrameMissed {
        /// Tick.
        tick: u32,
        /// How late it was by then, in ms.
        late_ms: f64,
    },
    /// The command left late.
    DeadlineMissed {
        /// Tick.
        tick: u32,
        /// Time from the expected frame to the command, in ms.
        took_ms: f64,
    },
    /// A frame was damaged and dropped.
    FrameDamaged {
        /// How many since the session began.
        count: u64,
    },
    /// Something happened to a policy.
    Policy {
        /// Tick.
        tick: u32,
        /// What.
        event: PolicyEvent,
    },
    /// The safety filter bent a command toward vent, for the first time in a second.
    Filtered {
        /// Tick.
        tick: u32,
        /// Duties that were asked for.
        asked: Pair,
        /// Measured pressures, kPa gauge.
        measured: Pair,
    },
    /// The last row of a sequence was played.
    Played {
        /// Tick.
        tick: u32,
    },
    /// The flight reached its end.
    FlightOver {
        /// Tick.
        tick: u32,
    },
}

impl Notice {
    /// The notice as the recorder's queue carries it.
    pub fn event(self, at_ns: u64) -> Event {
        let (code, values) = match self {
            Notice::SessionOpened { session } => (1, [f64::from(session), 0.0, 0.0, 0.0]),
            Notice::Armed { tick, auto } => (2, [f64::from(tick), f64::from(u8::from(auto)), 0.0, 0.0]),
            Notice::Disarmed { tick } => (3, [f64::from(tick), 0.0, 0.0, 0.0]),
            Notice::Vented { cause, tick, value } => (100 + cause as u16, [f64::from(tick), value, 0.0, 0.0]),
            Notice::Recovered { tick } => (4, [f64::from(tick), 0.0, 0.0, 0.0]),
            Notice::FrameMissed { tick, late_ms } => (5, [f64::from(tick), late_ms, 0.0, 0.0]),
            Notice::DeadlineMissed { tick, took_ms } => (6, [f64::from(tick), took_ms, 0.0, 0.0]),
            Notice::FrameDamaged { count } => (7, [count as f64, 0.0, 0.0, 0.0]),
            Notice::Policy { tick, event } => policy_numbers(tick, event),
            Notice::Filtered { tick, asked, measured } => (20, [f64::from(tick), asked[0], asked[1], measured[0]]),
            Notice::Played { tick } => (10, [f64::from(tick), 0.0, 0.0, 0.0]),
            Notice::FlightOver { tick } => (9, [f64::from(tick), 0.0, 0.0, 0.0]),
        };
        let level = match code {
            100.. => EventLevel::Error,
            5..=8 | 20 | 24 => EventLevel::Warning,
            _ => EventLevel::Info,
        };
        Event { at_ns, level, part: "tick", code, values }
    }
}

/// Code and numbers of what happened to a policy: tick, upper half of its hash, stage, reason.
fn policy_numbers(tick: u32, event: PolicyEvent) -> (u16, [f64; 4]) {
    let numbers =
        |tag: PolicyTag, stage: u8, loss: f64| [f64::from(tick), f64::from(tag.short()), f64::from(stage), loss];
    match event {
        PolicyEvent::Refused(tag) => (8, numbers(tag, 0, 0.0)),
        PolicyEvent::Taken(tag) => (21, numbers(tag, 0, 0.0)),
        PolicyEvent::Passed(tag, stage) => (22, numbers(tag, stage, 0.0)),
        PolicyEvent::Active(tag) => (23, numbers(tag, 0, 0.0)),
        PolicyEvent::Lost(tag, stage, loss) => (24, numbers(tag, stage, f64::from(loss as u8))),
        PolicyEvent::NothingBefore => (25, numbers(PolicyTag::FALLBACK, 0, 0.0)),
    }
}

fn policy_sentence(event: &Event) -> String {
    let [tick, hash, stage, loss] = event.values;
    let name = if hash == 0.0 { "the fallback".to_owned() } else { format!("policy {:08x}", hash as u32) };
    let at = format!("at tick {tick:.0}");
    let stage = match StageNow::of_code(stage as u8) {
        StageNow::Shadow => "shadow".to_owned(),
        StageNow::Ramp(level) => {
            format!("ramp, {:.0} % authority", 100.0 * LEVELS.get(level).copied().unwrap_or(1.0))
        }
        StageNow::Probation => "probation, full authority".to_owned(),
    };
    match event.code {
        8 => format!("{name} refused to answer {at}; the fallback decides from this tick on"),
        21 => format!("{name} is a candidate from tick {tick:.0} on"),
        22 => format!("{name} goes on to {stage} {at}"),
        23 => format!("{name} is active {at}"),
        24 => match Loss::of_code(loss as u8) {
            Some(Loss::Withdrawn) => format!("{name} is withdrawn {at}"),
            loss => format!("{name} lost its authority {at} ({stage}): {}", loss.map_or("unknown", Loss::reason)),
        },
        _ => format!("there is no policy to go back to ({at})"),
    }
}

/// What a recorded fault is called.
pub fn fault_name(code: u16) -> &'static str {
    match code {
        1 => "frames missing",
        2 => "positive sensor broken",
        3 => "negative sensor broken",
        4 => "over-pressure",
        5 => "over-vacuum",
        6 => "cRIO tripped",
        7 => "link lost",
        8 => "control law not finite",
        9 => "commands lost",
        _ => "unknown fault",
    }
}

/// A fault with the number behind it, and where to look.
pub fn fault_text(code: u16, value: f64) -> String {
    match code {
        1 => format!("no frame for {value:.0} ms"),
        2 => format!("the positive sensor reads {value:.3} V, outside 0.8 … 5.2 V; check sensor and wire"),
        3 => format!("the negative sensor reads {value:.3} V, outside 0.8 … 5.2 V; check sensor and wire"),
        4 => format!("positive pressure {value:.1} kPa is above safety.max_pos_kpa"),
        5 => format!("negative pressure {value:.1} kPa is below safety.min_neg_kpa"),
        6 => format!("the cRIO tripped ({})", TripBits::from_bits(value as u8)),
        7 => "the link to the cRIO is lost".to_owned(),
        8 => "the control law gave no finite duty".to_owned(),
        9 => "the cRIO got no command in time and vented by itself".to_owned(),
        _ => fault_name(code).to_owned(),
    }
}

/// One plain sentence for an event of a flight that is one session: nothing is connected again.
pub fn sentence_of_one_session(event: &Event) -> String {
    let [tick, value, ..] = event.values;
    match event.code {
        code @ 101..=109 => format!("VENTED at tick {tick:.0}: {}", fault_text(code - 100, value)),
        2 => format!("at rest; the first row is played at tick {tick:.0}"),
        _ => sentence(event),
    }
}

/// One plain sentence for an event made by [`Notice::event`].
pub fn sentence(event: &Event) -> String {
    let [a, b, ..] = event.values;
    let at = format!("at tick {a:.0}");
    match event.code {
        1 => format!("session {:08X} opened", a as u32),
        2 if b > 0.0 => format!("armed by itself {at} (control.auto_arm)"),
        2 => format!("armed {at}"),
        3 => format!("disarmed {at}; both vents open"),
        4 => format!("sound again {at}; standing by, vents open"),
        5 => format!("frame {a:.0} did not come ({b:.1} ms late); following the plan for one tick"),
        6 => format!("deadline missed {at}: the command left {b:.1} ms after its frame was due"),
        7 => format!("a frame came damaged and was dropped ({a:.0} in this session)"),
        8 | 21..=25 => policy_sentence(event),
        9 => format!("the run is over {at}; vents open"),
        20 => {
            let [_, pos, neg, _] = event.values;
            format!(
                "the safety filter acts {at}: duties {pos:.3} and {neg:.3} would have left the envelope and were bent toward vent"
            )
        }
        10 => format!("the last row was played {at}; both vents open"),
        code @ 101..=109 => {
            let next = match code - 100 {
                1 => "; waiting for the cRIO",
                6 | 9 => "; a new session will be opened",
                7 => "; connecting again",
                _ => "",
            };
            format!("VENTED {at}: {}{next}", fault_text(code - 100, b))
        }
        code => format!("event {code} {:?}", event.values),
    }
}
