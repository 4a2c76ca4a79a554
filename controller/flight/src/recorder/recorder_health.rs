//! The recorder's health, for everybody but its thread.

use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::sync::{Arc, PoisonError};
use std::time::Duration;

use crate::recorder_state::{State, UNKNOWN_BYTES};

/// Time that a disk may work on one thing before it counts as stalled.
const STALLED: Duration = Duration::from_secs(1);

/// The recorder's health; may be asked from any thread, and cloned.
#[derive(Debug, Clone)]
pub struct RecorderHealth {
    pub(super) state: Arc<State>,
}

impl RecorderHealth {
    /// The present problem, in one line.
    ///
    /// # Real-time
    /// Not in the tick: it copies a text.
    pub fn error(&self) -> Option<String> {
        self.state.error.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Reason why nothing new should be started now, one line: what is wrong, too little room, or a disk that does not answer.
    ///
    /// # Real-time
    /// Not in the tick.
    pub fn why_not_arm(&self) -> Option<String> {
        let room = || self.state.no_room.lock().unwrap_or_else(PoisonError::into_inner).clone();
        self.error()
            .or_else(room)
            .or_else(|| self.stalled().map(|time| format!("the disk has not answered for {:.1} s", time.as_secs_f64())))
    }

    /// Bytes that may still be written where recordings go, at the newest look; `None` where that is not known, as for a single file.
    ///
    /// # Real-time
    /// May run in the tick: one atomic load.
    pub fn free_bytes(&self) -> Option<u64> {
        Some(self.state.free_bytes.load(Ordering::Relaxed)).filter(|free| *free != UNKNOWN_BYTES)
    }

    /// Time for which the disk has not answered, where that is longer than a second.
    pub fn stalled(&self) -> Option<Duration> {
        Some(self.state.stalled()).filter(|time| *time > STALLED)
    }

    /// Notes that were refused because too many waited.
    pub fn notes_dropped(&self) -> u64 {
        self.state.notes_dropped.load(Ordering::Relaxed)
    }

    /// Last file that was finished so far, by this recorder; `None` before the first.
    pub fn last_finished(&self) -> Option<PathBuf> {
        self.state.files.lock().unwrap_or_else(PoisonError::into_inner).last().cloned()
    }

    /// Ticks that a full queue refused so far.
    pub fn ticks_dropped(&self) -> u64 {
        self.state.queues.ticks_dropped.load(Ordering::Relaxed)
    }

    /// Ticks that were taken and could not be written, because of [`RecorderHealth::error`].
    pub fn ticks_lost(&self) -> u64 {
        self.state.lost.load(Ordering::Relaxed)
    }
}
