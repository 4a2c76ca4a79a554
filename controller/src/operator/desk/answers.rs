//! Answers to operators and their record, and the newest that the tick has shown.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use flight::Noter;
use proto::recording::{EventLevel, rfc3339};

use super::{Desk, Step};
use crate::machine::clock::now_ns;
use crate::operator::mailbox::Status;
use crate::operator::operator_protocol::{Ask, Reply};
use crate::operator::peer::Peer;
use crate::state::State;

impl Desk {
    /// An answer to what is no request.
    pub fn refuse(&mut self, why: &str) -> Reply {
        self.refresh();
        self.reply(Err(why.to_owned()))
    }

    /// Records and answers a request that is over.
    pub(super) fn over(&mut self, what: &str, peer: Peer, outcome: Result<(), String>) -> Step {
        self.record(what, peer, &outcome);
        self.done(outcome)
    }

    /// As [`Desk::over`], with a line that says what was done.
    pub(super) fn over_saying(&mut self, what: &str, peer: Peer, outcome: Result<String, String>) -> Step {
        let (done, outcome) = match outcome {
            Ok(text) => (Some(text), Ok(())),
            Err(why) => (None, Err(why)),
        };
        self.record(what, peer, &outcome);
        let mut reply = self.reply(outcome);
        reply.done = done;
        Step::Done(Box::new(reply))
    }

    /// Records what a person should know.
    pub(super) fn note_remark(&self, remark: &str) {
        note_line(&self.options.notes, EventLevel::Warning, remark);
    }

    pub(super) fn record(&self, what: &str, peer: Peer, outcome: &Result<(), String>) {
        let outcome = outcome.as_ref().map(|()| None).map_err(String::as_str);
        note_outcome(&self.options.notes, &format!("{what} by {peer}"), outcome);
    }

    pub(super) fn done(&mut self, outcome: Result<(), String>) -> Step {
        Step::Done(Box::new(self.reply(outcome)))
    }

    pub(super) fn refresh(&mut self) {
        if let Some(shown) = self.options.mailbox.status() {
            self.newest = Some(shown);
        }
    }

    /// Age of the newest data; `None` where none has come yet.
    fn age(&self) -> Option<Duration> {
        let came = self.newest.filter(|shown| shown.at_ns > 0);
        came.map(|shown| Duration::from_nanos(now_ns().saturating_sub(shown.at_ns)))
    }

    /// Age of the newest data in ms, as it is told.
    pub(super) fn age_ms(&self) -> Option<u64> {
        self.age().map(|age| u64::try_from(age.as_millis()).unwrap_or(u64::MAX))
    }

    /// The newest status, if it still tells what is.
    pub(super) fn live_status(&self) -> Option<Status> {
        let fresh = self.age().is_some_and(|age| age <= self.options.stale);
        self.newest.filter(|_| fresh).map(|shown| shown.status)
    }

    pub(super) fn no_session(&self) -> String {
        if self.live_status().is_some() { "the cRIO answers".to_owned() } else { self.last_data() }
    }

    /// Words for a rig without a session: the age of the newest data.
    pub(super) fn last_data(&self) -> String {
        match self.age() {
            Some(age) => format!("no session with the cRIO, last data {:.1} s ago", age.as_secs_f64()),
            None => "no session with the cRIO yet".to_owned(),
        }
    }

    pub(super) fn reply(&mut self, outcome: Result<(), String>) -> Reply {
        let live = self.live_status();
        let running = self.running();
        // What would be refused whatever the tick says.
        let may_arm = !self.comes_between(&Ask::Arm {});
        Reply {
            ok: outcome.is_ok(),
            error: outcome.err().map(|why| one_line(&why)),
            state: live.map_or(State::Connect, |s| s.state),
            // Without a session the last readings are history: nothing is followed, nothing can be armed.
            status: live.map(|s| Status { can_arm: s.can_arm && may_arm && s.experiment.is_none(), ..s }).or(self
                .newest
                .map(|shown| Status { can_arm: false, reference_kpa: None, reported_duty: None, ..shown.status })),
            age_ms: self.age_ms(),
            running,
            done: None,
            remark: None,
            venting: None,
            policies: None,
            policies_problem: None,
            experiment: self.experiments.as_ref().and_then(|e| e.view(live.and_then(|s| s.experiment))),
            bad_input: false,
            recording_problem: self.options.health.error().or_else(|| self.options.health.why_not_arm()),
        }
    }

    /// Notes who armed it, and when.
    pub(super) fn armed_by(&mut self, peer: Peer) {
        self.options.running.armed_by = Some(stamp(peer));
    }
}

/// Records what came of a request, with what was done where that is not plain.
pub(super) fn note_outcome(notes: &Noter, request: &str, outcome: Result<Option<&str>, &str>) {
    let (level, how) = match outcome {
        Ok(None) => (EventLevel::Info, "done".to_owned()),
        Ok(Some(done)) => (EventLevel::Info, format!("done: {done}")),
        Err(why) => (EventLevel::Warning, format!("refused: {why}")),
    };
    note_line(notes, level, &format!("{request}: {how}"));
}

/// Records a line of the operators' desk.
pub(super) fn note_line(notes: &Noter, level: EventLevel, line: &str) {
    notes.note(now_ns(), level, "operator", one_line(line));
}

/// Most characters of a line that is told; what clients send is quoted in it.
const MOST_CHARACTERS: usize = 1000;

/// A text as one plain line: what clients send may hold line breaks, escapes of a terminal, and megabytes.
pub(super) fn one_line(text: &str) -> String {
    let mut line = String::new();
    for c in text.chars().take(MOST_CHARACTERS) {
        if c.is_control() { line.extend(c.escape_default()) } else { line.push(c) }
    }
    if text.chars().nth(MOST_CHARACTERS).is_some() {
        line.push('…');
    }
    line
}

/// Name, and time by the wall clock.
fn stamp(peer: Peer) -> String {
    let seconds = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
    format!("{peer} at {}", rfc3339(UNIX_EPOCH + Duration::from_secs(seconds)))
}
