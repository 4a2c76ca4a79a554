//! Speed of the pump, told from its ripple.
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

use super::ripple::{HARMONICS, Pair, Ripple};
use crate::data::Records;

/// The largest share by which a speed may be off.
const REACH: f64 = 0.02;
/// Turns of the ripple in the longest recording below which a swing is not told from an offset.
const LEAST_BEATS: f64 = 0.2;
/// Range in which the height of the pump's own ripple is, over the one that a rig predicts whose parameters are not yet right (1.14
/// and 1.30 for one pump, without and with an experiment among the recordings).
const HEIGHT: [f64; 2] = [0.7, 1.4];
/// The most of one that is beyond doubt ([`is_plain`]): what a rig lacks (a leak of 3 kPa) its parameters take up, and with them the
/// volumes that the ripple goes by (1.6 was seen).
const HEIGHT_OF_A_PLAIN_ONE: f64 = 2.0;
/// Turns, share of what is left that it explains in each recording, and factor within which recordings agree on its height, for a
/// ripple to be beyond doubt: no drift swings so, and not alike in all of them.
const PLAIN_TURNS: f64 = 1.5;
const PLAIN_SHARE: f64 = 0.5;
const PLAIN_AGREEMENT: f64 = 1.2;
/// The least of one that is only supposed: a fit takes up half of what turns once in a recording.
const SUPPOSED: f64 = 0.4;
/// Share of the best speed's gain from which on the opposite slip may be meant.
const AS_GOOD: f64 = 0.8;
/// Steps of the grid per turn of the ripple in the longest recording.
const STEPS_PER_BEAT: f64 = 8.0;

/// Reading of the ripple.
#[derive(Debug, Clone, PartialEq)]
pub struct Tachometer {
    /// The pump.
    pub pump: String,
    /// Speed of the pump in rev/min.
    pub speed_rpm: f64,
    /// Angle of the crank at the start of each recording, in revolutions.
    pub crank_rev: Vec<f64>,
    /// Frequency at which the ripple comes round, in Hz.
    pub beat_hz: f64,
    /// Turns of the ripple in the longest recording. What turns less than once or so may be anything slow.
    pub turns: f64,
    /// Share of its stated speed by which the pump is faster.
    pub slip: f64,
    /// Height of the swing over the one that the pump's model predicts.
    pub height: f64,
    /// Log-likelihood that the swing gains, each channel's errors as large as they are.
    pub log_likelihood: f64,
}

/// One reading: time, what is to be explained, and the ripple's harmonics, all over the channel's scale.
struct Point {
    time_s: f64,
    off: f64,
    ripple: [Pair; HARMONICS],
}

/// Reads the speed of the pump that `ripple` is of; nothing where the readings do not swing with it. `weights` is zero at
/// readings that do not count; a ripple that passes slowly needs them all (of a third of the rows of 30 s a turn cannot be
/// told from a slow error).
///
/// A ripple that passes backwards looks much the same. Where that gains nearly as much it comes second: a fit with each
/// tells.
pub fn tachometer(records: &Records, ripple: &Ripple, weights: &[f64]) -> Vec<Tachometer> {
    read_between(HEIGHT, records, ripple, weights)
}

/// Readings of a ripple that is only supposed, and may have been taken up in part by the fit of the rig that it is of. What it
/// explains must tell whether to believe it.
pub fn supposed(records: &Records, ripple: &Ripple, weights: &[f64]) -> Vec<Tachometer> {
    read_between([SUPPOSED, HEIGHT[1]], records, ripple, weights)
}

fn read_between(heights: [f64; 2], records: &Records, ripple: &Ripple, weights: &[f64]) -> Vec<Tachometer> {
    let (pump, speed_rpm) = (&ripple.pump, ripple.speed_rpm);
    let speed = speed_rpm / 60.0;
    let swings = swings(records, ripple, weights);
    let every = || swings.iter().flatten().flat_map(|swing| &swing.points);
    let longest_s = every().map(|p| p.time_s).fold(0.0, f64::max);
    let energy = |h: usize| -> f64 { every().filter_map(|p| p.ripple.get(h)).map(Pair::energy).sum() };
    let main = (0..HARMONICS).max_by(|a, b| energy(*a).total_cmp(&energy(*b))).unwrap_or(0);
    let turns = (main + 1) as f64 * speed;
    if longest_s * turns <= 0.0 || energy(main) <= 0.0 {
        return Vec::new();
    }
    let matches = |slip: f64| -> Vec<Match> {
        swings.iter().map(|record| Match::of(&Products::of(record, main, slip * turns))).collect()
    };
    let gained = |slip: f64| -> f64 { matches(slip).iter().map(|m| m.gain).sum() };
    let step = 1.0 / (STEPS_PER_BEAT * turns * longest_s);
    let steps = (REACH / step) as i64;
    let coarse = best((-steps..=steps).map(|k| k as f64 * step), gained);
    let finely = |near: f64| best((-8..=8).map(|k| near + f64::from(k) * step / 8.0), gained);
    let rows = every().count() as f64;
    let read = |slip: f64| -> Option<Tachometer> {
        let matched = matches(slip);
        let sum = |of: fn(&Match) -> f64| matched.iter().map(of).sum::<f64>();
        let height = sum(|m| m.product) / sum(|m| m.energy);
        // Each recording must show it, or a drift in one of them would do; not one in which the pump stands, nor a piece too
        // short to say: of a part of a turn, less than others have, any slow error says something else.
        let least_s = LONG_S.max(LEAST_OF_THE_LONGEST * longest_s);
        let long = |record: &[Swing]| record.iter().flat_map(|swing| swing.points.last()).any(|p| p.time_s > least_s);
        let any_long = swings.iter().any(|record| long(record));
        let asked = swings.iter().zip(&matched).filter(|(record, m)| m.energy > SILENT && (!any_long || long(record)));
        let asked: Vec<(usize, Match)> = asked.map(|(record, m)| (points_of(record), *m)).collect();
        let everywhere = asked.iter().all(|(_, m)| m.product > 0.5 * m.energy);
        let swing_turns = slip.abs() * turns * longest_s;
        let highest = if is_plain(&asked, swing_turns) { HEIGHT_OF_A_PLAIN_ONE } else { heights[1] };
        if !everywhere || swing_turns < LEAST_BEATS || !(heights[0]..=highest).contains(&height) {
            return None;
        }
        // Channels are scaled to unit variance; only some rows were looked at.
        let left = (1.0 - sum(|m| m.gain) / rows).max(1e-3);
        Some(Tachometer {
            pump: pump.clone(),
            speed_rpm: speed_rpm * (1.0 + slip),
            crank_rev: swings.iter().map(|record| crank(record, slip * speed)).collect(),
            beat_hz: (slip * turns).abs(),
            turns: swing_turns,
            slip,
            height,
            log_likelihood: -0.5 * rows * THINNED as f64 * left.ln(),
        })
    };
    let slip = finely(coarse);
    let Some(read_first) = read(slip) else { return Vec::new() };
    let mirrored = finely(-slip);
    let close = gained(mirrored) > AS_GOOD * gained(slip);
    let mirror = if close { read(mirrored) } else { None };
    std::iter::once(read_first).chain(mirror).collect()
}

/// Readings of a recording that are looked at.
fn points_of(record: &[Swing]) -> usize {
    record.iter().map(|swing| swing.points.len()).sum()
}

/// Tells whether what turns so often is the ripple beyond doubt: each recording, of so many readings of unit variance, is mostly
/// that and nothing else, and all of them at one height.
fn is_plain(asked: &[(usize, Match)], turns: f64) -> bool {
    let explains = |(readings, m): &(usize, Match)| m.product * m.product > PLAIN_SHARE * m.energy * *readings as f64;
    let heights = || asked.iter().map(|(_, m)| m.product / m.energy);
    let [least, most] = [heights().fold(f64::INFINITY, f64::min), heights().fold(0.0, f64::max)];
    turns > PLAIN_TURNS && asked.iter().all(explains) && most < PLAIN_AGREEMENT * least
}

/// Seconds from which on a recording must show a ripple by itself.
pub(super) const LONG_S: f64 = 10.0;

/// Share of the longest recording's time from which on one must.
const LEAST_OF_THE_LONGEST: f64 = 0.5;

/// Squared ripple that is none: what rounding leaves where a pump stands.
pub(super) const SILENT: f64 = 1e-9;

/// The slip that gains most.
fn best(slips: impl Iterator<Item = f64>, gained: impl Fn(f64) -> f64) -> f64 {
    slips.map(|slip| (slip, gained(slip))).max_by(|a, b| a.1.total_cmp(&b.1)).map_or(0.0, |(slip, _)| slip)
}

/// A channel's readings in one recording; ripple at most [`THINNED`] rows apart.
struct Swing {
    points: Vec<Point>,
}

/// Readings of which one is looked at: a slip within reach turns the ripple once in half a second at least.
const THINNED: usize = 3;

/// Every reading that counts, by recording and channel.
fn swings(records: &Records, ripple: &Ripple, weights: &[f64]) -> Vec<Vec<Swing>> {
    let mut swings: Vec<Vec<Swing>> = records.records().iter().map(|_| Vec::new()).collect();
    for (record, _, range) in records.layout().all() {
        let (Some(own), Some(columns)) = (swings.get_mut(record), records.records().get(record)) else { continue };
        let first_s = columns.time_s.first().copied().unwrap_or(0.0);
        let mut points: Vec<Point> = Vec::new();
        for (index, time_s) in range.zip(&columns.time_s).step_by(THINNED) {
            if weights.get(index).is_none_or(|w| *w == 0.0) {
                continue;
            }
            let mean = ripple.mean_kpa.get(index).copied().unwrap_or(f64::NAN);
            let off = records.readings_kpa().get(index).copied().unwrap_or(f64::NAN) - mean;
            let ripple = ripple.at.get(index).copied().unwrap_or_default();
            points.push(Point { time_s: time_s - first_s, off, ripple });
        }
        // A channel that is far off counts for less.
        let n = points.len().max(1) as f64;
        let offset = points.iter().map(|p| p.off).sum::<f64>() / n;
        let scale = (points.iter().map(|p| (p.off - offset).powi(2)).sum::<f64>() / n).sqrt();
        if !scale.is_finite() || scale <= 0.0 {
            continue;
        }
        for point in &mut points {
            point.off = (point.off - offset) / scale;
            point.ripple = point.ripple.map(|pair| Pair { cos: pair.cos / scale, sin: pair.sin / scale });
        }
        own.push(Swing { points });
    }
    swings
}

/// Products of a recording's readings and of a harmonic that turns, at angle zero (`u`) and a quarter turn on (`v`), each
/// less its mean over the channel: an offset is the parameters' to explain.
#[derive(Default)]
struct Products {
    off_u: f64,
    off_v: f64,
    uu: f64,
    uv: f64,
    vv: f64,
}

impl Products {
    fn of(record: &[Swing], harmonic: usize, beat_hz: f64) -> Self {
        let mut all = Products::default();
        for Swing { points } in record {
            let (mut sums, mut means) = (Products::default(), (0.0, 0.0));
            let mut last_s = 0.0;
            let (mut sin, mut cos) = (0.0, 1.0);
            // Rows are evenly spaced but for gaps: one rotation serves them all.
            let mut spacing = (0.0, 0.0, 1.0);
            for point in points {
                let Some(pair) = point.ripple.get(harmonic) else { continue };
                let by_s = point.time_s - last_s;
                if f64::abs(by_s - spacing.0) > 1e-9 {
                    let (sin, cos) = (TAU * beat_hz * by_s).sin_cos();
                    spacing = (by_s, sin, cos);
                }
                (sin, cos) = (sin * spacing.2 + cos * spacing.1, cos * spacing.2 - sin * spacing.1);
                last_s = point.time_s;
                let (u, v) = pair.turned(sin, cos);
                sums.off_u += point.off * u;
                sums.off_v += point.off * v;
                sums.uu += u * u;
                sums.uv += u * v;
                sums.vv += v * v;
                means.0 += u;
                means.1 += v;
            }
            // Readings have no mean left, so their products need no correction.
            let n = points.len().max(1) as f64;
            all.off_u += sums.off_u;
            all.off_v += sums.off_v;
            all.uu += sums.uu - means.0 * means.0 / n;
            all.uv += sums.uv - means.0 * means.1 / n;
            all.vv += sums.vv - means.1 * means.1 / n;
        }
        all
    }

    fn at(&self, sin: f64, cos: f64) -> Match {
        let product = cos * self.off_u + sin * self.off_v;
        let energy = cos * cos * self.uu + 2.0 * sin * cos * self.uv + sin * sin * self.vv;
        Match { gain: 2.0 * product - energy, product, energy }
    }
}

/// Match of a ripple of one angle with a recording.
#[derive(Debug, Clone, Copy)]
struct Match {
    /// Drop of the squared residual.
    gain: f64,
    /// Product of readings and ripple.
    product: f64,
    /// Square of the ripple.
    energy: f64,
}

impl Match {
    /// At the best angle.
    fn of(products: &Products) -> Self {
        const TRIED: usize = 24;
        let nothing = Match { gain: f64::NEG_INFINITY, product: 0.0, energy: 0.0 };
        (0..TRIED).fold(nothing, |best, k| {
            let (sin, cos) = (TAU * k as f64 / TRIED as f64).sin_cos();
            let here = products.at(sin, cos);
            if here.gain > best.gain { here } else { best }
        })
    }
}

/// The angle at which a recording starts, all harmonics together, in revolutions.
fn crank(record: &[Swing], turns_hz: f64) -> f64 {
    const TRIED: usize = 256;
    // Harmonics are apart, so their gains add up.
    let products: [Products; HARMONICS] = std::array::from_fn(|h| Products::of(record, h, (h + 1) as f64 * turns_hz));
    let gain = |rev: f64| -> f64 {
        let one = |(h, of): (usize, &Products)| {
            let (sin, cos) = (TAU * (h + 1) as f64 * rev).sin_cos();
            of.at(sin, cos).gain
        };
        products.iter().enumerate().map(one).sum()
    };
    best((0..TRIED).map(|k| k as f64 / TRIED as f64), gain)
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::simulator::{Fidelity, Simulator};
    use super::*;
    use model::plant::{FreeRunStart, Plant, Simulation};
    use model::rig::{Pump, Rig};
    use proto::recording::Recording;
    use proto::recording::csv::{Column, ColumnData};
    use std::sync::Arc;

    /// A minute and a half of holds on the paper's rig, its pump at `speed_rpm`, its crank anywhere at the start.
    fn recorded(speed_rpm: f64, crank_rev: f64) -> Recording {
        let mut rig = Rig::builtin("dual_pressure").unwrap();
        for pump in rig.pumps.values_mut() {
            if let Pump::Piston(pump) = pump {
                pump.speed_rpm = speed_rpm;
            }
        }
        recorded_on(rig, crank_rev, 4500)
    }

    /// Some rows of holds on the detailed rig.
    pub(crate) fn recorded_on(rig: Rig, crank_rev: f64, rows: usize) -> Recording {
        recorded_with(rig, crank_rev, rows, 1.0)
    }

    /// A recording of a rig with the pump's relay commanded so throughout.
    pub(crate) fn recorded_with(mut rig: Rig, crank_rev: f64, rows: usize, relay: f64) -> Recording {
        rig.integrator.step_ms = 0.2;
        let plant = Arc::new(Plant::<f64>::new(&rig).unwrap());
        let mut simulation = Simulation::new(plant);
        let duty = |k: usize| [0.70 + 0.02 * ((k / 150) % 3) as f64, 0.78 + 0.02 * ((k / 110) % 4) as f64, relay];
        simulation.start_at(&[90.0, -65.0], &duty(0), FreeRunStart::Running, crank_rev, 0.0);
        let mut columns: [Vec<f64>; 5] = std::array::from_fn(|_| Vec::with_capacity(rows));
        for k in 0..rows {
            for (column, value) in columns.iter_mut().zip(duty(k).into_iter().chain(simulation.readings_kpa())) {
                column.push(value);
            }
            simulation.tick(&duty(k));
        }
        let time_s: Vec<f64> = (0..rows).map(|k| 0.02 * k as f64).collect();
        let named = ["u_pos", "u_neg", "pump_on", "p_pos_kpa", "p_neg_kpa"].into_iter().zip(columns);
        let columns = named.map(|(name, c)| Column { name: name.to_owned(), data: ColumnData::Numbers(c) }).collect();
        Recording::new("made", time_s, columns).unwrap()
    }

    #[test]
    fn a_speed_that_is_a_little_off_is_read_and_one_that_is_right_is_left_alone() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        // 0.4 turns a minute are 0.013 Hz of ripple: once round in the recording. 2985 is a beat of half a second.
        for speed_rpm in [2999.8, 3000.4, 2985.0] {
            let recordings = [recorded(speed_rpm, 0.2), recorded(speed_rpm, 0.9)];
            let records = Records::new(&rig, &recordings).unwrap();
            let simulator = Simulator::new(&records, Fidelity::Averaged);
            let weights = vec![1.0; records.layout().len()];
            let ripple = Ripple::of(&simulator, &rig).unwrap().unwrap();
            let read = tachometer(&records, &ripple, &weights).swap_remove(0);
            // An eighth of an eighth of a turn in 90 s is what the grid resolves: 0.01 rev/min.
            assert!((read.speed_rpm - speed_rpm).abs() < 0.03, "{read:?}");
            // The ripple repeats itself every half turn, but for what differs between the pistons.
            for (rev, expected) in read.crank_rev.iter().zip([0.2, 0.9]) {
                let off = (2.0 * (rev - expected)).rem_euclid(1.0);
                assert!(off.min(1.0 - off) < 0.08, "{read:?}");
            }
        }
        let records = Records::new(&rig, &[recorded(3000.0, 0.3)]).unwrap();
        let simulator = Simulator::new(&records, Fidelity::Averaged);
        let ripple = Ripple::of(&simulator, &rig).unwrap().unwrap();
        assert_eq!(tachometer(&records, &ripple, &vec![1.0; records.layout().len()]), vec![]);
    }

    /// Parameters that have given way to something predict a ripple far too low: where nothing but the ripple is left it is read all
    /// the same, and where something else is it is not.
    #[test]
    fn a_ripple_higher_than_predicted_is_read_where_it_is_all_that_is_left() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        let recordings = [recorded(2998.5, 0.2), recorded(2998.5, 0.9)];
        let records = Records::new(&rig, &recordings).unwrap();
        let simulator = Simulator::new(&records, Fidelity::Averaged);
        let weights = vec![1.0; records.layout().len()];
        let mut ripple = Ripple::of(&simulator, &rig).unwrap().unwrap();
        for pair in ripple.at.iter_mut().flatten() {
            *pair = Pair { cos: pair.cos / 1.6, sin: pair.sin / 1.6 };
        }
        let read = tachometer(&records, &ripple, &weights);
        let found = read.first().is_some_and(|read| (read.speed_rpm - 2998.5).abs() < 0.03 && read.height > 1.4);
        assert!(found, "{read:?}");
        let mut drifting = records.readings_kpa().to_vec();
        for (_, _, range) in records.layout().all() {
            for (row, kpa) in drifting[range].iter_mut().enumerate() {
                *kpa += 0.5 * (TAU * row as f64 / 700.0).sin();
            }
        }
        let drifting = records.with_readings(drifting).unwrap();
        assert_eq!(tachometer(&drifting, &ripple, &weights), vec![]);
    }

    /// An experiment in which the pump stands says nothing of how it turns, and must not keep the others from saying it.
    #[test]
    fn a_pump_that_stands_in_one_recording_is_read_off_the_others() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        let recordings = [recorded(2985.0, 0.2), recorded_with(rig.clone(), 0.0, 1000, 0.0)];
        let records = Records::new(&rig, &recordings).unwrap();
        let simulator = Simulator::new(&records, Fidelity::Averaged);
        let ripple = Ripple::of(&simulator, &rig).unwrap().unwrap();
        let read = tachometer(&records, &ripple, &vec![1.0; records.layout().len()]);
        assert!(read.first().is_some_and(|read| (read.speed_rpm - 2985.0).abs() < 0.03), "{read:?}");
    }
}
