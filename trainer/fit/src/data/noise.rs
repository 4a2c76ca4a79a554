//! Scatter of the readings when nothing happens, told from samples alone.
//!
//! White noise shows in differences of neighbouring rows, which a plant with a time constant of a second hardly
//! passes; noise of the fourth difference `Δ⁴y` is `√70` times that of a reading, a parabola's is nil. Quantisation is
//! the smallest step on which (nearly) all readings lie. What noise there is beyond the white is asked of plateaus
//! alone: residuals of a model that lacks something are coloured too, and would explain away what is to be found.
//!
//! Where samples are further apart than rows a fourth difference spans what the plant does; lower ones are taken where commands do
//! not rest long enough for it, `Δ²y` with `√6` and `Δy` with `√2` times the noise of a reading, and of all sizes the smaller
//! ones say what is noise.
//!
//! Readings that are missing, left out or wild are none: differences go over the others, with the coefficients of uneven steps
//! `1 / Π (t_i − t_j)` where one is passed over.

use proto::recording::PERIOD_S;

use super::quality::readings::WILD_SAMPLING_S;
use super::quality::wild::wild;
use super::steps::near_steps;
use super::{Record, Records};

/// The noise of one channel.
#[derive(Debug, Clone, PartialEq)]
pub struct Noise {
    /// Standard deviation of a reading in kPa, quantisation included.
    pub sigma_kpa: f64,
    /// Quantisation step in kPa; 0 where none shows.
    pub step_kpa: f64,
    /// Standard deviation on plateaus of a second, from a parabola, in kPa: what wanders within a second is in it, what does so
    /// from row to row as well. `None` where there are too few plateaus.
    pub on_plateaus_kpa: Option<f64>,
}

impl Noise {
    /// The larger of both, which no model can be nearer to the readings than.
    pub fn floor_kpa(&self) -> f64 {
        self.on_plateaus_kpa.map_or(self.sigma_kpa, |kpa| kpa.max(self.sigma_kpa))
    }
}

/// Rows that a plateau must last for, after twice as many rows for settling: 1 s after 2 s.
const PLATEAU_ROWS: usize = 50;
/// Fewest plateaus that are enough.
const PLATEAUS: usize = 5;

/// The noise of every channel, all recordings together.
pub fn noise(records: &Records) -> Vec<Noise> {
    let wild = wild_places(records);
    let without = wild.contains(&true).then(|| records.clone().without_readings(&wild));
    let records = without.as_ref().unwrap_or(records);
    (0..records.layout().channels())
        .map(|channel| {
            let step_kpa = quantisation(records, channel);
            // A reading that never moves by less than a step has at least the rounding's own noise.
            let floor = step_kpa / 12.0_f64.sqrt();
            let sigma_kpa = white(records, channel).max(floor).max(1e-6);
            Noise { sigma_kpa, step_kpa, on_plateaus_kpa: on_plateaus(records, channel) }
        })
        .collect()
}

/// Readings that are wild by themselves, before any noise is known; of the recordings' layout.
fn wild_places(records: &Records) -> Vec<bool> {
    let mut places = vec![false; records.layout().len()];
    for (record, channel, range) in records.layout().all() {
        let Some(r) = records.records().get(record).filter(|r| r.sampling_s < WILD_SAMPLING_S) else { continue };
        let rows: Vec<usize> = (0..r.time_s.len()).filter(|row| r.is_read(channel, *row)).collect();
        let all = records.channel_kpa(record, channel);
        let values: Vec<f64> = rows.iter().filter_map(|row| all.get(*row)).copied().collect();
        for at in wild(&values, scatter(&values), None, &near_steps(r, &rows)).0 {
            if let Some(place) = rows.get(at).and_then(|row| places.get_mut(range.start + row)) {
                *place = true;
            }
        }
    }
    places
}

/// Deviation of readings from the medians of five, which two wild ones among these do not move.
fn scatter(values: &[f64]) -> f64 {
    let mut off: Vec<f64> = values
        .windows(5)
        .map(|window| {
            let mut sorted = window.to_vec();
            sorted.sort_by(f64::total_cmp);
            (window[2] - sorted[2]).abs()
        })
        .collect();
    deviation(&mut off)
}

/// Standard deviation of a normal whose sizes have the median of these, which are put into another order; 0 of none.
pub fn deviation(sizes: &mut [f64]) -> f64 {
    let middle = sizes.len() / 2;
    // The median of |N(0, 1)| is 0.6745.
    if sizes.is_empty() { 0.0 } else { *sizes.select_nth_unstable_by(middle, f64::total_cmp).1 / 0.6745 }
}

/// Coefficients of the fourth difference and the root of the sum of their squares.
const FOURTH: [f64; 5] = [1.0, -4.0, 6.0, -4.0, 1.0];

/// Most rows from the first to the last reading of a difference, some of which may be passed over.
const LONGEST_ROWS: usize = 8;

/// Rows before a difference in which no command may move by more than [`CALM_SPAN`] for the difference to be calm, and
/// how many calm ones there must be for the others to be left out.
const CALM_ROWS: usize = 8;
const CALM_SPAN: f64 = 0.01;
const CALM_LEAST: usize = 300;

/// Largest less smallest; infinite of nothing.
pub(super) fn span(numbers: Option<&[f64]>) -> f64 {
    let (low, high) = numbers
        .unwrap_or_default()
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(*v), high.max(*v)));
    if low <= high { high - low } else { f64::INFINITY }
}

fn white(records: &Records, channel: usize) -> f64 {
    if records.records().iter().all(Record::is_sparse) {
        return white_of_sparse(records, channel);
    }
    let (mut calm, mut all) = (Vec::new(), Vec::new());
    for (record, r) in records.records().iter().enumerate().filter(|(_, r)| !r.is_sparse()) {
        for rows in &r.segments {
            let values = records.channel_kpa(record, channel);
            let there: Vec<usize> = rows.clone().filter(|row| !r.is_missing(channel, *row)).collect();
            for w in there.windows(FOURTH.len()) {
                let (Some(row), Some(last)) = (w.first().copied(), w.last().copied()) else { continue };
                if last - row > LONGEST_ROWS || !w.iter().all(|row| r.is_measured(*row)) {
                    continue;
                }
                let those = w.iter().filter_map(|row| values.get(*row)).copied();
                let size = difference(those, &fourth(w));
                all.push(size);
                let before = row.saturating_sub(CALM_ROWS).max(rows.start);
                if r.inputs.iter().all(|input| span(input.get(before..last + 1)) < CALM_SPAN) {
                    calm.push(size);
                }
            }
        }
    }
    let mut sizes = if calm.len() >= CALM_LEAST { calm } else { all };
    let sigma = deviation(&mut sizes);
    trimmed(&sizes, sigma)
}

/// Coefficients of the fourth difference of readings in these rows: no parabola and no cubic is left of them.
fn fourth(rows: &[usize]) -> [f64; FOURTH.len()] {
    if rows.windows(2).all(|pair| pair[1] - pair[0] == 1) {
        return FOURTH;
    }
    let at = |k: usize| rows.get(k).copied().unwrap_or(0) as f64;
    std::array::from_fn(|i| (0..FOURTH.len()).filter(|j| *j != i).map(|j| at(i) - at(j)).product::<f64>().recip())
}

/// Size of a difference in units of a reading's noise.
fn difference(values: impl Iterator<Item = f64>, coefficients: &[f64]) -> f64 {
    let norm = coefficients.iter().map(|c| c * c).sum::<f64>().sqrt();
    (values.zip(coefficients).map(|(y, c)| y * c).sum::<f64>() / norm).abs()
}

/// Noise of readings in a row in kPa, by the median of their fourth differences: whatever smooth way the pressure goes. 0 of fewer than five.
pub(super) fn of_fourth_differences(values: &[f64]) -> f64 {
    let mut sizes: Vec<f64> = values.windows(FOURTH.len()).map(|w| difference(w.iter().copied(), &FOURTH)).collect();
    deviation(&mut sizes)
}

/// The median of quantised differences is a multiple of the step over the norm; the mean square of those within three deviations
/// (0.9733 of the variance of a normal) is not. Steps of a valve fall outside.
fn trimmed(sizes: &[f64], first: f64) -> f64 {
    let mut sigma = first;
    for _ in 0..4 {
        let within: Vec<f64> = sizes.iter().filter(|s| **s <= 3.0 * sigma).map(|s| s * s).collect();
        if within.is_empty() {
            break;
        }
        sigma = (within.iter().sum::<f64>() / within.len() as f64 / 0.9733).sqrt();
    }
    sigma
}

/// Coefficients of lower differences.
const SECOND: [f64; 3] = [1.0, -2.0, 1.0];
const FIRST: [f64; 2] = [1.0, -1.0];
/// Calm differences that are enough where samples are sparse.
const SPARSE_LEAST: usize = 40;
/// Quarter of a normal distribution's sizes that are below this many deviations.
const LOWER_QUARTER: f64 = 0.3186;

/// The white noise of samples further apart than rows: of the longest difference that fits between changes of commands.
fn white_of_sparse(records: &Records, channel: usize) -> f64 {
    let orders: [&[f64]; 3] = [&FOURTH, &SECOND, &FIRST];
    let mut last = Vec::new();
    for (order, coefficients) in orders.into_iter().enumerate() {
        let (calm, all) = sparse_differences(records, channel, coefficients);
        if calm.len() >= SPARSE_LEAST || order == 2 {
            last = if calm.is_empty() { all } else { calm };
            break;
        }
    }
    if last.is_empty() {
        return 0.0;
    }
    // What a chamber still does after a command is in many of the larger ones.
    let quarter = last.len() / 4;
    let sigma = *last.select_nth_unstable_by(quarter, f64::total_cmp).1 / LOWER_QUARTER;
    trimmed(&last, sigma)
}

/// Distance in rows, from a whole number of them, from which on samples stand between rows.
const OFF_ROWS: f64 = 0.02;

/// Tells whether samples stand between rows: a row then has a share of two samples, and its neighbour of one of them, so that only
/// every second one is independent.
fn is_off_rows(sampling_s: f64) -> bool {
    let rows = sampling_s / PERIOD_S;
    (rows - rows.round()).abs() > OFF_ROWS
}

/// Differences between samples with no change of command since one sample before them; and all.
fn sparse_differences(records: &Records, channel: usize, coefficients: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let (mut calm, mut all) = (Vec::new(), Vec::new());
    for (record, r) in records.records().iter().enumerate() {
        let values = records.channel_kpa(record, channel);
        let usual = (r.sampling_s / PERIOD_S).ceil() as usize;
        let stride = if is_off_rows(r.sampling_s) { 2 } else { 1 };
        for rows in &r.segments {
            let samples: Vec<usize> = rows.clone().filter(|row| r.is_read(channel, *row)).collect();
            for w in samples.windows((coefficients.len() - 1) * stride + 1) {
                let (Some(first), Some(end)) = (w.first().copied(), w.last().copied()) else { continue };
                // A lost sample makes the steps uneven.
                if end - first > (coefficients.len() - 1) * stride * usual + 1 {
                    continue;
                }
                let those = w.iter().step_by(stride).filter_map(|row| values.get(*row)).copied();
                let size = difference(those, coefficients);
                all.push(size);
                let before = first.saturating_sub(usual).max(rows.start);
                if r.inputs.iter().all(|input| span(input.get(before..end)) < CALM_SPAN) {
                    calm.push(size);
                }
            }
        }
    }
    (calm, all)
}

fn quantisation(records: &Records, channel: usize) -> f64 {
    let mut values: Vec<f64> = Vec::new();
    for (record, r) in records.records().iter().enumerate() {
        let rows = records.channel_kpa(record, channel).iter().enumerate();
        values.extend(rows.filter(|(row, _)| r.is_read(channel, *row)).map(|(_, value)| *value));
    }
    converter_step(values)
}

/// The step that (nearly) all of some readings lie on (kPa); 0 where none shows.
pub(super) fn converter_step(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let gaps: Vec<f64> = values.windows(2).map(|w| w[1] - w[0]).filter(|gap| *gap > 1e-9).collect();
    // Readings written with few digits scatter around the true grid by their rounding.
    let Some(least) = gaps.iter().copied().reduce(f64::min) else { return 0.0 };
    let near: Vec<f64> = gaps.iter().copied().filter(|gap| *gap < 1.5 * least).collect();
    let step = near.iter().sum::<f64>() / near.len() as f64;
    let on_grid = gaps.iter().filter(|gap| (*gap / step - (*gap / step).round()).abs() < 0.1).count();
    // Unquantised noise has gaps of every size; and thousands of values on a handful of steps are a grid.
    let distinct = gaps.len() + 1;
    if on_grid * 10 >= gaps.len() * 9 && distinct * 2 < values.len() { step } else { 0.0 }
}

/// Root mean square of residuals from a parabola on stretches where no command moves.
fn on_plateaus(records: &Records, channel: usize) -> Option<f64> {
    let (mut squares, mut plateaus) = (0.0, 0);
    for (record, r) in records.records().iter().enumerate().filter(|(_, r)| !r.is_sparse()) {
        let values = records.channel_kpa(record, channel);
        let still = |row: usize| {
            r.inputs.iter().all(|input| {
                matches!((input.get(row), input.get(row.wrapping_sub(1))), (Some(a), Some(b)) if (a - b).abs() < 1e-6)
            })
        };
        for rows in &r.segments {
            let mut since = rows.start;
            for row in rows.clone().skip(1) {
                if !still(row) {
                    since = row;
                }
                // Settled for as long again as the plateau itself.
                if row + 1 - since == 3 * PLATEAU_ROWS {
                    let part = values.get(row + 1 - PLATEAU_ROWS..row + 1).unwrap_or_default();
                    let residual = without_parabola(part);
                    squares += residual.iter().map(|r| r * r).sum::<f64>();
                    plateaus += 1;
                    since = row + 1 - PLATEAU_ROWS;
                }
            }
        }
    }
    // A parabola takes three of the rows' degrees of freedom.
    (plateaus >= PLATEAUS).then(|| (squares / (plateaus * (PLATEAU_ROWS - 3)) as f64).sqrt())
}

/// Residuals from the parabola that fits best.
fn without_parabola(values: &[f64]) -> Vec<f64> {
    let n = values.len() as f64;
    // Legendre-like polynomials, orthogonal on the rows: 1, x, x² − mean(x²).
    let x = |i: usize| i as f64 - 0.5 * (n - 1.0);
    let mean_square = (n * n - 1.0) / 12.0;
    let bases: [fn(f64, f64) -> f64; 3] = [|_, _| 1.0, |x, _| x, |x, m| x * x - m];
    let mut residual = values.to_vec();
    for base in bases {
        let norm: f64 = (0..values.len()).map(|i| base(x(i), mean_square).powi(2)).sum();
        let along = residual.iter().enumerate().map(|(i, v)| v * base(x(i), mean_square)).sum::<f64>() / norm;
        for (i, v) in residual.iter_mut().enumerate() {
            *v -= along * base(x(i), mean_square);
        }
    }
    residual
}

/// Noise over all channels, root mean square, in kPa.
pub fn rms_kpa(noise: &[Noise]) -> f64 {
    let squares: f64 = noise.iter().map(|n| n.sigma_kpa.powi(2)).sum();
    (squares / noise.len().max(1) as f64).sqrt()
}
