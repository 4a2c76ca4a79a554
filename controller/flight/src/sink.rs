//! The tick's end of the recorder: two bounded queues that never make it wait.
//!
//! Ticks and events go through queues of their own, so that a flood of ticks cannot push out the
//! event that explains it. Each event carries the number of ticks queued before it; the recorder puts
//! the two back into one order.
//!
//! # Why the tick never waits
//! [`ArrayQueue`] is lock-free, not wait-free: a producer that finds the queue full by one spins while
//! the consumer, which has taken the oldest entry but not yet given its slot back, is between two
//! instructions. Under `SCHED_FIFO` on one core the consumer would never get to the second one. So a
//! queue here has one slot more than it uses: the producer (there is one, hence `&mut self`) refuses an
//! entry while `capacity` are waiting, and then the slot that it writes next is never the one that is
//! being read.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use crossbeam::queue::ArrayQueue;
use proto::recording::{EventLevel, TickRecord};

/// Something that a person should know, in a size that the tick may queue.
///
/// The recorder thread turns it into a sentence with the function that it was started with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Event {
    /// Daemon's monotonic clock (ns).
    pub at_ns: u64,
    /// Importance.
    pub level: EventLevel,
    /// Part that speaks, for example `link`.
    pub part: &'static str,
    /// Code of what happened; the codes are the daemon's own.
    pub code: u16,
    /// Numbers that belong into the sentence; their meaning depends on the code.
    pub values: [f64; 4],
}

/// The tick's end of the recorder.
#[derive(Debug)]
pub struct RecordSink {
    shared: Arc<Queues>,
    // Ticks queued so far: what events are put in order by.
    queued: u64,
}

/// An event with the number of ticks that were queued before it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct OrderedEvent {
    pub(crate) after: u64,
    pub(crate) event: Event,
}

/// State that sink and recorder share.
#[derive(Debug)]
pub(crate) struct Queues {
    pub(crate) ticks: ArrayQueue<TickRecord>,
    pub(crate) events: ArrayQueue<OrderedEvent>,
    pub(crate) ticks_dropped: AtomicU64,
    pub(crate) events_dropped: AtomicU64,
    /// The recorder takes nothing any more.
    pub(crate) closed: AtomicBool,
    /// True where what begins now would not be recorded: the disk has failed or is nearly full.
    pub(crate) unrecorded: AtomicBool,
}

impl Queues {
    pub(crate) fn new(ticks: usize, events: usize) -> Self {
        Self {
            // One slot more than is used: see the module.
            ticks: ArrayQueue::new(ticks.max(1) + 1),
            events: ArrayQueue::new(events.max(1) + 1),
            ticks_dropped: AtomicU64::new(0),
            events_dropped: AtomicU64::new(0),
            closed: AtomicBool::new(false),
            unrecorded: AtomicBool::new(false),
        }
    }
}

impl RecordSink {
    pub(crate) fn new(shared: Arc<Queues>) -> Self {
        Self { shared, queued: 0 }
    }

    /// Queues a tick for the recorder; `false` when the queue is full and the tick is only counted.
    ///
    /// # Real-time
    /// May run in the tick: one copy of the record and a few atomic operations; allocates nothing,
    /// waits for nobody, makes no system call.
    pub fn push(&mut self, tick: &TickRecord) -> bool {
        let taken = offer(&self.shared.ticks, *tick, &self.shared);
        if taken {
            self.queued += 1;
        } else {
            self.shared.ticks_dropped.fetch_add(1, Ordering::Relaxed);
        }
        taken
    }

    /// Queues an event; `false` when the queue of events is full and the event is only counted.
    ///
    /// # Real-time
    /// As [`RecordSink::push`].
    pub fn event(&mut self, event: Event) -> bool {
        let taken = offer(&self.shared.events, OrderedEvent { after: self.queued, event }, &self.shared);
        if !taken {
            self.shared.events_dropped.fetch_add(1, Ordering::Relaxed);
        }
        taken
    }

    /// Ticks refused so far, for [`TickRecord::records_dropped`]; stays at the end of `u32`.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn dropped(&self) -> u32 {
        u32::try_from(self.shared.ticks_dropped.load(Ordering::Relaxed)).unwrap_or(u32::MAX)
    }

    /// Tells whether a run begun now would be recorded: nothing is to arm by itself while it would not.
    ///
    /// # Real-time
    /// May run in the tick: one atomic load.
    pub fn would_record(&self) -> bool {
        !self.shared.unrecorded.load(Ordering::Acquire)
    }

    /// Ticks that the queue still takes now: in lockstep, where no deadline runs, wait while it is 0.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn room(&self) -> usize {
        let ticks = &self.shared.ticks;
        ticks.capacity().saturating_sub(1).saturating_sub(ticks.len())
    }
}

fn offer<T>(queue: &ArrayQueue<T>, entry: T, shared: &Queues) -> bool {
    if shared.closed.load(Ordering::Acquire) || queue.len() + 1 >= queue.capacity() {
        return false;
    }
    queue.push(entry).is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tick(number: u32) -> TickRecord {
        TickRecord { tick: number, ..TickRecord::default() }
    }

    #[test]
    fn a_full_queue_counts_and_keeps_what_it_has() {
        let queues = Arc::new(Queues::new(3, 1));
        let mut sink = RecordSink::new(queues.clone());
        let taken: Vec<bool> = (0..5).map(|k| sink.push(&tick(k))).collect();
        assert_eq!(taken, [true, true, true, false, false]);
        assert_eq!((sink.dropped(), sink.room()), (2, 0));
        let kept: Vec<u32> = std::iter::from_fn(|| queues.ticks.pop()).map(|tick| tick.tick).collect();
        assert_eq!(kept, [0, 1, 2]);
        assert!(sink.push(&tick(5)), "room again");
        assert_eq!((sink.dropped(), sink.room()), (2, 2));
    }

    #[test]
    fn events_know_how_many_ticks_came_before_and_have_room_of_their_own() {
        let queues = Arc::new(Queues::new(1, 2));
        let mut sink = RecordSink::new(queues.clone());
        let event = Event { at_ns: 7, level: EventLevel::Info, part: "test", code: 1, values: [0.0; 4] };
        assert!(sink.event(event));
        assert!(sink.push(&tick(0)));
        assert!(!sink.push(&tick(1)), "refused, so the next event stands after one tick");
        assert!(sink.event(event));
        assert!(!sink.event(event));
        assert_eq!(queues.events_dropped.load(Ordering::Relaxed), 1);
        let after: Vec<u64> = std::iter::from_fn(|| queues.events.pop()).map(|event| event.after).collect();
        assert_eq!(after, [0, 1]);
    }

    #[test]
    fn a_closed_recorder_takes_nothing() {
        let queues = Arc::new(Queues::new(8, 8));
        let mut sink = RecordSink::new(queues.clone());
        queues.closed.store(true, Ordering::Release);
        assert!(!sink.push(&tick(0)));
        assert_eq!((sink.dropped(), queues.ticks.len()), (1, 0));
    }
}
