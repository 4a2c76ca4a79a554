//! Succession of policies: orders carried out, candidates taken in, lost and promoted, and what is told of each.
//!
//! All of it runs in the tick: nothing is freed here, what goes is handed to the publishing thread. The rules are those of
//! [`crate::succession`]; here they move the policies themselves.

use model::observation::CHANNELS;

use super::Arbiter;
use crate::channel::{Candidate, Command, Haste, Occasion, PolicyEvent, PolicyTag, Snapshot};
use crate::loss::Loss;
use crate::record::Record;
use crate::remainder::Remainder;
use crate::seat::{Seat, layout_of, tag_of};
use crate::stages::Stages;

/// Predecessor of the incumbent.
pub(super) enum Before {
    /// There is none, or it must not control any more.
    Nothing,
    /// A policy, or the fallback, which needs none.
    Kept(Option<Box<Candidate>>),
    /// It is the candidate now, and comes back here if it is withdrawn.
    OnItsWay,
}

impl Before {
    /// The tag of what is kept.
    fn kept(&self) -> Option<PolicyTag> {
        match self {
            Before::Kept(taken) => Some(tag_of(taken.as_deref())),
            Before::Nothing | Before::OnItsWay => None,
        }
    }

    /// The policy that is kept, to be handed back.
    fn into_policy(self) -> Option<Box<Candidate>> {
        match self {
            Before::Kept(taken) => taken,
            Before::Nothing | Before::OnItsWay => None,
        }
    }
}

impl Arbiter {
    /// Carries out the next order of the publishing thread; there is an event for each.
    pub(super) fn serve(&mut self) -> Option<PolicyEvent> {
        Some(match self.end.command()? {
            Command::Try(candidate, haste) => self.try_candidate(candidate, haste),
            Command::Rollback => self.go_back(),
        })
    }

    fn try_candidate(&mut self, candidate: Box<Candidate>, haste: Haste) -> PolicyEvent {
        let withdrawn = self.withdraw();
        let tag = candidate.tag;
        if tag == self.incumbent.tag() {
            self.end.retire(candidate);
            return self.answered(withdrawn.unwrap_or(PolicyEvent::Active(tag)));
        }
        if let Some(event) = withdrawn {
            self.told(event);
        }
        let stages = match haste {
            Haste::Proving => Stages::from_shadow(),
            Haste::Straight => Stages::straight(),
        };
        self.seat_candidate(Some(candidate), stages)
    }

    /// Goes back: from a candidate to the incumbent, or from that to what was active before it.
    fn go_back(&mut self) -> PolicyEvent {
        if let Some(event) = self.withdraw() {
            return self.answered(event);
        }
        match std::mem::replace(&mut self.before, Before::OnItsWay) {
            Before::Kept(taken) => self.seat_candidate(taken, Stages::straight()),
            Before::Nothing | Before::OnItsWay => {
                self.before = Before::Nothing;
                self.answered(PolicyEvent::NothingBefore)
            }
        }
    }

    fn seat_candidate(&mut self, taken: Option<Box<Candidate>>, stages: Stages) -> PolicyEvent {
        let law = self.incumbent.law.for_layout(layout_of(taken.as_deref()));
        let seat = Seat { law, taken };
        let tag = seat.tag();
        let stages = if tag == PolicyTag::FALLBACK { Stages::last_resort() } else { stages };
        self.candidate = Some((seat, stages));
        self.answered(PolicyEvent::Taken(tag))
    }

    /// Takes the candidate back by an order; the event is still to be told.
    fn withdraw(&mut self) -> Option<PolicyEvent> {
        let event = self.take_away(Loss::Withdrawn)?;
        self.remainder = Remainder::FROM_SENT;
        Some(event)
    }

    /// The incumbent gave no answer: from this tick on its law's fallback decides.
    pub(super) fn incumbent_refused(&mut self) -> Option<PolicyEvent> {
        self.stop_exploring();
        let taken = self.incumbent.taken.take()?;
        let tag = taken.tag;
        self.end.retire(taken);
        if self.before.kept() == Some(PolicyTag::FALLBACK) {
            // It has just come back; its box must not be freed here.
            let before = std::mem::replace(&mut self.before, Before::Nothing);
            self.retire(before.into_policy());
        }
        self.swaps = self.swaps.wrapping_add(1);
        self.remainder = Remainder::FROM_SENT;
        Some(self.told(PolicyEvent::Refused(tag)))
    }

    /// The candidate loses all authority in this tick.
    pub(super) fn lose(&mut self, loss: Loss) -> Option<PolicyEvent> {
        let event = self.take_away(loss)?;
        Some(self.told(event))
    }

    /// Takes the candidate away. What was withdrawn is where it came from; whatever else lost its authority is not gone back
    /// to either, but for the fallback.
    fn take_away(&mut self, loss: Loss) -> Option<PolicyEvent> {
        let (Seat { taken, law: _ }, stages) = self.candidate.take()?;
        let tag = tag_of(taken.as_deref());
        let is_blameless = loss == Loss::Withdrawn || tag == PolicyTag::FALLBACK;
        self.before = match std::mem::replace(&mut self.before, Before::Nothing) {
            Before::OnItsWay if is_blameless => Before::Kept(taken),
            before => {
                self.retire(taken);
                let must_go = matches!(before, Before::OnItsWay) || (!is_blameless && before.kept() == Some(tag));
                if must_go {
                    self.retire(before.into_policy());
                    Before::Nothing
                } else {
                    before
                }
            }
        };
        Some(PolicyEvent::Lost(tag, stages.now().code(), loss))
    }

    fn retire(&self, taken: Option<Box<Candidate>>) {
        if let Some(taken) = taken {
            self.end.retire(taken);
        }
    }

    /// The candidate becomes the incumbent; its record begins anew.
    pub(super) fn promote(&mut self) -> Option<PolicyEvent> {
        let (seat, _) = self.candidate.take()?;
        let old = std::mem::replace(&mut self.incumbent, seat);
        let is_another = old.tag() != self.incumbent.tag();
        let former = std::mem::replace(&mut self.before, Before::Nothing);
        self.retire(former.into_policy());
        if is_another {
            self.before = Before::Kept(old.taken);
        } else {
            self.retire(old.taken);
        }
        self.record = Record::default();
        self.swaps = self.swaps.wrapping_add(1);
        let active = PolicyEvent::Active(self.incumbent.tag());
        Some(self.told(active))
    }

    /// Tells an event that no order asked for.
    pub(super) fn told(&mut self, event: PolicyEvent) -> PolicyEvent {
        let snapshot = self.snapshot();
        self.end.tell(event, Occasion::Course, snapshot);
        event
    }

    /// Tells an event as the answer to the order that is carried out.
    fn answered(&mut self, event: PolicyEvent) -> PolicyEvent {
        let snapshot = self.snapshot();
        self.end.tell(event, Occasion::Answer, snapshot);
        event
    }

    pub(super) fn show(&self) {
        self.end.show(self.snapshot());
    }

    fn snapshot(&self) -> Snapshot {
        let candidate = self.candidate.as_ref();
        let on_its_way = candidate.map(|(seat, _)| seat.tag());
        Snapshot {
            incumbent: self.incumbent.tag(),
            candidate: on_its_way,
            before: if matches!(self.before, Before::OnItsWay) { on_its_way } else { self.before.kept() },
            stage: candidate.map_or(0, |(_, stages)| stages.now().code()),
            stage_ticks: candidate.map_or(0, |(_, stages)| stages.ticks()),
            authority: candidate.map_or(0.0, |(_, stages)| stages.authority()),
            log_ratio: candidate.map_or([0.0; CHANNELS], |(_, stages)| stages.test().log_ratio()),
            incumbent_rms_kpa: self.record.rms_kpa(),
            ..Snapshot::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use model::rig::Rig;
    use model::shown_reference::ShownReference;
    use model::steady::SteadyMap;

    use super::*;
    use crate::channel::channel;

    /// After `swap fallback` and a swap back, what comes before the incumbent is a box of the fallback's.
    #[test]
    fn a_refusal_frees_neither_the_policy_nor_the_fallback_before_it() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        let map = Arc::new(SteadyMap::new(&rig).unwrap());
        let (end, store) = channel();
        let mut policy = Candidate::fallback();
        policy.tag = PolicyTag(7);
        let mut arbiter = Arbiter::new(map, ShownReference::of(&rig), Some(policy), end);
        arbiter.before = Before::Kept(Some(Candidate::fallback()));
        assert_eq!(arbiter.incumbent_refused(), Some(PolicyEvent::Refused(PolicyTag(7))));
        assert!(matches!(arbiter.before, Before::Nothing));
        assert_eq!(store.sweep(), 2, "both come back through the queue");
    }
}
