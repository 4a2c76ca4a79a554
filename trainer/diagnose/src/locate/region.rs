//! The operating region in which most of a mismatch lives, in words and numbers.
//!
//! A mismatch may follow a command (and the way it moves), a pressure, the time since a command changed, or the time since the
//! recording began. Each of these axes is cut into bins; the tightest run of bins that holds four fifths of the mismatch's
//! energy is its region, and the axis is taken on which that region has least of the rows:
//!
//! ```text
//! lift = share of the energy inside / share of the rows inside
//! ```
//!
//! Where that is nowhere, a wide region counts that leaves hardly any energy outside, by the odds of energy and rows to be inside:
//! a command that spends two thirds of its time where nearly all of the energy lies. Where there is none either, half of the energy
//! counts.

use std::ops::Range;

/// One run of rows: what is missing, and when.
#[derive(Debug, Clone, Copy)]
pub struct Stretch<'a> {
    /// Energy of the mismatch, row by row (any unit, not negative).
    pub energy: &'a [f64],
    /// Time in s, row by row.
    pub time_s: &'a [f64],
}

/// Kind of quantity that a mismatch may follow.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AxisKind {
    /// A command, and the way it moves.
    Command,
    /// A recorded pressure in kPa gauge.
    Pressure,
    /// Time in s since a command changed.
    SinceChange,
    /// Time in s since the recording began.
    SinceStart,
}

/// A quantity that a mismatch may follow, row by row of each stretch.
#[derive(Debug, Clone)]
pub struct Axis {
    /// Kind of the quantity.
    pub kind: AxisKind,
    /// Column of the quantity; empty for a time.
    pub name: String,
    /// `[stretches × rows]`, in the unit of its kind.
    pub values: Vec<Vec<f64>>,
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

/// A region of an axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Region {
    /// Kind of the axis.
    pub kind: AxisKind,
    /// Column of the axis; empty for a time.
    pub name: String,
    /// Lower and upper end on the axis.
    pub within: [f64; 2],
    /// The way a command moves there, where one way holds most of the energy.
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
/// Bins over the range of an axis.
const BINS: usize = 40;
/// Share of the energy that a region must hold; or else nearly all of it; or else half of it.
const SHARES: [f64; 3] = [0.8, 0.95, 0.5];
/// Lift from which on a region is one: less is how energies of a minute scatter (chosen).
const LIFT: f64 = 1.4;
/// Odds of the energy to be inside over those of the rows, from which on a region is one, however wide (chosen).
const ODDS: f64 = 4.0;
/// By how much another axis must stand out more than the first, the component's own command.
const OTHER_AXIS: f64 = 1.2;

/// The region that tells most, among the axes; the first axis's where none tells anything ([`Region::is_everywhere`]).
pub fn most_telling(stretches: &[Stretch<'_>], axes: &[Axis]) -> Option<Region> {
    for share in SHARES {
        let found = axes.iter().enumerate().filter_map(|(at, axis)| {
            let region = region(stretches, axis, share)?;
            Some((region.lift() / if at == 0 { 1.0 } else { OTHER_AXIS }, region))
        });
        let best = found.filter(|(_, region)| !region.is_everywhere()).max_by(|a, b| a.0.total_cmp(&b.0));
        if let Some((_, region)) = best {
            return Some(region);
        }
    }
    axes.iter().find_map(|axis| region(stretches, axis, SHARES[0]))
}

/// The smallest region of an axis that holds a share of the energy.
pub fn region(stretches: &[Stretch<'_>], axis: &Axis, share: f64) -> Option<Region> {
    let mut low = f64::INFINITY;
    let mut high = f64::NEG_INFINITY;
    for value in axis.values.iter().flatten() {
        low = low.min(*value);
        high = high.max(*value);
    }
    // Without any value both are infinite.
    if low > high || high - low <= 1e-6 {
        return None;
    }
    let Table { energy, rows } = table(stretches, axis, [low, high]);
    let total: f64 = energy.iter().flatten().sum();
    let all_rows: f64 = rows.iter().flatten().sum();
    if total.is_nan() || total <= 0.0 {
        return None;
    }
    let of_way = |w: usize| (energy[w].iter().sum::<f64>() / total, rows[w].iter().sum::<f64>() / all_rows);
    // A way is named if it holds most of the energy and clearly more than its share of time.
    let way = (0..3).find(|w| {
        let (e, r) = of_way(*w);
        axis.kind == AxisKind::Command && e > 0.65 && e > 1.3 * r
    });
    let merged = |table: &[[f64; BINS]; 3]| -> Vec<f64> {
        (0..BINS).map(|b| way.map_or_else(|| (0..3).map(|w| table[w][b]).sum(), |w| table[w][b])).collect()
    };
    let (energies, counts) = (merged(&energy), merged(&rows));
    let inside = tightest(&energies, share * energies.iter().sum::<f64>());
    let width = (high - low) / BINS as f64;
    Some(Region {
        kind: axis.kind,
        name: axis.name.clone(),
        within: [low + width * inside.start as f64, low + width * inside.end as f64],
        way: way.map(|w| [Way::Rising, Way::Falling, Way::Still][w]),
        share: energies.get(inside.clone()).unwrap_or_default().iter().sum::<f64>() / total,
        rows: counts.get(inside).unwrap_or_default().iter().sum::<f64>() / all_rows,
        time_s: span(stretches, total),
    })
}

/// Energy and rows by way (rising, falling, still) and bin.
struct Table {
    energy: [[f64; BINS]; 3],
    rows: [[f64; BINS]; 3],
}

fn table(stretches: &[Stretch<'_>], axis: &Axis, [low, high]: [f64; 2]) -> Table {
    let bin = |value: f64| (((value - low) / (high - low) * BINS as f64) as usize).min(BINS - 1);
    let mut table = Table { energy: [[0.0; BINS]; 3], rows: [[0.0; BINS]; 3] };
    for (stretch, values) in stretches.iter().zip(&axis.values) {
        for (row, (e, value)) in stretch.energy.iter().zip(values).enumerate() {
            let before = values.get(row.saturating_sub(WAY_ROWS)).copied().unwrap_or(*value);
            let w = match value - before {
                d if d > STILL => 0,
                d if d < -STILL => 1,
                _ => 2,
            };
            table.energy[w][bin(*value)] += e;
            table.rows[w][bin(*value)] += 1.0;
        }
    }
    table
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
    /// Ratio of the share of the energy inside to the share of the rows.
    pub fn lift(&self) -> f64 {
        self.share / self.rows.max(1e-9)
    }

    /// Tells whether the energy is spread as the rows are: nowhere in particular.
    pub fn is_everywhere(&self) -> bool {
        self.way.is_none() && self.lift() < LIFT && self.odds() < ODDS
    }

    /// Ratio of the odds of the energy to be inside to those of a row.
    fn odds(&self) -> f64 {
        let odds = |share: f64| share / (1.0 - share).max(1e-9);
        odds(self.share) / odds(self.rows).max(1e-9)
    }

    /// In words: `falling u_neg between 0.70 and 0.85`.
    pub fn in_words(&self) -> String {
        let ([from, to], name) = (self.within, &self.name);
        if self.is_everywhere() {
            return format!("everywhere alike ({name} {from:.2} to {to:.2})");
        }
        let way = match self.way {
            Some(Way::Rising) => "rising ",
            Some(Way::Falling) => "falling ",
            Some(Way::Still) => "steady ",
            None => "",
        };
        match self.kind {
            AxisKind::Command => format!("{way}{name} between {from:.2} and {to:.2}"),
            AxisKind::Pressure => format!("{name} between {from:.1} and {to:.1} kPa"),
            AxisKind::SinceChange if from < 0.1 => format!("within {to:.1} s of a change of a command"),
            AxisKind::SinceChange => format!("from {from:.1} to {to:.1} s after a change of a command"),
            AxisKind::SinceStart if from < 1.0 => format!("the first {to:.0} s of a recording"),
            AxisKind::SinceStart => format!("between {from:.0} and {to:.0} s of a recording"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn on(name: &str, values: &[f64]) -> Axis {
        Axis { kind: AxisKind::Command, name: name.to_owned(), values: vec![values.to_vec()] }
    }

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
        let found = region(&[Stretch { energy: &energy, time_s: &time_s }], &on("u_neg", &command), SHARES[0]).unwrap();
        assert_eq!(found.way, Some(Way::Falling));
        // A bin is 0.01 wide; four fifths of the energy lie inside, so either end may stop short by a fifth.
        assert!(found.within[0] > 0.68 && found.within[1] < 0.87, "{found:?}");
        assert!(found.in_words().starts_with("falling u_neg between 0.7"), "{}", found.in_words());
    }

    #[test]
    fn a_mismatch_everywhere_is_said_to_be_everywhere() {
        let command: Vec<f64> = (0..1000).map(|k| 0.8 + 0.2 * f64::from(k).sin()).collect();
        let energy = vec![1.0; 1000];
        let time_s: Vec<f64> = (0..1000).map(|k| 0.02 * f64::from(k)).collect();
        let stretch = [Stretch { energy: &energy, time_s: &time_s }];
        let found = most_telling(&stretch, &[on("u_pos", &command)]).unwrap();
        assert!(found.in_words().starts_with("everywhere"), "{}", found.in_words());
        assert!(region(&stretch, &on("u_pos", &[0.5; 1000]), SHARES[0]).is_none());
    }

    /// A valve that spends most of its time nearly open, where all of the mismatch lies.
    #[test]
    fn a_wide_region_that_leaves_nothing_outside_is_one() {
        let command: Vec<f64> =
            (0..4000).map(|k| 1.0 - 0.4 * (0.5 + 0.5 * (0.03 * f64::from(k)).sin()).powi(4)).collect();
        let energy: Vec<f64> = command.iter().map(|u| if *u > 0.9 { 1.0 } else { 0.02 }).collect();
        let rows = energy.iter().filter(|e| **e == 1.0).count();
        assert!((0.6..0.8).contains(&(rows as f64 / 4000.0)), "{rows}");
        let time_s: Vec<f64> = (0..4000).map(|k| 0.02 * f64::from(k)).collect();
        let found = most_telling(&[Stretch { energy: &energy, time_s: &time_s }], &[on("u_pos", &command)]).unwrap();
        assert!(!found.is_everywhere() && found.within[0] > 0.88, "{found:?}");
    }

    /// A mismatch at high pressures only, whatever the command: the pressure is the axis that tells.
    #[test]
    fn the_axis_is_taken_on_which_a_mismatch_is_narrowest() {
        let command: Vec<f64> = (0..3000).map(|k| 0.8 + 0.2 * (0.37 * f64::from(k)).sin()).collect();
        let pressure: Vec<f64> = (0..3000).map(|k| 60.0 + 40.0 * (0.011 * f64::from(k)).sin()).collect();
        let energy: Vec<f64> = pressure.iter().map(|kpa| if *kpa > 90.0 { 1.0 } else { 0.01 }).collect();
        let time_s: Vec<f64> = (0..3000).map(|k| 0.02 * f64::from(k)).collect();
        let by_pressure =
            Axis { kind: AxisKind::Pressure, name: "p_pos_kpa".to_owned(), values: vec![pressure.clone()] };
        let stretch = [Stretch { energy: &energy, time_s: &time_s }];
        let found = most_telling(&stretch, &[on("u_pos", &command), by_pressure]).unwrap();
        assert_eq!(found.kind, AxisKind::Pressure);
        // A bin is 2 kPa wide.
        assert!(found.within[0] > 86.0 && found.in_words().contains("kPa"), "{found:?}");
    }
}
