//! The fallback on a reference that it flies again and again, learning from each flight for the next ([`law::repetition`]).

use std::sync::Arc;

use environment::closed_loop::Controller;
use law::{ControlInput, ControlOutput, Fallback, FallbackSettings, Repetition};
use model::observation::{AHEAD, Pair};
use model::steady::SteadyMap;

/// A fallback, and what its flights have taught.
#[derive(Debug, Clone)]
pub struct RepeatedFallback {
    fallback: Fallback,
    repetition: Repetition,
}

impl RepeatedFallback {
    /// For the rig that `map` was made of, before its first flight.
    pub fn new(map: &Arc<SteadyMap>, settings: FallbackSettings) -> Self {
        let repetition = settings.repetition(map);
        RepeatedFallback { fallback: Fallback::new(Arc::clone(map), settings), repetition }
    }
}

impl Controller for RepeatedFallback {
    fn restart(&mut self, _duty: Pair) {
        self.fallback.restart();
        self.repetition.begin(None);
    }

    fn decide(&mut self, situation: &ControlInput, _predicted_kpa: &[Pair; AHEAD]) -> ControlOutput {
        self.fallback.decide(&ControlInput { learned_duty: self.repetition.learned(), ..*situation })
    }

    fn applied(&mut self, duty: Pair) {
        self.repetition.follow(&self.fallback.left());
        self.fallback.applied(duty);
    }
}
