//! `valve_lag`: coil current and armature follow the duty with a first-order lag.
//!
//! ```text
//! τ ẏ = u − y
//! ```
//!
//! L/R of a coil and the armature's inertia put `τ` at 5 … 200 ms for proportional solenoids of this size. The coil is late
//! in front of what friction and magnetic hysteresis make of its current, the armature behind them (`lags`); without
//! either the two are the same.
//!
//! Solved exactly between tabled instants `s` apart, `y ← u + (y − u) e^(−s/τ)`, so it costs no integrator state
//! and cannot go unstable however short `τ` is.

use serde::{Deserialize, Serialize};

use super::command_delay::needs_a_command;
use super::{Form, Mechanism, Physics, Place};
use crate::plant::{Samples, lanes_of};
use crate::real::Real;
use crate::rig::{Number, Rig, RigError, numbers};

/// What of a valve is late.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Lags {
    /// The current: in front of friction and hysteresis.
    #[default]
    Coil,
    /// What the current moves: behind them.
    Armature,
}

impl Lags {
    fn is_coil(&self) -> bool {
        *self == Lags::Coil
    }
}

/// A first-order lag of a valve behind its duty.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ValveLag {
    /// Time constant τ in ms.
    pub time_constant_ms: f64,
    /// What is late; absent means the coil.
    #[serde(default, skip_serializing_if = "Lags::is_coil")]
    pub lags: Lags,
}

numbers!(ValveLag {
    time_constant_ms: Number::new("ms", 0.01, 10_000.0).plausible(1.0, 800.0).starts(&[8.0, 25.0, 60.0, 150.0]),
});

impl Physics for ValveLag {
    const ID: &'static str = "valve_lag";
    const PLACES: &'static [Place] = &[Place::Valve, Place::Pump];
    const SETTLED: bool = false;

    fn check(&self, rig: &Rig, component: &str, key: &str) -> Result<(), RigError> {
        needs_a_command(Self::ID, rig, component, key)
    }

    fn forms(_rig: &Rig, _component: &str) -> Vec<Form> {
        let late = |lags| Mechanism::ValveLag(ValveLag { time_constant_ms: 0.01, lags });
        vec![
            Form::of("", late(Lags::Coil), &[0]),
            Form::of("armature", late(Lags::Armature), &[0]).beside(&["valve_hysteresis", "valve_stiction"]),
        ]
    }
}

impl ValveLag {
    pub(crate) fn operator(&self, instant_s: f64) -> Lag<f64> {
        Lag { approach: -(-instant_s / (self.time_constant_ms * 1e-3)).exp_m1() }
    }
}

/// The lag from one tabled instant to the next; its memory is the lagged duty.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lag<R> {
    /// 1 − e^(−s/τ): the share of the distance covered.
    approach: R,
}

impl<R: Real> Lag<R> {
    pub(crate) fn side_by_side(parts: &[Lag<f64>]) -> Self {
        Lag { approach: lanes_of(parts, |p| p.approach) }
    }

    #[inline(always)]
    pub(crate) fn run(&self, memory: &mut R, samples: &mut Samples<R>) {
        samples.spread();
        let mut lagged = *memory;
        let mut first = true;
        for duty in samples.in_time() {
            // The first sample is the tick's own start, where the memory already stands.
            if !first {
                lagged = self.approach.mul_add(*duty - lagged, lagged);
            }
            first = false;
            *duty = lagged;
        }
        *memory = lagged;
    }
}
