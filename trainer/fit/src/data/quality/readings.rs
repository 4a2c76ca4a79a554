//! Flat, stuck and clipped readings.
//!
//! All of these are told from the noise: a sensor that works scatters by at least a step of its converter, so a
//! reading that repeats itself to the last digit for a second is not a calm plant but a dead or saturated sensor.
//! Recordings without noise (simulated ones) are therefore not tested for stuck readings.

use std::ops::Range;

use model::rig::Rig;

use super::finding::consequence;
use super::{Finding, Severity, Trouble, frozen, wild};
use crate::data::noise::{converter_step, of_fourth_differences};
use crate::data::steps::near_steps;
use crate::data::{Noise, Records};
use crate::wording::percent;

/// A run of this many equal readings is stuck: 0.5 s. With noise of half a step two neighbours are equal with
/// probability 0.7 at most, 25 with 1e-4, and most noise is larger.
const STUCK_ROWS: usize = 25;
/// Noise, as a share of a converter's step (its rounding included), below which that does not hold: half a step and its rounding,
/// `√(1/4 + 1/12)`. A chamber at rest then has one reading for long …
const COARSE: f64 = 0.577;
/// … and leaves it (or, at the end of a recording, comes to it) by a step of the converter or as fast as it goes on; a logger that held
/// a value jumps by all that the pressure did meanwhile.
const PLATEAU_STEPS: f64 = 1.5;
const GOING: f64 = 2.0;
/// One reading of so many on the channel's own extreme is a limit.
const HEAP: usize = 50;
/// Share of a sensor's range within which a reading stands at its end, or at the open air.
const NEAR_END: f64 = 0.02;
/// A channel with fewer distinct readings than this is flat.
const DISTINCT: usize = 4;
/// The most of a channel's readings, as a share, that are left out for standing still.
pub(super) const MOST_LEFT_OUT: f64 = 0.2;
/// Samples further apart than this, in s, are not asked for wild ones.
pub(in crate::data) const WILD_SAMPLING_S: f64 = 0.05;

/// Facts on readings that later checks need.
#[derive(Debug, Default)]
pub(super) struct Seen {
    /// Places of wild readings in the recordings' layout.
    pub(super) wild: Vec<usize>,
    /// Recordings and channels that move without noise that would tell a reading that is stuck.
    pub(super) smooth: Vec<(usize, usize)>,
}

/// Masks what cannot be trusted in `usable` and tells it.
pub(super) fn check(
    rig: &Rig,
    records: &Records,
    noise: &[Noise],
    usable: &mut [f64],
    findings: &mut Vec<Finding>,
) -> Seen {
    let mut seen = Seen::default();
    for (record, r) in records.records().iter().enumerate() {
        // Rows without a sample repeat and join; what is wrong shows in samples.
        for (channel, column) in records.sensors().iter().enumerate() {
            let rows: Vec<usize> = (0..r.time_s.len()).filter(|row| r.is_read(channel, *row)).collect();
            let all = records.channel_kpa(record, channel);
            let values: Vec<f64> = rows.iter().filter_map(|row| all.get(*row)).copied().collect();
            let mut mask = vec![1.0; values.len()];
            let sigma = noise.get(channel).map_or(0.0, |n| n.sigma_kpa);
            let add = |severity, trouble, text| {
                findings.push(Finding { source: r.source.clone(), column: column.clone(), severity, trouble, text });
            };
            let near_step = near_steps(r, &rows);
            let (range, sampling_s) = (range_of(rig, column), r.sampling_s);
            let time_s: Vec<f64> = rows.iter().filter_map(|row| r.time_s.get(*row)).copied().collect();
            let of = Channel { values: &values, time_s: &time_s, sigma, range, sampling_s, near_step: &near_step };
            let (smooth, wild) = of.check(&mut mask, add);
            let begin = records.layout().channel(record, channel).start;
            seen.wild.extend(wild.iter().filter_map(|at| Some(begin + rows.get(*at)?)));
            let usable = usable.get_mut(records.layout().channel(record, channel)).unwrap_or_default();
            if smooth {
                seen.smooth.push((record, channel));
                frozen::check(records, record, channel, usable, findings);
            }
            for (row, kept) in rows.iter().zip(&mask) {
                if let Some(slot) = usable.get_mut(*row) {
                    *slot *= kept;
                }
            }
        }
    }
    seen
}

/// The samples of one sensor in one recording.
struct Channel<'a> {
    values: &'a [f64],
    /// Time in s, by sample.
    time_s: &'a [f64],
    /// Noise in kPa.
    sigma: f64,
    /// Range that the sensor can tell, in gauge kPa.
    range: Option<[f64; 2]>,
    sampling_s: f64,
    /// By sample, whether a command steps next to it.
    near_step: &'a [bool],
}

/// Equal readings that are left out.
#[derive(Debug, Default)]
struct Equals {
    /// Readings at a limit.
    clipped: usize,
    /// Most of these in a row, among the readings that are asked.
    longest_clipped: Range<usize>,
    /// The limit, in kPa.
    limit_kpa: f64,
    /// Readings that repeat the one before, at no limit.
    stuck: usize,
    /// Most of these in a row, among the readings that are asked.
    longest_stuck: Range<usize>,
}

impl Channel<'_> {
    /// Masks what cannot be trusted and tells it; whether the reading moves without noise that would tell one that is stuck, and which
    /// of its readings are wild.
    fn check(&self, mask: &mut [f64], mut add: impl FnMut(Severity, Trouble, String)) -> (bool, Vec<usize>) {
        let moves = distinct(self.values) >= DISTINCT;
        if !moves && self.values.len() >= STUCK_ROWS {
            let at = self.values.iter().copied().fold(f64::INFINITY, f64::min);
            add(
                Severity::Unusable,
                Trouble::Flat,
                format!("flat: {at:.2} kPa throughout; check the sensor, its cable and its converter's channel"),
            );
            mask.fill(0.0);
            return (false, Vec::new());
        }
        // Between samples further apart a plant may well go somewhere and come back.
        let (rows, worst) = if self.sampling_s < WILD_SAMPLING_S {
            wild::wild(self.values, self.sigma, self.range, self.near_step)
        } else {
            (Vec::new(), 0.0)
        };
        // Dropouts to one level are no limit that a pressure stands at: what is wild is asked first, and of the others the rest.
        let mut left: Vec<usize> = (0..self.values.len()).collect();
        left.retain(|row| rows.binary_search(row).is_err());
        let of_left = |all: &[f64]| -> Vec<f64> { left.iter().filter_map(|row| all.get(*row)).copied().collect() };
        let (values, time_s) = (of_left(self.values), of_left(self.time_s));
        // Noise within a single recording, for another recording's noise is no proof that this one has any.
        let scatters = scatters(&values);
        if scatters {
            let mut kept = vec![1.0; values.len()];
            self.stuck(&values, &time_s, &mut kept, &mut add);
            left.iter().zip(kept).for_each(|(row, kept)| mask[*row] = kept);
        }
        rows.iter().for_each(|row| mask[*row] = 0.0);
        if !rows.is_empty() {
            let late = rows.iter().enumerate().take_while(|(k, row)| k == *row).count();
            let (severity, trouble, text) = wild::told(rows.len(), self.values.len(), worst, late);
            add(severity, trouble, text);
        }
        (moves && !scatters, rows)
    }

    /// Masks runs of equal readings among `values`, which are those that are not wild, read at `time_s`, and tells clipped ones (at the
    /// channel's own extreme) from stuck ones.
    fn stuck(&self, values: &[f64], time_s: &[f64], mask: &mut [f64], add: &mut impl FnMut(Severity, Trouble, String)) {
        let (low, high) = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
        // The extreme of noise is read once or twice; where a share of all readings stands on it, it is a limit, also where
        // noise lets single readings off it.
        let heaped =
            |limit: f64| values.iter().filter(|v| **v == limit).count() > (values.len() / HEAP).max(STUCK_ROWS);
        let step_kpa = converter_step(values.to_vec());
        let runs = runs_of_equals(values);
        // Where most readings stand at a limit, the noise of all is that of the few others. It is known to half a step of the converter.
        let loose = runs.iter().filter(|run| run.len() < STUCK_ROWS).filter_map(|run| values.get(run.clone()));
        let loose: Vec<f64> = loose.flatten().copied().collect();
        let is_coarse = self.sigma < COARSE * step_kpa && of_fourth_differences(&loose) < step_kpa;
        let apart = |one: usize, other: usize| Some((values.get(one)? - values.get(other)?).abs());
        let is_plateau = |run: Range<usize>| {
            let (last, after) = (run.end - 1, run.end);
            // A command may set it going at once.
            let leaves = apart(last, after).map(|kpa| kpa - GOING * apart(after, after + 1).unwrap_or(0.0));
            let comes = || run.start.checked_sub(1).and_then(|before| apart(before, run.start));
            let jump_kpa = leaves.or_else(comes).unwrap_or(f64::INFINITY);
            is_coarse && jump_kpa < PLATEAU_STEPS * step_kpa
        };
        // A chamber at rest leaves its reading step by step. Of a limit some runs look so, and most do not.
        let is_limit = |limit: f64| {
            let at = || runs.iter().filter(|run| values.get(run.start) == Some(&limit)).cloned();
            let at_rest: usize = at().filter(|run| is_plateau(run.clone())).map(|run| run.len()).sum();
            heaped(limit) && (self.is_cut_off_at(limit) || 2 * at_rest < at().map(|run| run.len()).sum::<usize>())
        };
        let limits = [low, high].map(|limit| is_limit(limit).then_some(limit));
        let mut found = Equals::default();
        for rows in &runs {
            let run = rows.len();
            let value = values.get(rows.start).copied().unwrap_or(0.0);
            if limits.contains(&Some(value)) || run >= STUCK_ROWS && !is_plateau(rows.clone()) {
                let longest = if value == low || value == high {
                    found.clipped += run;
                    found.limit_kpa = value;
                    &mut found.longest_clipped
                } else {
                    found.stuck += run;
                    &mut found.longest_stuck
                };
                if run > longest.len() {
                    *longest = rows.clone();
                }
                mask.get_mut(rows.clone()).unwrap_or_default().fill(0.0);
            }
        }
        self.tell(&found, time_s, add);
    }

    /// Tells of readings that were left out, among those that were asked, read at `time_s`.
    fn tell(&self, found: &Equals, time_s: &[f64], add: &mut impl FnMut(Severity, Trouble, String)) {
        let Equals { clipped, ref longest_clipped, limit_kpa, stuck, ref longest_stuck } = *found;
        let share = |rows: usize| rows as f64 / time_s.len() as f64;
        let what_is_done = |rows: usize, longest: &Range<usize>| {
            consequence(share(rows), MOST_LEFT_OUT, time_s.get(longest.clone()).unwrap_or_default())
        };
        if clipped > 0 {
            let whose = if self.is_at_range_end(limit_kpa) {
                "the end of the sensor's range"
            } else {
                "a limit (sensor, amplifier or converter)"
            };
            let (severity, done) = what_is_done(clipped, longest_clipped);
            add(
                severity,
                Trouble::Clipped,
                format!(
                    "clipped: {clipped} readings ({}) stand at {limit_kpa:.2} kPa, {whose}; {done}. Keep the pressure within the \
                     sensor's range",
                    percent(share(clipped), 1)
                ),
            );
        }
        if stuck > 0 {
            let (severity, done) = what_is_done(stuck, longest_stuck);
            add(
                severity,
                Trouble::Stuck,
                format!(
                    "stuck: {stuck} readings ({}) repeat the one before, for up to {:.1} s; {done}. Look for a logger that holds the \
                     last value",
                    percent(share(stuck), 1),
                    longest_stuck.len() as f64 * self.sampling_s
                ),
            );
        }
    }

    /// Tells whether a reading stands at an end of the sensor's range.
    fn is_at_range_end(&self, kpa: f64) -> bool {
        self.range.is_some_and(|[low, high]| (kpa - low).abs().min((kpa - high).abs()) < NEAR_END * (high - low))
    }

    /// Tells whether readings that heap up here are cut off by the sensor's range, whatever its converter's step. Many ranges end at the
    /// open air, where chambers rest.
    fn is_cut_off_at(&self, kpa: f64) -> bool {
        let is_air = self.range.is_some_and(|[low, high]| kpa.abs() < NEAR_END * (high - low));
        self.is_at_range_end(kpa) && !is_air
    }
}

/// Rows of each run of equal readings.
fn runs_of_equals(values: &[f64]) -> Vec<Range<usize>> {
    let ends = values.chunk_by(|a, b| a == b).scan(0, |end, run| {
        *end += run.len();
        Some(*end - run.len()..*end)
    });
    ends.collect()
}

/// Number of different readings.
fn distinct(values: &[f64]) -> usize {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.dedup();
    sorted.len()
}

/// Tells whether readings scatter by noise: most differ from the one before; where long runs of equal ones hide that, most of the
/// others do and keep turning round. (Independent noise turns at two steps of three; a simulated plant without noise, which rests
/// in runs of equal readings too, hardly ever.)
fn scatters(values: &[f64]) -> bool {
    let changes = values.windows(2).filter(|w| w[0] != w[1]).count();
    if changes * 2 > values.len() {
        return true;
    }
    let (mut rows, mut steps): (usize, Vec<f64>) = (0, Vec::new());
    for run in values.chunk_by(|a, b| a == b).filter(|run| run.len() < STUCK_ROWS) {
        rows += run.len();
        steps.extend(run.first());
    }
    let turns = steps.windows(3).filter(|w| (w[1] - w[0]) * (w[2] - w[1]) < 0.0).count();
    rows >= 2 * STUCK_ROWS && steps.len() * 2 > rows && turns * 3 > steps.len()
}

/// Lowest and highest pressure that the sensor of a column can tell, in gauge kPa.
pub(super) fn range_of(rig: &Rig, column: &str) -> Option<[f64; 2]> {
    let (_, sensor) = rig.sensor_of(column)?;
    let [a, b] = sensor.range_kpa_gauge;
    Some([a.min(b), a.max(b)])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Readings of a chamber that fills, rests, fills again and is emptied, with steps of `step_kpa`; the first of those `held` stands in
    /// all of them.
    fn readings(step_kpa: f64, held: Range<usize>) -> Vec<f64> {
        let noise = |k: usize| 0.02 * ((k * 7919 % 1000) as f64 / 1000.0 * 37.0).sin();
        let kpa = |k: usize| match k % 500 {
            j @ 0..200 => 0.31 * j as f64,
            j @ 200..290 => 62.0 + 0.2 * (1.0 - (-0.03 * (j - 200) as f64).exp()),
            // At once, as behind a step of a command.
            j @ 290..350 => 62.9 + 0.7 * (j - 290) as f64,
            j => 104.2 - 0.69 * (j - 350) as f64,
        };
        let at = |k: usize| if held.contains(&k) { held.start } else { k };
        (0..2000).map(|k| ((kpa(at(k)) + noise(at(k))) / step_kpa).round() * step_kpa).collect()
    }

    fn told(step_kpa: f64, held: Range<usize>) -> Vec<Trouble> {
        told_of(&readings(step_kpa, held), step_kpa, [-100.0, 300.0])
    }

    fn told_of(values: &[f64], step_kpa: f64, range: [f64; 2]) -> Vec<Trouble> {
        found_in(values, step_kpa, range).into_iter().map(|(_, trouble, _)| trouble).collect()
    }

    fn found_in(values: &[f64], step_kpa: f64, range: [f64; 2]) -> Vec<(Severity, Trouble, String)> {
        // Noise of 0.014 kPa and the rounding's.
        let sigma = (0.014_f64.powi(2) + step_kpa.powi(2) / 12.0).sqrt();
        let time_s: Vec<f64> = (0..values.len()).map(|k| 0.02 * k as f64).collect();
        let of = Channel { values, time_s: &time_s, sigma, range: Some(range), sampling_s: 0.02, near_step: &[] };
        let mut found = Vec::new();
        of.check(&mut vec![1.0; values.len()], |severity, trouble, text| found.push((severity, trouble, text)));
        found
    }

    /// Where over a fifth of the readings stands still nothing can be fitted: that is said, with where and what can be done.
    #[test]
    fn what_cannot_be_fitted_says_so() {
        let of = |values: &[f64], wanted: Trouble| {
            let found = found_in(values, 0.01, [-100.0, 300.0]);
            let (severity, _, text) = found.into_iter().find(|(_, trouble, _)| *trouble == wanted).unwrap();
            (severity, text)
        };
        let (severity, text) = of(&readings(0.01, 100..160), Trouble::Stuck);
        assert!(severity == Severity::Doubtful && text.contains("; left out. "), "{text}");
        let told = "left out, and more than 20 % of all: nothing can be fitted to this recording; leave the file out";
        let refused = |severity: Severity, text: &str| severity == Severity::Unusable && text.contains(told);
        let (severity, text) = of(&readings(0.01, 100..900), Trouble::Stuck);
        assert!(refused(severity, &text) && text.contains("the longest stretch: 2.0 to 18.0 s"), "{text}");
        let cut: Vec<f64> = readings(0.01, 0..0).iter().map(|kpa| kpa.min(64.0)).collect();
        let (severity, text) = of(&cut, Trouble::Clipped);
        assert!(refused(severity, &text), "{text}");
    }

    /// A coarse converter gives one reading of a chamber at rest; a logger that holds one jumps from it, coarse or not.
    #[test]
    fn rest_between_coarse_steps_is_not_stuck() {
        for step_kpa in [0.25, 0.125] {
            assert!(!told(step_kpa, 0..0).contains(&Trouble::Stuck), "{step_kpa}");
            assert!(told(step_kpa, 100..160).contains(&Trouble::Stuck), "{step_kpa}");
        }
        assert!(told(0.01, 100..160).contains(&Trouble::Stuck));
    }

    /// Readings of a chamber that rests at the open air, is filled and emptied again, cut off at `most_kpa`.
    fn from_the_air(step_kpa: f64, most_kpa: f64) -> Vec<f64> {
        let noise = |k: usize| 0.02 * ((k * 7919 % 1000) as f64 / 1000.0 * 37.0).sin();
        let kpa = |k: usize| match k % 500 {
            0..120 => 0.0,
            j @ 120..320 => 0.31 * (j - 120) as f64,
            j => 62.0 * (-0.03 * (j - 320) as f64).exp(),
        };
        (0..2000).map(|k| ((kpa(k).min(most_kpa) + noise(k)) / step_kpa).round() * step_kpa).collect()
    }

    /// A coarse converter's reading of a chamber at the open air is its lowest (or, of a vacuum, its highest) and no limit, also where the
    /// sensor's range ends there; the other end of the range is one.
    #[test]
    fn rest_at_the_open_air_is_not_clipped() {
        for step_kpa in [0.25, 0.125] {
            let values = from_the_air(step_kpa, f64::INFINITY);
            let vacuum: Vec<f64> = values.iter().map(|kpa| -kpa).collect();
            for low in [0.0, -100.0] {
                assert_eq!(told_of(&values, step_kpa, [low, 300.0]), [], "{step_kpa} from {low}");
                assert_eq!(told_of(&vacuum, step_kpa, [-300.0, -low]), [], "{step_kpa} to {}", -low);
            }
            let cut = from_the_air(step_kpa, 50.0);
            assert_eq!(told_of(&cut, step_kpa, [0.0, 50.0]), [Trouble::Clipped], "{step_kpa}");
        }
    }
}
