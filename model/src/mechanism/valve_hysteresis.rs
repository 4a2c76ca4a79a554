//! `valve_hysteresis`: the opening at a duty depends on whether the duty rose or fell to it.
//!
//! A play (backlash) operator of half width `w` between the coil's duty and the flapper's:
//!
//! ```text
//! y ← min(max(y, u − w), u + w)
//! ```
//!
//! (Visintin, *Differential Models of Hysteresis*, 1994; the elementary operator of Prandtl-Ishlinskii
//! models.) It is rate independent: slow and fast sweeps draw the same loop, which tells it from a lag.
//! Published calibrations of the paper's valve family (SMC PVQ31) differ by 5-8 % of duty between
//! rising and falling, so `w` is about 0.03 there.

use serde::{Deserialize, Serialize};

use crate::plant::{Samples, lanes_of};
use crate::real::Real;
use crate::rig::{RigError, within};

/// A play operator on a valve's duty.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ValveHysteresis {
    /// Half the distance between the rising and the falling branch, in duty (0 … 0.5).
    pub half_width_duty: f64,
}

impl ValveHysteresis {
    pub(super) fn check(&self, key: &str) -> Result<(), RigError> {
        within(
            &format!("{key}.half_width_duty"),
            self.half_width_duty,
            0.0,
            0.5,
            "duty",
            "half of the gap between rising and falling",
        )
    }

    pub(crate) fn operator(&self) -> Play<f64> {
        Play { half_width: self.half_width_duty }
    }
}

/// The play operator; its memory is the flapper's duty.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Play<R> {
    half_width: R,
}

impl<R: Real> Play<R> {
    pub(crate) fn side_by_side(parts: &[Play<f64>]) -> Self {
        Play { half_width: lanes_of(parts, |p| p.half_width) }
    }

    #[inline(always)]
    pub(crate) fn run(&self, memory: &mut R, samples: &mut Samples<R>) {
        let mut flapper = *memory;
        samples.each(|duty| {
            flapper = flapper.at_least(duty - self.half_width).at_most(duty + self.half_width);
            flapper
        });
        *memory = flapper;
    }
}
