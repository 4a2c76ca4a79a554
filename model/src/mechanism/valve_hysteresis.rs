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
//! Friction is not the same everywhere on a flapper's way: with `spread_duty` = `s` the half widths of five plays side
//! by side lie evenly within `w − s … w + s` and the opening follows their mean (a Prandtl-Ishlinskii model, which is a
//! Preisach model whose density depends on the width alone). Loops then come out round, and thin out as they get
//! smaller: a sweep over a range `A` encloses the mean of `2 w_i (A − 2 w_i)` over the plays narrower than `A/2`, and
//! `x` after turning round the opening lags by the mean of `min(x, 2 w_i)`.
//!
//! Two published calibrations of the paper's valve family (SMC PVQ31-5G-23-01N) say what `w` is before anything is
//! recorded. One lies 5-8 % of duty apart between rising and falling, `w = 0.033` (17 levels from 10 to 90 % open). In
//! the other the branches cross and differ by 0.0047 (root mean square over the same levels of flow), which bounds the
//! play from above. Two valves of one type number: the geometric mean is 0.012, the logarithm's standard deviation 1.
//! How these were computed: `docs/bring-your-own-rig.md`.

use serde::{Deserialize, Serialize};

use super::{Form, Mechanism, Physics, Place, is_zero};
use crate::plant::{Samples, lanes_of};
use crate::real::Real;
use crate::rig::{Number, Rig, numbers};

/// A play operator on a valve's duty.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ValveHysteresis {
    /// Half the distance between the rising and the falling branch, in duty (0 … 0.5).
    pub half_width_duty: f64,
    /// Distance by which the half widths of five plays side by side reach to either side of it, in duty (0 … 0.5; none is
    /// narrower than nothing). Left out or zero there is one play.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub spread_duty: f64,
}

numbers!(ValveHysteresis {
    half_width_duty: Number::new("duty", 0.0, 0.5)
        .plausible(0.002, 0.15)
        .starts(&[0.005, 0.015, 0.03, 0.06])
        .usually(0.012, 1.0)
        .hint("half of the gap between rising and falling"),
    spread_duty: Number::new("duty", 0.0, 0.5)
        .plausible(0.001, 0.06)
        .starts(&[0.005, 0.015])
        .hint("leave it out for one play")
        .optional(),
});

impl Physics for ValveHysteresis {
    const ID: &'static str = "valve_hysteresis";
    const PLACES: &'static [Place] = &[Place::Valve];
    const SETTLED: bool = false;

    fn forms(_rig: &Rig, _component: &str) -> Vec<Form> {
        let none = Mechanism::ValveHysteresis(ValveHysteresis { half_width_duty: 0.0, spread_duty: 0.0 });
        vec![Form::of("", none.clone(), &[0]), Form::of("spread", none, &[0, 1])]
    }
}

impl ValveHysteresis {
    /// Half widths of the plays side by side, in duty; all alike where they do not scatter.
    pub fn half_widths_duty(&self) -> [f64; PLAYS] {
        self.operator().half_widths()
    }

    pub(crate) fn operator(&self) -> Play<f64> {
        Play { half_width: self.half_width_duty, spread: self.spread_duty, is_spread: self.spread_duty > 0.0 }
    }
}

/// Plays side by side where their widths scatter.
pub const PLAYS: usize = 5;
/// The one of stated width, and the only one where they do not scatter.
const MIDDLE: usize = PLAYS / 2;

/// The play operator; its memory is the flapper's duty, for each play.
///
/// All plays have their places in the memory even where only the middle one acts, so that lanes with and without spread
/// lie side by side.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Play<R> {
    half_width: R,
    spread: R,
    /// True where widths scatter in any lane.
    is_spread: bool,
}

impl<R: Real> Play<R> {
    /// Numbers it remembers.
    pub(crate) const MEMORY: usize = PLAYS;

    pub(crate) fn side_by_side(parts: &[Play<f64>]) -> Self {
        Play {
            half_width: lanes_of(parts, |p| p.half_width),
            spread: lanes_of(parts, |p| p.spread),
            is_spread: parts.iter().any(|p| p.is_spread),
        }
    }

    /// Half widths of the plays.
    fn half_widths(&self) -> [R; PLAYS] {
        std::array::from_fn(|i| {
            // Middles of five even parts of the range.
            let off = (2.0 * i as f64 + 1.0) / PLAYS as f64 - 1.0;
            let off = if i == MIDDLE { 0.0 } else { off };
            self.spread.mul_add(R::splat(off), self.half_width).at_least(R::splat(0.0))
        })
    }

    /// Moves flappers that lie in the middle of their play, by a share of its half width (−1 … 1); what comes out then.
    pub(crate) fn place(&self, share: R, memory: &mut [R]) -> R {
        let mut sum = R::splat(0.0);
        for (flapper, half_width) in memory.iter_mut().zip(self.half_widths()) {
            *flapper += half_width * share;
            sum += *flapper;
        }
        self.out(sum, memory.get(MIDDLE).copied().unwrap_or(sum))
    }

    /// Output, from the sum of all plays and the middle one: a lane of one play has the bits it would have by itself.
    #[inline(always)]
    fn out(&self, sum: R, middle: R) -> R {
        let mean = sum * R::splat(1.0 / PLAYS as f64);
        R::from_lanes(|lane| if self.spread.lane(lane) > 0.0 { mean.lane(lane) } else { middle.lane(lane) })
    }

    #[inline(always)]
    pub(crate) fn run(&self, memory: &mut [R], samples: &mut Samples<R>) {
        let Some(memory) = memory.first_chunk_mut::<PLAYS>() else { return };
        if !self.is_spread {
            let mut flapper = memory[MIDDLE];
            for duty in samples.in_time() {
                flapper = pulled(flapper, *duty, self.half_width);
                *duty = flapper;
            }
            memory[MIDDLE] = flapper;
            return;
        }
        let half_widths = self.half_widths();
        for duty in samples.in_time() {
            let mut sum = R::splat(0.0);
            for (flapper, half_width) in memory.iter_mut().zip(&half_widths) {
                *flapper = pulled(*flapper, *duty, *half_width);
                sum += *flapper;
            }
            *duty = self.out(sum, memory[MIDDLE]);
        }
    }
}

/// Where a duty has pulled a flapper that has this much room to either side.
#[inline(always)]
fn pulled<R: Real>(flapper: R, duty: R, half_width: R) -> R {
    flapper.at_least(duty - half_width).at_most(duty + half_width)
}
