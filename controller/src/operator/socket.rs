//! The operator's Unix socket: many clients at once, none of which can hold another.
//!
//! One thread looks at all connections in turn and waits for none. A request has [`REQUEST_TIME`] to come whole; what
//! takes time, the tick's effect or a file, is asked for and looked at again ([`crate::operator::desk`]). Where more clients come
//! than there are places, the one that has been silent longest goes, so that a disarming always gets its place. Whoever
//! closes the connection before the answer withdraws the request.

use std::io::{self, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};

use crate::operator::bound_socket::BoundSocket;
use crate::operator::desk::{Desk, DeskOptions, Pending, Step};
use crate::operator::operator_protocol::{MOST_REQUEST_BYTES, REQUEST_TIME};
use crate::operator::peer::Peer;

pub use crate::operator::bound_socket::check_sockets;
pub use crate::operator::desk::May;
pub use crate::operator::operator_protocol::{Ask, Reply, SocketError, Switch, ask, is_there};
pub use crate::operator::running::Running;

/// Time in which a client keeps its place whatever comes: long enough to connect and then send a request.
const FRESH: Duration = Duration::from_millis(50);
/// Clients at once.
const MOST_CLIENTS: usize = 64;
/// Bytes of all requests that are still coming; memory is locked, so it is bounded.
const MOST_BYTES: usize = 2 * MOST_REQUEST_BYTES;
/// Time that an answer may take to be read.
const ANSWER_TIME: Duration = Duration::from_millis(1000);
/// Between two looks at what the tick does, while somebody waits for it.
const LOOK: Duration = Duration::from_millis(5);
/// Between two looks at the stop flag, while nobody does.
const IDLE: Duration = Duration::from_millis(100);
/// Time that the thread may take to end; nothing in it waits, so only a machine that hangs takes longer.
const END: Duration = Duration::from_secs(2);

/// The socket's thread.
pub struct Served(JoinHandle<()>);

impl Served {
    /// Waits, for a bounded time, for the thread, which removes the socket and ends once the daemon's stop flag is set.
    pub fn join(self) {
        let until = Instant::now() + END;
        while !self.0.is_finished() && Instant::now() < until {
            std::thread::sleep(LOOK);
        }
    }
}

/// Makes the socket and answers on it until `stop` is set.
///
/// # Errors
/// If it cannot be made, another daemon answers on it, or something that is no socket has its name.
pub fn serve(path: &Path, options: DeskOptions, stop: Arc<AtomicBool>) -> Result<Served, SocketError> {
    let socket = BoundSocket::bind(path)?;
    let mut server = Server { socket, desk: Desk::new(options), clients: Vec::new() };
    let serve = move || {
        while !stop.load(Ordering::Relaxed) {
            server.turn();
        }
        server.socket.remove();
    };
    let thread = std::thread::Builder::new().name("ctl".to_owned()).spawn(serve);
    Ok(Served(thread.map_err(|source| SocketError::Make { path: path.to_owned(), source })?))
}

/// A connection.
struct Client {
    stream: UnixStream,
    peer: Peer,
    stage: Stage,
}

/// Stage of a connection.
enum Stage {
    /// The request is coming.
    Reading { input: Vec<u8>, since: Instant },
    /// The tick has been asked.
    Waiting(Pending),
    /// The answer is going.
    Writing { output: Vec<u8>, sent: usize, since: Instant },
    /// It is over.
    Closed,
}

struct Server {
    socket: BoundSocket,
    desk: Desk,
    clients: Vec<Client>,
}

impl Server {
    /// One look at everything, after waiting for something to happen.
    fn turn(&mut self) {
        self.wait();
        if let Some(line) = self.socket.look_after() {
            self.desk.tell(line);
        }
        self.desk.take_reloads();
        self.desk.look_after_reach();
        self.desk.look_after_experiments();
        self.desk.tell_viewers();
        // A new client is read at once: what it has sent already counts before it could lose its place.
        for _ in 0..MOST_CLIENTS {
            if !self.has_room() {
                break;
            }
            let Ok(stream) = self.socket.accept() else { break };
            if stream.set_nonblocking(true).is_err() {
                continue;
            }
            let peer = Peer::of(&stream);
            let stage = Stage::Reading { input: Vec::new(), since: Instant::now() };
            let mut client = Client { stream, peer, stage };
            let coming = self.bytes_coming();
            client.step(&mut self.desk, coming);
            self.clients.push(client);
        }
        for number in 0..self.clients.len() {
            let coming = self.bytes_coming();
            if let Some(client) = self.clients.get_mut(number) {
                client.step(&mut self.desk, coming);
            }
        }
        self.clients.retain(|client| !matches!(client.stage, Stage::Closed));
    }

    fn wait(&self) {
        let waits = self.clients.iter().any(|client| matches!(client.stage, Stage::Waiting(_)));
        let full = self.clients.len() >= MOST_CLIENTS;
        let time = if waits || full { LOOK } else { IDLE };
        // Whoever comes while there is no place is no reason to look again at once.
        let coming = if full { PollFlags::empty() } else { PollFlags::IN };
        let mut fds = vec![PollFd::new(&self.socket, coming)];
        for client in &self.clients {
            let flags = match client.stage {
                Stage::Reading { .. } => PollFlags::IN,
                Stage::Writing { .. } => PollFlags::OUT,
                // A client that hangs up is reported in any case.
                Stage::Waiting(_) | Stage::Closed => PollFlags::empty(),
            };
            fds.push(PollFd::new(&client.stream, flags));
        }
        let time = Timespec { tv_sec: 0, tv_nsec: time.subsec_nanos().into() };
        if poll(&mut fds, Some(&time)).is_err() {
            // Interrupted, or no memory for it: the turn goes on, but never in a circle without a pause.
            std::thread::sleep(LOOK);
        }
    }

    /// Tells whether there is a place. Where all are taken the client goes that has not sent or read for longest; one that has
    /// only just come or waits for the tick keeps its own, and whoever comes next waits in the socket's queue.
    fn has_room(&mut self) -> bool {
        if self.clients.len() < MOST_CLIENTS {
            return true;
        }
        let silent = |client: &Client| match &client.stage {
            Stage::Reading { since, .. } | Stage::Writing { since, .. } => {
                Some(*since).filter(|since| since.elapsed() > FRESH)
            }
            Stage::Waiting(_) | Stage::Closed => None,
        };
        let oldest = self.clients.iter().enumerate().filter_map(|(n, c)| Some((silent(c)?, n))).min();
        oldest.map(|(_, number)| self.clients.swap_remove(number)).is_some()
    }

    fn bytes_coming(&self) -> usize {
        let coming = |client: &Client| match &client.stage {
            Stage::Reading { input, .. } => input.len(),
            _ => 0,
        };
        self.clients.iter().map(coming).sum()
    }
}

impl Client {
    /// Goes on as far as it can without waiting; `coming` bytes of requests are held already.
    fn step(&mut self, desk: &mut Desk, coming: usize) {
        if matches!(self.stage, Stage::Reading { .. }) {
            self.read(desk, coming);
        }
        if matches!(self.stage, Stage::Waiting(_)) {
            self.look(desk);
        }
        if matches!(self.stage, Stage::Writing { .. }) {
            self.write();
        }
    }

    fn read(&mut self, desk: &mut Desk, coming: usize) {
        let Stage::Reading { input, since } = &mut self.stage else { return };
        let mut piece = [0; 16 * 1024];
        let mut room = MOST_BYTES.saturating_sub(coming);
        let whole = loop {
            // The request's end is looked for in what is new only.
            match self.stream.read(&mut piece) {
                Ok(0) => {
                    self.stage = Stage::Closed;
                    return;
                }
                Ok(n) => {
                    let new = piece.get(..n).unwrap_or_default();
                    if let Some(end) = new.iter().position(|byte| *byte == b'\n') {
                        input.extend_from_slice(new.get(..end).unwrap_or_default());
                        break true;
                    }
                    input.extend_from_slice(new);
                    room = room.saturating_sub(n);
                    if input.len() > MOST_REQUEST_BYTES || room == 0 {
                        break false;
                    }
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {
                    if since.elapsed() < REQUEST_TIME {
                        return;
                    }
                    let why = format!("the request did not come whole within {} ms", REQUEST_TIME.as_millis());
                    let reply = desk.refuse(&why);
                    return self.answer(&reply);
                }
                Err(_) => {
                    self.stage = Stage::Closed;
                    return;
                }
            }
        };
        if !whole {
            let reply = desk.refuse("the request is longer than this socket takes");
            return self.answer(&reply);
        }
        let line = std::mem::take(input);
        // Whoever has already left gets nothing done.
        if self.has_left() {
            self.stage = Stage::Closed;
            return;
        }
        match desk.begin(&line, self.peer) {
            Step::Done(reply) => self.answer(&reply),
            Step::Pending(pending) => self.stage = Stage::Waiting(pending),
        }
    }

    fn look(&mut self, desk: &mut Desk) {
        let left = self.has_left();
        let Stage::Waiting(pending) = std::mem::replace(&mut self.stage, Stage::Closed) else { return };
        if left {
            return desk.gone(pending);
        }
        match desk.look(pending) {
            Step::Done(reply) => self.answer(&reply),
            Step::Pending(pending) => self.stage = Stage::Waiting(pending),
        }
    }

    /// Tells whether the other end is closed for good; one that has only ended its own sending still waits for the answer.
    fn has_left(&self) -> bool {
        let mut fds = [PollFd::new(&self.stream, PollFlags::empty())];
        let now = Timespec { tv_sec: 0, tv_nsec: 0 };
        let polled = poll(&mut fds, Some(&now));
        let [fd] = &fds;
        polled.is_ok() && fd.revents().intersects(PollFlags::HUP | PollFlags::ERR)
    }

    fn answer(&mut self, reply: &Reply) {
        // A reply is plain data; there is nothing in it that JSON cannot hold.
        let mut output = serde_json::to_vec(reply).unwrap_or_default();
        output.push(b'\n');
        self.stage = Stage::Writing { output, sent: 0, since: Instant::now() };
    }

    fn write(&mut self) {
        let Stage::Writing { output, sent, since } = &mut self.stage else { return };
        while let Some(rest) = output.get(*sent..).filter(|rest| !rest.is_empty()) {
            match self.stream.write(rest) {
                Ok(n) => *sent += n,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) if error.kind() == io::ErrorKind::WouldBlock && since.elapsed() < ANSWER_TIME => return,
                Err(_) => break,
            }
        }
        self.stage = Stage::Closed;
    }
}
