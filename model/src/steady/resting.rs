//! Pressures at which a rig comes to rest with its gas warmed: under constant duties, and as near to wanted ones as its valves
//! hold it.
//!
//! The balance of [`SteadyMap::settled_kpa`] has no solution where a valve is shut and the pump goes on, and none for pressures
//! that no duty holds. Followed in time, the rig comes to rest all the same, if need be at the map's edge.

use super::SteadyMap;
use super::pump_map::within_map;
use crate::observation::{CHANNELS, Pair};

/// Step in s: a tick, a tenth of what a chamber takes with its valve open.
const STEP_S: f64 = 0.02;
/// The least time that is followed, in s: gas has taken on the temperature that the pump gives it.
const LEAST_S: f64 = 5.0;
/// The most, in s: a rig that still moves then is slower than any that was met, and of its rest nothing is said.
const MOST_S: f64 = 300.0;
/// Rate in kPa/s below which a pressure counts as at rest.
const AT_REST_KPA_PER_S: f64 = 1e-3;
/// Rate in 1/s at which wanted pressures are approached; any that the step follows leads to the same rest.
const APPROACH_PER_S: f64 = 2.0;
/// Pressures from which a rig that is switched on comes to rest, in kPa gauge: next to the atmosphere's, so that none is kept that the
/// pump does not bring about, and not at it, where a valve's flow has no slope.
const BEGUN_KPA: Pair = [5.0, -5.0];

/// Pressures, their rates and the temperatures of the gas at a step.
#[derive(Clone, Copy)]
struct Step {
    kpa: Pair,
    kpa_per_s: Pair,
    gas_k: Pair,
}

impl SteadyMap {
    /// Pressures of the chambers (kPa gauge) at which the rig comes to rest under constant duties, as near to 0 and 1 as play lets
    /// the valves come ([`SteadyMap::played`]), while the pump runs; the map's edge (170 and −97.5 kPa) where it would go on.
    /// `None` where it has not come to rest after five minutes.
    ///
    /// # Real-time
    /// A millisecond or two, some more where the rig is slow; not for the tick.
    pub fn rests_at_kpa(&self, duty: Pair) -> Option<Pair> {
        self.at_rest(|_| self.played(duty))
    }

    /// Tells whether pressures of the chambers (kPa gauge) are within the map: of others nothing is known.
    pub fn covers(&self, chamber_kpa: Pair) -> bool {
        within_map(chamber_kpa) == chamber_kpa
    }

    /// Duties moved to those at which a valve's flapper can stand whatever is sent: one with play neither opens nor shuts by
    /// half of its width.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn played(&self, duty: Pair) -> Pair {
        std::array::from_fn(|c| {
            let short = self.paths[c].half_width_duty.min(0.5);
            duty[c].clamp(short, 1.0 - short)
        })
    }

    /// Pressures of the chambers (kPa gauge) at which the rig comes to rest while its valves do what they can for wanted ones:
    /// these themselves where duties that they can be at ([`SteadyMap::played`]) hold them. `None` where it has not come to rest
    /// after five minutes.
    ///
    /// # Real-time
    /// A millisecond or two, some more where the rig is slow; not for the tick.
    pub fn nearest_held_kpa(&self, wanted_kpa: Pair) -> Option<Pair> {
        self.at_rest(|step| {
            self.played(std::array::from_fn(|c| {
                // Each valve for its own pressure: the other one moves as it does, not as is wanted of it.
                let mut rates = step.kpa_per_s;
                rates[c] = APPROACH_PER_S * (wanted_kpa[c] - step.kpa[c]);
                self.warm_duty_for(step.kpa, rates, step.gas_k)[c]
            }))
        })
    }

    fn at_rest(&self, duty: impl Fn(&Step) -> Pair) -> Option<Pair> {
        let mut step = Step { kpa: BEGUN_KPA, kpa_per_s: [0.0; CHANNELS], gas_k: self.wall_k() };
        for k in 0..(MOST_S / STEP_S) as u32 {
            let rate = self.warm_rate_kpa_per_s(step.kpa, duty(&step), step.gas_k);
            let next = within_map(std::array::from_fn(|c| rate[c].mul_add(STEP_S, step.kpa[c])));
            // At the map's edge a pressure does not move, whatever the balance says.
            let moved: Pair = std::array::from_fn(|c| (next[c] - step.kpa[c]) / STEP_S);
            step = Step { gas_k: self.warmed_k(step.kpa, moved, step.gas_k, STEP_S), kpa: next, kpa_per_s: moved };
            if f64::from(k) * STEP_S > LEAST_S && moved.iter().all(|rate| rate.abs() < AT_REST_KPA_PER_S) {
                return Some(step.kpa);
            }
        }
        None
    }
}
