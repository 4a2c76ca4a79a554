//! Pressures that something moves in a rig that nothing moves.
//!
//! A rig without pump, source and command can only settle: each pressure stays between those it began with and the open air. A
//! recording that leaves these bounds was moved by what the rig file does not have, and any physics that a search found for it
//! would be made up. A chamber under pressure that is left to itself stays within them, and its leak can be told.

use std::ops::Range;

use model::rig::Rig;

use super::excitation::deviation;
use super::readings::range_of;
use super::{Finding, Severity, Trouble};
use crate::data::{Noise, Record, Records};

/// Samples that say where a stretch begins.
const FIRST: usize = 5;
/// Share of what was recorded at most by which warming air and sensors may leave the bounds …
const SHARE: f64 = 0.05;
/// … and deviations of the noise …
const NOISES: f64 = 10.0;
/// … and at least, in kPa, what a barometer and a sensor that warms up drift by while a rig rests …
const DRIFT_KPA: f64 = 3.0;
/// … but no less and no more of a sensor's range than these shares: sensors drift by a percent of it, and one for small pressures is made
/// for less than a barometer does.
const DRIFT_SHARES: [f64; 2] = [0.01, 0.1];

/// Rows for which all commands stand still at least for what pressures do meanwhile to be asked: 10 s …
const STILL_ROWS: usize = 500;
/// … and those behind the last step in which a chamber may still go where that step sends it.
const AFTER_STEP_ROWS: usize = 50;

/// Share of a recording from which on rows in which pressures go up and down at commands that stand still make it unusable; a supply
/// that cycles or a load that moves does it for a while, and is for a comparison to find.
const LARGER_PART: f64 = 0.5;

/// Samples that are taken together to see whether a pressure turns round.
const TOGETHER: usize = 25;
/// Share of all that a pressure moves through by which it must go back to have turned round, and times that it turns round which commands
/// that stand still do not explain: a few wide swings, or more of lesser ones, which warming air does not make.
const SWINGS: [(f64, usize); 2] = [(0.3, 2), (0.08, 3)];

pub(super) fn check(rig: &Rig, records: &Records, noise: &[Noise], findings: &mut Vec<Finding>) {
    if !records.inputs().is_empty() {
        // One line is enough where nothing can be told in any case; what a fit cannot do without a comparison can.
        if findings.iter().all(|f| f.severity != Severity::Unusable || f.trouble == Trouble::NoExcitation) {
            match driven_unseen(records, noise) {
                Some(found) => findings.push(found),
                None => findings.extend(driven_unseen_for_a_while(records, noise)),
            }
        }
        return;
    }
    if !rig.pumps.is_empty() || !rig.sources.is_empty() {
        return;
    }
    for (record, r) in records.records().iter().enumerate() {
        for rows in &r.segments {
            let samples: Vec<usize> = rows.clone().filter(|row| r.is_measured(*row)).collect();
            let of = |channel: usize| -> Vec<f64> {
                let values = records.channel_kpa(record, channel);
                samples.iter().filter_map(|row| values.get(*row)).copied().collect()
            };
            let all: Vec<Vec<f64>> = (0..records.sensors().len()).map(of).collect();
            let begun = all.iter().map(|values| middle(values.get(..FIRST.min(values.len())).unwrap_or_default()));
            let (low, high) = begun.fold((0.0_f64, 0.0_f64), |(low, high), p| (low.min(p), high.max(p)));
            for (channel, values) in all.iter().enumerate() {
                let column = records.sensors().get(channel).cloned().unwrap_or_default();
                let margin = margin_kpa(values, SHARE, noise.get(channel), range_of(rig, &column));
                let Some(beyond) = values.iter().find(|p| **p > high + margin || **p < low - margin) else { continue };
                let most = values.iter().copied().fold(*beyond, |most, p| if p.abs() > most.abs() { p } else { most });
                findings.push(Finding {
                    source: r.source.clone(),
                    column,
                    severity: Severity::Unusable,
                    trouble: Trouble::NothingMoves,
                    text: format!(
                        "goes to {most:.1} kPa, and nothing in this rig can move a pressure: no pump, no source, no command. Add to the rig \
                         file what moved it (a pump with its command, a source with its signal), or keep only the rows after it"
                    ),
                });
                return;
            }
        }
    }
}

/// Distance in kPa by which readings of a pressure that nothing drives may leave the bounds that there were at first: a share of the
/// largest of them, the noise, and drift of a sensor of this range.
pub(super) fn margin_kpa(values: &[f64], share: f64, noise: Option<&Noise>, range: Option<[f64; 2]>) -> f64 {
    let largest = values.iter().fold(0.0, |most: f64, p| most.max(p.abs()));
    (share * largest).max(NOISES * noise.map_or(0.0, |n| n.sigma_kpa)).max(drift_kpa(range))
}

/// Distance in kPa by which a sensor of this range, and the barometer, drift while a rig rests.
pub(super) fn drift_kpa(range: Option<[f64; 2]>) -> f64 {
    range.map_or(DRIFT_KPA, |[low, high]| {
        let [least, most] = DRIFT_SHARES.map(|share| share * (high - low));
        DRIFT_KPA.max(least).min(most)
    })
}

/// A pressure that goes up and down although no command and no signal moves in any recording.
fn driven_unseen(records: &Records, noise: &[Noise]) -> Option<Finding> {
    let moves = records.inputs().iter().any(|input| {
        let numbers = (0..records.records().len()).filter_map(|record| records.input(record, &input.column)).flatten();
        deviation(numbers.copied()) > 0.0
    });
    if moves {
        return None;
    }
    for (record, r) in records.records().iter().enumerate() {
        for (channel, column) in records.sensors().iter().enumerate() {
            let levels = levels(records, (record, r), channel, 0..records.channel_kpa(record, channel).len());
            let sigma = noise.get(channel).map_or(0.0, |n| n.sigma_kpa);
            if !swings(&levels, span(&levels), NOISES * sigma) {
                continue;
            }
            let commands: Vec<&str> = records.inputs().iter().map(|input| input.column.as_str()).collect();
            return Some(Finding {
                source: r.source.clone(),
                column: column.clone(),
                severity: Severity::Unusable,
                trouble: Trouble::NothingMoves,
                text: format!(
                    "goes up and down, and {} {} still in all recordings: is it the command that was sent? Name the right column \
                     in the rig file, [recording] columns",
                    commands.join(", "),
                    if commands.len() == 1 { "stands" } else { "stand" }
                ),
            });
        }
    }
    None
}

/// Pressures that go up and down in stretches in which no command and no signal moves, of recordings in which some move elsewhere; the
/// first stretch of each recording is told.
fn driven_unseen_for_a_while(records: &Records, noise: &[Noise]) -> Vec<Finding> {
    let of = |(record, r): (usize, &Record)| {
        let (mut rows, mut unexplained, mut first) = (0, 0, None);
        for segment in &r.segments {
            rows += segment.len();
            for stretch in unexplained_stretches(records, noise, record, segment.clone()) {
                unexplained += stretch.stands.len();
                first.get_or_insert(stretch);
            }
        }
        let Unexplained { channel, stands } = first?;
        let at = |row: usize| r.time_s.get(row).copied().unwrap_or(0.0);
        let is_larger_part = unexplained as f64 >= LARGER_PART * rows as f64;
        Some(Finding {
            source: r.source.clone(),
            column: records.sensors().get(channel).cloned().unwrap_or_default(),
            severity: if is_larger_part { Severity::Unusable } else { Severity::Doubtful },
            trouble: Trouble::NothingMoves,
            text: format!(
                "goes up and down, and no command moves, from {:.1} to {:.1} s: were the commands recorded there? Leave these \
                 rows out, or add to the rig file and the recording what moved the pressure",
                at(stands.start + AFTER_STEP_ROWS),
                at(stands.end.saturating_sub(1))
            ),
        })
    };
    records.records().iter().enumerate().filter_map(of).collect()
}

/// A stretch in which all commands stand still and a pressure goes up and down.
struct Unexplained {
    /// The first channel that does so.
    channel: usize,
    /// Rows in which the commands stand.
    stands: Range<usize>,
}

/// All such stretches of a segment of a recording.
fn unexplained_stretches(records: &Records, noise: &[Noise], record: usize, segment: Range<usize>) -> Vec<Unexplained> {
    let Some(r) = records.records().get(record) else { return Vec::new() };
    let stands = |one: &usize, next: &usize| r.inputs.iter().all(|input| input.get(*one) == input.get(*next));
    let rows: Vec<usize> = segment.clone().collect();
    let still: Vec<&[usize]> = rows.chunk_by(stands).filter(|still| still.len() >= STILL_ROWS).collect();
    if still.is_empty() {
        return Vec::new();
    }
    let levels = |channel: usize, rows: Range<usize>| levels(records, (record, r), channel, rows);
    let channels = 0..records.sensors().len();
    let moves_kpa: Vec<f64> = channels.map(|channel| span(&levels(channel, segment.clone()))).collect();
    let unexplained = |still: &[usize]| {
        let stands = *still.first()?..*still.last()? + 1;
        let swings = |(channel, moves_kpa): (usize, &f64)| {
            let sigma = noise.get(channel).map_or(0.0, |n| n.sigma_kpa);
            let levels = levels(channel, stands.start + AFTER_STEP_ROWS..stands.end);
            swings(&levels, *moves_kpa, NOISES * sigma).then_some(channel)
        };
        let channel = moves_kpa.iter().enumerate().find_map(swings)?;
        Some(Unexplained { channel, stands })
    };
    still.into_iter().filter_map(unexplained).collect()
}

/// Middles of the samples of a channel in these rows of a recording, taken together by [`TOGETHER`], in kPa.
fn levels(records: &Records, (record, r): (usize, &Record), channel: usize, rows: Range<usize>) -> Vec<f64> {
    let values = records.channel_kpa(record, channel);
    let read: Vec<f64> =
        rows.filter(|row| r.is_read(channel, *row)).filter_map(|row| values.get(row)).copied().collect();
    read.chunks(TOGETHER).map(middle).collect()
}

/// Distance between the least and the most of some levels.
fn span(levels: &[f64]) -> f64 {
    let (low, high) = levels.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
    if levels.is_empty() { 0.0 } else { high - low }
}

/// Tells whether levels of a pressure that moves through so many kPa turn round more often than commands that stand still explain.
fn swings(levels: &[f64], moves_kpa: f64, least_kpa: f64) -> bool {
    SWINGS.iter().any(|(share, least)| turns(levels, (share * moves_kpa).max(least_kpa)) >= *least)
}

/// Number of times that levels turn round by so many kPa.
fn turns(levels: &[f64], back: f64) -> usize {
    let (mut turns, mut lowest, mut highest, mut rises) = (0, f64::INFINITY, f64::NEG_INFINITY, None);
    for level in levels {
        lowest = level.min(lowest);
        highest = level.max(highest);
        let turned = match rises {
            Some(true) => *level < highest - back,
            Some(false) => *level > lowest + back,
            None => {
                let begun = highest - lowest > back;
                if begun {
                    rises = Some(*level == highest);
                }
                false
            }
        };
        if turned {
            turns += 1;
            rises = rises.map(|rises| !rises);
            (lowest, highest) = (*level, *level);
        }
    }
    turns
}

fn middle(values: &[f64]) -> f64 {
    let mut values = values.to_vec();
    let at = values.len() / 2;
    if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(at, f64::total_cmp).1 }
}
