//! `residual_response`: a reading that answers the pressure in a way nobody has a name for, as a second-order system.
//!
//! A fitted stand-in for physics that the library lacks between a chamber and its sensor:
//!
//! ```text
//! z̈/ω² + 2 ζ ż/ω + z = P        ω = 2π f
//! y = P + c (z − P)
//! ```
//!
//! Below `ζ = 1` it rings: gas that swings to and fro in a long thin hose, a membrane with a mass. From there on it is two
//! lags in a row. The share `c` of the reading that answers so is 1 where all of it does. Steady pressures are read as they are and the chamber itself never hears of it; above its natural frequency
//! little comes through. It names nothing: it says how a reading answers, and lets the rig be simulated with it.

use serde::{Deserialize, Serialize};

use super::{Form, Physics, Place};
use crate::rig::{Number, Rig, numbers};

/// A second-order answer of a reading to the pressure.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ResidualResponse {
    /// f: undamped natural frequency in Hz.
    pub natural_frequency_hz: f64,
    /// ζ: damping ratio, a bare number; below 1 the reading overshoots.
    pub damping_ratio: f64,
    /// c: share of the reading that answers so, a bare number; 1 is all of it.
    #[serde(default = "all")]
    pub share: f64,
}

fn all() -> f64 {
    1.0
}

numbers!(ResidualResponse {
    natural_frequency_hz: Number::new("Hz", 0.01, 10_000.0).plausible(0.1, 50.0),
    damping_ratio: Number::new("", 0.0, 100.0).plausible(0.02, 5.0),
    share: Number::new("", -100.0, 100.0).plausible(-1.0, 2.0),
});

impl Physics for ResidualResponse {
    const ID: &'static str = "residual_response";
    const PLACES: &'static [Place] = &[Place::Sensor];
    const SETTLED: bool = false;

    fn forms(_rig: &Rig, _component: &str) -> Vec<Form> {
        Vec::new()
    }
}

impl ResidualResponse {
    /// ω in rad/s.
    pub(crate) fn natural_rad_s(&self) -> f64 {
        std::f64::consts::TAU * self.natural_frequency_hz
    }

    /// Motion in `step_s` under a pressure that stays as it is, exactly.
    pub fn swing(&self, step_s: f64) -> Swing {
        let (angle, zeta) = (self.natural_rad_s() * step_s, self.damping_ratio);
        let squared = (1.0 - zeta * zeta) * angle * angle;
        let root = squared.abs().sqrt();
        // e^(−ζωh) taken into both, or a strongly damped one would be infinite times nothing.
        let decayed = |rate: f64| (rate - zeta * angle).exp();
        let (even, odd) = if squared < -1e-8 {
            (0.5 * (decayed(root) + decayed(-root)), 0.5 * (decayed(root) - decayed(-root)) / root)
        } else {
            // sin x / x within 1e-17 below 1e-8.
            let share = if root < 1e-8 { 1.0 } else { root.sin() / root };
            (decayed(0.0) * root.cos(), decayed(0.0) * share)
        };
        Swing { keeps: zeta * angle * odd + even, turns: angle * odd, damps: even - zeta * angle * odd }
    }
}

/// A step of a second-order answer: what is left of how far `z` is off, and of its speed over ω.
///
/// ```text
/// z − P ← keeps (z − P) + turns w        w = ż/ω
///     w ← damps w − turns (z − P)
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Swing {
    /// Share of the distance that is left.
    pub keeps: f64,
    /// Part of the speed that goes into the distance, and the other way with the opposite sign.
    pub turns: f64,
    /// Share of the speed that is left.
    pub damps: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against small steps of the equation itself, ringing, critically damped and creeping.
    #[test]
    fn a_step_is_the_equations() {
        for (natural_frequency_hz, damping_ratio) in
            [(3.0, 0.1), (3.0, 0.9), (2.0, 1.0), (2.0, 1.0 + 1e-9), (1.0, 4.0), (9.0, 60.0)]
        {
            let response = ResidualResponse { natural_frequency_hz, damping_ratio, share: 1.0 };
            let omega = response.natural_rad_s();
            let whole = response.swing(0.02);
            let (mut y, mut w) = (1.0_f64, 0.3_f64);
            let expected = [whole.keeps * y + whole.turns * w, whole.damps * w - whole.turns * y];
            // Midpoint rule.
            let (steps, rate) = (200_000, |y: f64, w: f64| (omega * w, -omega * (y + 2.0 * damping_ratio * w)));
            let h = 0.02 / f64::from(steps);
            for _ in 0..steps {
                let (dy, dw) = rate(y, w);
                let (dy, dw) = rate(y + 0.5 * h * dy, w + 0.5 * h * dw);
                (y, w) = (y + h * dy, w + h * dw);
            }
            // The rule's own error: (h ω ζ)³ a step, 1e-9 of the stiffest in all.
            assert!(
                (expected[0] - y).abs() < 1e-7 && (expected[1] - w).abs() < 1e-7,
                "{response:?}: {expected:?}, {y} {w}"
            );
        }
    }
}
