//! Frames between two edges: in by way of the fault script, out by way of it, and the link's end.

use crate::wire::{Bye, ByeReason, Command, Damage, Frame, FrameType, Hello, RawFrame, Received, WireError, is_newer};

use super::fault_outcome::Wire;
use super::link::{Link, ReadOutcome};
use super::serve::Server;
use super::watch::Event;

/// Reads of a link between two looks at the time: a flood cannot hold up the edge.
const READS_AT_ONCE: usize = 16;
/// Links being closed at the same time; beyond it the oldest is dropped.
const MOST_CLOSING: usize = 64;

impl Server {
    /// Sends a frame by way of the script; true where it went out at once, whole and unchanged.
    pub(super) fn send(&mut self, kind: FrameType, raw: RawFrame) -> bool {
        let outcome = self.script.outcome(Wire { kind, outgoing: true }, self.tick(), raw);
        if !outcome.untouched() {
            self.statistics.frames_spoilt += 1;
        }
        // Whoever has a frame can read the counts that led to it.
        self.publish();
        let due = self.due(outcome.delay);
        let mut failed = None;
        if let Some(link) = self.link.as_mut() {
            for _ in 0..outcome.times {
                match due {
                    Some(due) => link.hold_outgoing(due, outcome.raw),
                    None => failed = failed.or(link.write(outcome.raw.as_bytes()).err()),
                }
            }
        }
        if let Some(why) = failed {
            self.lose_link(why);
        }
        failed.is_none() && outcome.times > 0 && due.is_none() && !outcome.corrupted
    }

    /// Sends what the script held back until now.
    pub(super) fn release_outgoing(&mut self) {
        let now = self.clock();
        let mut failed = None;
        if let Some(link) = self.link.as_mut() {
            while let Some(raw) = link.due_outgoing(now) {
                failed = failed.or(link.write(raw.as_bytes()).err());
            }
        }
        if let Some(why) = failed {
            self.lose_link(why);
        }
    }

    /// Reads what has come and takes every frame in it.
    pub(super) fn receive(&mut self) {
        for _ in 0..READS_AT_ONCE {
            let Some(link) = self.link.as_mut() else { return };
            match link.read() {
                ReadOutcome::Nothing => return,
                ReadOutcome::Gone(why) => return self.lose_link(why),
                ReadOutcome::Some => {}
            }
            while let Some(link) = self.link.as_mut() {
                match link.reader.next_frame() {
                    Ok(None) => break,
                    Ok(Some(received)) => self.arrived(&received),
                    Err(damage) => self.damaged(&damage),
                }
            }
        }
    }

    /// A frame came over the wire: the script has its say first.
    fn arrived(&mut self, received: &Received) {
        if let Frame::Command(command) = &received.frame {
            self.note_answer(command);
        }
        let wire = Wire { kind: received.frame.kind(), outgoing: false };
        let outcome = self.script.outcome(wire, self.tick(), received.raw);
        if outcome.untouched() {
            return self.take(&received.frame);
        }
        self.statistics.frames_spoilt += 1;
        let due = self.due(outcome.delay);
        for _ in 0..outcome.times {
            match (due, self.link.as_mut()) {
                (Some(due), Some(link)) => link.hold_incoming(due, outcome.raw),
                (None, Some(_)) => self.take_raw(outcome.raw),
                (_, None) => return,
            }
        }
    }

    pub(super) fn release_incoming(&mut self) {
        let now = self.clock();
        while let Some(raw) = self.link.as_mut().and_then(|link| link.due_incoming(now)) {
            self.take_raw(raw);
        }
    }

    fn take_raw(&mut self, raw: RawFrame) {
        match Frame::decode(raw.as_bytes()) {
            Ok(frame) => self.take(&frame),
            Err(error) => self.damaged(&Damage { error, raw }),
        }
    }

    /// Lockstep: the answer came, whatever becomes of it, so the tick can end.
    fn note_answer(&mut self, command: &Command) {
        if self.waiting.is_some_and(|waiting| waiting.tick == command.tick)
            && self.crio.session() == Some(command.session)
        {
            self.waiting = None;
        }
    }

    fn take(&mut self, frame: &Frame) {
        match frame {
            Frame::Hello(hello) => self.hello(hello),
            Frame::Command(command) => match self.crio.command(command) {
                Ok(()) => self.statistics.commands_taken += 1,
                Err(rejection) => {
                    self.statistics.count_rejection(&rejection);
                    self.tell(Event::Rejected(rejection));
                }
            },
            Frame::Bye(bye) => {
                self.tell(Event::Bye(bye.reason));
                self.end_link();
            }
            Frame::Sense(_) => {
                self.tell(Event::Unexpected("a SENSE came from the client; only a cRIO sends those"));
                self.say_bye(ByeReason::ProtocolError);
                self.end_link();
            }
        }
    }

    fn hello(&mut self, hello: &Hello) {
        if self.crio.session() == Some(hello.session) {
            let repeated = self.crio.last_sequence().is_some_and(|last| !is_newer(hello.sequence, last));
            if repeated {
                return self.tell(Event::Unexpected("a HELLO came again; ignored"));
            }
            self.tell(Event::Unexpected("a second HELLO for the open session; a new session needs a new number"));
            self.say_bye(ByeReason::ProtocolError);
            return self.end_link();
        }
        let clock_ns = self.clock_ns();
        let Some(link) = self.link.as_mut() else { return };
        let sequence = link.sequence.advance();
        match self.crio.hello(hello, sequence, clock_ns) {
            Ok(answer) => {
                self.statistics.sessions += 1;
                self.session_is_fresh = true;
                self.waiting = None;
                self.tell(Event::SessionOpened { session: hello.session, name: hello.name_text().to_owned() });
                self.send(FrameType::Hello, RawFrame::of(&answer.encode()));
            }
            Err(refusal) => {
                self.statistics.hellos_refused += 1;
                self.tell(Event::HelloRefused(refusal));
                self.bye_frame(hello.session, sequence, refusal.bye_reason());
                self.end_link();
            }
        }
    }

    fn damaged(&mut self, damage: &Damage) {
        self.statistics.damaged += 1;
        self.tell(Event::Damaged(damage.error));
        if let WireError::Crc { frame: FrameType::Command, .. }
        | WireError::UnknownCode { frame: FrameType::Command, .. } = damage.error
        {
            // In lockstep a damaged COMMAND is an answer that does not count.
            self.waiting = None;
        }
        if damage.is_fatal() {
            self.say_bye(match damage.error {
                WireError::Version { .. } => ByeReason::Version,
                _ => ByeReason::ProtocolError,
            });
            self.end_link();
        }
    }

    pub(super) fn say_bye(&mut self, reason: ByeReason) {
        let session = self.crio.session().unwrap_or(0);
        if let Some(link) = self.link.as_mut() {
            let sequence = link.sequence.advance();
            self.bye_frame(session, sequence, reason);
        }
    }

    fn bye_frame(&mut self, session: u32, sequence: u32, reason: ByeReason) {
        let bye = Bye { sequence, clock_ns: self.clock_ns(), session, reason };
        self.send(FrameType::Bye, RawFrame::of(&bye.encode()));
    }

    /// Ends the session and closes the link in order.
    pub(super) fn end_link(&mut self) {
        self.crio.end_session();
        self.session_is_fresh = false;
        self.waiting = None;
        if let Some(link) = self.link.take() {
            self.close(link);
        }
        self.publish();
    }

    pub(super) fn close(&mut self, link: Link) {
        if self.closing.len() >= MOST_CLOSING {
            self.closing.remove(0);
        }
        self.closing.push(link.close());
    }

    /// Ends the session because the link is gone, or cuts it.
    pub(super) fn lose_link(&mut self, why: &'static str) {
        self.crio.end_session();
        self.session_is_fresh = false;
        self.waiting = None;
        if let Some(link) = self.link.take() {
            link.cut();
            self.statistics.links_lost += 1;
            self.tell(Event::LinkLost(why));
        }
        self.publish();
    }
}
