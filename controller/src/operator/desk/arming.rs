//! Arm, and acknowledge what waits for a person.

use super::answers::note_outcome;
use super::disarming::DisarmedBy;
use super::reach::Carried;
use super::{Asked, Desk, Step, WITHDRAWN, What};
use crate::operator::latched_conditions::LatchedConditions;
use crate::operator::mailbox::{Fate, Request, Status, Ticket};
use crate::operator::notice::why_barred;
use crate::operator::operator_protocol::{ECHO_TIME, EFFECT_TIME};
use crate::operator::peer::Peer;
use crate::state::FRAMES_TO_ARM;

/// Time for which all must have been sound before the rig is armed.
const SOUND_MS: u64 = FRAMES_TO_ARM as u64 * proto::wire::TICK_NS / 1_000_000;
/// Answered to an acknowledgement that came too late for the tick.
const LATE: &str = "no tick took it in time; try again";
/// Told where a tick has taken an acknowledgement, and none was shown since.
const NOT_SHOWN: &str = "a tick took it; `controller status` tells what waits";

/// An acknowledgement that the tick is asked for.
#[derive(Debug, Clone, Copy)]
pub(super) struct Acknowledging {
    pub(super) ticket: Ticket,
    /// Conditions that waited when it was asked for.
    before: LatchedConditions,
    progress: Progress,
}

/// Progress of an acknowledgement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Progress {
    /// No tick was seen to have taken it.
    Ordered,
    /// A tick has taken it; what it released is only known once that tick is shown.
    Taken,
}

impl Desk {
    pub(super) fn begin_arming(&mut self, asked: Asked) -> Step {
        match self.start_arming(asked) {
            Ok(ticket) => asked.taking(EFFECT_TIME).pending(What::Arm(ticket)),
            Err(why) => self.over("arm", asked.peer, Err(why)),
        }
    }

    fn start_arming(&self, asked: Asked) -> Result<Ticket, String> {
        let Some(status) = self.live_status() else {
            return Err(format!("nothing to arm: {}", self.no_session()));
        };
        if status.state.is_controlling() {
            return Err("it is armed already".to_owned());
        }
        if !status.waiting.is_empty() {
            let wait = status.waiting.wait();
            return Err(format!("{wait} for `controller acknowledge`; look at it first, then arm"));
        }
        if let Some(problem) = self.options.health.why_not_arm() {
            return Err(format!("it would not be recorded: {problem}"));
        }
        if let Some(condition) = status.bars_arming {
            return Err(format!("it cannot be armed: {}", why_barred(condition)));
        }
        if !status.can_arm {
            return Err(not_yet(&status));
        }
        self.ask_tick(Request::Arm, asked.since)
    }

    pub(super) fn look_at_arming(&mut self, ticket: Ticket, asked: Asked) -> Step {
        let Some(outcome) = self.arming(ticket, asked) else { return asked.pending(What::Arm(ticket)) };
        if outcome.is_err() {
            return self.over("arm", asked.peer, outcome);
        }
        self.armed_by(asked.peer);
        // The reference may pass through a place out of reach for a moment, so that is told and not refused.
        self.over_remarking(Carried::Arming, "arm", Vec::new(), asked)
    }

    /// Outcome of arming once it is over; `None` while it may still go either way.
    fn arming(&mut self, ticket: Ticket, asked: Asked) -> Option<Result<(), String>> {
        let late = asked.is_late();
        let fate = self.options.mailbox.fate(ticket);
        let since = self.newest.filter(|shown| shown.at_ns > asked.at_ns).map(|shown| shown.status);
        let runs = since.is_some_and(|status| status.state.is_controlling());
        let vented = since.filter(|status| status.state.is_vented());
        if let (Fate::Taken, Some(status)) = (fate, vented) {
            // The order is spent, and whoever is told that the rig does not run must not find it armed by itself.
            self.disarm(DisarmedBy::FailedArming(asked.peer));
            return Some(Err(vented_at_once(&status)));
        }
        match fate {
            Fate::Taken if runs => Some(Ok(())),
            Fate::Fell => Some(Err(self.why_fell(asked))),
            Fate::Withdrawn => Some(Err(WITHDRAWN.to_owned())),
            Fate::Waiting | Fate::Taken if !late => None,
            Fate::Waiting if self.options.mailbox.withdraw(ticket) => {
                Some(Err(format!("no tick took it in time, so it was withdrawn; {}", self.no_session())))
            }
            Fate::Waiting | Fate::Taken => {
                // The tick has taken it and the rig does not run: it must not begin to later on.
                self.disarm(DisarmedBy::FailedArming(asked.peer));
                let no_session = self.live_status().is_none_or(|status| status.session == 0);
                let why = if no_session { self.last_data() } else { "`controller status` tells why".to_owned() };
                Some(Err(format!("it did not start in time, so it was disarmed; {why}")))
            }
        }
    }

    /// The client that armed has left.
    pub(super) fn leave_arming(&mut self, ticket: Ticket, peer: Peer) {
        let outcome = self.withdrawn(ticket);
        self.record("arm", peer, &outcome);
        if outcome.is_ok() {
            self.armed_by(peer);
        }
    }

    pub(super) fn begin_acknowledging(&mut self, asked: Asked) -> Step {
        match self.start_acknowledging(asked) {
            Ok(acknowledging) => asked.taking(EFFECT_TIME).pending(What::Acknowledge(acknowledging)),
            Err(why) => self.over("acknowledge", asked.peer, Err(why)),
        }
    }

    fn start_acknowledging(&self, asked: Asked) -> Result<Acknowledging, String> {
        // Also without a session: a trip of the cRIO that waits for a person bars the next one.
        let before = self.newest.map_or(LatchedConditions::NONE, |shown| shown.status.waiting);
        if before.is_empty() {
            return Err("nothing waits to be acknowledged".to_owned());
        }
        let ticket = self.ask_tick(Request::Acknowledge, asked.since)?;
        Ok(Acknowledging { ticket, before, progress: Progress::Ordered })
    }

    pub(super) fn look_at_acknowledging(&mut self, acknowledging: Acknowledging, asked: Asked) -> Step {
        let Acknowledging { ticket, before, progress } = acknowledging;
        let late = asked.is_late();
        if progress == Progress::Ordered {
            let why = match self.options.mailbox.fate(ticket) {
                Fate::Waiting if !late => return asked.pending(What::Acknowledge(acknowledging)),
                Fate::Waiting if self.options.mailbox.withdraw(ticket) => LATE.to_owned(),
                Fate::Waiting | Fate::Taken => {
                    let taken = Acknowledging { progress: Progress::Taken, ..acknowledging };
                    return self.look_at_acknowledging(taken, asked.taking(ECHO_TIME));
                }
                Fate::Fell => self.why_fell(asked),
                Fate::Withdrawn => LATE.to_owned(),
            };
            return self.over("acknowledge", asked.peer, Err(why));
        }
        match self.newest.filter(|shown| shown.through >= ticket) {
            Some(shown) => self.over_acknowledging(acknowledged(before, shown.status.waiting), asked.peer),
            None if !late => asked.pending(What::Acknowledge(acknowledging)),
            None => self.over_acknowledging(Ok(NOT_SHOWN.to_owned()), asked.peer),
        }
    }

    /// Records and answers an acknowledgement that a tick has taken.
    fn over_acknowledging(&mut self, outcome: Result<String, String>, peer: Peer) -> Step {
        match outcome {
            Ok(told) => {
                note_outcome(&self.options.notes, &format!("acknowledge by {peer}"), Ok(Some(&told)));
                let mut reply = self.reply(Ok(()));
                reply.done = Some(told);
                Step::Done(Box::new(reply))
            }
            Err(why) => self.over("acknowledge", peer, Err(why)),
        }
    }
}

/// Answer to an order to arm a rig for which nothing waits and nothing is barred, before its frames have been sound for long enough.
fn not_yet(status: &Status) -> String {
    let name = status.state.as_str();
    match status.fault {
        Some(condition) => {
            let cause = condition.name();
            format!("it is {name} ({cause}) and can be armed {SOUND_MS} ms after that is over; ask again then")
        }
        None => format!("it is {name} and its frames must be sound for {SOUND_MS} ms first; ask again in a second"),
    }
}

/// Outcome of an acknowledgement that a tick has carried out: what it released of what waited, and what waits on. It is an error only
/// where it released nothing.
fn acknowledged(before: LatchedConditions, after: LatchedConditions) -> Result<String, String> {
    let released = before.without(after);
    if after.is_empty() {
        Ok(format!("acknowledged: {}; arm when you are ready", before.names()))
    } else if released.is_empty() {
        Err(format!("nothing was acknowledged; still waits: {} (still holds)", after.names()))
    } else {
        Ok(format!("acknowledged: {}; still waits: {} (still holds)", released.names(), after.names()))
    }
}

/// Answer to an order to arm that was carried out in a tick, or just before one, that vented the rig.
fn vented_at_once(status: &Status) -> String {
    let cause = status.fault.map_or("the log says why", |condition| condition.name());
    let next = if status.waiting.is_empty() {
        "arm again once that is over".to_owned()
    } else {
        format!("{} for `controller acknowledge`; look at it first, then arm", status.waiting.wait())
    };
    format!("the rig was vented as soon as it was armed ({cause}), and is disarmed; {next}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::state::{Condition, State};

    #[test]
    fn an_arming_that_was_vented_at_once_names_the_cause_and_what_is_to_do() {
        let vented = Status { state: State::Vent, fault: Some(Condition::FramesMissing), ..Status::default() };
        let latched = Status {
            fault: Some(Condition::PumpOff),
            waiting: LatchedConditions::of([Condition::CrioTripped]),
            state: State::Fault,
            ..Status::default()
        };
        for (status, words) in [
            (vented, [Condition::FramesMissing.name(), "arm again"]),
            (latched, [Condition::PumpOff.name(), "`cRIO tripped` waits for `controller acknowledge`"]),
        ] {
            let line = vented_at_once(&status);
            assert!(!line.contains('\n') && words.iter().all(|word| line.contains(word)), "{line}");
        }
    }

    #[test]
    fn an_acknowledgement_tells_what_it_released_and_what_waits_on() {
        let set = |conditions: &[Condition]| LatchedConditions::of(conditions.iter().copied());
        let (trip, broken) = (Condition::CrioTripped, Condition::SensorNegative);
        let all = acknowledged(set(&[trip, broken]), set(&[])).unwrap();
        assert!(all.starts_with("acknowledged: cRIO tripped, negative sensor broken; arm"), "{all}");
        let one = acknowledged(set(&[trip, broken]), set(&[broken])).unwrap();
        assert!(one.starts_with("acknowledged: cRIO tripped; still waits: negative sensor broken"), "{one}");
        for before in [set(&[broken]), set(&[broken, trip])] {
            let none = acknowledged(before, before).unwrap_err();
            assert!(none.contains("negative sensor broken") && none.contains("still holds"), "{none}");
        }
    }
}
