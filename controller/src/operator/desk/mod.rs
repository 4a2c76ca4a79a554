//! Answers the operator's requests: at once, or as soon as the tick has carried them out or provably will not.
//!
//! Nothing here waits. [`Desk::begin`] answers or names what is pending; [`Desk::look`] is asked again and again, and
//! [`Desk::gone`] is told when the client has left, which withdraws a request that the tick has not taken yet. Each subject
//! has its part of all three: `begin_…`, `look_at_…`, `leave_…`.
//!
//! | module | subject |
//! | --- | --- |
//! | `arming` | arm, acknowledge |
//! | `disarming` | disarm, and what is known of the vents then |
//! | `in_force` | state, policy, model and reference as they are told, to live viewers too |
//! | `references` | another reference: by an operator, by a configuration that was read again |
//! | `reach` | whether the rig reaches a reference, worked out aside |
//! | `policies` | policies listed, swapped, taken back; another model |
//! | `exploration` | noise on the active policy's answers |
//! | `experiments`, `experiment_desk` | an experiment: how it is asked for and begins; what becomes of it |
//! | `answers` | answers and their record; the newest that the tick has shown |

use std::sync::mpsc::Receiver;
use std::sync::{Arc, Weak};
use std::time::{Duration, Instant};

use flight::{Noter, RecorderHealth};
use handover::ExplorationRules;
use proto::recording::EventLevel;
use proto::reference::Reference;

use crate::config::{ReferenceChoice, Safety};
use crate::experiment::experiment_log::ExperimentLog;
use crate::machine::clock::now_ns;
use crate::operator::mailbox::{NotAsked, OperatorMailbox, Request, Shown, Stops, Ticket};
use crate::operator::operator_protocol::{Ask, EFFECT_TIME, Reply};
use crate::operator::peer::Peer;
use crate::operator::running::Running;
use crate::policy_service::PolicyHandle;
use crate::reload::Reloaded;
use crate::session::live_stream::Tap;
use arming::Acknowledging;
use disarming::{DisarmedBy, Disarming};
use experiment_desk::ExperimentDesk;
use experiments::{Beginning, Checking};
use exploration::Switching;
use policies::{Change, Rollbacks};
use reach::{ReachWork, Remarking};
use references::{Configured, Following, Reading};

mod answers;
mod arming;
mod disarming;
mod experiment_desk;
mod experiments;
mod exploration;
mod in_force;
mod policies;
mod reach;
mod references;

pub use experiment_desk::{ExperimentOutcome, ExperimentView};

/// Permissions of an operator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum May {
    /// Everything.
    Fly,
    /// Look on and disarm: an experiment is under way.
    OnlyStop,
}

/// Settings of a desk.
pub struct DeskOptions {
    /// The way to the tick.
    pub mailbox: OperatorMailbox,
    /// Limits that references must keep.
    pub safety: Safety,
    /// Settings by which references are followed.
    pub reference: ReferenceChoice,
    /// Health of the recording.
    pub health: RecorderHealth,
    /// Place where the record of who asked for what goes.
    pub notes: Noter,
    /// Permissions of an operator.
    pub may: May,
    /// Names of what the daemon runs with.
    pub running: Running,
    /// The reference that is followed once armed, where there is one.
    pub followed: Option<Arc<Reference>>,
    /// Policies and models, where they can be changed.
    pub policies: Option<PolicyHandle>,
    /// Place where experiments are recorded, where they can be played within the run.
    pub experiments: Option<ExperimentLog>,
    /// Live viewers, where there may be some.
    pub viewers: Option<Tap>,
    /// Configuration of exploration; the seed is each one's own.
    pub exploration: ExplorationRules,
    /// Age from which a status no longer tells what is: there is no session.
    pub stale: Duration,
    /// Configurations that were read again.
    pub reloads: Receiver<Reloaded>,
}

/// The operators' desk.
pub struct Desk {
    options: DeskOptions,
    experiments: Option<ExperimentDesk>,
    newest: Option<Shown>,
    /// Time at which live viewers were last told the state.
    viewers_told: Option<Instant>,
    /// Cause of the last disarming.
    disarmed_by: Option<DisarmedBy>,
    /// A reference is being read; at most one at a time.
    reading: bool,
    /// The reference of the configuration that was last taken over; an operator's may be followed since.
    configured: Option<Configured>,
    /// Held by the thread that loads a policy, compares a model or checks an experiment, for as long as it lives.
    working: Weak<()>,
    rollbacks: Rollbacks,
    reach_work: ReachWork,
}

/// Held by a thread that works on a policy, a model or an experiment; at most one at a time.
type AtWork = Arc<()>;

/// Answered while such a thread lives, also one whose client has been answered or has left.
const BUSY: &str = "another policy, model or experiment is being loaded or checked; try again";

/// Answered to a request that came too late for the tick.
const WITHDRAWN: &str = "it was not carried out: no tick in time";
/// Recorded of a request whose client left before the tick took it.
const LEFT: &str = "the client went away; withdrawn";

/// Request that is not yet answered.
pub struct Pending {
    what: What,
    asked: Asked,
}

/// Record of who asks for something, since when, what had stopped the rig by then, and until when it is answered.
#[derive(Debug, Clone, Copy)]
struct Asked {
    peer: Peer,
    at_ns: u64,
    since: Stops,
    until: Instant,
}

impl Asked {
    /// True once it has to be answered, whatever there is to say.
    fn is_late(self) -> bool {
        Instant::now() >= self.until
    }

    /// Gives the request more time: its current part takes this long from now.
    fn taking(self, time: Duration) -> Self {
        Asked { until: Instant::now() + time, ..self }
    }

    fn pending(self, what: What) -> Step {
        Step::Pending(Pending { what, asked: self })
    }
}

enum What {
    Arm(Ticket),
    Acknowledge(Acknowledging),
    Disarm(Disarming),
    Reading(Reading),
    Following(Following),
    Remarking(Remarking),
    Change(Change),
    Explore(Switching),
    Checking(Checking),
    Experiment(Beginning),
}

/// Outcome of a request for now.
pub enum Step {
    /// The answer.
    Done(Box<Reply>),
    /// Not yet.
    Pending(Pending),
}

impl Desk {
    /// A desk for a daemon.
    pub fn new(options: DeskOptions) -> Self {
        let experiments = options.experiments.clone().map(ExperimentDesk::new);
        let configured = options.followed.as_ref().map(|first| Configured::of(&options.running.reference, first));
        Desk {
            options,
            experiments,
            newest: None,
            viewers_told: None,
            disarmed_by: None,
            reading: false,
            configured,
            working: Weak::new(),
            rollbacks: Rollbacks::default(),
            reach_work: ReachWork::default(),
        }
    }

    /// Tells the person at the daemon something about the socket.
    pub fn tell(&self, line: String) {
        self.options.notes.note(now_ns(), EventLevel::Warning, "socket", line);
    }

    /// Takes in a line that a client sent.
    pub fn begin(&mut self, line: &[u8], peer: Peer) -> Step {
        self.refresh();
        let ask = match serde_json::from_slice::<Ask>(line) {
            Ok(ask) => ask,
            Err(error) => return self.done(Err(format!("not a request: {error}"))),
        };
        let asked = self.asked_now(peer, ask.answer_time());
        match ask {
            Ask::Status {} => self.done(Ok(())),
            Ask::Policies {} => self.list_policies(),
            _ if self.comes_between(&ask) => self.done(Err(experiments::UNDER_WAY.to_owned())),
            Ask::Arm {} => self.begin_arming(asked),
            Ask::Acknowledge {} => self.begin_acknowledging(asked),
            Ask::Disarm {} => self.begin_disarming(asked),
            Ask::Swap { name } => self.begin_swap(name, asked),
            Ask::Rollback {} => self.roll_back(peer),
            Ask::Model { file } => self.begin_model(file, asked),
            Ask::Explore { switch, seed } => self.begin_exploring(switch, seed, asked),
            Ask::Experiment { file, csv } => self.begin_experiment(&file, csv, asked),
            Ask::Reference { file, csv } => self.begin_reference(file, csv, asked),
        }
    }

    /// Looks whether something pending is over.
    pub fn look(&mut self, pending: Pending) -> Step {
        self.refresh();
        let Pending { what, asked } = pending;
        match what {
            What::Arm(ticket) => self.look_at_arming(ticket, asked),
            What::Acknowledge(acknowledging) => self.look_at_acknowledging(acknowledging, asked),
            What::Disarm(disarming) => self.look_at_disarming(disarming, asked),
            What::Reading(reading) => self.look_at_reading(reading, asked),
            What::Following(following) => self.look_at_following(following, asked),
            What::Remarking(remarking) => self.look_at_remarking(remarking, asked),
            What::Change(change) => self.look_at_change(change, asked),
            What::Explore(switching) => self.look_at_exploring(switching, asked),
            What::Checking(checking) => self.look_at_check(checking, asked),
            What::Experiment(beginning) => self.look_at_beginning(beginning, asked),
        }
    }

    /// The client has left: what the tick has not taken yet is withdrawn. A disarming stands.
    pub fn gone(&mut self, pending: Pending) {
        let Pending { what, asked } = pending;
        let peer = asked.peer;
        match what {
            What::Arm(ticket) => self.leave_arming(ticket, peer),
            What::Acknowledge(Acknowledging { ticket, .. }) => {
                let outcome = self.withdrawn(ticket);
                self.record("acknowledge", peer, &outcome);
            }
            What::Disarm(_) => self.record("disarm", peer, &Ok(())),
            What::Reading(_) => {
                self.reading = false;
                self.record("reference", peer, &Err(LEFT.to_owned()));
            }
            What::Following(following) => self.leave_following(following, peer),
            What::Remarking(remarking) => self.leave_remarking(remarking),
            What::Change(change) => self.leave_change(&change, peer),
            What::Explore(switching) => {
                let outcome = self.withdrawn(switching.ticket);
                self.record(switching.name(), peer, &outcome);
            }
            What::Checking(checking) => self.leave_check(&checking, peer),
            // What a tick has taken goes on without whoever asked for it.
            What::Experiment(beginning) => drop(self.experiment_settled(&beginning, asked)),
        }
    }

    fn asked_now(&self, peer: Peer, answer_time: Duration) -> Asked {
        let since = self.options.mailbox.stops();
        Asked { peer, at_ns: now_ns(), since, until: Instant::now() + answer_time }
    }

    /// Asks the tick, which takes it in time or not at all; not where a stop came after `since` with which it falls.
    fn ask_tick(&self, request: Request, since: Stops) -> Result<Ticket, String> {
        let until_ns = now_ns().saturating_add(EFFECT_TIME.as_nanos() as u64);
        self.options.mailbox.ask(request, until_ns, since).map_err(|why| match why {
            NotAsked::TooMany => "too many requests wait; try again".to_owned(),
            NotAsked::Stopped(stop) => self.stopped(stop),
        })
    }

    /// Tells whether a thread works on a policy, a model or an experiment.
    fn is_working(&self) -> bool {
        self.working.strong_count() > 0
    }

    /// Token that the next such thread holds.
    fn at_work(&mut self) -> AtWork {
        let at_work = Arc::new(());
        self.working = Arc::downgrade(&at_work);
        at_work
    }

    /// Fate of a request whose client has left: withdrawn, unless a tick has taken it.
    fn withdrawn(&self, ticket: Ticket) -> Result<(), String> {
        if self.options.mailbox.withdraw(ticket) { Err(LEFT.to_owned()) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests;
