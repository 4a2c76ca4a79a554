//! WebSocket (RFC 6455), the server's side: handshake and frames; no extensions.

use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use crate::deadline::Within;
use crate::http::Request;

/// Longest message taken from a client (bytes): a subscription has about a hundred.
const LONGEST: usize = 64 * 1024;
/// Suffix with which the key of the handshake is hashed (RFC 6455, 1.3).
const GUID: &str = "258EAFA5-E914-47DA-95CA-C5AB0DC85B11";
/// A frame that has begun must be whole within this, in either direction.
const PATIENCE: Duration = Duration::from_secs(5);

/// Message of a client.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Received {
    /// A text.
    Text(String),
    /// The end, by a close frame or a closed connection.
    Closed,
    /// Nothing for now.
    Nothing,
}

/// An open websocket.
pub(crate) struct WebSocket {
    stream: TcpStream,
    fragments: Vec<u8>,
    /// Time at which the client last sent anything.
    heard: Instant,
    /// Time at which it was last asked whether it is there.
    pinged: Instant,
}

/// Tells whether a request asks for a websocket.
pub(crate) fn is_upgrade(request: &Request) -> bool {
    request.header("upgrade").is_some_and(|to| to.eq_ignore_ascii_case("websocket"))
        && request.header("sec-websocket-key").is_some()
}

impl WebSocket {
    /// Answers the handshake; `protocol` is the one of the offered that is spoken.
    ///
    /// # Errors
    /// The connection ends.
    pub(crate) fn accept(stream: TcpStream, request: &Request, protocol: Option<&str>) -> io::Result<Self> {
        let key = request.header("sec-websocket-key").unwrap_or_default();
        let accept = base64(&sha1(format!("{key}{GUID}").as_bytes()));
        let protocol = protocol.map_or(String::new(), |name| format!("Sec-WebSocket-Protocol: {name}\r\n"));
        let head = format!(
            "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Accept: {accept}\r\n{protocol}\r\n"
        );
        Within::new(&stream, PATIENCE).write_all(head.as_bytes())?;
        let now = Instant::now();
        Ok(WebSocket { stream, fragments: Vec::new(), heard: now, pinged: now })
    }

    /// Sends a text.
    ///
    /// # Errors
    /// The connection ends or takes nothing.
    pub(crate) fn text(&mut self, text: &str) -> io::Result<()> {
        self.send(1, text.as_bytes())
    }

    /// Sends bytes.
    ///
    /// # Errors
    /// As [`WebSocket::text`].
    pub(crate) fn binary(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.send(2, bytes)
    }

    fn send(&mut self, opcode: u8, payload: &[u8]) -> io::Result<()> {
        let mut frame = vec![0x80 | opcode];
        match payload.len() {
            short @ 0..126 => frame.push(short as u8),
            middle @ 126..65_536 => {
                frame.push(126);
                frame.extend_from_slice(&(middle as u16).to_be_bytes());
            }
            long => {
                frame.push(127);
                frame.extend_from_slice(&(long as u64).to_be_bytes());
            }
        }
        frame.extend_from_slice(payload);
        // In one write: a frame in two pieces can wait for an acknowledgement.
        Within::new(&self.stream, PATIENCE).write_all(&frame)
    }

    /// Asks a client that has been silent for a while whether it is still there; every client answers that by itself.
    ///
    /// # Errors
    /// It has been silent for so long, or the connection ends.
    pub(crate) fn keep_alive(&mut self, silence: Duration) -> io::Result<()> {
        let silent = self.heard.elapsed();
        if silent > silence {
            return Err(io::ErrorKind::TimedOut.into());
        }
        let between = silence / 4;
        if silent > between && self.pinged.elapsed() > between {
            self.pinged = Instant::now();
            self.send(9, b"")?;
        }
        Ok(())
    }

    /// Takes what the client sent, waiting no longer than `most` for it to begin.
    ///
    /// # Errors
    /// The connection fails, or what comes breaks the protocol.
    pub(crate) fn receive(&mut self, most: Duration) -> io::Result<Received> {
        self.stream.set_read_timeout(Some(most.max(Duration::from_millis(1))))?;
        let mut first = [0; 1];
        match self.stream.read(&mut first) {
            Ok(0) => return Ok(Received::Closed),
            Ok(_) => {}
            Err(e) if [io::ErrorKind::WouldBlock, io::ErrorKind::TimedOut].contains(&e.kind()) => {
                return Ok(Received::Nothing);
            }
            Err(e) => return Err(e),
        }
        self.heard = Instant::now();
        let payload = payload(&mut Within::new(&self.stream, PATIENCE))?;
        let (last, opcode) = (first[0] & 0x80 != 0, first[0] & 0x0f);
        match opcode {
            0..=2 => {
                if self.fragments.len() + payload.len() > LONGEST {
                    return Err(broken("a message is too long"));
                }
                self.fragments.extend_from_slice(&payload);
                if !last {
                    return Ok(Received::Nothing);
                }
                let whole = std::mem::take(&mut self.fragments);
                Ok(Received::Text(String::from_utf8_lossy(&whole).into_owned()))
            }
            8 => {
                let _ = self.send(8, payload.get(..2).unwrap_or_default());
                Ok(Received::Closed)
            }
            9 => {
                self.send(10, &payload)?;
                Ok(Received::Nothing)
            }
            10 => Ok(Received::Nothing),
            _ => Err(broken("an unknown kind of frame")),
        }
    }
}

/// The rest of a frame whose first byte was read.
fn payload(from: &mut impl Read) -> io::Result<Vec<u8>> {
    let mut head = [0; 1];
    from.read_exact(&mut head)?;
    if head[0] & 0x80 == 0 {
        return Err(broken("a client's frame must be masked"));
    }
    let length = match head[0] & 0x7f {
        126 => {
            let mut more = [0; 2];
            from.read_exact(&mut more)?;
            usize::from(u16::from_be_bytes(more))
        }
        127 => return Err(broken("a frame is too long")),
        short => usize::from(short),
    };
    if length > LONGEST {
        return Err(broken("a frame is too long"));
    }
    let (mut mask, mut payload) = ([0; 4], vec![0; length]);
    from.read_exact(&mut mask)?;
    from.read_exact(&mut payload)?;
    for (byte, mask) in payload.iter_mut().zip(mask.iter().cycle()) {
        *byte ^= mask;
    }
    Ok(payload)
}

fn broken(what: &'static str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, what)
}

/// SHA-1 (RFC 3174), which the handshake asks for; it guards nothing here.
fn sha1(message: &[u8]) -> [u8; 20] {
    let mut state: [u32; 5] = [0x6745_2301, 0xefcd_ab89, 0x98ba_dcfe, 0x1032_5476, 0xc3d2_e1f0];
    let mut padded = message.to_vec();
    padded.push(0x80);
    padded.resize((padded.len() + 8).next_multiple_of(64) - 8, 0);
    padded.extend_from_slice(&(message.len() as u64 * 8).to_be_bytes());
    let (blocks, _) = padded.as_chunks::<64>();
    for block in blocks {
        let mut words = [0_u32; 80];
        let (given, _) = block.as_chunks::<4>();
        for (word, bytes) in words.iter_mut().zip(given) {
            *word = u32::from_be_bytes(*bytes);
        }
        for at in 16..80 {
            words[at] = (words[at - 3] ^ words[at - 8] ^ words[at - 14] ^ words[at - 16]).rotate_left(1);
        }
        let [mut a, mut b, mut c, mut d, mut e] = state;
        for (at, word) in words.into_iter().enumerate() {
            let (mixed, constant) = match at / 20 {
                0 => (b & c | !b & d, 0x5a82_7999),
                1 => (b ^ c ^ d, 0x6ed9_eba1),
                2 => (b & c | b & d | c & d, 0x8f1b_bcdc),
                _ => (b ^ c ^ d, 0xca62_c1d6_u32),
            };
            let next = a.rotate_left(5).wrapping_add(mixed).wrapping_add(e).wrapping_add(constant).wrapping_add(word);
            (e, d, c, b, a) = (d, c, b.rotate_left(30), a, next);
        }
        for (sum, add) in state.iter_mut().zip([a, b, c, d, e]) {
            *sum = sum.wrapping_add(add);
        }
    }
    let mut digest = [0; 20];
    for (bytes, word) in digest.chunks_exact_mut(4).zip(state) {
        bytes.copy_from_slice(&word.to_be_bytes());
    }
    digest
}

/// Base 64 (RFC 4648) with padding.
pub(crate) fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let at = |index: usize| u32::from(chunk.get(index).copied().unwrap_or(0));
        let word = at(0) << 16 | at(1) << 8 | at(2);
        for place in 0..4 {
            let letter = LETTERS.get((word >> (18 - 6 * place) & 63) as usize).copied().unwrap_or(b'A');
            out.push(if place <= chunk.len() { char::from(letter) } else { '=' });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hex(bytes: &[u8]) -> String {
        bytes.iter().map(|byte| format!("{byte:02x}")).collect()
    }

    #[test]
    fn the_hash_and_the_handshake_are_those_of_the_standards() {
        // RFC 3174, section 7.3, tests 1 and 2; RFC 6455, section 1.3.
        assert_eq!(hex(&sha1(b"abc")), "a9993e364706816aba3e25717850c26c9cd0d89d");
        let long = b"abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq";
        assert_eq!(hex(&sha1(long)), "84983e441c3bd26ebaae4aa1f95129e5e54670f1");
        assert_eq!(base64(&sha1(format!("dGhlIHNhbXBsZSBub25jZQ=={GUID}").as_bytes())), "s3pPLMBiTxaQ9kYGzzhZRbK+xOo=");
    }
}
