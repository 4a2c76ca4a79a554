//! Ways between the tick and other threads on which the tick waits for nobody, however long another thread stands still.
//!
//! A lock-free queue is not enough for that. Where a thread has claimed a slot and not yet given it back, whoever needs that very
//! slot spins until it has. A thread of ordinary priority that the tick interrupts between these two instructions gets no
//! processor before the tick is done, and so the tick spins until the kernel takes the processor away from it, about a second.
//! Here every slot that somebody else holds is one that the tick can do without.
//!
//! | way | what the tick does |
//! | --- | --- |
//! | [`Newest`] | shows a value, in whichever of two slots nobody reads |
//! | [`Inbox`] | takes an entry, or none while somebody is putting one in |
//! | [`Trail`] | leaves an entry, in whichever of two halves nobody reads; the oldest goes |

use std::collections::VecDeque;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError, TryLockError};

/// The lock, where nobody holds it.
fn free<T>(mutex: &Mutex<T>) -> Option<MutexGuard<'_, T>> {
    match mutex.try_lock() {
        Ok(guard) => Some(guard),
        Err(TryLockError::Poisoned(poisoned)) => Some(poisoned.into_inner()),
        Err(TryLockError::WouldBlock) => None,
    }
}

/// The lock, once nobody else holds it; not for the tick.
fn held<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The newest of the values that the tick shows.
#[derive(Debug)]
pub struct Newest<T> {
    /// Values with their numbers, counted from 1. Of those who look only one holds a slot, and only one slot, at a time.
    slots: [Mutex<Option<(u64, T)>>; 2],
    shown: AtomicU64,
    /// Number of the value that was looked at last.
    seen: Mutex<u64>,
}

impl<T: Copy> Newest<T> {
    /// Makes it with nothing shown yet.
    pub fn new() -> Self {
        Newest { slots: [Mutex::new(None), Mutex::new(None)], shown: AtomicU64::new(0), seen: Mutex::new(0) }
    }

    /// Shows a value; only one thread does.
    ///
    /// # Real-time
    /// Runs in the tick: a copy and a few atomic operations.
    pub fn show(&self, value: T) {
        let number = self.shown.fetch_add(1, Ordering::Relaxed) + 1;
        if let Some(mut slot) = self.slots.iter().find_map(free) {
            *slot = Some((number, value));
        }
    }

    /// The newest value, where one was shown since the last call of anybody.
    pub fn take(&self) -> Option<T> {
        let mut seen = held(&self.seen);
        // One that the tick is writing at this moment is passed over; it is there at the next call.
        let values = self.slots.iter().filter_map(|slot| free(slot).and_then(|slot| *slot));
        let (number, value) = values.max_by_key(|(number, _)| *number).filter(|(number, _)| number > &*seen)?;
        *seen = number;
        Some(value)
    }
}

impl<T: Copy> Default for Newest<T> {
    fn default() -> Self {
        Newest::new()
    }
}

/// A bounded queue to the tick.
#[derive(Debug)]
pub struct Inbox<T> {
    entries: Mutex<VecDeque<T>>,
    most: usize,
}

impl<T> Inbox<T> {
    /// A queue for so many entries.
    pub fn new(most: usize) -> Self {
        Inbox { entries: Mutex::new(VecDeque::with_capacity(most)), most }
    }

    /// Puts an entry in; not for the tick.
    ///
    /// # Errors
    /// The entry, where the queue is full.
    pub fn put(&self, entry: T) -> Result<(), T> {
        let mut entries = held(&self.entries);
        if entries.len() >= self.most {
            return Err(entry);
        }
        entries.push_back(entry);
        Ok(())
    }

    /// The oldest entry; `None` also while somebody is putting one in or taking one back: the next tick finds it.
    ///
    /// # Real-time
    /// Runs in the tick: waits for nobody, frees nothing.
    pub fn take(&self) -> Option<T> {
        free(&self.entries)?.pop_front()
    }

    /// Takes the oldest entry back, where no tick has taken it; not for the tick.
    pub fn take_back(&self) -> Option<T> {
        held(&self.entries).pop_front()
    }

    /// Tells whether another entry finds no room; not for the tick.
    pub fn is_full(&self) -> bool {
        held(&self.entries).len() >= self.most
    }
}

/// A bounded queue from the tick, of which the oldest entry goes where there is no room.
#[derive(Debug)]
pub struct Trail<T> {
    /// Entries with their numbers, counted from 1. Of those who take only one holds a half, and only one half, at a time.
    halves: [Mutex<VecDeque<(u64, T)>>; 2],
    left: AtomicU64,
    /// Number of the entry that was taken last.
    taken: Mutex<u64>,
    most: usize,
}

impl<T: Copy> Trail<T> {
    /// A queue that keeps so many entries.
    pub fn new(most: usize) -> Self {
        let most = most.max(1);
        let half = || Mutex::new(VecDeque::with_capacity(most));
        Trail { halves: [half(), half()], left: AtomicU64::new(0), taken: Mutex::new(0), most }
    }

    /// Leaves an entry; only one thread does.
    ///
    /// # Real-time
    /// Runs in the tick: waits for nobody, allocates nothing.
    pub fn leave(&self, entry: T) {
        let number = self.left.fetch_add(1, Ordering::Relaxed) + 1;
        if let Some(mut half) = self.halves.iter().find_map(free) {
            if half.len() >= self.most {
                half.pop_front();
            }
            half.push_back((number, entry));
        }
    }

    /// The oldest entry that is kept; not for the tick.
    pub fn take(&self) -> Option<T> {
        let mut taken = held(&self.taken);
        loop {
            let front = |half: &Mutex<VecDeque<(u64, T)>>| held(half).front().map_or(u64::MAX, |(number, _)| *number);
            // The first half first: what the tick leaves there after this look is newer than all that the other holds.
            let [first, second] = [front(&self.halves[0]), front(&self.halves[1])];
            // Where the tick has dropped this front meanwhile, the half is full of newer ones: what is older in the other is then
            // more than is kept.
            let (number, entry) = held(&self.halves[usize::from(second < first)]).pop_front()?;
            let newer = self.left.load(Ordering::Relaxed).saturating_sub(number);
            if number > *taken && newer < self.most as u64 {
                *taken = number;
                return Some(entry);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_is_seen_once_and_nothing_older_behind_it() {
        let newest = Newest::new();
        assert_eq!(newest.take(), None);
        newest.show(1);
        newest.show(2);
        assert_eq!((newest.take(), newest.take()), (Some(2), None));
        newest.show(3);
        assert_eq!(newest.take(), Some(3));
    }

    /// As a reader does that was interrupted in either slot, for as long as nobody can know.
    #[test]
    fn a_reader_that_stands_still_makes_nobody_wait_who_shows() {
        let newest = Newest::new();
        newest.show(1);
        for standing in [0, 1] {
            let reading = newest.slots[standing].lock().unwrap();
            (2..5).for_each(|value| newest.show(10 * standing + value));
            drop(reading);
            assert_eq!(newest.take(), Some(10 * standing + 4), "slot {standing}");
        }
    }

    #[test]
    fn who_stands_still_while_putting_something_in_makes_nobody_wait_who_takes() {
        let inbox = Inbox::new(2);
        assert_eq!((inbox.put(1), inbox.put(2), inbox.put(3)), (Ok(()), Ok(()), Err(3)));
        assert!(inbox.is_full());
        let putting = inbox.entries.lock().unwrap();
        assert_eq!(inbox.take(), None);
        drop(putting);
        assert_eq!((inbox.take(), inbox.take_back(), inbox.take()), (Some(1), Some(2), None));
    }

    #[test]
    fn a_trail_keeps_the_newest() {
        let trail = Trail::new(3);
        (0..7).for_each(|entry| trail.leave(entry));
        assert_eq!(std::iter::from_fn(|| trail.take()).collect::<Vec<_>>(), [4, 5, 6]);
        trail.leave(7);
        assert_eq!((trail.take(), trail.take()), (Some(7), None));
    }

    /// As a reader does that was interrupted in either half: the tick goes on, and the order stays, also over the change of halves.
    #[test]
    fn a_reader_that_stands_still_makes_nobody_wait_who_leaves_something() {
        for standing in [0, 1] {
            let trail = Trail::new(3);
            trail.leave(0);
            let reading = trail.halves[standing].lock().unwrap();
            (1..=8).for_each(|entry| trail.leave(entry));
            drop(reading);
            trail.leave(9);
            let taken: Vec<i32> = std::iter::from_fn(|| trail.take()).collect();
            assert_eq!(taken, [7, 8, 9], "half {standing}");
            let room = trail.halves.iter().map(|half| held(half).capacity()).max();
            assert_eq!(room, Some(VecDeque::<(u64, i32)>::with_capacity(3).capacity()), "nothing was allocated");
        }
    }

    #[test]
    fn entries_are_taken_in_their_order_while_others_are_left() {
        const LAST: u64 = 200_000;
        let trail = &Trail::new(8);
        std::thread::scope(|scope| {
            scope.spawn(|| (1..=LAST).for_each(|entry| trail.leave(entry)));
            let mut before = 0;
            while before < LAST {
                let Some(entry) = trail.take() else {
                    std::thread::yield_now();
                    continue;
                };
                assert!(entry > before, "{entry} behind {before}");
                before = entry;
            }
        });
    }
}
