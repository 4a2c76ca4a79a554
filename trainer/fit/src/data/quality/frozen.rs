//! A reading that stands for long while the commands and another channel move.
//!
//! Where readings scatter by noise a second of equal ones is told ([`super::readings`]). A reading that hardly scatters (a fine
//! sensor behind a coarse converter, or one that stands for most of the recording) leaves no noise to tell by. Ten
//! seconds of the very same digits while every command and another pressure go over a tenth of their way are no plant either: the
//! chambers are tied together by the pump, and a chamber that is shut off has a command that stands. A coarse reading is not asked:
//! a good controller may hold a pressure within one of its steps for as long.
//!
//! Where all sensors stand, or the only one, nothing but the rig as given says that they ought to move. It is asked for shares of its own way,
//! which are the same in any unit.

use std::ops::Range;

use proto::recording::PERIOD_S;

use super::expected::Expected;
use super::finding::consequence;
use super::readings::MOST_LEFT_OUT;
use super::{Finding, Trouble};
use crate::data::Records;
use crate::data::noise::span;
use crate::wording::percent;

/// Shortest run of equal readings that is asked for, in s.
const LONG_S: f64 = 10.0;
/// Share of its whole way that a command or another channel goes meanwhile.
const MOVES: f64 = 0.1;
/// Time at the beginning of the run in which what moves may still be what came before it, in s.
const BEFORE_S: f64 = 1.0;
/// Share of all that the rig would move through, and steps of the converter, that it would go meanwhile where a reading is frozen.
const WOULD_MOVE: f64 = 0.15;
const WOULD_STEP: f64 = 20.0;
/// Steps of the converter, at least, that all that a channel moves through is worth: one of a thousand is 0.1 kPa of 100.
const FINE: f64 = 1000.0;

/// Masks the rows of such runs in one channel of one recording, and tells them.
pub(super) fn check(records: &Records, record: usize, channel: usize, usable: &mut [f64], findings: &mut Vec<Finding>) {
    let Some(r) = records.records().get(record) else { return };
    let readings = records.channel_kpa(record, channel);
    if !is_fine(readings) {
        return;
    }
    let others: Vec<&[f64]> =
        (0..records.sensors().len()).filter(|c| *c != channel).map(|c| records.channel_kpa(record, c)).collect();
    let inputs: Vec<&[f64]> = r.inputs.iter().map(Vec::as_slice).filter(|input| is_graded(input)).collect();
    let is_read = |row: usize| r.is_read(channel, row);
    let frozen: Vec<Range<usize>> = runs(readings, is_read).filter(|run| stands_alone(run, &inputs, &others)).collect();
    let meanwhile = "commands and the other channel move";
    findings.extend(left_out(records, (record, channel), frozen, meanwhile, usable));
}

/// Masks the rows of runs during which a command moves and the rig as given would move the pressure, and tells them; `smooth` are
/// recordings and channels without noise to tell them by. A rig that is somewhat off its file moves all the same.
pub(super) fn check_by_model(
    records: &Records,
    smooth: &[(usize, usize)],
    expected: &Expected<'_>,
    usable: &mut [f64],
    findings: &mut Vec<Finding>,
) {
    for &(record, channel) in smooth {
        let (Some(r), Some(column)) = (records.records().get(record), records.sensors().get(channel)) else { continue };
        let is_known = |f: &Finding| f.source == r.source && f.column == *column && f.trouble == Trouble::Stuck;
        let readings = records.channel_kpa(record, channel);
        let long: Vec<Range<usize>> = runs(readings, |row| r.is_read(channel, row)).collect();
        if long.is_empty() || findings.iter().any(is_known) {
            continue;
        }
        let Some(would) = expected.channel_kpa(record, channel) else { continue };
        let least_kpa = (WOULD_MOVE * span(Some(would))).max(WOULD_STEP * step(readings));
        let is_left = |run: &Range<usize>| {
            let rows = later(run);
            r.inputs.iter().any(|input| moves(input, &rows)) && way(would, &rows) > least_kpa
        };
        let frozen = long.into_iter().filter(is_left).collect();
        let usable = usable.get_mut(records.layout().channel(record, channel)).unwrap_or_default();
        let meanwhile = "commands move and the rig would follow them";
        findings.extend(left_out(records, (record, channel), frozen, meanwhile, usable));
    }
}

/// Masks runs of a channel that lie within one stretch, and tells them.
fn left_out(
    records: &Records,
    (record, channel): (usize, usize),
    mut frozen: Vec<Range<usize>>,
    meanwhile: &str,
    usable: &mut [f64],
) -> Option<Finding> {
    let (r, column) = (records.records().get(record)?, records.sensors().get(channel)?);
    frozen.retain(|run| r.segments.iter().any(|segment| segment.start <= run.start && run.end <= segment.end));
    let longest = frozen.iter().max_by_key(|run| run.len())?.clone();
    let rows: usize = frozen.iter().map(Range::len).sum();
    for run in frozen {
        usable.get_mut(run).unwrap_or_default().fill(0.0);
    }
    let share = rows as f64 / r.time_s.len().max(1) as f64;
    let (severity, done) = consequence(share, MOST_LEFT_OUT, r.time_s.get(longest.clone()).unwrap_or_default());
    Some(Finding {
        source: r.source.clone(),
        column: column.clone(),
        severity,
        trouble: Trouble::Stuck,
        text: format!(
            "stuck: readings stand still for up to {:.1} s ({} of the recording) while {meanwhile}; {done}. Look for a dead sensor or a \
             logger that holds the last value",
            longest.len() as f64 * PERIOD_S,
            percent(share, 1),
        ),
    })
}

/// Runs of equal readings that are long from the first to the last one that was read: what stands in place of those of a sensor that was
/// not read (it came off, or was plugged in later) is no reading.
fn runs(readings: &[f64], is_read: impl Fn(usize) -> bool) -> impl Iterator<Item = Range<usize>> {
    let least = (LONG_S / PERIOD_S) as usize;
    let mut start = 0;
    readings.chunk_by(|a, b| a == b).filter_map(move |run| {
        let range = start..start + run.len();
        start = range.end;
        let read = range.clone().find(|row| is_read(*row))?..range.clone().rfind(|row| is_read(*row))? + 1;
        (read.len() >= least).then_some(read)
    })
}

/// Tells whether every command and some other channel move during a run.
fn stands_alone(run: &Range<usize>, inputs: &[&[f64]], others: &[&[f64]]) -> bool {
    let rows = later(run);
    let moves = |numbers: &&[f64]| moves(numbers, &rows);
    !inputs.is_empty() && inputs.iter().all(moves) && others.iter().any(moves)
}

/// The rows of a run but for its beginning ([`BEFORE_S`]).
fn later(run: &Range<usize>) -> Range<usize> {
    run.start + (BEFORE_S / PERIOD_S) as usize..run.end
}

/// Tells whether numbers go over a good part of their whole way ([`MOVES`]) within some rows.
fn moves(numbers: &[f64], rows: &Range<usize>) -> bool {
    way(numbers, rows) > MOVES * span(Some(numbers))
}

/// Way that numbers go over within some rows; none where there are no such rows.
fn way(numbers: &[f64], rows: &Range<usize>) -> f64 {
    numbers.get(rows.clone()).map_or(0.0, |part| span(Some(part)))
}

/// Tells whether neighbouring readings are a small step apart.
fn is_fine(readings: &[f64]) -> bool {
    span(Some(readings)) > FINE * step(readings)
}

/// Least distance of two different readings, in kPa: a step of their converter.
fn step(readings: &[f64]) -> f64 {
    let mut sorted = readings.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.dedup();
    sorted.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min)
}

/// Tells whether a command is more than a switch.
fn is_graded(input: &[f64]) -> bool {
    span(Some(input)) > 0.0 && input.iter().any(|x| *x != 0.0 && *x != 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROWS: usize = 2000;

    fn wave(period: f64) -> Vec<f64> {
        (0..ROWS).map(|k| 0.7 + 0.2 * (std::f64::consts::TAU * k as f64 / period).sin()).collect()
    }

    #[test]
    fn a_run_counts_where_all_commands_and_another_channel_move() {
        let (duty, shut) = (wave(400.0), vec![0.8; ROWS]);
        let (moving, resting) = (wave(300.0), vec![3.0; ROWS]);
        let run = 300..1500;
        assert!(stands_alone(&run, &[&duty, &duty], &[&moving]));
        assert!(!stands_alone(&run, &[&duty, &shut], &[&moving]), "a chamber that is shut off may rest");
        assert!(!stands_alone(&run, &[&duty, &duty], &[&resting]), "with the pump off both rest");
        assert!(!stands_alone(&run, &[&duty, &duty], &[]), "of one chamber alone this says nothing");
    }

    #[test]
    fn a_coarse_reading_is_not_asked() {
        let fine = wave(300.0);
        let coarse: Vec<f64> = fine.iter().map(|x| (x * 100.0).round() / 100.0).collect();
        assert!(is_fine(&fine) && !is_fine(&coarse) && !is_fine(&[]) && !is_fine(&[1.0; 600]));
    }

    #[test]
    fn runs_of_ten_seconds_are_found_with_their_rows() {
        let mut readings = wave(300.0);
        readings[100..700].fill(1.5);
        readings[900..1100].fill(1.5);
        let found: Vec<Range<usize>> = runs(&readings, |_| true).collect();
        assert!(found.len() == 1 && found[0] == (100..700), "{found:?}");
    }

    /// A sensor that came off has no run behind its last reading; one that is read in one row of five freezes all the same.
    #[test]
    fn rows_without_a_reading_make_no_run() {
        let mut readings = wave(300.0);
        readings[1000..].fill(1.5);
        assert_eq!(runs(&readings, |row| row < 1100).count(), 0);
        let found: Vec<_> = runs(&readings, |row| row % 5 == 0).collect();
        assert_eq!((found.first(), found.len()), (Some(&(1000..1996)), 1));
    }
}
