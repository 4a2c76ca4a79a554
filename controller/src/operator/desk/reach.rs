//! Reach of a reference as it is told: worked out on a thread of its own, so that whoever disarms waits behind nobody.
//!
//! A request is carried out first. Its answer waits for what the model in force says of the reference, for a bounded time; what comes
//! to be known later is recorded.

use std::sync::{Arc, Weak};

use proto::reference::Reference;

use super::policies::WORK_STACK_BYTES;
use super::{Asked, AtWork, Desk, Step, What};
use crate::operator::mailbox::{Status, Stop};
use crate::operator::operator_protocol::REACH_TIME;
use crate::reach::KnownReach;

/// Told in place of what is not known yet.
const NOT_YET: &str =
    "whether the rig reaches the reference is still being worked out; the log tells, and so does arming";

/// A request that was carried out, and whose answer waits for what the model says of its reference.
pub(super) struct Remarking {
    carried: Carried,
    reference: Arc<Reference>,
    /// Lines that a person should know besides.
    remarks: Vec<String>,
}

/// Order that was carried out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Carried {
    /// An order to arm.
    Arming,
    /// An order to follow a reference.
    Reference,
}

/// Work on the reach of references; at most one thread at a time.
#[derive(Debug, Default)]
pub(super) struct ReachWork {
    /// Held by the thread for as long as it lives.
    at_work: Weak<()>,
    /// Reference about which nobody waits for an answer, to be recorded once there is one.
    to_record: Option<Arc<Reference>>,
}

impl Desk {
    /// Records a request that was carried out, and answers it once it is known whether the rig reaches the reference that is followed.
    pub(super) fn over_remarking(&mut self, carried: Carried, what: &str, remarks: Vec<String>, asked: Asked) -> Step {
        self.record(what, asked.peer, &Ok(()));
        remarks.iter().for_each(|remark| self.note_remark(remark));
        match self.options.followed.clone() {
            Some(reference) => {
                self.look_at_remarking(Remarking { carried, reference, remarks }, asked.taking(REACH_TIME))
            }
            None => self.done_remarking(&remarks),
        }
    }

    pub(super) fn look_at_remarking(&mut self, mut remarking: Remarking, asked: Asked) -> Step {
        if let Some(ended) = self.ended_since(asked).filter(|_| remarking.carried == Carried::Arming) {
            // At once: whoever arms must not hear of it only when the reach is worked out.
            self.record_reach_later(remarking.reference);
            return self.done_remarking(&[ended]);
        }
        match self.reach_of(&remarking.reference) {
            KnownReach::Known(line) => {
                line.iter().for_each(|line| self.note_remark(line));
                remarking.remarks.extend(line);
            }
            KnownReach::Unknown if !asked.is_late() => return asked.pending(What::Remarking(remarking)),
            KnownReach::Unknown => {
                self.record_reach_later(remarking.reference);
                remarking.remarks.push(NOT_YET.to_owned());
            }
        }
        self.done_remarking(&remarking.remarks)
    }

    /// Reason why the rig is not under control any more since it was armed, one line; `None` where it is, or nothing is known of it.
    fn ended_since(&self, asked: Asked) -> Option<String> {
        // An experiment that somebody has begun arms it again by itself.
        let is_over = |status: &Status| !status.state.is_controlling() && status.experiment.is_none();
        let status = self.live_status().filter(is_over)?;
        if let Some(cause) = status.fault.filter(|_| status.state.is_vented()) {
            return Some(format!("it was armed, and is vented ({}) since; look at it", cause.name()));
        }
        Some(match self.options.mailbox.stop_since(asked.since) {
            Some(Stop::Disarmed) => "it was armed, and was disarmed since".to_owned(),
            Some(Stop::Vented(Some(cause))) => format!("it was armed, and was vented ({}) since", cause.name()),
            Some(Stop::Vented(None)) => "it was armed, and was vented, or without a session, since".to_owned(),
            None => format!("it was armed, and is {} since", status.state.as_str()),
        })
    }

    fn done_remarking(&mut self, remarks: &[String]) -> Step {
        let mut reply = self.reply(Ok(()));
        reply.remark = (!remarks.is_empty()).then(|| remarks.join("; "));
        Step::Done(Box::new(reply))
    }

    /// The client has left; what it asked for is carried out and recorded.
    pub(super) fn leave_remarking(&mut self, remarking: Remarking) {
        self.record_reach_later(remarking.reference);
    }

    /// Has what the model says of a reference recorded once it is known.
    pub(super) fn record_reach_later(&mut self, reference: Arc<Reference>) {
        self.reach_work.to_record = Some(reference);
    }

    /// Looks whether there is something to record of a reference for which nobody waits.
    pub fn look_after_reach(&mut self) {
        let Some(reference) = self.reach_work.to_record.take() else { return };
        match self.reach_of(&reference) {
            KnownReach::Known(line) => line.iter().for_each(|line| self.note_remark(line)),
            KnownReach::Unknown => self.reach_work.to_record = Some(reference),
        }
    }

    /// The line of the model in force about a reference, as far as it is known; where it is not, somebody works it out from now on.
    fn reach_of(&mut self, reference: &Arc<Reference>) -> KnownReach {
        let Some(handle) = &self.options.policies else { return KnownReach::Known(None) };
        let reach = handle.models.reach();
        let known = reach.known(reference);
        if known == KnownReach::Unknown && self.reach_work.at_work.strong_count() == 0 {
            let (at_work, reference) = (AtWork::default(), Arc::clone(reference));
            self.reach_work.at_work = Arc::downgrade(&at_work);
            let thread = std::thread::Builder::new().name("reach".to_owned()).stack_size(WORK_STACK_BYTES);
            // Where none can be started the next look tries again.
            let _ = thread.spawn(move || {
                reach.beyond(&reference);
                drop(at_work);
            });
        }
        known
    }
}
