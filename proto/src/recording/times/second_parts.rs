//! Parts of a second in a column of their own, beside a clock that shows whole seconds: milliseconds of a logger, nanoseconds of a message
//! of ROS.

use crate::recording::logger_file::sheet::Sheet;

/// Names of columns of nanoseconds.
const NANOSECONDS: [&str; 8] = ["ns", "nsec", "nsecs", "nanosec", "nanosecs", "nanos", "nanosecond", "nanoseconds"];
/// Names that such columns go by, what they count (s), and its name.
const PARTS: [(&[&str], f64, &str); 3] = [
    (
        &[
            "ms",
            "msec",
            "msecs",
            "millisec",
            "millitm",
            "millis",
            "milli",
            "millisecond",
            "milliseconds",
            "millisekunden",
        ],
        1e-3,
        "milliseconds",
    ),
    (&["us", "usec", "usecs", "microsec", "micros", "microsecond", "microseconds"], 1e-6, "microseconds"),
    (&NANOSECONDS, 1e-9, "nanoseconds"),
];
/// Names of the seconds beside them, behind a common beginning (`header.stamp.sec`, `header.stamp.nanosec`).
const SECONDS: [&str; 5] = ["seconds", "second", "secs", "sec", "s"];

/// A column of parts of a second.
struct Parts {
    /// By row (s).
    seconds: Vec<f64>,
    /// Name of what it counts.
    of: &'static str,
}

/// Times finer than those of a clock's whole seconds.
pub(crate) struct Finer {
    /// Place of the column with the parts.
    pub(crate) at: usize,
    /// By row (s).
    pub(crate) time_s: Vec<f64>,
    /// Name of what that column counts.
    pub(crate) of: &'static str,
}

/// Tells whether a column, by its name and its numbers, holds the parts of another clock's second: they begin anew.
pub(crate) fn are_of_a_second(sheet: &Sheet<'_>, at: usize) -> bool {
    let goes_back = |parts: &Parts| parts.seconds.windows(2).any(|pair| pair[1] < pair[0]);
    parts(sheet, at, None).is_some_and(|parts| goes_back(&parts))
}

/// A column that has such a name, alone or behind the beginning of the clock's, and nothing but whole numbers below a second.
fn parts(sheet: &Sheet<'_>, at: usize, clock: Option<&str>) -> Option<Parts> {
    let name = sheet.columns.get(at)?.name.to_ascii_lowercase();
    let is_beside = |stem: &str| {
        let of_clock = clock.and_then(|clock| clock.strip_prefix(stem));
        stem.is_empty() || of_clock.is_some_and(|rest| SECONDS.contains(&rest))
    };
    let (_, part_s, of) = PARTS
        .into_iter()
        .find(|(names, ..)| names.iter().any(|known| name.strip_suffix(known).is_some_and(is_beside)))?;
    let numbers = sheet.numbers(at).ok()?;
    let are_parts = numbers.iter().all(|x| x.fract() == 0.0 && (0.0..(1.0 / part_s).round()).contains(x));
    are_parts.then(|| Parts { seconds: numbers.iter().map(|x| part_s * x).collect(), of })
}

/// Names of two columns that are the seconds and the nanoseconds of one stamp, as messages of ROS have it.
pub(super) fn seconds_and_nanoseconds<'s>(sheet: &'s Sheet<'_>) -> Option<(&'s str, &'s str)> {
    let titles = || sheet.columns.iter().map(|column| column.title.as_str());
    titles().find_map(|fine| {
        let stem = NANOSECONDS.iter().find_map(|end| fine.strip_suffix(end))?;
        let is_coarse = |title: &&str| title.strip_prefix(stem).is_some_and(|end| SECONDS.contains(&end));
        Some((titles().find(is_coarse)?, fine))
    })
}

/// Times with the parts of a second of another column added, of the coarsest kind that has one; `None` where times show parts of a second
/// themselves, or where of each kind no column, or more than one, has such a name and such numbers.
pub(crate) fn added(sheet: &Sheet<'_>, places: &[usize], time_s: &[f64]) -> Option<Finer> {
    let first = time_s.first()?;
    // Differences of times since 1970 are exact to a microsecond.
    let is_whole = |time: &f64| ((time - first) - (time - first).round()).abs() < 1e-5;
    if !time_s.windows(2).any(|pair| pair[0] == pair[1]) || !time_s.iter().all(is_whole) {
        return None;
    }
    let clock = places.first().and_then(|at| sheet.columns.get(*at)).map(|column| column.name.to_ascii_lowercase());
    let elsewhere = (0..sheet.columns.len()).filter(|at| !places.contains(at));
    let those: Vec<(usize, Parts)> =
        elsewhere.filter_map(|at| Some((at, parts(sheet, at, clock.as_deref())?))).collect();
    let only = |kind: &str| {
        let mut of_kind = those.iter().filter(|(_, parts)| parts.of == kind);
        of_kind.next().filter(|_| of_kind.next().is_none())
    };
    let (at, Parts { seconds, of }) = PARTS.iter().find_map(|(_, _, kind)| only(kind))?;
    let time_s = time_s.iter().zip(seconds).map(|(time, part)| time + part).collect();
    Some(Finer { at: *at, time_s, of })
}
