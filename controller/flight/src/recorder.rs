//! The recorder thread: takes what the tick queued and writes it to MCAP files.
//!
//! It wakes every 5 ms, empties the queues, and once a second brings the file to the disk (`fdatasync`). What goes wrong
//! there (a full disk, a removed folder, a file cut short) never reaches the tick: the queues are emptied as before,
//! ticks that cannot be kept are counted, and [`RecorderHealth`] tells at once what is wrong. Recordings in a folder
//! ([`Recorder::start_in`]) go on in another file as soon as that is possible; a single file ends there.
//!
//! An observer sees every tick and event in their order on the recorder's thread, whether the disk works or not:
//! statistics and the live line need no queue of their own. It must not wait for anything.
//!
//! # Orders
//! Ticks stand in the order in which they were queued; an event of the sink stands exactly where it was said.
//! [`Noter::note`], for the other threads, stands near its time.

mod noter;
mod recorder_health;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::PoisonError;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::thread;
use std::time::{Duration, Instant};

use proto::recording::{Attachment, EventLevel, RecordingInfo, RecordingWriter, TickRecord, unfinished_path};

use crate::record_error::RecordError;
use crate::recorder_state::State;
use crate::rotation::{Destination, OneTape, Rotating, TapeSource};
use crate::sink::{Event, Queues, RecordSink};
use crate::tape::{McapTape, Tape};
use crate::writing::Writing;

pub use noter::Noter;
pub use recorder_health::RecorderHealth;

/// Ticks that the queue holds unless told otherwise: 82 s, 2 MiB.
pub const CAPACITY: usize = 4_096;
/// Events that the queue holds.
const EVENTS: usize = 256;
/// Notes that other threads may have waiting; further ones are counted.
const NOTES: usize = 1_024;
/// Time that the disk may work on one thing at the end of a recording before it counts as one that hangs.
const HANGS: Duration = Duration::from_secs(4);
/// Time that the end of a recording may take altogether.
const FINISH: Duration = Duration::from_secs(15);
/// Between two looks at the end's progress.
const LOOK: Duration = Duration::from_millis(100);

/// Item that the recorder's observer sees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Recorded<'a> {
    /// A tick.
    Tick(&'a TickRecord),
    /// An event or a note, as text.
    Event {
        /// Daemon's monotonic clock (ns).
        at_ns: u64,
        /// Importance.
        level: EventLevel,
        /// Part that speaks.
        part: &'a str,
        /// Description of what happened.
        message: &'a str,
    },
}

/// Sees every tick and event, on the recorder's thread.
pub type Observer = Box<dyn FnMut(Recorded<'_>) + Send>;

/// Settings of a recorder.
pub struct RecorderOptions {
    /// Ticks that the queue holds, at 50 per second and about 500 bytes each; at least 1.
    pub capacity: usize,
    /// Turns an event of the tick into one plain sentence.
    pub event_text: fn(&Event) -> String,
    /// Sees everything that passes.
    pub observer: Option<Observer>,
}

impl RecorderOptions {
    /// The usual queue of [`CAPACITY`] ticks, and no observer.
    pub fn new(event_text: fn(&Event) -> String) -> Self {
        Self { capacity: CAPACITY, event_text, observer: None }
    }

    /// With an observer.
    #[must_use]
    pub fn observer(mut self, observer: impl FnMut(Recorded<'_>) + Send + 'static) -> Self {
        self.observer = Some(Box::new(observer));
        self
    }
}

impl std::fmt::Debug for RecorderOptions {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RecorderOptions")
            .field("capacity", &self.capacity)
            .field("observer", &self.observer.is_some())
            .finish_non_exhaustive()
    }
}

/// Account that a finished recorder leaves.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RecordingSummary {
    /// The last finished file; empty where nothing was recorded.
    pub path: PathBuf,
    /// All finished files, in order.
    pub files: Vec<PathBuf>,
    /// Their size (bytes).
    pub bytes: u64,
    /// Ticks in them.
    pub ticks: u64,
    /// Events and notes in them.
    pub events: u64,
    /// Ticks that a full queue refused.
    pub ticks_dropped: u64,
    /// Events that a full queue refused.
    pub events_dropped: u64,
}

/// The recorder; dropped without [`Recorder::finish`], it still finishes its file.
#[derive(Debug)]
pub struct Recorder {
    // `None` once it was waited for.
    ended: Option<Receiver<Result<(), RecordError>>>,
    thread: thread::Thread,
    noter: Noter,
    place: PathBuf,
}

impl Recorder {
    /// Creates a single file and starts the thread.
    ///
    /// The file is `name.partial.mcap` until it is finished.
    ///
    /// # Errors
    /// The file is there already or cannot be made, or the thread cannot be started.
    pub fn start(
        path: &Path,
        info: &RecordingInfo,
        attachments: &[Attachment],
        options: RecorderOptions,
    ) -> Result<(Self, RecordSink), RecordError> {
        let writer = RecordingWriter::create(path, info, attachments)?;
        let partial = unfinished_path(path);
        Self::with_tape(Box::new(McapTape::new(writer, partial.clone())), partial, options)
    }

    /// Starts the thread, which makes a file in the folder with the first tick, and another whenever one is full.
    ///
    /// # Errors
    /// The thread cannot be started. That a file cannot be made shows in [`Recorder::health`].
    pub fn start_in(
        destination: Destination,
        info: &RecordingInfo,
        attachments: &[Attachment],
        options: RecorderOptions,
    ) -> Result<(Self, RecordSink), RecordError> {
        let (info, attachments) = (info.clone(), attachments.to_vec());
        Self::with_source(
            Box::new(Rotating { destination, info, attachments, part: 0, previous: String::new() }),
            options,
        )
    }

    pub(crate) fn with_tape(
        tape: Box<dyn Tape>,
        partial: PathBuf,
        options: RecorderOptions,
    ) -> Result<(Self, RecordSink), RecordError> {
        Self::with_source(Box::new(OneTape { tape: Some(tape), partial }), options)
    }

    fn with_source(source: Box<dyn TapeSource>, options: RecorderOptions) -> Result<(Self, RecordSink), RecordError> {
        let queues = Arc::new(Queues::new(options.capacity, EVENTS));
        let state = Arc::new(State::new(queues.clone()));
        let (notes, inbox) = mpsc::sync_channel(NOTES);
        let place = source.place().to_owned();
        let writing = Writing::new(source, state.clone(), inbox, options);
        let (end, ended) = mpsc::channel();
        let thread = thread::Builder::new()
            .name("rec".to_owned())
            .spawn(move || {
                // Whoever waits may have given up.
                let _ = end.send(writing.run());
            })
            .map_err(|source| RecordError::Thread { source })?;
        let noter = Noter { notes, state };
        Ok((Self { ended: Some(ended), thread: thread.thread().clone(), noter, place }, RecordSink::new(queues)))
    }

    /// A handle that tells how the recorder is doing.
    pub fn health(&self) -> RecorderHealth {
        RecorderHealth { state: self.noter.state.clone() }
    }

    /// A handle that adds texts.
    pub fn noter(&self) -> Noter {
        self.noter.clone()
    }

    /// Has the thread keep other limits from now on; the folder changes with the next file. A single file has none.
    pub fn redirect(&self, destination: Destination) {
        *self.noter.state.redirected.lock().unwrap_or_else(PoisonError::into_inner) = Some(destination);
    }

    /// Adds a text from any thread but the tick's: see [`Noter::note`].
    pub fn note(&self, at_ns: u64, level: EventLevel, part: &'static str, message: impl Into<String>) {
        self.noter.note(at_ns, level, part, message);
    }

    /// Writes all that is queued, finishes the file and gives it its name; gives up on a disk that does not answer.
    ///
    /// Ticks that are pushed from now on may be refused (and are then counted).
    ///
    /// # Errors
    /// The first thing that went wrong since the start, with the ticks that it cost.
    pub fn finish(mut self) -> Result<RecordingSummary, RecordError> {
        self.end()?;
        let state = &self.noter.state;
        let files = state.files.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let bytes = files.iter().filter_map(|file| std::fs::metadata(file).ok()).map(|file| file.len()).sum();
        let count = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        Ok(RecordingSummary {
            path: files.last().cloned().unwrap_or_default(),
            files,
            bytes,
            ticks: count(&state.ticks),
            events: count(&state.events),
            ticks_dropped: count(&state.queues.ticks_dropped),
            events_dropped: count(&state.queues.events_dropped),
        })
    }

    /// Orders the end and waits for it, for a bounded time; does nothing the second time.
    fn end(&mut self) -> Result<(), RecordError> {
        let Some(ended) = self.ended.take() else { return Ok(()) };
        self.noter.state.stop.store(true, Ordering::Release);
        self.thread.unpark();
        let begun = Instant::now();
        loop {
            match ended.recv_timeout(LOOK) {
                Ok(result) => return result,
                Err(RecvTimeoutError::Disconnected) => return Err(RecordError::Died { partial: self.place.clone() }),
                Err(RecvTimeoutError::Timeout) => {
                    let stalled = self.noter.state.stalled();
                    if stalled > HANGS || begun.elapsed() > FINISH {
                        let seconds = stalled.max(begun.elapsed()).as_secs();
                        return Err(RecordError::Hangs { place: self.place.clone(), seconds });
                    }
                }
            }
        }
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        let _ = self.end();
    }
}

#[cfg(test)]
mod tests;
