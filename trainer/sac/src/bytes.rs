//! Numbers as little-endian bytes with a check sum at the end.

use std::io::{self, Read, Write};

/// Why bytes make no sense.
#[derive(Debug)]
pub(crate) enum Malformed {
    Io(io::Error),
    Size,
    Sum,
}

impl From<io::Error> for Malformed {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

/// Floats turned into bytes at a time.
const CHUNK: usize = 4096;

/// Writes and sums up.
pub(crate) struct Sink<W> {
    writer: W,
    sum: crc32fast::Hasher,
    buffer: Vec<u8>,
}

impl<W: Write> Sink<W> {
    pub(crate) fn new(writer: W) -> Self {
        Self { writer, sum: crc32fast::Hasher::new(), buffer: Vec::new() }
    }

    fn bytes(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.sum.update(bytes);
        self.writer.write_all(bytes)
    }

    pub(crate) fn header(&mut self, magic: &[u8; 8], version: u32) -> io::Result<()> {
        self.bytes(magic)?;
        self.bytes(&version.to_le_bytes())
    }

    pub(crate) fn u64(&mut self, x: u64) -> io::Result<()> {
        self.bytes(&x.to_le_bytes())
    }

    /// The floats alone; their number is known otherwise.
    pub(crate) fn floats(&mut self, floats: &[f32]) -> io::Result<()> {
        let mut buffer = std::mem::take(&mut self.buffer);
        for chunk in floats.chunks(CHUNK) {
            buffer.clear();
            chunk.iter().for_each(|x| buffer.extend_from_slice(&x.to_le_bytes()));
            self.bytes(&buffer)?;
        }
        self.buffer = buffer;
        Ok(())
    }

    pub(crate) fn finish(&mut self) -> io::Result<()> {
        let sum = self.sum.clone().finalize();
        self.writer.write_all(&sum.to_le_bytes())?;
        self.writer.flush()
    }
}

/// Reads and sums up.
pub(crate) struct Source<R> {
    reader: R,
    sum: crc32fast::Hasher,
    buffer: Vec<u8>,
}

impl<R: Read> Source<R> {
    pub(crate) fn new(reader: R) -> Self {
        Self { reader, sum: crc32fast::Hasher::new(), buffer: Vec::new() }
    }

    fn bytes<const N: usize>(&mut self) -> Result<[u8; N], Malformed> {
        let mut bytes = [0; N];
        self.reader.read_exact(&mut bytes)?;
        self.sum.update(&bytes);
        Ok(bytes)
    }

    pub(crate) fn header(&mut self) -> Result<([u8; 8], u32), Malformed> {
        Ok((self.bytes()?, u32::from_le_bytes(self.bytes()?)))
    }

    pub(crate) fn u64(&mut self) -> Result<u64, Malformed> {
        Ok(u64::from_le_bytes(self.bytes()?))
    }

    /// A number up to `most`: damage must not make the program ask for all memory.
    pub(crate) fn size(&mut self, most: u64) -> Result<usize, Malformed> {
        match self.u64()? {
            size if size <= most => usize::try_from(size).map_err(|_| Malformed::Size),
            _ => Err(Malformed::Size),
        }
    }

    pub(crate) fn floats(&mut self, floats: &mut [f32]) -> Result<(), Malformed> {
        let mut buffer = std::mem::take(&mut self.buffer);
        for chunk in floats.chunks_mut(CHUNK) {
            buffer.resize(4 * chunk.len(), 0);
            self.reader.read_exact(&mut buffer)?;
            self.sum.update(&buffer);
            for (x, bytes) in chunk.iter_mut().zip(buffer.as_chunks().0) {
                *x = f32::from_le_bytes(*bytes);
            }
        }
        self.buffer = buffer;
        Ok(())
    }

    pub(crate) fn array<const N: usize>(&mut self) -> Result<[f32; N], Malformed> {
        let mut floats = [0.0; N];
        self.floats(&mut floats)?;
        Ok(floats)
    }

    pub(crate) fn some_floats(&mut self, count: usize) -> Result<Vec<f32>, Malformed> {
        let mut floats = vec![0.0; count];
        self.floats(&mut floats)?;
        Ok(floats)
    }

    /// The check sum, and nothing after it.
    pub(crate) fn finish(mut self) -> Result<(), Malformed> {
        let ours = self.sum.clone().finalize();
        let mut theirs = [0; 4];
        self.reader.read_exact(&mut theirs)?;
        let more = self.reader.read(&mut [0])?;
        if u32::from_le_bytes(theirs) != ours || more != 0 { Err(Malformed::Sum) } else { Ok(()) }
    }
}
