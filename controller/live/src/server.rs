//! Connections: a thread each, a bounded number, none of which can hold up another.

use std::io::{self, Write};
use std::net::{SocketAddr, TcpListener, TcpStream, ToSocketAddrs};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use crate::foxglove;
use crate::http::{Request, begin_events, respond};
use crate::hub::Hub;
use crate::metrics;
use crate::state_json::{Cursor, news};
use crate::websocket::{WebSocket, is_upgrade};

/// Viewers at a time; one more is told so.
const MOST_VIEWERS: usize = 32;
/// How long a request may take to come, and an answer to go.
const PATIENCE: Duration = Duration::from_secs(5);
/// Between two pictures of a page: as fast as eyes follow numbers.
const PICTURE: Duration = Duration::from_millis(100);
/// A page that hears nothing for this long is sent the age of what it shows.
const SILENCE: Duration = Duration::from_secs(1);

/// Why there is no server.
#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    /// The address is none.
    #[error("--listen {address}: {source}; write host:port, such as 127.0.0.1:8050")]
    Address {
        /// As given.
        address: String,
        /// What the system said.
        source: io::Error,
    },
    /// It cannot be listened on.
    #[error("--listen {address}: {source}; is another program listening there?")]
    Listen {
        /// As given.
        address: String,
        /// What the system said.
        source: io::Error,
    },
}

/// A server that listens.
pub struct Server {
    listener: TcpListener,
    hub: Arc<Hub>,
    /// Reached from this machine only.
    loopback: bool,
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
        Ok(Server { listener, hub, loopback: at.ip().is_loopback() })
    }

    /// Where it listens.
    ///
    /// # Errors
    /// What the system says.
    pub fn local_addr(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    /// Whether it can be reached from this machine only.
    pub fn is_loopback(&self) -> bool {
        self.loopback
    }

    /// Serves viewers until told to stop.
    pub fn run(&self, stop: &Arc<AtomicBool>) {
        let viewers = Arc::new(AtomicUsize::new(0));
        while !stop.load(Ordering::Relaxed) {
            let Ok((stream, _)) = self.listener.accept() else {
                std::thread::sleep(Duration::from_millis(10));
                continue;
            };
            if viewers.fetch_add(1, Ordering::Relaxed) >= MOST_VIEWERS {
                viewers.fetch_sub(1, Ordering::Relaxed);
                refuse(stream);
                continue;
            }
            let (hub, stop, own) = (Arc::clone(&self.hub), Arc::clone(stop), Arc::clone(&viewers));
            let loopback = self.loopback;
            let spawned = std::thread::Builder::new().name("viewer".to_owned()).spawn(move || {
                // A viewer that goes away in the middle is its own trouble.
                let _ = serve(stream, &hub, loopback, &stop);
                own.fetch_sub(1, Ordering::Relaxed);
            });
            if spawned.is_err() {
                viewers.fetch_sub(1, Ordering::Relaxed);
            }
        }
    }
}

fn refuse(mut stream: TcpStream) {
    let _ = stream.set_nonblocking(false);
    let _ = stream.set_write_timeout(Some(PATIENCE));
    let _ = respond(&mut stream, "503 Service Unavailable", "text/plain", b"too many viewers; close one\n");
}

fn serve(mut stream: TcpStream, hub: &Arc<Hub>, loopback: bool, stop: &AtomicBool) -> io::Result<()> {
    stream.set_nonblocking(false)?;
    stream.set_nodelay(true)?;
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.set_write_timeout(Some(PATIENCE))?;
    let request = match Request::read(&mut stream) {
        Ok(request) => request,
        Err(error) => {
            return respond(&mut stream, "400 Bad Request", "text/plain", format!("{error}\n").as_bytes());
        }
    };
    if loopback && !request.names_this_machine() {
        return respond(&mut stream, "403 Forbidden", "text/plain", b"ask by address or as localhost\n");
    }
    if is_upgrade(&request) {
        return match request.header("sec-websocket-protocol").and_then(foxglove::choose) {
            Some(protocol) => foxglove::serve(WebSocket::accept(stream, &request, Some(protocol))?, hub, stop),
            None => respond(
                &mut stream,
                "400 Bad Request",
                "text/plain",
                b"speak foxglove.sdk.v1 or foxglove.websocket.v1\n",
            ),
        };
    }
    if request.method != "GET" {
        return respond(&mut stream, "405 Method Not Allowed", "text/plain", b"read-only: GET\n");
    }
    const HTML: &str = "text/html; charset=utf-8";
    match request.path.as_str() {
        "/" | "/index.html" => respond(&mut stream, "200 OK", HTML, include_bytes!("page.html")),
        "/metrics" => {
            let text = metrics::text(hub);
            respond(&mut stream, "200 OK", "text/plain; version=0.0.4; charset=utf-8", text.as_bytes())
        }
        "/layout.json" => respond(&mut stream, "200 OK", "application/json", include_bytes!("layout.json")),
        "/events" => events(stream, hub, stop),
        _ => {
            respond(&mut stream, "404 Not Found", "text/plain", b"/, /metrics, /events, /layout.json, or a websocket\n")
        }
    }
}

/// Server-sent events until the page goes.
fn events(mut stream: TcpStream, hub: &Arc<Hub>, stop: &AtomicBool) -> io::Result<()> {
    begin_events(&mut stream)?;
    let mut cursor = Cursor::default();
    while !stop.load(Ordering::Relaxed) {
        let begun = Instant::now();
        let known = hub.wait(cursor.next, cursor.edition.unwrap_or(u64::MAX), SILENCE);
        let picture = news(hub, &known, &mut cursor);
        drop(known);
        stream.write_all(format!("data: {picture}\n\n").as_bytes())?;
        std::thread::sleep(PICTURE.saturating_sub(begun.elapsed().min(PICTURE)).max(Duration::from_millis(20)));
    }
    Ok(())
}
