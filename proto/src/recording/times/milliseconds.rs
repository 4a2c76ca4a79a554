//! Milliseconds in a column of their own, beside a clock that shows whole seconds.

use crate::recording::logger_file::sheet::Sheet;

/// Names that such columns go by.
const NAMES: [&str; 10] =
    ["ms", "msec", "msecs", "millisec", "millitm", "millis", "milli", "millisecond", "milliseconds", "millisekunden"];

/// Tells whether a column, by its name and its numbers, holds the milliseconds of another clock's second: they begin anew.
pub(crate) fn are_of_a_second(sheet: &Sheet<'_>, at: usize) -> bool {
    let goes_back = |ms: &[f64]| ms.windows(2).any(|pair| pair[1] < pair[0]);
    whole_milliseconds(sheet, at).is_some_and(|ms| goes_back(&ms))
}

/// Numbers of a column that has such a name and nothing but whole numbers below a thousand.
fn whole_milliseconds(sheet: &Sheet<'_>, at: usize) -> Option<Vec<f64>> {
    let name = &sheet.columns.get(at)?.name;
    let numbers = NAMES.iter().any(|known| name.eq_ignore_ascii_case(known)).then(|| sheet.numbers(at).ok())??;
    numbers.iter().all(|x| x.fract() == 0.0 && (0.0..1000.0).contains(x)).then_some(numbers)
}

/// Times with the milliseconds of another column added, and its place; `None` where times show parts of a second themselves, or no
/// column, or more than one, has that name and whole numbers below a thousand.
pub(crate) fn added(sheet: &Sheet<'_>, places: &[usize], time_s: &[f64]) -> Option<(usize, Vec<f64>)> {
    let first = time_s.first()?;
    // Differences of times since 1970 are exact to a microsecond.
    let is_whole = |time: &f64| ((time - first) - (time - first).round()).abs() < 1e-5;
    if !time_s.windows(2).any(|pair| pair[0] == pair[1]) || !time_s.iter().all(is_whole) {
        return None;
    }
    let elsewhere = (0..sheet.columns.len()).filter(|at| !places.contains(at));
    let mut those = elsewhere.filter_map(|at| Some((at, whole_milliseconds(sheet, at)?)));
    let (at, ms) = those.next()?;
    let finer = time_s.iter().zip(ms).map(|(time, ms)| time + 1e-3 * ms).collect();
    those.next().is_none().then_some((at, finer))
}
