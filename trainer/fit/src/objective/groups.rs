//! Readings whose residuals may belong together: neighbours in time, and moments at which the plant was in the same state.

use crate::data::{Records, Stretch};

/// Parts of a channel's pressures, each with as many readings.
const LEVELS: usize = 4;
/// Time over which a pressure is said to rise or to fall, in s.
const TREND_S: f64 = 0.5;

/// The block of each reading; `usize::MAX` for none.
pub fn by_time(records: &Records, blocks: &[Stretch]) -> Vec<usize> {
    let layout = records.layout();
    let mut numbers = vec![usize::MAX; layout.len()];
    for (number, block) in blocks.iter().enumerate() {
        for channel in 0..layout.channels() {
            if let Some(part) = numbers.get_mut(layout.stretch(block.record, channel, block.rows.clone())) {
                part.fill(number);
            }
        }
    }
    numbers
}

/// The state of the plant at each reading, in numbers: its channel, which quarter of the channel's pressures it is in, and whether that
/// pressure rises or falls.
///
/// What a formula is off by depends on the state and comes back whenever the state does, in all blocks of time alike, so that blocks
/// do not see it.
pub fn by_state(records: &Records) -> Vec<usize> {
    let layout = records.layout();
    let mut numbers = vec![usize::MAX; layout.len()];
    for channel in 0..layout.channels() {
        let mut sorted: Vec<f64> =
            (0..layout.records()).flat_map(|record| records.channel_kpa(record, channel)).copied().collect();
        sorted.sort_by(f64::total_cmp);
        let bounds: Vec<f64> = (1..LEVELS).filter_map(|k| sorted.get(k * sorted.len() / LEVELS).copied()).collect();
        for (record, recorded) in records.records().iter().enumerate() {
            let pressures = records.channel_kpa(record, channel);
            let Some(part) = numbers.get_mut(layout.channel(record, channel)) else { continue };
            for (row, number) in part.iter_mut().enumerate() {
                let (Some(now), Some(time_s)) = (pressures.get(row), recorded.time_s.get(row)) else { continue };
                let earlier = recorded.time_s.partition_point(|t| *t < time_s - TREND_S);
                let rises = pressures.get(earlier).is_some_and(|before| now >= before);
                let level = bounds.partition_point(|bound| bound <= now);
                *number = 2 * (LEVELS * channel + level) + usize::from(rises);
            }
        }
    }
    numbers
}
