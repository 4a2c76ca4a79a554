//! Policies listed, swapped and taken back; another model.

use std::path::PathBuf;
use std::sync::mpsc::{Receiver, TryRecvError, channel};

use handover::Permit;

use super::{Asked, AtWork, BUSY, Desk, LEFT, Step, What};
use crate::operator::operator_protocol::WORK_TIME;
use crate::operator::peer::Peer;
use crate::policy_service::PolicyHandle;

/// Answered where policies and models cannot be changed.
pub(super) const NO_POLICIES: &str = "policies and models cannot be changed in this run";

/// A policy that is being loaded, or a model that is being compared.
pub(super) struct Change {
    from: Receiver<(Result<String, String>, AtWork)>,
    what: String,
    permit: Permit,
}

impl Desk {
    pub(super) fn list_policies(&mut self) -> Step {
        let Some(handle) = &self.options.policies else { return self.done(Err(NO_POLICIES.to_owned())) };
        let (entries, _) = handle.policies.list();
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
        self.aside(format!("swap {name}"), asked, move |handle, who, permit| handle.policies.swap(&name, who, permit))
    }

    pub(super) fn roll_back(&mut self, peer: Peer) -> Step {
        match &self.options.policies {
            Some(handle) => {
                let outcome = handle.policies.rollback(&peer.to_string());
                self.over_saying("rollback", peer, outcome)
            }
            None => self.over("rollback", peer, Err(NO_POLICIES.to_owned())),
        }
    }

    pub(super) fn begin_model(&mut self, file: PathBuf, asked: Asked) -> Step {
        let notes = self.options.notes.clone();
        self.aside(format!("model {}", file.display()), asked, move |handle, _, permit| {
            let changed = handle.models.change(&file, permit)?;
            changed.keep(&notes);
            handle.policies.model_changed(handle.models.rig());
            Ok(changed.line)
        })
    }

    pub(super) fn look_at_change(&mut self, change: Change, asked: Asked) -> Step {
        let late = asked.is_late();
        match change.from.try_recv() {
            Ok((outcome, at_work)) => {
                drop(at_work);
                self.over_saying(&change.what, asked.peer, outcome)
            }
            // What has been handed to the tick is over within a bounded time, and that is what is answered.
            Err(TryRecvError::Empty) if !late || !change.permit.withdraw() => asked.pending(What::Change(change)),
            Err(TryRecvError::Empty) => {
                let why = format!("it was not done within {} s, and is not done any more", WORK_TIME.as_secs());
                self.over(&change.what, asked.peer, Err(why))
            }
            Err(TryRecvError::Disconnected) => {
                self.over(&change.what, asked.peer, Err("the work for it broke off; try again".to_owned()))
            }
        }
    }

    /// The client that asked for a change has left: what the tick has not been given yet is withdrawn.
    pub(super) fn leave_change(&mut self, change: &Change, peer: Peer) {
        let why =
            if change.permit.withdraw() { LEFT } else { "the client went away before it was told what came of it" };
        self.record(&change.what, peer, &Err(why.to_owned()));
    }

    /// Starts work on policies or models on a thread of its own: it takes up to some seconds, and disarming waits for nobody.
    fn aside(
        &mut self,
        what: String,
        asked: Asked,
        work: impl FnOnce(PolicyHandle, &str, &Permit) -> Result<String, String> + Send + 'static,
    ) -> Step {
        let Some(handle) = self.options.policies.clone() else {
            return self.over(&what, asked.peer, Err(NO_POLICIES.to_owned()));
        };
        if self.is_working() {
            return self.over(&what, asked.peer, Err(BUSY.to_owned()));
        }
        let (answer, from) = channel();
        let (peer, at_work) = (asked.peer, self.at_work());
        let permit = Permit::lasting(WORK_TIME);
        let held = permit.clone();
        let started = std::thread::Builder::new().name("change".to_owned()).spawn(move || {
            let outcome = work(handle, &peer.to_string(), &held);
            // Who asked may have gone.
            let _ = answer.send((outcome, at_work));
        });
        if let Err(error) = started {
            return self.over(&what, asked.peer, Err(format!("no thread can be started for it: {error}")));
        }
        asked.taking(WORK_TIME).pending(What::Change(Change { from, what, permit }))
    }
}
