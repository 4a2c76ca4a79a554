//! Recordings that others wrote: other names, other units, another rate.
//!
//! A rig file may say how ([`RecordingMap`]). Columns are made from those of the file, and rows are brought to
//! [`PERIOD_S`] apart. With `x(t)` a command held from sample to sample, or the straight lines between the samples of
//! something measured, a row at `t` holds
//!
//! ```text
//! command, signal     mean of x over t … t + 20 ms        (what acts in that row, pulses shorter than a row included)
//! reading             x(t); where samples are closer than rows, the mean of x over t ± 10 ms
//! ```
//!
//! The mean over a symmetric span shifts nothing in time and keeps the noise down as all samples together do. Signals of
//! sources are taken as measured, commands of valves and pumps as held. Where samples are missing for longer than twice
//! their usual distance there is a gap, as in any recording.
//!
//! Left out: MCAP files of other programs, and clocks of two machines in one file.

use std::path::Path;

use model::rig::{RecordingMap, Rig, Terms};

use super::csv::{self, Column, ColumnData, CsvError, TIME_COLUMN, Table};
use super::table::{PERIOD_S, Recording, RecordingError};

/// Steps beyond this many usual ones are gaps.
const GAP_STEPS: f64 = 2.5;
/// Samples further apart than this many rows leave rows between them that nobody measured.
const SPARSE_ROWS: f64 = 1.5;
/// Samples closer than this share of a row are averaged.
const DENSE_ROWS: f64 = 0.75;
/// Share by which rows may be off 20 ms without a word.
const USUAL: f64 = 0.02;

impl Recording {
    /// Reads a recording for a rig: MCAP, CSV with the rig's own columns, or CSV as the rig's `[recording]` table says.
    ///
    /// # Errors
    /// As [`Recording::read`]; a column that the table names and the file does not have.
    pub fn read_for(path: &Path, rig: &Rig) -> Result<Self, RecordingError> {
        let Some(map) = &rig.recording else { return Recording::read(path) };
        let file = path.display().to_string();
        let bytes = std::fs::read(path).map_err(|source| RecordingError::Read { file: file.clone(), source })?;
        let named_mcap = path.extension().is_some_and(|end| end.eq_ignore_ascii_case("mcap"));
        if bytes.starts_with(mcap::MAGIC) || named_mcap {
            return Recording::read(path);
        }
        Self::parse_csv_for(&file, &bytes, rig, map)
    }

    /// Parses the bytes of a CSV file as a rig's map says; a file that has the rig's own columns is taken as it is.
    ///
    /// # Errors
    /// As [`Recording::read_for`].
    pub fn parse_csv_for(file: &str, bytes: &[u8], rig: &Rig, map: &RecordingMap) -> Result<Self, RecordingError> {
        let names = csv::names(file, bytes)?;
        let has = |name: &str| names.iter().any(|known| known == name);
        if has(TIME_COLUMN) && map.columns.keys().all(|name| has(name)) {
            return Self::parse_csv(file, bytes);
        }
        let first = map.time.0.first().map_or(TIME_COLUMN, |term| term.from.as_str());
        let table = Table::parse_by(file, bytes, &[], first)?;
        let time_s = made(file, &table, &map.time)?;
        forward(file, &table, &time_s)?;
        let signals = rig.signals();
        let readings: Vec<&str> = rig.sensors.values().map(|sensor| sensor.column.as_str()).collect();
        let clock = Clock::new(&time_s);
        let mut columns = Vec::new();
        for name in rig.columns() {
            let given = match map.columns.get(&name) {
                Some(terms) => made(file, &table, terms)?,
                // Inputs with a default, and what the file has under the rig's own name.
                None => match table.numbers(&name) {
                    Some(numbers) => numbers.to_vec(),
                    None => continue,
                },
            };
            let kind = if readings.contains(&name.as_str()) {
                Kind::Reading
            } else if signals.contains(&name) {
                Kind::Signal
            } else {
                Kind::Command
            };
            columns.push(Column { name, data: ColumnData::Numbers(clock.rows_of(&given, kind)) });
        }
        let rows = clock.rows.clone();
        Ok(Recording::new(file, rows, columns)?.with_notes(clock.notes(file)))
    }
}

/// What a column is, which says how its rows are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Command,
    Signal,
    Reading,
}

/// Samples and the rows they are brought to.
struct Clock<'t> {
    time_s: &'t [f64],
    /// Usual distance of samples in s.
    step_s: f64,
    /// Times of the rows.
    rows: Vec<f64>,
}

impl<'t> Clock<'t> {
    fn new(time_s: &'t [f64]) -> Self {
        let mut steps: Vec<f64> = time_s.windows(2).map(|w| w[1] - w[0]).collect();
        let middle = steps.len() / 2;
        let step_s = if steps.is_empty() { PERIOD_S } else { *steps.select_nth_unstable_by(middle, f64::total_cmp).1 };
        let (first, last) = (time_s.first().copied().unwrap_or(0.0), time_s.last().copied().unwrap_or(0.0));
        let longest = (GAP_STEPS * step_s).max(GAP_STEPS * PERIOD_S);
        let count = ((last - first) / PERIOD_S + 1e-6).floor() as usize + 1;
        let within = |t: f64| {
            let after = time_s.partition_point(|sample| *sample < t - 1e-9);
            match (after.checked_sub(1).and_then(|before| time_s.get(before)), time_s.get(after)) {
                (Some(before), Some(after)) => after - before <= longest || *after - t < 1e-9,
                _ => true,
            }
        };
        // Never so many that a broken clock fills the memory: rows exist only near samples.
        let rows = if count > 1000 * time_s.len().max(1) {
            Vec::new()
        } else {
            (0..count).map(|k| first + PERIOD_S * k as f64).filter(|t| within(*t)).collect()
        };
        Clock { time_s, step_s, rows }
    }

    fn rows_of(&self, x: &[f64], kind: Kind) -> Vec<f64> {
        let held = kind == Kind::Command;
        let sums = self.integral(x, held);
        let mean = |from: f64, to: f64| {
            (self.integral_to(x, &sums, held, to) - self.integral_to(x, &sums, held, from)) / (to - from)
        };
        let half = 0.5 * PERIOD_S;
        self.rows
            .iter()
            .map(|t| match kind {
                Kind::Command | Kind::Signal => mean(*t, t + PERIOD_S),
                Kind::Reading if self.step_s < DENSE_ROWS * PERIOD_S => mean(t - half, t + half),
                Kind::Reading => self.at(x, *t),
            })
            .collect()
    }

    /// Integral of a column from the first sample to each.
    fn integral(&self, x: &[f64], held: bool) -> Vec<f64> {
        let mut sum = 0.0;
        let mut sums = vec![0.0];
        for (time, value) in self.time_s.windows(2).zip(x.windows(2)) {
            let height = if held { value[0] } else { 0.5 * (value[0] + value[1]) };
            sum += height * (time[1] - time[0]);
            sums.push(sum);
        }
        sums
    }

    /// Integral from the first sample to `t`; before the first and after the last sample the column stays as it is there.
    fn integral_to(&self, x: &[f64], sums: &[f64], held: bool, t: f64) -> f64 {
        let before = self.time_s.partition_point(|sample| *sample <= t);
        let Some(i) = before.checked_sub(1) else {
            let (first, value) = (self.time_s.first().copied().unwrap_or(t), x.first().copied().unwrap_or(0.0));
            return (t - first) * value;
        };
        let at = |numbers: &[f64], k: usize| numbers.get(k).copied().unwrap_or(0.0);
        let since = t - at(self.time_s, i);
        let height = if held { at(x, i) } else { 0.5 * (at(x, i) + self.at(x, t)) };
        at(sums, i) + height * since
    }

    /// The straight line between samples at `t`.
    fn at(&self, x: &[f64], t: f64) -> f64 {
        let after = self.time_s.partition_point(|sample| *sample <= t);
        let sample = |k: usize| Some((*self.time_s.get(k)?, *x.get(k)?));
        match (after.checked_sub(1).and_then(sample), sample(after)) {
            (Some((t0, x0)), Some((t1, x1))) => x0 + (x1 - x0) * (t - t0) / (t1 - t0),
            (Some((_, x)), None) | (None, Some((_, x))) => x,
            (None, None) => f64::NAN,
        }
    }

    fn notes(&self, file: &str) -> Vec<String> {
        let ms = 1e3 * self.step_s;
        let rows = self.step_s / PERIOD_S;
        if (rows - 1.0).abs() < USUAL {
            return Vec::new();
        }
        let mut note = format!("{file}: samples {ms:.1} ms apart, brought to rows of 20 ms");
        if rows > SPARSE_ROWS {
            note.push_str("; what lies between samples was not measured, so nothing faster than they are can be told");
        }
        vec![note]
    }
}

/// A column made from columns of the file.
fn made(file: &str, table: &Table, terms: &Terms) -> Result<Vec<f64>, RecordingError> {
    let mut sum = vec![0.0; table.time_s.len()];
    for term in &terms.0 {
        let numbers = if table.time == term.from { Some(table.time_s.as_slice()) } else { table.numbers(&term.from) };
        let Some(numbers) = numbers else {
            if table.columns.iter().any(|column| column.name == term.from) {
                return Err(RecordingError::TextColumn { file: file.to_owned(), column: term.from.clone() });
            }
            let others = table.columns.iter().map(|column| column.name.as_str());
            return Err(CsvError::MissingColumn {
                file: file.to_owned(),
                line: Some(1),
                column: term.from.clone(),
                found: csv::listed(std::iter::once(table.time.as_str()).chain(others)),
            }
            .into());
        };
        for (slot, x) in sum.iter_mut().zip(numbers) {
            *slot += term.of(*x);
        }
    }
    Ok(sum)
}

fn forward(file: &str, table: &Table, time_s: &[f64]) -> Result<(), CsvError> {
    let steps = time_s.windows(2).zip(table.lines.iter().skip(1));
    for (pair, line) in steps {
        if pair[1] <= pair[0] {
            return Err(CsvError::TimeNotForward {
                file: file.to_owned(),
                line: *line,
                position: table.time_position,
                value: pair[1],
                previous: pair[0],
            });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const RIG: &str = r#"
format = 1
name = "line"
[gas]
gas_constant_j_per_kg_k = 287.0
heat_capacity_ratio = 1.4
[atmosphere]
pressure_kpa_abs = 101.325
temperature_k = 293.15
[volumes.line]
volume_l = 0.1
temperature_k = 293.15
[pumps.pump]
kind = "flow"
outlet = "line"
command = "u"
flow_l_per_min = 2.0
[sources.meter]
kind = "flow"
to = "line"
flow_l_per_min = 1.0
signal = "q"
[sensors.sensor]
volume = "line"
column = "p_kpa"
range_kpa_gauge = [0.0, 100.0]
range_v = [0.0, 5.0]
[recording]
time = { from = "ms", scale = 1e-3 }
columns.u = { from = "PWM", scale = 0.01 }
columns.q = { from = "q_in", scale = 2.0 }
columns.p_kpa = { from = "P", offset = 1.0 }
"#;

    fn read(text: &str) -> Result<Recording, RecordingError> {
        let rig = Rig::from_toml(RIG).unwrap();
        Recording::parse_csv_for("x.csv", text.as_bytes(), &rig, rig.recording.as_ref().unwrap())
    }

    /// A parabola in time sampled every 7 ms: means and instants are those of calculus, up to what straight lines
    /// between samples leave out (h²/8 · x'' = 6e-6 of x'' = 1).
    #[test]
    fn dense_samples_become_rows_by_their_means() {
        let mut text = String::from("ms,PWM,q_in,P\n");
        for k in 0..300 {
            let t = 7e-3 * f64::from(k);
            let parabola = 0.5 * t * t;
            text.push_str(&format!("{},{},{parabola},{parabola}\n", 7 * k, if k < 100 { 0 } else { 100 }));
        }
        let recording = read(&text).unwrap();
        let [u, q, p] = recording.require(["u", "q", "p_kpa"]).unwrap();
        assert_eq!(recording.rows(), 105);
        assert!(recording.notes()[0].contains("7.0 ms"), "{:?}", recording.notes());
        for (row, t) in recording.time_s().iter().enumerate().take(100).skip(1) {
            let (a, b) = (*t, t + 0.02);
            assert!((q[row] / 2.0 - (b.powi(3) - a.powi(3)) / 0.12).abs() < 1e-5, "{row}");
            assert!((p[row] - 1.0 - (0.5 * t * t + 0.01_f64.powi(2) / 6.0)).abs() < 1e-5, "{row}");
            // The command steps at 0.7 s; the row that holds the step has its share of it.
            let share = ((b - 0.7) / 0.02).clamp(0.0, 1.0);
            assert!((u[row] - share).abs() < 1e-9, "{row}");
        }
    }

    #[test]
    fn sparse_jittering_samples_are_joined_by_lines_and_gaps_stay_gaps() {
        let times: Vec<f64> = (0..50)
            .map(|k| 20.0 * f64::from(k) + if k % 2 == 0 { 0.0 } else { 0.3 } + if k > 30 { 200.0 } else { 0.0 })
            .collect();
        let text: String = times.iter().map(|t| format!("{t},50,0,{}\n", 0.25 * t)).collect();
        let recording = read(&format!("ms,PWM,q_in,P\n{text}")).unwrap();
        assert_eq!(recording.segments().len(), 2);
        assert_eq!(recording.notes().len(), 0, "20.3 and 19.7 ms are near enough");
        let [p] = recording.require(["p_kpa"]).unwrap();
        for (t, p) in recording.time_s().iter().zip(p) {
            assert!((p - 1.0 - 250.0 * t).abs() < 1e-9);
        }
    }

    #[test]
    fn own_columns_are_taken_as_they_are_and_missing_ones_named() {
        let own = "time_s,u,q,p_kpa\n0,0.1,3,5\n0.02,0.1,3,5\n0.04,0.1,3,5\n";
        assert_eq!(read(own).unwrap().column("p_kpa").unwrap(), [5.0; 3]);
        let said = read("ms,PWM,P\n0,1,1\n20,1,1\n").unwrap_err().to_string();
        assert!(said.contains("q_in") && said.contains("ms,PWM,P"), "{said}");
        let said = read("s,PWM,q_in,P\n0,1,1,1\n").unwrap_err().to_string();
        assert!(said.contains("column ms is missing"), "{said}");
        let said = read("ms,PWM,q_in,P\n0,1,1,1\n0,1,1,1\n").unwrap_err().to_string();
        assert!(said.contains("line 3"), "{said}");
        let said = read("ms,PWM,q_in,P\n0,on,1,1\n20,on,1,1\n").unwrap_err().to_string();
        assert!(said.contains("PWM") && said.contains("text"), "{said}");
    }
}
