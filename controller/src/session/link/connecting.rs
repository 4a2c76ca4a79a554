//! The way to a cRIO: its name is looked up, and its addresses are tried.
//!
//! The look-up has a thread of its own. A name server that does not answer holds whoever asks for 10 s, two of them for
//! 20 s. The tick's thread must not stand still for so long: it takes what operators ask for, systemd's watchdog is beaten
//! only while it goes on, and the program ends with it. A daemon that the watchdog starts again has forgotten what waits
//! for a person. The look-up has the priority of the thread that begins it; no session is open meanwhile that it could
//! hold up.

use std::io;
use std::net::{SocketAddr, TcpStream, ToSocketAddrs};
use std::thread::JoinHandle;
use std::time::Duration;

use socket2::{Domain, Protocol, SockRef, Socket, TcpKeepalive, Type};

use super::{HANDSHAKE, LinkError};

/// Room for commands that the cRIO has not read yet, in bytes; the kernel doubles it. A second or two of them, so that a
/// cRIO that stopped reading is noticed.
const SEND_BUFFER: usize = 4096;

/// Addresses that are tried, one of each family: whoever ends the daemon, and its watchdog, wait for all of them.
const MOST_TRIED: usize = 2;

/// A look-up of a cRIO's addresses.
#[derive(Debug)]
pub(crate) struct LookUp {
    address: String,
    thread: JoinHandle<io::Result<Vec<SocketAddr>>>,
}

impl LookUp {
    /// Begins to look up `host:port`.
    ///
    /// # Errors
    /// If the system gives no thread.
    ///
    /// # Real-time
    /// Not for the tick: it allocates.
    pub(crate) fn begin(address: &str) -> Result<Self, LinkError> {
        let (address, name) = (address.to_owned(), address.to_owned());
        let look_up = move || name.to_socket_addrs().map(Iterator::collect);
        match std::thread::Builder::new().name("look-up".to_owned()).spawn(look_up) {
            Ok(thread) => Ok(LookUp { address, thread }),
            Err(source) => Err(LinkError::Resolve { address, source }),
        }
    }

    /// Tells whether the answer is there.
    pub(crate) fn is_over(&self) -> bool {
        self.thread.is_finished()
    }

    /// Addresses that were found; waits for them where the answer is not there yet.
    ///
    /// # Errors
    /// The name is not known, or nobody who knows names answers.
    pub(crate) fn addresses(self) -> Result<Vec<SocketAddr>, LinkError> {
        let LookUp { address, thread } = self;
        let found = thread.join().unwrap_or_else(|_| Err(io::Error::other("the look-up ended early")));
        found.map_err(|source| LinkError::Resolve { address, source })
    }
}

/// Connects to the first of these addresses that answers, of the first [`MOST_TRIED`]; each has a second.
pub(super) fn connect(address: &str, candidates: &[SocketAddr]) -> Result<TcpStream, LinkError> {
    let mut last = io::Error::from(io::ErrorKind::AddrNotAvailable);
    for candidate in candidates.iter().take(MOST_TRIED) {
        match connect_to(*candidate) {
            Ok(stream) => return Ok(stream),
            Err(error) => last = error,
        }
    }
    Err(LinkError::Connect { address: address.to_owned(), source: last })
}

fn connect_to(address: SocketAddr) -> io::Result<TcpStream> {
    let socket = Socket::new(Domain::for_address(address), Type::STREAM, Some(Protocol::TCP))?;
    socket.connect_timeout(&address.into(), HANDSHAKE)?;
    // With Nagle's algorithm on, a frame can wait 40 ms for an acknowledgement.
    socket.set_tcp_nodelay(true)?;
    socket.set_send_buffer_size(SEND_BUFFER)?;
    let stream: TcpStream = socket.into();
    // A cRIO that lost its power says nothing; without probes the link would look alive for hours.
    let keepalive = TcpKeepalive::new().with_time(Duration::from_secs(1)).with_interval(Duration::from_secs(1));
    SockRef::from(&stream).set_tcp_keepalive(&keepalive)?;
    stream.set_nonblocking(true)?;
    Ok(stream)
}
