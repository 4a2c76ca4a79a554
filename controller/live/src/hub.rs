//! What is known about the run now, and the last minute of it, for everybody who looks.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use flight::CodeNames;
use proto::recording::{Arrival, Event, TickRecord};
use proto::stream::Message;

/// Ticks that are kept: a minute.
pub(crate) const TICKS: usize = 3_000;
/// Events that are kept.
pub(crate) const EVENTS: usize = 200;
/// Upper edges of the bins of the time of a tick (s); the last bin has none.
pub(crate) const COMPUTE_EDGES_S: [f64; 12] =
    [0.000_1, 0.000_2, 0.000_5, 0.001, 0.002, 0.003, 0.005, 0.008, 0.014, 0.02, 0.05, 0.1];

/// A tick with its number among all that came, and the wall clock.
#[derive(Debug, Clone)]
pub(crate) struct Seen<T> {
    pub(crate) number: u64,
    pub(crate) unix_ns: u64,
    pub(crate) what: T,
}

/// Counts since this viewer began to look.
#[derive(Debug, Clone, Default)]
pub(crate) struct Totals {
    pub(crate) ticks: u64,
    pub(crate) deadline_misses: u64,
    pub(crate) frames_missing: u64,
    pub(crate) frames_damaged: u64,
    pub(crate) faults: u64,
    pub(crate) filter_interventions: u64,
    pub(crate) events: u64,
    pub(crate) sessions: u64,
    /// Ticks by their time of computing; the last bin is open.
    pub(crate) compute: [u64; COMPUTE_EDGES_S.len() + 1],
    pub(crate) compute_sum_s: f64,
}

/// Everything that is known.
#[derive(Debug, Default)]
pub(crate) struct Known {
    pub(crate) about: BTreeMap<String, String>,
    pub(crate) policies: String,
    pub(crate) ticks: VecDeque<Seen<TickRecord>>,
    pub(crate) events: VecDeque<Seen<Event>>,
    pub(crate) totals: Totals,
    /// Why the daemon's stream is not there; `None` while it is.
    pub(crate) trouble: Option<String>,
    /// When the last message came.
    pub(crate) heard: Option<Instant>,
    /// Counts changes of `about`, `policies` and `trouble`.
    pub(crate) edition: u64,
    next: u64,
}

impl Known {
    /// The newest tick.
    pub(crate) fn newest(&self) -> Option<&Seen<TickRecord>> {
        self.ticks.back()
    }

    /// Number of the next tick or event.
    pub(crate) fn next(&self) -> u64 {
        self.next
    }

    /// Time since the last message; `None` before the first.
    pub(crate) fn age(&self) -> Option<Duration> {
        self.heard.map(|heard| heard.elapsed())
    }

    fn take(&mut self, message: Message) {
        self.heard = Some(Instant::now());
        let number = self.next;
        match message {
            Message::About(about) => {
                self.about = about;
                self.edition += 1;
            }
            Message::Policies(policies) => {
                self.policies = policies;
                self.edition += 1;
            }
            Message::Event(event) => {
                self.next += 1;
                self.totals.events += 1;
                self.events.push_back(Seen { number, unix_ns: event.unix_ns, what: event });
                trim(&mut self.events, EVENTS);
            }
            Message::Tick { unix_ns, tick } => {
                self.next += 1;
                self.count(&tick);
                self.ticks.push_back(Seen { number, unix_ns, what: *tick });
                trim(&mut self.ticks, TICKS);
            }
        }
    }

    fn count(&mut self, tick: &TickRecord) {
        let before = self.ticks.back().map(|seen| &seen.what);
        let totals = &mut self.totals;
        totals.ticks += 1;
        totals.deadline_misses += u64::from(tick.deadline_missed);
        totals.frames_missing += u64::from(tick.arrival == Arrival::Missing);
        totals.frames_damaged += u64::from(tick.arrival == Arrival::Damaged);
        totals.filter_interventions += u64::from(tick.filter_active);
        totals.faults += u64::from(tick.fault != 0 && before.is_none_or(|before| before.fault != tick.fault));
        totals.sessions += u64::from(before.is_none_or(|before| before.session != tick.session));
        let seconds = f64::from(tick.compute_ns) * 1e-9;
        let bin = COMPUTE_EDGES_S.partition_point(|edge| *edge < seconds);
        if let Some(count) = totals.compute.get_mut(bin) {
            *count += 1;
        }
        totals.compute_sum_s += seconds;
    }
}

fn trim<T>(queue: &mut VecDeque<T>, most: usize) {
    while queue.len() > most {
        queue.pop_front();
    }
}

/// Shared by the source and all viewers.
#[derive(Debug)]
pub struct Hub {
    known: Mutex<Known>,
    news: Condvar,
    /// What the daemon's codes are called.
    pub(crate) names: CodeNames,
}

impl Hub {
    /// A hub that knows nothing yet.
    pub fn new(names: CodeNames) -> Self {
        let known = Known { trouble: Some("not connected yet".to_owned()), ..Known::default() };
        Hub { known: Mutex::new(known), news: Condvar::new(), names }
    }

    /// Takes a message of the daemon's.
    pub fn take(&self, message: Message) {
        self.lock().take(message);
        self.news.notify_all();
    }

    /// Says whether the daemon's stream is there, or why not.
    pub fn link(&self, link: Result<(), String>) {
        let trouble = link.err();
        let mut known = self.lock();
        if known.trouble != trouble {
            known.trouble = trouble;
            known.edition += 1;
        }
        drop(known);
        self.news.notify_all();
    }

    pub(crate) fn lock(&self) -> MutexGuard<'_, Known> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for something newer than what a viewer has, no longer than asked.
    pub(crate) fn wait(&self, next: u64, edition: u64, most: Duration) -> MutexGuard<'_, Known> {
        let nothing = |known: &mut Known| known.next == next && known.edition == edition;
        let waited = self.news.wait_timeout_while(self.lock(), most, nothing);
        waited.unwrap_or_else(PoisonError::into_inner).0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proto::recording::EventLevel;

    fn hub() -> Hub {
        Hub::new(CodeNames { state: |_| "run", fault: |_| "link lost" })
    }

    fn tick(number: u32, fault: u16, compute_ns: u32) -> Message {
        let tick = TickRecord {
            session: 1,
            tick: number,
            fault,
            compute_ns,
            arrival: Arrival::InTime,
            ..TickRecord::default()
        };
        Message::Tick { unix_ns: u64::from(number) * 20_000_000, tick: Box::new(tick) }
    }

    #[test]
    fn counts_are_kept_and_memory_is_bounded() {
        let hub = hub();
        (0..4_000).for_each(|k| hub.take(tick(k, u16::from((100..200).contains(&k)) * 7, 400_000)));
        hub.take(tick(4_000, 0, 30_000_000));
        for _ in 0..300 {
            let event = Event { unix_ns: 1, level: EventLevel::Info, part: "p".to_owned(), message: "m".to_owned() };
            hub.take(Message::Event(event));
        }
        let known = hub.lock();
        assert_eq!((known.ticks.len(), known.events.len()), (TICKS, EVENTS));
        let totals = &known.totals;
        assert_eq!((totals.ticks, totals.faults, totals.sessions, totals.events), (4_001, 1, 1, 300));
        // 0.4 ms lies in the bin up to 0.5 ms, 30 ms in the one up to 50.
        assert_eq!((totals.compute[2], totals.compute[10]), (4_000, 1));
        assert!((totals.compute_sum_s - 1.63).abs() < 1e-9);
    }

    #[test]
    fn a_viewer_waits_for_news_and_no_longer_than_it_says() {
        let hub = hub();
        let begun = Instant::now();
        drop(hub.wait(0, 0, Duration::from_millis(30)));
        assert!(begun.elapsed() >= Duration::from_millis(30));
        hub.take(tick(0, 0, 1));
        assert_eq!(hub.wait(0, 0, Duration::from_secs(60)).next(), 1);
    }
}
