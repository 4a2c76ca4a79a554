//! The way to a cRIO: its name is looked up, and its addresses are tried.
//!
//! The look-up has a thread of its own. A name server that does not answer holds whoever asks for 10 s, two of them for
//! 20 s. The tick's thread must not stand still for so long: it takes what operators ask for, systemd's watchdog is beaten
//! only while it goes on, and the program ends with it. A daemon that the watchdog starts again has forgotten what waits
//! for a person. The look-up has the priority and the CPUs of any program, whoever begins it: it reads files, and what a name
//! server sends.

use std::io;
use std::net::{SocketAddr, TcpStream, ToSocketAddrs};
use std::thread::JoinHandle;
use std::time::Duration;

use socket2::{Domain, Protocol, SockRef, Socket, TcpKeepalive, Type};

use super::{HANDSHAKE, LinkError};
use crate::machine::realtime::step_back;

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
        let name = address.to_owned();
        Self::begin_by(address, move || name.to_socket_addrs().map(Iterator::collect))
    }

    /// Begins to look up `host:port` in this way.
    ///
    /// # Errors
    /// As [`Self::begin`].
    pub(crate) fn begin_by(
        address: &str,
        look: impl FnOnce() -> io::Result<Vec<SocketAddr>> + Send + 'static,
    ) -> Result<Self, LinkError> {
        let address = address.to_owned();
        let look_up = move || {
            step_back();
            look()
        };
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

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use rustix::thread::sched_getaffinity;
    use thread_priority::{NormalThreadSchedulePolicy, ThreadSchedulePolicy, thread_schedule_policy};

    use super::*;
    use crate::config::Realtime;
    use crate::machine::realtime::make_realtime;

    /// Begun by a thread with the tick's kind of priority, and with the tick's CPU.
    #[test]
    fn a_look_up_has_the_priority_and_the_cpus_of_any_program() {
        let found = Arc::new(Mutex::new(None));
        let noted = Arc::clone(&found);
        let allowed = sched_getaffinity(None).unwrap();
        let begun = std::thread::spawn(move || {
            // A priority that is refused is not inherited either; the CPU needs no right.
            let refused = make_realtime(&Realtime { priority: 1, ..Realtime::default() });
            refused.iter().for_each(|line| eprintln!("{line}"));
            let own = sched_getaffinity(None).unwrap();
            let look = move || {
                *noted.lock().unwrap() = Some((thread_schedule_policy().unwrap(), sched_getaffinity(None).unwrap()));
                Ok(Vec::new())
            };
            LookUp::begin_by("crio:1", look).unwrap().addresses().unwrap();
            own
        });
        assert_eq!(begun.join().unwrap().count(), 1);
        let ordinary = ThreadSchedulePolicy::Normal(NormalThreadSchedulePolicy::Other);
        assert_eq!(*found.lock().unwrap(), Some((ordinary, allowed)));
    }
}
