//! A pump's ripple as a late sensor shows it.
//!
//! The pump turns about once in a tick, so every tick samples a chamber at much the same place of its ripple. A sensor that
//! lags shows the mean of the ripple instead. A controller that puts the sampled chamber on its reference would leave the
//! reading off by the difference for good (0.19 kPa of the negative channel behind a lag of 160 ms).
//!
//! The difference is found by running the sensor a second time on the chamber as it is sampled:
//!
//! ```text
//! m̂(τ+1) = A m̂(τ) + B (c(τ) + c(τ+1))/2        ŷ = h m̂ + h_P c        c: the chamber at the ticks
//! r ← r + (y − ŷ − r)/N                          y: the model's sensor, which follows the chamber within the tick
//! ```
//!
//! A pressure that moves without ripple has `y = ŷ`: over a tick its mean is that of a straight line.

use nalgebra::{DMatrix, DVector};

use crate::plant::{MOST_SENSED, SensorSystem};
use crate::real::Real;

/// Ticks over which the difference is averaged (0.5 s): many turns of the pump, and few of what moves its ripple.
const MEAN_TICKS: f64 = 25.0;

/// Running estimate of what a sensor shows of a chamber beyond the chamber at its ticks, in kPa.
#[derive(Debug, Clone)]
pub(super) struct Ripple<R> {
    system: SensorSystem<R>,
    /// The sensor's memory per pressure that has long stood.
    settled: [R; MOST_SENSED],
    /// The sensor on the sampled chamber; NaN before there was a tick.
    memory: [R; MOST_SENSED],
    /// The chamber at the tick before, as corrected there.
    before_kpa: R,
    mean_kpa: R,
}

impl<R: Real> Ripple<R> {
    /// No difference yet, behind a sensor.
    pub(super) fn behind(system: SensorSystem<R>) -> Self {
        let by_lane: Vec<DVector<f64>> = (0..R::LANES).map(|lane| settled(&system, lane)).collect();
        let settled = std::array::from_fn(|m| {
            R::from_lanes(|lane| by_lane.get(lane).and_then(|k| k.get(m)).copied().unwrap_or(0.0))
        });
        let (none, zero) = (R::splat(f64::NAN), R::splat(0.0));
        Ripple { system, settled, memory: [none; MOST_SENSED], before_kpa: none, mean_kpa: zero }
    }

    /// Forgets all: the rig has been started anew.
    pub(super) fn restart(&mut self) {
        (self.before_kpa, self.mean_kpa) = (R::splat(f64::NAN), R::splat(0.0));
    }

    /// As `restart`, for one lane.
    pub(super) fn restart_lane(&mut self, lane: usize) {
        let (before, mean) = (self.before_kpa, self.mean_kpa);
        self.before_kpa = R::from_lanes(|l| if l == lane { f64::NAN } else { before.lane(l) });
        self.mean_kpa = R::from_lanes(|l| if l == lane { 0.0 } else { mean.lane(l) });
    }

    /// Takes in a tick: what the model's sensor shows and its chamber as the sensor would read it, both before they are
    /// corrected, in kPa.
    ///
    /// # Real-time
    /// May run in the tick.
    pub(super) fn follow(&mut self, shown_kpa: R, chamber_kpa: R) {
        let begins = R::from_lanes(|lane| f64::from(u8::from(!self.before_kpa.lane(lane).is_finite())));
        let pick = |first: R, later: R| {
            R::from_lanes(|lane| if begins.lane(lane) > 0.0 { first.lane(lane) } else { later.lane(lane) })
        };
        let between = (self.before_kpa + chamber_kpa) * R::splat(0.5);
        let moved: [R; MOST_SENSED] = std::array::from_fn(|row| {
            let mut next = self.system.input[row] * between;
            for (column, remembered) in self.memory.iter().enumerate().take(self.system.count) {
                next += self.system.transition[row][column] * *remembered;
            }
            next
        });
        for (row, slot) in self.memory.iter_mut().enumerate() {
            *slot =
                if row < self.system.count { pick(self.settled[row] * chamber_kpa, moved[row]) } else { R::splat(0.0) };
        }
        let mut sampled = self.system.direct * chamber_kpa;
        for (weight, remembered) in self.system.output.iter().zip(&self.memory).take(self.system.count) {
            sampled += *weight * *remembered;
        }
        let off = shown_kpa - sampled;
        self.mean_kpa = pick(R::splat(0.0), self.mean_kpa + (off - self.mean_kpa) * R::splat(1.0 / MEAN_TICKS));
        self.before_kpa = chamber_kpa;
    }

    /// Follows a correction of the model: its chamber and its sensor's memory have been moved by so much (kPa as read).
    ///
    /// # Real-time
    /// May run in the tick.
    pub(super) fn corrected(&mut self, chamber_by_kpa: R, memory_by_kpa: &[R; MOST_SENSED]) {
        self.before_kpa += chamber_by_kpa;
        for (slot, by) in self.memory.iter_mut().zip(memory_by_kpa).take(self.system.count) {
            *slot += *by;
        }
    }

    /// The difference, in kPa as the sensor reads it.
    ///
    /// # Real-time
    /// May run in the tick.
    pub(super) fn mean_kpa(&self) -> R {
        self.mean_kpa
    }
}

/// The memory at which a constant pressure of one leaves a sensor: `(I − A)⁻¹ B`.
fn settled<R: Real>(system: &SensorSystem<R>, lane: usize) -> DVector<f64> {
    let count = system.count;
    let still = DMatrix::from_fn(count, count, |row, column| {
        f64::from(u8::from(row == column)) - system.transition[row][column].lane(lane)
    });
    let input = DVector::from_fn(count, |row, _| system.input[row].lane(lane));
    // Every sensor forgets, so `I − A` has an inverse; one that did not would begin at nothing and find its place.
    still.lu().solve(&input).unwrap_or_else(|| DVector::zeros(count))
}
