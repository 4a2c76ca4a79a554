//! Places of connections: a bounded number at a time, of which requests that do not come whole take none for long.
//!
//! A client that connects and says nothing costs nobody else an answer: where all places are taken, the oldest of the requests
//! that are still to come is closed for the new one. A whole request comes within milliseconds, so an honest one is seldom
//! the oldest.

use std::collections::VecDeque;
use std::io;
use std::net::{Shutdown, TcpStream};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A place among a bounded number, given back when it is dropped.
pub(crate) struct Place(Arc<AtomicUsize>);

impl Place {
    /// A place, if fewer than `most` are taken.
    pub(crate) fn take(taken: &Arc<AtomicUsize>, most: usize) -> Option<Self> {
        let one_more = |count: usize| (count < most).then_some(count + 1);
        let found = taken.fetch_update(Ordering::Relaxed, Ordering::Relaxed, one_more);
        found.is_ok().then(|| Place(Arc::clone(taken)))
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Connections whose requests are still to come, the oldest first.
pub(crate) struct Arrivals {
    /// Connections at a time, those that are being answered among them.
    most: usize,
    taken: Arc<AtomicUsize>,
    waiting: Mutex<VecDeque<Waiting>>,
    /// Connections taken in so far.
    count: AtomicU64,
}

/// A connection whose request is still to come.
struct Waiting {
    stream: TcpStream,
    place: Place,
    /// Number by which its [`Arrival`] finds it.
    number: u64,
}

impl Arrivals {
    /// Makes it empty, with room for so many.
    pub(crate) fn new(most: usize) -> Self {
        Arrivals { most, taken: Arc::default(), waiting: Mutex::default(), count: AtomicU64::new(0) }
    }

    /// Takes a connection in, for which the oldest of those whose requests are still to come may be closed; `None` where all
    /// requests have come whole and are being answered.
    ///
    /// # Errors
    /// The system gives no second handle of the connection.
    pub(crate) fn admit(self: &Arc<Self>, stream: &TcpStream) -> io::Result<Option<Arrival>> {
        let stream = stream.try_clone()?;
        let mut waiting = self.waiting();
        let place = Place::take(&self.taken, self.most).or_else(|| {
            let oldest = waiting.pop_front()?;
            // Its thread sees the end of the connection, and has no place to give back.
            let _ = oldest.stream.shutdown(Shutdown::Both);
            Some(oldest.place)
        });
        Ok(place.map(|place| {
            let number = self.count.fetch_add(1, Ordering::Relaxed);
            waiting.push_back(Waiting { stream, place, number });
            Arrival { number, among: Arc::clone(self) }
        }))
    }

    /// Takes one out; `None` where it was closed for another.
    fn take_out(&self, number: u64) -> Option<Place> {
        let mut waiting = self.waiting();
        let at = waiting.iter().position(|one| one.number == number)?;
        waiting.remove(at).map(|one| one.place)
    }

    fn waiting(&self) -> MutexGuard<'_, VecDeque<Waiting>> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A connection that was taken in and whose request is still to come; its place is given back where none comes.
pub(crate) struct Arrival {
    number: u64,
    among: Arc<Arrivals>,
}

impl Arrival {
    /// Place of the connection, now that its request has come whole; `None` where it was closed for another.
    pub(crate) fn has_come(self) -> Option<Place> {
        // Dropping it afterwards finds nothing, which is meant.
        self.among.take_out(self.number)
    }
}

impl Drop for Arrival {
    fn drop(&mut self) {
        drop(self.among.take_out(self.number));
    }
}
