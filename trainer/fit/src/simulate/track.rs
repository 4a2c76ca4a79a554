//! The course of a pump's speed, followed through its ripple.
//!
//! A pump that slows down under load, or speeds up as it warms, pulses at 84 or 103 Hz instead of the stated 100, never for
//! long at the same rate: sampled every 20 ms its ripple looks like noise of 0.3 kPa. Within a second, though, it keeps
//! step with a course of the speed that is nearly right, and nothing else does. So courses are laid over the readings,
//! the angle of the crank free in every window:
//!
//! ```text
//! constant   s = ε                                         off by a share
//! drooping   s = ε − (1 + ε) k ΔP_τ                        ΔP between the pump's ports as recorded, followed with a lag τ
//! warming    s = ε (1 − e^(−t/τ))                          from the start of each recording
//! gain       Σ over windows of max over φ of |off|² − |off − r(φ + f ∫ s dt)|²
//! ```
//!
//! `off` is what the averaged pump does not explain, `r` its ripple ([`super::ripple`]), both less a straight line in every
//! window: what is slow is the parameters' to explain. A coarse grid over windows of 1 s is refined with windows of 2 and
//! 4 s, in which speeds are told to 1e-4. What is found must have the height that the pump's model predicts, in every
//! recording.

use std::f64::consts::TAU;
use std::ops::Range;

use super::course::Course;
use super::ripple::{HARMONICS, Ripple};
use super::tachometer::{LONG_S, SILENT};
use super::windows::{Channel, Match, Piece, Products, Sums};
use crate::data::Records;
use model::rig::{ATMOSPHERE, Rig};

/// A ripple that was followed.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    /// The pump.
    pub pump: String,
    /// How its speed went.
    pub course: Course,
    /// Standard error of the course's leading number (`per_bar`, or `share`), from the scatter between recordings.
    pub error: f64,
    /// Standard error of a warming course's time constant in s, found likewise; zero for other courses.
    pub time_error_s: f64,
    /// Share by which the speed was off on average.
    pub mean_share: f64,
    /// Height of the ripple over the predicted one.
    pub height: f64,
    /// Log-likelihood that the ripple gains, each channel's errors as large as they are.
    pub log_likelihood: f64,
    /// Share of what was unexplained within windows that goes with it.
    pub share: f64,
    /// The ripple on each reading, in kPa.
    pub ripple_kpa: Vec<f64>,
}

/// Rows of a window of the coarse grid, and of those that refine it.
const WINDOWS: [usize; 3] = [50, 100, 200];
/// What is found must be the pump's own ripple: its height over the predicted one.
const HEIGHT: [f64; 2] = [0.7, 1.35];
/// The same where nothing but the pump follows its load so: a rig that lacks something else as well is fitted with wrong
/// volumes, which the predicted height goes by.
const HEIGHT_FOLLOWED: [f64; 2] = [0.5, 2.0];
/// How much more than by chance a ripple must be there to be taken for nothing else.
const UNMISTAKABLE: f64 = 4.0;
/// How much more than by chance a recording must have of it.
const STANDS_OUT: f64 = 1.2;
/// Share of the ripple's energy that a course with one number more must gain.
const WORTH: f64 = 0.02;
/// Share of the ripple's energy that must lie where a window tells it from something slow.
const QUICK: f64 = 0.3;

/// Everything that a course is laid over.
struct Laid {
    pieces: Vec<Piece>,
    /// The stated speed in rev/s.
    speed: f64,
    /// Index of the harmonic that carries the ripple.
    main: usize,
}

/// Follows the ripple of a pump of `rig`; `None` where no course accounts for it. `weights` is zero at readings that do not
/// count.
pub fn track(records: &Records, rig: &Rig, ripple: &Ripple, weights: &[f64]) -> Option<Track> {
    let laid = Laid::of(records, rig, ripple, weights)?;
    let (course, chance) = laid.best_course();
    let matched = laid.matches(course, WINDOWS[0]);
    // What is found by chance adds to what is there as noise does to a length.
    let own = |(m, chance): (&Match, &f64)| (m.product * m.product - chance * chance).max(0.0).sqrt();
    let (long, any_long) = (|piece: &Piece| piece.lasts_s() > LONG_S, laid.pieces.iter().any(|p| p.lasts_s() > LONG_S));
    let asked = || {
        let all = laid.pieces.iter().zip(matched.iter().zip(&chance));
        all.filter(|(piece, _)| !any_long || long(piece)).map(|(_, of)| of)
    };
    let everywhere = asked().all(|(m, c)| own((m, c)) > 0.5 * m.energy && m.product > STANDS_OUT * c);
    let all = matched.iter().fold(Match::default(), |sum, m| sum.plus(*m));
    let product: f64 = matched.iter().zip(&chance).map(own).sum();
    let quick = all.energy > QUICK * all.whole;
    let shares: Vec<f64> = laid.pieces.iter().flat_map(|piece| piece.shares(course)).collect();
    let mean_share = shares.iter().sum::<f64>() / shares.len().max(1) as f64;
    // The valves let through what they did, so a slower pump moves more in each stroke.
    let height = product / all.energy * (1.0 + mean_share);
    let followed = asked().all(|(m, c)| m.product > UNMISTAKABLE * c);
    let [low, high] = if followed && matches!(course, Course::Drooping { .. }) { HEIGHT_FOLLOWED } else { HEIGHT };
    if !everywhere || !quick || !(low..=high).contains(&height) {
        return None;
    }
    let ripple_kpa = laid.followed(course, weights.len());
    let (log_likelihood, share) = laid.gained(&ripple_kpa);
    let by_recording = laid.by_recording(course);
    Some(Track {
        log_likelihood,
        share,
        pump: ripple.pump.clone(),
        error: scatter(&by_recording, Course::leading).unwrap_or(ALONE * course.leading().abs()),
        time_error_s: scatter(&by_recording, Course::time_s).unwrap_or(ALONE * course.time_s()),
        mean_share,
        course,
        height,
        ripple_kpa,
    })
}

impl Laid {
    fn of(records: &Records, rig: &Rig, ripple: &Ripple, weights: &[f64]) -> Option<Laid> {
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

    /// How a course matches, by recording.
    fn matches(&self, course: Course, rows: usize) -> Vec<Match> {
        self.pieces.iter().map(|piece| self.matched(piece, course, rows)).collect()
    }

    fn matched(&self, piece: &Piece, course: Course, rows: usize) -> Match {
        let turned = self.turned(piece, course, self.main);
        piece
            .windows(rows, rows)
            .map(|window| {
                let mut products = Products::default();
                for channel in &piece.channels {
                    let sums = Sums::of(channel, &window, self.main, &turned);
                    products.add(&sums, channel.weight_in(&sums));
                }
                products.matched()
            })
            .fold(Match::default(), Match::plus)
    }

    /// Sine and cosine of a harmonic's angle by row.
    fn turned(&self, piece: &Piece, course: Course, harmonic: usize) -> Vec<(f64, f64)> {
        let order = TAU * (harmonic + 1) as f64;
        piece.turns(course, self.speed).iter().map(|turns| (order * turns).sin_cos()).collect()
    }

    fn gain(&self, course: Course, rows: usize) -> f64 {
        self.matches(course, rows).iter().map(|m| m.gain).sum()
    }

    /// The best of each kind refined; more numbers must be worth it. With it, the product that any course has by chance,
    /// by recording: most of a grid is wrong.
    fn best_course(&self) -> (Course, Vec<f64>) {
        let mut kinds: [Option<(f64, Course)>; 3] = [None; 3];
        let mut products: Vec<Vec<f64>> = vec![Vec::new(); self.pieces.len()];
        for course in Course::grid() {
            let matched = self.matches(course, WINDOWS[0]);
            let gain = matched.iter().map(|m| m.gain).sum();
            for (all, m) in products.iter_mut().zip(&matched) {
                all.push(m.product);
            }
            let kind = match course {
                Course::Constant { .. } => 0,
                Course::Drooping { .. } => 1,
                Course::Warming { .. } => 2,
            };
            if let Some(slot) = kinds.get_mut(kind)
                && slot.is_none_or(|(best, _)| gain > best)
            {
                *slot = Some((gain, course));
            }
        }
        let energy: f64 =
            self.pieces.iter().map(|p| self.matched(p, Course::Constant { share: 0.1 }, WINDOWS[2]).energy).sum();
        let mut best: Option<(f64, Course)> = None;
        for (_, course) in kinds.into_iter().flatten() {
            let refined = self.refined(course);
            let gain = self.gain(refined, WINDOWS[2]);
            if best.is_none_or(|(most, _)| gain > most + WORTH * energy) {
                best = Some((gain, refined));
            }
        }
        let chance = products.iter_mut().map(|of| {
            of.sort_by(f64::total_cmp);
            of.get(of.len() / 2).copied().unwrap_or(0.0)
        });
        (best.map_or(Course::Constant { share: 0.0 }, |(_, course)| course), chance.collect())
    }

    /// Climbs from a course over all recordings, windows growing as its steps shrink.
    fn refined(&self, course: Course) -> Course {
        let steps = WINDOWS.into_iter().zip([[0.5, 0.25, 0.12], [0.12, 0.06, 0.03], [0.03, 0.015, 0.007]]);
        climb(course, mean_load_bar(&self.pieces), steps, |course, rows| self.gain(course, rows))
    }

    /// What each recording by itself says of a course, all its numbers: a faster pump that droops more is nearly the same.
    fn by_recording(&self, course: Course) -> Vec<Course> {
        let steps = [(WINDOWS[1], [0.25, 0.06, 0.015]), (WINDOWS[2], [0.06, 0.015, 0.004])];
        let own = |piece: &Piece| {
            let load_bar = mean_load_bar(std::slice::from_ref(piece));
            climb(course, load_bar, steps, |course, rows| self.matched(piece, course, rows).gain)
        };
        self.pieces.iter().map(own).collect()
    }

    /// The ripple on each reading: the angle from windows of a second every half, height and lag of each channel and
    /// harmonic fitted over everything.
    fn followed(&self, course: Course, places: usize) -> Vec<f64> {
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

    /// Log-likelihood gained by taking a ripple out, and the share of squares that goes with it; lines of windows out.
    fn gained(&self, ripple_kpa: &[f64]) -> (f64, f64) {
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
        let rows = WINDOWS[0];
        let order = (self.main + 1) as f64;
        let turned = self.turned(piece, course, self.main);
        let mut turns = piece.turns(course, self.speed);
        let mut known: Vec<(f64, f64)> = Vec::new();
        for window in piece.windows(rows, rows / 2) {
            let mut products = Products::default();
            for channel in &piece.channels {
                let sums = Sums::of(channel, &window, self.main, &turned);
                products.add(&sums, channel.weight_in(&sums));
            }
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

/// Share of a number that a single recording is taken to be off by: it has nothing to be compared with.
const ALONE: f64 = 0.02;

/// Standard error of the mean of a number of some courses; `None` of fewer than two.
fn scatter(courses: &[Course], number: impl Fn(&Course) -> f64) -> Option<f64> {
    let n = courses.len() as f64;
    let mean = courses.iter().map(&number).sum::<f64>() / n.max(1.0);
    let variance = courses.iter().map(|course| (number(course) - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    (courses.len() > 1).then(|| (variance / n).sqrt())
}

/// Load averaged over some recordings, in bar.
fn mean_load_bar(pieces: &[Piece]) -> f64 {
    let loads = || pieces.iter().flat_map(|piece| &piece.load_bar);
    loads().sum::<f64>() / loads().count().max(1) as f64
}

/// Steps of one size at most: along a valley as many as a few steps of the size before.
const STEPS: usize = 12;

/// Climbs from a course by steps of these sizes, each with windows of so many rows.
fn climb(
    course: Course,
    load_bar: f64,
    steps: impl IntoIterator<Item = (usize, [f64; 3])>,
    gain_of: impl Fn(Course, usize) -> f64,
) -> Course {
    let mut here = course;
    for (rows, sizes) in steps {
        let mut gain = gain_of(here, rows);
        for size in sizes {
            for _ in 0..STEPS {
                let tried = here.neighbours(size, load_bar).into_iter().map(|course| (gain_of(course, rows), course));
                match tried.max_by(|a, b| a.0.total_cmp(&b.0)) {
                    Some((better, course)) if better > gain => (gain, here) = (better, course),
                    _ => break,
                }
            }
        }
    }
    here
}

#[cfg(test)]
mod tests {
    use super::super::simulator::{Fidelity, Simulator};
    use super::super::tachometer::tests::recorded_on;
    use super::*;
    use model::mechanism::{Mechanism, PumpDroop, PumpSpeed};
    use model::rig::Attached;
    use proto::recording::Recording;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    /// Two recordings of 30 s on the detailed rig with a mechanism of its pump, and noise of 0.06 kPa.
    fn records(rig: &Rig, mechanism: Option<Mechanism>, seed: u64) -> Records {
        let mut with = rig.clone();
        with.mechanisms.extend(mechanism.map(|mechanism| Attached {
            component: "pump".to_owned(),
            enabled: true,
            mechanism,
        }));
        let recordings: Vec<Recording> = [0.2, 0.7].map(|crank| recorded_on(with.clone(), crank, 1500)).to_vec();
        let records = Records::new(rig, &recordings).unwrap();
        let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(seed);
        let noise: Vec<f64> = records
            .readings_kpa()
            .iter()
            .map(|kpa| {
                let normal: f64 = StandardNormal.sample(&mut random);
                kpa + 0.06 * normal
            })
            .collect();
        records.with_readings(noise).unwrap()
    }

    fn followed(rig: &Rig, records: &Records) -> Option<Track> {
        let simulator = Simulator::new(records, Fidelity::Averaged).on(1);
        let ripple = Ripple::of(&simulator, rig).unwrap().unwrap();
        track(records, rig, &ripple, &vec![1.0; records.layout().len()])
    }

    #[test]
    fn droop_is_read_off_a_ripple_that_never_keeps_one_rate() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        for per_bar in [0.03, 0.1] {
            let droop = PumpDroop { speed_loss_per_bar: per_bar };
            let records = records(&rig, Some(Mechanism::PumpDroop(droop)), 1);
            let read = followed(&rig, &records).unwrap();
            let Course::Drooping { per_bar: found, share, .. } = read.course else { panic!("{:?}", read.course) };
            // Speeds are told to 1e-4 in a window; loads differ by some tenths of a bar. Load and speed without load are
            // told apart the worse: 1.5 bar of the one are a share of the other.
            assert!((found - per_bar).abs() < 0.03 * per_bar, "{per_bar} {:?} {}", read.course, read.error);
            assert!(share.abs() < 0.05 * per_bar, "{:?}", read.course);
            // What is left is the noise that was put on: a ripple of 0.3 kPa is nine tenths of the rest.
            assert!(read.share > 0.8 && read.log_likelihood > 1000.0, "{} {}", read.share, read.log_likelihood);
        }
    }

    #[test]
    fn a_constant_speed_several_per_cent_off_is_called_constant() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        for percent in [4.0, -7.0] {
            let records = records(
                &rig,
                Some(Mechanism::PumpSpeed(PumpSpeed { change_percent: percent, time_constant_s: 0.0 })),
                2,
            );
            let read = followed(&rig, &records).unwrap();
            let Course::Constant { share } = read.course else { panic!("{:?}", read.course) };
            // A twentieth of a turn of 100 Hz in windows of 4 s.
            assert!((share - 0.01 * percent).abs() < 2e-4, "{percent} {share}");
        }
    }

    /// What a speed moves towards, and how fast, each with an error that holds the truth.
    #[test]
    fn a_pump_that_warms_tells_its_time_constant() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        let warming = PumpSpeed { change_percent: -6.0, time_constant_s: 11.0 };
        let read = followed(&rig, &records(&rig, Some(Mechanism::PumpSpeed(warming)), 4)).unwrap();
        let Course::Warming { share, time_s } = read.course else { panic!("{:?}", read.course) };
        // Four standard errors, and what a step of the climb and a ripple that is not quite the model's leave.
        assert!((share + 0.06).abs() < 4.0 * read.error + 3e-4, "{share} ± {}", read.error);
        assert!((time_s - 11.0).abs() < 4.0 * read.time_error_s + 0.05, "{time_s} ± {}", read.time_error_s);
        assert!(read.time_error_s < 0.5, "{}", read.time_error_s);
    }

    #[test]
    fn nothing_is_followed_at_the_stated_speed() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        assert_eq!(followed(&rig, &records(&rig, None, 3)).map(|read| read.course), None);
    }
}
