//! Between the tick and everybody else: the newest status out, requests in, both lock-free for the tick.
//!
//! A request is never carried out late. Each has a ticket with a time until which it counts; the tick takes it by one
//! atomic exchange, and whoever asked can withdraw it by another until then, so that a request is either carried out or
//! provably never will be. Disarming has a way of its own that is never full, never expires, and takes every request
//! before it out of force.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use crossbeam::queue::ArrayQueue;
use handover::{ExplorationRules, ExplorationShown};
use proto::reference::Reference;
use serde::{Deserialize, Serialize};
use supervisor::{Condition, State};

use crate::cycle::duty_source::ExperimentProgress;
use crate::experiment::open_loop_playback::OpenLoopPlayback;
use crate::machine::clock::now_ns;

/// Requests that may wait for the tick.
const MOST_WAITING: usize = 8;
/// Tickets whose outcome is kept: more than may wait, so that a place is only used again once its request is gone.
const PLACES: usize = 2 * MOST_WAITING;

/// Experiments that may wait for the desk: one is under way at a time, and the next begins only once it was fetched.
const MOST_PLAYED: usize = 2;

/// What the daemon is doing, as of the newest tick.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Status {
    /// The state.
    pub state: State,
    /// Condition behind `vented`, `fault` or the end of the last session.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fault: Option<Condition>,
    /// Worst condition that waits for `controller acknowledge`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub latched: Option<Condition>,
    /// When the newest frame came, ns of the daemon's monotonic clock; 0 before the first. The pressures are that old.
    #[serde(default)]
    pub received_ns: u64,
    /// Session, 0 without one.
    pub session: u32,
    /// Tick of the session.
    pub tick: u32,
    /// Whether it could be armed now.
    pub can_arm: bool,
    /// Condition that keeps it from being armed, in standby.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bars_arming: Option<Condition>,
    /// Measured pressures, kPa gauge; absent where a sensor has no sound reading.
    pub pressures_kpa: Option<[f64; 2]>,
    /// References, kPa gauge; absent while nothing is followed.
    pub reference_kpa: Option<[f64; 2]>,
    /// Duties that were sent.
    pub duty: [f64; 2],
    /// Duties that the cRIO reports; absent where no frame came, and without a session.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reported_duty: Option<[f64; 2]>,
    /// Deadlines missed since the start.
    pub deadline_misses: u64,
    /// Frames that did not come in time since the start.
    pub frames_missed: u64,
    /// Longest computation since the start, in ms.
    pub slowest_ms: f64,
    /// Commands that the safety filter has changed since the start.
    #[serde(default)]
    pub filter_interventions: u64,
    /// How far the experiment is that is under way.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub experiment: Option<ExperimentProgress>,
    /// Exploration that is on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exploration: Option<ExplorationShown>,
}

/// What the operator wants.
#[derive(Debug)]
pub enum Request {
    /// Control the pressures.
    Arm,
    /// Open the vents.
    Disarm,
    /// What was wrong has been looked at; what still holds goes on waiting.
    Acknowledge,
    /// Follow another reference.
    Reference(Box<Reference>),
    /// Play an experiment, and go on afterwards.
    Experiment(Box<OpenLoopPlayback>),
    /// Explore around the active policy, or no more.
    Explore(Option<ExplorationRules>),
}

/// What the tick must not free.
#[derive(Debug)]
pub enum Spent {
    /// A reference that is no longer followed, or never was.
    Reference(Box<Reference>),
    /// An experiment that was not begun.
    Experiment(Box<OpenLoopPlayback>),
}

impl Request {
    /// What a request that is not carried out leaves to be freed.
    fn spent(self) -> Option<Spent> {
        match self {
            Request::Reference(reference) => Some(Spent::Reference(reference)),
            Request::Experiment(playback) => Some(Spent::Experiment(playback)),
            Request::Arm | Request::Disarm | Request::Acknowledge | Request::Explore(_) => None,
        }
    }
}

/// The number of a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Ticket(u64);

/// What has become of a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fate {
    /// It waits for the tick.
    Waiting,
    /// The tick has taken it.
    Taken,
    /// It was withdrawn, came too late, or a disarming came after it: the tick never takes it.
    Withdrawn,
}

/// A request on its way.
struct Order {
    request: Request,
    ticket: u64,
    /// Daemon's monotonic clock (ns) after which it no longer counts.
    expires_ns: u64,
}

/// What both sides share.
struct Shared {
    /// The newest status with the time at which it was shown, monotonic clock (ns).
    status: ArrayQueue<(Status, u64)>,
    orders: ArrayQueue<Order>,
    retired: ArrayQueue<Spent>,
    /// Experiments that are over, on their way back.
    played: ArrayQueue<Box<OpenLoopPlayback>>,
    /// For each place the ticket and what became of it: `ticket << 2 | fate`.
    fates: [AtomicU64; PLACES],
    disarm: AtomicBool,
    /// Tickets up to this one were asked for before the last disarming.
    disarmed_through: AtomicU64,
    /// The last ticket given out; the lock is only ever taken by those who ask.
    last_ticket: Mutex<u64>,
}

const WAITING: u64 = 0;
const TAKEN: u64 = 1;
const WITHDRAWN: u64 = 2;

impl Shared {
    fn place(&self, ticket: u64) -> &AtomicU64 {
        // The remainder is below the array's length.
        &self.fates[(ticket % PLACES as u64) as usize]
    }

    /// From waiting to `fate`; `false` if it no longer waits.
    fn settle(&self, ticket: u64, fate: u64) -> bool {
        self.place(ticket)
            .compare_exchange(ticket << 2 | WAITING, ticket << 2 | fate, Ordering::AcqRel, Ordering::Acquire)
            .is_ok()
    }
}

/// The tick's side.
pub struct TickMailbox {
    shared: Arc<Shared>,
}

/// The operator's side.
#[derive(Clone)]
pub struct OperatorMailbox {
    shared: Arc<Shared>,
}

/// Makes both sides.
pub fn mailbox() -> (TickMailbox, OperatorMailbox) {
    let shared = Arc::new(Shared {
        status: ArrayQueue::new(1),
        orders: ArrayQueue::new(MOST_WAITING),
        retired: ArrayQueue::new(2 * MOST_WAITING),
        played: ArrayQueue::new(MOST_PLAYED),
        fates: std::array::from_fn(|_| AtomicU64::new(WITHDRAWN)),
        disarm: AtomicBool::new(false),
        disarmed_through: AtomicU64::new(0),
        last_ticket: Mutex::new(0),
    });
    (TickMailbox { shared: Arc::clone(&shared) }, OperatorMailbox { shared })
}

impl TickMailbox {
    /// Shows a new status, as of now.
    ///
    /// # Real-time
    /// Runs in the tick: lock-free, allocation-free.
    pub fn show(&self, status: Status) {
        self.shared.status.force_push((status, now_ns()));
    }

    /// Shows a status whose data is as old as this time, monotonic clock (ns): there is no session.
    pub fn show_as_of(&self, status: Status, at_ns: u64) {
        self.shared.status.force_push((status, at_ns));
    }

    /// The next request that still counts, if there is one; disarming comes first.
    ///
    /// # Real-time
    /// Runs in the tick: at most as many steps as requests may wait.
    pub fn request(&self) -> Option<Request> {
        if self.shared.disarm.swap(false, Ordering::AcqRel) {
            return Some(Request::Disarm);
        }
        for _ in 0..MOST_WAITING {
            // A request that carries memory is only taken if that memory can be handed back.
            if self.shared.retired.is_full() {
                return None;
            }
            let order = self.shared.orders.pop()?;
            let overruled = order.ticket <= self.shared.disarmed_through.load(Ordering::Acquire);
            let fate = if overruled || now_ns() > order.expires_ns { WITHDRAWN } else { TAKEN };
            if self.shared.settle(order.ticket, fate) && fate == TAKEN {
                return Some(order.request);
            }
            if let Some(spent) = order.request.spent() {
                self.retire(spent);
            }
        }
        None
    }

    /// Hands back what the tick must not free.
    ///
    /// # Real-time
    /// Runs in the tick; `request` has seen to it that there is room.
    pub fn retire(&self, spent: Spent) {
        if let Err(spent) = self.shared.retired.push(spent) {
            std::mem::forget(spent);
        }
    }

    /// Hands back an experiment that is over.
    ///
    /// # Real-time
    /// Runs in the tick; there is room, for the next one begins only once this one was fetched.
    pub fn hand_back(&self, playback: Box<OpenLoopPlayback>) {
        if let Err(playback) = self.shared.played.push(playback) {
            std::mem::forget(playback);
        }
    }
}

impl OperatorMailbox {
    /// The status since the last call with the time it was shown at, monotonic clock (ns), if a tick has passed.
    pub fn status(&self) -> Option<(Status, u64)> {
        self.shared.status.pop()
    }

    /// Puts a request to the tick, for as long as it counts; `None` if too many wait.
    pub fn ask(&self, request: Request, counts_until_ns: u64) -> Option<Ticket> {
        while self.shared.retired.pop().is_some() {}
        let mut last = self.shared.last_ticket.lock().unwrap_or_else(PoisonError::into_inner);
        if self.shared.orders.is_full() {
            return None;
        }
        let ticket = *last + 1;
        self.shared.place(ticket).store(ticket << 2 | WAITING, Ordering::Release);
        self.shared.orders.push(Order { request, ticket, expires_ns: counts_until_ns }).ok()?;
        *last = ticket;
        Some(Ticket(ticket))
    }

    /// The experiment that is over, once the tick has handed it back.
    pub fn played(&self) -> Option<Box<OpenLoopPlayback>> {
        self.shared.played.pop()
    }

    /// Disarms at the next tick, whenever that comes, and takes every request before it out of force.
    pub fn disarm(&self) {
        let last = self.shared.last_ticket.lock().unwrap_or_else(PoisonError::into_inner);
        self.shared.disarmed_through.store(*last, Ordering::Release);
        self.shared.disarm.store(true, Ordering::Release);
    }

    /// Whether the tick has not seen the last disarming yet.
    pub fn disarm_waits(&self) -> bool {
        self.shared.disarm.load(Ordering::Acquire)
    }

    /// What has become of a request.
    pub fn fate(&self, ticket: Ticket) -> Fate {
        let now = self.shared.place(ticket.0).load(Ordering::Acquire);
        match now & 3 {
            // The place serves another ticket by now, so this one is long over.
            _ if now >> 2 != ticket.0 => Fate::Withdrawn,
            WAITING => Fate::Waiting,
            TAKEN => Fate::Taken,
            _ => Fate::Withdrawn,
        }
    }

    /// Withdraws a request; `false` if the tick has taken it already.
    pub fn withdraw(&self, ticket: Ticket) -> bool {
        self.shared.settle(ticket.0, WITHDRAWN) || self.fate(ticket) == Fate::Withdrawn
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FAR: u64 = u64::MAX;

    #[test]
    fn a_request_is_taken_once_or_never() {
        let (tick, desk) = mailbox();
        let taken = desk.ask(Request::Arm, FAR).unwrap();
        assert_eq!(desk.fate(taken), Fate::Waiting);
        assert!(matches!(tick.request(), Some(Request::Arm)));
        assert_eq!(desk.fate(taken), Fate::Taken);
        assert!(!desk.withdraw(taken), "it cannot be had back");
        let withdrawn = desk.ask(Request::Arm, FAR).unwrap();
        assert!(desk.withdraw(withdrawn) && desk.withdraw(withdrawn));
        assert!(tick.request().is_none());
        assert_eq!(desk.fate(withdrawn), Fate::Withdrawn);
    }

    #[test]
    fn what_comes_too_late_is_dropped_and_its_memory_handed_back() {
        let (tick, desk) = mailbox();
        let ticket = desk.ask(Request::Reference(Box::new(Reference::constant(80.0, -70.0))), 1).unwrap();
        assert!(tick.request().is_none());
        assert_eq!((desk.fate(ticket), tick.shared.retired.len()), (Fate::Withdrawn, 1));
    }

    #[test]
    fn disarming_needs_no_room_and_overrules_what_was_asked_before_it() {
        let (tick, desk) = mailbox();
        let before: Vec<Ticket> = (0..MOST_WAITING).map(|_| desk.ask(Request::Arm, FAR).unwrap()).collect();
        assert!(desk.ask(Request::Arm, FAR).is_none(), "full");
        desk.disarm();
        assert!(desk.disarm_waits());
        assert!(matches!(tick.request(), Some(Request::Disarm)));
        assert!(!desk.disarm_waits());
        assert!(tick.request().is_none(), "an arming asked for before the disarming must not follow it");
        assert!(before.iter().all(|ticket| desk.fate(*ticket) == Fate::Withdrawn));
        desk.ask(Request::Arm, FAR).unwrap();
        assert!(matches!(tick.request(), Some(Request::Arm)), "asked for after it");
    }

    /// Two threads race for each of many tickets: exactly one of them gets it.
    #[test]
    fn tick_and_withdrawal_never_both_win() {
        let (tick, desk) = mailbox();
        let mut taken = 0_u32;
        std::thread::scope(|scope| {
            let asking = scope.spawn(|| {
                let mut withdrawn = 0_u32;
                for _ in 0..20_000 {
                    let ticket = loop {
                        if let Some(ticket) = desk.ask(Request::Arm, FAR) {
                            break ticket;
                        }
                        std::thread::yield_now();
                    };
                    withdrawn += u32::from(desk.withdraw(ticket));
                }
                withdrawn
            });
            while !asking.is_finished() {
                taken += u32::from(tick.request().is_some());
            }
            while tick.request().is_some() {
                taken += 1;
            }
            assert_eq!(taken + asking.join().unwrap(), 20_000);
        });
    }
}
