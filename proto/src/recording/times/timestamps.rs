//! Times as loggers write them: dates, times of day, zones, epochs.
//!
//! Read are `2026-03-29 01:59:00.020`, with `T` or a blank, `/` or `.` between the parts of a date in the orders year-month-day,
//! day-month-year and month-day-year, a fraction behind a point or a comma, `AM`/`PM`, a zone (`Z`, `+02:00`, `-0700`, `UTC`, `CEST`);
//! the same in digits alone (`20260329T015900.020Z`, `20260329015900020`); a date alone; a time of day alone (`01:59:00,020`), or of the hour, with a
//! fraction (`59:00.0`, as spreadsheets show it); days and a time (`0 days 00:00:00.020`); months by name in the languages that loggers
//! are sold in ([`super::month_names`]). Only differences count, so that a zone matters where it changes within a file; without one, the
//! hour that summer time takes or gives (half an hour on Lord Howe Island) is noticed between rows and taken back. Between moments that
//! lie apart, such as the beginnings of runs, an hour is an hour.

use super::in_digits::in_digits;
use super::month_names::{in_numbers, month_of};
use super::other_marks::with_usual_marks;

/// Seconds of a day.
const DAY_S: f64 = 86_400.0;
/// Longest step over midnight, in s, at which a date that stands still is no second run of the day before.
const STILL_DATE_S: f64 = 60.0;
/// Hours of a clock without a word for the half of the day, behind which it begins anew (s).
const HALF_DAY_S: f64 = 43_200.0;
/// Times of day at which such a clock shows its last hour, from 12:00:00 to 12:59:59 (s).
const ITS_LAST_HOUR_S: [f64; 2] = [43_200.0, 46_800.0];
/// Times of day at which it shows the first minute of its next round, which begins at one o'clock (s).
const ITS_FIRST_MINUTE_S: [f64; 2] = [3600.0, 3660.0];
/// Seconds that clocks are set by for summer time.
const SUMMER_TIME_S: f64 = 3600.0;
/// Change on Lord Howe Island (s). A logger may well pause for half an hour, so this one counts only where the rows go on at their
/// own pace without it.
const HALF_SUMMER_TIME_S: f64 = 1800.0;

/// Order of the parts of a date.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum DateOrder {
    YearMonthDay,
    DayMonthYear,
    MonthDayYear,
}

/// Zones by the names that loggers write, and their hours before UTC. Only differences within a file count.
const ZONES: [(&str, f64); 20] = [
    ("WET", 0.0),
    ("WEST", 1.0),
    ("BST", 1.0),
    ("CET", 1.0),
    ("CEST", 2.0),
    ("MEZ", 1.0),
    ("MESZ", 2.0),
    ("EST", -5.0),
    ("EDT", -4.0),
    ("CST", -6.0),
    ("CDT", -5.0),
    ("PST", -8.0),
    ("PDT", -7.0),
    ("JST", 9.0),
    ("KST", 9.0),
    ("AWST", 8.0),
    ("AEST", 10.0),
    ("AEDT", 11.0),
    ("NZST", 12.0),
    ("NZDT", 13.0),
];

/// Tells whether a text is a date, a time of day, or both.
pub(crate) fn is_timestamp(text: &str) -> bool {
    let spread = spread(text);
    let text = spread.as_deref().unwrap_or(text);
    seconds(text, DateOrder::DayMonthYear).or_else(|| seconds(text, DateOrder::MonthDayYear)).is_some()
}

/// Tells whether a text is a date without a time of day.
pub(crate) fn is_date_alone(text: &str) -> bool {
    let spread = spread(text);
    is_timestamp(text) && parts(spread.as_deref().unwrap_or(text)).clock.is_none()
}

/// Tells whether a text is a time of day without a date.
pub(crate) fn is_clock_alone(text: &str) -> bool {
    let spread = spread(text);
    is_timestamp(text) && parts(spread.as_deref().unwrap_or(text)).date.is_none()
}

/// Seconds of the clock of every row since a common instant, without the hour of summer time; the row (from 0) whose text is no time where
/// there is one.
///
/// # Errors
/// The first row that is neither date nor time.
pub(crate) fn column_s(texts: &[&str]) -> Result<Vec<f64>, usize> {
    seconds_of(texts, WholeHours::OfSummerTime)
}

/// Seconds of moments that may lie any time apart since a common instant: nobody can tell an hour of summer time from an hour's pause.
///
/// # Errors
/// The first text that is neither date nor time.
pub(crate) fn moments_s(texts: &[&str]) -> Result<Vec<f64>, usize> {
    seconds_of(texts, WholeHours::AsWritten)
}

/// The meaning of a step of a whole hour between times without a zone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum WholeHours {
    /// The clock was set for summer time.
    OfSummerTime,
    /// An hour passed.
    AsWritten,
}

fn seconds_of(texts: &[&str], hours: WholeHours) -> Result<Vec<f64>, usize> {
    let spread: Option<Vec<String>> = texts.iter().map(|text| spread(text)).collect();
    let spread: Vec<&str> = spread.iter().flatten().map(String::as_str).collect();
    let texts = if spread.len() == texts.len() { &spread } else { texts };
    let in_order = |order: DateOrder| -> Result<Vec<f64>, usize> {
        texts.iter().enumerate().map(|(row, text)| seconds(text, order).ok_or(row)).collect()
    };
    let (day_first, month_first) = (in_order(DateOrder::DayMonthYear), in_order(DateOrder::MonthDayYear));
    let mut times = match (day_first, month_first) {
        // 03/04 may be either; that which leaves less of a span between first and last row is meant.
        (Ok(day_first), Ok(month_first)) => {
            let span =
                |times: &[f64]| times.last().zip(times.first()).map_or(0.0, |(last, first)| (last - first).abs());
            if span(&month_first) < span(&day_first) { month_first } else { day_first }
        }
        (Ok(times), Err(_)) | (Err(_), Ok(times)) => times,
        (Err(row), Err(_)) => return Err(row),
    };
    let first = texts.first().map(|text| parts(text));
    let is_dated = first.as_ref().is_some_and(|first| first.date.is_some() || first.days.is_some());
    let written = if is_dated { Written::Dated } else { Written::TimeOfDay };
    let zoned = first.is_some_and(|first| first.zone.is_some());
    unwrap(&mut times, written, if zoned { WholeHours::AsWritten } else { hours });
    Ok(times)
}

/// Manner in which a column writes its times.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Written {
    /// The time of day alone, which begins anew at midnight.
    TimeOfDay,
    /// A date beside it, or a count of days.
    Dated,
}

/// Takes midnight out of times of day, one o'clock out of those of twelve hours, and the change to and from summer time out of times
/// without a zone.
fn unwrap(times: &mut [f64], written: Written, hours: WholeHours) {
    let may_be_set = hours == WholeHours::OfSummerTime;
    let (mut shift_s, mut longest_s) = (0.0, 0.0_f64);
    let mut previous: Option<f64> = None;
    for time in times {
        let mut step_s = previous.map_or(0.0, |previous| *time - previous);
        let is_within = |time: f64, [from_s, to_s]: [f64; 2]| (from_s..to_s).contains(&time.rem_euclid(DAY_S));
        let may_begin_anew = previous.is_some_and(|previous| is_within(previous, ITS_LAST_HOUR_S))
            && is_within(*time, ITS_FIRST_MINUTE_S);
        previous = Some(*time);
        // Beside a time of day a date may stand still: the day on which a file was begun.
        let is_midnight = match written {
            Written::Dated => (0.0..STILL_DATE_S).contains(&(step_s + DAY_S)),
            Written::TimeOfDay => step_s < -0.5 * DAY_S,
        };
        if is_midnight {
            shift_s += DAY_S;
            step_s += DAY_S;
        }
        // 12:59:59 and 1:00:00 without AM or PM.
        if may_be_set && may_begin_anew && (0.0..STILL_DATE_S).contains(&(step_s + HALF_DAY_S)) {
            shift_s += HALF_DAY_S;
            step_s += HALF_DAY_S;
        }
        // Within a second of a whole hour: no logger pauses so.
        if may_be_set && (step_s.abs() - SUMMER_TIME_S).abs() < 1.0 {
            shift_s -= SUMMER_TIME_S.copysign(step_s);
            step_s -= SUMMER_TIME_S.copysign(step_s);
        } else if may_be_set && goes_on(step_s - HALF_SUMMER_TIME_S.copysign(step_s), longest_s) {
            shift_s -= HALF_SUMMER_TIME_S.copysign(step_s);
            step_s -= HALF_SUMMER_TIME_S.copysign(step_s);
        }
        longest_s = longest_s.max(step_s);
        *time += shift_s;
    }
}

/// Tells whether a step is one of rows that come at least every `longest_s`, or so.
fn goes_on(step_s: f64, longest_s: f64) -> bool {
    step_s > 0.0 && step_s < 1.5 * longest_s
}

/// A time in one of the writings that have no marks between their parts, other ones, or a month by name, with numbers and marks; `None` of
/// another.
fn spread(text: &str) -> Option<String> {
    in_digits(text).or_else(|| in_numbers(text)).or_else(|| with_usual_marks(text))
}

/// A timestamp in its parts.
struct Parts<'t> {
    /// Days since the beginning.
    days: Option<f64>,
    date: Option<&'t str>,
    clock: Option<&'t str>,
    afternoon: Option<bool>,
    zone: Option<f64>,
}

fn parts(text: &str) -> Parts<'_> {
    let mut parts = Parts { days: None, date: None, clock: None, afternoon: None, zone: None };
    let (date_and, clock) = halves(text.trim());
    let words = date_and.split_whitespace().chain(clock.split_whitespace());
    for word in words {
        match word.to_ascii_uppercase().as_str() {
            "AM" | "A.M." => parts.afternoon = Some(false),
            "PM" | "P.M." => parts.afternoon = Some(true),
            "Z" | "UTC" | "GMT" => parts.zone = Some(0.0),
            "DAY" | "DAYS" if parts.clock.is_none() => {
                parts.days = parts.date.take().and_then(|days| days.parse::<u32>().ok()).map(f64::from);
            }
            name if parts.clock.is_some() && zone_s(name).is_some() => parts.zone = zone_s(name),
            _ if word.contains(':') && parts.clock.is_none() => {
                let (clock, zone) = split_zone(word);
                parts.clock = Some(clock);
                parts.zone = zone.or(parts.zone);
            }
            _ if parts.clock.is_some() && word.starts_with(['+', '-']) => parts.zone = offset_s(word),
            _ if parts.date.is_none() => parts.date = Some(word),
            _ => return Parts { days: None, date: Some(""), clock: None, afternoon: None, zone: None },
        }
    }
    parts
}

/// A zone of a name, in s.
fn zone_s(name: &str) -> Option<f64> {
    ZONES.iter().find(|(zone, _)| *zone == name).map(|(_, hours)| 3600.0 * hours)
}

/// Texts before and behind the `T` between a date and a time.
fn halves(text: &str) -> (&str, &str) {
    let digits = |at: usize| {
        let byte = |at: Option<usize>| at.and_then(|at| text.as_bytes().get(at)).is_some_and(u8::is_ascii_digit);
        byte(at.checked_sub(1)) && byte(Some(at + 1))
    };
    match text.find(['T', 't']).filter(|at| digits(*at)) {
        Some(at) => (text.get(..at).unwrap_or(text), text.get(at + 1..).unwrap_or("")),
        None => (text, ""),
    }
}

/// A time of day and the zone that is written behind it.
fn split_zone(word: &str) -> (&str, Option<f64>) {
    if let Some(clock) = word.strip_suffix(['Z', 'z']) {
        return (clock, Some(0.0));
    }
    match word.rfind(['+', '-']) {
        Some(at) => {
            let (clock, zone) = word.split_at(at);
            (clock, offset_s(zone))
        }
        None => (word, None),
    }
}

/// `+02:00`, `-0700` or `+02` in s.
fn offset_s(zone: &str) -> Option<f64> {
    let sign = if zone.starts_with('-') { -1.0 } else { 1.0 };
    let digits: String = zone.chars().filter(char::is_ascii_digit).collect();
    let (hours, minutes) = match digits.len() {
        1 | 2 => (digits.as_str(), "0"),
        4 => digits.split_at(2),
        _ => return None,
    };
    Some(sign * (3600.0 * hours.parse::<f64>().ok()? + 60.0 * minutes.parse::<f64>().ok()?))
}

/// Seconds since 1970 of a date with or without a time; since midnight of a time alone.
fn seconds(text: &str, order: DateOrder) -> Option<f64> {
    let parts = parts(text);
    if parts.date.is_none() && parts.clock.is_none() {
        return None;
    }
    let days = match parts.date {
        Some(date) => days(date, order)? as f64,
        None => 0.0,
    };
    let clock_s = match parts.clock {
        Some(clock) => clock_s(clock, parts.afternoon)?,
        None => 0.0,
    };
    let days = days + parts.days.unwrap_or(0.0);
    Some(DAY_S * days + clock_s - parts.zone.unwrap_or(0.0))
}

fn clock_s(clock: &str, afternoon: Option<bool>) -> Option<f64> {
    // Minutes and seconds with a fraction: what a spreadsheet makes of a clock when it writes it out.
    let of_the_hour = |seconds: &str| seconds.contains(['.', ',']) && !seconds.contains(':');
    if let Some((minutes, seconds)) = clock.split_once(':').filter(|(_, seconds)| of_the_hour(seconds)) {
        let seconds: f64 = seconds.replace(',', ".").parse().ok()?;
        let minutes = f64::from(minutes.parse::<u32>().ok()?);
        return (minutes < 60.0 && (0.0..61.0).contains(&seconds)).then_some(60.0 * minutes + seconds);
    }
    let mut fields = clock.split(':');
    let hours: u32 = fields.next()?.parse().ok()?;
    let minutes: u32 = fields.next()?.parse().ok()?;
    let seconds: f64 = match fields.next() {
        Some(text) if text.starts_with(|c: char| c.is_ascii_digit()) => text.replace(',', ".").parse().ok()?,
        Some(_) => return None,
        None => 0.0,
    };
    // `hh:mm:ss:mmm` is how some loggers write thousandths.
    let thousandths: f64 = fields.next().map_or(Some(0.0), |text| text.parse::<u32>().ok().map(f64::from))?;
    if fields.next().is_some() || hours > 24 || minutes > 59 || !(0.0..61.0).contains(&seconds) {
        return None;
    }
    let hours = match afternoon {
        Some(true) if hours < 12 => hours + 12,
        Some(false) if hours == 12 => 0,
        _ => hours,
    };
    Some(f64::from(hours) * 3600.0 + f64::from(minutes) * 60.0 + seconds + 1e-3 * thousandths)
}

/// Days since 1970-01-01 of a date (Gregorian; Hinnant's algorithm of days from civil).
fn days(date: &str, order: DateOrder) -> Option<i64> {
    let mark = date.chars().find(|c| matches!(c, '-' | '/' | '.'))?;
    let fields: Vec<&str> = date.split(mark).collect();
    let [a, b, c] = fields.as_slice() else { return None };
    let order = if a.len() == 4 { DateOrder::YearMonthDay } else { order };
    let [year, month, day] = match order {
        DateOrder::YearMonthDay => [a, b, c],
        DateOrder::DayMonthYear => [c, b, a],
        DateOrder::MonthDayYear => [c, a, b],
    };
    let month = month.parse().ok().filter(|month| (1..=12).contains(month)).or_else(|| month_of(month))?;
    let (mut year, day): (i64, i64) = (year.parse().ok()?, day.parse().ok()?);
    if year < 100 {
        year += 2000;
    }
    if !(1..=31).contains(&day) || !(1900..2200).contains(&year) {
        return None;
    }
    let shifted = if month <= 2 { year - 1 } else { year };
    let era = shifted.div_euclid(400);
    let of_era = shifted.rem_euclid(400);
    let of_year = (153 * ((month + 9) % 12) + 2) / 5 + day - 1;
    Some(era * 146_097 + of_era * 365 + of_era / 4 - of_era / 100 + of_year - 719_468)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(text: &str) -> f64 {
        column_s(&[text]).unwrap()[0]
    }

    /// Against seconds that `date -u +%s` gives.
    #[test]
    fn dates_are_seconds_since_1970() {
        const AT: f64 = 1_774_749_540.0; // 2026-03-29T01:59:00Z
        for text in [
            "2026-03-29 01:59:00",
            "2026-03-29T01:59:00Z",
            "2026/03/29 01:59:00.000",
            "29.03.2026 01:59:00,000",
            "29/03/2026 01:59",
            "03/29/2026 1:59:00 AM",
            "29-Mar-2026 01:59:00",
            "2026-03-29T03:59:00+02:00",
            "2026-03-28 18:59:00-0700",
            "2026-03-29 01:59:00 UTC",
            "2026-03-29 01:59:00:000",
            "29. März 2026 01:59:00",
            "29-Mrz-2026 01:59:00",
            "29.Mär.2026 01:59:00,000",
            "29 mars 2026 01:59:00",
            "Sun Mar 29 01:59:00 2026",
            "Sun, 29 Mar 2026 03:59:00 +0200",
            "March 29, 2026 1:59:00 AM",
            "29 Mar 2026, 01:59:00",
        ] {
            assert_eq!(one(text), AT, "{text}");
        }
        assert!((one("2026-03-29 01:59:00.020") - AT - 0.02).abs() < 1e-6, "a double of 2e9 s has steps of 2e-7 s");
        assert_eq!(one("2000-02-29"), 951_782_400.0);
        assert_eq!(one("1:02:03.5 PM"), 13.0 * 3600.0 + 123.5);
        for text in
            ["", "run 3", "12", "0.02", "2026-13-29", "25:61", "a:b:c", "kPa", "1774749540020000000", "20261329015900"]
        {
            assert!(!is_timestamp(text), "{text}");
        }
    }

    #[test]
    fn midnight_and_summer_time_are_taken_out() {
        let steps = |texts: &[&str]| -> Vec<f64> { column_s(texts).unwrap().windows(2).map(|w| w[1] - w[0]).collect() };
        let near = |found: Vec<f64>| assert!(found.iter().all(|step| (step - 0.02).abs() < 1e-5), "{found:?}");
        near(steps(&["23:59:59.980", "00:00:00.000", "00:00:00.020"]));
        near(steps(&["2026-03-29 01:59:59.980", "2026-03-29 03:00:00.000", "2026-03-29 03:00:00.020"]));
        near(steps(&["2026-10-25 02:59:59.980", "2026-10-25 02:00:00.000", "2026-10-25 02:00:00.020"]));
        // Lord Howe Island; a logger may pause for half an hour, and does not go back by one.
        near(steps(&["2026-04-05 01:59:59.960", "2026-04-05 01:59:59.980", "2026-04-05 01:30:00.000"]));
        near(steps(&["2026-10-04 01:59:59.960", "2026-10-04 01:59:59.980", "2026-10-04 02:30:00.000"]));
        assert_eq!(steps(&["2026-10-04 01:00:00", "2026-10-04 01:00:01", "2026-10-04 01:30:09"]), [1.0, 1808.0]);
        near(steps(&["2026-03-29T01:59:59.980+01:00", "2026-03-29T03:00:00.000+02:00"]));
        near(steps(&["20260329T015959.980Z", "20260329T020000.000Z", "20260329T020000.020Z"]));
        near(steps(&["20260329 015959,980", "20260329 020000,000"]));
        near(steps(&["20260329015959980", "20260329020000000", "20260329020000020"]));
        near(steps(&["20260329015959.98", "20260329020000.00"]));
        near(steps(&["12:59:59.980", "01:00:00.000", "01:00:00.020"]));
        near(steps(&["12:59:59.980 PM", "01:00:00.000 PM"]));
        // Twelve hours back at another minute than the first past one o'clock are no clock of twelve hours.
        assert_eq!(steps(&["12:10:00", "00:10:20"]), [-43_180.0]);
        assert_eq!(steps(&["12:59:50", "00:59:59"]), [-43_191.0]);
        near(steps(&["03/29/2026 12:59:59.980", "03/29/2026 1:00:00.000"]));
        near(steps(&["59:59.98", "00:00.00", "00:00.02"]));
        near(steps(&["0 days 23:59:59.98", "1 days 00:00:00.00", "1 days 00:00:00.02"]));
        near(steps(&["2026-03-29 01:59:59.980 CET", "2026-03-29 03:00:00.000 CEST"]));
        // With a zone an hour is an hour.
        assert_eq!(steps(&["2026-03-29T01:00:00Z", "2026-03-29T02:00:00Z"]), [3600.0]);
        // Moments may lie an hour apart; midnight is no day's pause.
        let apart = |texts: &[&str]| moments_s(texts).unwrap()[1] - moments_s(texts).unwrap()[0];
        assert_eq!(apart(&["2026-03-29 10:00:00", "2026-03-29 11:00:00.5"]), 3600.5);
        assert_eq!(apart(&["2026-03-29 11:00:00 CET", "2026-03-29 11:00:00 CEST"]), -3600.0);
        assert_eq!(apart(&["23:30:00", "00:30:00"]), 3600.0);
        // Day and month exchanged would be 28 days.
        assert_eq!(steps(&["03/31/2026 23:59:59", "04/01/2026 00:00:00"]), [1.0]);
        assert_eq!(steps(&["05/03/2026 23:59:59", "06/03/2026 00:00:00"]), [1.0]);
        assert_eq!(column_s(&["01:00:00", "later"]), Err(1));
    }
}
