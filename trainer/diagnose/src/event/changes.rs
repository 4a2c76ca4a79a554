//! Lasting changes at a moment: a jump of the error, and a plateau after it.
//!
//! A sensor that lost its zero, a fitting that came loose, a knob that was turned and left there: before the moment the model is off by
//! one amount, after it by another, and the same was asked of it before and after. With `e` the error averaged over half a second,
//! two levels are likelier than one by
//!
//! ```text
//! 2 ln Λ = n ln (Σ (e − ē)² / (Σ before (e − ē₁)² + Σ after (e − ē₂)²))
//! ```
//!
//! (a change of mean at one point: Hinkley, *Biometrika* 57, 1970). Blocks of an error hang together, so the likelihood is not asked how
//! certain: the jump must be larger than what the error does elsewhere, and sudden. It is looked for whatever was named, since what is
//! named holds for all recordings and a change for a part of one.

use fit::data::Records;
use proto::diagnosis::ChangeInTime;

use crate::bench::Bench;
use crate::event::asked_outside;

/// Rows whose errors are taken together: half a second.
const BLOCK: usize = 25;
/// Fewest blocks before and after: 5 s.
const SHORTEST: usize = 10;
/// Blocks on either side by which a jump is told from a drift: 2 s.
const SUDDEN: usize = 4;
/// Share of the jump that must lie between those.
const AT_ONCE: f64 = 0.6;
/// Multiples of the scatter of blocks around their level, and of the noise of a reading, that a jump must exceed.
const TIMES_SCATTER: f64 = 3.0;
const TIMES_NOISE: f64 = 3.0;
/// Least jump in kPa.
const LEAST_KPA: f64 = 0.1;

/// Lasting changes of what `trace` is off by, the largest first; at most one of a channel of each recording. In files that the rig
/// explains without what was found (`explained`) nothing changed: what jumps there came with what was found.
pub(crate) fn changes(bench: &Bench<'_>, trace: &[f64], explained: &[&str]) -> Vec<ChangeInTime> {
    let (records, layout) = (bench.records, bench.records.layout());
    let mut found = Vec::new();
    let asked =
        |record: &usize| records.records().get(*record).is_some_and(|r| !explained.contains(&r.source.as_str()));
    for record in (0..layout.records()).filter(asked) {
        for channel in 0..layout.channels() {
            let change =
                Errors::of(bench, trace, record, channel).and_then(|errors| errors.jump(bench, record, channel));
            let Some((time_s, jump_kpa)) = change else { continue };
            found.push(ChangeInTime {
                recording: records.records().get(record).map(|r| r.source.clone()).unwrap_or_default(),
                channel: records.sensors().get(channel).cloned().unwrap_or_default(),
                time_s,
                jump_kpa,
            });
        }
    }
    found.sort_by(|a, b| b.jump_kpa.abs().total_cmp(&a.jump_kpa.abs()));
    found
}

/// Errors of a channel in one recording, by block: recorded less simulated.
struct Errors {
    kpa: Vec<f64>,
    /// First row of each block.
    row: Vec<usize>,
}

impl Errors {
    fn of(bench: &Bench<'_>, trace: &[f64], record: usize, channel: usize) -> Option<Self> {
        let range = bench.records.layout().channel(record, channel);
        let [simulated, recorded, counted] =
            [trace, bench.records.readings_kpa(), bench.counted()].map(|values| values.get(range.clone()));
        let (simulated, recorded, counted) = (simulated?, recorded?, counted?);
        let mut errors = Errors { kpa: Vec::new(), row: Vec::new() };
        for start in (0..recorded.len()).step_by(BLOCK) {
            let rows = start..(start + BLOCK).min(recorded.len());
            let off: Vec<f64> =
                rows.filter(|row| counted[*row] != 0.0).map(|row| recorded[row] - simulated[row]).collect();
            if off.len() * 2 >= BLOCK {
                errors.kpa.push(off.iter().sum::<f64>() / off.len() as f64);
                errors.row.push(start);
            }
        }
        (errors.kpa.len() >= 2 * SHORTEST).then_some(errors)
    }

    /// Time in s and size in kPa of the jump that explains most, if it is one.
    fn jump(&self, bench: &Bench<'_>, record: usize, channel: usize) -> Option<(f64, f64)> {
        let (at, jump_kpa, scatter_kpa) = likeliest(&self.kpa)?;
        let noise_kpa = bench.sigma_kpa().get(channel).copied().unwrap_or(0.0);
        let least_kpa = LEAST_KPA.max(TIMES_NOISE * noise_kpa).max(TIMES_SCATTER * scatter_kpa);
        if jump_kpa.abs() < least_kpa || !is_sudden(&self.kpa, at, jump_kpa) {
            return None;
        }
        let row = *self.row.get(at)?;
        let r = bench.records.records().get(record)?;
        asked_alike(bench.records, record, row).then_some((*r.time_s.get(row)?, jump_kpa))
    }
}

/// Tells whether the commands after a row are among those before it, or the other way round.
fn asked_alike(records: &Records, record: usize, row: usize) -> bool {
    let Some(r) = records.records().get(record) else { return false };
    asked_outside(&r.inputs, &(row..r.time_s.len())) || asked_outside(&r.inputs, &(0..row))
}

/// The split into two levels that leaves least: its first block after, the jump, and the scatter around the levels.
fn likeliest(kpa: &[f64]) -> Option<(usize, f64, f64)> {
    let n = kpa.len();
    let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len().max(1) as f64;
    let squares = |part: &[f64], mean: f64| part.iter().map(|e| (e - mean).powi(2)).sum::<f64>();
    (SHORTEST..=n.checked_sub(SHORTEST)?)
        .map(|at| {
            let (before, after) = kpa.split_at(at);
            let [low, high] = [mean(before), mean(after)];
            (at, high - low, squares(before, low) + squares(after, high))
        })
        .min_by(|a, b| a.2.total_cmp(&b.2))
        .map(|(at, jump, within)| (at, jump, (within / n as f64).sqrt()))
}

/// Tells whether most of a jump lies between the two seconds before it and the two after.
fn is_sudden(kpa: &[f64], at: usize, jump_kpa: f64) -> bool {
    let mean = |range: std::ops::Range<usize>| {
        let part = kpa.get(range).unwrap_or_default();
        part.iter().sum::<f64>() / part.len().max(1) as f64
    };
    let here = mean(at..(at + SUDDEN).min(kpa.len())) - mean(at.saturating_sub(SUDDEN)..at);
    here / jump_kpa > AT_ONCE
}

/// A change in words, in the recording that is shown as `file`.
pub(crate) fn in_words(change: &ChangeInTime, file: &str) -> String {
    format!(
        "Something changed at {:.1} s of {file} and stayed: {} reads {:.2} kPa {} than the model from then on, beside what it did before.",
        change.time_s,
        change.channel,
        change.jump_kpa.abs(),
        if change.jump_kpa > 0.0 { "more" } else { "less" }
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_jump_that_stays_is_told_from_a_drift_and_from_scatter() {
        let scatter = |k: usize| 0.02 * ((k * 7 % 11) as f64 - 5.0) / 5.0;
        let jumped: Vec<f64> = (0..100).map(|k| scatter(k) + if k >= 63 { 0.5 } else { 0.0 }).collect();
        let (at, jump_kpa, scatter_kpa) = likeliest(&jumped).unwrap();
        assert_eq!(at, 63);
        assert!((jump_kpa - 0.5).abs() < 0.01 && is_sudden(&jumped, at, jump_kpa) && scatter_kpa < 0.02);
        let drifting: Vec<f64> = (0..100).map(|k| scatter(k) + 0.01 * k as f64).collect();
        let (at, jump_kpa, _) = likeliest(&drifting).unwrap();
        assert!(!is_sudden(&drifting, at, jump_kpa));
        assert!(likeliest(&jumped[..12]).is_none());
    }
}
