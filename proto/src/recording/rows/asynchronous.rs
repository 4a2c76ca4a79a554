//! Topics in one table, each in rows of its own: what a plotting program or a bag of messages writes when every topic has its own
//! stamps.
//!
//! The distance of such rows is that of nothing. Readings count at the times of the sensor that is read least often, where the other
//! sensors were read within a step of it (straight lines between their own readings); commands act from their own rows on, between readings
//! as well. Topics that share their stamps in rows of their own become one row each.

use std::borrow::Cow;
use std::ops::Range;

use super::own_rows::in_ms;
use super::repeated::Held;
use super::resample::{Kind, SPARSE_S, median_step};
use super::slower::{self, blank};
use crate::recording::csv::numbers::says_nothing;
use crate::recording::csv::{Column, ColumnData, rows_alone};
use crate::recording::logger_file::sheet::{Cells, Sheet};

/// Readings that there are at least: fewer tell nothing of a rate.
const LEAST_READINGS: usize = 20;
/// Commands that there are at least: written where they change, there are few.
const LEAST_COMMANDS: usize = 2;
/// Readings one behind the other in which all sensors were read, at least, where that is so in less than half of the file: with fewer a run
/// tells nothing, and they may be chance.
const LEAST_TOGETHER: usize = 100;
/// Usual steps up to which readings are one behind the other.
const STRETCH: f64 = 2.5;
/// One row of so many, of those with a reading or of those with a command, at most has both.
const BOTH: usize = 10;

/// The sheet with the rows of one time put together where each has what the other lacks; `None` where there are none.
pub(crate) fn joined<'a>(sheet: &Sheet<'a>, of_time: &[usize]) -> Option<Sheet<'a>> {
    let text = |at: usize| match sheet.columns.get(at).map(|column| &column.cells) {
        Some(Cells::Text(texts)) => Some(texts),
        _ => None,
    };
    let columns: Vec<&Vec<Cow<'a, str>>> = (0..sheet.columns.len()).filter_map(text).collect();
    let is_at_once = |row: usize| {
        let same = |at: &usize| text(*at).is_some_and(|texts| texts.get(row) == texts.get(row - 1));
        !of_time.is_empty() && of_time.iter().all(same)
    };
    // One sample holds one reading of each topic: a second one is another sample, whatever row it stands in.
    let adds = |sample: Range<usize>, row: usize| {
        let (mut before, mut here) = (false, false);
        for texts in &columns {
            let cell = |row: usize| texts.get(row).map_or("", AsRef::as_ref).trim();
            let other = cell(row);
            match sample.clone().map(cell).find(|one| !says_nothing(one)) {
                Some(_) if says_nothing(other) => before = true,
                Some(one) if one != other => return false,
                None if !says_nothing(other) => here = true,
                _ => {}
            }
        }
        before && here
    };
    let mut added = vec![false; sheet.rows()];
    let mut first = 0;
    for (row, added) in added.iter_mut().enumerate().skip(1) {
        *added = is_at_once(row) && adds(first..row, row);
        if !*added {
            first = row;
        }
    }
    // A few are rows whose times are rounded, and whose blank cells fit by chance.
    if added.iter().filter(|added| **added).count() < LEAST_READINGS {
        return None;
    }
    let mut of = sheet.clone();
    for column in &mut of.columns {
        let Cells::Text(texts) = &mut column.cells else { continue };
        for row in (1..texts.len()).rev().filter(|row| added.get(*row) == Some(&true)) {
            let Some([before, here]) = texts.get_mut(row - 1..=row) else { continue };
            if says_nothing(before) {
                *before = std::mem::take(here);
            }
        }
    }
    let kept: Vec<usize> = (0..sheet.rows()).filter(|row| added.get(*row) == Some(&false)).collect();
    let mut of = of.rows_alone(&kept);
    of.manner.push("rows of one time put together".to_owned());
    Some(of)
}

/// A sheet whose readings and commands stand in rows of their own.
#[derive(Debug)]
pub(crate) struct Apart<'a> {
    /// With commands held between the rows that have them.
    pub(crate) sheet: Sheet<'a>,
    /// Rows with a reading of the first sensor.
    pub(crate) rows_read: Vec<usize>,
}

/// The sheet with commands held between the rows that have them, where these are other rows than those with readings; `None` elsewhere.
/// `columns` are what the rig asks for and their places.
pub(crate) fn apart<'a>(sheet: &Sheet<'a>, columns: &[(Kind, Vec<usize>)]) -> Option<Apart<'a>> {
    type Places<'c> = Vec<&'c (Kind, Vec<usize>)>;
    let (sensors, commands): (Places<'_>, Places<'_>) = columns.iter().partition(|(kind, _)| *kind == Kind::Reading);
    let [sensors, commands]: [Vec<usize>; 2] =
        [sensors, commands].map(|those| those.into_iter().flat_map(|(_, places)| places.iter().copied()).collect());
    let filled = |places: &[usize]| -> Vec<bool> {
        let blank: Vec<Vec<bool>> = places.iter().map(|at| blank(sheet, *at)).collect();
        (0..sheet.rows()).map(|row| blank.iter().any(|blank| blank.get(row) == Some(&false))).collect()
    };
    let (read, written) = (filled(&sensors), filled(&commands));
    let count = |rows: &[bool]| rows.iter().filter(|filled| **filled).count();
    let both = read.iter().zip(&written).filter(|(read, written)| **read && **written).count();
    let [readings, orders] = [count(&read), count(&written)];
    if readings < LEAST_READINGS || orders < LEAST_COMMANDS || BOTH * both > readings.min(orders) {
        return None;
    }
    let mut held = sheet.clone();
    for at in commands {
        let is_blank = blank(sheet, at);
        if let Some(Cells::Text(texts)) = held.columns.get_mut(at).map(|column| &mut column.cells) {
            hold(texts, &is_blank);
        }
    }
    held.manner.push("readings and commands in rows of their own, each at its own times".to_owned());
    let first = blank(sheet, *sensors.first()?);
    let rows_read = (0..sheet.rows()).filter(|row| first.get(*row) == Some(&false)).collect();
    Some(Apart { sheet: held, rows_read })
}

/// Repeats each cell over the blank ones behind it, the first one also before it.
fn hold(texts: &mut [Cow<'_, str>], is_blank: &[bool]) {
    let Some(first) = is_blank.iter().position(|blank| !blank) else { return };
    let mut last = texts.get(first).cloned().unwrap_or_default();
    for (text, blank) in texts.iter_mut().zip(is_blank) {
        if *blank {
            text.clone_from(&last);
        } else {
            last.clone_from(text);
        }
    }
}

/// Takes repeated readings of each sensor out of its own rows, and tells how often it was read.
pub(crate) fn without_repeated(time_s: &[f64], columns: &mut [(Column, Kind)]) -> Vec<String> {
    let mut told = Vec::new();
    for (column, _) in columns.iter_mut().filter(|(_, kind)| *kind == Kind::Reading) {
        let ColumnData::Numbers(numbers) = &mut column.data else { continue };
        let rows = rows_with_a_number(numbers);
        let [times, own] = [rows_alone(time_s, &rows), rows_alone(numbers, &rows)];
        let step_s = median_step(&times).unwrap_or(0.0);
        let is_slow = |held: &Held| held.rows_a_reading * step_s > SPARSE_S;
        let Some(held) = Held::of(&times, &own).filter(is_slow) else { continue };
        for (row, _) in rows.iter().zip(&held.read).filter(|(_, read)| !**read) {
            numbers.get_mut(*row).into_iter().for_each(|x| *x = f64::NAN);
        }
        told.push(format!(
            "{} was read every {} ms ({})",
            column.name,
            in_ms(held.rows_a_reading * step_s),
            held.told()
        ));
    }
    told
}

/// Words on the times from which to which each sensor has readings.
pub(crate) fn spans(time_s: &[f64], columns: &[(Column, Kind)]) -> String {
    let span = |column: &Column| {
        let there: Vec<bool> = column.numbers()?.iter().map(|x| !x.is_nan()).collect();
        let [first, last] = [there.iter().position(|there| *there)?, there.iter().rposition(|there| *there)?];
        Some(format!("{} from {:.2} to {:.2} s", column.name, time_s.get(first)?, time_s.get(last)?))
    };
    let sensors = columns.iter().filter(|(_, kind)| *kind == Kind::Reading);
    sensors.filter_map(|(column, _)| span(column)).collect::<Vec<_>>().join(", ")
}

/// Rows at whose times readings count, with all sensors' columns brought to these rows alone.
///
/// # Errors
/// The place among the sensors of one that was hardly ever read when the others were.
pub(crate) fn readings(time_s: &[f64], columns: &mut [(Column, Kind)]) -> Result<Vec<usize>, usize> {
    let sensors = columns.iter().filter(|(_, kind)| *kind == Kind::Reading);
    let read: Vec<Vec<usize>> = sensors.filter_map(|(column, _)| column.numbers()).map(rows_with_a_number).collect();
    let kept = near_all(time_s, &read)?;
    for (column, _) in columns.iter_mut().filter(|(_, kind)| *kind == Kind::Reading) {
        if let ColumnData::Numbers(numbers) = &mut column.data {
            slower::fill(time_s, numbers);
            *numbers = rows_alone(numbers, &kept);
        }
    }
    Ok(kept)
}

/// Rows of the sensor that is read least often at which all others were read within a usual step of it; `read` are the rows of each.
///
/// # Errors
/// The place among the sensors of that one, where these are less than half of its rows and too few for a run.
pub(crate) fn near_all(time_s: &[f64], read: &[Vec<usize>]) -> Result<Vec<usize>, usize> {
    let Some((slowest, base)) = read.iter().enumerate().min_by_key(|(_, rows)| rows.len()) else {
        return Ok(Vec::new());
    };
    let at = |row: usize| time_s.get(row).copied().unwrap_or(f64::NAN);
    let step_s = median_step(&base.iter().map(|row| at(*row)).collect::<Vec<_>>()).unwrap_or(0.0);
    let is_near = |rows: &[usize], time_s: f64| {
        let behind = rows.partition_point(|row| at(*row) < time_s);
        let off = |place: usize| rows.get(place).map_or(f64::INFINITY, |row| (at(*row) - time_s).abs());
        behind.checked_sub(1).map_or(f64::INFINITY, off).min(off(behind)) <= step_s
    };
    let kept: Vec<usize> = base.iter().copied().filter(|row| read.iter().all(|rows| is_near(rows, at(*row)))).collect();
    // Sensors that are each read in a part of the file have a stretch in common, which is one run.
    let longest = kept.chunk_by(|a, b| at(*b) - at(*a) <= STRETCH * step_s).map(<[usize]>::len).max().unwrap_or(0);
    if 2 * kept.len() < base.len() && longest < LEAST_TOGETHER {
        return Err(slowest);
    }
    Ok(kept)
}

fn rows_with_a_number(numbers: &[f64]) -> Vec<usize> {
    numbers.iter().enumerate().filter(|(_, x)| !x.is_nan()).map(|(row, _)| row).collect()
}
