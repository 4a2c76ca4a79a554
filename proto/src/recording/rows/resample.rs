//! Samples of any rate brought to rows of 20 ms.
//!
//! With `x(t)` a command held from sample to sample, or the straight lines between the samples of something measured, a row
//! at `t` holds
//!
//! ```text
//! command, signal     mean of x over t … t + 20 ms        (what acts in that row, pulses shorter than a row included)
//! switch              x(t), held: there is no half of a relay
//! reading             x(t); where samples are closer than rows, the mean of x over t ± 10 ms
//! ```
//!
//! The mean over a symmetric span shifts nothing in time and keeps the noise down as all samples together do. Samples that
//! stand on a grid of 20 ms, up to [`AS_THEY_ARE_S`], are rows as they are. The usual distance of samples is the mean of steps near the median.
//!
//! Samples that are missing make a hole. A short one (twice the usual distance and a half, or [`BRIDGED_S`], whichever is longer)
//! is bridged: rows go on, commands held, readings on straight lines. A longer one is a gap, where a segment ends. Rows that no
//! sample is near to, in a hole or between samples further apart than [`SPARSE_ROWS`], are marked as not measured: they carry a
//! simulation on and are no evidence.

use std::ops::Range;

use super::repeated::Sensors;
use crate::recording::table::PERIOD_S;

/// Steps beyond this many usual ones are gaps, if they are beyond [`BRIDGED_S`] too.
const GAP_STEPS: f64 = 2.5;
/// The longest step that is bridged at any rate (s): four lost rows, a tenth of a chamber's usual time constant of a second.
const BRIDGED_S: f64 = 0.1;
/// Samples further apart than this many rows leave rows between them that nobody measured.
const SPARSE_ROWS: f64 = 1.5;
/// Distance of sparse samples in s.
pub(crate) const SPARSE_S: f64 = SPARSE_ROWS * PERIOD_S;
/// A row between two neighbouring samples closer than this many rows was measured.
const NEIGHBOURS_ROWS: f64 = 1.75;
/// Samples closer than this share of a row are averaged.
const DENSE_ROWS: f64 = 0.75;
/// Distance from the grid of 20 ms up to which samples are rows as they are (s): at 20 kPa/s, fast for a chamber, it is 0.02 kPa,
/// less than a sensor's noise.
const AS_THEY_ARE_S: f64 = 1e-3;
/// Share by which the usual distance may be off 20 ms for that.
const AS_THEY_ARE_RATE: f64 = 5e-3;

/// Share of a row's reading that may be a line in place of missing samples.
const MISSING: f64 = 0.25;

/// Kind of a column, which says how its rows are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// A command between 0 and 1.
    Command,
    /// A relay: 0 or 1.
    Switch,
    /// A prescribed flow or pressure, as measured.
    Signal,
    /// A sensor's reading.
    Reading,
}

/// Samples and the rows they are brought to.
#[derive(Debug)]
pub(crate) struct Resampling<'t> {
    time_s: &'t [f64],
    /// Usual distance of samples (s).
    pub(crate) step_s: f64,
    /// Time of each row (s).
    pub(crate) rows: Vec<f64>,
    /// By row, whether a sample was taken there.
    pub(crate) measured: Vec<bool>,
    /// By row, the sample that it is, where samples are rows as they are.
    is_sample: Option<Vec<Option<usize>>>,
    /// Times at which commands were written, where these are others (s).
    commands_s: Option<&'t [f64]>,
    /// Relation of samples and readings.
    sensors: Sensors,
    /// Holes that were bridged: the time of the row or sample before each (s), and the rows or samples that it lacks.
    pub(crate) holes: Vec<(f64, usize)>,
}

impl<'t> Resampling<'t> {
    /// Lays rows over samples whose times go forward.
    pub(crate) fn new(time_s: &'t [f64]) -> Self {
        let step_s = usual_step(time_s).unwrap_or(PERIOD_S);
        let longest_s = longest_s(step_s);
        let mut of = Resampling {
            time_s,
            step_s,
            rows: Vec::new(),
            measured: Vec::new(),
            is_sample: None,
            commands_s: None,
            sensors: Sensors::EachSample,
            holes: holes(time_s, step_s, longest_s),
        };
        let runs = runs(time_s, longest_s);
        let on_grid = (step_s / PERIOD_S - 1.0).abs() <= AS_THEY_ARE_RATE;
        match on_grid.then(|| runs.iter().map(|run| of.as_they_are(run)).collect::<Option<Vec<_>>>()).flatten() {
            Some(laid) => {
                let mut is_sample = Vec::new();
                for (time, sample) in laid.into_iter().flatten() {
                    of.rows.push(time);
                    of.measured.push(sample.is_some());
                    is_sample.push(sample);
                }
                of.is_sample = Some(is_sample);
            }
            None => runs.iter().for_each(|run| of.lay(run.clone(), on_grid)),
        }
        of
    }

    /// These rows, for commands that were written at times of their own.
    pub(crate) fn commanded(self, commands_s: &'t [f64]) -> Self {
        Resampling { commands_s: Some(commands_s), ..self }
    }

    /// Usual distance of samples (s), that of rows where they are closer.
    pub(crate) fn sampling_s(&self) -> f64 {
        let step_s = self.step_s * self.sensors.samples();
        if step_s > SPARSE_S { step_s } else { PERIOD_S }
    }

    /// Takes only those samples for readings that are `fresh`.
    pub(crate) fn only(&mut self, fresh: &[bool], sensors: Sensors) {
        self.sensors = sensors;
        let taken = self.taken_at(fresh);
        self.measured.iter_mut().zip(taken).for_each(|(measured, taken)| *measured &= taken);
    }

    /// By row, whether it is a sample that is `fresh`, or the nearest to one.
    pub(crate) fn taken_at(&self, fresh: &[bool]) -> Vec<bool> {
        if let Some(is_sample) = &self.is_sample {
            let of = |sample: &Option<usize>| sample.and_then(|sample| fresh.get(sample)).copied().unwrap_or(false);
            return is_sample.iter().map(of).collect();
        }
        let mut is_near = vec![false; self.rows.len()];
        for (time, _) in self.time_s.iter().zip(fresh).filter(|(_, fresh)| **fresh) {
            let row = self.rows.partition_point(|row| *row < time - 0.5 * PERIOD_S);
            is_near.get_mut(row).into_iter().for_each(|near| *near = true);
        }
        is_near
    }

    /// Tells whether samples are rows as they are, but for lost ones.
    pub(crate) fn is_as_it_was(&self) -> bool {
        self.is_sample.is_some()
    }

    /// The samples of a run as rows, lost ones added; `None` where they stand off the grid.
    fn as_they_are(&self, run: &Range<usize>) -> Option<Vec<(f64, Option<usize>)>> {
        let mut rows: Vec<(f64, Option<usize>)> = Vec::with_capacity(run.len());
        let first = *self.time_s.get(run.start)?;
        let mut place = 0.0;
        let mut before: Option<f64> = None;
        for sample in run.clone() {
            let time = *self.time_s.get(sample)?;
            let here = ((time - first) / PERIOD_S).round();
            // Slow drift of a clock is no jitter: the step is what must be whole.
            let step = before.map_or(PERIOD_S, |before| time - before);
            let whole = (step / PERIOD_S).round();
            if whole < 1.0 || (step - whole * PERIOD_S).abs() > 2.0 * AS_THEY_ARE_S {
                return None;
            }
            if (time - first - here * PERIOD_S).abs() > AS_THEY_ARE_S + AS_THEY_ARE_RATE * (time - first) {
                return None;
            }
            if let Some(before) = before {
                let lost = (1..whole as usize).map(|k| (before + step * k as f64 / whole, None));
                rows.extend(lost);
            }
            rows.push((time, Some(sample)));
            place += whole;
            before = Some(time);
        }
        (place >= 0.0).then_some(rows)
    }

    /// Lays rows of 20 ms over a run of samples; on the phase that most of them have where they are as far apart as rows.
    fn lay(&mut self, run: Range<usize>, on_grid: bool) {
        let Some(samples) = self.time_s.get(run) else { return };
        let (Some(first), Some(last)) = (samples.first().copied(), samples.last().copied()) else { return };
        let begin = if on_grid { first + phase(samples, first) } else { first };
        // The last sample of a grid may come early.
        let slack = if on_grid { 0.5 } else { 1e-6 };
        let count = ((last - begin) / PERIOD_S + slack).floor().max(0.0) as usize + 1;
        let from = self.rows.len();
        let sparse = self.step_s > SPARSE_S;
        let mut after = 0;
        for k in 0..count {
            let t = begin + PERIOD_S * k as f64;
            while samples.get(after).is_some_and(|sample| *sample < t - 1e-9) {
                after += 1;
            }
            let apart = match (after.checked_sub(1).and_then(|before| samples.get(before)), samples.get(after)) {
                (Some(before), Some(after)) => after - before,
                _ => 0.0,
            };
            self.rows.push(t);
            self.measured.push(!sparse && apart <= NEIGHBOURS_ROWS * PERIOD_S);
        }
        for sample in samples {
            let nearest = ((sample - begin) / PERIOD_S).round().max(0.0) as usize;
            if let Some(measured) = self.measured.get_mut(from + nearest.min(count - 1)) {
                *measured = true;
            }
        }
    }

    /// The rows of a column.
    pub(crate) fn rows_of(&self, x: &[f64], kind: Kind) -> Vec<f64> {
        if let Some(time_s) = self.commands_s.filter(|_| kind != Kind::Reading) {
            let rows = self.rows.clone();
            let of = Resampling {
                time_s,
                rows,
                measured: Vec::new(),
                is_sample: None,
                commands_s: None,
                holes: Vec::new(),
                ..*self
            };
            return of.rows_of(x, kind);
        }
        if let Some(is_sample) = &self.is_sample {
            return self.rows.iter().zip(is_sample).map(|(t, sample)| self.as_it_was(x, *t, *sample, kind)).collect();
        }
        let held = kind == Kind::Command;
        let sums = self.integral(x, held);
        let mean = |from: f64, to: f64| {
            (self.integral_to(x, &sums, held, to) - self.integral_to(x, &sums, held, from)) / (to - from)
        };
        let half = 0.5 * PERIOD_S;
        self.rows
            .iter()
            .map(|t| match kind {
                Kind::Command | Kind::Signal => mean(*t, t + PERIOD_S),
                Kind::Switch => self.held(x, *t),
                Kind::Reading if self.step_s < DENSE_ROWS * PERIOD_S => mean(t - half, t + half),
                Kind::Reading => self.at(x, *t),
            })
            .collect()
    }

    /// By row, whether a reading is missing where samples lack one: where more than [`MISSING`] of what the row takes is a line over it.
    pub(crate) fn missing_of(&self, missing: &[bool]) -> Vec<bool> {
        let lacks: Vec<f64> = missing.iter().map(|missing| f64::from(u8::from(*missing))).collect();
        self.rows_of(&lacks, Kind::Reading).into_iter().map(|share| share > MISSING).collect()
    }

    /// The texts of a column, each the last one at or before a row.
    pub(crate) fn texts_of(&self, texts: &[String]) -> Vec<String> {
        let last = |t: &f64| self.time_s.partition_point(|sample| *sample <= t + 1e-9).saturating_sub(1);
        self.rows.iter().map(|t| texts.get(last(t)).cloned().unwrap_or_default()).collect()
    }

    fn as_it_was(&self, x: &[f64], t: f64, sample: Option<usize>, kind: Kind) -> f64 {
        match (sample, kind) {
            (Some(sample), _) => x.get(sample).copied().unwrap_or(f64::NAN),
            (None, Kind::Command | Kind::Switch) => self.held(x, t),
            (None, Kind::Signal | Kind::Reading) => self.at(x, t),
        }
    }

    /// The last sample at or before `t`, the first one before all.
    fn held(&self, x: &[f64], t: f64) -> f64 {
        let before = self.time_s.partition_point(|sample| *sample <= t + 1e-9);
        x.get(before.saturating_sub(1)).copied().unwrap_or(f64::NAN)
    }

    /// Integral of a column from the first sample to each.
    fn integral(&self, x: &[f64], held: bool) -> Vec<f64> {
        let mut sum = 0.0;
        let mut sums = vec![0.0];
        for (time, value) in self.time_s.windows(2).zip(x.windows(2)) {
            let height = if held { value[0] } else { 0.5 * (value[0] + value[1]) };
            sum += height * (time[1] - time[0]);
            sums.push(sum);
        }
        sums
    }

    /// Integral from the first sample to `t`; before the first and after the last sample the column stays as it is there.
    fn integral_to(&self, x: &[f64], sums: &[f64], held: bool, t: f64) -> f64 {
        let before = self.time_s.partition_point(|sample| *sample <= t);
        let Some(i) = before.checked_sub(1) else {
            let (first, value) = (self.time_s.first().copied().unwrap_or(t), x.first().copied().unwrap_or(0.0));
            return (t - first) * value;
        };
        let at = |numbers: &[f64], k: usize| numbers.get(k).copied().unwrap_or(0.0);
        let since = t - at(self.time_s, i);
        let height = if held { at(x, i) } else { 0.5 * (at(x, i) + self.at(x, t)) };
        at(sums, i) + height * since
    }

    /// The straight line between samples at `t`.
    fn at(&self, x: &[f64], t: f64) -> f64 {
        let after = self.time_s.partition_point(|sample| *sample <= t);
        let sample = |k: usize| Some((*self.time_s.get(k)?, *x.get(k)?));
        match (after.checked_sub(1).and_then(sample), sample(after)) {
            (Some((t0, x0)), Some((t1, x1))) => x0 + (x1 - x0) * (t - t0) / (t1 - t0),
            (Some((_, x)), None) | (None, Some((_, x))) => x,
            (None, None) => f64::NAN,
        }
    }

    /// Lines that a person should read about the rows.
    pub(crate) fn notes(&self, file: &str) -> Vec<String> {
        let mut notes = Vec::new();
        if !self.is_as_it_was() {
            let mut note = format!("{file}: samples {:.1} ms apart, brought to rows of 20 ms", 1e3 * self.step_s);
            let jitter_ms = 1e3 * jitter_s(self.time_s, self.step_s);
            if jitter_ms > 0.02e3 * self.step_s {
                note.push_str(&format!(" (steps scatter by {jitter_ms:.1} ms)"));
            }
            if self.step_s > SPARSE_S {
                note.push_str(&format!(
                    "; what lies between samples was not measured, so nothing faster than {:.0} ms can be told",
                    1e3 * self.step_s
                ));
            }
            notes.push(note);
        }
        let apart_ms = 1e3 * self.step_s * self.sensors.samples();
        match self.sensors {
            // Which sensor was read how often is told with their names.
            Sensors::EachSample | Sensors::Own(_) => {}
            Sensors::Repeated(times) => notes.push(format!(
                "{file}: every reading stands there {times} times, so the sensors were read every {apart_ms:.0} ms; only the first of each is \
                 taken for a reading, and nothing faster can be told"
            )),
            Sensors::Slower(_) => notes.push(format!(
                "{file}: the sensors have no number in some rows; they were read every {apart_ms:.0} ms, what lies between counts as no \
                 reading, and nothing faster can be told"
            )),
        }
        if let Some(note) = self.bridged(file) {
            notes.push(note);
        }
        notes
    }

    /// Remark on the samples that were lost and bridged, with their number and places.
    fn bridged(&self, file: &str) -> Option<String> {
        const TOLD: usize = 4;
        let lost: usize = self.holes.iter().map(|(_, lost)| lost).sum();
        if lost == 0 {
            return None;
        }
        let places: Vec<String> = self.holes.iter().take(TOLD).map(|(time_s, _)| format!("{time_s:.2}")).collect();
        let more = if self.holes.len() > TOLD { " …" } else { "" };
        let [rows, places_word] = [(lost, "row"), (self.holes.len(), "place")]
            .map(|(count, word)| if count == 1 { format!("1 {word}") } else { format!("{count} {word}s") });
        Some(format!(
            "{file}: {rows} lost in {places_word} (after {}{more} s) and bridged: commands held, nothing there counts as a reading",
            places.join(", ")
        ))
    }
}

/// Median distance of samples (s).
pub(crate) fn median_step(time_s: &[f64]) -> Option<f64> {
    let mut steps: Vec<f64> = time_s.windows(2).map(|w| w[1] - w[0]).collect();
    let middle = steps.len() / 2;
    (!steps.is_empty()).then(|| *steps.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Mean of the steps that are no holes (s): a clock that ticks in whole ms has a median that is off.
fn usual_step(time_s: &[f64]) -> Option<f64> {
    let median = median_step(time_s)?;
    let near = time_s.windows(2).map(|w| w[1] - w[0]).filter(|step| (0.5 * median..=1.5 * median).contains(step));
    let (count, sum) = near.fold((0.0, 0.0), |(count, sum), step| (count + 1.0, sum + step));
    Some(if count > 0.0 { sum / count } else { median })
}

/// Standard deviation of the steps that are no holes (s).
fn jitter_s(time_s: &[f64], step_s: f64) -> f64 {
    let off = time_s.windows(2).map(|w| w[1] - w[0] - step_s).filter(|off| *off < 0.5 * step_s);
    let (count, squares) = off.fold((0.0, 0.0), |(count, squares), off| (count + 1.0, squares + off * off));
    (squares / f64::max(count, 1.0)).sqrt()
}

/// Holes that are bridged.
fn holes(time_s: &[f64], step_s: f64, longest_s: f64) -> Vec<(f64, usize)> {
    let usual_s = step_s.max(PERIOD_S);
    let hole = |w: &[f64]| {
        let step = w[1] - w[0];
        let lost = (step / usual_s).round() as usize;
        (step > NEIGHBOURS_ROWS * usual_s && step <= longest_s && lost > 1).then(|| (w[0], lost - 1))
    };
    time_s.windows(2).filter_map(hole).collect()
}

/// The longest step that is bridged (s), by the usual one.
fn longest_s(step_s: f64) -> f64 {
    (GAP_STEPS * step_s).max(BRIDGED_S) + 2.0 * AS_THEY_ARE_S
}

/// Runs of samples between which simulations begin anew.
pub(crate) fn runs_of(time_s: &[f64]) -> Vec<Range<usize>> {
    runs(time_s, longest_s(usual_step(time_s).unwrap_or(PERIOD_S)))
}

/// Runs of samples without a gap.
fn runs(time_s: &[f64], longest_s: f64) -> Vec<Range<usize>> {
    let mut runs = Vec::new();
    let mut start = 0;
    for (at, w) in time_s.windows(2).enumerate() {
        if w[1] - w[0] > longest_s {
            runs.push(start..at + 1);
            start = at + 1;
        }
    }
    runs.push(start..time_s.len());
    runs
}

/// Phase of the grid of 20 ms that most samples are near to, from `first` on (s): the median of their distances from it.
fn phase(samples: &[f64], first: f64) -> f64 {
    let off = |base: f64| -> f64 {
        let mut offs: Vec<f64> = samples
            .iter()
            .map(|t| {
                let k = ((t - first - base) / PERIOD_S).round();
                t - first - base - k * PERIOD_S
            })
            .collect();
        let middle = offs.len() / 2;
        if offs.is_empty() { 0.0 } else { *offs.select_nth_unstable_by(middle, f64::total_cmp).1 }
    };
    // Twice, since a first sample that is far off makes some of the others wrap round.
    let once = off(0.0);
    let phase = once + off(once);
    phase - (phase / PERIOD_S).round() * PERIOD_S
}
