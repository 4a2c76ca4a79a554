//! The recorder's thread: empties the queues onto tapes, syncs them once a second, and looks after the disk.

use std::collections::VecDeque;
use std::sync::atomic::Ordering;
use std::sync::mpsc::Receiver;
use std::sync::{Arc, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use proto::recording::{Attachment, EventLevel, TickRecord};

use crate::disk::{RetentionClock, free_bytes};
use crate::record_error::RecordError;
use crate::recorder::{Observer, Recorded, RecorderOptions};
use crate::recorder_state::{Parts, State, UNKNOWN_BYTES};
use crate::rotation::TapeSource;
use crate::sink::{Event, OrderedEvent};
use crate::tape::Tape;

/// Between two looks into the queues.
const POLL: Duration = Duration::from_millis(5);
/// Between two syncs of the file: what a cut-off recording loses at most.
const FLUSH: Duration = Duration::from_secs(1);
/// Between two looks whether the file is still there.
const WATCH: Duration = Duration::from_millis(250);
/// Between two tries to record again after a disk has failed.
const RETRY: Duration = Duration::from_secs(10);
/// Events kept until the first tick opens a file.
const EARLY: usize = 256;

/// A text of another thread than the tick.
pub(crate) struct Note {
    pub(crate) at_ns: u64,
    pub(crate) level: EventLevel,
    pub(crate) part: &'static str,
    pub(crate) message: String,
}

/// The thread's own state.
pub(crate) struct Writing {
    source: Box<dyn TapeSource>,
    tape: Option<Box<dyn Tape>>,
    /// The first thing that cost ticks or the end of a file, for whoever finishes the recorder.
    first: Option<RecordError>,
    state: Arc<State>,
    inbox: Receiver<Note>,
    taken: u64,
    // An event that was taken before the tick it follows.
    waiting: Option<OrderedEvent>,
    early: VecDeque<Note>,
    /// Files that wait for a tape.
    unplaced: Vec<Attachment>,
    unsynced: bool,
    synced: Instant,
    watched: Instant,
    opened: Instant,
    retry: Option<Instant>,
    dates: RetentionClock,
    event_text: fn(&Event) -> String,
    observer: Option<Observer>,
}

impl Writing {
    pub(crate) fn new(
        source: Box<dyn TapeSource>,
        state: Arc<State>,
        inbox: Receiver<Note>,
        options: RecorderOptions,
    ) -> Self {
        let RecorderOptions { event_text, observer, .. } = options;
        let now = Instant::now();
        Self {
            source,
            tape: None,
            first: None,
            state,
            inbox,
            taken: 0,
            waiting: None,
            early: VecDeque::new(),
            unplaced: Vec::new(),
            unsynced: false,
            synced: now,
            watched: now,
            opened: now,
            retry: None,
            dates: RetentionClock::start(),
            event_text,
            observer,
        }
    }

    /// Runs until the order to stop; what was queued before it is written.
    pub(crate) fn run(mut self) -> Result<(), RecordError> {
        if self.source.destination().is_none() {
            self.open_tape();
        }
        self.look_for_room();
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
            self.look_after();
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
                let message = (self.event_text)(&next.event);
                let Event { at_ns, level, part, .. } = next.event;
                self.event(Note { at_ns, level, part, message });
            }
            let Some(tick) = tick else { break };
            self.taken += 1;
            self.tick(&tick);
            if self.synced.elapsed() >= FLUSH {
                self.look_after();
            }
        }
        while let Ok(note) = self.inbox.try_recv() {
            self.event(note);
        }
        let files = std::mem::take(&mut *self.state.attach.lock().unwrap_or_else(PoisonError::into_inner));
        for (file, parts) in files {
            let written = self.on_tape(|tape| tape.attach(&file));
            match parts {
                Parts::AllFromHere => self.source.keep(file),
                Parts::One if written => {}
                Parts::One => self.unplaced.push(file),
            }
        }
    }

    /// Syncs, watches the file and the room on the disk, begins the next file.
    fn look_after(&mut self) {
        if self.watched.elapsed() >= WATCH {
            self.watched = Instant::now();
            self.on_tape(|tape| tape.check());
        }
        if self.synced.elapsed() < FLUSH {
            return;
        }
        self.synced = Instant::now();
        let redirected = self.state.redirected.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(destination) = redirected {
            self.source.redirect(destination);
        }
        if std::mem::take(&mut self.unsynced) {
            self.on_tape(|tape| tape.flush());
            self.unsynced = false;
        }
        self.look_for_room();
        let full = match (&self.tape, self.source.destination()) {
            (Some(tape), Some(to)) => tape.bytes() >= to.most_bytes || self.opened.elapsed() >= to.most_time,
            _ => false,
        };
        if full {
            self.end_tape();
        }
    }

    fn tick(&mut self, tick: &TickRecord) {
        if let Some(observer) = &mut self.observer {
            observer(Recorded::Tick(tick));
        }
        self.ensure_tape();
        let written = self.on_tape(|tape| tape.tick(tick));
        // Once more where the file was taken away under the thread: the tick goes into the next one.
        let written = written || (self.tape.is_some() && self.on_tape(|tape| tape.tick(tick)));
        let counter = if written { &self.state.ticks } else { &self.state.lost };
        counter.fetch_add(1, Ordering::Relaxed);
    }

    fn event(&mut self, note: Note) {
        if let Some(observer) = &mut self.observer {
            let Note { at_ns, level, part, message } = &note;
            observer(Recorded::Event { at_ns: *at_ns, level: *level, part, message });
        }
        if self.tape.is_none() {
            if self.early.len() == EARLY {
                self.early.pop_front();
            }
            self.early.push_back(note);
            return;
        }
        self.put(&note);
    }

    fn put(&mut self, note: &Note) {
        if self.on_tape(|tape| tape.event(note.at_ns, note.level, note.part, &note.message)) {
            self.state.events.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Says something of the recorder's own, to whoever looks on and into the recording.
    fn say(&mut self, level: EventLevel, message: String) {
        let at_ns = self.source.destination().map_or(0, |to| (to.clock)());
        self.event(Note { at_ns, level, part: "recorder", message });
    }

    /// Opens a tape where there is none, unless the disk has just failed.
    fn ensure_tape(&mut self) {
        if self.tape.is_some() || self.retry.is_some_and(|at| Instant::now() < at) {
            return;
        }
        self.open_tape();
    }

    fn open_tape(&mut self) {
        let written = self.state.ticks.load(Ordering::Relaxed);
        let state = Arc::clone(&self.state);
        match state.working(|| self.source.next(written)) {
            None => self.retry = Some(Instant::now() + RETRY),
            Some(Err(error)) => self.failed(error),
            Some(Ok(tape)) => {
                let again = self.retry.take().is_some() || self.state.failed.load(Ordering::Acquire);
                self.tape = Some(tape);
                self.opened = Instant::now();
                self.state.set_error(None);
                for file in std::mem::take(&mut self.unplaced) {
                    self.on_tape(|tape| tape.attach(&file));
                }
                for note in std::mem::take(&mut self.early) {
                    self.put(&note);
                }
                self.remove_old();
                if again {
                    self.say(EventLevel::Warning, "recording goes on in a new file".to_owned());
                }
            }
        }
    }

    /// Does something with the tape and says whether it worked; without a tape, nothing.
    fn on_tape(&mut self, work: impl FnOnce(&mut Box<dyn Tape>) -> Result<(), RecordError>) -> bool {
        let Some(tape) = &mut self.tape else { return false };
        self.unsynced = true;
        match self.state.working(|| work(tape)) {
            Ok(()) => true,
            Err(error) => {
                self.failed(error);
                false
            }
        }
    }

    /// The tape is of no use any more: tells it at once, and goes on in another file where only this one was harmed.
    fn failed(&mut self, error: RecordError) {
        self.tape = None;
        let harmed = matches!(error, RecordError::Removed { .. } | RecordError::Cut { .. });
        let known = self.state.error.lock().unwrap_or_else(PoisonError::into_inner).is_some();
        let text = error.to_string();
        self.state.set_error(Some(text.clone()));
        self.first.get_or_insert(error);
        self.retry = Some(Instant::now() + RETRY);
        if !known && self.source.destination().is_some() {
            self.say(EventLevel::Error, format!("{text}; the rig is controlled on, what comes is not recorded"));
        }
        if harmed && !known {
            self.open_tape();
        }
    }

    /// Finishes the tape, so that the next tick begins another.
    fn end_tape(&mut self) {
        let Some(tape) = self.tape.take() else { return };
        let state = Arc::clone(&self.state);
        match state.working(|| tape.finish()) {
            Ok(path) => self.state.files.lock().unwrap_or_else(PoisonError::into_inner).push(path),
            Err(error) => self.failed(error),
        }
    }

    fn look_for_room(&mut self) {
        let Some(to) = self.source.destination() else { return };
        let (min, place) = (to.min_free_bytes, to.directory.clone());
        let state = Arc::clone(&self.state);
        let free = state.working(|| free_bytes(&place));
        state.free_bytes.store(free.unwrap_or(UNKNOWN_BYTES), Ordering::Relaxed);
        let short = free.filter(|free| *free < min).map(|free| {
            format!(
                "{}: only {} MiB free, record.min_free_mib = {}; make room, then arm",
                place.display(),
                free >> 20,
                min >> 20
            )
        });
        let mut known = self.state.no_room.lock().unwrap_or_else(PoisonError::into_inner);
        let news = known.is_none() && short.is_some();
        *known = short;
        let text = known.clone().filter(|_| news);
        drop(known);
        self.state.tell_tick();
        if let Some(text) = text {
            self.say(EventLevel::Error, text);
        }
    }

    fn remove_old(&mut self) {
        let Some(to) = self.source.destination() else { return };
        let (retention, directory, stems) = (to.retention, to.directory.clone(), to.stems);
        let state = Arc::clone(&self.state);
        let now = self.dates.now();
        let gone = state.working(|| retention.apply(&directory, stems, now));
        if !gone.is_empty() {
            let text = format!("removed {} old recordings (record.keep_days, record.keep_gib)", gone.len());
            self.say(EventLevel::Info, text);
        }
    }

    fn finish(mut self) -> Result<(), RecordError> {
        self.end_tape();
        match self.first {
            None => Ok(()),
            Some(first) => Err(RecordError::Incomplete {
                first: Box::new(first),
                written: self.state.ticks.load(Ordering::Relaxed),
                lost: self.state.lost.load(Ordering::Relaxed),
            }),
        }
    }
}
