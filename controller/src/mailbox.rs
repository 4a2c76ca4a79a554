//! Between the tick and everybody else: the newest status out, requests in, both lock-free.

use std::sync::Arc;

use crossbeam::queue::ArrayQueue;
use proto::reference::Reference;
use serde::{Deserialize, Serialize};

/// What the daemon is doing, as of the newest tick.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Status {
    /// State: 0 standby, 1 run, 2 vented.
    pub state: u8,
    /// Fault behind `vented`, 0 for none.
    pub fault: u16,
    /// Session, 0 without one.
    pub session: u32,
    /// Tick of the session.
    pub tick: u32,
    /// Whether it could be armed now.
    pub can_arm: bool,
    /// Measured pressures, kPa gauge.
    pub pressures_kpa: [f64; 2],
    /// References, kPa gauge; 0 while nothing is followed.
    pub reference_kpa: [f64; 2],
    /// Duties.
    pub duty: [f64; 2],
    /// Deadlines missed since the start.
    pub deadline_misses: u64,
    /// Frames that did not come in time since the start.
    pub frames_missed: u64,
    /// Longest computation since the start, in ms.
    pub slowest_ms: f64,
}

/// What the operator wants.
pub enum Request {
    /// Control the pressures.
    Arm,
    /// Open the vents.
    Disarm,
    /// Follow another reference.
    Reference(Box<Reference>),
}

/// The tick's side.
pub struct TickMailbox {
    status: Arc<ArrayQueue<Status>>,
    requests: Arc<ArrayQueue<Request>>,
    retired: Arc<ArrayQueue<Box<Reference>>>,
}

/// The operator's side.
#[derive(Clone)]
pub struct OperatorMailbox {
    status: Arc<ArrayQueue<Status>>,
    requests: Arc<ArrayQueue<Request>>,
    retired: Arc<ArrayQueue<Box<Reference>>>,
}

/// Makes both sides.
pub fn mailbox() -> (TickMailbox, OperatorMailbox) {
    let (status, requests, retired) =
        (Arc::new(ArrayQueue::new(1)), Arc::new(ArrayQueue::new(8)), Arc::new(ArrayQueue::new(8)));
    let tick =
        TickMailbox { status: Arc::clone(&status), requests: Arc::clone(&requests), retired: Arc::clone(&retired) };
    (tick, OperatorMailbox { status, requests, retired })
}

impl TickMailbox {
    /// Shows a new status.
    ///
    /// # Real-time
    /// Runs in the tick: lock-free, allocation-free.
    pub fn show(&self, status: Status) {
        self.status.force_push(status);
    }

    /// The next request, if there is one.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn request(&self) -> Option<Request> {
        // A request that carries memory is only taken if that memory can be handed back.
        if self.retired.is_full() { None } else { self.requests.pop() }
    }

    /// Hands back what the tick must not free.
    ///
    /// # Real-time
    /// Runs in the tick; `request` has seen to it that there is room.
    pub fn retire(&self, reference: Box<Reference>) {
        if let Err(reference) = self.retired.push(reference) {
            std::mem::forget(reference);
        }
    }
}

impl OperatorMailbox {
    /// The status since the last call, if a tick has passed.
    pub fn status(&self) -> Option<Status> {
        self.status.pop()
    }

    /// Puts a request to the next tick; `false` if too many wait.
    pub fn ask(&self, request: Request) -> bool {
        while self.retired.pop().is_some() {}
        self.requests.push(request).is_ok()
    }
}
