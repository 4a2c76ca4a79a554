//! `valve_stiction`: the flapper stays where it is until the duty has moved away far enough, then jumps.
//!
//! ```text
//! y ← u − ρ d sign(u − y)   if |u − y| > d,      else y stays
//! ```
//!
//! (Stenman, Gustafsson & Forsman, *Int. J. Adapt. Control Signal Process.* 17, 2003, for `ρ = 0`; with `ρ`, the
//! kinetic friction that is left while the flapper moves, it is the two-parameter model of He, Wang, Pottmann & Qin,
//! *Ind. Eng. Chem. Res.* 46, 2007: `d = f_S`, `ρ d = f_D`.) Slow ramps come out as staircases of step `(1 − ρ) d`, where
//! play (`valve_hysteresis`) gives smooth branches set apart; after a large step nothing but `ρ d` of it is left. What
//! is fitted is not smooth in `d`: each jump comes in one instant or in the next, and a cost is flat between two `d` at
//! which the same jumps come ([`super::Candidate::stepped`]).

use serde::{Deserialize, Serialize};

use super::{Form, Mechanism, Physics, Place};
use crate::plant::{Samples, lanes_of};
use crate::real::Real;
use crate::rig::{Number, Rig, numbers};

/// Static friction of a valve's flapper.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ValveStiction {
    /// d: by how much the duty must have moved before the flapper does, in duty (0 … 0.5).
    pub band_duty: f64,
    /// ρ: share of the band by which a jump ends short of the duty (0 … 1, below).
    #[serde(default)]
    pub short_of_it: f64,
}

numbers!(ValveStiction {
    band_duty: Number::new("duty", 0.0, 0.5)
        .plausible(0.003, 0.08)
        .starts(&[0.003, 0.0042, 0.006, 0.0085, 0.012, 0.017, 0.024, 0.034, 0.048, 0.068])
        .hint("how far the duty moves before the flapper does"),
    short_of_it: Number::new("", 0.0, 0.99).plausible(0.0, 0.8).starts(&[0.0, 0.3]).hint("a share of the band"),
});

impl Physics for ValveStiction {
    const ID: &'static str = "valve_stiction";
    const PLACES: &'static [Place] = &[Place::Valve];
    const SETTLED: bool = false;

    fn forms(_rig: &Rig, _component: &str) -> Vec<Form> {
        let free = ValveStiction { band_duty: 0.0, short_of_it: 0.0 };
        vec![Form::of("", Mechanism::ValveStiction(free), &[0, 1]).stepped()]
    }
}

impl ValveStiction {
    pub(crate) fn operator(&self) -> Stick<f64> {
        Stick { band: self.band_duty, short: self.short_of_it * self.band_duty }
    }
}

/// The stick-and-jump operator; its memory is the flapper's duty.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stick<R> {
    band: R,
    /// By how much a jump ends short of the duty.
    short: R,
}

impl<R: Real> Stick<R> {
    pub(crate) fn side_by_side(parts: &[Stick<f64>]) -> Self {
        Stick { band: lanes_of(parts, |p| p.band), short: lanes_of(parts, |p| p.short) }
    }

    #[inline(always)]
    pub(crate) fn run(&self, memory: &mut R, samples: &mut Samples<R>) {
        let mut flapper = *memory;
        samples.each(|duty| {
            flapper = R::from_lanes(|lane| {
                let (u, y) = (duty.lane(lane), flapper.lane(lane));
                let away = u - y;
                if away.abs() > self.band.lane(lane) { u - self.short.lane(lane) * away.signum() } else { y }
            });
            flapper
        });
        *memory = flapper;
    }
}
