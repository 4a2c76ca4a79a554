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
use crate::rotation::{Destination, OneTape, Rotating, TapeSource};
use crate::sink::{Event, Queues, RecordSink};
use crate::tape::{McapTape, Tape};
use crate::writing::{State, Writing};

pub use noter::Noter;
pub use recorder_health::RecorderHealth;

/// Ticks that the queue holds unless told otherwise: 82 s, 2 MiB.
pub const CAPACITY: usize = 4_096;
/// Events that the queue holds.
const EVENTS: usize = 256;
/// Notes that other threads may have waiting; further ones are counted.
const NOTES: usize = 1_024;
/// How long the disk may work on one thing at the end of a recording before it counts as one that hangs.
const HANGS: Duration = Duration::from_secs(4);
/// How long the end of a recording may take altogether.
const FINISH: Duration = Duration::from_secs(15);
/// Between two looks at the end's progress.
const LOOK: Duration = Duration::from_millis(100);
/// What the recorder's observer sees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Recorded<'a> {
    /// A tick.
    Tick(&'a TickRecord),
    /// An event or a note, as text.
    Event {
        /// Daemon's monotonic clock (ns).
        at_ns: u64,
        /// How much it matters.
        level: EventLevel,
        /// Which part speaks.
        part: &'a str,
        /// What happened.
        message: &'a str,
    },
}

/// Sees every tick and event, on the recorder's thread.
pub type Observer = Box<dyn FnMut(Recorded<'_>) + Send>;

/// How a recorder runs.
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

/// What a finished recorder leaves.
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
mod tests {
    use super::*;
    use proto::recording::WriteMcapError;
    use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
    use std::sync::{Arc, Mutex};

    /// What a tape in memory was given, one word each.
    type Log = Arc<Mutex<Vec<String>>>;

    /// A tape in memory that can be slow or fail.
    struct Memory {
        log: Log,
        /// Each tick waits for a permit; a gone sender permits everything.
        permits: Option<Receiver<()>>,
        /// Fails at this tick number and ever after.
        full_at: Option<u32>,
        finish_fails: bool,
    }

    fn full(path: &str) -> RecordError {
        // ENOSPC
        WriteMcapError::Write { path: path.into(), source: std::io::Error::from_raw_os_error(28) }.into()
    }

    impl Tape for Memory {
        fn tick(&mut self, tick: &TickRecord) -> Result<(), RecordError> {
            if let Some(permits) = &self.permits {
                let _ = permits.recv();
            }
            if self.full_at.is_some_and(|at| tick.tick >= at) {
                return Err(full("run.mcap"));
            }
            self.log.lock().unwrap().push(tick.tick.to_string());
            Ok(())
        }

        fn event(&mut self, _: u64, _: EventLevel, part: &str, message: &str) -> Result<(), RecordError> {
            self.log.lock().unwrap().push(format!("{part}:{message}"));
            Ok(())
        }

        fn attach(&mut self, _: &Attachment) -> Result<(), RecordError> {
            Ok(())
        }

        fn flush(&mut self) -> Result<(), RecordError> {
            Ok(())
        }

        fn check(&mut self) -> Result<(), RecordError> {
            Ok(())
        }

        fn bytes(&self) -> u64 {
            0
        }

        fn finish(self: Box<Self>) -> Result<PathBuf, RecordError> {
            if self.finish_fails { Err(full("run.mcap")) } else { Ok(PathBuf::from("run.mcap")) }
        }
    }

    fn memory() -> (Memory, Log) {
        let log = Log::default();
        (Memory { log: log.clone(), permits: None, full_at: None, finish_fails: false }, log)
    }

    fn slow() -> (Memory, Log, SyncSender<()>) {
        let (permit, permits) = sync_channel(100);
        let (tape, log) = memory();
        (Memory { permits: Some(permits), ..tape }, log, permit)
    }

    fn start(tape: Memory, capacity: usize) -> (Recorder, RecordSink) {
        let text = |event: &Event| format!("code {} {}", event.code, event.values[0]);
        let options = RecorderOptions { capacity, ..RecorderOptions::new(text) };
        Recorder::with_tape(Box::new(tape), PathBuf::from("run.partial.mcap"), options).unwrap()
    }

    fn tick(number: u32) -> TickRecord {
        TickRecord { tick: number, ..TickRecord::default() }
    }

    fn wait_until(what: &str, mut done: impl FnMut() -> bool) {
        let start = Instant::now();
        while !done() {
            // Far longer than the thread's 5 ms, for a machine that is busy.
            assert!(start.elapsed() < Duration::from_secs(20), "{what}");
            thread::sleep(Duration::from_millis(1));
        }
    }

    #[test]
    fn everything_pushed_before_the_end_is_written_in_order_with_events_where_they_were_said() {
        let (tape, log) = memory();
        let (recorder, mut sink) = start(tape, 1_000);
        let mut expected = Vec::new();
        for k in 0..500 {
            assert!(sink.push(&tick(k)));
            expected.push(k.to_string());
            if k % 7 == 3 {
                let values = [f64::from(k), 0.0, 0.0, 0.0];
                assert!(sink.event(Event { at_ns: 0, level: EventLevel::Info, part: "p", code: 9, values }));
                expected.push(format!("p:code 9 {k}"));
            }
        }
        let done = recorder.finish().unwrap();
        assert_eq!(*log.lock().unwrap(), expected);
        assert_eq!((done.ticks, done.events, done.ticks_dropped, done.events_dropped), (500, 71, 0, 0));
        assert!(!sink.push(&tick(500)) && sink.dropped() == 1, "after the end nothing is taken");
    }

    #[test]
    fn a_disk_that_stalls_costs_ticks_but_never_time() {
        let (tape, log, permit) = slow();
        let (recorder, mut sink) = start(tape, 8);
        // The thread takes one tick off the queue and hangs in it.
        assert!(sink.push(&tick(0)));
        wait_until("the thread takes the tick", || sink.room() == 8);
        let begun = Instant::now();
        let taken = (1..=20).filter(|k| sink.push(&tick(*k))).count();
        // 20 copies of 500 bytes take microseconds; a second is there only for a machine that stalls.
        assert!(begun.elapsed() < Duration::from_secs(1), "{:?}", begun.elapsed());
        assert_eq!((taken, sink.dropped()), (8, 12));
        assert!(recorder.health().healthy(), "slow is not broken");
        drop(permit);
        let done = recorder.finish().unwrap();
        assert_eq!((done.ticks, done.ticks_dropped), (9, 12));
        assert_eq!(log.lock().unwrap().len(), 9);
    }

    #[test]
    fn a_full_disk_is_told_once_and_the_queue_still_empties() {
        let (tape, _) = memory();
        let (recorder, mut sink) = start(Memory { full_at: Some(3), ..tape }, 16);
        let health = recorder.health();
        for k in 0..200 {
            wait_until("room in the queue", || sink.room() > 0);
            assert!(sink.push(&tick(k)));
        }
        wait_until("all taken", || health.ticks_lost() == 197);
        assert!(!health.healthy());
        let told = health.error().unwrap();
        assert!(told.starts_with("run.mcap: cannot write the recording: No space left on device"), "{told}");
        assert_eq!((health.ticks_written(), health.ticks_dropped()), (3, 0));
        let error = recorder.finish().unwrap_err().to_string();
        assert!(error.starts_with(&told) && error.ends_with("(3 ticks written, 197 lost)"), "{error}");
        assert!(!error.contains('\n'));
    }

    #[test]
    fn a_file_that_cannot_be_finished_is_told() {
        let (tape, _) = memory();
        let (recorder, mut sink) = start(Memory { finish_fails: true, ..tape }, 16);
        assert!(sink.push(&tick(0)));
        let health = recorder.health();
        let error = recorder.finish().unwrap_err();
        assert!(matches!(error, RecordError::Incomplete { written: 1, lost: 0, .. }), "{error}");
        assert!(!health.healthy() && health.error().is_some());
    }

    #[test]
    fn the_observer_sees_everything_although_the_disk_is_full() {
        let seen = Log::default();
        let log = seen.clone();
        let (tape, _) = memory();
        let options = RecorderOptions::new(|event| format!("code {}", event.code)).observer(move |what| {
            log.lock().unwrap().push(match what {
                Recorded::Tick(tick) => tick.tick.to_string(),
                Recorded::Event { message, .. } => message.to_owned(),
            });
        });
        let tape = Memory { full_at: Some(0), ..tape };
        let (recorder, mut sink) = Recorder::with_tape(Box::new(tape), PathBuf::new(), options).unwrap();
        sink.push(&tick(0));
        sink.event(Event { at_ns: 0, level: EventLevel::Info, part: "p", code: 5, values: [0.0; 4] });
        sink.push(&tick(1));
        recorder.note(0, EventLevel::Info, "socket", "armed");
        assert!(recorder.finish().is_err());
        let mut seen = seen.lock().unwrap().clone();
        // The note comes from another queue: it may stand anywhere.
        seen.retain(|entry| entry != "armed");
        assert_eq!(seen, ["0", "code 5", "1"]);
    }

    #[test]
    fn a_panic_in_the_observer_ends_the_thread_and_is_told() {
        let (tape, _) = memory();
        let options = RecorderOptions::new(|_| String::new()).observer(|_| panic!("on purpose"));
        let (recorder, mut sink) =
            Recorder::with_tape(Box::new(tape), PathBuf::from("run.partial.mcap"), options).unwrap();
        sink.push(&tick(0));
        assert!(matches!(recorder.finish(), Err(RecordError::Died { .. })));
        // Nobody empties the queue now; the tick does not mind.
        assert!((0..10_000).any(|k| !sink.push(&tick(k))));
    }
}
