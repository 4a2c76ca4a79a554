//! Quantities of a rig's recordings that a mismatch may follow: commands, pressures, time since a change, time since the start.

use crate::bench::Bench;
use crate::locate::region::{Axis, AxisKind};

/// A command that moves by more than this from one row to the next has changed.
const CHANGED: f64 = 2e-3;
/// Time since a change in s, beyond which more makes no difference.
const LONG_AFTER_S: f64 = 10.0;

/// The axes on which a region of a mismatch is looked for, `first_command` first; pressures are those of `channels`.
pub(crate) fn axes(bench: &Bench<'_>, first_command: Option<&str>, channels: &[usize]) -> Vec<Axis> {
    let records = bench.records;
    let all = 0..records.records().len();
    let mut columns: Vec<&str> = records.inputs().iter().map(|input| input.column.as_str()).collect();
    columns.sort_by_key(|column| Some(*column) != first_command);
    let command = |column: &str| Axis {
        kind: AxisKind::Command,
        name: column.to_owned(),
        values: all.clone().map(|record| records.input(record, column).unwrap_or_default().to_vec()).collect(),
    };
    let pressure = |channel: &usize| {
        let name = records.sensors().get(*channel)?.clone();
        let values = all.clone().map(|record| records.channel_kpa(record, *channel).to_vec()).collect();
        Some(Axis { kind: AxisKind::Pressure, name, values })
    };
    let mut axes: Vec<Axis> = columns.iter().map(|column| command(column)).collect();
    axes.extend(channels.iter().filter_map(pressure));
    if !columns.is_empty() {
        let values = all.clone().map(|record| since_change(bench, record)).collect();
        axes.push(Axis { kind: AxisKind::SinceChange, name: "time since a change".to_owned(), values });
    }
    let since_start = |record: usize| {
        let time_s = records.records().get(record).map_or(&[][..], |r| &r.time_s);
        let first = time_s.first().copied().unwrap_or(0.0);
        time_s.iter().map(|t| t - first).collect()
    };
    axes.push(Axis {
        kind: AxisKind::SinceStart,
        name: "time since the start".to_owned(),
        values: all.map(since_start).collect(),
    });
    axes
}

/// Time in s since any command changed, row by row of a recording.
fn since_change(bench: &Bench<'_>, record: usize) -> Vec<f64> {
    let Some(r) = bench.records.records().get(record) else { return Vec::new() };
    let mut last = f64::NEG_INFINITY;
    let changed = |row: usize| {
        row > 0
            && r.inputs.iter().any(|input| {
                input.get(row).zip(input.get(row - 1)).is_some_and(|(now, before)| (now - before).abs() > CHANGED)
            })
    };
    let at = |(row, t): (usize, &f64)| {
        if changed(row) {
            last = *t;
        }
        (t - last).min(LONG_AFTER_S)
    };
    r.time_s.iter().enumerate().map(at).collect()
}
