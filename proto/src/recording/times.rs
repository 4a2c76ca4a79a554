//! Times of a file's rows: which column they stand in, and in what unit.
//!
//! Looked for in this order: what `[recording] time` names; `time_s`; a column that is called a time; the only column of dates; a
//! column of dates beside one of times of day. Units are those that the map, the file or the name say. Numbers too large for a
//! recording's seconds are epochs, in the unit in which they lie between 2001 and 2286. Where nobody says a unit, steps that only
//! another one explains are refused with the key that says it, and never taken for a slow logger's.

mod bursts;
mod clock_set;
mod counter_wrap;
mod forward;
mod in_digits;
mod month_names;
mod other_marks;
pub(crate) mod second_parts;
mod seconds;
pub(crate) mod time_notes;
pub(crate) mod timestamps;
mod unlikely_times;

use std::borrow::Cow;

use model::rig::{RecordingMap, Term};

use self::bursts::{Bursts, bursts};
use self::clock_set::{ClockSet, clock_set};
use self::forward::forward;
use self::in_digits::is_without_marks;
use self::second_parts::Finer;
use self::seconds::{EPOCH_S, Said, said, seconds, unit_behind};
use self::unlikely_times::plausible;
use crate::recording::columns::Naming;
use crate::recording::csv::{CsvError, TIME_COLUMN, rows_alone, toml_text};
use crate::recording::logger_file::sheet::{Cells, Sheet, field};
use crate::recording::recording_error::RecordingError;

/// Names that columns of times go by, in the order in which they are preferred, and the s per number that the name says.
const NAMES: [(&str, Option<f64>); 26] = [
    ("time", None),
    ("t", None),
    ("timestamp", None),
    ("time stamp", None),
    ("datetime", None),
    ("date_time", None),
    ("date time", None),
    ("date/time", None),
    ("_time", None),
    ("__time", None),
    ("x_value", None),
    ("elapsed", None),
    ("elapsed time", None),
    ("elapsed_time", None),
    ("zeit", None),
    ("t_s", Some(1.0)),
    ("seconds", Some(1.0)),
    ("time_ms", Some(1e-3)),
    ("t_ms", Some(1e-3)),
    ("timestamp_ms", Some(1e-3)),
    ("millis", Some(1e-3)),
    ("ms", Some(1e-3)),
    ("time_us", Some(1e-6)),
    ("micros", Some(1e-6)),
    ("t_min", Some(60.0)),
    ("time_min", Some(60.0)),
];
/// Names of times in other languages, of which some mean something else in English (`temps`): asked for last.
const NAMES_ELSEWHERE: [&str; 4] = ["temps", "tiempo", "tempo", "tijd"];
/// Marks between the name of a time and its unit: `elapsed_ms`, `time-min`.
const UNIT_MARKS: [char; 3] = ['_', '-', ' '];

/// Length of a break that stands for a hole in which the clock was set (s): longer than any that is bridged.
const BREAK_S: f64 = 60.0;

/// Times and where they come from.
#[derive(Debug)]
pub(super) struct Times {
    /// By row (s).
    pub(super) time_s: Vec<f64>,
    /// Places of their columns.
    pub(super) columns: Vec<usize>,
    /// Columns and units that were taken for the time, in words, where it was not `time_s` in seconds.
    pub(super) taken: Vec<String>,
}

/// The kind of rows that times stand in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stamps<'r> {
    /// Rows that are samples of all channels.
    OfRows,
    /// Topics in rows of their own, which may come close behind one another and be no bursts. The rows of one sensor are at a distance
    /// that tells something.
    OfTopics(&'r [usize]),
}

impl Stamps<'_> {
    /// Times of the rows whose distance tells something, of the times of all rows.
    fn telling(self, time_s: &[f64]) -> Cow<'_, [f64]> {
        match self {
            Stamps::OfRows => Cow::Borrowed(time_s),
            Stamps::OfTopics(rows) => Cow::Owned(rows_alone(time_s, rows)),
        }
    }

    /// The bursts that times come in, of rows that are samples.
    fn bursts(self, time_s: &[f64]) -> Option<Bursts> {
        bursts(time_s).filter(|_| self == Stamps::OfRows)
    }
}

/// The times of a sheet's rows, or those of rows at the distance that the map says where the file's tell rows not apart.
///
/// # Errors
/// No column of times, a cell that is no time, times that do not go forward, steps of another unit.
pub(super) fn times(
    sheet: &Sheet<'_>,
    map: &RecordingMap,
    naming: Naming,
    stamps: Stamps<'_>,
) -> Result<Times, RecordingError> {
    let times = match mapped(sheet, map, naming)? {
        Some(places) => or_every(sheet, map, of_terms(sheet, map, &places, stamps), stamps)?,
        None => match place(sheet, map)? {
            Found::Columns(places) => or_every(sheet, map, of_columns(sheet, &places, stamps), stamps)?,
            Found::Period(period_s) => every(sheet, period_s),
        },
    };
    let times = match second_parts::added(sheet, &times.columns, &times.time_s) {
        Some(Finer { at, time_s, of }) if !times.columns.is_empty() => {
            let title = sheet.columns.get(at).map_or("", |column| column.title.as_str());
            let taken = times.taken.into_iter().chain([format!("{of} from {title}")]).collect();
            Times { time_s: from_zero(time_s), columns: times.columns.into_iter().chain([at]).collect(), taken }
        }
        _ => times,
    };
    let column = times.columns.first().copied().unwrap_or(0);
    forward(sheet, column, &times.time_s)?;
    match stamps.bursts(&times.time_s) {
        Some(bursts) if !times.columns.is_empty() => Err(come_in(sheet, column, bursts)),
        _ => Ok(times),
    }
}

/// Places of the columns that hold the times, for what must be known of them before they are read; none where rows have none, or where
/// the map says what to take where their times are none.
pub(super) fn places_of_time(sheet: &Sheet<'_>, map: &RecordingMap, naming: Naming) -> Vec<usize> {
    if map.period_ms.is_some() {
        return Vec::new();
    }
    match mapped(sheet, map, naming) {
        Ok(Some(places)) => places,
        _ => match place(sheet, map) {
            Ok(Found::Columns(places)) => places,
            _ => Vec::new(),
        },
    }
}

/// Places of the columns that the map names for the time; `None` where it names none, one that the file does not have, or where the
/// file has the rig's own names.
fn mapped(sheet: &Sheet<'_>, map: &RecordingMap, naming: Naming) -> Result<Option<Vec<usize>>, CsvError> {
    let places = map.time.0.iter().map(|term| sheet.find(&term.from)).collect::<Result<Vec<_>, _>>()?;
    let of_its_own_name = map.time.0.iter().all(|term| term.from == TIME_COLUMN);
    let asked = map.names_time() && (naming == Naming::Foreign || of_its_own_name);
    Ok(places.into_iter().collect::<Option<Vec<_>>>().filter(|_| asked))
}

/// Times as the file has them, or at the map's distance where it says one and they are none, stand still, go back or come in bursts.
/// Where the map says one, a hole in which the clock was set becomes a break.
fn or_every(
    sheet: &Sheet<'_>,
    map: &RecordingMap,
    times: Result<Times, RecordingError>,
    stamps: Stamps<'_>,
) -> Result<Times, RecordingError> {
    let Some(period_ms) = map.period_ms else { return times };
    match times {
        Ok(times)
            if times.time_s.windows(2).all(|pair| pair[1] > pair[0]) && stamps.bursts(&times.time_s).is_none() =>
        {
            Ok(with_break(times))
        }
        _ => Ok(every(sheet, 1e-3 * period_ms)),
    }
}

/// Times with a short break in the place of a hole in which the clock was set. Nobody knows how long it was, and two runs look the same: the
/// rows before and behind it are never one run.
fn with_break(mut times: Times) -> Times {
    if let Some(ClockSet { row, gap_s, .. }) = clock_set(&times.time_s) {
        times.time_s.iter_mut().skip(row).for_each(|time| *time -= gap_s - BREAK_S);
        times.taken.push(format!("a break of {BREAK_S} s where the clock was set"));
    }
    times
}

/// The error of rows whose times are those of the writing.
fn come_in(sheet: &Sheet<'_>, column: usize, of: Bursts) -> RecordingError {
    RecordingError::Bursts {
        file: sheet.file.clone(),
        column: sheet.columns.get(column).map_or_else(|| TIME_COLUMN.to_owned(), |column| column.title.clone()),
        rows: of.rows,
        step_ms: of.step_s * 1e3,
        every_ms: of.every_s * 1e3,
        period_ms: of.even_s * 1e3,
    }
}

/// Times of rows that come at one distance.
fn every(sheet: &Sheet<'_>, period_s: f64) -> Times {
    Times {
        time_s: (0..sheet.rows()).map(|row| period_s * row as f64).collect(),
        columns: Vec::new(),
        taken: vec![format!("a row every {} ms", 1e3 * period_s)],
    }
}

enum Found {
    Columns(Vec<usize>),
    Period(f64),
}

/// Where the times are, of a map that does not say it, or says what the file does not have.
fn place(sheet: &Sheet<'_>, map: &RecordingMap) -> Result<Found, RecordingError> {
    if let Some(at) = sheet.find(TIME_COLUMN)? {
        return Ok(Found::Columns(vec![at]));
    }
    if let Some(period_ms) = map.period_ms {
        return Ok(Found::Period(1e-3 * period_ms));
    }
    if !map.names_time()
        && let Some(places) = guessed(sheet)
    {
        return Ok(Found::Columns(places));
    }
    let column = map.time.0.iter().map(|term| &term.from).find(|name| !matches!(sheet.find(name), Ok(Some(_))));
    let mend = if map.names_time() {
        "the rig file's [recording] time asks for it".to_owned()
    } else if let Some((seconds, nanoseconds)) = second_parts::seconds_and_nanoseconds(sheet) {
        format!(
            "the time stands in two columns: say so in the rig file, [recording] time = [{{ from = {} }}, {{ from = {}, scale = 1e-9 }}]",
            toml_text(seconds),
            toml_text(nanoseconds)
        )
    } else {
        "where the time has another name say so in the rig file: [recording] time = \"…\"; where there is none, period_ms = …".to_owned()
    };
    Err(RecordingError::NotMapped {
        file: sheet.file.clone(),
        line: sheet.header_line,
        column: column.map_or(TIME_COLUMN, String::as_str).to_owned(),
        found: sheet.listed(),
        mend: sheet.mend_of_missing(mend),
    })
}

/// A column that is called a time, the only one of dates, or a date beside a time of day.
fn guessed(sheet: &Sheet<'_>) -> Option<Vec<usize>> {
    let called = |name: &str| sheet.columns.iter().position(|column| column.name.eq_ignore_ascii_case(name));
    if let (Some(date), Some(time)) = (called("date"), called("time"))
        && sheet.is_timestamped(date)
        && sheet.is_timestamped(time)
    {
        return Some(vec![date, time]);
    }
    let all = || 0..sheet.columns.len();
    let parts = (
        all().filter(|at| sheet.is_date_alone(*at)).collect::<Vec<_>>(),
        all().filter(|at| sheet.is_clock_alone(*at)).collect::<Vec<_>>(),
    );
    if let ([date], [clock]) = (parts.0.as_slice(), parts.1.as_slice()) {
        return Some(vec![*date, *clock]);
    }
    let is_field = |name: &str| {
        let mut those = all().filter(|at| {
            let column = sheet.columns.get(*at).and_then(|column| field(&column.name));
            column.is_some_and(|field| field.eq_ignore_ascii_case(name))
        });
        those.next().filter(|_| those.next().is_none())
    };
    let dates = dates(sheet);
    let named = NAMES.iter().find_map(|(name, _)| called(name)).or_else(|| with_its_unit(sheet));
    // Beside a date and time they are a part of it.
    let named = named.filter(|at| dates.len() != 1 || !second_parts::are_of_a_second(sheet, *at));
    let named = named.or_else(|| NAMES_ELSEWHERE.iter().find_map(|name| called(name)));
    if let Some(at) = named.or_else(|| NAMES.iter().find_map(|(name, _)| is_field(name))) {
        return Some(vec![at]);
    }
    if dates.is_empty() {
        called_time_somehow(sheet).map(|at| vec![at])
    } else {
        Some(dates).filter(|dates| dates.len() == 1)
    }
}

/// Columns of dates or times of day. Digits without marks may be the number of a run instead: they are a date where they change from
/// the first row to the last, and no column with marks is one.
fn dates(sheet: &Sheet<'_>) -> Vec<usize> {
    let ends = |at: &usize| match sheet.columns.get(*at).map(|column| &column.cells) {
        Some(Cells::Text(texts)) => Some((texts.first()?.as_ref(), texts.last()?.as_ref())),
        _ => None,
    };
    let all = (0..sheet.columns.len()).filter(|at| sheet.is_timestamped(*at));
    let (without_marks, marked): (Vec<usize>, Vec<usize>) =
        all.partition(|at| ends(at).is_some_and(|(first, _)| is_without_marks(first)));
    if marked.is_empty() {
        without_marks.into_iter().filter(|at| ends(at).is_some_and(|(first, last)| first != last)).collect()
    } else {
        marked
    }
}

/// The only column with a time in its name (`rosbagTimestamp`) whose numbers go on from row to row.
fn called_time_somehow(sheet: &Sheet<'_>) -> Option<usize> {
    let is_called = |name: &str| ["time", "stamp", "zeit"].iter().any(|word| name.to_ascii_lowercase().contains(word));
    let goes_on =
        |at: usize| sheet.numbers(at).is_ok_and(|x| x.len() > 1 && x.windows(2).all(|pair| pair[1] > pair[0]));
    let mut those = sheet.columns.iter().enumerate().filter(|(_, column)| is_called(&column.name)).map(|(at, _)| at);
    those.next().filter(|at| those.next().is_none() && goes_on(*at))
}

/// The only column that is called a time with a unit behind: `elapsed_min`.
fn with_its_unit(sheet: &Sheet<'_>) -> Option<usize> {
    let is_time = |name: &str| {
        name.rsplit_once(UNIT_MARKS)
            .is_some_and(|(stem, _)| NAMES.iter().any(|(known, _)| stem.eq_ignore_ascii_case(known)))
            && unit_behind(name).is_some()
    };
    let mut those = sheet.columns.iter().enumerate().filter(|(_, column)| is_time(&column.name)).map(|(at, _)| at);
    those.next().filter(|_| those.next().is_none())
}

/// Times as the map makes them.
fn of_terms(
    sheet: &Sheet<'_>,
    map: &RecordingMap,
    places: &[usize],
    stamps: Stamps<'_>,
) -> Result<Times, RecordingError> {
    let mut time_s = vec![0.0; sheet.rows()];
    let mut taken = Vec::new();
    for (term, at) in map.time.0.iter().zip(places) {
        let said = said(sheet, *at, Some(term))?;
        let (numbers, word) = seconds(sheet, *at, said)?;
        taken.extend(word);
        time_s.iter_mut().zip(numbers).for_each(|(slot, x)| *slot += term.of(x));
    }
    if let Some(moments) = sheet.moments(places).filter(|_| map.time.0.iter().all(Term::is_plain)) {
        time_s = moments;
    }
    let explicit = map.time.0.iter().any(|term| term.unit.is_some() || !term.is_plain());
    let said = match (explicit, map.time.0.as_slice(), places) {
        (true, [only], [at]) if only.is_plain() => said(sheet, *at, Some(only))?,
        (true, ..) => Said::Unit(1.0),
        (false, ..) => Said::Column,
    };
    plausible(sheet, places, &stamps.telling(&time_s), said)?;
    Ok(Times { time_s: from_zero(time_s), columns: places.to_vec(), taken })
}

/// Times of columns that no map names.
fn of_columns(sheet: &Sheet<'_>, places: &[usize], stamps: Stamps<'_>) -> Result<Times, RecordingError> {
    let mut time_s = vec![0.0; sheet.rows()];
    let (mut taken, mut least) = (Vec::new(), Said::Unit(1.0));
    for at in places {
        let said = said(sheet, *at, None)?;
        let (numbers, word) = seconds(sheet, *at, said)?;
        taken.extend(word);
        if (said == Said::Nothing || places.len() == 1) && !sheet.is_timestamped(*at) {
            least = said;
        }
        time_s.iter_mut().zip(numbers).for_each(|(slot, x)| *slot += x);
    }
    // Each by itself would go on at midnight: the date by a day, and the time of day as one that has no date.
    if let Some(moments) = sheet.moments(places) {
        time_s = moments;
    }
    plausible(sheet, places, &stamps.telling(&time_s), least)?;
    if let ([at], Some(first)) = (places, time_s.first().copied())
        && sheet.is_clock_alone(*at)
    {
        time_s.iter_mut().for_each(|time| *time -= first);
    }
    let names: Vec<&str> = places.iter().filter_map(|at| sheet.columns.get(*at)).map(|c| c.title.as_str()).collect();
    if taken.is_empty() && names != [TIME_COLUMN] {
        taken.push(format!("time from {} in s", names.join(" and ")));
    }
    Ok(Times { time_s: from_zero(time_s), columns: places.to_vec(), taken })
}

/// Times since the first row where they are since 1970, so that they stay short.
fn from_zero(mut time_s: Vec<f64>) -> Vec<f64> {
    match time_s.first().copied() {
        Some(first) if first.abs() >= 0.1 * EPOCH_S[0] => {
            time_s.iter_mut().for_each(|time| *time -= first);
            time_s
        }
        _ => time_s,
    }
}
