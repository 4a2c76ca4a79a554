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

#[cfg(test)]
mod tests {
    use super::*;
    use model::rig::Rig;
    use proto::recording::Recording;
    use proto::recording::csv::{Column, ColumnData};

    /// A pressure that goes up and down: a quarter of it in each level, and as much of that rising as falling.
    #[test]
    fn a_state_is_a_level_and_a_direction() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        let rows = 1600;
        let column = |name: &str, of: &dyn Fn(f64) -> f64| Column {
            name: name.to_owned(),
            data: ColumnData::Numbers((0..rows).map(|k| of(0.02 * f64::from(k))).collect()),
        };
        // Up for 8 s, down for 8 s.
        let wave = |t: f64| 90.0 + (1.0 - (t / 8.0 % 2.0 - 1.0).abs());
        let columns = vec![
            column("u_pos", &|_| 0.8),
            column("u_neg", &|_| 0.8),
            column("p_pos_kpa", &wave),
            column("p_neg_kpa", &|t| -wave(t)),
        ];
        let time_s = (0..rows).map(|k| 0.02 * f64::from(k)).collect();
        let records = Records::new(&rig, &[Recording::new("made", time_s, columns).unwrap()]).unwrap();
        let numbers = by_state(&records);
        assert_eq!(numbers.len(), 2 * rows as usize);
        for number in 0..16 {
            let count = numbers.iter().filter(|n| **n == number).count();
            // 200 each, but that the half second after a turn still counts for the way before it.
            assert!((170..=230).contains(&count), "{number}: {count}");
        }
        let at = |t: f64| numbers[(t / 0.02) as usize];
        assert_eq!([at(1.0), at(7.0), at(9.0), at(15.0)], [1, 7, 6, 0]);
        // The other channel: falls where the first one rises.
        assert_eq!(numbers[rows as usize + 50], 8 + 6);
    }
}
