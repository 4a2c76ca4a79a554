//! LabVIEW segments whose times begin anew in each: every press of a button, or every call of the writing program, starts at nought again.
//!
//! Each segment's head says when it began (`Date`, `Time`). Where these clocks put the segments one behind another, times are counted from
//! the first segment's begin. Where they do not, times stay as they are and the reader refuses them: rows of different segments must never
//! be mixed. A clock that was set back by more than a minute, as at the end of summer time, is refused here: nobody knows how long the
//! pause was.

use std::borrow::Cow;

use super::sheet::{Cells, Sheet};
use crate::recording::csv::numbers::parse;
use crate::recording::rows::resample::median_step;

/// Steps by which a segment may begin too early by its clock, which the program reads when it comes to it.
const EARLY_STEPS: f64 = 2.0;
/// A segment that begins longer than this before the one before it ends has a clock that was set back (s): programs are late by less.
const SET_BACK_S: f64 = 60.0;
/// Seconds that a clock is set back by at the end of summer time, and one for the reading of it.
const SUMMER_TIME_S: f64 = 3601.0;

/// A segment that its clock puts before the end of the one before.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SetBack {
    /// Place of the segment, from 0.
    pub(crate) segment: usize,
    /// Time by which it begins too early (s).
    pub(crate) early_s: f64,
}

impl SetBack {
    /// The segment at this place, where it begins too early by so much and its clock has moved since the one before.
    pub(crate) fn of(segment: usize, early_s: f64, clocks_s: &[f64]) -> Option<Self> {
        let before = segment.checked_sub(1).and_then(|before| clocks_s.get(before));
        let has_moved = before.is_some() && before != clocks_s.get(segment);
        (has_moved && early_s > SET_BACK_S).then_some(SetBack { segment, early_s })
    }

    /// Tells whether summer time may have ended in between.
    pub(crate) fn may_be_summer_time(self) -> bool {
        self.early_s <= SUMMER_TIME_S
    }
}

/// Brings columns of times that begin anew to one course; `bounds` are the first rows of the segments and the end of the last, `clocks_s`
/// the times when they began.
///
/// # Errors
/// A segment whose clock was set back.
pub(crate) fn put_in_order(
    sheet: &mut Sheet<'_>,
    times: &[usize],
    bounds: &[usize],
    clocks_s: &[f64],
) -> Result<(), SetBack> {
    let Some(begun_s) = begun(sheet, times, bounds, clocks_s)? else { return Ok(()) };
    for at in times {
        let decimal = sheet.decimal;
        let Some(Cells::Text(texts)) = sheet.columns.get_mut(*at).map(|column| &mut column.cells) else { continue };
        for (span, begun_s) in bounds.windows(2).zip(&begun_s) {
            for text in texts.get_mut(span[0]..span[1]).unwrap_or_default() {
                if let Some(time_s) = parse(text, decimal) {
                    *text = Cow::Owned((time_s + begun_s).to_string());
                }
            }
        }
    }
    sheet.manner.push("times that begin anew in each segment counted from its clock".to_owned());
    Ok(())
}

/// Seconds to add to the times of each segment; `None` where times go on as they are, or where clocks do not say it.
fn begun(sheet: &Sheet<'_>, times: &[usize], bounds: &[usize], clocks_s: &[f64]) -> Result<Option<Vec<f64>>, SetBack> {
    let segments: Option<Vec<[f64; 2]>> = bounds.windows(2).map(|span| ends(sheet, times, span[0]..span[1])).collect();
    let Some(segments) = segments else { return Ok(None) };
    if segments.windows(2).all(|pair| pair[1][0] > pair[0][1]) || clocks_s.len() != segments.len() {
        return Ok(None);
    }
    let step_s = bounds.windows(2).find_map(|span| {
        let column = times.first().and_then(|at| numbers(sheet, *at, span[0]..span[1]));
        median_step(&column?)
    });
    let (Some(step_s), Some(first_s)) = (step_s, clocks_s.first()) else { return Ok(None) };
    let mut begun = Vec::with_capacity(segments.len());
    let mut before = f64::NEG_INFINITY;
    for (segment, ([first, last], clock_s)) in segments.iter().zip(clocks_s).enumerate() {
        let by_clock = clock_s - first_s;
        let early = before + step_s - (first + by_clock);
        if let Some(set_back) = SetBack::of(segment, early, clocks_s) {
            return Err(set_back);
        }
        if early > EARLY_STEPS * step_s {
            return Ok(None);
        }
        let by_clock = if first + by_clock > before { by_clock } else { by_clock + early };
        begun.push(by_clock);
        before = last + by_clock;
    }
    Ok(Some(begun))
}

/// The first and the last time in some rows, of all columns of times; `None` where there is none.
fn ends(sheet: &Sheet<'_>, times: &[usize], rows: std::ops::Range<usize>) -> Option<[f64; 2]> {
    let mut ends: Option<[f64; 2]> = None;
    for at in times {
        let numbers = numbers(sheet, *at, rows.clone())?;
        let (first, last) = (*numbers.first()?, *numbers.last()?);
        ends = Some(ends.map_or([first, last], |[least, most]| [least.min(first), most.max(last)]));
    }
    ends
}

/// The times that stand in some rows of a column; `None` where a cell is neither a number nor blank.
fn numbers(sheet: &Sheet<'_>, column: usize, rows: std::ops::Range<usize>) -> Option<Vec<f64>> {
    let Cells::Text(texts) = &sheet.columns.get(column)?.cells else { return None };
    let texts = texts.get(rows)?.iter().filter(|text| !text.is_empty());
    texts.map(|text| parse(text, sheet.decimal)).collect()
}

#[cfg(test)]
mod tests {
    use crate::recording::logger_file::labview;
    use model::rig::RecordingMap;

    /// Segments of three rows that begin at 0 each, with one column of times or one before each channel.
    fn times(columns: &str, clocks: &[&str]) -> Vec<f64> {
        let mut text =
            format!("LabVIEW Measurement\t\nSeparator\tTab\nX_Columns\t{columns}\n***End_of_Header***\t\n\t\n");
        for clock in clocks {
            text += &format!(
                "Channels\t2\nDate\t2026/05/01\nTime\t{clock}\nX0\t0.0\nDelta_X\t0.02\n***End_of_Header***\t\n"
            );
            text += if columns == "One" { "X_Value\tu\tp\tComment\n" } else { "X_Value\tu\tX_Value\tp\tComment\n" };
            for k in 0..3 {
                let time = format!("{:.6}", 0.02 * f64::from(k));
                let second = if columns == "One" { String::new() } else { format!("\t{time}") };
                text += &format!("{time}\t0.5{second}\t{k}\n");
            }
        }
        let sheet = labview::sheet("a.lvm", &text, &RecordingMap::default()).unwrap();
        sheet.numbers(0).unwrap()
    }

    #[test]
    fn segments_that_begin_anew_stand_at_their_own_times() {
        for columns in ["One", "Multi"] {
            let found = times(columns, &["12:00:00.000000", "12:00:00.060000", "12:00:07.500000"]);
            let expected: Vec<f64> = [0.0, 0.06, 7.5].iter().flat_map(|t| [*t, t + 0.02, t + 0.04]).collect();
            assert!(found.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-6), "{columns}: {found:?}");
        }
    }

    #[test]
    fn a_clock_that_is_a_little_early_moves_its_segment_and_one_that_stands_still_none() {
        let found = times("One", &["12:00:00.000", "12:00:00.035", "12:00:00.120"]);
        assert!(found.windows(2).all(|pair| pair[1] > pair[0]), "{found:?}");
        assert!((found[6] - 0.12).abs() < 1e-6, "it does not add up: {found:?}");
        let still = times("One", &["12:00:00", "12:00:00", "12:00:00"]);
        assert_eq!(still[3], 0.0, "{still:?}");
    }
}
