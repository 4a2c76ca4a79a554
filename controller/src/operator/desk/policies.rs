//! Policies listed, swapped and taken back; another model.
//!
//! Work that gives the tick an order or reads a file is done on a thread of its own: the one that answers operators waits for
//! nothing.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::Duration;

use flight::Noter;
use handover::Permit;

use super::answers::note_outcome;
use super::{Asked, AtWork, BUSY, Desk, LEFT, Step, What};
use crate::operator::operator_protocol::{EFFECT_TIME, WORK_TIME};
use crate::operator::peer::Peer;
use crate::policy_service::PolicyHandle;

/// Answered where policies and models cannot be changed.
pub(super) const NO_POLICIES: &str = "policies and models cannot be changed in this run";

/// Rollbacks that may wait for a tick at a time: each has a thread.
const MOST_ROLLBACKS: usize = 8;
/// Answered to one more.
const ROLLBACKS_WAIT: &str = "too many rollbacks wait for a tick already; try again";
/// Stack of a thread that takes a policy back: it reads no file and computes nothing, and all memory is locked.
const ROLLBACK_STACK_BYTES: usize = 256 << 10;
/// Stack of a thread that loads a policy, compares a model or works out what it reaches.
pub(super) const WORK_STACK_BYTES: usize = 2 << 20;

/// Outcome of a change: a line that says what was done, or why it was not.
type Outcome = Result<String, String>;

/// Progress of the work for a change.
enum Progress {
    /// It is done on a thread of its own.
    UnderWay,
    /// It is done, and whoever asked is to be told.
    Done(Outcome),
    /// Whoever asked has left: what comes of it is only recorded, by the thread that does it.
    Unattended,
}

/// A policy that is being loaded or taken back, or a model that is being compared.
pub(super) struct Change {
    progress: Arc<Mutex<Progress>>,
    what: String,
    permit: Permit,
    /// Time that the work may take before the tick is given anything.
    time: Duration,
    /// Keeps others from being begun until this one is answered.
    at_work: AtWork,
}

/// Bounds of the work for a change.
struct Work {
    /// Time until it gives the tick anything.
    time: Duration,
    stack_bytes: usize,
    at_work: AtWork,
}

/// Rollbacks whose threads live, or that are not answered yet.
#[derive(Debug, Default)]
pub(super) struct Rollbacks(Vec<Weak<()>>);

impl Rollbacks {
    /// A place for one more; `None` where there are too many.
    fn place(&mut self) -> Option<AtWork> {
        self.0.retain(|rollback| rollback.strong_count() > 0);
        (self.0.len() < MOST_ROLLBACKS).then(|| {
            let at_work = AtWork::default();
            self.0.push(Arc::downgrade(&at_work));
            at_work
        })
    }
}

impl Change {
    fn progress(&self) -> MutexGuard<'_, Progress> {
        self.progress.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The outcome, once there is one; an error of its own where the thread has broken off.
    fn outcome(&self) -> Option<Outcome> {
        // Looked at first: a thread that has ended by then has left what came of it.
        let is_alone = Arc::strong_count(&self.progress) == 1;
        match std::mem::replace(&mut *self.progress(), Progress::UnderWay) {
            Progress::Done(outcome) => Some(outcome),
            _ => is_alone.then(|| Err("the work for it broke off; try again".to_owned())),
        }
    }
}

impl Desk {
    pub(super) fn list_policies(&mut self) -> Step {
        let Some(handle) = &self.options.policies else { return self.done(Err(NO_POLICIES.to_owned())) };
        let entries = handle.policies.list();
        let problem = handle.policies.problem();
        let mut reply = self.reply(Ok(()));
        reply.policies = Some(entries);
        reply.policies_problem = problem;
        Step::Done(Box::new(reply))
    }

    pub(super) fn begin_swap(&mut self, name: String, asked: Asked) -> Step {
        // A name that nobody has is the asker's mistake, not the rig's refusal.
        let unknown = |handle: &PolicyHandle| handle.policies.unknown(&name);
        if let Some(why) = self.options.policies.as_ref().filter(|_| !self.is_working()).and_then(unknown) {
            self.record(&format!("swap {name}"), asked.peer, &Err(why.clone()));
            let mut reply = self.reply(Err(why));
            reply.bad_input = true;
            return Step::Done(Box::new(reply));
        }
        self.one_at_a_time(format!("swap {name}"), asked, move |handle, who, permit| {
            handle.policies.swap(&name, who, permit)
        })
    }

    /// Goes back, also while something else is being loaded or checked: it needs nothing of that.
    pub(super) fn roll_back(&mut self, peer: Peer) -> Step {
        let what = "rollback".to_owned();
        let Some(at_work) = self.rollbacks.place() else {
            return self.over(&what, peer, Err(ROLLBACKS_WAIT.to_owned()));
        };
        let work = Work { time: EFFECT_TIME, stack_bytes: ROLLBACK_STACK_BYTES, at_work };
        let asked = self.asked_now(peer, EFFECT_TIME);
        self.aside(what, asked, work, |handle, who, permit| handle.policies.rollback(who, permit))
    }

    pub(super) fn begin_model(&mut self, file: PathBuf, asked: Asked) -> Step {
        let (notes, followed, safety) =
            (self.options.notes.clone(), self.options.followed.clone(), self.options.safety);
        self.one_at_a_time(format!("model {}", file.display()), asked, move |handle, _, permit| {
            let changed = handle.models.change(&file, safety, permit)?;
            changed.keep(&notes);
            handle.policies.model_changed(handle.models.rig());
            let beyond = followed.and_then(|reference| handle.models.reach().beyond(&reference));
            Ok(beyond.map_or(changed.line.clone(), |beyond| format!("{}; {beyond}", changed.line)))
        })
    }

    pub(super) fn look_at_change(&mut self, change: Change, asked: Asked) -> Step {
        let late = asked.is_late();
        match change.outcome() {
            Some(outcome) => {
                let Change { what, at_work, .. } = change;
                drop(at_work);
                self.over_saying(&what, asked.peer, outcome)
            }
            // What has been handed to the tick is over within a bounded time, and that is what is answered.
            None if !late || !change.permit.withdraw() => asked.pending(What::Change(change)),
            None => {
                let why = format!("it was not done within {} s, and is not done any more", change.time.as_secs_f64());
                self.over(&change.what, asked.peer, Err(why))
            }
        }
    }

    /// The client that asked for a change has left: what the tick has not been given yet is withdrawn; what it has is
    /// recorded as what it comes to.
    pub(super) fn leave_change(&mut self, change: &Change, peer: Peer) {
        let outcome = change.outcome();
        let is_withdrawn = outcome.is_none() && change.permit.withdraw();
        let settled = if is_withdrawn { Some(Err(LEFT.to_owned())) } else { outcome };
        let settled = settled.or_else(|| match std::mem::replace(&mut *change.progress(), Progress::Unattended) {
            Progress::Done(outcome) => Some(outcome),
            Progress::UnderWay | Progress::Unattended => None,
        });
        if let Some(outcome) = settled {
            self.record(&change.what, peer, &outcome.map(drop));
        }
    }

    /// As [`Desk::aside`], for what takes up to some seconds of computing: nothing else of the kind is begun meanwhile.
    fn one_at_a_time(
        &mut self,
        what: String,
        asked: Asked,
        work: impl FnOnce(PolicyHandle, &str, &Permit) -> Outcome + Send + 'static,
    ) -> Step {
        if self.options.policies.is_some() && self.is_working() {
            return self.over(&what, asked.peer, Err(BUSY.to_owned()));
        }
        let bounds = Work { time: WORK_TIME, stack_bytes: WORK_STACK_BYTES, at_work: self.at_work() };
        self.aside(what, asked, bounds, work)
    }

    /// Starts work on policies or models on a thread of its own, which has so much time until it gives the tick anything:
    /// disarming waits for nobody.
    fn aside(
        &mut self,
        what: String,
        asked: Asked,
        Work { time, stack_bytes, at_work }: Work,
        work: impl FnOnce(PolicyHandle, &str, &Permit) -> Outcome + Send + 'static,
    ) -> Step {
        let Some(handle) = self.options.policies.clone() else {
            return self.over(&what, asked.peer, Err(NO_POLICIES.to_owned()));
        };
        let progress = Arc::new(Mutex::new(Progress::UnderWay));
        let permit = Permit::lasting(time);
        let (peer, notes, done) = (asked.peer, self.options.notes.clone(), Arc::clone(&progress));
        let (held, busy, asked_for) = (permit.clone(), Arc::clone(&at_work), what.clone());
        let thread = std::thread::Builder::new().name("change".to_owned()).stack_size(stack_bytes);
        let started = thread.spawn(move || {
            let outcome = work(handle, &peer.to_string(), &held);
            let mut progress = done.lock().unwrap_or_else(PoisonError::into_inner);
            match *progress {
                Progress::Unattended => note_unattended(&notes, &asked_for, peer, &outcome),
                _ => *progress = Progress::Done(outcome),
            }
            drop(busy);
        });
        if let Err(error) = started {
            return self.over(&what, asked.peer, Err(format!("no thread can be started for it: {error}")));
        }
        asked.taking(time).pending(What::Change(Change { progress, what, permit, time, at_work }))
    }
}

/// Records what came of a change after whoever asked for it had left.
fn note_unattended(notes: &Noter, what: &str, peer: Peer, outcome: &Outcome) {
    let request = format!("{what} by {peer}, who had left before");
    note_outcome(notes, &request, outcome.as_ref().map(|done| Some(done.as_str())).map_err(String::as_str));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rollbacks_have_so_many_places_and_give_them_back() {
        let mut rollbacks = Rollbacks::default();
        let mut held: Vec<AtWork> = std::iter::from_fn(|| rollbacks.place()).collect();
        assert_eq!(held.len(), MOST_ROLLBACKS);
        // The thread's part outlives the answer.
        let thread = held.pop().map(|at_work| Arc::clone(&at_work));
        assert!(rollbacks.place().is_none());
        drop(thread);
        assert!(rollbacks.place().is_some());
    }
}
