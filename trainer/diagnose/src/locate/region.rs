//! The operating region in which most of a mismatch lives, in words and numbers.

use std::ops::Range;

/// One run of rows: what is missing and the command that may have to do with it.
#[derive(Debug, Clone, Copy)]
pub struct Stretch<'a> {
    /// Energy of the mismatch, row by row (any unit, not negative).
    pub energy: &'a [f64],
    /// The command, row by row.
    pub command: &'a [f64],
    /// Time in s, row by row.
    pub time_s: &'a [f64],
}

/// Which way a command moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Way {
    /// Upwards.
    Rising,
    /// Downwards.
    Falling,
    /// Not at all.
    Still,
}

/// A region of commands.
#[derive(Debug, Clone, PartialEq)]
pub struct Region {
    /// Lower and upper end of the command.
    pub command: [f64; 2],
    /// The way it moves there, where one way holds most of the energy.
    pub way: Option<Way>,
    /// Share of the energy inside.
    pub share: f64,
    /// Share of the rows inside.
    pub rows: f64,
    /// First and last time between which nine tenths of the energy lie, in s.
    pub time_s: [f64; 2],
}

/// Rows over which a command's way is judged: 0.1 s.
const WAY_ROWS: usize = 5;
/// A command that moves less than this over [`WAY_ROWS`] stands still.
const STILL: f64 = 2e-3;
/// Bins over the range of the command.
const BINS: usize = 40;
/// Share of the energy that a region must hold.
const SHARE: f64 = 0.8;

/// The smallest region of the command that holds four fifths of the energy.
pub fn region(stretches: &[Stretch<'_>]) -> Option<Region> {
    let mut low = f64::INFINITY;
    let mut high = f64::NEG_INFINITY;
    for command in stretches.iter().flat_map(|s| s.command) {
        low = low.min(*command);
        high = high.max(*command);
    }
    // Without any command both are infinite.
    if low > high || high - low <= 1e-6 {
        return None;
    }
    let bin = |command: f64| (((command - low) / (high - low) * BINS as f64) as usize).min(BINS - 1);
    let ways = [Way::Rising, Way::Falling, Way::Still];
    let mut energy = [[0.0; BINS]; 3];
    let mut rows = [[0.0; BINS]; 3];
    for stretch in stretches {
        for (row, (e, u)) in stretch.energy.iter().zip(stretch.command).enumerate() {
            let before = stretch.command.get(row.saturating_sub(WAY_ROWS)).copied().unwrap_or(*u);
            let w = match u - before {
                d if d > STILL => 0,
                d if d < -STILL => 1,
                _ => 2,
            };
            energy[w][bin(*u)] += e;
            rows[w][bin(*u)] += 1.0;
        }
    }
    let total: f64 = energy.iter().flatten().sum();
    let all_rows: f64 = rows.iter().flatten().sum();
    if total.is_nan() || total <= 0.0 {
        return None;
    }
    let of_way = |w: usize| (energy[w].iter().sum::<f64>() / total, rows[w].iter().sum::<f64>() / all_rows);
    // A way is named if it holds most of the energy and clearly more than its share of time.
    let way = (0..3).find(|w| {
        let (e, r) = of_way(*w);
        e > 0.65 && e > 1.3 * r
    });
    let merged = |table: &[[f64; BINS]; 3]| -> Vec<f64> {
        (0..BINS).map(|b| way.map_or_else(|| (0..3).map(|w| table[w][b]).sum(), |w| table[w][b])).collect()
    };
    let (energies, counts) = (merged(&energy), merged(&rows));
    let inside = tightest(&energies, SHARE * energies.iter().sum::<f64>());
    let width = (high - low) / BINS as f64;
    Some(Region {
        command: [low + width * inside.start as f64, low + width * inside.end as f64],
        way: way.map(|w| ways[w]),
        share: energies.get(inside.clone()).unwrap_or_default().iter().sum::<f64>() / total,
        rows: counts.get(inside).unwrap_or_default().iter().sum::<f64>() / all_rows,
        time_s: span(stretches, total),
    })
}

/// The shortest run of bins with at least `least` in it.
fn tightest(bins: &[f64], least: f64) -> Range<usize> {
    let mut best = 0..bins.len();
    for start in 0..bins.len() {
        let mut sum = 0.0;
        for (end, e) in bins.iter().enumerate().skip(start) {
            sum += e;
            if sum >= least {
                if end + 1 - start < best.len() {
                    best = start..end + 1;
                }
                break;
            }
        }
    }
    best
}

/// Times between which nine tenths of the energy lie, all stretches over one clock.
fn span(stretches: &[Stretch<'_>], total: f64) -> [f64; 2] {
    let mut rows: Vec<(f64, f64)> =
        stretches.iter().flat_map(|s| s.time_s.iter().copied().zip(s.energy.iter().copied())).collect();
    rows.sort_by(|a, b| a.0.total_cmp(&b.0));
    let at = |share: f64| {
        let mut sum = 0.0;
        rows.iter()
            .find(|(_, e)| {
                sum += e;
                sum >= share * total
            })
            .map_or(0.0, |(t, _)| *t)
    };
    [at(0.05), at(0.95)]
}

impl Region {
    /// In words: `falling u_neg between 0.70 and 0.85`.
    pub fn in_words(&self, command: &str) -> String {
        let way = match self.way {
            Some(Way::Rising) => "rising ",
            Some(Way::Falling) => "falling ",
            Some(Way::Still) => "steady ",
            None => "",
        };
        // Energy spread as the rows are: nowhere in particular.
        if self.way.is_none() && self.rows > 0.7 * self.share {
            return format!("everywhere ({command} {:.2} to {:.2})", self.command[0], self.command[1]);
        }
        format!("{way}{command} between {:.2} and {:.2}", self.command[0], self.command[1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mismatch_on_the_way_down_is_found_there() {
        // A triangle between 0.6 and 1.0; the mismatch is there on the way down between 0.70 and 0.85.
        let command: Vec<f64> = (0..2000)
            .map(|k| {
                let phase = (k % 400) as f64 / 200.0;
                0.6 + 0.4 * if phase < 1.0 { phase } else { 2.0 - phase }
            })
            .collect();
        let energy: Vec<f64> =
            (0..2000).map(|k| if k % 400 > 200 && (0.70..0.85).contains(&command[k]) { 1.0 } else { 0.02 }).collect();
        let time_s: Vec<f64> = (0..2000).map(|k| 0.02 * f64::from(k)).collect();
        let found = region(&[Stretch { energy: &energy, command: &command, time_s: &time_s }]).unwrap();
        assert_eq!(found.way, Some(Way::Falling));
        // A bin is 0.01 wide; four fifths of the energy lie inside, so either end may stop short by a fifth.
        assert!(found.command[0] > 0.68 && found.command[1] < 0.87, "{found:?}");
        assert!(found.in_words("u_neg").starts_with("falling u_neg between 0.7"), "{}", found.in_words("u_neg"));
    }

    #[test]
    fn a_mismatch_everywhere_is_said_to_be_everywhere() {
        let command: Vec<f64> = (0..1000).map(|k| 0.8 + 0.2 * f64::from(k).sin()).collect();
        let energy = vec![1.0; 1000];
        let time_s: Vec<f64> = (0..1000).map(|k| 0.02 * f64::from(k)).collect();
        let found = region(&[Stretch { energy: &energy, command: &command, time_s: &time_s }]).unwrap();
        assert!(found.in_words("u_pos").starts_with("everywhere"), "{}", found.in_words("u_pos"));
        assert!(region(&[Stretch { energy: &energy, command: &vec![0.5; 1000], time_s: &time_s }]).is_none());
    }
}
