//! Courses laid over recordings, window by window.

use std::f64::consts::TAU;
use std::ops::Range;

use crate::data::Records;
use crate::simulate::course::Course;
use crate::simulate::ripple::Ripple;
use crate::simulate::tachometer::SILENT;
use crate::simulate::windows::{Channel, Match, Piece, Products, Sums};
use model::rig::{ATMOSPHERE, Rig};

/// Rows of a window of the coarse grid, and of those that refine it.
pub(super) const WINDOWS: [usize; 3] = [50, 100, 200];
/// Largest mean square of the ripple over the usual variance within windows: what scatters there is at least the ripple where that
/// is there, so it is one at most, and half as much again allows for a rig that was fitted with wrong volumes.
const NO_MORE_THAN_SCATTERS: f64 = 1.5;

/// Everything that a course is laid over.
pub(super) struct Laid {
    pub(super) pieces: Vec<Piece>,
    /// The stated speed in rev/s.
    pub(super) speed: f64,
    /// Index of the harmonic that carries the ripple.
    pub(super) main: usize,
}

impl Laid {
    pub(super) fn of(records: &Records, rig: &Rig, ripple: &Ripple, weights: &[f64]) -> Option<Laid> {
        let layout = records.layout();
        let port = |volume: &str| -> Option<Option<usize>> {
            // The atmosphere is at zero; a chamber that nobody reads tells no load.
            if volume == ATMOSPHERE {
                return Some(None);
            }
            rig.sensors.values().position(|sensor| sensor.volume == volume).map(Some)
        };
        let (inlet, outlet) = (port(&ripple.inlet)?, port(&ripple.outlet)?);
        let mut pieces: Vec<Piece> = Vec::new();
        for (index, record) in records.records().iter().enumerate() {
            let kpa = |port: Option<usize>, row: usize| -> f64 {
                port.map_or(0.0, |channel| records.channel_kpa(index, channel).get(row).copied().unwrap_or(0.0))
            };
            let rows = record.time_s.len();
            pieces.push(Piece {
                time_s: (0..rows).map(|row| record.elapsed_s(row)).collect(),
                load_bar: (0..rows).map(|row| 0.01 * (kpa(outlet, row) - kpa(inlet, row))).collect(),
                segments: record.segments.clone(),
                channels: (0..layout.channels())
                    .map(|channel| Channel::of(records, layout.channel(index, channel), ripple, weights))
                    .collect(),
            });
        }
        let mut laid = Laid { pieces, speed: ripple.speed_rpm / 60.0, main: ripple.main() };
        laid.weigh();
        // Where the pump stands there is no ripple.
        let pulses = |c: &Channel| c.ripple.iter().flatten().any(|pair| pair.energy() > SILENT);
        let counted = |piece: &Piece| {
            piece.channels.iter().any(|c| c.weight > 0.0 && c.off.iter().any(|o| !o.is_nan()) && pulses(c))
        };
        laid.pieces.retain(counted);
        (!laid.pieces.is_empty()).then_some(laid)
    }

    /// Weights each channel by what it scatters, lines of windows taken out.
    fn weigh(&mut self) {
        for piece in &mut self.pieces {
            let windows: Vec<Range<usize>> = piece.windows(WINDOWS[0], WINDOWS[0]).collect();
            let turned = vec![(0.0, 1.0); piece.time_s.len()];
            for channel in &mut piece.channels {
                let variances = windows.iter().map(|window| Sums::of(channel, window, self.main, &turned).variance());
                let mut variances: Vec<f64> = variances.filter(|v| v.is_finite() && *v > 0.0).collect();
                variances.sort_by(f64::total_cmp);
                channel.weight = variances.get(variances.len() / 2).map_or(0.0, |v| 1.0 / v);
            }
        }
    }

    /// Matches of a course, by recording.
    pub(super) fn matches(&self, course: Course, rows: usize) -> Vec<Match> {
        self.pieces.iter().map(|piece| self.matched(piece, course, rows)).collect()
    }

    pub(super) fn matched(&self, piece: &Piece, course: Course, rows: usize) -> Match {
        let turned = self.turned(piece, course, self.main);
        piece
            .windows(rows, rows)
            .map(|window| self.products(piece, &window, &turned).matched())
            .fold(Match::default(), Match::plus)
    }

    /// Products of a window, all channels together.
    pub(super) fn products(&self, piece: &Piece, window: &Range<usize>, turned: &[(f64, f64)]) -> Products {
        let mut products = Products::default();
        for channel in &piece.channels {
            let sums = Sums::of(channel, window, self.main, turned);
            products.add(&sums, channel.weight_in(&sums));
        }
        products
    }

    /// Sine and cosine of a harmonic's angle by row.
    pub(super) fn turned(&self, piece: &Piece, course: Course, harmonic: usize) -> Vec<(f64, f64)> {
        let order = TAU * (harmonic + 1) as f64;
        piece.turns(course, self.speed).iter().map(|turns| (order * turns).sin_cos()).collect()
    }

    pub(super) fn gain(&self, course: Course, rows: usize) -> f64 {
        self.matches(course, rows).iter().map(|m| m.gain).sum()
    }

    /// Gains of a course in each window of a recording.
    pub(super) fn gains(&self, piece: &Piece, course: Course, rows: usize) -> Vec<f64> {
        let turned = self.turned(piece, course, self.main);
        piece.windows(rows, rows).map(|window| self.products(piece, &window, &turned).matched().gain).collect()
    }

    /// Tells whether what scatters within windows could be the ripple: it is no less.
    pub(super) fn scatters_like_it(&self) -> bool {
        let channels = self.pieces.iter().flat_map(|piece| &piece.channels).filter(|channel| channel.weight > 0.0);
        let (mut ripple, mut readings) = (0.0, 0.0);
        for channel in channels {
            let pairs = channel.ripple.iter().zip(&channel.off).filter(|(_, off)| !off.is_nan());
            for pair in pairs.filter_map(|(harmonics, _)| harmonics.get(self.main)) {
                ripple += channel.weight * pair.energy();
                readings += 1.0;
            }
        }
        ripple < NO_MORE_THAN_SCATTERS * readings
    }
}
