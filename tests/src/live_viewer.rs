//! `controller live` beside a running daemon, asked as its viewers ask it. Everything here fails by panicking.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::laboratory::Laboratory;
use crate::{Running, Stream};

/// Longest wait for a line or an answer on a busy machine.
pub const PATIENCE: Duration = Duration::from_secs(60);

/// A viewer's server for a laboratory's daemon, and the address at which it listens.
///
/// # Panics
/// If it does not start.
pub fn start(laboratory: &Laboratory) -> (Running, String) {
    let live = Running::start(&mut laboratory.command(&["live", "--listen", "127.0.0.1:0"]));
    let line = live.line(Stream::Out, "http://", PATIENCE);
    let address = line.split("http://").nth(1).and_then(|rest| rest.split('/').next()).expect("an address").to_owned();
    (live, address)
}

fn ask(address: &str, host: &str, request: &str) -> TcpStream {
    let mut socket = TcpStream::connect(address).expect("a server");
    socket.set_read_timeout(Some(PATIENCE)).expect("a socket");
    socket.write_all(format!("{request} HTTP/1.1\r\nHost: {host}\r\n\r\n").as_bytes()).expect("a request");
    socket
}

/// The whole answer to a request, made under the name of a host.
///
/// # Panics
/// If none comes.
pub fn get(address: &str, host: &str, request: &str) -> String {
    let mut answer = String::new();
    ask(address, host, request).read_to_string(&mut answer).expect("an answer");
    answer
}

/// A sample of the metrics by its name and labels.
///
/// # Panics
/// If the metrics do not come.
pub fn sample(address: &str, name: &str) -> Option<f64> {
    let text = get(address, address, "GET /metrics");
    let line = text.lines().find(|line| line.strip_prefix(name).is_some_and(|rest| rest.starts_with(' ')))?.to_owned();
    line.rsplit_once(' ')?.1.parse().ok()
}

/// The first picture that a page is sent.
///
/// # Panics
/// If none comes.
pub fn picture(address: &str) -> Value {
    let lines = BufReader::new(ask(address, address, "GET /events")).lines();
    let data = lines.map(|line| line.expect("a picture")).find(|line| line.starts_with("data: ")).expect("a picture");
    serde_json::from_str(data.trim_start_matches("data: ")).expect("an object")
}

/// Waits until something is so.
///
/// # Panics
/// If it is not in time.
pub fn wait_for(what: &str, mut done: impl FnMut() -> bool) {
    let until = Instant::now() + PATIENCE;
    while !done() {
        assert!(Instant::now() < until, "{what}");
        std::thread::sleep(Duration::from_millis(100));
    }
}
