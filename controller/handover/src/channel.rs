//! Queues between the tick and the thread that publishes policies.
//!
//! Every queue is bounded, and the tick waits for nobody at it ([`crate::crossing`]). A policy goes into the tick as a box and
//! comes back as a box; the tick takes one only while what it may have to hand back finds room.

use std::sync::Arc;

use crossbeam::queue::ArrayQueue;
use policy::Policy;
use serde::{Deserialize, Serialize};

use crate::crossing::{Inbox, Newest, Trail};
use crate::exploration::PolicySpread;
use crate::succession::Succession;

/// Commands that may wait.
const COMMANDS: usize = 8;
/// Policies that may wait to be dropped: at most four go in a tick (a candidate and the one that replaced it, the incumbent, the
/// one before it).
const RETIRED: usize = 16;
const MOST_AT_ONCE: usize = 4;
/// Events that may wait; the publishing thread looks ten times a second.
const EVENTS: usize = 256;

/// The first eight bytes of a policy's SHA-256; 0 for the fallback.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
pub struct PolicyTag(pub u64);

impl PolicyTag {
    /// No policy: the fallback.
    pub const FALLBACK: PolicyTag = PolicyTag(0);

    /// The tag of a policy.
    pub fn of(policy: &Policy) -> Self {
        let [a, b, c, d, e, f, g, h, ..] = policy.hash().0;
        PolicyTag(u64::from_be_bytes([a, b, c, d, e, f, g, h]))
    }

    /// The upper half, which events carry in a number.
    pub fn short(self) -> u32 {
        (self.0 >> 32) as u32
    }
}

/// Way in which a candidate comes to its authority.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Haste {
    /// Shadow, ramp, probation.
    Proving,
    /// Straight into probation, over half a second: it has been active before. The fallback is active with that, and never on
    /// probation.
    Straight,
}

/// A policy on its way into the tick.
pub struct Candidate {
    /// The policy; `None` for the fallback.
    pub policy: Option<Policy>,
    /// Tag.
    pub tag: PolicyTag,
    /// Spread of its exploration.
    pub spread: PolicySpread,
}

impl Candidate {
    /// A policy.
    pub fn new(policy: Policy) -> Box<Self> {
        let tag = PolicyTag::of(&policy);
        let spread = PolicySpread::of(&policy);
        Box::new(Candidate { policy: Some(policy), tag, spread })
    }

    /// The fallback.
    pub fn fallback() -> Box<Self> {
        Box::new(Candidate { policy: None, tag: PolicyTag::FALLBACK, spread: PolicySpread::default() })
    }
}

/// Orders of the publishing thread to the tick.
pub enum Command {
    /// To try a candidate; another one that is on its way is withdrawn. Of what controls already that is all.
    Try(Box<Candidate>, Haste),
    /// To go back to what was active before, or from a candidate to the incumbent.
    Rollback,
}

/// Something that happened to a policy in the tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PolicyEvent {
    /// A candidate was taken in.
    Taken(PolicyTag),
    /// A candidate passed into a stage, by [`crate::StageNow::code`].
    Passed(PolicyTag, u8),
    /// A candidate became active, or what was to be tried controls already.
    Active(PolicyTag),
    /// A candidate lost its authority at a stage, by [`crate::StageNow::code`], for a reason.
    Lost(PolicyTag, u8, crate::Loss),
    /// The active policy refused to answer; the fallback took over.
    Refused(PolicyTag),
    /// There is nothing to roll back to.
    NothingBefore,
}

/// State of the policies, as of the newest tick.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Snapshot {
    /// Events told before it: of an event and a snapshot the reader then knows which is the later.
    pub told: u32,
    /// Orders carried out before it.
    pub served: u32,
    /// The incumbent.
    pub incumbent: PolicyTag,
    /// The candidate, if one is on its way.
    pub candidate: Option<PolicyTag>,
    /// Predecessor of the incumbent, as in [`Succession::before`].
    pub before: Option<PolicyTag>,
    /// Stage, by [`crate::StageNow::code`].
    pub stage: u8,
    /// Ticks in it.
    pub stage_ticks: u32,
    /// Share of the command, 0 … 1.
    pub authority: f64,
    /// Λ of the sequential test for both channels: +4.6 is a verdict against it, −4.6 passes.
    pub log_ratio: [f64; 2],
    /// Root mean square of the incumbent's errors over the last two minutes, in kPa.
    pub incumbent_rms_kpa: [f64; 2],
}

impl Snapshot {
    /// The policies that the loop holds.
    pub fn succession(&self) -> Succession {
        Succession { incumbent: self.incumbent, candidate: self.candidate, before: self.before }
    }

    /// The policy that has all of the command: a candidate in full authority, otherwise the incumbent.
    pub fn in_command(&self) -> PolicyTag {
        self.candidate.filter(|_| self.authority >= 1.0).unwrap_or(self.incumbent)
    }

    /// Tells whether an order has been carried out, by its number.
    pub fn has_served(&self, number: u32) -> bool {
        self.served.wrapping_sub(number) as i32 >= 0
    }
}

/// An event as the tick tells it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Told {
    /// The event.
    pub event: PolicyEvent,
    /// Number of the order that it is the answer to, counted from 1 as they were given.
    pub answers: Option<u32>,
    /// State of the loop with it.
    pub snapshot: Snapshot,
}

/// Tells whether an event is the answer to the order that is carried out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Occasion {
    Answer,
    Course,
}

/// The tick's end.
pub struct TickEnd {
    commands: Arc<Inbox<Command>>,
    retired: Arc<ArrayQueue<Box<Candidate>>>,
    events: Arc<Trail<Told>>,
    snapshot: Arc<Newest<Snapshot>>,
    told: u32,
    served: u32,
}

/// The publishing thread's end.
#[derive(Clone)]
pub struct StoreEnd {
    commands: Arc<Inbox<Command>>,
    retired: Arc<ArrayQueue<Box<Candidate>>>,
    events: Arc<Trail<Told>>,
    snapshot: Arc<Newest<Snapshot>>,
}

/// Makes both ends.
pub fn channel() -> (TickEnd, StoreEnd) {
    let commands = Arc::new(Inbox::new(COMMANDS));
    let retired = Arc::new(ArrayQueue::new(RETIRED));
    let events = Arc::new(Trail::new(EVENTS));
    let snapshot = Arc::new(Newest::new());
    let store = StoreEnd {
        commands: Arc::clone(&commands),
        retired: Arc::clone(&retired),
        events: Arc::clone(&events),
        snapshot: Arc::clone(&snapshot),
    };
    (TickEnd { commands, retired, events, snapshot, told: 0, served: 0 }, store)
}

impl TickEnd {
    /// The next command, if there is one and what it may retire finds room.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub(crate) fn command(&mut self) -> Option<Command> {
        let room = self.retired.capacity() - self.retired.len();
        let command = if room < 2 * MOST_AT_ONCE { None } else { self.commands.take() };
        self.served = self.served.wrapping_add(u32::from(command.is_some()));
        command
    }

    /// Hands a policy back, to be dropped elsewhere.
    ///
    /// # Real-time
    /// Runs in the tick. Where there is no room the memory is lost rather than freed here; `command` sees to it that there is, and
    /// more, so that no slot is written that is being read.
    pub(crate) fn retire(&self, candidate: Box<Candidate>) {
        if let Err(candidate) = self.retired.push(candidate) {
            std::mem::forget(candidate);
        }
    }

    /// Tells an event and what flies with it.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub(crate) fn tell(&mut self, event: PolicyEvent, occasion: Occasion, snapshot: Snapshot) {
        self.told = self.told.wrapping_add(1);
        let answers = (occasion == Occasion::Answer).then_some(self.served);
        self.events.leave(Told { event, answers, snapshot: self.counted(snapshot) });
    }

    pub(crate) fn show(&self, snapshot: Snapshot) {
        self.snapshot.show(self.counted(snapshot));
    }

    fn counted(&self, snapshot: Snapshot) -> Snapshot {
        Snapshot { told: self.told, served: self.served, ..snapshot }
    }
}

impl StoreEnd {
    /// Puts a command to the next tick under control. Commands are carried out in their order, and are numbered by it from 1.
    ///
    /// # Errors
    /// The command, if too many wait: nothing ticks.
    pub fn ask(&self, command: Command) -> Result<(), Command> {
        self.commands.put(command)
    }

    /// The next event.
    pub fn event(&self) -> Option<Told> {
        self.events.take()
    }

    /// State of the policies, if a tick has passed since the last call.
    pub fn snapshot(&self) -> Option<Snapshot> {
        self.snapshot.take()
    }

    /// Drops what the tick has handed back; how many.
    pub fn sweep(&self) -> usize {
        std::iter::from_fn(|| self.retired.pop()).count()
    }
}
