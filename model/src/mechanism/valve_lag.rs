//! `valve_lag`: coil current and armature follow the duty with a first-order lag.
//!
//! ```text
//! τ ẏ = u − y,        τ = τ_r while u > y, τ_f while u < y
//! ```
//!
//! L/R of a coil and the armature's inertia put `τ` at 5 … 200 ms for proportional solenoids of this size. The coil is late
//! in front of what friction and magnetic hysteresis make of its current, the armature behind them (`lags`); without
//! either the two are the same.
//!
//! A coil is switched on against its supply and off against whatever its driver lets its current fall by: through a diode at
//! about `L/R` as well, through a resistor or a Zener diode sooner; eddy currents and a closed air gap hold the flux, and make
//! falling the slower one. `falling_over_rising` is `τ_f/τ_r`; absent it is 1.
//!
//! Solved exactly between tabled instants `s` apart, `y ← u + (y − u) e^(−s/τ)`, so it costs no integrator state
//! and cannot go unstable however short `τ` is.

use serde::{Deserialize, Serialize};

use super::command_delay::needs_a_command;
use super::{Form, Mechanism, Physics, Place};
use crate::plant::{Samples, lanes_of};
use crate::real::Real;
use crate::rig::{Number, Rig, RigError, numbers};

/// Part of a valve that is late.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Lags {
    /// The current: in front of friction and hysteresis.
    #[default]
    Coil,
    /// Armature that the current moves, behind them.
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
    /// Part that is late; absent means the coil.
    #[serde(default, skip_serializing_if = "Lags::is_coil")]
    pub lags: Lags,
    /// Time constant of a falling duty over that of a rising one, which `time_constant_ms` then is; absent means 1.
    #[serde(default = "alike", skip_serializing_if = "is_alike")]
    pub falling_over_rising: f64,
}

/// Falling takes as long as rising.
fn alike() -> f64 {
    1.0
}

fn is_alike(falling_over_rising: &f64) -> bool {
    *falling_over_rising == alike()
}

numbers!(ValveLag {
    time_constant_ms: Number::new("ms", 0.01, 10_000.0).plausible(1.0, 800.0).starts(&[8.0, 25.0, 60.0, 150.0]),
    falling_over_rising: Number::new("", 0.01, 100.0)
        .plausible(0.25, 4.0)
        .starts(&[1.3])
        .hint("a ratio: 1 for a fall that takes as long as a rise")
        .optional(),
});

impl Physics for ValveLag {
    const ID: &'static str = "valve_lag";
    const PLACES: &'static [Place] = &[Place::Valve, Place::Pump];
    const SETTLED: bool = false;

    fn check(&self, rig: &Rig, component: &str, key: &str) -> Result<(), RigError> {
        needs_a_command(Self::ID, rig, component, key)
    }

    fn forms(_rig: &Rig, _component: &str) -> Vec<Form> {
        let late = |lags| Mechanism::ValveLag(ValveLag { time_constant_ms: 0.01, lags, falling_over_rising: alike() });
        vec![
            Form::of("", late(Lags::Coil), &[0]),
            Form::of("armature", late(Lags::Armature), &[0]).beside(&["valve_hysteresis", "valve_stiction"]),
            Form::of("falling", late(Lags::Coil), &[0, 1]).refinement(),
        ]
    }
}

impl ValveLag {
    pub(crate) fn operator(&self, instant_s: f64) -> Lag<f64> {
        let approach = |time_constant_ms: f64| -(-instant_s / (time_constant_ms * 1e-3)).exp_m1();
        Lag {
            rising: approach(self.time_constant_ms),
            falling: approach(self.time_constant_ms * self.falling_over_rising),
        }
    }
}

/// The lag from one tabled instant to the next; its memory is the lagged duty.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lag<R> {
    /// 1 − e^(−s/τ_r): the share of the distance covered upwards.
    rising: R,
    /// 1 − e^(−s/τ_f): the same downwards.
    falling: R,
}

impl<R: Real> Lag<R> {
    pub(crate) fn side_by_side(parts: &[Lag<f64>]) -> Self {
        Lag { rising: lanes_of(parts, |p| p.rising), falling: lanes_of(parts, |p| p.falling) }
    }

    #[inline(always)]
    pub(crate) fn run(&self, memory: &mut R, samples: &mut Samples<R>) {
        samples.spread();
        let zero = R::splat(0.0);
        let mut lagged = *memory;
        let mut first = true;
        for duty in samples.in_time() {
            // The first sample is the tick's own start, where the memory already stands.
            if !first {
                let distance = *duty - lagged;
                let up = self.rising.mul_add(distance.at_least(zero), lagged);
                lagged = self.falling.mul_add(distance.at_most(zero), up);
            }
            first = false;
            *duty = lagged;
        }
        *memory = lagged;
    }
}
