//! Text for people on each condition: the number behind it, where to look, and what follows.

use proto::wire::TripBits;
use supervisor::condition::Latch;
use supervisor::{Condition, Severity};

/// Name of a recorded fault.
pub fn fault_name(code: u16) -> &'static str {
    Condition::from_code(code).map_or("unknown fault", Condition::name)
}

/// Reason why a condition keeps the rig from being armed, in a clause: what a person may look at, without numbers.
pub fn why_barred(condition: Condition) -> String {
    match condition {
        Condition::NotRealtime => {
            let text = fault_text(condition.code(), 0.0);
            format!("{text}; the daemon's first lines name those that are, and `controller rt-test` what gives them")
        }
        Condition::NotRecorded => fault_text(condition.code(), 0.0),
        _ => condition.name().to_owned(),
    }
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
        C::SuspectPositive => format!("the positive reading jumped {value:+.1} kPa away from what the model foresaw"),
        C::SuspectNegative => format!("the negative reading jumped {value:+.1} kPa away from what the model foresaw"),
        C::TrackingPositive => format!("the positive pressure stays {value:+.1} kPa away from its reference"),
        C::TrackingNegative => format!("the negative pressure stays {value:+.1} kPa away from its reference"),
        C::FilterBusy => {
            format!("the safety filter had to bend {value:.0} of the last 50 commands toward vent, more than 20")
        }
        C::ModelDiverged => {
            "the model behind the predictions came to numbers that are none; look at the rig file".to_owned()
        }
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
            format!(
                "{value:.0} of the last 100 frames had a wrong CRC, an unknown code or no place in the session; the link is closed"
            )
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
        C::LinkLost => format!("the link to the cRIO is lost: {}", how_lost(value)),
        C::SampleRate => {
            format!("the cRIO does not sample at 50 Hz (its period now makes {value:.1} Hz); set its loop to 20 ms")
        }
        C::LawNotFinite => "the control law gave no finite duty".to_owned(),
        C::CommandNotInForce => format!(
            "the cRIO reports command {value:.0} in force, which is none of the last; look whether its program applies what it receives"
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
            "both vents were commanded open and the cRIO reports a duty of {value:.3}; switch the pump off by hand"
        ),
        C::VentIneffective => format!(
            "both vents were commanded open and a pressure stays at {value:.1} kPa: a valve, a hose or a sensor is stuck; switch the pump off by hand"
        ),
    }
}

/// Tells how a link was lost, by an error number of the system, 0 where the cRIO closed it, minus the seconds of a silence.
fn how_lost(value: f64) -> String {
    match value {
        silence if silence < 0.0 => format!("nothing has come for {:.0} s; look at cable, switch and cRIO", -silence),
        0.0 => "the cRIO closed it; look whether its program still runs".to_owned(),
        errno => std::io::Error::from_raw_os_error(errno as i32).to_string(),
    }
}

fn against_the_model(kpa: f64) -> String {
    format!(" reading and model disagree by {kpa:+.1} kPa: a wrong sensor, a leak, a stuck valve or a burst hose")
}

fn frozen(ticks: f64) -> String {
    format!(" sensor's reading has not moved in a single bit for {ticks:.0} ticks; it is stuck")
}

/// State of the rig: vented, or not even that is sure.
pub(crate) fn vented(fault: u16) -> &'static str {
    match Condition::from_code(fault).map(Condition::severity) {
        Some(Severity::Fault) => "FAULT",
        _ => "VENTED",
    }
}

/// Instruction: what follows by itself, or what a person must do.
pub(crate) fn what_next(fault: u16) -> &'static str {
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
        Some(condition) if condition.latch() == Latch::UntilAcknowledged => {
            "; `controller acknowledge` once it is fixed, then arm"
        }
        _ => "",
    }
}
