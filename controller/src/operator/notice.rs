//! Messages of the daemon to people: numbered notices, made in the tick without text, told outside it.

use flight::Event;
use handover::stage_now::LEVELS;
use handover::{Loss, PolicyEvent, PolicyTag, StageNow};
use model::observation::Pair;
use proto::recording::EventLevel;
use supervisor::Condition;

use crate::operator::fault_text::{vented, what_next};
use crate::operator::latched_conditions::LatchedConditions;

pub use crate::operator::fault_text::{fault_name, fault_text, why_barred};
pub use crate::session::attribution::MissCause;
pub use crate::session::link::Misplaced;

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
        /// Reason.
        cause: Condition,
        /// Tick.
        tick: u32,
        /// The number behind it: volts, kPa, ms, trip bits.
        value: f64,
    },
    /// The link is gone while the rig is vented for something worse.
    Disconnected {
        /// Condition that ended the link.
        cause: Condition,
        /// Tick.
        tick: u32,
    },
    /// Venting is still in doubt.
    StillFaulted {
        /// Reason.
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
        /// Reason.
        condition: Condition,
        /// Tick.
        tick: u32,
        /// The number behind it.
        value: f64,
    },
    /// The fallback took over from the policy.
    Reverted {
        /// Reason.
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
    /// A person acknowledged, and something is still wrong.
    StillHolds {
        /// The worst of it.
        condition: Condition,
        /// Tick.
        tick: u32,
        /// The number behind it.
        value: f64,
        /// Conditions that no longer wait.
        released: LatchedConditions,
    },
    /// Frames came too seldom.
    FramesScarce {
        /// Tick.
        tick: u32,
        /// Missing frames of the last hundred.
        missing: u32,
    },
    /// It does not arm by itself, for nothing would be recorded.
    NotRecorded {
        /// Tick.
        tick: u32,
    },
    /// The cause of the venting is over.
    Recovered {
        /// Tick.
        tick: u32,
    },
    /// A single frame was lost or late; the plan was followed.
    FrameMissed {
        /// Tick.
        tick: u32,
        /// Lateness by then, in ms.
        late_ms: f64,
    },
    /// The command left late.
    DeadlineMissed {
        /// Tick.
        tick: u32,
        /// Time from the expected frame to the command, in ms.
        took_ms: f64,
        /// Cause that it is put down to.
        cause: MissCause,
    },
    /// A frame was damaged and dropped.
    FrameDamaged {
        /// Number since the session began.
        count: u64,
    },
    /// A sound frame came that has no place in the session, and was dropped.
    FrameMisplaced {
        /// Number of frames dropped since the session began.
        count: u64,
        /// Kind of frame that it was.
        what: Misplaced,
    },
    /// Something happened to a policy.
    Policy {
        /// Tick.
        tick: u32,
        /// The event.
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
    /// The program is told to end.
    Stopped {
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
            Notice::StillHolds { condition, tick, value, released } => {
                (16, [f64::from(tick), f64::from(condition.code()), value, released.to_number()])
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
            Notice::Stopped { tick } => (32, [f64::from(tick), 0.0, 0.0, 0.0]),
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
        StageNow::Recheck => "recheck, no authority while the incumbent is measured anew".to_owned(),
        StageNow::Retrial => {
            "retrial: it erred more than what it is to replace, which is measured anew before that is held against it"
                .to_owned()
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

/// One plain sentence for an event of a run that is one session: nothing is connected again.
pub fn sentence_of_one_session(event: &Event) -> String {
    let [tick, value, ..] = event.values;
    match event.code {
        code @ 101..=199 => format!("{} at tick {tick:.0}: {}", vented(code - 100), fault_text(code - 100, value)),
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
        3 => format!("disarmed {at}; both vents are commanded open"),
        4 => format!("sound again {at}; standing by with both vents open, ready to be armed"),
        5 => format!("frame {a:.0} did not come ({b:.1} ms late); following the plan for one tick"),
        6 => format!(
            "deadline missed {at}: the command left {b:.1} ms after its frame was due ({})",
            MissCause::text(c as u8)
        ),
        7 => format!("a frame came damaged and was dropped ({a:.0} in this session)"),
        31 => format!("the cRIO sent {}; it was dropped ({a:.0} in this session)", Misplaced::text([b, c])),
        8 | 21..=25 => policy_sentence(event),
        9 => format!("the run is over {at}; both vents are commanded open"),
        32 => format!("stopping {at}; both vents are commanded open"),
        20 => format!(
            "the safety filter acts {at}: duties {b:.3} and {c:.3} would have left the envelope and were bent toward vent"
        ),
        10 => format!("the last row was played {at}; both vents are commanded open"),
        26 => {
            format!("an experiment of {b:.0} rows begins after tick {a:.0}; vents open until the pressures stand still")
        }
        28 => format!(
            "exploring {at}: noise of {c:.4}/{d:.4} of duty (standard deviation) on the policy's answers, seed {b:.0}"
        ),
        29 => format!("exploration is off {at}"),
        27 => format!("at rest; the first row is played {at}"),
        11 => format!("holding {at}: {}", fault_text(b as u16, c)),
        13 => format!("the fallback alone controls from tick {a:.0} on: {}", fault_text(b as u16, c)),
        14 => format!("the policy controls again {at}"),
        15 => format!("acknowledged {at}; arm when you are ready"),
        16 => match LatchedConditions::from_number(d) {
            LatchedConditions::NONE => format!("acknowledged {at}, but it still holds: {}", fault_text(b as u16, c)),
            released => {
                let (released, holds) = (released.names(), fault_text(b as u16, c));
                format!("acknowledged {at}: {released}; still waits, for it still holds: {holds}")
            }
        },
        17 => format!("frames are scarce {at}: {}", fault_text(Condition::FramesScarce.code(), b)),
        30 => format!("not armed by itself {at}: {}", fault_text(Condition::NotRecorded.code(), 0.0)),
        18 => format!("the session ended {at}: {}; the rig stays vented", fault_name(b as u16)),
        code @ 101..=199 => {
            let fault = code - 100;
            format!("{} {at}: {}{}", vented(fault), fault_text(fault, b), what_next(fault))
        }
        code @ 301..=399 => format!(
            "STILL A FAULT after {b:.0} s {at}: {}; {c:.1}/{d:.1} kPa with both vents commanded open; switch the pump off by hand",
            fault_name(code - 300)
        ),
        code => format!("event {code} {:?}", event.values),
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

    #[test]
    fn an_acknowledgement_that_released_something_says_what() {
        let line = |released| {
            let condition = Condition::SensorNegative;
            sentence(&Notice::StillHolds { condition, tick: 7, value: 0.5, released }.event(0))
        };
        let released = line(LatchedConditions::of([Condition::CrioTripped]));
        assert!(released.contains("tick 7: cRIO tripped; still waits") && released.contains("0.5"), "{released}");
        assert!(line(LatchedConditions::NONE).contains("but it still holds: "));
    }
}
