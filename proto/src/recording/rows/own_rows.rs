//! Sensors that are each read in rows of their own: at rates of their own, with blank cells or the last number between, beside commands in
//! every row.
//!
//! A reading counts in the row in which it was read, and for its own sensor alone. Between them lie straight lines that are no evidence,
//! none of them across a gap: a run begins where every sensor has been read. The distance of readings that nothing faster can be told
//! from is that of the sensor that is read least often. Where all sensors are read in the same rows these are samples of the whole
//! ([`super::slower`], [`super::repeated::fresh`]).
//!
//! A sensor may have readings in a part of the file alone (it was plugged in later, or came off). Behind its last one the others are
//! evidence without it.

use std::ops::Range;

use super::asynchronous::near_all;
use super::lost_rows::{Missing, left_out_before_readings};
use super::repeated::Held;
use super::resample::{self, Kind, Resampling, median_step};
use super::slower::{self, Slower};
use crate::recording::csv::{Column, ColumnData, rows_alone};

/// Time (s) and readings by which a sensor may begin after the first one, or end before the last, and be read all the time.
const LATE_S: f64 = 1.0;
const LATE_READINGS: f64 = 5.0;
/// Usual distances of readings from which on one is a hole.
const HOLE: f64 = 5.0;

/// Rows in which each of several sensors was read.
#[derive(Debug)]
pub(crate) struct OwnRows {
    /// By sensor its column, and by row whether it was read.
    read: Vec<(String, Vec<bool>)>,
    /// Rows for each reading of the sensor that is read least often, as a mean.
    pub(crate) rows_a_reading: f64,
    /// Remarks on it.
    pub(crate) notes: Vec<String>,
}

/// The readings of one sensor.
struct Sensor<'c> {
    column: &'c str,
    read: Vec<bool>,
    /// Rows from each of its readings to the next, as a mean, and words on them where it is not read in every row.
    rows_a_reading: f64,
    how: Option<String>,
    is_held: bool,
}

impl<'c> Sensor<'c> {
    /// The sensor whose column this is, where samples were taken at `time_s`, usually `step_s` apart.
    fn of(column: &'c str, numbers: &[f64], (time_s, step_s): (&[f64], f64)) -> Self {
        if let Some(held) = Held::of(time_s, numbers).filter(|held| held.rows_a_reading * step_s > resample::SPARSE_S) {
            let how = Some(held.told());
            return Sensor { column, read: held.read, rows_a_reading: held.rows_a_reading, how, is_held: true };
        }
        let read: Vec<bool> = numbers.iter().map(|x| !x.is_nan()).collect();
        let rows = usual_distance(&read).round().max(1.0);
        let how = (rows > 1.5).then(|| format!("a number in one row of {rows:.0}"));
        Sensor { column, read, rows_a_reading: rows, how, is_held: false }
    }

    fn rows(&self) -> Vec<usize> {
        (0..self.read.len()).filter(|row| self.is_read(*row)).collect()
    }

    fn is_read(&self, row: usize) -> bool {
        self.read.get(row).copied().unwrap_or(false)
    }

    /// Words on how often it was read; `None` where that is in every row.
    fn told(&self, step_s: f64) -> Option<String> {
        let apart_ms = in_ms(step_s * self.rows_a_reading);
        self.how.as_ref().map(|how| format!("{} was read every {apart_ms} ms ({how})", self.column))
    }

    /// From the row of its first reading to that of its last.
    fn span(&self) -> Option<Range<usize>> {
        Some(self.read.iter().position(|read| *read)?..self.read.iter().rposition(|read| *read)?)
    }
}

/// Words on each sensor that was read in a part of the time alone in which others were, with this part.
fn parts(sensors: &[Sensor<'_>], time_s: &[f64], step_s: f64) -> Vec<String> {
    let spans = || sensors.iter().filter_map(|sensor| Some((sensor, sensor.span()?)));
    let (Some(first), Some(last)) = (spans().map(|(_, of)| of.start).min(), spans().map(|(_, of)| of.end).max()) else {
        return Vec::new();
    };
    let at = |row: usize| time_s.get(row).copied().unwrap_or(f64::NAN);
    let told = |(sensor, of): (&Sensor<'_>, Range<usize>)| {
        let edge_s = LATE_S.max(LATE_READINGS * sensor.rows_a_reading * step_s);
        let is_part = at(of.start) - at(first) > edge_s || at(last) - at(of.end) > edge_s;
        is_part.then(|| format!("{} from {:.2} to {:.2} s", sensor.column, at(of.start), at(of.end)))
    };
    spans().filter_map(told).collect()
}

/// The usual distance of readings in rows: the mean of those that are no holes.
fn usual_distance(read: &[bool]) -> f64 {
    let rows: Vec<f64> = read.iter().enumerate().filter(|(_, read)| **read).map(|(row, _)| row as f64).collect();
    let Some(median) = median_step(&rows) else { return read.len() as f64 };
    let near = rows.windows(2).map(|w| w[1] - w[0]).filter(|step| *step <= HOLE * median);
    let (count, sum) = near.fold((0.0, 0.0), |(count, sum), step| (count + 1.0, sum + step));
    sum / f64::max(count, 1.0)
}

/// A time in ms, with a tenth where it is no whole number.
pub(crate) fn in_ms(time_s: f64) -> String {
    let ms = 1e3 * time_s;
    if (ms - ms.round()).abs() < 0.05 { format!("{ms:.0}") } else { format!("{ms:.1}") }
}

impl OwnRows {
    /// Brings times and columns to rows in which each sensor has readings of its own, and marks the others in `missing`; with it the rows
    /// that are kept. `None` where all sensors are read in the same rows, or in every row.
    ///
    /// # Errors
    /// The place among the sensors of one that was hardly ever read when the others were.
    pub(crate) fn put(
        file: &str,
        time_s: &mut Vec<f64>,
        columns: &mut [(Column, Kind)],
        missing: &mut Missing,
    ) -> Result<Option<(Self, Vec<usize>)>, usize> {
        let step_s = median_step(time_s).unwrap_or(0.0);
        let numbers = columns.iter().filter(|(_, kind)| *kind == Kind::Reading);
        let numbers: Vec<(&str, &[f64])> = numbers.filter_map(|(c, _)| Some((c.name.as_str(), c.numbers()?))).collect();
        let sensors: Vec<Sensor<'_>> =
            numbers.iter().map(|(name, of)| Sensor::of(name, of, (time_s.as_slice(), step_s))).collect();
        let parts = parts(&sensors, time_s, step_s);
        let together = Slower::of(&numbers.iter().map(|(_, of)| *of).collect::<Vec<_>>()).is_ok();
        if together && parts.is_empty() && sensors.iter().all(|sensor| !sensor.is_held) {
            return Ok(None);
        }
        near_all(time_s, &sensors.iter().map(Sensor::rows).collect::<Vec<_>>())?;
        let slowest = sensors.iter().enumerate().max_by(|(_, a), (_, b)| a.rows_a_reading.total_cmp(&b.rows_a_reading));
        let (at_slowest, rows_a_reading) = slowest.map_or((0, 1.0), |(at, sensor)| (at, sensor.rows_a_reading));
        let last_read: Vec<Option<usize>> = sensors.iter().map(|sensor| sensor.span().map(|of| of.end)).collect();
        // A run in which a sensor was never read begins nowhere, but for one that was read for the last time before it.
        let begin = |run: &Range<usize>| {
            let first = |sensor: &Sensor<'_>| run.clone().find(|row| sensor.is_read(*row)).unwrap_or(run.end);
            let is_over = |last: &Option<usize>| last.is_some_and(|last| last < run.start);
            let counting = sensors.iter().zip(&last_read).filter(|(_, last)| !is_over(last));
            counting.map(|(sensor, _)| first(sensor)).max().unwrap_or(run.start)
        };
        let kept: Vec<usize> = resample::runs_of(time_s).into_iter().flat_map(|run| begin(&run)..run.end).collect();
        if kept.is_empty() {
            return Err(at_slowest);
        }
        let mut notes = Vec::new();
        let told: Vec<String> = sensors.iter().filter_map(|sensor| sensor.told(step_s)).collect();
        if !told.is_empty() {
            notes.push(format!(
                "{file}: {}; only the row of each reading counts as one of its sensor, straight lines lie between, and nothing faster than \
                 {} ms can be told",
                told.join(", "),
                in_ms(step_s * rows_a_reading)
            ));
        }
        if !parts.is_empty() {
            notes.push(format!(
                "{file}: read in a part of the file alone: {}; before the first reading of a sensor no run can begin, and behind its last \
                 one the others count without it",
                parts.join(", ")
            ));
        }
        notes.extend(left_out_before_readings(file, time_s.len() - kept.len()));
        let mut read: Vec<(String, Vec<bool>)> =
            sensors.into_iter().map(|sensor| (sensor.column.to_owned(), sensor.read)).collect();
        for (column, _) in columns.iter_mut() {
            // Before rows go: the first line may begin in one of them.
            if let Some((_, read)) = read.iter().find(|(name, _)| *name == column.name) {
                fill(time_s, column, read);
            }
            column.data = column.data.rows_alone(&kept);
        }
        *time_s = rows_alone(time_s, &kept);
        let marks = missing.columns.iter_mut().chain(&mut read);
        marks.for_each(|(_, of)| *of = rows_alone(of, &kept));
        for (name, read) in &mut read {
            let lost = missing.columns.iter().find(|(column, _)| column == name);
            let lost = lost.map_or(&[][..], |(_, lost)| lost.as_slice());
            read.iter_mut().zip(lost).for_each(|(read, lost)| *read &= !lost);
        }
        Ok(Some((OwnRows { read, rows_a_reading, notes }, kept)))
    }

    /// By row, whether any sensor was read.
    pub(crate) fn any(&self) -> Vec<bool> {
        let rows = self.read.first().map_or(0, |(_, read)| read.len());
        (0..rows).map(|row| self.read.iter().any(|(_, read)| read.get(row) == Some(&true))).collect()
    }

    /// By sensor that was not read in every row its column, and by row of a resampling whether it has no reading there.
    pub(crate) fn missing_of(&self, resampling: &Resampling<'_>) -> Vec<(String, Vec<bool>)> {
        let lacks = |read: &Vec<bool>| resampling.taken_at(read).into_iter().map(|taken| !taken).collect();
        self.read
            .iter()
            .filter(|(_, read)| read.contains(&false))
            .map(|(name, read)| (name.clone(), lacks(read)))
            .collect()
    }
}

/// Puts straight lines between the readings of a sensor, in each run its own.
fn fill(time_s: &[f64], column: &mut Column, read: &[bool]) {
    let ColumnData::Numbers(numbers) = &mut column.data else { return };
    numbers.iter_mut().zip(read).filter(|(_, read)| !**read).for_each(|(x, _)| *x = f64::NAN);
    // Behind a sensor's last reading, and in runs in which it has none, stands the one before.
    let mut before = f64::NAN;
    for run in resample::runs_of(time_s) {
        if let (Some(times), Some(numbers)) = (time_s.get(run.clone()), numbers.get_mut(run)) {
            if numbers.iter().all(|x| x.is_nan()) {
                numbers.fill(before);
            }
            slower::fill(times, numbers);
            before = numbers.last().copied().unwrap_or(before);
        }
    }
}
