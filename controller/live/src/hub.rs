//! State of the run now, and the last minute of it, for everybody who looks.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use flight::CodeNames;
use proto::recording::{Arrival, Event, TickRecord};
use proto::stream::{DaemonState, Message};

use crate::source::RECORDING_PROBLEM;

/// Ticks that are kept: a minute.
pub(crate) const TICKS: usize = 3_000;
/// Events that are kept.
pub(crate) const EVENTS: usize = 200;
/// Upper edges of the bins of the time of a tick (s); the last bin has none.
pub(crate) const COMPUTE_EDGES_S: [f64; 12] =
    [0.000_1, 0.000_2, 0.000_5, 0.001, 0.002, 0.003, 0.005, 0.008, 0.014, 0.02, 0.05, 0.1];

/// Age from which data no longer tells what is.
const FRESH: Duration = Duration::from_secs(1);
/// Time without word of its state after which a daemon counts as gone; it tells it once a second.
const SILENT: Duration = Duration::from_secs(5);

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
    /// Reason why the daemon's stream is not there; `None` while it is.
    pub(crate) trouble: Option<String>,
    /// The daemon's state, and when it was told; none since the stream was last connected.
    state: Option<(DaemonState, Instant)>,
    /// Age of the newest data, and when it was that.
    data: Option<(Duration, Instant)>,
    /// Counts changes of `about`, `policies` and `trouble`.
    pub(crate) edition: u64,
    next: u64,
}

impl Known {
    /// The daemon's state.
    ///
    /// # Errors
    /// Why it is not known, in one line.
    pub(crate) fn daemon(&self) -> Result<&DaemonState, String> {
        match (&self.trouble, &self.state) {
            (Some(trouble), _) => Err(trouble.clone()),
            (None, None) => Err("the daemon has not told its state yet".to_owned()),
            (None, Some((_, at))) if at.elapsed() > SILENT => {
                Err(format!("the daemon has told nothing for {:.0} s", at.elapsed().as_secs_f64()))
            }
            (None, Some((state, _))) => Ok(state),
        }
    }

    /// Problem that keeps the daemon from recording, empty where nothing does; `None` where that is not known.
    pub(crate) fn recording_problem(&self) -> Option<&str> {
        self.daemon().ok()?;
        self.about.get(RECORDING_PROBLEM).map(String::as_str)
    }

    /// The newest tick, while it tells what is: a session is open, and the data is fresh.
    pub(crate) fn current(&self) -> Option<&Seen<TickRecord>> {
        let is_in_session = self.daemon().is_ok_and(|state| state.session != 0);
        let is_fresh = self.age().is_some_and(|age| age <= FRESH);
        self.ticks.back().filter(|_| is_in_session && is_fresh)
    }

    /// Number of the next tick or event.
    pub(crate) fn next(&self) -> u64 {
        self.next
    }

    /// Age of the newest data; `None` before the first. Events and words of the state are no data.
    pub(crate) fn age(&self) -> Option<Duration> {
        self.data.map(|(age, at)| age + at.elapsed())
    }

    fn take(&mut self, message: Message) {
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
                // A tick without a frame is the daemon's alone: the rig has said nothing.
                if matches!(tick.arrival, Arrival::InTime | Arrival::Late) {
                    self.data = Some((Duration::ZERO, Instant::now()));
                }
                self.ticks.push_back(Seen { number, unix_ns, what: *tick });
                trim(&mut self.ticks, TICKS);
            }
            Message::State(state) => {
                // Whoever waits for news looks again, also where there is neither tick nor event.
                self.next += 1;
                // A viewer that has just come knows the age of what it never saw; a tick that came late is as old as the daemon says.
                if let Some(told) = state.age_ms.map(Duration::from_millis) {
                    let age = self.age().map_or(told, |seen| seen.max(told));
                    self.data = Some((age, Instant::now()));
                }
                self.state = Some((state, Instant::now()));
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
    /// Names of the daemon's codes.
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
            // What the daemon before it was doing is no longer anybody's state.
            known.state = None;
        }
        drop(known);
        self.news.notify_all();
    }

    /// The name of a fault's code; none for 0.
    pub(crate) fn fault_name(&self, code: u16) -> &'static str {
        if code == 0 { "" } else { (self.names.fault)(code) }
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

    fn told(session: u32, age_ms: Option<u64>) -> Message {
        Message::State(DaemonState { session, age_ms, ..DaemonState::default() })
    }

    #[test]
    fn only_data_is_news_of_the_rig() {
        let hub = hub();
        assert!(hub.lock().daemon().unwrap_err().contains("not connected"));
        hub.link(Ok(()));
        hub.take(tick(0, 0, 1));
        assert!(hub.lock().daemon().is_err() && hub.lock().current().is_none(), "its state is not known yet");
        hub.take(told(1, Some(0)));
        assert!(hub.lock().daemon().is_ok() && hub.lock().current().is_some());
        // The session is over: the tick is history at once, and the age is the daemon's, whatever else it says.
        hub.take(told(0, Some(10_900)));
        let event = Event { unix_ns: 1, level: EventLevel::Info, part: "operator".to_owned(), message: "x".to_owned() };
        hub.take(Message::Event(event));
        hub.take(Message::Policies("[]".to_owned()));
        let known = hub.lock();
        assert!(known.current().is_none() && known.age().unwrap() >= Duration::from_millis(10_900));
        drop(known);
        hub.take(tick(1, 0, 1));
        hub.take(told(1, Some(2_000)));
        assert!(hub.lock().current().is_none(), "a tick that came late is as old as the daemon says");
        hub.take(tick(2, 0, 1));
        assert!(hub.lock().current().is_some());
        hub.link(Err("the daemon ended".to_owned()));
        hub.link(Ok(()));
        assert!(hub.lock().daemon().is_err(), "the next daemon's state is its own");
    }

    #[test]
    fn a_daemon_that_says_nothing_is_not_up() {
        let hub = hub();
        hub.link(Ok(()));
        hub.take(told(1, None));
        let mut known = hub.lock();
        let Some((_, at)) = &mut known.state else { panic!("it was told") };
        *at -= SILENT + Duration::from_secs(1);
        assert!(known.daemon().unwrap_err().contains("nothing for"));
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
