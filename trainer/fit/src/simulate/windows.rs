//! Products of readings and of a ripple that turns, window by window.
//!
//! In a window, and with one angle for all of it, the best angle of a harmonic is known in closed form:
//!
//! ```text
//! max over φ of  2 (cos φ ⟨off, u⟩ + sin φ ⟨off, v⟩) − |cos φ u + sin φ v|²,      tan φ ≈ ⟨off, v⟩ / ⟨off, u⟩
//! ```
//!
//! for `u` and `v` are as long as each other and, over some turns, at right angles. All products are less a straight line
//! in every window: what is slow is the parameters' to explain.

use std::ops::Range;

use super::course::Course;
use super::ripple::{HARMONICS, Pair, Ripple};
use crate::data::Records;

/// One recording, ready for courses to be laid over it.
pub(super) struct Piece {
    /// Since the recording began.
    pub(super) time_s: Vec<f64>,
    /// Pressure between outlet and inlet in bar.
    pub(super) load_bar: Vec<f64>,
    pub(super) segments: Vec<Range<usize>>,
    pub(super) channels: Vec<Channel>,
}

pub(super) struct Channel {
    /// Where the rows lie in a vector of readings.
    pub(super) place: Range<usize>,
    /// Residuals to be explained, in kPa; NaN at readings that do not count.
    pub(super) off: Vec<f64>,
    pub(super) ripple: Vec<[Pair; HARMONICS]>,
    /// One over the usual variance about the straight lines of windows.
    pub(super) weight: f64,
}

impl Piece {
    /// Duration in s.
    pub(super) fn lasts_s(&self) -> f64 {
        self.time_s.first().zip(self.time_s.last()).map_or(0.0, |(first, last)| last - first)
    }

    /// The share by which the speed is off at each row.
    pub(super) fn shares(&self, course: Course) -> Vec<f64> {
        course.shares(&self.time_s, &self.load_bar)
    }

    /// Revolutions beyond those of the stated speed, by row.
    pub(super) fn turns(&self, course: Course, speed: f64) -> Vec<f64> {
        let shares = self.shares(course);
        let mut turned = 0.0;
        let mut turns = Vec::with_capacity(shares.len());
        for (row, share) in shares.iter().enumerate() {
            if row > 0 {
                let before = shares.get(row - 1).copied().unwrap_or(*share);
                let by_s = self.time_s.get(row).unwrap_or(&0.0) - self.time_s.get(row - 1).unwrap_or(&0.0);
                turned += 0.5 * (before + share) * speed * by_s;
            }
            turns.push(turned);
        }
        turns
    }

    /// Windows of about this many rows, none across a gap.
    pub(super) fn windows(&self, rows: usize, apart: usize) -> impl Iterator<Item = Range<usize>> + '_ {
        self.segments.iter().filter(move |segment| segment.len() >= rows / 2).flat_map(move |segment| {
            let last = segment.len().saturating_sub(rows);
            (0..=last.div_ceil(apart)).map(move |k| {
                let start = segment.start + (k * apart).min(last);
                start..(start + rows).min(segment.end)
            })
        })
    }
}

/// Products of what is to be explained and a ripple that turns, at angle zero (`u`) and a quarter turn on (`v`).
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Products {
    pub(super) off_u: f64,
    pub(super) off_v: f64,
    pub(super) uu: f64,
    pub(super) uv: f64,
    pub(super) vv: f64,
    /// As `uu` and `vv` together, lines not taken out.
    pub(super) whole: f64,
}

/// Match of a ripple with what is to be explained.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Match {
    pub(super) gain: f64,
    pub(super) product: f64,
    pub(super) energy: f64,
    pub(super) whole: f64,
}

impl Match {
    pub(super) fn plus(self, other: Match) -> Match {
        Match {
            gain: self.gain + other.gain,
            product: self.product + other.product,
            energy: self.energy + other.energy,
            whole: self.whole + other.whole,
        }
    }
}

impl Products {
    /// At its best angle.
    pub(super) fn matched(&self) -> Match {
        let length = self.off_u.hypot(self.off_v).max(1e-300);
        let (sin, cos) = (self.off_v / length, self.off_u / length);
        let energy = cos * cos * self.uu + 2.0 * sin * cos * self.uv + sin * sin * self.vv;
        Match { gain: 2.0 * length - energy, product: length, energy, whole: 0.5 * self.whole }
    }

    pub(super) fn add(&mut self, sums: &Sums, weight: f64) {
        let n = sums.n.max(1.0);
        // Less the straight line that fits best: 1 and t are orthogonal once t is taken from its mean.
        let mean_t = sums.t / n;
        let spread = (sums.tt - n * mean_t * mean_t).max(1e-9);
        let along = |x: f64, xt: f64| (x, xt - mean_t * x);
        let (off, u, v) = (along(sums.off, sums.off_t), along(sums.u, sums.u_t), along(sums.v, sums.v_t));
        let less = |sum: f64, a: (f64, f64), b: (f64, f64)| weight * (sum - a.0 * b.0 / n - a.1 * b.1 / spread);
        self.off_u += less(sums.off_u, off, u);
        self.off_v += less(sums.off_v, off, v);
        self.uu += less(sums.uu, u, u);
        self.uv += less(sums.uv, u, v);
        self.vv += less(sums.vv, v, v);
        self.whole += weight * (sums.uu + sums.vv);
    }
}

/// Sums over a channel's rows of a window.
#[derive(Default)]
pub(super) struct Sums {
    pub(super) n: f64,
    pub(super) t: f64,
    pub(super) tt: f64,
    pub(super) off: f64,
    pub(super) u: f64,
    pub(super) v: f64,
    pub(super) off_t: f64,
    pub(super) u_t: f64,
    pub(super) v_t: f64,
    pub(super) off_off: f64,
    pub(super) off_u: f64,
    pub(super) off_v: f64,
    pub(super) uu: f64,
    pub(super) uv: f64,
    pub(super) vv: f64,
}

impl Sums {
    pub(super) fn of(channel: &Channel, window: &Range<usize>, harmonic: usize, turned: &[(f64, f64)]) -> Sums {
        Sums::of_rows(&channel.off, &channel.ripple, window, harmonic, turned)
    }

    pub(super) fn of_rows(
        off: &[f64],
        ripple: &[[Pair; HARMONICS]],
        window: &Range<usize>,
        harmonic: usize,
        turned: &[(f64, f64)],
    ) -> Sums {
        let mut s = Sums::default();
        for row in window.clone() {
            let (Some(off), Some(pair), Some((sin, cos))) =
                (off.get(row), ripple.get(row).and_then(|r| r.get(harmonic)), turned.get(row))
            else {
                continue;
            };
            if off.is_nan() {
                continue;
            }
            let (u, v) = pair.turned(*sin, *cos);
            let t = (row - window.start) as f64;
            s.n += 1.0;
            s.t += t;
            s.tt += t * t;
            s.off += off;
            s.u += u;
            s.v += v;
            s.off_t += off * t;
            s.u_t += u * t;
            s.v_t += v * t;
            s.off_off += off * off;
            s.off_u += off * u;
            s.off_v += off * v;
            s.uu += u * u;
            s.uv += u * v;
            s.vv += v * v;
        }
        s
    }

    /// Mean square of what is to be explained about its straight line.
    pub(super) fn variance(&self) -> f64 {
        let mean_t = self.t / self.n;
        let along = self.off_t - mean_t * self.off;
        (self.off_off - self.off * self.off / self.n - along * along / (self.tt - self.n * mean_t * mean_t)) / self.n
    }
}

impl Channel {
    /// Weight of a window: less where the model is further off than usual.
    pub(super) fn weight_in(&self, sums: &Sums) -> f64 {
        let variance = sums.variance();
        if variance > 0.0 { self.weight.min(1.0 / variance) } else { self.weight }
    }

    pub(super) fn of(records: &Records, place: Range<usize>, ripple: &Ripple, weights: &[f64]) -> Channel {
        let at = |vector: &[f64], index: usize| vector.get(index).copied().unwrap_or(f64::NAN);
        let off =
            place
                .clone()
                .map(|i| {
                    if at(weights, i) > 0.0 {
                        at(records.readings_kpa(), i) - at(&ripple.mean_kpa, i)
                    } else {
                        f64::NAN
                    }
                })
                .collect();
        let ripple = ripple.at.get(place.clone()).unwrap_or_default().to_vec();
        Channel { place, off, ripple, weight: 1.0 }
    }
}
