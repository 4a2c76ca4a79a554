//! Frames out of a byte stream that comes split and joined in any way.
//!
//! A fixed buffer takes what a read gives; [`FrameReader::next_frame`] takes frames out of it until
//! it says there is none. A frame with a wrong CRC or an unknown code is dropped, reported and
//! counted, and reading goes on behind it. Wrong magic, version, type or length is the end: the same
//! error comes back until [`FrameReader::reset`], for a new link.
//!
//! ```
//! use proto::wire::{Frame, FrameReader, Hello};
//! let bytes = Hello::new(1, 0, 42, "daemon").encode();
//! let mut reader = FrameReader::new();
//! assert_eq!(reader.push(&bytes[..30]), 30);
//! assert!(matches!(reader.next_frame(), Ok(None)));
//! reader.push(&bytes[30..]);
//! let received = reader.next_frame().unwrap().unwrap();
//! assert!(matches!(received.frame, Frame::Hello(hello) if hello.session == 42));
//! assert_eq!(received.raw.as_bytes(), bytes);
//! ```

use std::io::{self, Read};

use super::error::{Damage, WireError};
use super::frame::{Frame, RawFrame, check_header, decode_whole};

/// Bytes the buffer holds: 64 of the longest frames, over a second of readings.
const CAPACITY: usize = 4096;

/// A frame and the bytes it came as.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Received {
    /// The frame.
    pub frame: Frame,
    /// Bytes, for the recording.
    pub raw: RawFrame,
}

/// Takes frames out of a byte stream.
///
/// # Real-time
/// Allocates nothing; every call ends within the buffer's 4096 bytes. May run in the tick.
#[derive(Debug, Clone)]
pub struct FrameReader {
    buffer: [u8; CAPACITY],
    // Bytes start..end wait to be read; 0 <= start <= end <= CAPACITY.
    start: usize,
    end: usize,
    fatal: Option<Damage>,
    dropped: u64,
}

impl FrameReader {
    /// A reader at the start of a stream.
    #[must_use]
    pub const fn new() -> Self {
        Self { buffer: [0; CAPACITY], start: 0, end: 0, fatal: None, dropped: 0 }
    }

    /// Starts a new stream: what waits, a fatal error and the count of dropped frames are forgotten.
    pub const fn reset(&mut self) {
        self.start = 0;
        self.end = 0;
        self.fatal = None;
        self.dropped = 0;
    }

    /// Recoverably damaged frames dropped since the stream began.
    #[must_use]
    pub const fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Bytes that wait to be read: a frame not yet whole, or frames not yet taken.
    #[must_use]
    pub const fn waiting(&self) -> usize {
        self.end.saturating_sub(self.start)
    }

    /// Where the next read may put bytes; never empty once [`Self::next_frame`] said `None` or fatal.
    ///
    /// Tell [`Self::filled`] how many came.
    pub fn space(&mut self) -> &mut [u8] {
        self.compact();
        self.buffer.get_mut(self.end..).unwrap_or(&mut [])
    }

    /// Counts in `count` bytes that a read put at the start of [`Self::space`].
    pub fn filled(&mut self, count: usize) {
        self.end = self.end.saturating_add(count).min(CAPACITY);
    }

    /// Copies bytes in and says how many found room; all do up to 4032 once `next_frame` said `None`.
    pub fn push(&mut self, bytes: &[u8]) -> usize {
        let space = self.space();
        let count = bytes.len().min(space.len());
        for (to, from) in space.iter_mut().zip(bytes) {
            *to = *from;
        }
        self.filled(count);
        count
    }

    /// Makes one read from `source`; `Ok(0)` is the end of the stream.
    ///
    /// # Errors
    /// The source's error; `StorageFull` where frames were not taken out and no room is left.
    pub fn read_from(&mut self, source: &mut impl Read) -> io::Result<usize> {
        let space = self.space();
        if space.is_empty() {
            return Err(io::ErrorKind::StorageFull.into());
        }
        let count = source.read(space)?;
        self.filled(count);
        Ok(count)
    }

    /// The next whole frame, `Ok(None)` where more bytes are needed.
    ///
    /// # Errors
    /// [`Damage`]: recoverable, one frame was dropped and the next call goes on behind it; or fatal
    /// (`is_fatal`), every later call gives the same and the link must be closed.
    pub fn next_frame(&mut self) -> Result<Option<Received>, Damage> {
        if let Some(damage) = self.fatal {
            self.discard();
            return Err(damage);
        }
        let waiting = self.buffer.get(self.start..self.end).unwrap_or(&[]);
        let kind = match check_header(waiting) {
            Ok(Some(kind)) => kind,
            Ok(None) => return Ok(None),
            Err(error) => return Err(self.fail(error)),
        };
        let Some(bytes) = waiting.get(..kind.length()) else {
            return Ok(None);
        };
        let raw = RawFrame::of(bytes);
        let frame = decode_whole(kind, bytes);
        self.start = self.start.saturating_add(kind.length()).min(self.end);
        match frame {
            Ok(frame) => Ok(Some(Received { frame, raw })),
            Err(error) => {
                self.dropped = self.dropped.saturating_add(1);
                Err(Damage { error, raw })
            }
        }
    }

    fn fail(&mut self, error: WireError) -> Damage {
        let raw = RawFrame::of(self.buffer.get(self.start..self.end).unwrap_or(&[]));
        let damage = Damage { error, raw };
        self.fatal = Some(damage);
        self.discard();
        damage
    }

    const fn discard(&mut self) {
        self.start = 0;
        self.end = 0;
    }

    /// Moves what waits to the front: less than one frame once `next_frame` said `None`.
    fn compact(&mut self) {
        if self.start > 0 {
            self.buffer.copy_within(self.start..self.end, 0);
            self.end = self.end.saturating_sub(self.start);
            self.start = 0;
        }
    }
}

impl Default for FrameReader {
    fn default() -> Self {
        Self::new()
    }
}
