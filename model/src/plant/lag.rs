//! First-order lags over one integration step, whatever the step.
//!
//! `τ ẏ = p − y` with `p` on its way from `p₀` to `p₁` in proportion to time, over a step `h`, exactly:
//!
//! ```text
//! y ← y + a (p₀ + b (p₁ − p₀) − y),      a = 1 − e^(−h/τ),   b = 1/a − τ/h
//! ```
//!
//! With the mean of both ends instead (`b = ½`) a ramp is followed late by `h²/12τ` too much. At the 0.1 ms of a rig that is
//! nothing; at the 10 ms of averaged pumps a lag of 14 ms acts like one of 14.6, and a fit makes it as much shorter.

use crate::real::Real;

/// Shares of a lag in one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Share {
    /// `a`, the share of the distance that is covered (0 … 1).
    pub(crate) approach: f64,
    /// `b`, the part of its input's way that it goes for (½ … 1).
    pub(crate) ahead: f64,
}

impl Share {
    /// Shares of a time constant, in one step.
    pub(crate) fn of(time_constant_s: f64, step_s: f64) -> Self {
        let approach = -(-step_s / time_constant_s).exp_m1();
        Share { approach, ahead: 1.0 / approach - time_constant_s / step_s }
    }

    /// Shares of no lag.
    pub(crate) fn whole() -> Self {
        Share { approach: 1.0, ahead: 1.0 }
    }
}

/// Value that a lagged one comes to while its input goes `from` … `to`.
#[inline(always)]
pub(crate) fn follow<R: Real>(lagged: R, [from, to]: [R; 2], approach: R, ahead: R) -> R {
    let towards = ahead.mul_add(to - from, from);
    approach.mul_add(towards - lagged, lagged)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ramp is followed late by the time constant at any step, and a lag far faster than the step not at all.
    #[test]
    fn a_ramp_is_followed_late_by_the_time_constant() {
        for (time_constant_s, step_s) in [(0.014, 0.010), (0.014, 0.0001), (0.002, 0.010), (10.0, 0.010)] {
            let Share { approach, ahead } = Share::of(time_constant_s, step_s);
            let mut lagged = -time_constant_s;
            for k in 0..500 {
                let start = step_s * f64::from(k);
                lagged = follow(lagged, [start, start + step_s], approach, ahead);
            }
            let late_s = 500.0 * step_s - lagged;
            assert!((late_s - time_constant_s).abs() < 1e-9, "{late_s} for {time_constant_s} in steps of {step_s}");
        }
        let Share { approach, ahead } = Share::of(1e-5, 0.01);
        assert!((follow(0.0, [0.0, 1.0], approach, ahead) - 1.0).abs() < 2e-3);
    }
}
