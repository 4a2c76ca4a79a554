//! The rig as the tick describes it, with the orders that it was given and its answers to them.

use std::collections::VecDeque;

use handover::{PolicyEvent, PolicyTag, Snapshot, StageNow, Succession, Told};

use crate::entry::EntryState;

/// Answers of the tick that are kept: more than orders may wait.
const MOST_ANSWERS: usize = 32;

/// An order to the tick, by what it makes of the succession.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Asked {
    /// To try a policy.
    Try(PolicyTag),
    /// To go back.
    Rollback,
}

/// The rig by the tick's own word, and the orders to it.
#[derive(Debug, Default)]
pub struct Flying {
    snapshot: Snapshot,
    /// Orders that no tick has carried out yet, with their numbers, the oldest first.
    waiting: VecDeque<(u32, Asked)>,
    /// Answers to the newest orders, by number.
    answers: VecDeque<(u32, PolicyEvent)>,
}

impl Flying {
    /// This policy flies from the start.
    pub fn begin(&mut self, tag: PolicyTag) {
        self.snapshot.incumbent = tag;
    }

    /// State of the loop, as the tick has told it last.
    pub fn snapshot(&self) -> Snapshot {
        self.snapshot
    }

    /// Takes in a snapshot of the tick; one from before an event that is known already says nothing any more.
    pub fn show(&mut self, snapshot: Snapshot) {
        if snapshot.told.wrapping_sub(self.snapshot.told) as i32 >= 0 {
            self.take_in(snapshot);
        }
    }

    /// Takes in an event of the tick.
    pub fn happened(&mut self, told: &Told) {
        if let Some(number) = told.answers {
            self.answers.push_back((number, told.event));
            if self.answers.len() > MOST_ANSWERS {
                self.answers.pop_front();
            }
        }
        self.show(told.snapshot);
    }

    fn take_in(&mut self, snapshot: Snapshot) {
        self.snapshot = snapshot;
        self.waiting.retain(|(number, _)| !snapshot.has_served(*number));
    }

    /// An order was given.
    pub fn given(&mut self, number: u32, asked: Asked) {
        self.waiting.push_back((number, asked));
    }

    /// Answer to an order, once a tick has carried it out.
    pub fn answer(&self, number: u32) -> Option<PolicyEvent> {
        self.answers.iter().rev().find(|(of, _)| *of == number).map(|(_, event)| *event)
    }

    /// The succession as it will be once the orders that wait are carried out.
    pub fn expected(&self) -> Succession {
        self.waiting.iter().fold(self.snapshot.succession(), |succession, (_, asked)| match asked {
            Asked::Try(tag) => succession.tried(*tag),
            Asked::Rollback => succession.gone_back(),
        })
    }

    /// State of a policy on the rig; nothing where it has no part there.
    pub fn state_of(&self, tag: PolicyTag) -> Option<EntryState> {
        let Succession { incumbent, candidate, before } = self.snapshot.succession();
        if candidate == Some(tag) {
            Some(EntryState::of_stage(StageNow::of_code(self.snapshot.stage)))
        } else if incumbent == tag {
            Some(EntryState::Active)
        } else {
            (before == Some(tag)).then_some(EntryState::Previous)
        }
    }

    /// Share of the command in percent, of a candidate.
    pub fn authority_percent(&self, tag: PolicyTag) -> Option<f64> {
        (self.snapshot.candidate == Some(tag)).then_some(100.0 * self.snapshot.authority)
    }

    /// Tells whether the rig has a policy or will have it, so that it must be found by its name.
    pub fn needs(&self, tag: PolicyTag) -> bool {
        self.snapshot.succession().holds(tag) || self.waiting.iter().any(|(_, asked)| *asked == Asked::Try(tag))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const POLICY: PolicyTag = PolicyTag(7);

    fn told(event: PolicyEvent, answers: Option<u32>, snapshot: Snapshot) -> Told {
        Told { event, answers, snapshot }
    }

    /// A tick shows what flies, and only then tells that something else does from now on; whoever asks in between is told the newer.
    #[test]
    fn what_was_shown_before_an_event_does_not_undo_it() {
        let mut flying = Flying::default();
        let shown = Snapshot { candidate: Some(POLICY), told: 1, ..Snapshot::default() };
        let active = Snapshot { incumbent: POLICY, told: 2, ..Snapshot::default() };
        flying.happened(&told(PolicyEvent::Taken(POLICY), None, shown));
        flying.show(shown);
        flying.happened(&told(PolicyEvent::Active(POLICY), None, active));
        flying.show(shown);
        assert_eq!((flying.snapshot().incumbent, flying.snapshot().candidate), (POLICY, None));
        flying.show(Snapshot { stage_ticks: 9, ..active });
        assert_eq!((flying.snapshot().incumbent, flying.snapshot().stage_ticks), (POLICY, 9));
        // Of events that found no room the tick has told more than was heard.
        flying.show(Snapshot { told: 40, ..Snapshot::default() });
        assert_eq!(flying.snapshot().incumbent, PolicyTag::FALLBACK);
    }

    #[test]
    fn an_order_that_waits_is_foreseen_and_one_that_was_carried_out_is_answered() {
        let mut flying = Flying::default();
        flying.given(1, Asked::Try(POLICY));
        assert_eq!(flying.expected().candidate, Some(POLICY));
        assert!(flying.needs(POLICY) && flying.state_of(POLICY).is_none());
        flying.given(2, Asked::Rollback);
        assert_eq!(flying.expected().candidate, None);
        let taken = Snapshot { candidate: Some(POLICY), told: 1, served: 1, stage: 7, ..Snapshot::default() };
        flying.happened(&told(PolicyEvent::Taken(POLICY), Some(1), taken));
        assert_eq!(flying.state_of(POLICY), Some(EntryState::Probation));
        assert_eq!((flying.answer(1), flying.answer(2)), (Some(PolicyEvent::Taken(POLICY)), None));
        assert_eq!(flying.expected().candidate, None, "the second order still waits");
        flying.show(Snapshot { told: 2, served: 2, ..Snapshot::default() });
        assert!(!flying.needs(POLICY) && flying.needs(PolicyTag::FALLBACK));
    }
}
