//! How fast the pump turned, told from its ripple.
//!
//! A sensor that is read every 20 ms sees the pump's pulses at the angle that the crank has then. At exactly 3000
//! rev/min that is always the same; a motor that turns a thousandth of a per cent faster moves through all angles in
//! minutes, and the readings swing by the ripple's full height (0.5 kPa on the paper's rig) as slowly as a sensor drifts.
//! The averaged pump knows the ripple at every angle, so speed and angle can be read off:
//!
//! ```text
//! r(t) = Σ_h  a_h(t) cos 2π h ψ + b_h(t) sin 2π h ψ,     ψ = φ + ε f t
//! ```
//!
//! with `f` the speed in the rig file, `ε` the share by which it is off, `φ` the angle at a recording's start, and
//! `a_h`, `b_h` from runs whose cranks start at eight angles. For one harmonic the best `φ` is known in closed form; `ε`
//! is searched on a grid fine enough for the longest recording. Nothing but `ε` and `φ` is free: that the height of the
//! swing, its course with pressure, and its ratio between the channels are the pump's own is what is asked before a
//! reading is believed.

use std::f64::consts::TAU;

use model::rig::{Pump, Rig};

use super::arcs::Arcs;
use super::simulator::{Fidelity, Run, Simulator};
use super::start::refined_starts;
use crate::FitError;

/// Angles at which cranks start.
const ANGLES: usize = 8;
/// Harmonics of a revolution that the ripple is made of.
const HARMONICS: usize = 3;
/// The largest share by which a speed may be off.
const REACH: f64 = 0.02;
/// Turns of the ripple in the longest recording below which a swing is not told from an offset.
const LEAST_BEATS: f64 = 0.4;
/// What is found must be the pump's own ripple: its height over the predicted one.
const HEIGHT: [f64; 2] = [0.75, 1.3];
/// Steps of the grid per turn of the ripple in the longest recording.
const STEPS_PER_BEAT: f64 = 8.0;

/// What the ripple told.
#[derive(Debug, Clone, PartialEq)]
pub struct Tachometer {
    /// The pump.
    pub pump: String,
    /// Its speed in rev/min.
    pub speed_rpm: f64,
    /// Angle of the crank at the start of each recording, in revolutions.
    pub crank_rev: Vec<f64>,
    /// How often the ripple comes round, in Hz.
    pub beat_hz: f64,
    /// Height of the swing over the one that the pump's model predicts.
    pub height: f64,
}

/// Amplitudes of one harmonic at one reading.
#[derive(Debug, Clone, Copy, Default)]
struct Pair {
    cos: f64,
    sin: f64,
}

/// One reading: time, what is to be explained, and the ripple's harmonics, all over the channel's scale.
struct Point {
    time_s: f64,
    off: f64,
    ripple: [Pair; HARMONICS],
}

/// Reads the speed of the only piston pump of `rig`, whose other parameters are already fitted; `None` where there is
/// no such pump, or the readings do not swing with its ripple. `weights` is zero at readings that do not count.
///
/// # Errors
/// The rig cannot be simulated.
pub fn tachometer(simulator: &Simulator<'_>, rig: &Rig, weights: &[f64]) -> Result<Option<Tachometer>, FitError> {
    let mut pistons = rig.pumps.iter().filter_map(|(name, pump)| match pump {
        Pump::Piston(piston) => Some((name, piston.speed_rpm)),
        Pump::Flow(_) => None,
    });
    let (Some((pump, speed_rpm)), None) = (pistons.next(), pistons.next()) else { return Ok(None) };
    let speed = speed_rpm / 60.0;
    let points = points(&simulator.at(Fidelity::Averaged), rig, weights)?;
    let longest_s = points.iter().flatten().map(|p| p.time_s).fold(0.0, f64::max);
    let energy = |h: usize| -> f64 { points.iter().flatten().map(|p| energy_of(p, h)).sum() };
    let main = (0..HARMONICS).max_by(|a, b| energy(*a).total_cmp(&energy(*b))).unwrap_or(0);
    let turns = (main + 1) as f64 * speed;
    if longest_s * turns <= 0.0 || energy(main) <= 0.0 {
        return Ok(None);
    }
    let height = |slip: f64| -> f64 {
        points.iter().map(|record| along(record, main, slip * turns).hypot()).sum::<f64>() / energy(main)
    };
    let step = 1.0 / (STEPS_PER_BEAT * turns * longest_s);
    let steps = (REACH / step) as i64;
    let best = (-steps..=steps)
        .map(|k| k as f64 * step)
        .filter(|slip| slip.abs() * turns * longest_s >= LEAST_BEATS)
        .map(|slip| (slip, height(slip)))
        .max_by(|a, b| a.1.total_cmp(&b.1));
    let Some((coarse, _)) = best else { return Ok(None) };
    let (slip, height) = (-8..=8)
        .map(|k| coarse + f64::from(k) * step / 8.0)
        .map(|slip| (slip, height(slip)))
        .max_by(|a, b| a.1.total_cmp(&b.1))
        .unwrap_or((coarse, 0.0));
    // Recordings with a swing of their own must each show it, or a drift in one of them would do.
    let everywhere = points.iter().all(|record| {
        let own: f64 = record.iter().map(|p| energy_of(p, main)).sum();
        let length_s = record.last().map_or(0.0, |p| p.time_s);
        slip.abs() * turns * length_s < LEAST_BEATS || along(record, main, slip * turns).hypot() > 0.5 * own
    });
    if !everywhere || !(HEIGHT[0]..=HEIGHT[1]).contains(&height) {
        return Ok(None);
    }
    Ok(Some(Tachometer {
        pump: pump.clone(),
        speed_rpm: speed_rpm * (1.0 + slip),
        crank_rev: points.iter().map(|record| crank(record, slip * speed)).collect(),
        beat_hz: (slip * turns).abs(),
        height,
    }))
}

/// Every reading that counts, by recording.
fn points(simulator: &Simulator<'_>, rig: &Rig, weights: &[f64]) -> Result<Vec<Vec<Point>>, FitError> {
    let records = simulator.records();
    let arcs = refined_starts(simulator, rig, &Arcs::free(records))?;
    let runs: Vec<Run> =
        (0..ANGLES).map(|k| Run { crank_rev: k as f64 / ANGLES as f64, ..Run::from(rig.clone()) }).collect();
    let traces = simulator.run(&runs, &arcs).into_iter().collect::<Result<Vec<_>, _>>().map_err(FitError::rig(rig))?;
    let mut points: Vec<Vec<Point>> = records.records().iter().map(|_| Vec::new()).collect();
    for (record, _, range) in records.layout().all() {
        let (Some(own), Some(columns)) = (points.get_mut(record), records.records().get(record)) else { continue };
        let first_s = columns.time_s.first().copied().unwrap_or(0.0);
        let mut of_channel: Vec<Point> = Vec::new();
        for (index, time_s) in range.zip(&columns.time_s) {
            if weights.get(index).is_none_or(|w| *w == 0.0) {
                continue;
            }
            let at = |k: usize| traces.get(k).and_then(|trace| trace.get(index)).copied().unwrap_or(f64::NAN);
            let mean = (0..ANGLES).map(at).sum::<f64>() / ANGLES as f64;
            let ripple = std::array::from_fn(|h| {
                let angle = |k: usize| TAU * ((h + 1) * k) as f64 / ANGLES as f64;
                let of = |part: fn(f64) -> f64| {
                    (0..ANGLES).map(|k| at(k) * part(angle(k))).sum::<f64>() * 2.0 / ANGLES as f64
                };
                Pair { cos: of(f64::cos), sin: of(f64::sin) }
            });
            let off = records.readings_kpa().get(index).copied().unwrap_or(f64::NAN) - mean;
            of_channel.push(Point { time_s: time_s - first_s, off, ripple });
        }
        // An offset is the parameters' to explain, and a channel that is far off counts for less.
        let n = of_channel.len().max(1) as f64;
        let offset = of_channel.iter().map(|p| p.off).sum::<f64>() / n;
        let scale = (of_channel.iter().map(|p| (p.off - offset).powi(2)).sum::<f64>() / n).sqrt();
        if !scale.is_finite() || scale <= 0.0 {
            continue;
        }
        own.extend(of_channel.into_iter().map(|p| Point {
            off: (p.off - offset) / scale,
            ripple: p.ripple.map(|pair| Pair { cos: pair.cos / scale, sin: pair.sin / scale }),
            ..p
        }));
    }
    Ok(points)
}

/// What a harmonic contributes to the squared ripple, on average over its angle.
fn energy_of(point: &Point, harmonic: usize) -> f64 {
    point.ripple.get(harmonic).map_or(0.0, |pair| 0.5 * (pair.cos * pair.cos + pair.sin * pair.sin))
}

/// Products of a recording with a harmonic that turns `beat_hz` times a second, at angle zero and a quarter turn on.
struct Along(f64, f64);

impl Along {
    fn hypot(&self) -> f64 {
        self.0.hypot(self.1)
    }
}

fn along(record: &[Point], harmonic: usize, beat_hz: f64) -> Along {
    let mut sums = Along(0.0, 0.0);
    let mut last_s = 0.0;
    let (mut sin, mut cos) = (0.0, 1.0);
    // Rows are evenly spaced but for gaps and the next channel's first: one rotation serves them all.
    let mut spacing = (0.0, 0.0, 1.0);
    for point in record {
        let Some(pair) = point.ripple.get(harmonic) else { continue };
        let by_s = point.time_s - last_s;
        if f64::abs(by_s - spacing.0) > 1e-9 {
            let (sin, cos) = (TAU * beat_hz * by_s).sin_cos();
            spacing = (by_s, sin, cos);
        }
        (sin, cos) = (sin * spacing.2 + cos * spacing.1, cos * spacing.2 - sin * spacing.1);
        last_s = point.time_s;
        sums.0 += point.off * (pair.cos * cos + pair.sin * sin);
        sums.1 += point.off * (pair.sin * cos - pair.cos * sin);
    }
    sums
}

/// The angle at which a recording starts, all harmonics together, in revolutions.
fn crank(record: &[Point], turns_hz: f64) -> f64 {
    const TRIED: usize = 256;
    // Products with every harmonic serve all angles; so do energies, as harmonics are apart.
    let sums: [Along; HARMONICS] = std::array::from_fn(|h| along(record, h, (h + 1) as f64 * turns_hz));
    (0..TRIED)
        .map(|k| k as f64 / TRIED as f64)
        .max_by(|a, b| {
            let product = |rev: f64| -> f64 {
                sums.iter()
                    .enumerate()
                    .map(|(h, sum)| {
                        let (sin, cos) = (TAU * (h + 1) as f64 * rev).sin_cos();
                        cos * sum.0 + sin * sum.1
                    })
                    .sum()
            };
            product(*a).total_cmp(&product(*b))
        })
        .unwrap_or(0.0)
}
