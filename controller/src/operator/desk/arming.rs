//! Arm, and acknowledge what waits for a person.

use super::{Asked, Desk, Step, WITHDRAWN, What};
use crate::operator::mailbox::{Fate, Request, Ticket};
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
        if outcome.is_ok() {
            self.armed_by(asked.peer);
        }
        self.over("arm", asked.peer, outcome)
    }

    /// Whether arming is over, and how; `None` while it may still go either way.
    fn arming(&mut self, ticket: Ticket, asked: Asked) -> Option<Result<(), String>> {
        let late = asked.is_late();
        let fate = self.options.mailbox.fate(ticket);
        let runs = self.newest.is_some_and(|(s, at_ns)| s.state.is_controlling() && at_ns > asked.at_ns);
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
                Some(Err("it did not start in time, so it was disarmed; `controller status` tells why".to_owned()))
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
