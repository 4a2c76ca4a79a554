//! Ticks to an MCAP file, a second at a time.
//!
//! # What is in the file
//! | topic | message | when |
//! | --- | --- | --- |
//! | `/tick` | `pneumatic.Tick`: readings, references, predictions, law, duties, codes, timings | every tick |
//! | `/sense` | `pneumatic.Frame`: the SENSE frame as received | ticks with a frame |
//! | `/command` | `pneumatic.Frame`: the COMMAND frame as sent | ticks with a command |
//! | `/event` | `foxglove.Log`: what a person should know | when something happens |
//!
//! First come a metadata record `recording` (who wrote it, when, with what policy and seed) and the
//! attachments (configuration, rig): they are there even when the end of the file is not.
//! Messages of one tick share their MCAP sequence number.
//!
//! # Why Protocol Buffers and not JSON
//! Foxglove plots both. PlotJuggler picks a parser by the channel's message encoding, then by the
//! schema's, and has both; but JSON knows no NaN (a broken sensor's reading) and its parser drops
//! what is null, so a gap would be drawn as a straight line, and a NaN's payload or a −0.0 would not
//! come back. Protocol Buffers keep every bit, at a third of the size and without formatting
//! numbers. Three things PlotJuggler needs besides: a schema on every channel (it skips those
//! without), publish time equal to log time (it plots over publish time unless told otherwise), and
//! numbers instead of enums (it shows enums as text). All three hold here.
//!
//! # Why uncompressed
//! 60 s are 1.7 MB, an hour 103 MB. The bytes are mostly the noise of floating-point numbers:
//! compressing each one-second chunk with zstd (level 3) would save 46 %, with LZ4 38 %, for a C
//! library in the build and for work on the core beside the real-time thread.
//!
//! # What a crash leaves
//! While it is written the file is called `name.partial.mcap`: the ending stays, so every tool opens
//! it as it is, and the name says that its end is missing. [`RecordingWriter::flush`] ends the chunk
//! and brings it to the disk; what came before the last flush survives a power cut, and
//! [`read_mcap`](super::read_mcap) reads it. [`RecordingWriter::finish`] writes the index and gives
//! the file its name.
//!
//! # Real-time
//! Nothing here belongs into the tick: every call may allocate, block and touch the disk.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

use mcap::records::MessageHeader;
use mcap::write::NoSeek;
use mcap::{McapError, WriteOptions, Writer};

use super::log_clock::LogClock;
use super::recording_info::{Attachment, RecordingInfo};
use super::schema::{self, Log};
use super::tick::TickRecord;
use super::wall_clock;
use crate::atomic_file::{self, AtomicFileError};

/// A chunk ends here even when nobody flushes, so that memory stays bounded (bytes).
const CHUNK_BYTES: u64 = 1 << 20;

/// Topics of a recording.
pub(crate) mod topic {
    pub(in super::super) const TICK: &str = "/tick";
    pub(in super::super) const SENSE: &str = "/sense";
    pub(in super::super) const COMMAND: &str = "/command";
    pub(in super::super) const EVENT: &str = "/event";
}

/// Weight of an event.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EventLevel {
    /// Worth keeping.
    Info,
    /// Worth a look.
    Warning,
    /// Something failed.
    Error,
}

impl EventLevel {
    /// The number that a `foxglove.Log` carries.
    pub(crate) const fn code(self) -> u64 {
        match self {
            Self::Info => 2,
            Self::Warning => 3,
            Self::Error => 4,
        }
    }

    /// The level of such a number; what is below a warning is worth keeping, what is above an error has failed.
    pub(crate) const fn from_code(code: u64) -> Self {
        match code {
            0..=2 => Self::Info,
            3 => Self::Warning,
            _ => Self::Error,
        }
    }
}

/// Something that a person should know, with its time.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Event {
    /// Wall clock (ns since 1970).
    pub unix_ns: u64,
    /// Weight.
    pub level: EventLevel,
    /// Which part speaks, for example `link`.
    pub part: String,
    /// One plain sentence on the event.
    pub message: String,
}

/// The part that speaks the last word of a recording; as an error it says that the flight did not come to its end.
pub const VERDICT: &str = "verdict";

/// Why a recording cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteMcapError {
    /// The file is there already.
    #[error("{}: a recording of that name is there already; it is never written over", .path.display())]
    Exists {
        /// The file in the way.
        path: PathBuf,
    },
    /// The file cannot be created.
    #[error("{}: cannot create the recording: {source}", .path.display())]
    Create {
        /// The file.
        path: PathBuf,
        /// Error of the system.
        source: io::Error,
    },
    /// Writing failed, most often because the disk is full.
    #[error("{}: cannot write the recording: {source}; what was flushed before is kept", .path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Error of the system.
        source: io::Error,
    },
    /// The MCAP library refused.
    #[error("{}: cannot write the recording: {source}", .path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// Error of the library.
        source: McapError,
    },
    /// The finished file cannot get its name.
    #[error(transparent)]
    Rename(#[from] AtomicFileError),
}

/// Name of a recording while it is written: `run.mcap` is `run.partial.mcap`.
pub fn unfinished_path(path: &Path) -> PathBuf {
    path.with_extension("partial.mcap")
}

/// Channel numbers in the file.
#[derive(Debug, Clone, Copy)]
struct Channels {
    tick: u16,
    sense: u16,
    command: u16,
    event: u16,
}

/// An MCAP file that is being written.
///
/// Dropped without [`finish`](RecordingWriter::finish), it leaves `name.partial.mcap`.
pub struct RecordingWriter {
    writer: Writer<NoSeek<BufWriter<File>>>,
    // The same open file again: the library owns the one it writes to, and only a file can be synced.
    file: File,
    path: PathBuf,
    channels: Channels,
    clock: LogClock,
    sequence: u32,
    // Reused for every message.
    message: Vec<u8>,
}

impl std::fmt::Debug for RecordingWriter {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RecordingWriter")
            .field("path", &self.path)
            .field("ticks", &self.sequence)
            .finish_non_exhaustive()
    }
}

impl RecordingWriter {
    /// Creates `name.partial.mcap` beside `path`, with the metadata and attachments on the disk.
    ///
    /// # Errors
    /// `path` or the partial file is there already, the folder is missing or not writable.
    pub fn create(path: &Path, info: &RecordingInfo, attachments: &[Attachment]) -> Result<Self, WriteMcapError> {
        let partial = unfinished_path(path);
        if path.exists() {
            return Err(WriteMcapError::Exists { path: path.to_owned() });
        }
        // Readable by the group, never by all: what a rig does is the lab's own business.
        let opened = OpenOptions::new().write(true).create_new(true).mode(0o640).open(&partial);
        let create = |source| WriteMcapError::Create { path: partial.clone(), source };
        let file = opened.map_err(|source| match source.kind() {
            io::ErrorKind::AlreadyExists => WriteMcapError::Exists { path: partial.clone() },
            _ => create(source),
        })?;
        let second = file.try_clone().map_err(create)?;
        let write = |source| write_error(&partial, source);
        let mut writer = WriteOptions::new()
            .library(concat!("proto/", env!("CARGO_PKG_VERSION")))
            .chunk_size(Some(CHUNK_BYTES))
            // A chunk is put together in memory and written in one piece: a crash then leaves whole
            // chunks, not a chunk whose length was to be filled in later.
            .disable_seeking(true)
            .create(NoSeek::new(BufWriter::new(file)))
            .map_err(write)?;
        let unix_ns = wall_clock::unix_ns(info.started);
        writer.write_metadata(&info.metadata()).map_err(write)?;
        for attachment in attachments {
            writer.attach(&as_mcap(attachment, unix_ns)).map_err(write)?;
        }
        let channels = add_channels(&mut writer).map_err(write)?;
        let clock = LogClock::new(info);
        let mut this = Self {
            writer,
            file: second,
            path: path.to_owned(),
            channels,
            clock,
            sequence: 0,
            message: Vec::with_capacity(1_024),
        };
        // Schemas and channels become a chunk of their own: no later damage can take them away.
        this.flush()?;
        Ok(this)
    }

    /// Adds a tick.
    ///
    /// # Errors
    /// The file cannot be written; then no later call succeeds either.
    pub fn write(&mut self, tick: &TickRecord) -> Result<(), WriteMcapError> {
        let at = self.clock.at(tick);
        self.sequence = self.sequence.wrapping_add(1);
        if tick.sense_present {
            self.message.clear();
            schema::encode_frame(&tick.sense, &mut self.message);
            self.put(self.channels.sense, at)?;
        }
        if tick.command_present {
            self.message.clear();
            schema::encode_frame(&tick.command, &mut self.message);
            self.put(self.channels.command, at)?;
        }
        // Last, so that a reader who has a tick has its frames.
        self.message.clear();
        schema::encode_tick(tick, &mut self.message);
        self.put(self.channels.tick, at)
    }

    /// Adds an event at a moment of the daemon's monotonic clock (ns).
    ///
    /// In lockstep the event stands at the last tick written.
    ///
    /// # Errors
    /// As [`RecordingWriter::write`].
    pub fn event(&mut self, at_ns: u64, level: EventLevel, part: &str, message: &str) -> Result<(), WriteMcapError> {
        let unix_ns = self.clock.moment(at_ns);
        let log = Log { unix_ns, level: level.code(), message: message.to_owned(), name: part.to_owned() };
        self.message.clear();
        log.encode(&mut self.message);
        self.put(self.channels.event, unix_ns)
    }

    /// Puts a file inside, as of the last tick written.
    ///
    /// # Errors
    /// As [`RecordingWriter::write`].
    pub fn attach(&mut self, attachment: &Attachment) -> Result<(), WriteMcapError> {
        let unix_ns = wall_clock::unix_ns(std::time::SystemTime::now());
        self.writer.attach(&as_mcap(attachment, unix_ns)).map_err(|source| write_error(&self.path, source))
    }

    /// Ends the chunk and waits until it is on the disk; once a second is enough.
    ///
    /// # Errors
    /// The file cannot be written or synced.
    pub fn flush(&mut self) -> Result<(), WriteMcapError> {
        self.writer.flush().map_err(|source| write_error(&self.path, source))?;
        self.file.sync_data().map_err(|source| WriteMcapError::Write { path: self.path.clone(), source })
    }

    /// Ticks written so far (wraps at 2³²).
    pub fn ticks(&self) -> u32 {
        self.sequence
    }

    /// Writes the index, syncs, and gives the file its name, which it returns.
    ///
    /// # Errors
    /// The file cannot be written, synced or renamed; the partial file is then still there.
    pub fn finish(mut self) -> Result<PathBuf, WriteMcapError> {
        self.writer.finish().map_err(|source| write_error(&self.path, source))?;
        self.file.sync_all().map_err(|source| WriteMcapError::Write { path: self.path.clone(), source })?;
        atomic_file::rename_synced(&unfinished_path(&self.path), &self.path)?;
        Ok(self.path.clone())
    }

    fn put(&mut self, channel_id: u16, at: u64) -> Result<(), WriteMcapError> {
        let header = MessageHeader { channel_id, sequence: self.sequence, log_time: at, publish_time: at };
        self.writer.write_to_known_channel(&header, &self.message).map_err(|source| write_error(&self.path, source))
    }
}

fn add_channels(writer: &mut Writer<NoSeek<BufWriter<File>>>) -> Result<Channels, McapError> {
    const ENCODING: &str = "protobuf";
    let pneumatic = schema::pneumatic_schema();
    let tick = writer.add_schema(schema::TICK, ENCODING, &pneumatic)?;
    let frame = writer.add_schema(schema::FRAME, ENCODING, &pneumatic)?;
    let log = writer.add_schema(schema::LOG, ENCODING, &schema::log_schema())?;
    let none = BTreeMap::new();
    Ok(Channels {
        tick: writer.add_channel(tick, topic::TICK, ENCODING, &none)?,
        sense: writer.add_channel(frame, topic::SENSE, ENCODING, &none)?,
        command: writer.add_channel(frame, topic::COMMAND, ENCODING, &none)?,
        event: writer.add_channel(log, topic::EVENT, ENCODING, &none)?,
    })
}

fn as_mcap(attachment: &Attachment, unix_ns: u64) -> mcap::Attachment<'_> {
    mcap::Attachment {
        log_time: unix_ns,
        create_time: unix_ns,
        name: attachment.name.clone(),
        media_type: attachment.media_type.clone(),
        data: attachment.data.as_slice().into(),
    }
}

fn write_error(path: &Path, error: McapError) -> WriteMcapError {
    let path = path.to_owned();
    match error {
        McapError::Io(source) => WriteMcapError::Write { path, source },
        source => WriteMcapError::Format { path, source },
    }
}
