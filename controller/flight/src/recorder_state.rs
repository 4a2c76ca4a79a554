//! State that the recorder's thread shares with its handles: orders in, health and counts out.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use proto::recording::Attachment;

use crate::rotation::Destination;
use crate::sink::Queues;

/// Stands for room that is not known.
pub(crate) const UNKNOWN_BYTES: u64 = u64::MAX;

/// Parts of a run that an attached file goes into.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Parts {
    /// The one being written and all after it.
    AllFromHere,
    /// The one being written.
    One,
}

/// State that the thread and the recorder's handles share.
#[derive(Debug)]
pub(crate) struct State {
    pub(crate) queues: Arc<Queues>,
    /// The order to finish.
    pub(crate) stop: AtomicBool,
    pub(crate) failed: AtomicBool,
    /// Present faults.
    pub(crate) error: Mutex<Option<String>>,
    /// Reason why there is too little room to start anything.
    pub(crate) no_room: Mutex<Option<String>>,
    /// Bytes that may still be written where recordings go; [`UNKNOWN_BYTES`] before the first look, and where the system does not tell.
    pub(crate) free_bytes: AtomicU64,
    pub(crate) ticks: AtomicU64,
    pub(crate) events: AtomicU64,
    pub(crate) lost: AtomicU64,
    pub(crate) notes_dropped: AtomicU64,
    pub(crate) files: Mutex<Vec<PathBuf>>,
    /// Files that are to go into the recording.
    pub(crate) attach: Mutex<Vec<(Attachment, Parts)>>,
    /// Limits to be kept from now on.
    pub(crate) redirected: Mutex<Option<Destination>>,
    begun: Instant,
    /// Since when the disk is at work, in ms since `begun`, plus 1; 0 while it is not.
    busy_since: AtomicU64,
}

impl State {
    pub(crate) fn new(queues: Arc<Queues>) -> Self {
        Self {
            queues,
            stop: AtomicBool::new(false),
            failed: AtomicBool::new(false),
            error: Mutex::new(None),
            no_room: Mutex::new(None),
            free_bytes: AtomicU64::new(UNKNOWN_BYTES),
            ticks: AtomicU64::new(0),
            events: AtomicU64::new(0),
            lost: AtomicU64::new(0),
            notes_dropped: AtomicU64::new(0),
            files: Mutex::new(Vec::new()),
            attach: Mutex::new(Vec::new()),
            redirected: Mutex::new(None),
            begun: Instant::now(),
            busy_since: AtomicU64::new(0),
        }
    }

    fn now_ms(&self) -> u64 {
        u64::try_from(self.begun.elapsed().as_millis()).unwrap_or(u64::MAX - 1)
    }

    /// Time for which the disk has not answered; zero while it is not asked.
    pub(crate) fn stalled(&self) -> Duration {
        match self.busy_since.load(Ordering::Relaxed) {
            0 => Duration::ZERO,
            since => Duration::from_millis((self.now_ms() + 1).saturating_sub(since)),
        }
    }

    pub(crate) fn working<T>(&self, work: impl FnOnce() -> T) -> T {
        self.busy_since.store(self.now_ms() + 1, Ordering::Relaxed);
        let done = work();
        self.busy_since.store(0, Ordering::Relaxed);
        done
    }

    /// Tells the tick whether a run begun now would not be recorded: where a tape fails or room is short.
    pub(crate) fn tell_tick(&self) {
        let is_short = self.no_room.lock().unwrap_or_else(PoisonError::into_inner).is_some();
        self.queues.unrecorded.store(is_short || self.failed.load(Ordering::Acquire), Ordering::Release);
    }

    pub(crate) fn set_error(&self, error: Option<String>) {
        self.failed.store(error.is_some(), Ordering::Release);
        self.tell_tick();
        *self.error.lock().unwrap_or_else(PoisonError::into_inner) = error;
    }
}
