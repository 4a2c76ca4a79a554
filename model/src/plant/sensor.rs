//! From a chamber to a reading: lag, answer, gain, bias and drift, and what of a pump's ripple comes through.

use super::elements::{lanes_of, record};
use super::lag::{self, Share};
use crate::mechanism::{Mechanism, Swing};
use crate::real::Real;

record! {
    /// A sensor on a chamber.
    SensorPath { node: usize,
        /// Where in the memory its lagged reading lives, if it lags.
        memory: Option<usize>,
        /// Where what a second lag behind that has come to lives, if there is one.
        second: Option<usize>,
        /// Where what it answers to that lives, with its speed over ω behind it (mechanism `residual_response`).
        response: Option<usize>,
    } lanes {
        /// Share of the distance to the pressure covered in one step (0 … 1).
        approach,
        /// Part of the pressure's way in a step that it goes for.
        ahead,
        /// Approach of the second lag, whose way is the first's.
        second_approach,
        second_ahead,
        /// ω of its answer in rad/s.
        natural,
        /// ζ.
        damping,
        /// Share of the distance that is left after a step.
        keeps,
        /// Part of the speed that goes into the distance.
        turns,
        /// Share of the speed that is left.
        damps,
        /// 1/(ω h): the speed over ω with which it follows what changes by one in a step.
        keeps_up,
        /// Share of the reading that answers so.
        share,
        /// Reading per pressure; 1 is right.
        gain,
        /// Offset of the reading, in kPa.
        bias,
        /// Rate at which the offset grows at the start, in kPa/s.
        drift,
        /// With what rate the drift comes to rest, in 1/s; 0 is never.
        drift_end,
    }
}

/// Filter between a chamber's ripple and a reading.
#[derive(Debug, Clone, Copy)]
pub struct Filter<R> {
    /// Time constant of a first-order lag in s; 0 for none.
    pub(crate) lag_s: R,
    /// Time constant of a second lag behind it.
    pub(crate) second_lag_s: R,
    /// 1/ω of a second-order answer in s; 0 for none.
    pub(crate) period_s: R,
    /// Damping ratio.
    pub(crate) damping: R,
}

impl<R: Real> Filter<R> {
    /// Nothing.
    pub(crate) fn none() -> Self {
        let zero = R::splat(0.0);
        Filter { lag_s: zero, second_lag_s: zero, period_s: zero, damping: zero }
    }

    /// Gain at an angular frequency in rad/s, and by what angle it comes late; `None` where all comes through as it is.
    #[inline(always)]
    pub(crate) fn at(&self, frequency: R) -> Option<(R, R)> {
        let zero = R::splat(0.0);
        let (lags, rings) = (self.lag_s.any_above(zero), self.period_s.any_above(zero));
        if !lags && !rings {
            return None;
        }
        let (mut gain, mut late) = (R::splat(1.0), zero);
        if lags {
            let behind = (frequency * self.lag_s).map(f64::atan);
            (gain, late) = (behind.map(f64::cos), behind);
        }
        if self.second_lag_s.any_above(zero) {
            let behind = (frequency * self.second_lag_s).map(f64::atan);
            (gain, late) = (gain * behind.map(f64::cos), late + behind);
        }
        if rings {
            let ratio = frequency * self.period_s;
            let (real, imaginary) = (R::splat(1.0) - ratio * ratio, R::splat(2.0) * self.damping * ratio);
            gain = gain / (real * real + imaginary * imaginary).sqrt();
            late += R::from_lanes(|lane| imaginary.lane(lane).atan2(real.lane(lane)));
        }
        Some((gain, late))
    }
}

impl SensorPath<f64> {
    /// A sensor that reads what is there.
    pub(crate) fn plain(node: usize) -> Self {
        SensorPath {
            node,
            memory: None,
            second: None,
            response: None,
            approach: 1.0,
            ahead: 1.0,
            second_approach: 1.0,
            second_ahead: 1.0,
            natural: f64::INFINITY,
            damping: 1.0,
            keeps: 0.0,
            turns: 0.0,
            damps: 0.0,
            keeps_up: 0.0,
            share: 0.0,
            gain: 1.0,
            bias: 0.0,
            drift: 0.0,
            drift_end: 0.0,
        }
    }

    /// A sensor with its mechanisms, in steps of `step_s`; it remembers from place `memory` on, which is moved behind that.
    pub(crate) fn with<'m>(
        node: usize,
        mechanisms: impl Iterator<Item = &'m Mechanism>,
        step_s: f64,
        memory: &mut usize,
    ) -> Self {
        let mut path = SensorPath::plain(node);
        let mut remember = |numbers: usize| {
            let place = *memory;
            *memory += numbers;
            Some(place)
        };
        for mechanism in mechanisms {
            match mechanism {
                Mechanism::SensorLag(m) => {
                    let [first, second] = m.time_constants_s();
                    path.memory = remember(1);
                    Share { approach: path.approach, ahead: path.ahead } = Share::of(first, step_s);
                    if second > 0.0 {
                        path.second = remember(1);
                        Share { approach: path.second_approach, ahead: path.second_ahead } = Share::of(second, step_s);
                    }
                }
                Mechanism::ResidualResponse(m) => {
                    path.response = remember(2);
                    (path.natural, path.damping, path.share) = (m.natural_rad_s(), m.damping_ratio, m.share);
                    let Swing { keeps, turns, damps } = m.swing(step_s);
                    (path.keeps, path.turns, path.damps) = (keeps, turns, damps);
                    path.keeps_up = 1.0 / (path.natural * step_s);
                }
                Mechanism::SensorGain(m) => path.gain = m.gain,
                Mechanism::SensorBias(m) => path.bias = m.bias_kpa,
                Mechanism::SensorDrift(m) => (path.drift, path.drift_end) = m.course(),
                _ => {}
            }
        }
        path
    }

    /// Tells whether it shows a pressure late.
    pub(crate) fn is_late(&self) -> bool {
        self.lagged().is_some() || self.response.is_some()
    }

    /// The pressure that it shows of one without a ripple, in the unit of its memory; gain, bias and drift aside.
    pub(crate) fn seen(&self, pressure: f64, memory: &[f64]) -> f64 {
        let remembered = |place: Option<usize>| place.and_then(|m| memory.get(m)).copied();
        let lagged = remembered(self.lagged()).unwrap_or(pressure);
        remembered(self.response).map_or(lagged, |answered| self.share.mul_add(answered - lagged, lagged))
    }
}

impl<R: Real> SensorPath<R> {
    /// Offset of the reading `time_s` after the start, in kPa.
    fn offset(&self, time_s: f64) -> R {
        let drifted = R::from_lanes(|lane| {
            let end = self.drift_end.lane(lane);
            let gone = if end * time_s > 1e-9 { -(-end * time_s).exp_m1() / end } else { time_s };
            self.drift.lane(lane) * gone
        });
        self.bias + drifted
    }

    /// Reading at a gauge pressure in kPa, `time_s` after the start.
    pub(crate) fn reading(&self, gauge_kpa: R, time_s: f64) -> R {
        self.gain.mul_add(gauge_kpa, self.offset(time_s))
    }

    /// Where what it has come to lives, if it lags.
    pub(crate) fn lagged(&self) -> Option<usize> {
        self.second.or(self.memory)
    }

    /// Filter by which its lag lets a ripple through, for steps of `step_s`.
    pub(crate) fn lag(&self, step_s: f64) -> Filter<R> {
        let of = |place: Option<usize>, approach: R| match place {
            Some(_) => approach.map(|approach| -step_s / (-approach).ln_1p()),
            None => R::splat(0.0),
        };
        let (lag_s, second_lag_s) = (of(self.memory, self.approach), of(self.second, self.second_approach));
        Filter { lag_s, second_lag_s, ..Filter::none() }
    }

    /// And what its answer does to that.
    pub(crate) fn answer(&self, step_s: f64) -> Filter<R> {
        Filter { period_s: self.natural.map(|natural| 1.0 / natural), damping: self.damping, ..self.lag(step_s) }
    }

    /// Moves on by a step in which the pressure went `from` … `to`, exactly if in proportion to time.
    #[inline(always)]
    pub(crate) fn follow(&self, way: [R; 2], memory: &mut [R]) {
        let mut seen = way;
        if let Some(reading) = self.memory.and_then(|m| memory.get_mut(m)) {
            let was = *reading;
            *reading = lag::follow(was, way, self.approach, self.ahead);
            seen = [was, *reading];
            if let Some(second) = self.second.and_then(|m| memory.get_mut(m)) {
                let was = *second;
                *second = lag::follow(was, seen, self.second_approach, self.second_ahead);
                seen = [was, *second];
            }
        }
        if let Some([reading, speed]) = self.response.and_then(|m| memory.get_mut(m..m + 2)) {
            // Less what answers a ramp when all else has died down: late by 2ζ/ω, and as fast as the ramp.
            let [from, to] = seen;
            let ramp = self.keeps_up * (to - from);
            let late = R::splat(2.0) * self.damping * ramp;
            let (off, was) = (*reading - from + late, *speed - ramp);
            *reading = self.keeps.mul_add(off, self.turns.mul_add(was, to - late));
            *speed = self.damps.mul_add(was, ramp - self.turns * off);
        }
    }

    /// Has it read `pressure` for ever.
    pub(crate) fn settle(&self, pressure: R, memory: &mut [R]) {
        for place in [self.memory, self.second].into_iter().flatten() {
            if let Some(reading) = memory.get_mut(place) {
                *reading = pressure;
            }
        }
        if let Some([reading, speed]) = self.response.and_then(|m| memory.get_mut(m..m + 2)) {
            (*reading, *speed) = (pressure, R::splat(0.0));
        }
    }

    /// The gauge pressure in kPa at which it reads so.
    pub(crate) fn gauge_kpa(&self, reading: R, time_s: f64) -> R {
        (reading - self.offset(time_s)) / self.gain
    }
}
