//! The recorder's thread: empties the queues onto a tape and syncs it once a second.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::Receiver;
use std::sync::{Arc, OnceLock};
use std::thread;
use std::time::{Duration, Instant};

use proto::recording::{EventLevel, RecordingWriter, TickRecord};

use crate::record_error::RecordError;
use crate::recorder::{Observer, Recorded, RecorderOptions};
use crate::sink::{Event, OrderedEvent, Queues};

/// Between two looks into the queues.
const POLL: Duration = Duration::from_millis(5);
/// Between two syncs of the file.
const FLUSH: Duration = Duration::from_secs(1);

/// What the thread and the recorder's handles share.
#[derive(Debug)]
pub(crate) struct State {
    pub(crate) queues: Arc<Queues>,
    /// The order to finish.
    pub(crate) stop: AtomicBool,
    pub(crate) failed: AtomicBool,
    /// The first error, set once.
    pub(crate) error: OnceLock<String>,
    pub(crate) ticks: AtomicU64,
    pub(crate) events: AtomicU64,
    pub(crate) lost: AtomicU64,
}

impl State {
    pub(crate) fn new(queues: Arc<Queues>) -> Self {
        Self {
            queues,
            stop: AtomicBool::new(false),
            failed: AtomicBool::new(false),
            error: OnceLock::new(),
            ticks: AtomicU64::new(0),
            events: AtomicU64::new(0),
            lost: AtomicU64::new(0),
        }
    }
}

/// A text of another thread than the tick.
pub(crate) struct Note {
    pub(crate) at_ns: u64,
    pub(crate) level: EventLevel,
    pub(crate) part: &'static str,
    pub(crate) message: String,
}

/// Where ticks go: a file, or what tests put in its place.
pub(crate) trait Tape: Send {
    fn tick(&mut self, tick: &TickRecord) -> Result<(), RecordError>;
    fn event(&mut self, at_ns: u64, level: EventLevel, part: &str, message: &str) -> Result<(), RecordError>;
    fn flush(&mut self) -> Result<(), RecordError>;
    fn finish(self: Box<Self>) -> Result<PathBuf, RecordError>;
}

/// The thread's own state.
pub(crate) struct Writing {
    // After the first error there is no tape any more, but the error.
    tape: Result<Box<dyn Tape>, RecordError>,
    state: Arc<State>,
    inbox: Receiver<Note>,
    taken: u64,
    // An event that was taken before the tick it follows.
    waiting: Option<OrderedEvent>,
    unsynced: bool,
    event_text: fn(&Event) -> String,
    observer: Option<Observer>,
}

impl Writing {
    pub(crate) fn new(tape: Box<dyn Tape>, state: Arc<State>, inbox: Receiver<Note>, options: RecorderOptions) -> Self {
        let RecorderOptions { event_text, observer, .. } = options;
        Self { tape: Ok(tape), state, inbox, taken: 0, waiting: None, unsynced: false, event_text, observer }
    }

    /// Runs until the order to stop; what was queued before it is written.
    pub(crate) fn run(mut self) -> Result<PathBuf, RecordError> {
        let mut synced = Instant::now();
        loop {
            // Read before the queues: what was pushed before the order to stop is still written.
            let stop = self.state.stop.load(Ordering::Acquire);
            if stop {
                self.state.queues.closed.store(true, Ordering::Release);
            }
            self.drain();
            if stop {
                return self.finish();
            }
            if self.unsynced && synced.elapsed() >= FLUSH {
                self.on_tape(|tape| tape.flush());
                self.unsynced = false;
                synced = Instant::now();
            }
            thread::park_timeout(POLL);
        }
    }

    fn drain(&mut self) {
        // No more than the queue holds at once: a lockstep run that never pauses must not keep the
        // thread from syncing.
        for _ in 0..=self.state.queues.ticks.capacity() {
            // The tick first: an event that was said before it is then sure to be seen.
            let tick = self.state.queues.ticks.pop();
            while let Some(next) = self.waiting.take().or_else(|| self.state.queues.events.pop()) {
                if next.after > self.taken {
                    self.waiting = Some(next);
                    break;
                }
                let text = (self.event_text)(&next.event);
                self.event(next.event.at_ns, next.event.level, next.event.part, &text);
            }
            let Some(tick) = tick else { break };
            self.taken += 1;
            self.tick(&tick);
        }
        while let Ok(note) = self.inbox.try_recv() {
            self.event(note.at_ns, note.level, note.part, &note.message);
        }
    }

    fn tick(&mut self, tick: &TickRecord) {
        if let Some(observer) = &mut self.observer {
            observer(Recorded::Tick(tick));
        }
        let written = self.on_tape(|tape| tape.tick(tick));
        let counter = if written { &self.state.ticks } else { &self.state.lost };
        counter.fetch_add(1, Ordering::Relaxed);
    }

    fn event(&mut self, at_ns: u64, level: EventLevel, part: &str, message: &str) {
        if let Some(observer) = &mut self.observer {
            observer(Recorded::Event { at_ns, level, part, message });
        }
        if self.on_tape(|tape| tape.event(at_ns, level, part, message)) {
            self.state.events.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Does something with the tape and says whether it worked; after the first error, nothing.
    fn on_tape(&mut self, work: impl FnOnce(&mut Box<dyn Tape>) -> Result<(), RecordError>) -> bool {
        let Ok(tape) = &mut self.tape else { return false };
        self.unsynced = true;
        let worked = work(tape);
        match worked {
            Ok(()) => true,
            Err(error) => {
                self.state.fail(&error);
                self.tape = Err(error);
                false
            }
        }
    }

    fn finish(self) -> Result<PathBuf, RecordError> {
        let ended = self.tape.and_then(|tape| {
            tape.finish().inspect_err(|error| {
                self.state.fail(error);
            })
        });
        ended.map_err(|first| RecordError::Incomplete {
            first: Box::new(first),
            written: self.state.ticks.load(Ordering::Relaxed),
            lost: self.state.lost.load(Ordering::Relaxed),
        })
    }
}

impl State {
    fn fail(&self, error: &RecordError) {
        // Only the first error is kept, and there is only one that ends the tape.
        let _ = self.error.set(error.to_string());
        self.failed.store(true, Ordering::Release);
    }
}

/// A recording in a file.
pub(crate) struct McapWriter {
    writer: RecordingWriter,
    partial: PathBuf,
}

impl McapWriter {
    pub(crate) fn new(writer: RecordingWriter, partial: PathBuf) -> Self {
        Self { writer, partial }
    }

    /// A file without a name takes every byte and keeps none, and the system reports no error.
    fn still_there(&self) -> Result<(), RecordError> {
        match self.partial.try_exists() {
            Ok(false) => Err(RecordError::Removed { path: self.partial.clone() }),
            // A folder that may not be searched just now is no proof that the file is gone.
            Ok(true) | Err(_) => Ok(()),
        }
    }
}

impl Tape for McapWriter {
    fn tick(&mut self, tick: &TickRecord) -> Result<(), RecordError> {
        Ok(self.writer.write(tick)?)
    }

    fn event(&mut self, at_ns: u64, level: EventLevel, part: &str, message: &str) -> Result<(), RecordError> {
        Ok(self.writer.event(at_ns, level, part, message)?)
    }

    fn flush(&mut self) -> Result<(), RecordError> {
        self.writer.flush()?;
        self.still_there()
    }

    fn finish(self: Box<Self>) -> Result<PathBuf, RecordError> {
        self.still_there()?;
        Ok(self.writer.finish()?)
    }
}
