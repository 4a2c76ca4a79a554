//! Learning from flights of a reference: what earlier ones have taught becomes part of the fallback's command, and what this one leaves
//! is kept for the next.

use law::{Left, Repetitions};

use super::{Arbiter, Trust};
use crate::seat::Seat;

impl Arbiter {
    /// Learns from here on what flights of a reference leave, named by its identity, and hands back what was learned in its place before;
    /// with nothing it learns no more.
    ///
    /// # Real-time
    /// May run in the tick: nothing is freed as long as somebody else holds what is handed back.
    pub fn exchange_repetitions(
        &mut self,
        repetitions: Option<Box<Repetitions>>,
        reference: u64,
    ) -> Option<Box<Repetitions>> {
        let before = std::mem::replace(&mut self.repetitions, repetitions);
        self.choose_reference(reference);
        before
    }

    /// A flight of the reference begins; after `period_ticks` the next one follows, where it does by itself.
    ///
    /// # Real-time
    /// Runs in the tick; bounded.
    pub fn begin_flight(&mut self, period_ticks: Option<u32>) {
        if let Some(repetitions) = &mut self.repetitions {
            repetitions.begin(period_ticks);
        }
    }

    /// Another reference is flown, by its identity ([`Repetitions::choose`]).
    ///
    /// # Real-time
    /// Runs in the tick; bounded.
    pub fn choose_reference(&mut self, reference: u64) {
        self.shown_reference.restart();
        if let Some(repetitions) = &mut self.repetitions {
            repetitions.choose(reference);
        }
    }

    /// Flights of the reference that were learned from; nothing where none are.
    pub fn flights(&self) -> Option<usize> {
        self.repetitions.as_ref().map(|repetitions| repetitions.flights())
    }

    /// Takes what a tick left for the next flight.
    pub(super) fn learn(&mut self, left: &Left) {
        if let Some(repetitions) = &mut self.repetitions {
            repetitions.follow(left);
        }
    }

    /// Tells whether what flights have taught is part of the whole command: a policy of the paper's layout decides without the fallback.
    pub(super) fn builds_on_fallback(&self) -> bool {
        let candidate = self.candidate.as_ref().filter(|(_, stages)| stages.authority() > 0.0).map(|(seat, _)| seat);
        self.trust == Trust::FallbackOnly
            || std::iter::once(&self.incumbent).chain(candidate).all(Seat::builds_on_fallback)
    }
}
