//! Check of the plan that MPObs rolls ahead against what is then done.
//!
//! ```text
//! e_plan(τ)      = õ(τ+5) − o(τ+5)      õ rolled at τ from the plan of τ−1
//! e_unchanged(τ) = o(τ)   − o(τ+5)      what "nothing changes" errs
//! ```
//!
//! With a model that is the rig, the first comes of the plan and of the readings' noise alone.

use law::{ControlInput, ControlOutput};
use model::observation::{AHEAD, ActionTrajectory, CHANNELS, Pair};
use serde::Serialize;

use crate::closed_loop::Controller;
use crate::score::skipped_ticks;

/// One tick as the controller met it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlannedTick {
    /// Measured pressures in kPa gauge.
    pub measured_kpa: Pair,
    /// Readings that MPObs rolled ahead at this tick for the next five, in kPa gauge.
    pub predicted_kpa: [Pair; AHEAD],
    /// Duties decided for now, and planned for the next five ticks.
    pub trajectory: ActionTrajectory,
}

/// A controller that is watched: everything that it was told and planned is kept.
#[derive(Debug, Clone)]
pub struct Watched<C> {
    /// The controller.
    pub controller: C,
    /// Tick by tick.
    pub ticks: Vec<PlannedTick>,
}

impl<C> Watched<C> {
    /// Watches a controller.
    pub fn new(controller: C) -> Self {
        Watched { controller, ticks: Vec::new() }
    }
}

impl<C: Controller> Controller for Watched<C> {
    fn restart(&mut self, duty: Pair) {
        self.controller.restart(duty);
    }

    fn decide(&mut self, situation: &ControlInput, predicted_kpa: &[Pair; AHEAD]) -> ControlOutput {
        let decision = self.controller.decide(situation, predicted_kpa);
        self.ticks.push(PlannedTick {
            measured_kpa: situation.measured_kpa,
            predicted_kpa: *predicted_kpa,
            trajectory: decision.trajectory,
        });
        decision
    }

    fn applied(&mut self, duty: Pair) {
        self.controller.applied(duty);
    }
}

/// Errors five ticks ahead, root mean squares in kPa, positive and negative channel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PlanErrors {
    /// Error of MPObs, rolled from the plan.
    pub plan_kpa: Pair,
    /// Error of "nothing changes".
    pub unchanged_kpa: Pair,
}

impl PlanErrors {
    /// Over a run, its first seconds left out as in [`crate::Score`]; NaN if it is too short.
    pub fn of(ticks: &[PlannedTick]) -> Self {
        let counted = ticks.get(skipped_ticks()..).unwrap_or_default();
        let rms = |error: &dyn Fn(&PlannedTick, &PlannedTick, usize) -> f64| -> Pair {
            std::array::from_fn(|c| {
                let pairs = counted.iter().zip(counted.iter().skip(AHEAD));
                let (sum, count) =
                    pairs.fold((0.0, 0.0), |(s, n), (now, then)| (s + error(now, then, c).powi(2), n + 1.0));
                (sum / count).sqrt()
            })
        };
        PlanErrors {
            plan_kpa: rms(&|now, then, c| now.predicted_kpa[AHEAD - 1][c] - then.measured_kpa[c]),
            unchanged_kpa: rms(&|now, then, c| now.measured_kpa[c] - then.measured_kpa[c]),
        }
    }

    /// Share of what "nothing changes" errs.
    pub fn share(&self) -> Pair {
        std::array::from_fn(|c| self.plan_kpa[c] / self.unchanged_kpa[c])
    }
}

const _: () = assert!(CHANNELS == 2);

#[cfg(test)]
mod tests {
    use super::*;

    /// A ramp of 0.1 kPa a tick, foreseen 0.2 kPa too high: half a kPa in five ticks if nothing changed.
    #[test]
    fn errors_are_those_five_ticks_later() {
        let at = |tick: usize| [0.1 * tick as f64, -0.1 * tick as f64];
        let ticks: Vec<PlannedTick> = (0..400)
            .map(|tick| PlannedTick {
                measured_kpa: at(tick),
                predicted_kpa: std::array::from_fn(|j| at(tick + j + 1).map(|p| p + 0.2)),
                trajectory: ActionTrajectory::held([0.5; CHANNELS]),
            })
            .collect();
        let errors = PlanErrors::of(&ticks);
        for c in 0..CHANNELS {
            assert!((errors.plan_kpa[c] - 0.2).abs() < 1e-9 && (errors.unchanged_kpa[c] - 0.5).abs() < 1e-9);
            assert!((errors.share()[c] - 0.4).abs() < 1e-9);
        }
    }
}
