//! Remarks on a file's times: what they were taken for, where that may be wrong or is not what the map says.

use model::rig::RecordingMap;

use super::clock_set::{ClockSet, clock_set};
use super::unlikely_times::{DAY_S, may_count_rows};
use crate::recording::csv::numbers::figures;
use crate::recording::csv::toml_text;
use crate::recording::logger_file::sheet::Sheet;
use crate::recording::rows::resample::median_step;

/// Share by which the map's distance of rows may be off that of the times.
const ONE_PERIOD: f64 = 0.05;

/// Notes of a sheet's times, and whether they may be a count of rows; `of_time` are the places of their columns, none where rows are laid
/// out at the map's distance.
pub(crate) fn of_times(
    sheet: &Sheet<'_>,
    map: &RecordingMap,
    of_time: &[usize],
    time_s: &[f64],
) -> (Vec<String>, bool) {
    let title = of_time.first().and_then(|at| sheet.columns.get(*at)).map_or("", |column| column.title.as_str());
    let file = &sheet.file;
    let may_count = !map.names_time() && may_count_rows(sheet, of_time, time_s);
    let counted = may_count.then(|| {
        format!(
            "{file}: {title} has whole numbers, taken as 1 s a row; if they count rows: [recording] time = {{ from = {}, scale = 0.02 }}",
            toml_text(title)
        )
    });
    let step_s = median_step(time_s).unwrap_or(0.0);
    let unused = map.period_ms.filter(|ms| !of_time.is_empty() && (1e-3 * ms / step_s - 1.0).abs() > ONE_PERIOD);
    let unused = unused.map(|ms| {
        format!(
            "{file}: rows are {:.1} ms apart by {title}, and that is taken: [recording] period_ms = {ms} is for files without times that tell rows apart",
            1e3 * step_s
        )
    });
    let set = clock_set(time_s).filter(|_| !of_time.is_empty()).map(|ClockSet { row, gap_s, rest_s }| {
        let line = sheet.lines.get(row).copied().unwrap_or(0);
        format!(
            "{file}: line {line}: {title} goes on by {} in one step, longer than all other rows together ({rest_s:.1} s): if the clock was set \
             there, [recording] period_ms = {:?} in the rig file makes it a short break",
            in_words(gap_s),
            figures(1e3 * step_s, 4)
        )
    });
    (counted.into_iter().chain(unused).chain(set).collect(), may_count)
}

/// A span of an hour or more in words.
fn in_words(span_s: f64) -> String {
    if span_s < 2.0 * DAY_S { format!("{:.1} hours", span_s / 3600.0) } else { format!("{:.0} days", span_s / DAY_S) }
}
