//! Every field of every tick as CSV: for tools that read neither MCAP nor Protocol Buffers.
//!
//! A row for each tick in the order of the file, a column for each number, under the names of the schema; arrays have
//! their index behind their name, from 1. A number that is none is an empty cell, a yes or no is 1 or 0. The table's
//! first column, `time_s`, counts 20 ms a tick within a session and goes on with the daemon's clock between sessions.

use super::schema;
use super::tick::{Arrival, TickRecord};

/// The table, header included.
pub fn tick_table(ticks: &[TickRecord]) -> String {
    let mut out = format!("time_s,{}\n", schema::column_names().join(","));
    let mut clock = Clock::default();
    let mut cells = Vec::new();
    for tick in ticks {
        cells.clear();
        cells.push(format!("{}", clock.time_s(tick)));
        schema::cells(tick, &mut cells);
        out.push_str(&cells.join(","));
        out.push('\n');
    }
    out
}

/// Seconds since the first tick.
#[derive(Default)]
struct Clock {
    before: Option<(u32, u32, u64)>,
    ticks: u64,
}

impl Clock {
    fn time_s(&mut self, tick: &TickRecord) -> f64 {
        self.ticks += match self.before {
            None => 0,
            Some((session, before, _)) if session == tick.session => u64::from(tick.tick.saturating_sub(before)),
            Some((.., receive_ns)) => (tick.receive_ns.saturating_sub(receive_ns) / 20_000_000).max(1),
        };
        self.before = Some((tick.session, tick.tick, tick.receive_ns));
        self.ticks as f64 / 50.0
    }
}

/// A field as one or more cells.
pub(crate) trait Cells {
    /// Number of cells, for an array.
    const COUNT: Option<usize> = None;

    /// Appends the cells.
    fn cells(&self, out: &mut Vec<String>);
}

macro_rules! numbers {
    ($($rust:ty),*) => { $(
        impl Cells for $rust {
            fn cells(&self, out: &mut Vec<String>) {
                out.push(self.to_string());
            }
        }
    )* };
}
numbers!(u8, u16, u32, u64, i64);

macro_rules! floats {
    ($($rust:ty),*) => { $(
        impl Cells for $rust {
            fn cells(&self, out: &mut Vec<String>) {
                // The shortest text that reads back as the same number.
                out.push(if self.is_finite() { format!("{self:?}") } else { String::new() });
            }
        }
    )* };
}
floats!(f32, f64);

impl Cells for bool {
    fn cells(&self, out: &mut Vec<String>) {
        out.push(u8::from(*self).to_string());
    }
}

impl Cells for Arrival {
    fn cells(&self, out: &mut Vec<String>) {
        out.push(self.code().to_string());
    }
}

impl<T: Cells, const N: usize> Cells for [T; N] {
    const COUNT: Option<usize> = Some(N);

    fn cells(&self, out: &mut Vec<String>) {
        self.iter().for_each(|value| value.cells(out));
    }
}

/// The columns of a field: its name, or for an array its name with 1, 2 … behind.
pub(crate) fn names_of<T: Cells>(name: &str, _: &T) -> Vec<String> {
    match T::COUNT {
        None => vec![name.to_owned()],
        Some(count) => (1..=count).map(|index| format!("{name}_{index}")).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_has_every_column_and_numbers_that_are_none_are_empty() {
        let first = TickRecord {
            session: 3,
            tick: 10,
            p_pos_kpa: 90.125,
            volts: [1.5, -0.5, f32::NAN, 2.0],
            ..TickRecord::default()
        };
        let second = TickRecord { tick: 12, pump_on: true, ..first };
        let later = TickRecord { session: 4, tick: 0, receive_ns: 1_000_000_000, ..first };
        let table = tick_table(&[first, second, later]);
        let rows: Vec<Vec<&str>> = table.lines().map(|line| line.split(',').collect()).collect();
        let at = |name: &str| rows[0].iter().position(|column| *column == name).unwrap();
        assert!(rows.iter().all(|row| row.len() == rows[0].len()), "{table}");
        assert_eq!([1, 2, 3].map(|row| rows[row][0]), ["0", "0.04", "1.04"]);
        assert_eq!((rows[1][at("p_pos_kpa")], rows[1][at("p_neg_kpa")]), ("90.125", ""));
        assert_eq!([1, 2, 3, 4].map(|n| rows[1][at(&format!("volts_{n}"))]), ["1.5", "-0.5", "", "2.0"]);
        assert_eq!([rows[1][at("pump_on")], rows[2][at("pump_on")]], ["0", "1"]);
    }
}
