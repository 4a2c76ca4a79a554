//! The little of HTTP/1.1 that viewers need: one GET per connection, headers of a few kB, no body.

use std::io::{self, Read, Write};
use std::net::IpAddr;

/// Longest head of a request (bytes).
const LONGEST_HEAD: usize = 8 * 1024;

/// A request without a body.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Request {
    pub(crate) method: String,
    /// Path without its query.
    pub(crate) path: String,
    headers: Vec<(String, String)>,
}

impl Request {
    /// Reads a request's head; what follows it (nothing, from an honest client) is dropped.
    ///
    /// # Errors
    /// The connection ends or stalls, or what comes is no request.
    pub(crate) fn read(from: &mut impl Read) -> io::Result<Self> {
        let (mut head, mut byte) = (Vec::new(), [0; 1]);
        // Byte by byte: what follows the head of a websocket's request must stay in the socket.
        while !head.ends_with(b"\r\n\r\n") {
            if head.len() >= LONGEST_HEAD {
                return Err(io::Error::new(io::ErrorKind::InvalidData, "the request's head is too long"));
            }
            from.read_exact(&mut byte)?;
            head.extend_from_slice(&byte);
        }
        Self::parse(&String::from_utf8_lossy(&head))
            .ok_or_else(|| io::Error::new(io::ErrorKind::InvalidData, "no HTTP request"))
    }

    fn parse(head: &str) -> Option<Self> {
        let mut lines = head.split("\r\n");
        let mut first = lines.next()?.split(' ');
        let (method, target, version) = (first.next()?, first.next()?, first.next()?);
        if !version.starts_with("HTTP/1.") || !target.starts_with('/') || first.next().is_some() {
            return None;
        }
        let headers = lines.take_while(|line| !line.is_empty()).map(|line| {
            line.split_once(':').map(|(name, value)| (name.trim().to_ascii_lowercase(), value.trim().to_owned()))
        });
        let path = target.split(['?', '#']).next().unwrap_or("/").to_owned();
        Some(Request { method: method.to_owned(), path, headers: headers.collect::<Option<_>>()? })
    }

    /// A header's value, whatever the case of its name.
    pub(crate) fn header(&self, name: &str) -> Option<&str> {
        self.headers.iter().find(|(known, _)| known == name).map(|(_, value)| value.as_str())
    }

    /// Tells whether it was asked for by an address or as `localhost`, and not under the name of some web site that points
    /// here: pages of others must not read what a viewer on this machine may.
    pub(crate) fn names_this_machine(&self) -> bool {
        let host = self.header("host").unwrap_or_default();
        let name = match host.strip_prefix('[') {
            Some(rest) => rest.split(']').next().unwrap_or_default(),
            None => host.split(':').next().unwrap_or_default(),
        };
        name.eq_ignore_ascii_case("localhost") || name.parse::<IpAddr>().is_ok()
    }
}

/// Writes a whole answer and asks for the connection to be closed.
pub(crate) fn respond(to: &mut impl Write, status: &str, media_type: &str, body: &[u8]) -> io::Result<()> {
    let head = format!(
        "HTTP/1.1 {status}\r\nContent-Type: {media_type}\r\nContent-Length: {}\r\nCache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\nConnection: close\r\n\r\n",
        body.len()
    );
    to.write_all(head.as_bytes())?;
    to.write_all(body)
}

/// Begins an answer of server-sent events.
pub(crate) fn begin_events(to: &mut impl Write) -> io::Result<()> {
    to.write_all(
        b"HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\nCache-Control: no-store\r\nConnection: close\r\n\r\n",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request(text: &str) -> io::Result<Request> {
        Request::read(&mut text.as_bytes())
    }

    #[test]
    fn requests_are_read_and_nonsense_is_refused() {
        let read = request("GET /metrics?x=1 HTTP/1.1\r\nHost: 127.0.0.1:8050\r\nUPGRADE: WebSocket\r\n\r\n").unwrap();
        assert_eq!((read.method.as_str(), read.path.as_str()), ("GET", "/metrics"));
        assert_eq!((read.header("upgrade"), read.header("none")), (Some("WebSocket"), None));
        for wrong in
            ["", "GET /", "GET / FTP/1\r\n\r\n", "GET x HTTP/1.1\r\n\r\n", "GET / HTTP/1.1\r\nno colon\r\n\r\n"]
        {
            assert!(request(wrong).is_err(), "{wrong:?}");
        }
        let long = format!("GET / HTTP/1.1\r\nA: {}\r\n\r\n", "x".repeat(LONGEST_HEAD));
        assert!(request(&long).is_err());
    }

    #[test]
    fn only_this_machines_own_names_count() {
        let under =
            |host: &str| request(&format!("GET / HTTP/1.1\r\nHost: {host}\r\n\r\n")).unwrap().names_this_machine();
        assert!(["127.0.0.1:8050", "localhost", "LOCALHOST:1", "[::1]:8050", "192.168.1.2"].into_iter().all(under));
        assert!(!["evil.example", "127.0.0.1.evil.example:80", ""].into_iter().any(under));
    }
}
