//! `valve_stiction`: the flapper stays where it is until what moves it has changed far enough, then jumps.
//!
//! ```text
//! y ← h − ρ d sign(h − y)   if |h − y| > d,      else y stays
//! ```
//!
//! What rubs decides what `h` is (`rubs`): for the plunger in its guide the duty, `h = u`; for the flapper the balance of all
//! forces on it in units of duty, `h = u + (Ĉ_P (πD²/4) ΔP)/Ĉ_u` (paper eq. (5)), so that pressure alone can break it loose,
//! and while it sticks the valve is a fixed orifice of area `Ĉ_u y − Ĉ_k`.
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

/// Part of a valve that rubs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Rubs {
    /// The plunger in its guide, which knows the duty alone.
    #[default]
    Plunger,
    /// The flapper, which the pressure pushes too.
    Flapper,
}

impl Rubs {
    fn is_plunger(&self) -> bool {
        *self == Rubs::Plunger
    }
}

/// Static friction of a valve's plunger or flapper.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ValveStiction {
    /// d: by how much the duty must have moved before the flapper does, in duty (0 … 0.5).
    pub band_duty: f64,
    /// ρ: share of the band by which a jump ends short of the duty (0 … 1, below).
    #[serde(default)]
    pub short_of_it: f64,
    /// Part that rubs; absent means the plunger.
    #[serde(default, skip_serializing_if = "Rubs::is_plunger")]
    pub rubs: Rubs,
}

numbers!(ValveStiction {
    band_duty: Number::new("duty", 0.0, 0.5)
        .plausible(0.003, 0.2)
        .starts(&[0.003, 0.0042, 0.006, 0.0085, 0.012, 0.017, 0.024, 0.034, 0.048, 0.068, 0.096, 0.135])
        .hint("how far the duty moves before the flapper does"),
    short_of_it: Number::new("", 0.0, 0.99).plausible(0.0, 0.8).starts(&[0.0, 0.3]).hint("a share of the band"),
});

impl Physics for ValveStiction {
    const ID: &'static str = "valve_stiction";
    const PLACES: &'static [Place] = &[Place::Valve];
    const SETTLED: bool = false;

    fn forms(_rig: &Rig, _component: &str) -> Vec<Form> {
        let sticks = |rubs| Mechanism::ValveStiction(ValveStiction { band_duty: 0.0, short_of_it: 0.0, rubs });
        vec![
            Form::of("", sticks(Rubs::Plunger), &[0, 1]).stepped(),
            Form::of("flapper", sticks(Rubs::Flapper), &[0, 1]).stepped(),
        ]
    }
}

impl ValveStiction {
    pub(crate) fn operator(&self) -> Stick<f64> {
        Stick { band: self.band_duty, short: self.short_of_it * self.band_duty }
    }
}

/// The stick-and-jump operator; its memory is where it stands, in duty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Stick<R> {
    pub(crate) band: R,
    /// By how much a jump ends short.
    pub(crate) short: R,
}

impl<R: Real> Stick<R> {
    /// Where what stood at `at` stands once `pulled` acts.
    #[inline(always)]
    pub(crate) fn moved(&self, at: R, pulled: R) -> R {
        self.moved_within(at, pulled, [pulled; 2])
    }

    /// Motion while what pulls swings between two ends within a revolution of a pump: where its peaks reach the band, it
    /// moves at the band's edge.
    #[inline(always)]
    pub(crate) fn moved_within(&self, at: R, pulled: R, [low, high]: [R; 2]) -> R {
        R::from_lanes(|lane| {
            let (h, y, band) = (pulled.lane(lane), at.lane(lane), self.band.lane(lane));
            let (low, high, short) = (low.lane(lane), high.lane(lane), self.short.lane(lane));
            if high - y > band {
                (if low - y > band { h } else { y + band }) - short
            } else if y - low > band {
                (if y - high > band { h } else { y - band }) + short
            } else {
                y
            }
        })
    }

    pub(crate) fn side_by_side(parts: &[Stick<f64>]) -> Self {
        Stick { band: lanes_of(parts, |p| p.band), short: lanes_of(parts, |p| p.short) }
    }

    #[inline(always)]
    pub(crate) fn run(&self, memory: &mut R, samples: &mut Samples<R>) {
        let mut flapper = *memory;
        for duty in samples.in_time() {
            flapper = self.moved(flapper, *duty);
            *duty = flapper;
        }
        *memory = flapper;
    }
}
