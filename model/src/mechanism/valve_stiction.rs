//! `valve_stiction`: the flapper stays where it is until the duty has moved away far enough, then jumps to it.
//!
//! ```text
//! y ← u   if |u − y| > d,      else y stays
//! ```
//!
//! (Stenman, Gustafsson & Forsman, *Int. J. Adapt. Control Signal Process.* 17, 2003: the one-parameter
//! model of static friction.) Slow ramps come out as staircases of step `d`, where play (`valve_hysteresis`)
//! gives smooth branches set apart; after a large step nothing of it is left. What is fitted is not smooth
//! in `d`: each jump comes in one instant or in the next.

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
}

numbers!(ValveStiction {
    band_duty: Number::new("duty", 0.0, 0.5)
        .plausible(0.003, 0.08)
        .starts(&[0.005, 0.01, 0.02, 0.04])
        .hint("how far the duty moves before the flapper does"),
});

impl Physics for ValveStiction {
    const ID: &'static str = "valve_stiction";
    const PLACES: &'static [Place] = &[Place::Valve];
    const SETTLED: bool = false;

    fn forms(_rig: &Rig, _component: &str) -> Vec<Form> {
        vec![Form::of("", Mechanism::ValveStiction(ValveStiction { band_duty: 0.0 }), &[0])]
    }
}

impl ValveStiction {
    pub(crate) fn operator(&self) -> Stick<f64> {
        Stick { band: self.band_duty }
    }
}

/// The stick-and-jump operator; its memory is the flapper's duty.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stick<R> {
    band: R,
}

impl<R: Real> Stick<R> {
    pub(crate) fn side_by_side(parts: &[Stick<f64>]) -> Self {
        Stick { band: lanes_of(parts, |p| p.band) }
    }

    #[inline(always)]
    pub(crate) fn run(&self, memory: &mut R, samples: &mut Samples<R>) {
        let mut flapper = *memory;
        samples.each(|duty| {
            flapper = R::from_lanes(|lane| {
                let (u, y) = (duty.lane(lane), flapper.lane(lane));
                if (u - y).abs() > self.band.lane(lane) { u } else { y }
            });
            flapper
        });
        *memory = flapper;
    }
}
