//! `command_delay`: a duty acts a fixed time after it was sent.
//!
//! `y(t) = u(t − d)`: latching at the cRIO's next edge, transport, driver. Any `d` up to
//! [`LONGEST_TICKS`] ticks; a part of a tick switches at the matching instant of the table, blended linearly
//! over one such interval so that a fit sees a smooth function of `d`.

use serde::{Deserialize, Serialize};

use crate::plant::{Samples, lanes_of};
use crate::real::Real;
use crate::rig::{RigError, within};

/// The longest delay in ticks.
pub(crate) const LONGEST_TICKS: usize = 8;

/// A pure delay of a valve's duty.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CommandDelay {
    /// The delay in ms.
    pub delay_ms: f64,
}

impl CommandDelay {
    pub(super) fn check(&self, key: &str, tick_ms: f64) -> Result<(), RigError> {
        let longest = LONGEST_TICKS as f64 * tick_ms;
        within(&format!("{key}.delay_ms"), self.delay_ms, 0.0, longest, "ms", "eight ticks at most")
    }

    pub(crate) fn operator(&self, tick_ms: f64) -> Delay<f64> {
        // Rounding of the division must not push a delay at the upper limit beyond the memory.
        let ticks = (self.delay_ms / tick_ms).min(LONGEST_TICKS as f64);
        Delay { whole: ticks.floor(), part: ticks.fract() }
    }
}

/// The delay; its memory holds the last duties, newest first.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Delay<R> {
    /// Whole ticks of delay.
    whole: R,
    /// The rest, as a part of a tick (0 … 1).
    part: R,
}

impl<R: Real> Delay<R> {
    pub(crate) fn side_by_side(parts: &[Delay<f64>]) -> Self {
        Delay { whole: lanes_of(parts, |p| p.whole), part: lanes_of(parts, |p| p.part) }
    }

    #[inline(always)]
    pub(crate) fn run(&self, memory: &mut [R], samples: &mut Samples<R>) {
        let now = samples.first();
        // Duty sent `n` ticks ago, lane by lane: lanes may differ in their delay.
        let sent = |extra: usize| {
            R::from_lanes(|lane| {
                let ticks = self.whole.lane(lane) as usize + extra;
                if ticks == 0 { now.lane(lane) } else { memory.get(ticks - 1).map_or(now.lane(lane), |u| u.lane(lane)) }
            })
        };
        let (newer, older) = (sent(0), sent(1));
        if self.part.any_above(R::splat(0.0)) {
            samples.spread();
            let instants = samples.instants() as f64;
            let mut j = 0.0;
            samples.each(|_| {
                let past = R::splat(j) - self.part * R::splat(instants) + R::splat(1.0);
                let weight = past.limited(R::splat(0.0), R::splat(1.0));
                j += 1.0;
                // Not `older + weight (newer − older)`: at weight one this is the newer duty to the last bit, as
                // in a run alone, when a neighbour's delay makes a lane without a part of a tick come here.
                weight.mul_add(newer, (R::splat(1.0) - weight) * older)
            });
        } else {
            samples.each(|_| newer);
        }
        memory.rotate_right(1);
        if let Some(newest) = memory.first_mut() {
            *newest = now;
        }
    }
}
