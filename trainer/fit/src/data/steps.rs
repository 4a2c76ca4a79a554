//! Rows in which a command steps, and those near to one: what a pressure does there is the command's doing.

use super::Record;
use super::noise::span;

/// Share of its whole way that a command steps by.
const STEP: f64 = 0.1;
/// Rows behind a step within which a pressure answers at once: 0.1 s, the time that a relay, a valve or a pump takes.
const ANSWER_ROWS: usize = 5;

/// Rows in which a command of a recording steps.
pub(super) fn command_steps(record: &Record) -> Vec<usize> {
    let of = |input: &Vec<f64>| {
        let least = STEP * span(Some(input));
        let stepped = |(row, pair): (usize, &[f64])| ((pair[1] - pair[0]).abs() > least).then_some(row + 1);
        input.windows(2).enumerate().filter_map(stepped).collect::<Vec<usize>>()
    };
    record.inputs.iter().flat_map(of).collect()
}

/// By one of some rows, whether a command steps in it, in the next one, or shortly before it.
pub(super) fn near_steps(record: &Record, rows: &[usize]) -> Vec<bool> {
    let mut near = vec![false; record.time_s.len()];
    for step in command_steps(record) {
        let answering = step.saturating_sub(1)..(step + ANSWER_ROWS + 1).min(near.len());
        near.get_mut(answering).unwrap_or_default().fill(true);
    }
    rows.iter().map(|row| near.get(*row).copied().unwrap_or(false)).collect()
}
