//! Commands that drive a rig: random holds, slow triangles and stairs, and a closed loop that follows references.
//!
//! Before anything is recorded the rig is commissioned as a lab would do it: a controller finds the duties at which
//! the pressures are where they are to range, so that the valves are open in all of it whatever the hidden parameters.

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};

use crate::rng::Draws;
use crate::run::{Precision, Rig, Run, TICK_S, TICKS_PER_S};

/// Duties between which a rig is driven, and where the pressures are then.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct OperatingRange {
    /// Lowest and highest duty, by channel.
    pub duty: [[f64; 2]; 2],
    /// Lowest and highest pressure reached at these (kPa gauge), by channel.
    pub pressure_kpa: [[f64; 2]; 2],
}

impl OperatingRange {
    /// Duties in the middle: a safe place to rest.
    pub fn rest(&self) -> [f64; 2] {
        self.duty.map(|[low, high]| rounded(0.5 * (low + high)))
    }

    /// A duty of a channel at a share of the range.
    fn at(&self, channel: usize, share: f64) -> f64 {
        let [low, high] = self.duty[channel];
        rounded(low + (high - low) * share)
    }
}

/// Files carry five digits of a duty, and the rig receives what the file says.
fn rounded(duty: f64) -> f64 {
    (duty * 1e5).round() / 1e5
}

/// A proportional and integral controller of both vents.
///
/// Opening the positive vent lowers its pressure, opening the negative one raises its own. Gains were set by hand on
/// the paper's plant (some −175 kPa per unit of duty within a second, and +49 kPa within a tenth).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Controller {
    integral: [f64; 2],
}

impl Controller {
    const PROPORTIONAL: [f64; 2] = [-0.010, 0.006];
    const INTEGRAL_PER_S: [f64; 2] = [-0.020, 0.080];
    const DUTIES: [f64; 2] = [0.30, 1.0];

    /// A controller that starts at these duties.
    pub fn at(duty: [f64; 2]) -> Self {
        Self { integral: duty }
    }

    /// Duties for the next tick.
    pub fn duties(&mut self, goal_kpa: [f64; 2], measured_kpa: [f64; 2]) -> [f64; 2] {
        std::array::from_fn(|c| {
            let error = goal_kpa[c] - measured_kpa[c];
            let [low, high] = Self::DUTIES;
            let integral = self.integral[c] + Self::INTEGRAL_PER_S[c] * error * TICK_S;
            // The integral stays where a duty can be: enough against windup at this pace.
            self.integral[c] = integral.clamp(low, high);
            rounded((integral + Self::PROPORTIONAL[c] * error).clamp(low, high))
        })
    }
}

/// Pressures at the two ends of the range (kPa gauge): the pump delivers most when both are high.
const ENDS_KPA: [[f64; 2]; 2] = [[132.0, -63.0], [64.0, -78.5]];
/// Time that the controller has to get there (s).
const COMMISSIONING_S: f64 = 9.0;

/// Finds a rig's operating range; `None` if the valves cannot hold pressures over a useful range.
pub fn commission(rig: &Rig) -> Option<OperatingRange> {
    let mut ends = [[[0.0; 2]; 2]; 2];
    for (end, goal) in ends.iter_mut().zip(ENDS_KPA) {
        let start = [0.8, 0.8];
        let mut run = Run::from_rest(rig, start, Precision::Coarse);
        let mut controller = Controller::at(start);
        let mut duty = start;
        for _ in 0..(COMMISSIONING_S * TICKS_PER_S) as usize {
            duty = controller.duties(goal, run.clean_kpa());
            run.tick(duty, true);
        }
        *end = [duty, run.clean_kpa()];
    }
    let sorted = |quantity: usize, c: usize| {
        let (a, b) = (ends[0][quantity][c], ends[1][quantity][c]);
        [a.min(b), a.max(b)]
    };
    let range = OperatingRange {
        duty: std::array::from_fn(|c| sorted(0, c).map(rounded)),
        pressure_kpa: std::array::from_fn(|c| sorted(1, c)),
    };
    // Half of what the paper's own plant gives.
    let wide = |[low, high]: [f64; 2], least: f64| high - low >= least;
    let useful = range.duty.iter().all(|duty| wide(*duty, 0.12))
        && wide(range.pressure_kpa[0], 32.0)
        && wide(range.pressure_kpa[1], 7.0);
    useful.then_some(range)
}

/// Each channel holds a random duty for 0.3 to 2 s, then another.
pub fn random_holds(draws: &mut Draws, range: &OperatingRange, ticks: usize) -> Vec<[f64; 2]> {
    let mut left = [0_usize; 2];
    let mut duty = range.rest();
    (0..ticks)
        .map(|_| {
            for c in 0..2 {
                if left[c] == 0 {
                    duty[c] = range.at(c, draws.unit());
                    left[c] = 15 + draws.index(86);
                }
                left[c] -= 1;
            }
            duty
        })
        .collect()
}

/// Slow triangles, of another period in each channel, for two thirds of the time; then stairs of 2 s.
pub fn triangles_and_stairs(draws: &mut Draws, range: &OperatingRange, ticks: usize) -> Vec<[f64; 2]> {
    let period_s: [f64; 2] = [draws.between(14.0, 20.0), draws.between(9.0, 13.0)];
    let phase = [draws.unit(), draws.unit()];
    let turns = 2 * ticks / 3;
    let stairs_s = 2.0;
    let steps: Vec<[f64; 2]> = (0..ticks).map(|_| [draws.unit(), draws.unit()]).collect();
    (0..ticks)
        .map(|k| {
            let time_s = k as f64 / TICKS_PER_S;
            std::array::from_fn(|c| {
                if k < turns {
                    let turn = (time_s / period_s[c] + phase[c]).fract();
                    range.at(c, 1.0 - (2.0 * turn - 1.0).abs())
                } else {
                    // The channels step in turn, a second apart, so that each step is seen alone.
                    let lag_s = if c == 0 { 0.0 } else { 0.5 * stairs_s };
                    let stair = ((time_s + lag_s) / stairs_s) as usize;
                    range.at(c, steps[stair % ticks][c])
                }
            })
        })
        .collect()
}

/// References for a closed loop: a ramp, a sine and a step now and then, within the middle of the reachable range.
pub fn references_kpa(draws: &mut Draws, range: &OperatingRange, ticks: usize) -> Vec<[f64; 2]> {
    let period_s = [draws.between(6.0, 10.0), draws.between(8.0, 13.0)];
    let phase = [draws.unit(), draws.unit()];
    let (from, to) = ([draws.unit(), draws.unit()], [draws.unit(), draws.unit()]);
    let mut step = [0.0; 2];
    let mut left = [150_usize; 2];
    (0..ticks)
        .map(|k| {
            let (time_s, share) = (k as f64 / TICKS_PER_S, k as f64 / ticks as f64);
            std::array::from_fn(|c| {
                if left[c] == 0 {
                    step[c] = draws.between(-0.12, 0.12);
                    left[c] = 150 + draws.index(300);
                }
                left[c] -= 1;
                let [low, high] = range.pressure_kpa[c];
                let ramp = 0.40 + 0.20 * (from[c] + (to[c] - from[c]) * share);
                let sine = 0.14 * (TAU * (time_s / period_s[c] + phase[c])).sin();
                low + (high - low) * (ramp + sine + step[c])
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const RANGE: OperatingRange =
        OperatingRange { duty: [[0.62, 0.99], [0.61, 0.97]], pressure_kpa: [[60.0, 130.0], [-79.0, -62.0]] };

    #[test]
    fn every_signal_stays_within_the_range_and_uses_it() {
        let mut draws = Draws::new(5);
        let ticks = 5000;
        for signal in [random_holds(&mut draws, &RANGE, ticks), triangles_and_stairs(&mut draws, &RANGE, ticks)] {
            assert_eq!(signal.len(), ticks);
            for c in 0..2 {
                let [low, high] = RANGE.duty[c];
                let lowest = signal.iter().map(|duty| duty[c]).fold(f64::INFINITY, f64::min);
                let highest = signal.iter().map(|duty| duty[c]).fold(0.0, f64::max);
                assert!(lowest >= low - 1e-9 && highest <= high + 1e-9);
                assert!(highest - lowest > 0.85 * (high - low));
            }
        }
        for reference in references_kpa(&mut draws, &RANGE, ticks) {
            for (goal, [low, high]) in reference.into_iter().zip(RANGE.pressure_kpa) {
                assert!(goal > low && goal < high);
            }
        }
    }
}
