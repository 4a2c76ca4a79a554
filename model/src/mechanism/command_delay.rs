//! `command_delay`: a duty acts a fixed time after it was sent.
//!
//! `y(t) = u(t − d)`: latching at the cRIO's next edge, transport, driver. Any `d` up to
//! [`LONGEST_TICKS`] ticks. Where a part of a tick ends between two instants of the table, the one that is nearer holds the mean of
//! what is there, so that the mean over a tick is that of the edge itself: a fit sees a function of `d` that has no jump where a
//! delay becomes a whole number of ticks.

use serde::{Deserialize, Serialize};

use super::{Form, Mechanism, Physics, Place};
use crate::plant::{Samples, lanes_of};
use crate::real::Real;
use crate::rig::{Number, Pump, Rig, RigError, numbers, within};

/// The longest delay in ticks.
pub(crate) const LONGEST_TICKS: usize = 16;

/// A pure delay of a valve's duty.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CommandDelay {
    /// The delay in ms.
    pub delay_ms: f64,
}

numbers!(CommandDelay {
    // How many ticks it may span is checked beside the range: it is the rig's tick that counts.
    delay_ms: Number::new("ms", 0.0, 1e5).plausible(0.5, 320.0).starts(&[10.0, 20.0, 40.0, 80.0, 180.0, 280.0]),
});

impl Physics for CommandDelay {
    const ID: &'static str = "command_delay";
    const PLACES: &'static [Place] = &[Place::Valve, Place::Pump];
    const SETTLED: bool = false;

    fn check(&self, rig: &Rig, component: &str, key: &str) -> Result<(), RigError> {
        needs_a_command(Self::ID, rig, component, key)?;
        let longest = LONGEST_TICKS as f64 * rig.integrator.tick_ms;
        within(&format!("{key}.delay_ms"), self.delay_ms, 0.0, longest, "ms", "sixteen ticks at most")
    }

    fn forms(rig: &Rig, _component: &str) -> Vec<Form> {
        let tick = rig.integrator.tick_ms;
        let form = Form::of("", Mechanism::CommandDelay(CommandDelay { delay_ms: 0.0 }), &[0]);
        vec![form.ranging(
            0,
            [0.0, LONGEST_TICKS as f64 * tick],
            [0.5, 1.0, 2.0, 4.0, 9.0, 14.0].map(|ticks| ticks * tick).to_vec(),
        )]
    }
}

impl CommandDelay {
    pub(crate) fn operator(&self, tick_ms: f64) -> Delay<f64> {
        // Rounding of the division must not push a delay at the upper limit beyond the memory.
        let ticks = (self.delay_ms / tick_ms).min(LONGEST_TICKS as f64);
        Delay { whole: ticks.floor(), part: ticks.fract() }
    }
}

/// Refuses a pump that has no command which could come late.
pub(super) fn needs_a_command(id: &str, rig: &Rig, component: &str, key: &str) -> Result<(), RigError> {
    let commanded = matches!(rig.pumps.get(component), Some(Pump::Flow(pump)) if pump.command.is_some());
    if rig.valves.contains_key(component) || commanded {
        return Ok(());
    }
    Err(RigError::at(
        format!("{key}.component"),
        format!("`{id}` goes on what has a command; `{component}` is a pump that is only switched, if at all"),
    ))
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
            let instants = samples.instants();
            let switch = self.part * R::splat(instants as f64);
            for (j, sample) in samples.in_time().iter_mut().enumerate() {
                // An instant stands for what is nearer to it than to any other: at the ends of the tick for half as much.
                let per_instant = if j == 0 || j == instants { 2.0 } else { 1.0 };
                let end = R::splat((j as f64 + 0.5).min(instants as f64));
                let weight = ((end - switch) * R::splat(per_instant)).limited(R::splat(0.0), R::splat(1.0));
                // Not `older + weight (newer − older)`: at weight one this is the newer duty to the last bit, as
                // in a run alone, when a neighbour's delay makes a lane without a part of a tick come here.
                *sample = weight.mul_add(newer, (R::splat(1.0) - weight) * older);
            }
        } else {
            samples.in_time().fill(newer);
        }
        memory.rotate_right(1);
        if let Some(newest) = memory.first_mut() {
            *newest = now;
        }
    }
}
