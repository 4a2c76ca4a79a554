//! The ripple of a course on each reading, and what goes with it.

use std::f64::consts::TAU;
use std::ops::Range;

use super::laid::{Laid, WINDOWS};
use crate::simulate::course::Course;
use crate::simulate::ripple::HARMONICS;
use crate::simulate::windows::{Piece, Products, Sums};

/// Windows of a recording that each have an angle of their own: of a second, every half.
fn with_an_angle(piece: &Piece) -> impl Iterator<Item = Range<usize>> {
    piece.windows(WINDOWS[0], WINDOWS[0] / 2)
}

impl Laid {
    /// The ripple on each reading: the angle from windows of a second every half, height and lag of each channel and
    /// harmonic fitted over everything.
    pub(super) fn followed(&self, course: Course, places: usize) -> Vec<f64> {
        let mut ripple_kpa = vec![0.0; places];
        let turned: Vec<Vec<f64>> = self.pieces.iter().map(|piece| self.angles(piece, course)).collect();
        let channels = self.pieces.iter().map(|p| p.channels.len()).max().unwrap_or(0);
        for channel in 0..channels {
            for harmonic in 0..HARMONICS {
                let order = TAU * (harmonic + 1) as f64;
                let mut all = Products::default();
                let angles =
                    |turns: &[f64]| -> Vec<(f64, f64)> { turns.iter().map(|t| (order * t).sin_cos()).collect() };
                for (piece, turns) in self.pieces.iter().zip(&turned) {
                    let Some(of) = piece.channels.get(channel) else { continue };
                    let turned = angles(turns);
                    for window in piece.windows(WINDOWS[0], WINDOWS[0]) {
                        all.add(&Sums::of(of, &window, harmonic, &turned), 1.0);
                    }
                }
                // Two amplitudes by least squares.
                let determinant = all.uu * all.vv - all.uv * all.uv;
                if determinant <= 1e-6 * all.uu * all.vv || determinant.is_nan() {
                    continue;
                }
                let a = (all.off_u * all.vv - all.off_v * all.uv) / determinant;
                let b = (all.off_v * all.uu - all.off_u * all.uv) / determinant;
                for (piece, turns) in self.pieces.iter().zip(&turned) {
                    let Some(of) = piece.channels.get(channel) else { continue };
                    for ((index, pair), (sin, cos)) in of.place.clone().zip(&of.ripple).zip(angles(turns)) {
                        let Some(pair) = pair.get(harmonic) else { continue };
                        let (u, v) = pair.turned(sin, cos);
                        if let Some(slot) = ripple_kpa.get_mut(index) {
                            *slot += a * u + b * v;
                        }
                    }
                }
            }
        }
        ripple_kpa
    }

    /// Angles that [`Laid::followed`] fits.
    pub(super) fn free_angles(&self) -> usize {
        self.pieces.iter().map(|piece| with_an_angle(piece).count()).sum()
    }

    /// Log-likelihood gained by taking a ripple out, and the share of squares that goes with it; lines of windows out.
    pub(super) fn gained(&self, ripple_kpa: &[f64]) -> (f64, f64) {
        let channels = self.pieces.iter().map(|p| p.channels.len()).max().unwrap_or(0);
        let (mut gained, mut squares) = (0.0, [0.0, 0.0]);
        for channel in 0..channels {
            let (mut rows, mut own) = (0.0, [0.0, 0.0]);
            for piece in &self.pieces {
                let Some(before) = piece.channels.get(channel) else { continue };
                let still = vec![(0.0, 1.0); piece.time_s.len()];
                let less = |(off, index): (&f64, usize)| off - ripple_kpa.get(index).copied().unwrap_or(0.0);
                let after: Vec<f64> = before.off.iter().zip(before.place.clone()).map(less).collect();
                for window in piece.windows(WINDOWS[0], WINDOWS[0]) {
                    let of = |off: &[f64]| Sums::of_rows(off, &before.ripple, &window, self.main, &still);
                    let sums = [of(&before.off), of(&after)];
                    // A window that the model misses altogether says nothing of the ripple.
                    if sums[0].n < 3.0 || sums[0].variance() * before.weight > 9.0 {
                        continue;
                    }
                    rows += sums[0].n;
                    own[0] += sums[0].n * sums[0].variance();
                    own[1] += sums[1].n * sums[1].variance();
                }
            }
            if own[0] > 0.0 && own[1] > 0.0 {
                gained += 0.5 * rows * (own[0] / own[1]).ln();
                squares = [squares[0] + own[0], squares[1] + own[1]];
            }
        }
        (gained, 1.0 - squares[1] / f64::max(squares[0], 1e-300))
    }

    /// Turns of the crank by row, the angle of each window put right.
    fn angles(&self, piece: &Piece, course: Course) -> Vec<f64> {
        let order = (self.main + 1) as f64;
        let turned = self.turned(piece, course, self.main);
        let mut turns = piece.turns(course, self.speed);
        let mut known: Vec<(f64, f64)> = Vec::new();
        for window in with_an_angle(piece) {
            let products = self.products(piece, &window, &turned);
            let angle = products.off_v.atan2(products.off_u) / (TAU * order);
            // The ripple repeats itself: the nearest of its angles goes on from the one before.
            let angle = known.last().map_or(angle, |(_, last)| {
                let off = (angle - last) * order;
                last + (off - off.round()) / order
            });
            known.push((0.5 * (window.start + window.end) as f64, angle));
        }
        let mut at = 0;
        for (row, turn) in turns.iter_mut().enumerate() {
            let row = row as f64;
            while known.get(at + 1).is_some_and(|(next, _)| *next <= row) {
                at += 1;
            }
            *turn += match (known.get(at), known.get(at + 1)) {
                (Some((from, a)), Some((to, b))) if row > *from => a + (b - a) * (row - from) / (to - from),
                (Some((_, a)), _) => *a,
                _ => 0.0,
            };
        }
        turns
    }
}
