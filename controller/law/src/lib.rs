//! Control laws of the dual-pressure rig, free of sockets, clocks and files.
//!
//! | module | subject |
//! | --- | --- |
//! | [`fallback`] | feed-forward PI: what flies when no policy does |
//! | [`policy_law`] | what a policy is told, and how its answer becomes a duty |
//! | [`integral`] | the paper's integral action and anti-windup, on top of a policy or of the fallback |
//! | [`repetition`] | what a reference flown again and again teaches |
//! | [`repetitions`] | the same of several references, each kept by itself |
//! | [`course`] | where on its reference a run is: approach, flights, goals |
//! | [`rest`] | holds on which integral action stands still |
//! | [`soft_start`] | from where the rig is to where the reference is, without saturating |
//! | [`foresight`] | feed-forward: the reference, as much ahead as each valve is late |
//! | [`direction`] | which way a planned duty moves, for play in a valve |
//! | `plays` | plays of several widths side by side, undone |
//!
//! A law is told the [`ControlInput`] of a tick and answers with a [`ControlOutput`]; once limits have made the duty
//! that is really sent, it is told that too, so that what saturates does not wind up. Daemon, trainer and
//! tests use these same laws. Everything here is bounded and allocation-free and may run in the tick.

pub mod course;
pub mod direction;
pub mod fallback;
pub mod foresight;
pub mod integral;
mod plays;
pub mod policy_law;
pub mod repetition;
pub mod repetitions;
pub mod rest;
pub mod soft_start;

pub use course::{AfterEnd, Course};
pub use fallback::{Fallback, FallbackSettings};
pub use integral::{IntegralAction, IntegralSettings};
pub use policy_law::PolicyLaw;
pub use repetition::{Left, Repetition, RepetitionLearning};
pub use repetitions::Repetitions;
pub use soft_start::SoftStart;

use model::observation::{AHEAD, ActionTrajectory, CHANNELS, GOALS_AHEAD, Pair, TICKS_PER_S};

/// Length of a control tick in seconds.
pub const TICK_S: f64 = 1.0 / TICKS_PER_S;

/// Knowledge of a law at a tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ControlInput {
    /// Measured pressures in kPa gauge.
    pub measured_kpa: Pair,
    /// Readings of sensors that neither lag nor swing, in kPa gauge: see [`model::predict::Predictor::observe`].
    /// They are the measured ones where nobody knows of a lag.
    pub undelayed_kpa: Pair,
    /// Goals in kPa gauge: now, and the next fifteen ticks.
    pub goals_kpa: [Pair; GOALS_AHEAD + 1],
    /// Duties that earlier flights of the reference have taught, for now and the next five ticks ([`Repetition::learned`]); nothing
    /// where nothing learns, or in flights that teach play.
    pub learned_duty: Option<[Pair; AHEAD + 1]>,
}

impl ControlInput {
    /// Knowledge where sensors read what is there.
    pub fn of_measured(measured_kpa: Pair, goals_kpa: [Pair; GOALS_AHEAD + 1]) -> Self {
        ControlInput { measured_kpa, undelayed_kpa: measured_kpa, goals_kpa, learned_duty: None }
    }
}

/// Terms that make up the duty of one channel, before limits.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct DutyTerms {
    /// Feed-forward, or the policy's action (duty).
    pub feed_forward: f64,
    /// Term that undoes the valve's play (duty).
    pub play: f64,
    /// Correction that a policy adds to the fallback (duty).
    pub correction: f64,
    /// Proportional part (duty).
    pub proportional: f64,
    /// Integral part (duty).
    pub integral: f64,
}

impl DutyTerms {
    /// The sum.
    pub fn raw(&self) -> f64 {
        self.feed_forward + self.play + self.correction + self.proportional + self.integral
    }
}

/// Answer of a law.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ControlOutput {
    /// Terms that make up the duties, positive and negative channel.
    pub parts: [DutyTerms; CHANNELS],
    /// Duties for now and the next five ticks, within 0 … 1; what MPObs rolls ahead at the next tick.
    pub trajectory: ActionTrajectory,
}

impl ControlOutput {
    /// The duties before limits.
    pub fn raw(&self) -> Pair {
        self.parts.map(|p| p.raw())
    }

    /// The duties within 0 … 1.
    pub fn duty(&self) -> Pair {
        self.trajectory.now()
    }
}

/// Limits a duty to 0 … 1; NaN becomes 1, the vent.
pub fn saturated(duty: f64) -> f64 {
    if duty.is_nan() { 1.0 } else { duty.clamp(0.0, 1.0) }
}
