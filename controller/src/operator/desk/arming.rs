//! Arm, and acknowledge what waits for a person.

use super::{Asked, Desk, Step, WITHDRAWN, What};
use crate::operator::mailbox::{Fate, Request, Status, Ticket};
use crate::operator::notice::why_barred;
use crate::operator::peer::Peer;

impl Desk {
    pub(super) fn begin_arming(&mut self, asked: Asked) -> Step {
        match self.start_arming() {
            Ok(ticket) => asked.pending(What::Arm(ticket)),
            Err(why) => self.over("arm", asked.peer, Err(why)),
        }
    }

    fn start_arming(&mut self) -> Result<Ticket, String> {
        let Some(status) = self.live_status() else {
            return Err(format!("nothing to arm: {}", self.no_session()));
        };
        if status.state.is_controlling() {
            return Err("it is armed already".to_owned());
        }
        if let Some(condition) = status.latched {
            let what = condition.name();
            return Err(format!("`{what}` waits for `controller acknowledge`; look at it first, then arm"));
        }
        if let Some(problem) = self.options.health.why_not_arm() {
            return Err(format!("it would not be recorded: {problem}"));
        }
        if let Some(condition) = status.bars_arming {
            return Err(format!("it cannot be armed: {}", why_barred(condition)));
        }
        if !status.can_arm {
            let name = status.state.as_str();
            return Err(format!("it is {name} and cannot be armed yet; `controller status` tells why"));
        }
        self.ask_tick(Request::Arm)
    }

    pub(super) fn look_at_arming(&mut self, ticket: Ticket, asked: Asked) -> Step {
        let Some(outcome) = self.arming(ticket, asked) else { return asked.pending(What::Arm(ticket)) };
        if outcome.is_err() {
            return self.over("arm", asked.peer, outcome);
        }
        self.armed_by(asked.peer);
        // It may pass through such a place for a moment, so it is told and not refused.
        let remark = self.beyond_reach();
        self.over_remarking("arm", asked.peer, remark)
    }

    /// Whether arming is over, and how; `None` while it may still go either way.
    fn arming(&mut self, ticket: Ticket, asked: Asked) -> Option<Result<(), String>> {
        let late = asked.is_late();
        let fate = self.options.mailbox.fate(ticket);
        let since = self.newest.filter(|(_, at_ns)| *at_ns > asked.at_ns).map(|(status, _)| status);
        let runs = since.is_some_and(|status| status.state.is_controlling());
        let vented = since.filter(|status| status.state.is_vented());
        if let (Fate::Taken, Some(status)) = (fate, vented) {
            // The order is spent, and whoever is told that the rig does not run must not find it armed by itself.
            self.options.mailbox.disarm();
            return Some(Err(vented_at_once(&status)));
        }
        match fate {
            Fate::Taken if runs => Some(Ok(())),
            Fate::Withdrawn => Some(Err(WITHDRAWN.to_owned())),
            Fate::Waiting | Fate::Taken if !late => None,
            Fate::Waiting if self.options.mailbox.withdraw(ticket) => {
                Some(Err(format!("no tick took it in time, so it was withdrawn; {}", self.no_session())))
            }
            Fate::Waiting | Fate::Taken => {
                // The tick has taken it and the rig does not run: it must not begin to later on.
                self.options.mailbox.disarm();
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
        match self.start_acknowledging() {
            Ok(ticket) => asked.pending(What::Acknowledge(ticket)),
            Err(why) => self.over("acknowledge", asked.peer, Err(why)),
        }
    }

    fn start_acknowledging(&mut self) -> Result<Ticket, String> {
        // Also without a session: a trip of the cRIO that waits for a person bars the next one.
        if self.newest.is_none_or(|(status, _)| status.latched.is_none()) {
            return Err("nothing waits to be acknowledged".to_owned());
        }
        self.ask_tick(Request::Acknowledge)
    }

    pub(super) fn look_at_acknowledging(&mut self, ticket: Ticket, asked: Asked) -> Step {
        match self.acknowledging(ticket, asked) {
            Some(outcome) => self.over("acknowledge", asked.peer, outcome),
            None => asked.pending(What::Acknowledge(ticket)),
        }
    }

    /// Whether acknowledging is over, and how; `None` while it may still go either way.
    fn acknowledging(&self, ticket: Ticket, asked: Asked) -> Option<Result<(), String>> {
        let late = asked.is_late();
        let waits = self.newest.and_then(|(status, _)| status.latched);
        match self.options.mailbox.fate(ticket) {
            Fate::Taken => match waits {
                None => Some(Ok(())),
                Some(condition) if late => {
                    Some(Err(format!("`{}` still holds, and goes on waiting", condition.name())))
                }
                Some(_) => None,
            },
            Fate::Waiting if !late => None,
            Fate::Waiting if !self.options.mailbox.withdraw(ticket) => Some(Ok(())),
            Fate::Waiting | Fate::Withdrawn => Some(Err("no tick took it in time; try again".to_owned())),
        }
    }
}

/// Answer to an order to arm that was carried out in a tick, or just before one, that vented the rig.
fn vented_at_once(status: &Status) -> String {
    let cause = status.fault.map_or("the log says why", |condition| condition.name());
    let next = match status.latched {
        Some(condition) => {
            format!("`{}` waits for `controller acknowledge`; look at it first, then arm", condition.name())
        }
        None => "arm again once that is over".to_owned(),
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
            latched: Some(Condition::CrioTripped),
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
}
