//! Disarm, and what can be said of the vents then: commanded, reported by the cRIO, or not known.
//!
//! A disarming is carried out by the next tick; that the vents are open is only known once the cRIO reports it, some ticks
//! later. So the answer waits for that report, for a fault of the venting, or for the end of its time.

use monitor::vent_check::OPEN_DUTY;
use proto::recording::EventLevel;

use super::answers::note_line;
use super::{Asked, Desk, Step, WITHDRAWN, What};
use crate::cycle::duty_source::VENT;
use crate::machine::clock::now_ns;
use crate::operator::mailbox::{Status, Stop};
use crate::operator::operator_protocol::{ECHO_TIME, EFFECT_TIME, Venting};
use crate::operator::peer::Peer;
use crate::state::State;

/// Progress of a disarming.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Disarming {
    /// No tick has taken it yet.
    Ordered,
    /// A tick had taken it by then, monotonic clock (ns); whatever is shown later follows it.
    Taken {
        /// Time at which that was seen.
        at_ns: u64,
    },
    /// A tick was shown that is not under control; the cRIO's report is waited for.
    Commanded,
}

/// Cause of a disarming.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum DisarmedBy {
    /// Somebody's order to disarm.
    Order(Peer),
    /// Somebody's order to arm, which failed: the rig must not begin to run later on.
    FailedArming(Peer),
}

/// As the subject of a sentence.
impl std::fmt::Display for DisarmedBy {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            DisarmedBy::Order(peer) => write!(f, "a disarming by {peer}"),
            DisarmedBy::FailedArming(peer) => write!(f, "an arming by {peer} that failed, and was disarmed,"),
        }
    }
}

impl Desk {
    pub(super) fn begin_disarming(&mut self, asked: Asked) -> Step {
        self.disarm(DisarmedBy::Order(asked.peer));
        asked.taking(EFFECT_TIME).pending(What::Disarm(Disarming::Ordered))
    }

    /// Disarms at the next tick; nothing that was asked for before it moves the rig any more.
    pub(super) fn disarm(&mut self, by: DisarmedBy) {
        self.options.mailbox.disarm();
        self.disarmed_by = Some(by);
    }

    /// The stop after which a request is not carried out any more, one line.
    pub(super) fn stopped(&self, stop: Stop) -> String {
        match (stop, self.disarmed_by) {
            (Stop::Disarmed, Some(by)) => format!("{by} came after it was asked for; ask again"),
            (Stop::Disarmed, None) => "a disarming came after it was asked for; ask again".to_owned(),
            (Stop::Vented(Some(condition)), _) => {
                format!("the rig was vented ({}) after it was asked for; look at it, then ask again", condition.name())
            }
            (Stop::Vented(None), _) => {
                "the rig was vented, or without a session, after it was asked for; look at it, then ask again"
                    .to_owned()
            }
        }
    }

    /// The stop that came after a request, one line; `None` where none did.
    pub(super) fn stopped_since(&self, asked: Asked) -> Option<String> {
        self.options.mailbox.stop_since(asked.since).map(|stop| self.stopped(stop))
    }

    /// Answer to a request that the mailbox says fell with a stop.
    pub(super) fn why_fell(&self, asked: Asked) -> String {
        self.stopped_since(asked).unwrap_or_else(|| WITHDRAWN.to_owned())
    }

    pub(super) fn look_at_disarming(&mut self, disarming: Disarming, asked: Asked) -> Step {
        let late = asked.is_late();
        let Some(live) = self.live_status().filter(|status| status.session != 0) else {
            // A session that was last shown may go on: this machine may only have stood still.
            let may_go_on = self.newest.is_some_and(|shown| shown.status.session != 0);
            return if may_go_on && !late {
                asked.pending(What::Disarm(disarming))
            } else {
                // Nothing is sent; the disarming stands for the next session.
                self.disarmed(Venting::Unknown, asked.peer)
            };
        };
        let disarming = match disarming {
            Disarming::Ordered if !self.options.mailbox.disarm_waits() => Disarming::Taken { at_ns: now_ns() },
            other => other,
        };
        let shown_ns = self.newest.map_or(0, |shown| shown.at_ns);
        let is_since = disarming != Disarming::Ordered && shown_ns > asked.at_ns;
        if let Some(venting) = venting(disarming, &live).filter(|_| is_since) {
            return self.disarmed(venting, asked.peer);
        }
        match disarming {
            Disarming::Taken { .. } if is_since && !live.state.is_controlling() => {
                asked.taking(ECHO_TIME).pending(What::Disarm(Disarming::Commanded))
            }
            _ if !late => asked.pending(What::Disarm(disarming)),
            Disarming::Commanded => self.disarmed(Venting::InDoubt, asked.peer),
            Disarming::Taken { at_ns } if shown_ns > at_ns => self.disarmed(Venting::ArmedAgain, asked.peer),
            Disarming::Taken { .. } | Disarming::Ordered => {
                let why = "it still runs; the disarming stands for the next tick".to_owned();
                self.over("disarm", asked.peer, Err(why))
            }
        }
    }

    /// Records and answers a disarming that was carried out, with what is known of the vents.
    fn disarmed(&mut self, venting: Venting, peer: Peer) -> Step {
        let status = self.live_status().unwrap_or_default();
        if venting != Venting::ArmedAgain {
            self.options.running.armed_by = None;
        }
        let no_session = self.last_data();
        let text = told(venting, &status, &no_session, self.options.running.armed_by.as_deref());
        match venting {
            Venting::Open => self.record("disarm", peer, &Ok(())),
            // It was carried out, and what was wanted by it is not known to be so.
            _ => note_line(&self.options.notes, EventLevel::Warning, &format!("disarm by {peer}: {text}")),
        }
        let mut reply = self.reply(Ok(()));
        (reply.done, reply.venting) = (Some(text), Some(venting));
        Step::Done(Box::new(reply))
    }
}

/// Finding on the vents of a tick after the disarming; `None` while it says nothing yet.
fn venting(disarming: Disarming, status: &Status) -> Option<Venting> {
    match status.state {
        State::Fault => Some(Venting::InDoubt),
        state if state.is_controlling() => (disarming == Disarming::Commanded).then_some(Venting::ArmedAgain),
        _ => reports_open(status).then_some(Venting::Open),
    }
}

fn reports_open(status: &Status) -> bool {
    status.duty == VENT
        && status.reported_duty.is_some_and(|duty| duty.iter().all(|duty| *duty >= f64::from(OPEN_DUTY)))
}

/// Answer to a person about the vents, in one line: what is commanded, what is reported, the pressures, and what follows.
fn told(venting: Venting, status: &Status, no_session: &str, armed_by: Option<&str>) -> String {
    let pressures = match status.pressures_kpa {
        Some([pos, neg]) => format!("{pos:.2}/{neg:.2} kPa now"),
        None => "no sound reading of the pressures".to_owned(),
    };
    let reported = match status.reported_duty {
        Some([pos, neg]) => format!("the cRIO reports duties of {pos:.3}/{neg:.3}, and 1 is open"),
        None => "the cRIO reports nothing of them".to_owned(),
    };
    let waits = if status.waiting.is_empty() {
        String::new()
    } else {
        format!("; {} for `controller acknowledge`", status.waiting.wait())
    };
    match venting {
        Venting::Open => format!(
            "disarmed: both vents are commanded open, and the cRIO reports them open; {pressures}, and that they fall is watched{waits}"
        ),
        Venting::InDoubt => {
            let why = match status.fault.filter(|_| status.state.is_vented()) {
                Some(condition) => format!(" ({})", condition.name()),
                None => String::new(),
            };
            format!(
                "disarmed, and the venting is in doubt{why}: both vents are commanded open, {reported}; {pressures}; switch the pump off by hand, and look at valves, hoses and sensors{waits}"
            )
        }
        Venting::Unknown => format!(
            "disarmed, and whether the vents are open is not known: {no_session}, so nothing can be commanded; a cRIO that keeps to the protocol opens them by itself; look at the rig"
        ),
        Venting::ArmedAgain => format!(
            "disarmed, and armed again since ({}): the rig is under control; {pressures}",
            armed_by.unwrap_or("the log says by whom")
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::operator::latched_conditions::LatchedConditions;
    use crate::state::Condition;

    fn status(state: State, reported_duty: Option<[f64; 2]>) -> Status {
        Status { state, duty: VENT, reported_duty, pressures_kpa: Some([91.0, -24.84]), ..Status::default() }
    }

    #[test]
    fn vents_are_open_where_the_crio_reports_it_and_nowhere_else() {
        let taken = |state, reported| venting(Disarming::Taken { at_ns: 1 }, &status(state, reported));
        let commanded = |state, reported| venting(Disarming::Commanded, &status(state, reported));
        assert_eq!(taken(State::Standby, Some([1.0, 0.995])), Some(Venting::Open));
        assert_eq!(taken(State::Vent, Some([1.0, 1.0])), Some(Venting::Open));
        for not_yet in [Some([0.885, 0.889]), Some([1.0, 0.2]), Some([f64::NAN, 1.0]), None] {
            assert_eq!(taken(State::Standby, not_yet), None, "{not_yet:?}");
        }
        assert_eq!(taken(State::Fault, Some([1.0, 1.0])), Some(Venting::InDoubt));
        assert_eq!(taken(State::Run, Some([1.0, 1.0])), None, "not carried out yet");
        assert_eq!(commanded(State::Hold, Some([1.0, 1.0])), Some(Venting::ArmedAgain));
    }

    #[test]
    fn whoever_failed_to_arm_is_not_said_to_have_disarmed() {
        let (end, _other) = std::os::unix::net::UnixStream::pair().unwrap();
        let peer = Peer::of(&end);
        assert_eq!(DisarmedBy::Order(peer).to_string(), format!("a disarming by {peer}"));
        let failed = DisarmedBy::FailedArming(peer).to_string();
        assert_eq!(failed, format!("an arming by {peer} that failed, and was disarmed,"));
    }

    #[test]
    fn one_line_says_what_is_known_and_what_is_not() {
        let fault = Status {
            fault: Some(Condition::VentIneffective),
            waiting: LatchedConditions::of([Condition::VentNotEchoed]),
            ..status(State::Fault, Some([0.2, 1.0]))
        };
        for (venting, status, words) in [
            (Venting::Open, status(State::Standby, Some(VENT)), &["reports them open", "91.00/-24.84 kPa"][..]),
            (
                Venting::InDoubt,
                fault,
                &["in doubt (vent without effect)", "0.200/1.000", "pump off", "`vent not echoed` waits"],
            ),
            (Venting::InDoubt, status(State::Standby, None), &["in doubt: ", "reports nothing"]),
            (Venting::Unknown, Status::default(), &["not known: no session, last data 3.0 s ago", "look at the rig"]),
            (Venting::ArmedAgain, status(State::Run, None), &["armed again since (root", "under control"]),
        ] {
            let line = told(venting, &status, "no session, last data 3.0 s ago", Some("root (uid 0)"));
            assert!(!line.contains('\n') && line.starts_with("disarmed"), "{line}");
            for word in words {
                assert!(line.contains(word), "`{word}` is not in: {line}");
            }
        }
    }
}
