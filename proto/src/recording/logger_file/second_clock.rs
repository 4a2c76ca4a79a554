//! Two loggers' columns side by side in one table, each with a clock of its own: a row is not one moment then.
//!
//! ```text
//! t_cmd, pwm,   t_p,  p
//! 0.00,  0.30,  0.00, 1.2
//! 0.02,  0.31,  0.10, 1.5
//! 0.04,  0.31,  ,
//! ```
//!
//! A second clock is a column that the rig does not ask for, whose numbers rise from the first row to one that is not the end of the first
//! clock, that cover the span of the first at another pace (one that is called a time may begin at another moment or be in another unit),
//! and that end where columns which the rig asks for end.
//! Numbers that go on with the first clock from row to row, in whatever unit of time, are no second clock, and neither is a count.
//! The first clock may stand in several columns, as a date beside a time of day; such a table is refused.

use model::rig::{RecordingMap, Rig};

use super::own_clocks;
use super::row_names::is_called_a_time;
use super::sheet::{Cells, Sheet};
use crate::recording::columns::{Naming, places};
use crate::recording::csv::CsvError;
use crate::recording::csv::numbers::{parse, says_nothing};
use crate::recording::rows::resample::median_step;
use crate::recording::times::{places_of_time, second_parts, timestamps};

/// Times that a clock has at least: of fewer nobody can say that they go on.
const LEAST_TIMES: usize = 10;
/// Share of the first clock's span within which a second one begins and ends with it.
const SAME_SPAN: f64 = 0.1;
/// Units in which a column may count the time of the first clock, in its numbers …
const THOUSANDS: [f64; 7] = [1.0, 1e3, 1e6, 1e9, 1e-3, 1e-6, 1e-9];
/// … or which a second time in the rows of the first may be in besides.
const MINUTES: [f64; 2] = [60.0, 1.0 / 60.0];
/// Share of its span, and steps of the first clock, by which such a column may be off: two oscillators are off by less, and a row is
/// stamped at one moment or the next.
const OFF: f64 = 1e-3;
const OFF_STEPS: f64 = 3.0;
/// One of so many rows at the end of a channel may lack a reading.
const LACKING: usize = 50;

/// A column of times: its place and, by row, its numbers.
struct Clock {
    at: usize,
    times: Vec<(usize, f64)>,
    /// Rows up to its last time.
    rows: usize,
}

/// The sheet with the times of one clock alone where it has several that can be brought together; `None` where it has one.
///
/// # Errors
/// A second clock that cannot be brought together with the first.
pub(crate) fn joined<'a>(
    sheet: &Sheet<'a>,
    (rig, map): (&Rig, &RecordingMap),
    naming: Naming,
) -> Result<Option<Sheet<'a>>, CsvError> {
    let lengths: Vec<usize> = (0..sheet.columns.len()).map(|at| filled_rows(sheet, at)).collect();
    if lengths.iter().all(|rows| *rows == sheet.rows()) {
        return Ok(None);
    }
    // A distance that the map says is that of the rows; the clocks are there all the same.
    let of_time = places_of_time(sheet, &RecordingMap { period_ms: None, ..map.clone() }, naming);
    let (Some((first, of_time)), Ok(asked)) = (Clock::first(sheet, map, of_time), places(sheet, rig, map, naming))
    else {
        return Ok(None);
    };
    let is_first = |place: &usize| of_time.contains(place);
    let asked: Vec<usize> = asked.into_iter().flat_map(|(_, places)| places).filter(|place| !is_first(place)).collect();
    let length = |place: usize| lengths.get(place).copied().unwrap_or(0);
    let ends_with = |place: usize, rows: usize| length(place) <= rows && LACKING * (rows - length(place)) <= rows;
    // An end to the row is no chance; one row in so many may lack a reading, but then it must not be the first clock's end as well.
    let is_of = |place: usize, clock: &Clock| {
        length(place) == clock.rows || (ends_with(place, clock.rows) && !ends_with(place, first.rows))
    };
    let is_second = |clock: &Clock| {
        clock.rows != first.rows
            && asked.iter().any(|place| is_of(*place, clock))
            && !clock.goes_on_with(&first)
            && (clock.spans(&first) || (clock.is_called_a_time(sheet) && clock.lasts_as_long_as(&first)))
    };
    let others = (0..sheet.columns.len()).filter(|place| !is_first(place) && !asked.contains(place));
    let seconds: Vec<Clock> = others.filter_map(|place| Clock::of(sheet, place, &lengths)).filter(is_second).collect();
    let Some(second) = seconds.first() else { return Ok(None) };
    let refused = |why: &'static str| {
        let title = |place: usize| sheet.columns.get(place).map_or_else(String::new, |column| column.title.clone());
        CsvError::SecondClock {
            file: sheet.file.clone(),
            line: sheet.header_line,
            position: second.at + 1,
            column: title(second.at),
            own: second.rows,
            first: of_time.iter().map(|place| title(*place)).collect::<Vec<_>>().join(" and "),
            rows: first.rows,
            why,
        }
    };
    if !seconds.iter().all(|clock| clock.spans(&first)) {
        return Err(refused("the two do not cover the same time in the same unit"));
    }
    if of_time.len() > 1 {
        return Err(refused("the time stands in more than one column"));
    }
    let mut clocks: Vec<&Clock> = seconds.iter().chain([&first]).collect();
    clocks.sort_by_key(|clock| clock.at);
    let clock_of = |place: usize| clocks.iter().rev().find(|clock| clock.at < place).or(clocks.first());
    let belongs = |place: &usize| clock_of(*place).is_none_or(|clock| length(*place) <= clock.rows);
    let is_left_alone = |clock: &Clock| !asked.iter().any(|place| clock_of(*place).is_some_and(|of| of.at == clock.at));
    if !asked.iter().all(belongs) || clocks.iter().any(|clock| is_left_alone(clock)) {
        return Err(refused("the columns of each clock do not stand to the right of it"));
    }
    let places: Vec<usize> = clocks.iter().map(|clock| clock.at).collect();
    own_clocks::joined(sheet, &places).map(Some).ok_or_else(|| refused("their times are not all plain numbers"))
}

/// Rows of a column up to the last cell that says something.
fn filled_rows(sheet: &Sheet<'_>, at: usize) -> usize {
    match sheet.columns.get(at).map(|column| &column.cells) {
        Some(Cells::Text(texts)) => texts.iter().rposition(|text| !says_nothing(text)).map_or(0, |last| last + 1),
        _ => sheet.rows(),
    }
}

/// Rows of a column whose cells say something, with these; `None` of a column that holds numbers ([`Cells::Numbers`]) and no text.
fn said_in<'s>(sheet: &'s Sheet<'_>, at: usize) -> Option<Vec<(usize, &'s str)>> {
    let Cells::Text(texts) = &sheet.columns.get(at)?.cells else { return None };
    Some(texts.iter().map(AsRef::as_ref).enumerate().filter(|(_, text)| !says_nothing(text)).collect())
}

impl Clock {
    /// The clock of the rows and its columns, in the rows in which all of these say something: their sum, as the map scales several, or a
    /// date and a time of day, with the parts of a second that stand beside it.
    fn first(sheet: &Sheet<'_>, map: &RecordingMap, mut places: Vec<usize>) -> Option<(Self, Vec<usize>)> {
        let said: Vec<Vec<(usize, &str)>> = places.iter().map(|at| said_in(sheet, *at)).collect::<Option<_>>()?;
        let (shortest, others) = said.split_first()?;
        let is_in = |row: usize| move |of: &Vec<(usize, &str)>| of.binary_search_by_key(&row, |(at, _)| *at).is_ok();
        let rows: Vec<usize> =
            shortest.iter().map(|(row, _)| *row).filter(|row| others.iter().all(is_in(*row))).collect();
        let alone = sheet.rows_alone(&rows);
        let of_terms = || {
            let mut sum = vec![0.0; rows.len()];
            for (nth, at) in places.iter().enumerate() {
                // One column alone is compared with others as it stands.
                let term = map.time.0.get(nth).filter(|_| places.len() > 1 && map.time.0.len() == places.len());
                let times = alone.times(*at).ok()?;
                sum.iter_mut().zip(times).for_each(|(sum, x)| *sum += term.map_or(x, |term| term.of(x)));
            }
            Some(sum)
        };
        let mut times = alone.moments(&places).or_else(of_terms)?;
        if let Some(finer) = second_parts::added(&alone, &places, &times) {
            times = finer.time_s;
            places.push(finer.at);
        }
        let length = rows.last().map_or(0, |last| last + 1);
        let clock = Clock::that_goes_on(*places.first()?, rows.into_iter().zip(times).collect(), length)?;
        Some((clock, places))
    }

    /// The times of a column; `None` where its cells are not numbers or moments that rise.
    fn of(sheet: &Sheet<'_>, at: usize, lengths: &[usize]) -> Option<Self> {
        let filled = said_in(sheet, at)?;
        let numbers: Vec<f64> = if sheet.is_timestamped(at) {
            timestamps::column_s(&filled.iter().map(|(_, text)| *text).collect::<Vec<_>>()).ok()?
        } else {
            filled.iter().map(|(_, text)| parse(text, sheet.decimal)).collect::<Option<_>>()?
        };
        let times = filled.iter().map(|(row, _)| *row).zip(numbers).collect();
        Clock::that_goes_on(at, times, lengths.get(at).copied().unwrap_or(0))
    }

    /// The clock of these rows and their times, up to so many rows; `None` where times do not rise, or stand here and there alone.
    fn that_goes_on(at: usize, times: Vec<(usize, f64)>, rows: usize) -> Option<Self> {
        let rises =
            times.iter().all(|(_, time)| time.is_finite()) && times.windows(2).all(|pair| pair[1].1 > pair[0].1);
        // A clock of another logger fills the rows from the first one on; a stamp here and there is that of a topic.
        let goes_on = times.len() >= LEAST_TIMES && LACKING * (rows - times.len()) <= rows;
        (rises && goes_on).then_some(Clock { at, times, rows })
    }

    /// First and last time.
    fn ends(&self) -> [f64; 2] {
        [self.times.first(), self.times.last()].map(|end| end.map_or(0.0, |(_, time)| *time))
    }

    /// Tells whether it covers the same time as another one, in the same numbers.
    fn spans(&self, other: &Clock) -> bool {
        let ([begin, end], [others_begin, others_end]) = (self.ends(), other.ends());
        let near = SAME_SPAN * (others_end - others_begin);
        (begin - others_begin).abs() <= near && (end - others_end).abs() <= near
    }

    /// Tells whether it lasts as long as another one, in seconds or thousandths and the like of them: what a count of rows lasts is chance.
    fn lasts_as_long_as(&self, other: &Clock) -> bool {
        let ([begin, end], [others_begin, others_end]) = (self.ends(), other.ends());
        let other_s = others_end - others_begin;
        THOUSANDS.iter().any(|unit| ((end - begin) / unit - other_s).abs() <= SAME_SPAN * other_s)
    }

    /// Tells whether it tells the time of another one from row to row, in any unit.
    fn goes_on_with(&self, other: &Clock) -> bool {
        let mut others = other.times.iter().peekable();
        let both: Vec<[f64; 2]> = self
            .times
            .iter()
            .filter_map(|(row, time)| {
                while others.next_if(|(of, _)| of < row).is_some() {}
                others.next_if(|(of, _)| of == row).map(|(_, others)| [*time, *others])
            })
            .collect();
        let ([Some(first), Some(last)], Some(step)) =
            ([both.first(), both.last()], median_step(&both.iter().map(|[_, others]| *others).collect::<Vec<_>>()))
        else {
            return false;
        };
        let off = OFF * (last[1] - first[1]) + OFF_STEPS * step;
        let is_in = |unit: &f64| both.iter().all(|at| ((at[0] - first[0]) / unit - (at[1] - first[1])).abs() <= off);
        THOUSANDS.iter().chain(&MINUTES).any(is_in)
    }

    fn is_called_a_time(&self, sheet: &Sheet<'_>) -> bool {
        sheet.is_timestamped(self.at) || sheet.columns.get(self.at).is_some_and(|column| is_called_a_time(&column.name))
    }
}
