//! Exploration around the active policy: noise on its answers, for as long as it decides alone.

use super::{Arbiter, Trust};
use crate::exploration::{Exploration, ExplorationRules, ExplorationShown, Noise};

impl Arbiter {
    /// Explores around the active policy from the next tick on; answers whether it does. It does not where the fallback
    /// decides or a candidate is on its way.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn explore(&mut self, rules: ExplorationRules) -> bool {
        let spread = self.incumbent.taken.as_ref().filter(|taken| taken.policy.is_some()).map(|taken| taken.spread);
        let alone = self.trust == Trust::Policies && self.candidate.is_none();
        self.exploration = spread.filter(|_| alone).map(|spread| Exploration::new(rules, &spread));
        self.exploration.is_some()
    }

    /// Explores no more.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn stop_exploring(&mut self) {
        self.exploration = None;
    }

    /// Exploration that is on.
    pub fn exploration(&self) -> Option<ExplorationShown> {
        self.exploration.as_ref().map(Exploration::shown)
    }

    /// Takes the noise of a recorded tick in place of what would be drawn: for replays.
    pub fn impose_noise(&mut self, noise: Noise) {
        self.imposed_noise = Some(noise);
    }
}
