//! The TCP link to the cRIO: connect, open a session, receive until a deadline, send in one write.
//!
//! The socket never blocks: waiting is done by `ppoll`, which keeps nanosecond deadlines (a socket's own
//! receive time-out has the grain of the kernel's timer), and a send that would block means the cRIO has
//! stopped reading, which is a lost link, not a reason to wait.

mod broken;
#[cfg(test)]
mod burst_tests;
mod connecting;
mod link_error;
mod misplaced;
#[cfg(test)]
mod tests;

use std::hash::{BuildHasher, Hasher, RandomState};
use std::io::{self, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

use monitor::{FrameGate, Pacing, Rejection};
use proto::wire::{Bye, ByeReason, Frame, FrameReader, Hello, RawFrame, Sense, SequenceCounter, WireError};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::io::{Errno, ioctl_fionread};
use rustix::time::Timespec;
use supervisor::Condition;

use broken::broken_stream;
use connecting::connect;

use crate::machine::clock::now_ns;

pub use broken::Broken;
pub(crate) use connecting::LookUp;
pub use link_error::{Heard, LinkError};
pub use misplaced::Misplaced;

/// Time that connecting and each answer of the handshake may take.
const HANDSHAKE: Duration = Duration::from_millis(1000);
/// Bytes taken in one tick: a thousand readings, twenty seconds of a machine that stood still. More is a flood.
const MOST_BYTES: usize = 64 * 1024;
/// The daemon's name in HELLO.
const NAME: &str = "controller";

/// Result of waiting for a frame.
#[derive(Debug, Clone, Copy)]
pub enum Incoming {
    /// The newest reading.
    Sense {
        /// The frame.
        sense: Sense,
        /// Bytes.
        raw: RawFrame,
        /// Time at which it was in hand.
        at_ns: u64,
    },
    /// The deadline passed.
    Timeout,
    /// The link is gone, or must be closed.
    Lost(Broken),
}

/// A frame did not go out whole: the link is lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NotSent;

/// An open session.
pub struct Link {
    socket: TcpStream,
    reader: FrameReader,
    sequence: SequenceCounter,
    session: u32,
    gate: FrameGate,
    damaged: u64,
    misplaced: Option<Misplaced>,
    rejected: Option<Rejection>,
    /// Bytes taken since the last reading was asked for.
    taken: usize,
    /// Time by which the last wait for a reading ended later than was asked for, in ns.
    overslept_ns: u64,
    /// Reason why the link is gone that came behind a reading, which is answered first.
    broken: Option<Broken>,
}

impl Link {
    /// Connects to the first of these addresses that answers, and opens a session with a fresh random number; `address` is
    /// what they are called in messages.
    ///
    /// # Errors
    /// Why not, in one line that names the address.
    ///
    /// # Real-time
    /// Not for the tick: it waits and allocates.
    pub fn open(address: &str, candidates: &[SocketAddr], pacing: Pacing) -> Result<Self, LinkError> {
        let socket = connect(address, candidates)?;
        let mut link = Link {
            socket,
            reader: FrameReader::new(),
            sequence: SequenceCounter::new(),
            session: fresh_session(),
            gate: FrameGate::new(pacing),
            damaged: 0,
            misplaced: None,
            rejected: None,
            taken: 0,
            overslept_ns: 0,
            broken: None,
        };
        let hello = Hello::new(link.sequence.advance(), now_ns(), link.session, NAME);
        let broken = |source| LinkError::Broken { address: address.to_owned(), source };
        link.socket.write_all(&hello.encode()).map_err(broken)?;
        let until = now_ns() + HANDSHAKE.as_nanos() as u64;
        // What came instead of the HELLO.
        let mut heard: Option<Heard> = None;
        let mut is_over = false;
        loop {
            match link.reader.next_frame() {
                Ok(Some(received)) => match received.frame {
                    Frame::Hello(hello) => {
                        hello.check().map_err(|refusal| {
                            link.bye(refusal.bye_reason());
                            LinkError::Refused { address: address.to_owned(), refusal }
                        })?;
                        if hello.session != link.session {
                            link.bye(ByeReason::ProtocolError);
                            return Err(LinkError::Session {
                                address: address.to_owned(),
                                sent: link.session,
                                found: hello.session,
                            });
                        }
                        return Ok(link);
                    }
                    Frame::Bye(bye) => return Err(LinkError::Bye { address: address.to_owned(), reason: bye.reason }),
                    // Readings of an older session may still be on their way.
                    Frame::Sense(_) | Frame::Command(_) => {
                        heard.get_or_insert(Heard::Early { frame: received.frame.kind() });
                    }
                },
                Ok(None) => {
                    // What had come by the end is read; what goes on coming is not waited for.
                    let was_over = std::mem::replace(&mut is_over, is_past(Some(until)));
                    let is_late = was_over || !link.wait(Some(until)).map_err(|errno| broken(errno.into()))?;
                    let read = if is_late { Ok(0) } else { link.reader.read_from(&mut link.socket) };
                    if read.as_ref().is_ok_and(|bytes| *bytes > 0) {
                        continue;
                    }
                    let address = address.to_owned();
                    let heard = heard.or_else(|| Heard::piece(link.reader.waiting()));
                    return Err(match (read, heard) {
                        // What only came early or not whole explains no error of the system.
                        (Err(error), None | Some(Heard::Early { .. } | Heard::Piece { .. })) => broken(error),
                        (_, Some(heard)) => LinkError::Unanswered { address, heard },
                        (_, None) if is_late => LinkError::Silent { address },
                        (_, None) => broken(io::ErrorKind::UnexpectedEof.into()),
                    });
                }
                Err(damage) if damage.is_fatal() => {
                    let reason = if matches!(damage.error, WireError::Version { .. }) {
                        ByeReason::Version
                    } else {
                        ByeReason::ProtocolError
                    };
                    link.bye(reason);
                    return Err(LinkError::Wire { address: address.to_owned(), error: damage.error });
                }
                // A frame that came damaged says more than one that came early.
                Err(damage) => heard = Some(Heard::damaged(damage.error)),
            }
        }
    }

    /// The session's number.
    pub fn session(&self) -> u32 {
        self.session
    }

    /// A frame since the last call that did not count because its numbering cannot be right.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn take_rejection(&mut self) -> Option<Rejection> {
        self.rejected.take()
    }

    /// Condition that the cRIO samples at another rate, with the rate in Hz; `None` where it does not.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn wrong_rate(&self) -> Option<(Condition, f64)> {
        self.gate.wrong_rate()
    }

    /// The newest frame since the last call that had no place in the session, however sound it was.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn take_misplaced(&mut self) -> Option<Misplaced> {
        self.misplaced.take()
    }

    /// Frames dropped as damaged, or of a kind or session that has no place here.
    pub fn damaged(&self) -> u64 {
        self.damaged
    }

    /// Waits for the newest reading until `until_ns` on the monotonic clock (`None`: for ever). Readings that it has overtaken,
    /// because they came together, are shown to `overtaken`, the oldest first.
    ///
    /// Bytes that have already come are taken first, so a late wake-up of this thread loses nothing. What breaks the link behind a reading is
    /// told by the next call: the reading may say why.
    ///
    /// # Real-time
    /// Runs in the tick: waits no longer than asked, whatever keeps coming, takes no more than a bounded number of bytes, allocates
    /// nothing.
    pub fn receive(&mut self, until_ns: Option<u64>, overtaken: &mut dyn FnMut(&Sense)) -> Incoming {
        self.taken = 0;
        self.overslept_ns = 0;
        if let Some(broken) = self.broken {
            return Incoming::Lost(broken);
        }
        loop {
            let is_over = is_past(until_ns);
            match self.newest(until_ns, overtaken) {
                Ok(Some((sense, raw))) => return Incoming::Sense { sense, raw, at_ns: now_ns() },
                Ok(None) if is_over => return Incoming::Timeout,
                Ok(None) => {}
                Err(broken) => return Incoming::Lost(broken),
            }
            let begun_ns = now_ns();
            let has_come = match self.wait(until_ns) {
                Ok(has_come) => has_come,
                Err(errno) => return Incoming::Lost(lost_by(errno.raw_os_error())),
            };
            // A wait whose end had passed before it began asked for nothing.
            let late_ns = until_ns.map_or(0, |until| now_ns().saturating_sub(until.max(begun_ns)));
            self.overslept_ns = self.overslept_ns.max(late_ns);
            if !has_come {
                return Incoming::Timeout;
            }
        }
    }

    /// Reason why the link is gone, where that has come already behind the newest reading.
    ///
    /// # Real-time
    /// May run in the tick.
    pub(crate) fn broken(&self) -> Option<Broken> {
        self.broken
    }

    /// Time by which this thread came back later from its last wait for a reading than it had asked to, in ns: it stood still.
    pub fn overslept_ns(&self) -> u64 {
        self.overslept_ns
    }

    /// Sends a frame in one write.
    ///
    /// # Errors
    /// If it could not go out whole at once: the link is lost.
    ///
    /// # Real-time
    /// Runs in the tick: one system call that does not wait.
    pub fn send(&mut self, frame: &[u8]) -> Result<(), NotSent> {
        match self.socket.write(frame) {
            Ok(sent) if sent == frame.len() => Ok(()),
            _ => Err(NotSent),
        }
    }

    /// The next sequence number of our direction.
    pub fn next_sequence(&mut self) -> u32 {
        self.sequence.advance()
    }

    /// Says BYE; whether it arrives matters no more.
    pub fn bye(&mut self, reason: ByeReason) {
        let bye = Bye { sequence: self.sequence.advance(), clock_ns: now_ns(), session: self.session, reason };
        let _ = self.send(&bye.encode());
    }

    /// Takes everything that has come and answers the newest reading in it.
    fn newest(
        &mut self,
        until_ns: Option<u64>,
        overtaken: &mut dyn FnMut(&Sense),
    ) -> Result<Option<(Sense, RawFrame)>, Broken> {
        let mut newest: Option<(Sense, RawFrame)> = None;
        let taken = self.take_all(until_ns, |sense, raw| {
            if let Some((older, _)) = newest.replace((sense, raw)) {
                overtaken(&older);
            }
        });
        match (newest, taken) {
            (None, Err(broken)) => Err(broken),
            (newest, taken) => {
                self.broken = taken.err();
                Ok(newest)
            }
        }
    }

    /// Takes everything that has come and hands on each reading in it; once the deadline has passed, no more than lies there then.
    fn take_all(&mut self, until_ns: Option<u64>, mut read: impl FnMut(Sense, RawFrame)) -> Result<(), Broken> {
        let mut left: Option<usize> = None;
        loop {
            match self.reader.next_frame() {
                Ok(Some(received)) => match received.frame {
                    Frame::Sense(sense) if sense.session == self.session => match self.gate.judge(&sense, now_ns()) {
                        Ok(()) => read(sense, received.raw),
                        Err(rejection) => self.rejected = Some(rejection),
                    },
                    Frame::Bye(bye) => {
                        return Err(Broken::because(Condition::PeerLeft, f64::from(bye.reason.code())));
                    }
                    Frame::Sense(sense) => self.misplace(Misplaced::Sense { session: sense.session }),
                    Frame::Hello(_) => self.misplace(Misplaced::Hello),
                    Frame::Command(_) => self.misplace(Misplaced::Command),
                },
                Ok(None) => {
                    if self.taken > MOST_BYTES {
                        return Err(Broken::because(Condition::LinkFlooded, self.taken as f64));
                    }
                    if left.is_none() && is_past(until_ns) {
                        // At least one read: it finds what has no bytes, the end of the link or an error.
                        left = Some(ioctl_fionread(&self.socket).map_or(1, |bytes| bytes.max(1) as usize));
                    }
                    if left == Some(0) {
                        return Ok(());
                    }
                    match self.reader.read_from(&mut self.socket) {
                        Ok(0) => return Err(lost_by(0)),
                        Ok(bytes) => {
                            self.taken += bytes;
                            left = left.map(|left| left.saturating_sub(bytes));
                        }
                        Err(e) if e.kind() == io::ErrorKind::WouldBlock => return Ok(()),
                        Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                        Err(e) => return Err(lost_by(e.raw_os_error().unwrap_or(0))),
                    }
                }
                Err(damage) if damage.is_fatal() => return Err(broken_stream(damage.error)),
                Err(damage) => match damage.error {
                    WireError::UnknownCode { offset, code, .. } => {
                        self.misplace(Misplaced::UnknownCode { offset, code });
                    }
                    _ => self.damaged += 1,
                },
            }
        }
    }

    fn misplace(&mut self, what: Misplaced) {
        self.damaged += 1;
        self.misplaced = Some(what);
    }

    /// Waits until there is something to read; `false` at the deadline.
    fn wait(&self, until_ns: Option<u64>) -> Result<bool, Errno> {
        loop {
            let left = until_ns.map(|until| until.saturating_sub(now_ns()));
            let timeout =
                left.map(|ns| Timespec { tv_sec: (ns / 1_000_000_000) as i64, tv_nsec: (ns % 1_000_000_000) as _ });
            let mut fds = [PollFd::new(&self.socket, PollFlags::IN)];
            match poll(&mut fds, timeout.as_ref()) {
                Ok(0) => return Ok(false),
                // An error of the socket itself is found by the read that follows.
                Ok(_) => return Ok(true),
                Err(Errno::INTR) => {}
                Err(errno) => return Err(errno),
            }
        }
    }
}

/// Tells whether a time on the monotonic clock has passed; `None` never does.
fn is_past(until_ns: Option<u64>) -> bool {
    until_ns.is_some_and(|until| now_ns() >= until)
}

/// A link that the system gave up with this error; 0 where the cRIO closed it.
fn lost_by(errno: i32) -> Broken {
    Broken::because(Condition::LinkLost, f64::from(errno))
}

/// A session number that is random and not zero; the hasher's keys come from the system's random numbers.
fn fresh_session() -> u32 {
    let hash = RandomState::new().build_hasher().finish();
    ((hash ^ (hash >> 32)) as u32).max(1)
}
