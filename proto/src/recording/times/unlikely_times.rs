//! Times that are rather in another unit than in the seconds that they are taken for.
//!
//! Where nobody says a unit, steps that only another one explains are refused with the key that says it, and never taken for a slow
//! logger's. A map that names the column of times without a unit says seconds, and is believed where seconds can be. Whole numbers
//! that go on by one count rows, unless the column's name says seconds: then the readings tell, which the trainer asks.

use super::{Said, unit_behind};
use crate::recording::csv::numbers::figures;
use crate::recording::csv::{TIME_COLUMN, toml_text};
use crate::recording::logger_file::sheet::Sheet;
use crate::recording::recording_error::RecordingError;
use crate::recording::rows::resample::median_step;
use crate::recording::table::rules::time_hint;

/// Samples further apart than this (s) are refused: a pump moves a chamber within seconds, and a rate so slow is mostly
/// milliseconds taken for seconds.
pub(crate) const MOST_STEP_S: f64 = 5.0;
/// No logger of a pneumatic rig is faster (s between samples); smaller steps are those of another unit.
const LEAST_STEP_S: f64 = 2e-6;
/// … and most are slower than this, which tells the unit that is meant (s).
const LEAST_LIKELY_STEP_S: f64 = 1e-3;
/// Rows that a unit puts closer than this (s) in a file that it makes shorter than that (s) are in another.
const QUICKEST_S: f64 = 1e-4;
const OVER_AT_ONCE_S: f64 = 1.0;
/// s of a day.
pub(crate) const DAY_S: f64 = 86_400.0;

/// Refuses steps that only another unit explains.
pub(crate) fn plausible(sheet: &Sheet<'_>, places: &[usize], time_s: &[f64], said: Said) -> Result<(), RecordingError> {
    let Some(step_s) = median_step(time_s).filter(|step| *step > 0.0) else { return Ok(()) };
    let title =
        places.first().and_then(|at| sheet.columns.get(*at)).map_or(TIME_COLUMN, |column| column.title.as_str());
    // A key goes by the rig's own name where the file has it, whatever unit stands behind it there.
    let is_own = sheet.find(TIME_COLUMN).is_ok_and(|own| own.is_some() && own.as_ref() == places.first());
    let title = if is_own { TIME_COLUMN } else { title };
    let quoted = toml_text(title);
    let key = |unit: &str| format!("[recording] time = {{ from = {quoted}, unit = \"{unit}\" }}");
    let another = |mend: String| {
        Err(RecordingError::TimeUnit {
            file: sheet.file.clone(),
            median_ms: figures(1e3 * step_s, 3),
            mend: format!("{title} {mend}"),
            column: title.to_owned(),
        })
    };
    if let Said::Unit(s) = said {
        if step_s > MOST_STEP_S {
            return Err(too_sparse(sheet, title, (step_s, s)));
        }
        if !is_too_quick(time_s, step_s, s) {
            return Ok(());
        }
        return Err(RecordingError::Unit {
            file: sheet.file.clone(),
            column: title.to_owned(),
            problem: format!(
                "by the unit that is said of it rows are {} ms apart, which no logger of a rig does; the numbers seem to be s as they stand: {}",
                figures(1e3 * step_s, 3),
                key("s")
            ),
        });
    }
    // A map or a name that says seconds is no wonder of a row a second, and nothing but whole numbers counts.
    let counts = said == Said::Nothing && go_on_by_one(time_s) && !says_seconds(sheet, places);
    if let Some(hint) = time_hint(step_s).filter(|hint| counts || !hint.contains("rows")) {
        let key = match unit_of(hint) {
            Some(unit) => key(unit),
            None => {
                format!("[recording] time = {{ from = {quoted}, scale = 0.02 }}, or unit = \"s\" if these are seconds")
            }
        };
        return another(format!("seems to {hint}, or say what it is in the rig file: {key}"));
    }
    if step_s < LEAST_STEP_S {
        let larger = [("min", 60.0), ("h", 3600.0), ("days", DAY_S)];
        let likely =
            larger.into_iter().find(|(_, s)| step_s * s >= LEAST_LIKELY_STEP_S).map_or("days", |(unit, _)| unit);
        return another(format!("seems to be in {likely}: say so in the rig file, {}", key(likely)));
    }
    if step_s > MOST_STEP_S {
        return Err(too_sparse(sheet, title, (step_s, 1.0)));
    }
    match unlikely(time_s, step_s) {
        Some(unit) => another(format!(
            "seems to be in {unit}: say so in the rig file, {}, or unit = \"s\" if these are seconds",
            key(unit)
        )),
        None => Ok(()),
    }
}

/// Tells whether times that were taken for seconds may be a count of rows: whole numbers that go on by one, and nothing but the name of
/// their column says seconds.
pub(crate) fn may_count_rows(sheet: &Sheet<'_>, places: &[usize], time_s: &[f64]) -> bool {
    says_seconds(sheet, places) && go_on_by_one(time_s)
}

/// Tells whether the only column of times has seconds in its name, and no unit beside it.
fn says_seconds(sheet: &Sheet<'_>, places: &[usize]) -> bool {
    let [at] = places else { return false };
    sheet.columns.get(*at).is_some_and(|column| column.unit.is_none() && unit_behind(&column.name) == Some(1.0))
}

/// Tells whether all times are whole numbers, most of them one behind another: rows may be lost.
fn go_on_by_one(time_s: &[f64]) -> bool {
    median_step(time_s) == Some(1.0) && time_s.iter().all(|time| time.fract() == 0.0)
}

/// Tells whether rows that were brought to seconds by a unit of so many (s) are closer than loggers write them, in a file that is over at
/// once, and as far apart as loggers are set to where the numbers are seconds as they stand.
fn is_too_quick(time_s: &[f64], step_s: f64, unit_s: f64) -> bool {
    let lasts_s = time_s.first().zip(time_s.last()).map_or(0.0, |(first, last)| last - first);
    unit_s < 1.0 && step_s < QUICKEST_S && lasts_s < OVER_AT_ONCE_S && is_usual(step_s / unit_s)
}

/// The error of samples so far apart (s) by a unit of so many (s).
fn too_sparse(sheet: &Sheet<'_>, title: &str, (step_s, unit_s): (f64, f64)) -> RecordingError {
    let smaller = [("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)];
    let written = step_s / unit_s;
    let likely = smaller.into_iter().find(|(_, s)| written * s <= MOST_STEP_S).map_or("ns", |(unit, _)| unit);
    let quoted = toml_text(title);
    RecordingError::TooSparse {
        file: sheet.file.clone(),
        column: title.to_owned(),
        step_s: (step_s * 1e3).round() / 1e3,
        most_s: MOST_STEP_S,
        mend: format!(
            "{title} seems to be in {likely}: say so in the rig file, [recording] time = {{ from = {quoted}, unit = \"{likely}\" }}"
        ),
    }
}

/// Distances that loggers are set to (s).
const USUAL_STEPS_S: [f64; 14] =
    [1e-3, 2e-3, 4e-3, 5e-3, 8e-3, 1e-2, 1.25e-2, 1.6e-2, 2e-2, 2.5e-2, 4e-2, 5e-2, 0.1, 0.2];
/// Share by which a distance may be off one of those.
const USUAL_WITHIN: f64 = 5e-3;
/// Whatever lasts longer than this (s) is not minutes taken for seconds: nobody records a pump for an hour at such a rate.
const SHORT_S: f64 = 60.0;
/// Samples a second or more apart for longer than this (s), all at whole numbers, are milliseconds: two hours of a logger that is quicker.
const LONG_S: f64 = 7200.0;
/// Steps that may be milliseconds of a quick logger (s).
const QUICK_IN_MS: f64 = 1.0;

/// Tells whether loggers are set to such a distance (s).
fn is_usual(step_s: f64) -> bool {
    USUAL_STEPS_S.iter().any(|usual| (step_s / usual - 1.0).abs() <= USUAL_WITHIN)
}

/// The unit that times are rather in than in seconds: at a distance that no logger is set to, and that is one in this unit; or whole
/// numbers that go on for hours.
fn unlikely(time_s: &[f64], step_s: f64) -> Option<&'static str> {
    let lasts_s = time_s.first().zip(time_s.last()).map_or(0.0, |(first, last)| last - first);
    let is_set = is_usual(step_s) || is_usual(10.0 * step_s) || is_usual(100.0 * step_s);
    if lasts_s < SHORT_S && !is_set {
        return [("min", 60.0), ("h", 3600.0)].into_iter().find(|(_, s)| is_usual(s * step_s)).map(|(unit, _)| unit);
    }
    let is_whole = || time_s.iter().all(|time| time.fract() == 0.0);
    (step_s >= QUICK_IN_MS && lasts_s > LONG_S && is_whole()).then_some("ms")
}

/// The unit that a hint is about; `None` where it is about rows.
fn unit_of(hint: &str) -> Option<&'static str> {
    let units = [("milli", "ms"), ("micro", "us"), ("nano", "ns"), ("minutes", "min"), ("hours", "h")];
    units.into_iter().find(|(word, _)| hint.contains(word)).map(|(_, unit)| unit)
}
