//! `valve_lag`: coil current and armature follow the duty with a first-order lag.
//!
//! ```text
//! τ ẏ = u − y
//! ```
//!
//! L/R of a coil and the armature's inertia put `τ` at 5 … 200 ms for proportional solenoids of this size.
//! Solved exactly between half steps, `y ← u + (y − u) e^(−h/2τ)`, so it costs no integrator state
//! and cannot go unstable however short `τ` is.

use serde::{Deserialize, Serialize};

use crate::plant::{Samples, lanes_of};
use crate::real::Real;
use crate::rig::{RigError, within};

/// A first-order lag of a valve behind its duty.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ValveLag {
    /// Time constant τ in ms.
    pub time_constant_ms: f64,
}

impl ValveLag {
    pub(super) fn check(&self, key: &str) -> Result<(), RigError> {
        within(&format!("{key}.time_constant_ms"), self.time_constant_ms, 0.01, 10_000.0, "ms", "")
    }

    pub(crate) fn operator(&self, half_step_s: f64) -> Lag<f64> {
        Lag { approach: -(-half_step_s / (self.time_constant_ms * 1e-3)).exp_m1() }
    }
}

/// The lag over one half step; its memory is the lagged duty.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lag<R> {
    /// 1 − e^(−h/2τ): the share of the distance covered in a half step.
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
        samples.each(|duty| {
            // The first sample is the tick's own start, where the memory already stands.
            if !first {
                lagged = self.approach.mul_add(duty - lagged, lagged);
            }
            first = false;
            lagged
        });
        *memory = lagged;
    }
}
