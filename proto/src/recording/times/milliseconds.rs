//! Milliseconds in a column of their own, beside a clock that shows whole seconds.

use crate::recording::logger_file::sheet::Sheet;

/// Names that such columns go by.
const NAMES: [&str; 7] = ["ms", "msec", "millis", "milli", "millisecond", "milliseconds", "millisekunden"];

/// Times with the milliseconds of another column added, and its place; `None` where times show parts of a second themselves, or no
/// column, or more than one, has that name and whole numbers below a thousand.
pub(crate) fn added(sheet: &Sheet<'_>, places: &[usize], time_s: &[f64]) -> Option<(usize, Vec<f64>)> {
    let first = time_s.first()?;
    // Differences of times since 1970 are exact to a microsecond.
    let is_whole = |time: &f64| ((time - first) - (time - first).round()).abs() < 1e-5;
    if !time_s.windows(2).any(|pair| pair[0] == pair[1]) || !time_s.iter().all(is_whole) {
        return None;
    }
    let below_a_thousand = |x: &f64| x.fract() == 0.0 && (0.0..1000.0).contains(x);
    let of = |at: usize| {
        let name = &sheet.columns.get(at).filter(|_| !places.contains(&at))?.name;
        let numbers = NAMES.iter().any(|known| name.eq_ignore_ascii_case(known)).then(|| sheet.numbers(at).ok())??;
        numbers.iter().all(below_a_thousand).then_some((at, numbers))
    };
    let mut those = (0..sheet.columns.len()).filter_map(of);
    let (at, ms) = those.next()?;
    let finer = time_s.iter().zip(ms).map(|(time, ms)| time + 1e-3 * ms).collect();
    those.next().is_none().then_some((at, finer))
}
