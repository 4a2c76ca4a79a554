//! One hypothesis of what the rig is: a model that runs along behind an observer, and how far the readings contradict it.
//!
//! The model is run twice, under the command as sent and under that of a slow valve ([`crate::lagged_command`]); what lies
//! between both forecasts contradicts neither. In each tick a chamber has made some way a (what its reading says, taken through
//! the observer where the sensor lags), and the model foresaw a way m. Of a rig that is as quick as its model r = a − m is left;
//! of one that is k times as slow r = k a − m, where k is found from the ways themselves ([`crate::slowness`]). Again, what
//! lies between contradicts neither. A reading that does not move leaves r = −m however slow the rig is.

use model::observation::{CHANNELS, Pair};
use model::predict::Predictor;
use model::rig::{Rig, RigError};

use crate::model_residual::{Excess, Limits, Measure, ModelResidual};
use crate::reference_motion::Motion;
use crate::slowness::Slowness;
use crate::standing::Standing;

/// Ticks for which a contradiction counts beyond the last in which a sum was too large: two hypotheses differ by some ticks in
/// when they see the same thing (chosen).
const HELD_TICKS: u32 = 5;

/// Way of a chamber in a tick, in kPa as its sensor reads it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Way {
    /// By the readings.
    pub(crate) actual_kpa: f64,
    /// By the model.
    pub(crate) foreseen_kpa: f64,
}

/// Distance that is left of a tick between a chamber's ways under two commands, with a rig that is slower by `factor` (1: as quick).
pub(crate) fn left_kpa(ways: [Way; 2], factor: f64) -> f64 {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for way in ways {
        for share in [1.0, factor] {
            let left = way.actual_kpa / share - way.foreseen_kpa;
            (low, high) = (low.min(left), high.max(left));
        }
    }
    // The nearest to nothing of all that lies between them.
    0.0_f64.max(low).min(high.max(low))
}

/// The models of one hypothesis, which can be exchanged.
#[derive(Debug, Clone)]
pub(crate) struct HypothesisModels {
    rigs: [Predictor; 2],
    /// The chambers after the last reading, as their sensors would read them without lag, kPa gauge.
    before_kpa: [Pair; 2],
}

impl HypothesisModels {
    pub(crate) fn new(rig: &Rig) -> Result<Self, RigError> {
        Ok(HypothesisModels { rigs: [Predictor::new(rig)?, Predictor::new(rig)?], before_kpa: [[0.0; CHANNELS]; 2] })
    }

    /// Readings foreseen for this tick, under both commands, kPa gauge.
    pub(crate) fn foreseen_kpa(&self) -> [Pair; 2] {
        [0, 1].map(|n: usize| self.rigs[n].readings_kpa())
    }

    /// Takes in readings (kPa gauge); the ways that both chambers made since the last.
    pub(crate) fn take(&mut self, readings_kpa: Pair) -> [[Way; 2]; CHANNELS] {
        let mut ways = [[Way { actual_kpa: 0.0, foreseen_kpa: 0.0 }; 2]; CHANNELS];
        for (n, rig) in self.rigs.iter_mut().enumerate() {
            if !rig.readings_kpa().iter().all(|kpa| kpa.is_finite()) {
                // A model that has diverged begins anew.
                rig.recover(readings_kpa);
            }
            let now = rig.observe(readings_kpa);
            let added = rig.added_kpa();
            for c in 0..CHANNELS {
                let actual_kpa = now[c] - self.before_kpa[n][c];
                ways[c][n] = Way { actual_kpa, foreseen_kpa: actual_kpa - added[c] };
            }
            self.before_kpa[n] = now;
        }
        ways
    }

    pub(crate) fn advance(&mut self, duties: [Pair; 2], pump_on: bool) {
        for (rig, duty) in self.rigs.iter_mut().zip(duties) {
            rig.advance(duty, pump_on);
        }
    }
}

/// Measure of how far the readings of one channel contradict a hypothesis.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Contradiction {
    pub(crate) sums: ModelResidual,
    slowness: Slowness,
    standing: Standing,
    last: Option<Excess>,
    held: u32,
}

impl Contradiction {
    pub(crate) fn new(limits: Limits) -> Self {
        Contradiction {
            sums: ModelResidual::new(limits),
            slowness: Slowness::NONE,
            standing: Standing::new(limits.standing_kpa),
            last: None,
            held: 0,
        }
    }

    /// Nothing is known of a model that is put in while the rig is controlled, but that it was compared with the rig.
    pub(crate) fn compared(limits: Limits) -> Self {
        Contradiction { slowness: Slowness::COMPARED, ..Contradiction::new(limits) }
    }

    /// Begins anew after arming; what is known about the model stays.
    pub(crate) fn restart(&mut self) {
        self.sums.restart();
        self.standing.restart();
        self.held = 0;
    }

    /// Takes the ways of a tick under control; the sum that contradicts, while one does.
    pub(crate) fn judge(&mut self, ways: [Way; 2], motion: Motion) -> Option<Excess> {
        let factor = self.slowness.follow(ways);
        self.held = self.held.saturating_sub(1);
        let standing = self.standing.push(ways, factor).map(|kpa| Excess { kpa, by: Measure::Standing });
        let found = self.sums.push(left_kpa(ways, factor), factor, motion).or(standing);
        if found.is_some() {
            (self.last, self.held) = (found, HELD_TICKS);
        }
        self.last.filter(|_| self.held > 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ways(actual_kpa: f64, foreseen_kpa: [f64; 2]) -> [Way; 2] {
        foreseen_kpa.map(|foreseen_kpa| Way { actual_kpa, foreseen_kpa })
    }

    #[test]
    fn what_lies_between_forecasts_is_no_contradiction() {
        assert_eq!(left_kpa(ways(1.0, [0.5, 2.0]), 1.0), 0.0);
        assert_eq!(left_kpa(ways(2.5, [0.5, 2.0]), 1.0), 0.5);
        assert_eq!(left_kpa(ways(0.2, [0.5, 2.0]), 1.0), -0.3);
        // Five times as slow: 0.2 is as good as 1.
        assert_eq!(left_kpa(ways(0.2, [0.5, 2.0]), 0.2), 0.0);
        // What does not move, or the other way, is explained by no slowness.
        assert_eq!(left_kpa(ways(0.0, [0.5, 2.0]), 0.05), -0.5);
        assert_eq!(left_kpa(ways(-0.1, [0.5, 2.0]), 0.1), -0.6);
    }
}
