//! Between the tick and everybody else: the newest status out, requests in; the tick waits for nobody at either.
//!
//! A request is never carried out late. Each has a ticket with a time until which it counts; the tick takes it by one
//! atomic exchange, and whoever asked can withdraw it by another until then, so that a request is either carried out or
//! provably never will be. Disarming has a way of its own that is never full, never expires, and takes every request
//! before it out of force: also one that takes work before it gets its ticket, which says what had stopped the rig when it was
//! asked for ([`Stops`]).

use std::cell::Cell;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crossbeam::queue::ArrayQueue;
use handover::ExplorationShown;
use handover::crossing::{Inbox, Newest};
use serde::{Deserialize, Serialize};
use supervisor::{Condition, State};

use crate::cycle::duty_source::ExperimentProgress;
use crate::experiment::open_loop_playback::OpenLoopPlayback;
use crate::machine::clock::now_ns;
use crate::operator::latched_conditions::LatchedConditions;
use crate::operator::stops::VentedLooks;

pub use crate::operator::stops::{Stop, Stops};
pub use request::{Request, Spent};

mod request;

/// Requests that may wait for the tick.
const MOST_WAITING: usize = 8;
/// Tickets whose outcome is kept: more than may wait, so that a place is only used again once its request is gone.
const PLACES: usize = 2 * MOST_WAITING;

/// Experiments that may wait for the desk: one is under way at a time, and the next begins only once it was fetched.
const MOST_PLAYED: usize = 2;

/// State of the daemon as of the newest tick.
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
    /// All conditions that wait for it.
    #[serde(default, skip_serializing_if = "is_nothing")]
    pub waiting: LatchedConditions,
    /// Time at which the newest frame came, ns of the daemon's monotonic clock; 0 before the first. The pressures are that old.
    #[serde(default)]
    pub received_ns: u64,
    /// Session, 0 without one.
    pub session: u32,
    /// Tick of the session.
    pub tick: u32,
    /// True where it could be armed now.
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
    /// Progress of the experiment that is under way.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub experiment: Option<ExperimentProgress>,
    /// Exploration that is on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exploration: Option<ExplorationShown>,
}

fn is_nothing(waiting: &LatchedConditions) -> bool {
    waiting.is_empty()
}

/// Reason for which the tick is not asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NotAsked {
    /// Too many requests wait.
    TooMany,
    /// The rig was stopped after this was asked for.
    Stopped(Stop),
}

/// The number of a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Ticket(u64);

/// Fate of a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fate {
    /// It waits for the tick.
    Waiting,
    /// The tick has taken it.
    Taken,
    /// It was withdrawn or came too late: the tick never takes it.
    Withdrawn,
    /// A stop came after it with which it falls: the tick never takes it.
    Fell,
}

/// A request on its way.
struct Order {
    request: Request,
    ticket: u64,
    /// Stops that had come when it was asked for.
    since: Stops,
    /// Daemon's monotonic clock (ns) after which it no longer counts.
    expires_ns: u64,
}

/// A status as the tick has shown it.
#[derive(Debug, Clone, Copy)]
pub struct Shown {
    /// The status.
    pub status: Status,
    /// Time at which it was shown, monotonic clock (ns).
    pub at_ns: u64,
    /// The last request that the tick had taken or passed over by then.
    pub through: Ticket,
}

/// State that both sides share.
struct Shared {
    status: Newest<Shown>,
    orders: Inbox<Order>,
    retired: ArrayQueue<Spent>,
    /// Experiments that are over, on their way back.
    played: ArrayQueue<Box<OpenLoopPlayback>>,
    /// For each place the ticket and what became of it: `ticket << 2 | fate`.
    fates: [AtomicU64; PLACES],
    disarm: AtomicBool,
    /// Tickets up to this one were asked for before the last disarming.
    disarmed_through: AtomicU64,
    vented: VentedLooks,
    /// The last ticket given out, and how often it was disarmed; the lock is only ever taken by those who ask.
    asked: Mutex<AskedSoFar>,
}

/// Counts of those who ask.
#[derive(Debug, Clone, Copy, Default)]
struct AskedSoFar {
    last_ticket: u64,
    disarmings: u64,
}

const WAITING: u64 = 0;
const TAKEN: u64 = 1;
const WITHDRAWN: u64 = 2;
const FELL: u64 = 3;

impl Shared {
    fn place(&self, ticket: u64) -> &AtomicU64 {
        // The remainder is below the array's length.
        &self.fates[(ticket % PLACES as u64) as usize]
    }

    /// The stop that came after these, where one did.
    fn stop_since(&self, since: Stops, disarmings: u64) -> Option<Stop> {
        if since.disarmings != disarmings { Some(Stop::Disarmed) } else { self.vented.since(since) }
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
    /// The last request that was taken or passed over.
    through: Cell<u64>,
}

/// The operator's side.
#[derive(Clone)]
pub struct OperatorMailbox {
    shared: Arc<Shared>,
}

/// Makes both sides.
pub fn mailbox() -> (TickMailbox, OperatorMailbox) {
    let shared = Arc::new(Shared {
        status: Newest::new(),
        orders: Inbox::new(MOST_WAITING),
        retired: ArrayQueue::new(2 * MOST_WAITING),
        played: ArrayQueue::new(MOST_PLAYED),
        fates: std::array::from_fn(|_| AtomicU64::new(WITHDRAWN)),
        disarm: AtomicBool::new(false),
        disarmed_through: AtomicU64::new(0),
        vented: VentedLooks::default(),
        asked: Mutex::default(),
    });
    (TickMailbox { shared: Arc::clone(&shared), through: Cell::new(0) }, OperatorMailbox { shared })
}

impl TickMailbox {
    /// Shows a new status, as of now.
    ///
    /// # Real-time
    /// Runs in the tick: waits for nobody, allocates nothing.
    pub fn show(&self, status: Status) {
        self.show_as_of(status, now_ns());
    }

    /// Shows a status whose data is as old as this time, monotonic clock (ns): there is no session.
    pub fn show_as_of(&self, status: Status, at_ns: u64) {
        self.shared.vented.count(&status);
        self.shared.status.show(Shown { status, at_ns, through: Ticket(self.through.get()) });
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
            // A request that carries memory is only taken if that memory can be handed back, and not by way of the slot that somebody
            // may be reading.
            if self.shared.retired.len() + 1 >= self.shared.retired.capacity() {
                return None;
            }
            let order = self.shared.orders.take()?;
            self.through.set(order.ticket);
            let vented = order.request.falls_with_venting() && self.shared.vented.since(order.since).is_some();
            let overruled = vented || order.ticket <= self.shared.disarmed_through.load(Ordering::Acquire);
            let late = now_ns() > order.expires_ns;
            let fate = if overruled {
                FELL
            } else if late {
                WITHDRAWN
            } else {
                TAKEN
            };
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
    /// The newest status that was shown since the last call, if a tick has passed.
    pub fn status(&self) -> Option<Shown> {
        self.shared.status.take()
    }

    /// All that has stopped the rig so far.
    pub fn stops(&self) -> Stops {
        let disarmings = self.asked().disarmings;
        Stops { disarmings, vented_looks: self.shared.vented.looks() }
    }

    /// The stop that came after these, where one did.
    pub fn stop_since(&self, since: Stops) -> Option<Stop> {
        let disarmings = self.asked().disarmings;
        self.shared.stop_since(since, disarmings)
    }

    /// Puts a request to the tick, for as long as it counts; `since` are the stops by the time at which somebody asked for it.
    ///
    /// # Errors
    /// Too many wait, or a stop came after it was asked for with which it falls.
    pub fn ask(&self, request: Request, counts_until_ns: u64, since: Stops) -> Result<Ticket, NotAsked> {
        while self.shared.retired.pop().is_some() {}
        // Under the lock of disarming: none comes between this look and the ticket.
        let mut asked = self.asked();
        match self.shared.stop_since(since, asked.disarmings) {
            Some(Stop::Vented(_)) if !request.falls_with_venting() => {}
            Some(stop) => return Err(NotAsked::Stopped(stop)),
            None => {}
        }
        if self.shared.orders.is_full() {
            return Err(NotAsked::TooMany);
        }
        let ticket = asked.last_ticket + 1;
        self.shared.place(ticket).store(ticket << 2 | WAITING, Ordering::Release);
        let order = Order { request, ticket, since, expires_ns: counts_until_ns };
        self.shared.orders.put(order).map_err(|_| NotAsked::TooMany)?;
        asked.last_ticket = ticket;
        Ok(Ticket(ticket))
    }

    fn asked(&self) -> MutexGuard<'_, AskedSoFar> {
        self.shared.asked.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The experiment that is over, once the tick has handed it back.
    pub fn played(&self) -> Option<Box<OpenLoopPlayback>> {
        self.shared.played.pop()
    }

    /// Disarms at the next tick, whenever that comes, and takes every request before it out of force.
    pub fn disarm(&self) {
        let mut asked = self.asked();
        asked.disarmings += 1;
        self.shared.disarmed_through.store(asked.last_ticket, Ordering::Release);
        self.shared.disarm.store(true, Ordering::Release);
    }

    /// Tells whether the last disarming still waits for the tick to see it.
    pub fn disarm_waits(&self) -> bool {
        self.shared.disarm.load(Ordering::Acquire)
    }

    /// Fate of a request.
    pub fn fate(&self, ticket: Ticket) -> Fate {
        let now = self.shared.place(ticket.0).load(Ordering::Acquire);
        match now & 3 {
            // The place serves another ticket by now, so this one is long over.
            _ if now >> 2 != ticket.0 => Fate::Withdrawn,
            WAITING => Fate::Waiting,
            TAKEN => Fate::Taken,
            FELL => Fate::Fell,
            _ => Fate::Withdrawn,
        }
    }

    /// Withdraws a request; `false` if the tick has taken it already.
    pub fn withdraw(&self, ticket: Ticket) -> bool {
        self.shared.settle(ticket.0, WITHDRAWN) || self.fate(ticket) != Fate::Taken
    }
}

#[cfg(test)]
mod tests;
