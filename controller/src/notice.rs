//! What the daemon tells a person: numbered notices, made in the tick without text, told outside it.

use flight::Event;
use handover::stages::LEVELS;
use handover::{Loss, PolicyEvent, PolicyTag, StageNow};
use model::observation::Pair;
use proto::recording::EventLevel;
use proto::wire::TripBits;
use supervisor::Condition;

pub use crate::attribution::MissCause;
pub use crate::link::Misplaced;

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
        cause: Condition,
        /// Tick.
        tick: u32,
        /// The number behind it: volts, kPa, ms, trip bits.
        value: f64,
    },
    /// The link is gone while the rig is vented for something worse.
    Disconnected {
        /// What ended the link.
        cause: Condition,
        /// Tick.
        tick: u32,
    },
    /// Venting is still in doubt.
    StillFaulted {
        /// Why.
        cause: Condition,
        /// Tick.
        tick: u32,
        /// For so long, in s.
        seconds: f64,
        /// Pressures now, kPa gauge.
        measured_kpa: [f64; 2],
    },
    /// HOLD began: the plan goes on with integrators still.
    Held {
        /// Why.
        condition: Condition,
        /// Tick.
        tick: u32,
        /// The number behind it.
        value: f64,
    },
    /// The fallback took over from the policy.
    Reverted {
        /// Why.
        condition: Condition,
        /// Tick.
        tick: u32,
        /// The number behind it.
        value: f64,
    },
    /// The policy controls again.
    Returned {
        /// Tick.
        tick: u32,
    },
    /// A person acknowledged what was wrong.
    Acknowledged {
        /// Tick.
        tick: u32,
    },
    /// A person acknowledged, and it is still wrong.
    StillHolds {
        /// What.
        condition: Condition,
        /// Tick.
        tick: u32,
        /// The number behind it.
        value: f64,
    },
    /// Frames came too seldom.
    FramesScarce {
        /// Tick.
        tick: u32,
        /// Of the last hundred.
        missing: u32,
    },
    /// It does not arm by itself, for nothing would be recorded.
    NotRecorded {
        /// Tick.
        tick: u32,
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
        /// What it is put down to.
        cause: MissCause,
    },
    /// A frame was damaged and dropped.
    FrameDamaged {
        /// How many since the session began.
        count: u64,
    },
    /// A sound frame came that has no place in the session, and was dropped.
    FrameMisplaced {
        /// How many frames were dropped since the session began.
        count: u64,
        /// Which it was.
        what: Misplaced,
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
    /// An experiment begins: vents open, pump off, until the pressures stand still.
    ExperimentBegins {
        /// Tick before it.
        tick: u32,
        /// Rows that it has.
        rows: u32,
    },
    /// The rig stands at rest, and the first row of a sequence is played.
    FirstRow {
        /// Tick.
        tick: u32,
    },
    /// Noise is added to the active policy's answers from now on.
    Exploring {
        /// Tick.
        tick: u32,
        /// Seed of the noise.
        seed: u32,
        /// Standard deviations, duty.
        std_duty: Pair,
    },
    /// Nothing is added any more.
    ExplorationOver {
        /// Tick.
        tick: u32,
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
            Notice::Vented { cause, tick, value } => (100 + cause.code(), [f64::from(tick), value, 0.0, 0.0]),
            Notice::Disconnected { cause, tick } => (18, [f64::from(tick), f64::from(cause.code()), 0.0, 0.0]),
            Notice::StillFaulted { cause, tick, seconds, measured_kpa: [pos, neg] } => {
                (300 + cause.code(), [f64::from(tick), seconds, pos, neg])
            }
            Notice::Held { condition, tick, value } => (11, [f64::from(tick), f64::from(condition.code()), value, 0.0]),
            Notice::Reverted { condition, tick, value } => {
                (13, [f64::from(tick), f64::from(condition.code()), value, 0.0])
            }
            Notice::Returned { tick } => (14, [f64::from(tick), 0.0, 0.0, 0.0]),
            Notice::Acknowledged { tick } => (15, [f64::from(tick), 0.0, 0.0, 0.0]),
            Notice::StillHolds { condition, tick, value } => {
                (16, [f64::from(tick), f64::from(condition.code()), value, 0.0])
            }
            Notice::FramesScarce { tick, missing } => (17, [f64::from(tick), f64::from(missing), 0.0, 0.0]),
            Notice::NotRecorded { tick } => (30, [f64::from(tick), 0.0, 0.0, 0.0]),
            Notice::Recovered { tick } => (4, [f64::from(tick), 0.0, 0.0, 0.0]),
            Notice::FrameMissed { tick, late_ms } => (5, [f64::from(tick), late_ms, 0.0, 0.0]),
            Notice::DeadlineMissed { tick, took_ms, cause } => {
                (6, [f64::from(tick), took_ms, f64::from(cause as u8), 0.0])
            }
            Notice::FrameDamaged { count } => (7, [count as f64, 0.0, 0.0, 0.0]),
            Notice::FrameMisplaced { count, what } => {
                let [code, number] = what.numbers();
                (31, [count as f64, code, number, 0.0])
            }
            Notice::Policy { tick, event } => policy_numbers(tick, event),
            Notice::Filtered { tick, asked, measured } => (20, [f64::from(tick), asked[0], asked[1], measured[0]]),
            Notice::ExperimentBegins { tick, rows } => (26, [f64::from(tick), f64::from(rows), 0.0, 0.0]),
            Notice::FirstRow { tick } => (27, [f64::from(tick), 0.0, 0.0, 0.0]),
            Notice::Exploring { tick, seed, std_duty: [pos, neg] } => {
                (28, [f64::from(tick), f64::from(seed), pos, neg])
            }
            Notice::ExplorationOver { tick } => (29, [f64::from(tick), 0.0, 0.0, 0.0]),
            Notice::Played { tick } => (10, [f64::from(tick), 0.0, 0.0, 0.0]),
            Notice::FlightOver { tick } => (9, [f64::from(tick), 0.0, 0.0, 0.0]),
        };
        let level = match code {
            100.. => EventLevel::Error,
            5..=8 | 11 | 13 | 16 | 17 | 20 | 24 | 30 | 31 => EventLevel::Warning,
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
    Condition::from_code(code).map_or("unknown fault", Condition::name)
}

/// A fault with the number behind it, and where to look.
pub fn fault_text(code: u16, value: f64) -> String {
    use Condition as C;
    let Some(condition) = Condition::from_code(code) else { return fault_name(code).to_owned() };
    match condition {
        C::FramesScarce => {
            format!("{value:.0} of the last 100 frames did not come in time; look at the link and its load")
        }
        C::NotRealtime => "real-time rights are missing, and realtime.enforce = true asks for them".to_owned(),
        C::NotRecorded => {
            "nothing would be recorded; `controller status` says what is wrong with the recording".to_owned()
        }
        C::FrameMissing | C::FramesMissing => format!("no frame for {value:.0} ms"),
        C::FrameImplausible => format!("a frame's numbering cannot be right ({value:.0})"),
        C::DeadlineMissed => format!("a command left {value:.1} ms after its frame was due"),
        C::ReadingSuspect => format!("a reading jumped {value:+.1} kPa away from what the model foresaw"),
        C::TrackingPoor => format!("a pressure stays {value:+.1} kPa away from its reference"),
        C::PolicyRefused => "the policy gave no usable answer".to_owned(),
        C::FramesLost => format!("{value:.0} of the last 100 frames did not come in time, more than 25"),
        C::CommandsScarce => {
            format!("by its own count the cRIO did not get {value:.0} of the last 100 commands in time, more than 25")
        }
        C::DeadlinesMissed => format!("deadlines missed: {value:.0} of the last 100, or three in a row"),
        C::CommandsLost => "the cRIO got no command in time and vented by itself".to_owned(),
        C::ClockImplausible => format!(
            "the frames' sequence number, clock or tick does not go on as time does ({value:.0}); look at the cRIO's program"
        ),
        C::FramesDamaged => {
            format!("{value:.0} of the last 100 frames had a wrong CRC or no place in the session; the link is closed")
        }
        C::LinkFlooded => format!("{value:.0} bytes came in one tick; a cRIO sends 64; the link is closed"),
        C::StreamBroken => format!(
            "the byte stream is broken: a frame began with wrong magic, type or length (0x{:08X}); the link is closed",
            value as u32
        ),
        C::VersionWrong => {
            format!("a frame of protocol version {value:.0} came, this program speaks 1; the link is closed")
        }
        C::NotRead => "the cRIO no longer reads what is sent to it; the link is closed".to_owned(),
        C::PeerLeft => "the cRIO said BYE".to_owned(),
        C::LinkLost => "the link to the cRIO is lost".to_owned(),
        C::SampleRate => {
            format!("the cRIO does not sample at 50 Hz (its period now makes {value:.1} Hz); set its loop to 20 ms")
        }
        C::LawNotFinite => "the control law gave no finite duty".to_owned(),
        C::CommandNotInForce => format!(
            "the cRIO reports command {value:.0} in force, which is none of the last; does it apply what it receives?"
        ),
        C::EchoWrong => format!("the cRIO reports a duty of {value:.3} that was not commanded; look at its outputs"),
        C::CrioIdle => format!("the cRIO reports state {value:.0} although it is told to run"),
        C::PumpOff => "the cRIO reports the pump off although it is switched on; look at relay and supply".to_owned(),
        C::Uncontrolled => {
            format!(
                "a pressure of {value:.1} kPa stays beyond its reference with the vent open; look at valve and hose"
            )
        }
        C::ModelPositive => format!("positive{}", against_the_model(value)),
        C::ModelNegative => format!("negative{}", against_the_model(value)),
        C::FrozenPositive => format!("the positive{}", frozen(value)),
        C::FrozenNegative => format!("the negative{}", frozen(value)),
        C::RangePositive => {
            format!("the positive sensor reads {value:.1} kPa, which no positive chamber has; check sensor and wire")
        }
        C::RangeNegative => {
            format!("the negative sensor reads {value:.1} kPa, which no negative chamber has; check sensor and wire")
        }
        C::SensorPositive => {
            format!("the positive sensor reads {value:.3} V, outside 0.8 … 5.2 V; check sensor and wire")
        }
        C::SensorNegative => {
            format!("the negative sensor reads {value:.3} V, outside 0.8 … 5.2 V; check sensor and wire")
        }
        C::TripBits => format!("the cRIO reports {} without having tripped", TripBits::from_bits(value as u8)),
        C::CrioTripped => format!("the cRIO tripped ({})", TripBits::from_bits(value as u8)),
        C::OverVacuum => format!("negative pressure {value:.1} kPa is below safety.min_neg_kpa"),
        C::OverPressure => format!("positive pressure {value:.1} kPa is above safety.max_pos_kpa"),
        C::VentNotEchoed => format!(
            "FAULT: both vents were commanded open and the cRIO reports a duty of {value:.3}; switch the pump off by hand"
        ),
        C::VentIneffective => format!(
            "FAULT: the vents are commanded open and {value:.1} kPa does not fall; valve, hose or sensor is stuck: switch the pump off by hand"
        ),
    }
}

fn against_the_model(kpa: f64) -> String {
    format!(" reading and model disagree by {kpa:+.1} kPa: a wrong sensor, a leak, a stuck valve or a burst hose")
}

fn frozen(ticks: f64) -> String {
    format!(" sensor's reading has not moved in a single bit for {ticks:.0} ticks; it is stuck")
}

/// One plain sentence for an event of a run that is one session: nothing is connected again.
pub fn sentence_of_one_session(event: &Event) -> String {
    let [tick, value, ..] = event.values;
    match event.code {
        code @ 101..=199 => format!("VENTED at tick {tick:.0}: {}", fault_text(code - 100, value)),
        _ => sentence(event),
    }
}

/// One plain sentence for an event made by [`Notice::event`].
pub fn sentence(event: &Event) -> String {
    let [a, b, c, d] = event.values;
    let at = format!("at tick {a:.0}");
    match event.code {
        1 => format!("session {:08X} opened", a as u32),
        2 if b > 0.0 => format!("armed by itself {at} (control.auto_arm)"),
        2 => format!("armed {at}"),
        3 => format!("disarmed {at}; both vents open"),
        4 => format!("sound again {at}; standing by, vents open"),
        5 => format!("frame {a:.0} did not come ({b:.1} ms late); following the plan for one tick"),
        6 => format!(
            "deadline missed {at}: the command left {b:.1} ms after its frame was due ({})",
            MissCause::text(c as u8)
        ),
        7 => format!("a frame came damaged and was dropped ({a:.0} in this session)"),
        31 => format!("the cRIO sent {}; it was dropped ({a:.0} in this session)", Misplaced::text([b, c])),
        8 | 21..=25 => policy_sentence(event),
        9 => format!("the run is over {at}; vents open"),
        20 => format!(
            "the safety filter acts {at}: duties {b:.3} and {c:.3} would have left the envelope and were bent toward vent"
        ),
        10 => format!("the last row was played {at}; both vents open"),
        26 => {
            format!("an experiment of {b:.0} rows begins after tick {a:.0}; vents open until the pressures stand still")
        }
        28 => format!(
            "exploring {at}: noise of {c:.4}/{d:.4} of duty (standard deviation) on the policy's answers, seed {b:.0}"
        ),
        29 => format!("exploration is off {at}"),
        27 => format!("at rest; the first row is played {at}"),
        11 => format!("holding {at}: {}", fault_text(b as u16, c)),
        13 => format!("the fallback took over {at}: {}", fault_text(b as u16, c)),
        14 => format!("the policy controls again {at}"),
        15 => format!("acknowledged {at}; arm when you are ready"),
        16 => format!("acknowledged {at}, but it still holds: {}", fault_text(b as u16, c)),
        17 => format!("{} {at}", fault_text(Condition::FramesScarce.code(), b)),
        30 => format!("not armed by itself {at}: {}", fault_text(Condition::NotRecorded.code(), 0.0)),
        18 => format!("the session ended {at}: {}; the rig stays vented", fault_name(b as u16)),
        code @ 101..=199 => {
            let fault = code - 100;
            format!("VENTED {at}: {}{}", fault_text(fault, b), what_next(fault))
        }
        code @ 301..=399 => format!(
            "STILL IN DOUBT after {b:.0} s {at}: {} at {c:.1}/{d:.1} kPa; switch the pump off by hand",
            fault_name(code - 300)
        ),
        code => format!("event {code} {:?}", event.values),
    }
}

/// What follows by itself, or what a person must do.
fn what_next(fault: u16) -> &'static str {
    match Condition::from_code(fault) {
        Some(
            Condition::FramesMissing | Condition::FramesLost | Condition::CommandsScarce | Condition::ClockImplausible,
        ) => "; waiting for the cRIO",
        Some(Condition::CommandsLost) => "; a new session will be opened",
        Some(
            Condition::LinkLost
            | Condition::PeerLeft
            | Condition::NotRead
            | Condition::FramesDamaged
            | Condition::LinkFlooded
            | Condition::StreamBroken
            | Condition::VersionWrong,
        ) => "; connecting again",
        Some(condition) if condition.latch() == supervisor::condition::Latch::UntilAcknowledged => {
            "; `controller acknowledge` once it is mended, then arm"
        }
        _ => "",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_condition_has_a_line_of_its_own() {
        let mut seen = std::collections::BTreeSet::new();
        for condition in Condition::ALL {
            let notice = Notice::Vented { cause: *condition, tick: 7, value: 3.0 };
            let line = sentence(&notice.event(0));
            assert!(line.contains("tick 7") && !line.contains('\n') && !line.contains("event "), "{line}");
            assert!(seen.insert(line.clone()) || *condition == Condition::FramesMissing, "twice: {line}");
        }
    }
}
