//! Connections: a thread each, a bounded number, none of which can hold up another.

use std::io::{self, Write};
use std::net::{SocketAddr, TcpListener, TcpStream, ToSocketAddrs};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use crate::deadline::Within;
use crate::foxglove;
use crate::http::{Request, begin_events, respond};
use crate::hub::Hub;
use crate::metrics;
use crate::places::{Arrival, Arrivals, Place};
use crate::state_json::{Cursor, news};
use crate::websocket::{WebSocket, is_upgrade};

/// Pages and websockets at a time, which stay; one more is told so.
const MOST_VIEWERS: usize = 32;
/// Requests under way at a time, beside those who stay: Prometheus and a new page always find a place soon, whoever connects and
/// says nothing.
const MOST_REQUESTS: usize = 32;
/// Time for which a websocket's client may say nothing, pings unanswered, before it is cut off.
const CLIENT_SILENCE: Duration = Duration::from_secs(15);
/// Time that a whole answer or picture may take to go, and usually a whole request to come.
const PATIENCE: Duration = Duration::from_secs(5);
/// Between two pictures of a page: as fast as eyes follow numbers.
const PICTURE: Duration = Duration::from_millis(100);
/// A page that hears nothing for this long is sent the age of what it shows.
const SILENCE: Duration = Duration::from_secs(1);

/// Reason why there is no server.
#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    /// The address is none.
    #[error("--listen {address}: {source}; write host:port, such as 127.0.0.1:8050")]
    Address {
        /// As given.
        address: String,
        /// Error of the system.
        source: io::Error,
    },
    /// It cannot be listened on.
    #[error("--listen {address}: {source}; {}", fix(.source))]
    Listen {
        /// As given.
        address: String,
        /// Error of the system.
        source: io::Error,
    },
}

/// Words for what to do where an address cannot be listened on.
fn fix(error: &io::Error) -> &'static str {
    match error.kind() {
        io::ErrorKind::AddrNotAvailable => "this machine has no such address; 0.0.0.0 stands for all that it has",
        io::ErrorKind::PermissionDenied => "ports below 1024 need rights of their own; take another",
        _ => "is another program listening there?",
    }
}

/// A server that listens.
pub struct Server {
    listener: TcpListener,
    shared: Shared,
}

/// State that all connections share.
#[derive(Clone)]
struct Shared {
    hub: Arc<Hub>,
    /// Names under which it may be asked.
    names: AskedUnder,
    /// Pages and websockets.
    viewers: Arc<AtomicUsize>,
    /// Time for which a websocket's client may say nothing.
    silence: Duration,
    /// Time that a whole request may take to come.
    request_patience: Duration,
}

/// Names under which a server answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum AskedUnder {
    /// An address, or `localhost`: it is reached from this machine only.
    ThisMachine,
    /// Any.
    AnyName,
}

impl Server {
    /// Listens on an address; port 0 takes a free one.
    ///
    /// # Errors
    /// The address is none or taken.
    pub fn bind(address: &str, hub: Arc<Hub>) -> Result<Self, LiveError> {
        let wrong = |source| LiveError::Address { address: address.to_owned(), source };
        let first = address.to_socket_addrs().map_err(wrong)?.next();
        let at = first.ok_or_else(|| wrong(io::ErrorKind::AddrNotAvailable.into()))?;
        let listen = |source| LiveError::Listen { address: address.to_owned(), source };
        let listener = TcpListener::bind(at).map_err(listen)?;
        listener.set_nonblocking(true).map_err(listen)?;
        let names = if at.ip().is_loopback() { AskedUnder::ThisMachine } else { AskedUnder::AnyName };
        let shared =
            Shared { hub, names, viewers: Arc::default(), silence: CLIENT_SILENCE, request_patience: PATIENCE };
        Ok(Server { listener, shared })
    }

    /// Address at which it listens.
    ///
    /// # Errors
    /// The system gives no address.
    pub fn local_addr(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    /// Tells whether it can be reached from this machine only.
    pub fn is_loopback(&self) -> bool {
        self.shared.names == AskedUnder::ThisMachine
    }

    /// Serves viewers until told to stop.
    pub fn run(&self, stop: &Arc<AtomicBool>) {
        let arrivals = Arc::new(Arrivals::new(MOST_REQUESTS));
        while !stop.load(Ordering::Relaxed) {
            let Ok((stream, _)) = self.listener.accept() else {
                std::thread::sleep(Duration::from_millis(10));
                continue;
            };
            // Without a second handle it could not be closed for another; it is closed now.
            let Ok(admitted) = arrivals.admit(&stream) else { continue };
            let Some(arrival) = admitted else {
                let _ = stream.set_nonblocking(false);
                let _ = refuse(&stream);
                continue;
            };
            let (shared, stop) = (self.shared.clone(), Arc::clone(stop));
            // Where no thread can be had the connection is closed, and its place given back.
            let _ = std::thread::Builder::new().name("viewer".to_owned()).spawn(move || {
                // A viewer that goes away in the middle is its own trouble.
                let _ = serve(stream, &shared, arrival, &stop);
            });
        }
    }
}

fn refuse(stream: &TcpStream) -> io::Result<()> {
    answer(stream, "503 Service Unavailable", "text/plain", b"too many viewers; close one\n")
}

fn answer(stream: &TcpStream, status: &str, media_type: &str, body: &[u8]) -> io::Result<()> {
    respond(&mut Within::new(stream, PATIENCE), status, media_type, body)
}

fn serve(stream: TcpStream, shared: &Shared, arrival: Arrival, stop: &AtomicBool) -> io::Result<()> {
    let Shared { hub, names, viewers, silence, request_patience } = shared;
    stream.set_nonblocking(false)?;
    stream.set_nodelay(true)?;
    let request = match Request::read(&mut Within::new(&stream, *request_patience)) {
        Ok(request) => request,
        Err(error) => {
            return answer(&stream, "400 Bad Request", "text/plain", format!("{error}\n").as_bytes());
        }
    };
    // Closed for another in the moment in which it came.
    let Some(request_place) = arrival.has_come() else { return Ok(()) };
    if *names == AskedUnder::ThisMachine && !request.names_this_machine() {
        return answer(&stream, "403 Forbidden", "text/plain", b"ask by address or as localhost\n");
    }
    if is_upgrade(&request) {
        let offered = request.header("sec-websocket-protocol");
        let Some(protocol) = offered.and_then(foxglove::choose) else {
            let help = b"speak foxglove.sdk.v1 or foxglove.websocket.v1\n";
            return answer(&stream, "400 Bad Request", "text/plain", help);
        };
        let Some(_place) = Place::take(viewers, MOST_VIEWERS) else { return refuse(&stream) };
        drop(request_place);
        return foxglove::serve(WebSocket::accept(stream, &request, Some(protocol))?, hub, *silence, stop);
    }
    if request.method != "GET" {
        return answer(&stream, "405 Method Not Allowed", "text/plain", b"read-only: GET\n");
    }
    const HTML: &str = "text/html; charset=utf-8";
    match request.path.as_str() {
        "/" | "/index.html" => answer(&stream, "200 OK", HTML, include_bytes!("page.html")),
        "/metrics" => {
            let text = metrics::text(hub);
            answer(&stream, "200 OK", "text/plain; version=0.0.4; charset=utf-8", text.as_bytes())
        }
        "/layout.json" => answer(&stream, "200 OK", "application/json", include_bytes!("layout.json")),
        "/events" => {
            let Some(_place) = Place::take(viewers, MOST_VIEWERS) else { return refuse(&stream) };
            drop(request_place);
            events(&stream, hub, stop)
        }
        _ => answer(&stream, "404 Not Found", "text/plain", b"/, /metrics, /events, /layout.json, or a websocket\n"),
    }
}

/// Server-sent events until the page goes.
fn events(stream: &TcpStream, hub: &Arc<Hub>, stop: &AtomicBool) -> io::Result<()> {
    begin_events(&mut Within::new(stream, PATIENCE))?;
    let mut cursor = Cursor::default();
    while !stop.load(Ordering::Relaxed) {
        let begun = Instant::now();
        let known = hub.wait(cursor.next, cursor.edition.unwrap_or(u64::MAX), SILENCE);
        let picture = news(hub, &known, &mut cursor);
        drop(known);
        Within::new(stream, PATIENCE).write_all(format!("data: {picture}\n\n").as_bytes())?;
        std::thread::sleep(PICTURE.saturating_sub(begun.elapsed().min(PICTURE)).max(Duration::from_millis(20)));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use flight::CodeNames;
    use std::io::Read;

    /// A server that knows nothing, until it is dropped.
    struct Served {
        address: SocketAddr,
        stop: Arc<AtomicBool>,
    }

    impl Served {
        /// Starts one with this much patience for a silent client.
        fn new(silence: Duration) -> Self {
            Self::with_patience(silence, PATIENCE)
        }

        /// Starts one with this much patience for a silent client, and for one whose request does not come whole.
        fn with_patience(silence: Duration, request_patience: Duration) -> Self {
            let hub = Hub::new(CodeNames { state: |_| "run", fault: |_| "link lost" });
            let mut server = Server::bind("127.0.0.1:0", Arc::new(hub)).unwrap();
            server.shared.silence = silence;
            server.shared.request_patience = request_patience;
            let (address, stop) = (server.local_addr().unwrap(), Arc::new(AtomicBool::new(false)));
            let until = Arc::clone(&stop);
            std::thread::spawn(move || server.run(&until));
            Served { address, stop }
        }

        /// Sends a request and answers what came of it so far.
        fn ask(&self, path: &str, headers: &str) -> (TcpStream, String) {
            let mut stream = TcpStream::connect(self.address).unwrap();
            let request = format!("GET {path} HTTP/1.1\r\nHost: localhost\r\n{headers}\r\n");
            stream.write_all(request.as_bytes()).unwrap();
            let mut first = [0; 16];
            stream.read_exact(&mut first).unwrap();
            (stream, String::from_utf8_lossy(&first).into_owned())
        }

        fn websocket(&self) -> (TcpStream, String) {
            self.ask(
                "/",
                "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n\
                 Sec-WebSocket-Protocol: foxglove.websocket.v1\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n",
            )
        }
    }

    impl Drop for Served {
        fn drop(&mut self) {
            self.stop.store(true, Ordering::Relaxed);
        }
    }

    #[test]
    fn an_address_that_cannot_be_listened_on_is_told_with_what_to_do() {
        let taken = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
        let held = TcpListener::bind(&taken).unwrap();
        // One for documents, which no machine has.
        for (address, words) in [(taken.as_str(), "is another program"), ("192.0.2.1:8050", "has no such address")] {
            let hub = Hub::new(CodeNames { state: |_| "run", fault: |_| "link lost" });
            let said = Server::bind(address, Arc::new(hub)).err().map(|error| error.to_string()).unwrap();
            assert!(said.contains(address) && said.contains(words), "{said}");
        }
        drop(held);
    }

    #[test]
    fn those_who_stay_keep_no_place_from_those_who_come_and_go() {
        let served = Served::new(Duration::from_secs(600));
        let idle: Vec<(TcpStream, String)> = (0..MOST_VIEWERS).map(|_| served.websocket()).collect();
        assert!(idle.iter().all(|(_, answer)| answer.starts_with("HTTP/1.1 101")));
        for path in ["/metrics", "/", "/layout.json"] {
            let (_, answer) = served.ask(path, "");
            assert!(answer.starts_with("HTTP/1.1 200"), "{path}: {answer}");
        }
        for (_, answer) in [served.websocket(), served.ask("/events", "")] {
            assert!(answer.starts_with("HTTP/1.1 503"), "{answer}");
        }
    }

    /// More clients than there are places connect and begin to ask, and one asks.
    #[test]
    fn requests_that_never_come_whole_keep_nobody_from_an_answer() {
        // Nobody's time is over before this test is: what is closed is closed for another.
        let served = Served::with_patience(CLIENT_SILENCE, Duration::from_secs(600));
        let half = |_| {
            let mut stream = TcpStream::connect(served.address).unwrap();
            stream.write_all(b"GET /metrics HTTP/1.1\r\n").unwrap();
            stream
        };
        let mut idle: Vec<TcpStream> = (0..2 * MOST_REQUESTS).map(half).collect();
        let (_, answer) = served.ask("/metrics", "");
        assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
        // The oldest was closed for the others; the newest may go on.
        let mut end = Vec::new();
        let answered = idle[0].read_to_end(&mut end);
        assert!(end.is_empty(), "{answered:?}: {}", String::from_utf8_lossy(&end));
        let newest = idle.last_mut().unwrap();
        newest.write_all(b"Host: localhost\r\n\r\n").unwrap();
        newest.read_to_end(&mut end).unwrap();
        assert!(end.starts_with(b"HTTP/1.1 200"), "{}", String::from_utf8_lossy(&end));
    }

    #[test]
    fn a_websocket_whose_client_answers_no_ping_is_cut_off() {
        let served = Served::new(Duration::from_millis(200));
        let (mut stream, answer) = served.websocket();
        assert!(answer.starts_with("HTTP/1.1 101"), "{answer}");
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        let mut rest = Vec::new();
        stream.read_to_end(&mut rest).unwrap();
        // A ping has no payload here.
        assert!(rest.windows(2).any(|two| two == [0x89, 0]), "it was asked whether it is there");
    }
}
