//! Who comes after whom: orders carried out, candidates taken in, lost and promoted, and what is told of each.
//!
//! All of it runs in the tick: nothing is freed here, what goes is handed to the publishing thread.

use model::observation::CHANNELS;

use super::Arbiter;
use crate::channel::{Command, Haste, PolicyEvent, Snapshot};
use crate::loss::Loss;
use crate::record::Record;
use crate::remainder::Remainder;
use crate::seat::{Seat, layout_of};
use crate::stages::Stages;

impl Arbiter {
    /// Carries out the next order of the publishing thread; there is an event for each.
    pub(super) fn serve(&mut self) -> Option<PolicyEvent> {
        match self.end.command()? {
            Command::Try(candidate, haste) => {
                if self.lose(Loss::Withdrawn).is_some() {
                    self.remainder = Remainder::FROM_SENT;
                }
                let law = self.incumbent.law.for_layout(layout_of(Some(&candidate)));
                let tag = candidate.tag;
                let stages = match haste {
                    Haste::Proving => Stages::from_shadow(),
                    Haste::Straight => Stages::straight(),
                };
                self.candidate = Some((Seat { law, taken: Some(candidate) }, stages));
                Some(self.told(PolicyEvent::Taken(tag)))
            }
            Command::Rollback if self.candidate.is_some() => {
                self.remainder = Remainder::FROM_SENT;
                self.lose(Loss::Withdrawn)
            }
            Command::Rollback => match self.before.take() {
                None => Some(self.told(PolicyEvent::NothingBefore)),
                Some(before) => {
                    let law = self.incumbent.law.for_layout(layout_of(Some(&before)));
                    let tag = before.tag;
                    self.candidate = Some((Seat { law, taken: Some(before) }, Stages::straight()));
                    Some(self.told(PolicyEvent::Taken(tag)))
                }
            },
        }
    }

    /// The incumbent gave no answer: from this tick on its law's fallback decides.
    pub(super) fn incumbent_refused(&mut self) -> Option<PolicyEvent> {
        self.stop_exploring();
        let taken = self.incumbent.taken.take()?;
        let tag = taken.tag;
        self.end.retire(taken);
        self.swaps = self.swaps.wrapping_add(1);
        self.remainder = Remainder::FROM_SENT;
        Some(self.told(PolicyEvent::Refused(tag)))
    }

    /// The candidate loses all authority in this tick.
    pub(super) fn lose(&mut self, loss: Loss) -> Option<PolicyEvent> {
        let (seat, stages) = self.candidate.take()?;
        let tag = seat.tag();
        if let Some(taken) = seat.taken {
            self.end.retire(taken);
        }
        Some(self.told(PolicyEvent::Lost(tag, stages.now().code(), loss)))
    }

    /// The candidate becomes the incumbent; its record begins anew.
    pub(super) fn promote(&mut self) -> Option<PolicyEvent> {
        let (seat, _) = self.candidate.take()?;
        let old = std::mem::replace(&mut self.incumbent, seat);
        let old = old.taken;
        if let Some(oldest) = std::mem::replace(&mut self.before, old) {
            self.end.retire(oldest);
        }
        self.record = Record::default();
        self.swaps = self.swaps.wrapping_add(1);
        let active = PolicyEvent::Active(self.incumbent.tag());
        Some(self.told(active))
    }

    pub(super) fn told(&mut self, event: PolicyEvent) -> PolicyEvent {
        self.end.tell(event);
        event
    }

    pub(super) fn show(&self) {
        let candidate = self.candidate.as_ref();
        self.end.show(Snapshot {
            told: 0,
            incumbent: self.incumbent.tag(),
            candidate: candidate.map(|(seat, _)| seat.tag()),
            stage: candidate.map_or(0, |(_, stages)| stages.now().code()),
            stage_ticks: candidate.map_or(0, |(_, stages)| stages.ticks()),
            authority: candidate.map_or(0.0, |(_, stages)| stages.authority()),
            log_ratio: candidate.map_or([0.0; CHANNELS], |(_, stages)| stages.test().log_ratio()),
            incumbent_rms_kpa: self.record.rms_kpa(),
        });
    }
}
