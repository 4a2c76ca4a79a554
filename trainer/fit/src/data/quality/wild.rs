//! Wild readings: what a loose contact or interference puts between sound ones.
//!
//! A reading is wild that its neighbours on both sides contradict, or that no sensor of its range can give: a logger's
//! -9999, the end of a converter. Those at the ends of a run have neighbours on one side only, and two or three in a row bear each other
//! out: they must be much farther from the sound ones than the reading usually moves from row to row, so that neither a pump that
//! starts nor a line that rings is taken for a loose contact. So must one next to a step of a command: where a pump is switched off a
//! pressure turns round within a row.

use std::ops::Range;

use super::finding::consequence;
use super::ranges::{MANY, MARGIN};
use super::{Severity, Trouble, median};

/// A reading this many noise deviations away from the median of its neighbours is wild …
const WILD: f64 = 10.0;
/// … and this far away at least, in kPa: more than the plant can do within two rows and go back on …
const WILD_KPA: f64 = 2.0;
/// … or, on a rig of low pressures, this share of all that the channel moves through.
const WILD_SHARE: f64 = 0.5;
/// Wild readings at an end, or next to each other, are this many times as far off as all but three steps in a hundred are large …
const STEPS: f64 = 5.0;
/// … and as the sound readings around them are apart.
const APART: f64 = 5.0;
/// Most wild readings that stand next to each other.
pub(super) const MOST_TOGETHER: usize = 3;
/// The most of a channel's readings, as a share, that are left out for being wild.
const MOST_LEFT_OUT: f64 = 0.01;
/// Share of its range within which a reading is nothing, or at an end of it.
const NOTHING: f64 = 0.02;
/// Most readings without power that spoil nothing behind them, as a share of all: a fifth.
const LATE_PART: usize = 5;
/// Readings behind those of a sensor without power that show that it scatters.
const LATE_REST: usize = 50;

/// The places of wild readings among those of one channel, and how far the worst is from the sound ones around it (kPa); `near_step` says
/// by reading whether a command steps next to it.
pub(in crate::data) fn wild(
    values: &[f64],
    sigma: f64,
    range: Option<[f64; 2]>,
    near_step: &[bool],
) -> (Vec<usize>, f64) {
    let mut is_wild = outside(values, range);
    let mut turning = Vec::new();
    let limit = WILD_KPA.min(WILD_SHARE * span(values)).max(WILD * sigma);
    for (row, window) in values.windows(5).enumerate() {
        let off = (window[2] - median(window)).abs();
        let others = [window[0], window[1], window[3], window[4]];
        // Farther than the other four are from each other: the crest of a swing stands out, too.
        let (low, high) = others.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
        if off > limit && off > high - low {
            is_wild[row + 2] = true;
            if near_step.get(row + 2) == Some(&true) {
                turning.push((row + 2, off));
            }
        }
    }
    // Steps to and from those that are known already say nothing of how the reading usually moves.
    let sound: Vec<f64> = values.iter().zip(&is_wild).filter(|(_, wild)| !**wild).map(|(v, _)| *v).collect();
    let far = limit.max(STEPS * usual_step(&sound));
    let is_outside = outside(values, range);
    turning.iter().filter(|(row, off)| *off <= far && !is_outside[*row]).for_each(|(row, _)| is_wild[*row] = false);
    for together in 2..=MOST_TOGETHER {
        for from in 2..(values.len() + 1).saturating_sub(together + 2) {
            let around = [from - 2, from - 1, from + together, from + together + 1];
            if stand_off(values, from..from + together, &around, far) {
                is_wild[from..from + together].fill(true);
            }
        }
    }
    let rows = values.len();
    if rows > 5 {
        // Up to three at an end, or one that is the second from it.
        for together in 1..=MOST_TOGETHER.min(rows - 4) {
            let ends = [
                (0..together, [together, together + 1, together + 2]),
                (rows - together..rows, [rows - together - 1, rows - together - 2, rows - together - 3]),
            ];
            for (end, inwards) in ends {
                if stand_off(values, end.clone(), &inwards, far) {
                    is_wild[end].fill(true);
                }
            }
        }
        for (second, inwards) in [(1, [2, 3, 4]), (rows - 2, [rows - 3, rows - 4, rows - 5])] {
            if stand_off(values, second..second + 1, &inwards, far) {
                is_wild[second] = true;
            }
        }
    }
    let late = late(values, far, range);
    is_wild[..late].fill(true);
    let (wild, sound): (Vec<usize>, Vec<usize>) = (0..values.len()).partition(|row| is_wild[*row]);
    let worst = wild.iter().map(|row| off_the_sound(values, &sound, *row)).fold(0.0, f64::max);
    (wild, worst)
}

/// Number of readings at the beginning that a sensor gives which has no power yet: they stand still to the last digit
/// while the others scatter, and the reading that follows is far off in one step, where no chamber gets in a row.
fn late(values: &[f64], far_kpa: f64, range: Option<[f64; 2]>) -> usize {
    let Some(first) = values.first().filter(|first| is_without_power(**first, values, range)) else { return 0 };
    let still = values.iter().take_while(|v| *v == first).count();
    let rest = values.get(still..).unwrap_or_default();
    if still <= MOST_TOGETHER || rest.len() < still.max(LATE_REST) || 2 * changes(rest) < rest.len() {
        return 0;
    }
    // A row may be the mean of samples on both sides of the step.
    let after = (still..=still + 1).find(|from| stand_off(values, 0..still, &[*from, from + 1, from + 2], far_kpa));
    after.unwrap_or(0)
}

/// Number of readings that differ from the one before.
fn changes(values: &[f64]) -> usize {
    values.windows(2).filter(|w| w[0] != w[1]).count()
}

/// Tells whether a sensor gives this without power: nothing, or what stands at or beyond an end of its range.
fn is_without_power(first: f64, values: &[f64], range: Option<[f64; 2]>) -> bool {
    let near = NOTHING * range.map_or_else(|| span(values), |[low, high]| high - low);
    let at_an_end = range.is_some_and(|[low, high]| first <= low + near || first >= high - near);
    at_an_end || first.abs() <= near
}

/// Distance of a wild reading from the middle of the nearest sound ones (kPa), two on either side where there are; `sound` are their rows.
fn off_the_sound(values: &[f64], sound: &[usize], row: usize) -> f64 {
    let at = sound.partition_point(|other| *other < row);
    let around = sound.get(at.saturating_sub(2)..(at + 2).min(sound.len())).unwrap_or_default();
    let around: Vec<f64> = around.iter().filter_map(|other| values.get(*other)).copied().collect();
    if around.is_empty() { 0.0 } else { (values[row] - median(&around)).abs() }
}

/// Tells whether readings are all this far from those around them, which agree with each other.
fn stand_off(values: &[f64], rows: Range<usize>, around: &[usize], far_kpa: f64) -> bool {
    let sound: Vec<f64> = around.iter().filter_map(|row| values.get(*row)).copied().collect();
    let (low, high) = sound.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
    let of = |v: &f64| (low - v).max(v - high);
    values.get(rows).is_some_and(|those| those.iter().all(|v| of(v) > far_kpa && of(v) > APART * (high - low)))
}

/// The size that all but three steps in a hundred from row to row keep below, in kPa: each wild reading makes two.
fn usual_step(values: &[f64]) -> f64 {
    let mut steps: Vec<f64> = values.windows(2).map(|w| (w[1] - w[0]).abs()).collect();
    let at = steps.len() * 97 / 100;
    if steps.is_empty() { 0.0 } else { *steps.select_nth_unstable_by(at, f64::total_cmp).1 }
}

/// The finding on wild readings, `first` of which a recording begins with.
pub(super) fn told(count: usize, of: usize, worst: f64, first: usize) -> (Severity, Trouble, String) {
    let reason = if first > MOST_TOGETHER {
        format!(
            "{first} of them are the first readings, one and the same: power the sensor before the logger is started"
        )
    } else {
        "Look for a loose contact or interference".to_owned()
    };
    // A sensor without power spoils nothing behind it.
    let among = if first > MOST_TOGETHER && first * LATE_PART <= of { count - first } else { count };
    let (severity, done) = consequence(among as f64 / of.max(1) as f64, MOST_LEFT_OUT, &[]);
    let text = format!(
        "{count} wild reading{}, up to {} kPa off the neighbours; {done}. {reason}",
        if count == 1 { "" } else { "s" },
        // A number that is no pressure at all has no digits behind the point worth reading.
        if worst < 1e6 { format!("{worst:.1}") } else { format!("{worst:.0e}") }
    );
    (severity, Trouble::Spikes, text)
}

/// Readings that no sensor of this range gives, where they are few: many are another unit, which other checks tell.
fn outside(values: &[f64], range: Option<[f64; 2]>) -> Vec<bool> {
    let Some([low, high]) = range else { return vec![false; values.len()] };
    let margin = MARGIN * (high - low);
    let is_outside: Vec<bool> = values.iter().map(|v| !(low - margin..=high + margin).contains(v)).collect();
    let few = is_outside.iter().filter(|out| **out).count() as f64 <= MANY * values.len() as f64;
    if few { is_outside } else { vec![false; values.len()] }
}

/// Range that nine of ten readings lie within, in kPa: single wild ones do not widen it.
fn span(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = |share: f64| sorted.get((share * sorted.len() as f64) as usize).copied().unwrap_or(0.0);
    at(0.95) - at(0.05)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A chamber that fills, sampled with a little noise.
    fn filling() -> Vec<f64> {
        (0..200).map(|k| 100.0 * (1.0 - (-0.1 * f64::from(k)).exp()) + 0.05 * f64::from(k * 7919 % 13) / 13.0).collect()
    }

    #[test]
    fn what_no_neighbour_bears_out_is_wild_wherever_it_stands() {
        let range = Some([-100.0, 300.0]);
        assert_eq!(wild(&filling(), 0.05, range, &[]).0, Vec::<usize>::new(), "a pump that starts is no wild reading");
        for at in [0, 1, 2, 77, 197, 198, 199] {
            for reading in [1e6, 260.0, -99.0] {
                let mut values = filling();
                values[at] = reading;
                assert_eq!(wild(&values, 0.05, range, &[]).0, [at], "{reading} at {at}");
            }
        }
        // Three rows of a logger's "no value" have each other for neighbours; so have two zeros, which a sensor may well read.
        let mut values = filling();
        values[50..53].fill(-9999.0);
        values[120..122].fill(0.0);
        assert_eq!(wild(&values, 0.05, range, &[]).0, [50, 51, 52, 120, 121]);
    }

    #[test]
    fn what_a_plant_does_is_not_wild() {
        // A pump that starts in the first row, and a line that rings with six rows a turn.
        let from_rest: Vec<f64> = (0..400).map(|k| 100.0 * (1.0 - (-0.6 * f64::from(k)).exp())).collect();
        let rings = |amplitude: f64| -> Vec<f64> {
            (0..400)
                .map(|k| {
                    let since = f64::from(k % 100);
                    50.0 + f64::from(k / 100 % 2) * 20.0
                        + amplitude * (-since / 15.0).exp() * (since * std::f64::consts::FRAC_PI_3).sin()
                })
                .collect()
        };
        for (what, values) in [("from rest", from_rest), ("ringing", rings(6.0)), ("ringing hard", rings(10.0))] {
            assert_eq!(wild(&values, 0.05, Some([-100.0, 300.0]), &[]).0, Vec::<usize>::new(), "{what}");
        }
    }

    /// A pump that is switched off turns a pressure round within a row; what no pressure does in a row is wild there as well.
    #[test]
    fn a_reading_next_to_a_step_may_turn_round() {
        // Ripple that stands at one phase of the pump's turn ends in a single reading of the mean above it.
        let mut values: Vec<f64> = (0..200).map(|k| 80.0 + 0.1 * f64::from(k)).collect();
        values.extend((0..90).map(|k| 102.2 - 1.1 * f64::from(k)));
        let range = Some([-100.0, 300.0]);
        let at_peak: Vec<bool> = (0..290).map(|row| (199..=205).contains(&row)).collect();
        assert_eq!(wild(&values, 0.05, range, &[]).0, [200], "without its command it is a spike");
        assert_eq!(wild(&values, 0.05, range, &at_peak).0, Vec::<usize>::new());
        for reading in [230.0, 150.0, -9999.0] {
            values[201] = reading;
            assert!(wild(&values, 0.05, range, &at_peak).0.contains(&201), "{reading}");
        }
    }

    /// Their distance is told from sound readings, never from the others of their run.
    #[test]
    fn the_distance_is_to_the_sound_neighbours() {
        for rows in [77..78, 77..79, 77..80, 0..3, 197..200] {
            let mut values = filling();
            let sound = values[rows.start];
            values[rows.clone()].fill(260.0);
            let (found, worst) = wild(&values, 0.05, Some([-100.0, 300.0]), &[]);
            assert_eq!(found, rows.clone().collect::<Vec<_>>());
            assert!((worst - (260.0 - sound)).abs() < 40.0 && worst > 150.0, "{rows:?}: {worst}");
        }
    }

    /// A sensor that is powered late reads zero until then, however long; a chamber at rest that a pump fills does not jump.
    #[test]
    fn readings_before_a_sensor_has_power_are_wild() {
        let scattering = |k: u32| 120.0 + 0.05 * f64::from(k * 7919 % 13);
        for rows in [1, 2, 3, 4, 30, 80] {
            let mut values: Vec<f64> = (0..400).map(scattering).collect();
            values[..rows].fill(0.0);
            assert_eq!(wild(&values, 0.05, Some([-100.0, 300.0]), &[]).0, (0..rows).collect::<Vec<_>>());
        }
        // At an end of its range, but nowhere within it: that is a sensor that stands still.
        for (level, is_wild) in [(-100.0, true), (300.0, true), (60.0, false), (-40.0, false)] {
            let mut values: Vec<f64> = (0..400).map(scattering).collect();
            values[..150].fill(level);
            assert_eq!(!wild(&values, 0.05, Some([-100.0, 300.0]), &[]).0.is_empty(), is_wild, "{level}");
        }
        let mut at_rest = vec![0.0; 30];
        at_rest.extend(filling());
        assert_eq!(wild(&at_rest, 0.05, Some([-100.0, 300.0]), &[]).0, Vec::<usize>::new());
    }
}
