//! Competing hypotheses that measured data do not tell apart, whatever a likelihood of white noise says.
//!
//! A likelihood is right about hypotheses one of which is right. Where the best one still leaves several times the noise,
//! none is: what it leaves is the same in thousands of rows, and rows that belong together count as so many witnesses. A
//! per cent of such a residual is then "certain" to hundreds of units of log-likelihood, and would be the other way round on
//! another day. So hypotheses are compared there by what they are off by on validation data.

use fit::data::{Role, Stretch};

use crate::bench::{Bench, Explanation};

use super::left;

/// Multiples of the noise that are several (chosen: what a sound formula of the right mechanism leaves on rigs of other makes
/// is one to two).
const SEVERAL_TIMES_NOISE: f64 = 3.0;
/// Ratio of two errors on validation data within which they may be alike (chosen: errors of one rig differ by as much from one day's
/// recordings to the next).
const ALIKE: f64 = 1.1;
/// Standard errors of the mean difference by block by which the better one must be better throughout to be told apart all the same.
const THROUGHOUT_SE: f64 = 2.0;
/// Rows of a block: 4 s.
const BLOCK_ROWS: usize = 200;

/// Tells whether what `best` leaves is several times the noise of a channel, and more than a model may leave that lacks nothing.
pub(super) fn leaves_several_times_the_noise(bench: &Bench<'_>, best: &Explanation) -> bool {
    let left = left(bench, best);
    bench.is_much(&left) && left.iter().zip(bench.sigma_kpa()).any(|(kpa, sigma)| *kpa > SEVERAL_TIMES_NOISE * sigma)
}

/// Tells whether `rival` is off by about as much as `best` on validation data, and not by more on the other rows or in block after
/// block of all, where that is the measure.
pub(super) fn alike_on_validation_data(bench: &Bench<'_>, best: &Explanation, rival: &Explanation) -> bool {
    let other_rows = |e: &Explanation| bench.squares_by_channel(&e.trace, false).iter().sum::<f64>();
    // One jump that comes late throws an open-loop simulation off until the next: where a flapper jumps such errors are no measure.
    let is_measure = !best.jumps && !rival.jumps;
    is_measure
        && leaves_several_times_the_noise(bench, best)
        && bench.validation_kpa(&rival.trace) < ALIKE * bench.validation_kpa(&best.trace)
        && other_rows(rival) < ALIKE * ALIKE * other_rows(best)
        && !is_worse_throughout(&differences(bench, best, rival))
}

/// By how much `rival` is off more than `best`, as the logarithm of the ratio of squares, in each block of all rows: both have about
/// as many parameters, so that rows which were fitted favour neither.
fn differences(bench: &Bench<'_>, best: &Explanation, rival: &Explanation) -> Vec<f64> {
    let layout = bench.records.layout();
    let noise: f64 = bench.sigma_kpa().iter().map(|sigma| sigma * sigma).sum::<f64>() / layout.channels().max(1) as f64;
    let square = |trace: &[f64], block: &Stretch| {
        let rows = (0..layout.channels()).flat_map(|channel| layout.stretch(block.record, channel, block.rows.clone()));
        let off = rows.filter_map(|i| Some((trace.get(i)? - bench.records.readings_kpa().get(i)?).powi(2)));
        let (sum, count) = off.fold((0.0, 0.0), |(sum, count), square| (sum + square, count + 1.0));
        sum / f64::max(count, 1.0) + noise
    };
    let blocks = [Role::Fit, Role::Select, Role::HeldOut].map(|role| bench.split.blocks(role, BLOCK_ROWS));
    blocks.iter().flatten().map(|block| (square(&rival.trace, block) / square(&best.trace, block)).ln()).collect()
}

/// Tells whether the mean of some differences is larger than nothing by more than [`THROUGHOUT_SE`].
fn is_worse_throughout(differences: &[f64]) -> bool {
    let n = differences.len() as f64;
    let mean = differences.iter().sum::<f64>() / n.max(1.0);
    let variance = differences.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    n > 2.0 && mean > THROUGHOUT_SE * (variance / n).sqrt()
}

/// Cost by which a hypothesis whose error is alike may be behind after a glance: half the logarithm of the ratio of squares for
/// each of `readings`.
pub(super) fn cost_of_alike(readings: f64) -> f64 {
    readings * ALIKE.ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_better_in_block_after_block_is_told_apart() {
        let scatter = |k: usize| 0.3 * ((k * 7 % 11) as f64 - 5.0) / 5.0;
        let alike: Vec<f64> = (0..33).map(scatter).collect();
        assert!(!is_worse_throughout(&alike));
        let worse: Vec<f64> = (0..33).map(|k| 0.15 + scatter(k)).collect();
        assert!(is_worse_throughout(&worse));
        assert!(!is_worse_throughout(&[0.5]));
    }
}
