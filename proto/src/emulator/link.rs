//! One client's link: a non-blocking socket, its frame reader, and frames that a script holds back.
//!
//! Each frame goes out in one write. A client that does not read fills its socket's buffer; a write
//! that does not take the whole frame then ends the link, for half a frame would break the stream and
//! waiting would hold up the sample edge.

use std::collections::VecDeque;
use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::time::{Duration, Instant};

use crate::wire::{FrameReader, RawFrame, SequenceCounter};

/// Time for which a closed link is kept to read what still comes: closing with bytes unread would reset the
/// connection, and the peer might lose the BYE.
const CLOSING: Duration = Duration::from_secs(1);

/// The link to one client.
pub(super) struct Link {
    pub(super) stream: TcpStream,
    pub(super) reader: FrameReader,
    pub(super) sequence: SequenceCounter,
    /// When the last byte came.
    pub(super) heard: Instant,
    /// Frames held back on their way out and in, each with the emulator's time at which it is due.
    outgoing: VecDeque<(Duration, RawFrame)>,
    incoming: VecDeque<(Duration, RawFrame)>,
}

/// Bytes came, none are there now, or the link is gone for this reason.
pub(super) enum ReadOutcome {
    Some,
    Nothing,
    Gone(&'static str),
}

impl Link {
    /// A link on a fresh connection.
    pub(super) fn new(stream: TcpStream) -> std::io::Result<Self> {
        stream.set_nodelay(true)?;
        stream.set_nonblocking(true)?;
        Ok(Self {
            stream,
            reader: FrameReader::new(),
            sequence: SequenceCounter::new(),
            heard: Instant::now(),
            outgoing: VecDeque::new(),
            incoming: VecDeque::new(),
        })
    }

    /// Makes one read into the frame reader.
    pub(super) fn read(&mut self) -> ReadOutcome {
        match self.reader.read_from(&mut self.stream) {
            Ok(0) => ReadOutcome::Gone("the client closed it"),
            Ok(_) => {
                self.heard = Instant::now();
                ReadOutcome::Some
            }
            Err(error) => match error.kind() {
                ErrorKind::WouldBlock | ErrorKind::Interrupted => ReadOutcome::Nothing,
                ErrorKind::ConnectionReset => ReadOutcome::Gone("the client reset it"),
                _ => ReadOutcome::Gone("the socket gave an error on reading"),
            },
        }
    }

    /// Sends a frame in one write.
    pub(super) fn write(&mut self, bytes: &[u8]) -> Result<(), &'static str> {
        loop {
            return match self.stream.write(bytes) {
                Ok(count) if count == bytes.len() => Ok(()),
                Ok(_) => Err("the client does not read: a frame found no room"),
                Err(error) => match error.kind() {
                    ErrorKind::Interrupted => continue,
                    ErrorKind::WouldBlock => Err("the client does not read: a frame found no room"),
                    _ => Err("the client closed it"),
                },
            };
        }
    }

    pub(super) fn hold_outgoing(&mut self, due: Duration, raw: RawFrame) {
        hold(&mut self.outgoing, due, raw);
    }

    pub(super) fn hold_incoming(&mut self, due: Duration, raw: RawFrame) {
        hold(&mut self.incoming, due, raw);
    }

    pub(super) fn due_outgoing(&mut self, now: Duration) -> Option<RawFrame> {
        due(&mut self.outgoing, now)
    }

    pub(super) fn due_incoming(&mut self, now: Duration) -> Option<RawFrame> {
        due(&mut self.incoming, now)
    }

    /// When the next frame held back is due.
    pub(super) fn next_due(&self) -> Option<Duration> {
        [&self.outgoing, &self.incoming].into_iter().filter_map(|queue| queue.front()).map(|(due, _)| *due).min()
    }

    /// Ends the cRIO's side; what the client still sends is read and thrown away for a while.
    pub(super) fn close(self) -> Closing {
        // Fails where the peer is gone already, which is as well.
        let _ = self.stream.shutdown(Shutdown::Write);
        Closing { stream: self.stream, until: Instant::now() + CLOSING }
    }

    /// Cuts the link without a word: the peer sees a reset.
    pub(super) fn cut(self) {
        cut(&self.stream);
    }
}

/// Makes the closing of this connection a reset.
pub(super) fn cut(stream: &TcpStream) {
    // Where the option is refused the connection still closes, with a FIN.
    let _ = socket2::SockRef::from(stream).set_linger(Some(Duration::ZERO));
}

/// A link that is being closed.
pub(super) struct Closing {
    stream: TcpStream,
    until: Instant,
}

impl Closing {
    /// Reads and throws away; true as long as there is something to wait for.
    pub(super) fn goes_on(&mut self) -> bool {
        let mut thrown_away = [0; 1024];
        for _ in 0..16 {
            match self.stream.read(&mut thrown_away) {
                Ok(0) => return false,
                Ok(_) => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => return Instant::now() < self.until,
                Err(_) => return false,
            }
        }
        Instant::now() < self.until
    }
}

/// Keeps the queue sorted by due time, first come first within the same.
fn hold(queue: &mut VecDeque<(Duration, RawFrame)>, due: Duration, raw: RawFrame) {
    let place = queue.partition_point(|(other, _)| *other <= due);
    queue.insert(place, (due, raw));
}

fn due(queue: &mut VecDeque<(Duration, RawFrame)>, now: Duration) -> Option<RawFrame> {
    if queue.front().is_some_and(|(due, _)| *due <= now) {
        return queue.pop_front().map(|(_, raw)| raw);
    }
    None
}
