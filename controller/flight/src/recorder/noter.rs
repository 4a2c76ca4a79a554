//! Texts and files that other threads than the tick's add to a recording.

use std::sync::atomic::Ordering;
use std::sync::mpsc::SyncSender;
use std::sync::{Arc, PoisonError};

use proto::recording::{Attachment, EventLevel};

use crate::recorder_state::{Parts, State};
use crate::writing::Note;

/// Adds texts to a recording from any thread but the tick's; may be cloned.
#[derive(Debug, Clone)]
pub struct Noter {
    pub(super) notes: SyncSender<Note>,
    pub(super) state: Arc<State>,
}

impl Noter {
    /// Puts a file into the recording, and into those that go on after it.
    ///
    /// # Real-time
    /// Not in the tick: it allocates and locks.
    pub fn attach(&self, file: Attachment) {
        self.put(file, Parts::AllFromHere);
    }

    /// Puts a file into the part of the run that is being written, or into the next one where none is.
    ///
    /// # Real-time
    /// Not in the tick: it allocates and locks.
    pub fn attach_once(&self, file: Attachment) {
        self.put(file, Parts::One);
    }

    fn put(&self, file: Attachment, parts: Parts) {
        self.state.attach.lock().unwrap_or_else(PoisonError::into_inner).push((file, parts));
    }

    /// Adds a text; one that finds too many waiting is counted and dropped.
    ///
    /// # Real-time
    /// Not in the tick: it allocates. [`RecordSink::event`](crate::sink::RecordSink::event) is for the tick.
    pub fn note(&self, at_ns: u64, level: EventLevel, part: &'static str, message: impl Into<String>) {
        // A thread that is gone is told by `finish`.
        if self.notes.try_send(Note { at_ns, level, part, message: message.into() }).is_err() {
            self.state.notes_dropped.fetch_add(1, Ordering::Relaxed);
        }
    }
}
