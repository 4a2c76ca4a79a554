//! Gains of the observer: the steady Kalman filter of a chamber, what disturbs it, and its sensor.
//!
//! ```text
//! P(τ+1) = P(τ) + d(τ) + w_P        the chamber, as far as the model errs
//! d(τ+1) = d(τ) + w_d               what the model errs by in a tick
//! m(τ+1) = A m(τ) + B (P + d/2)     the sensor
//! y      = h m + h_P P + v
//! ```
//!
//! The model itself moves pressure and sensor; this system is that of its *errors*, and the gains say how much of an
//! innovation goes to each. They depend on the noise of the reading relative to `w_P` and `w_d` alone, so a ladder of
//! noises is worked out once and one is chosen while it runs.

use nalgebra::{DMatrix, DVector};

use crate::plant::{MOST_SENSED, SensorSystem};
use crate::real::Real;

/// RMS of what the model's pressure errs by in a tick at random, in kPa. Chosen together with the next: behind a lag of 160 ms
/// an exact model's predictions are then within a factor of two of what less trust in readings would give, and a model that
/// errs by 0.1 kPa a tick loses a fifth to what more would.
const PRESSURE_STEP_KPA: f64 = 0.005;
/// RMS by which the model's rate changes in a tick, in kPa per tick.
const RATE_STEP_KPA: f64 = 0.002;
/// Noises of a reading for which gains are worked out, in kPa RMS: a factor of two apart, from a sensor of 16 bits to a poor one.
pub(crate) const NOISES_KPA: [f64; 9] = [0.003, 0.006, 0.012, 0.024, 0.05, 0.1, 0.2, 0.4, 0.8];
/// Steps of the Riccati equation; the slowest part, lags of a second, has settled by then.
const STEPS: usize = 600;

/// By how much an innovation (all in one unit) moves each estimate.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Gains<R> {
    /// Gain on the chamber's pressure.
    pub(crate) pressure: R,
    /// Gain on what disturbs it, per tick.
    pub(crate) disturbance: R,
    /// Gains on the sensor's memory.
    pub(crate) memory: [R; MOST_SENSED],
}

/// Gains by noise, in the order of [`NOISES_KPA`].
pub(crate) type Ladder<R> = [Gains<R>; NOISES_KPA.len()];

/// The gains of a sensor at each noise, lane by lane.
pub(crate) fn ladder<R: Real>(sensor: &SensorSystem<R>) -> Ladder<R> {
    NOISES_KPA.map(|noise_kpa| {
        let by_lane: Vec<DVector<f64>> = (0..R::LANES).map(|lane| steady(sensor, lane, noise_kpa)).collect();
        let of = |row: usize| R::from_lanes(|lane| by_lane.get(lane).and_then(|k| k.get(row)).copied().unwrap_or(0.0));
        Gains {
            pressure: of(0),
            disturbance: of(1),
            memory: std::array::from_fn(|m| if m < sensor.count { of(2 + m) } else { R::splat(0.0) }),
        }
    })
}

/// The gain that the Riccati equation settles at.
fn steady<R: Real>(sensor: &SensorSystem<R>, lane: usize, noise_kpa: f64) -> DVector<f64> {
    let states = 2 + sensor.count;
    let mut f = DMatrix::<f64>::identity(states, states);
    let mut h = DVector::<f64>::zeros(states);
    f[(0, 1)] = 1.0;
    h[0] = sensor.direct.lane(lane);
    for row in 0..sensor.count {
        let input = sensor.input[row].lane(lane);
        (f[(2 + row, 0)], f[(2 + row, 1)]) = (input, 0.5 * input);
        for column in 0..sensor.count {
            f[(2 + row, 2 + column)] = sensor.transition[row][column].lane(lane);
        }
        h[2 + row] = sensor.output[row].lane(lane);
    }
    let mut process = DMatrix::<f64>::zeros(states, states);
    process[(0, 0)] = PRESSURE_STEP_KPA * PRESSURE_STEP_KPA;
    process[(1, 1)] = RATE_STEP_KPA * RATE_STEP_KPA;
    let reading = noise_kpa * noise_kpa;
    // The gain is on what is read, so a sensor's own gain divides out of it.
    let (mut p, mut k) = (DMatrix::<f64>::identity(states, states), DVector::<f64>::zeros(states));
    for _ in 0..STEPS {
        let ph = &p * &h;
        k = &ph / (h.dot(&ph) + reading);
        let left = &p - &k * ph.transpose();
        // Kept symmetric against rounding.
        let left = (&left + left.transpose()) * 0.5;
        p = &f * left * f.transpose() + &process;
    }
    k
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A first-order lag as the formula has it.
    fn lag(time_constant_s: f64) -> SensorSystem<f64> {
        let keeps = (-0.02 / time_constant_s).exp();
        let mut system = SensorSystem {
            count: 1,
            transition: [[0.0; MOST_SENSED]; MOST_SENSED],
            input: [0.0; MOST_SENSED],
            output: [0.0; MOST_SENSED],
            direct: 0.0,
            gain: 1.0,
        };
        (system.transition[0][0], system.input[0], system.output[0]) = (keeps, 1.0 - keeps, 1.0);
        system
    }

    /// Errors in pressure, rate and sensor die out, within a second at little noise.
    #[test]
    fn errors_die_out_at_every_noise() {
        for time_constant_s in [0.01, 0.16, 0.6] {
            let sensor = lag(time_constant_s);
            for (noise_kpa, gains) in NOISES_KPA.iter().zip(ladder(&sensor)) {
                let mut error = [1.0, 0.1, 0.5];
                for _ in 0..600 {
                    let innovation = -error[2];
                    error[0] += gains.pressure * innovation;
                    error[1] += gains.disturbance * innovation;
                    error[2] += gains.memory[0] * innovation;
                    let [p, d, m] = error;
                    error = [p + d, d, sensor.transition[0][0] * m + sensor.input[0] * (p + 0.5 * d)];
                }
                let left = error.iter().fold(0.0_f64, |most, e| most.max(e.abs()));
                assert!(left < 1e-3, "{time_constant_s} s, noise {noise_kpa} kPa: {left}");
            }
        }
    }

    /// Less noise, more trust in what is read.
    #[test]
    fn gains_fall_with_noise() {
        let ladder = ladder(&lag(0.16));
        for pair in ladder.windows(2) {
            assert!(pair[0].pressure > pair[1].pressure && pair[0].disturbance > pair[1].disturbance, "{pair:?}");
        }
    }
}
