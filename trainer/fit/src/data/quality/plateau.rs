//! Readings cut off at a limit before the noise comes in.
//!
//! An amplifier that is at its end gives one level, and a converter behind it reads that level with its own noise: no reading repeats, and
//! [`super::readings`] sees none that is stuck. What tells such a plateau is that a pressure runs into it at full speed and is still at
//! once, as no chamber comes to rest; that it is the channel's own extreme, the same to a part of the noise however often; and that the
//! rig would go beyond it meanwhile, now further and now less far, while the other pressures move. A valve that stays shut (a
//! dead band that the rig file lacks) leaves a chamber at what the pump can do, which the chamber approaches slowly. A command that steps
//! stops a pressure at once as well, so a run that begins there tells nothing.

use std::ops::Range;

use super::expected::Expected;
use super::finding::consequence;
use super::readings::range_of;
use super::{Finding, Trouble, median};
use crate::data::noise::span;
use crate::data::steps::command_steps;
use crate::data::{Noise, Records};
use crate::wording::percent;
use model::rig::Rig;

/// Rows of one run at the limit: 0.5 s.
const ROWS: usize = 25;
/// One reading of so many at the limit is enough.
const HEAP: usize = 50;
/// Depth below the largest reading, in deviations of the noise, of readings at one level.
const DEEP: f64 = 7.0;
/// By how much of a deviation the medians of runs at one level differ at most.
const LEVEL: f64 = 1.0;
/// Rows before a run, and deviations by which a pressure comes up over them that runs into a limit.
const APPROACH_ROWS: usize = 10;
const APPROACH: f64 = 12.0;
/// Rows from a command's step within which a run that comes to its level is its doing.
const COMMANDED_ROWS: usize = 3;
/// Deviations and share of all that a channel moves through by which the rig must go beyond a limit, and vary meanwhile.
const BEYOND: f64 = 10.0;
const BEYOND_SHARE: f64 = 0.05;
/// Share of its whole way that another channel goes meanwhile.
const MOVES: f64 = 0.2;
/// Share of a channel's readings from which on what is left out leaves too little.
const MOST: f64 = 0.5;

/// Masks such readings in `usable`, of the recordings' layout, and tells them.
pub(super) fn check(
    rig: &Rig,
    records: &Records,
    noise: &[Noise],
    expected: &Expected<'_>,
    usable: &mut [f64],
    findings: &mut Vec<Finding>,
) {
    for (record, r) in records.records().iter().enumerate() {
        for (channel, column) in records.sensors().iter().enumerate() {
            let known = findings.iter().any(|f| {
                f.source == r.source && f.column == *column && matches!(f.trouble, Trouble::Clipped | Trouble::Flat)
            });
            if known || r.is_sparse() {
                continue;
            }
            let sigma = noise.get(channel).map_or(0.0, |n| n.sigma_kpa);
            let of = Channel { records, record, channel, sigma };
            let Some((runs, at_kpa)) = [1.0, -1.0].into_iter().find_map(|sign| of.cut_off(sign, expected)) else {
                continue;
            };
            let rows: usize = runs.iter().map(Range::len).sum();
            let usable = usable.get_mut(records.layout().channel(record, channel)).unwrap_or_default();
            let longest = runs.iter().max_by_key(|run| run.len()).and_then(|run| r.time_s.get(run.clone()));
            runs.into_iter().for_each(|run| usable.get_mut(run).unwrap_or_default().fill(0.0));
            let share = rows as f64 / r.time_s.len().max(1) as f64;
            let end = range_of(rig, column)
                .is_some_and(|[low, high]| (at_kpa - low).abs().min((at_kpa - high).abs()) < 0.02 * (high - low));
            let whose =
                if end { "the end of the sensor's range" } else { "a limit (amplifier, converter, or a relief valve)" };
            let (severity, done) = consequence(share, MOST, longest.unwrap_or_default());
            findings.push(Finding {
                source: r.source.clone(),
                column: column.clone(),
                severity,
                trouble: Trouble::Clipped,
                text: format!(
                    "clipped: {rows} readings ({}) stand at {at_kpa:.2} kPa within their noise, {whose}, where the rig would go beyond; \
                     {done}. Keep the pressure below it, or mend the amplifier",
                    percent(share, 1)
                ),
            });
        }
    }
}

/// One channel of one recording.
struct Channel<'a> {
    records: &'a Records,
    record: usize,
    channel: usize,
    /// Noise of a reading (kPa).
    sigma: f64,
}

impl Channel<'_> {
    /// The runs at the upper (`sign` 1) or lower (−1) limit, and its level in kPa; `None` where there is none.
    fn cut_off(&self, sign: f64, expected: &Expected<'_>) -> Option<(Vec<Range<usize>>, f64)> {
        let values = self.records.channel_kpa(self.record, self.channel);
        let y: Vec<f64> = values.iter().map(|v| sign * v).collect();
        let whole = span(Some(values));
        if self.sigma <= 0.0 || y.len() < 2 * HEAP || whole < BEYOND * self.sigma {
            return None;
        }
        let mut sorted = y.clone();
        sorted.sort_by(f64::total_cmp);
        // A thousandth aside, which a loose contact may have put there.
        let most = *sorted.get(y.len() - 1 - y.len() / 1000)?;
        let mut runs = self.runs(&y, most - DEEP * self.sigma);
        let levels: Vec<f64> = runs.iter().map(|run| median(y.get(run.clone()).unwrap_or_default())).collect();
        let level = median(&levels);
        let rows = |runs: &[Range<usize>]| runs.iter().map(Range::len).sum::<usize>();
        let all = rows(&runs);
        let mut alike = levels.iter().map(|of| (of - level).abs() < LEVEL * self.sigma);
        runs.retain(|_| alike.next().unwrap_or(false));
        let many = (y.len() / HEAP).max(2 * ROWS);
        // A chamber comes to rest at the atmosphere by itself.
        if rows(&runs) < many || 5 * rows(&runs) < 4 * all || level.abs() < BEYOND_SHARE * whole {
            return None;
        }
        // A chamber whose command steps stops at once, too: a run that comes to its level in such a row is the command's doing.
        let steps = self.records.records().get(self.record).map_or_else(Vec::new, command_steps);
        let is_commanded = |run: &Range<usize>| {
            let reached = run.clone().find(|row| y.get(*row).is_some_and(|y| *y >= level)).unwrap_or(run.start);
            let around = run.start.saturating_sub(COMMANDED_ROWS)..=reached + COMMANDED_ROWS;
            steps.iter().any(|step| around.contains(step))
        };
        let by_itself = || runs.iter().filter(|run| run.start >= APPROACH_ROWS && !is_commanded(run));
        let comes_up = |run: &&Range<usize>| {
            let before = run.start.checked_sub(APPROACH_ROWS).and_then(|at| y.get(at));
            before.is_some_and(|before| level - before > APPROACH * self.sigma)
        };
        let entered = by_itself().count();
        let corners = by_itself().filter(comes_up).count();
        if corners == 0 || 2 * corners < entered {
            return None;
        }
        let at_limit = |values: &[f64]| -> Vec<f64> {
            runs.iter().flat_map(|run| values.get(run.start + ROWS / 2..run.end).unwrap_or_default()).copied().collect()
        };
        let channels = 0..self.records.sensors().len();
        let mut others =
            channels.filter(|c| *c != self.channel).map(|c| self.records.channel_kpa(self.record, c)).peekable();
        let alone = others.peek().is_none();
        if !alone && !others.any(|other| span(Some(&at_limit(other))) > MOVES * span(Some(other))) {
            return None;
        }
        let margin = (BEYOND * self.sigma).max(BEYOND_SHARE * whole);
        let mut would: Vec<f64> =
            at_limit(expected.channel_kpa(self.record, self.channel)?).into_iter().map(|kpa| sign * kpa).collect();
        would.sort_by(f64::total_cmp);
        let part = |share: f64| would.get((share * would.len() as f64) as usize).copied();
        let goes_beyond = part(0.5)? > level + margin && part(0.95)? - part(0.05)? > margin;
        goes_beyond.then_some((runs, sign * level))
    }

    /// Runs of readings above a level within the recording's stretches.
    fn runs(&self, y: &[f64], above: f64) -> Vec<Range<usize>> {
        let segments = self.records.records().get(self.record).map_or(&[][..], |r| &r.segments);
        let mut runs = Vec::new();
        for segment in segments {
            let mut start = segment.start;
            let values = y.get(segment.clone()).unwrap_or_default();
            for part in values.chunk_by(|a, b| (*a > above) == (*b > above)) {
                let run = start..start + part.len();
                start = run.end;
                if part.len() >= ROWS && part.first().is_some_and(|first| *first > above) {
                    runs.push(run);
                }
            }
        }
        runs
    }
}
