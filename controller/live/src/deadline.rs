//! A connection that has only so long for what is read from it or written to it, however slowly it trickles.

use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

/// A connection until a moment; from then on every read and write fails.
pub(crate) struct Within<'a> {
    stream: &'a TcpStream,
    until: Instant,
}

impl<'a> Within<'a> {
    /// The connection for this long from now.
    pub(crate) fn new(stream: &'a TcpStream, time: Duration) -> Self {
        Within { stream, until: Instant::now() + time }
    }

    /// Rest of the time.
    fn left(&self) -> io::Result<Duration> {
        let left = self.until.saturating_duration_since(Instant::now());
        if left.is_zero() { Err(io::ErrorKind::TimedOut.into()) } else { Ok(left) }
    }
}

impl Read for Within<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        self.stream.set_read_timeout(Some(self.left()?))?;
        self.stream.read(bytes)
    }
}

impl Write for Within<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.stream.set_write_timeout(Some(self.left()?))?;
        self.stream.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.stream.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::TcpListener;

    #[test]
    fn bytes_that_trickle_do_not_lengthen_the_time() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let mut client = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let (stream, _) = listener.accept().unwrap();
        let trickle = std::thread::spawn(move || {
            while client.write_all(b"x").is_ok() {
                std::thread::sleep(Duration::from_millis(10));
            }
        });
        let (begun, time) = (Instant::now(), Duration::from_millis(200));
        let read = Within::new(&stream, time).read_exact(&mut vec![0; 1 << 20]);
        assert!(read.is_err() && begun.elapsed() >= time, "{read:?} after {:?}", begun.elapsed());
        drop(stream);
        trickle.join().unwrap();
    }
}
