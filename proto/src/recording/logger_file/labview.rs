//! LabVIEW measurement files (`.lvm`), as the Write To Measurement File VI writes them.
//!
//! A header of `key<separator>value` lines says separator, decimal mark and how many columns of times there are; each segment repeats a
//! head with the channels' units ([`super::labview_units`]), the clock when it began and, where there is no column of times, first time and
//! step. Rows follow a line of names that begins with `X_Value`; without a column of times that name may be blank or absent. Segments with
//! the same names are one recording: times go on from segment to segment where `X0` does; where each begins at the same `X0`, its clock
//! says when; where that stands still as well, rows follow each other. Columns of times that begin anew in each segment are put in order by
//! the same clocks ([`super::labview_segments`]). Channels may have times of their own within a segment ([`super::labview_channels`]).

use std::borrow::Cow;
use std::ops::Range;

use model::rig::{Decimal, RecordingMap, Separator};

use super::labview_channels::{self, ChannelTimes, Clocks};
use super::labview_segments::{self, SetBack};
use super::labview_units::ChannelRows;
use super::logger_text::{LastRow, Row, fill, filled, next};
use super::sheet::{Cells, Sheet, SheetColumn, is_data};
use super::table_head::Head;
use super::{own_clocks, second_header};
use crate::recording::csv::CsvError;
use crate::recording::csv::cells::{Comments, Grammar, Rows};
use crate::recording::times::timestamps;

/// First words of such a file.
const MAGIC: &str = "LabVIEW Measurement";
/// First cell of the line that ends a head.
const END_OF_HEADER: &str = "***End_of_Header***";
/// Name of a column of times.
pub(crate) const TIME: &str = "X_Value";

/// Tells whether a text is a LabVIEW measurement file.
pub(crate) fn is_measurement(text: &str) -> bool {
    text.trim_start().starts_with(MAGIC)
}

/// Tells whether columns of this first name begin with one of times.
pub(crate) fn has_times(first: &str) -> bool {
    first.is_empty() || first == TIME
}

/// Times of a segment as its head says them.
#[derive(Debug, Clone, Default, PartialEq)]
struct Segment {
    /// Line of its names: its rows stand behind it.
    line: u64,
    /// `X0` and `Delta_X`, where there is no column of times (s).
    first_s: f64,
    step_s: f64,
    /// `Date` and `Time` when it began, as written.
    clock: [String; 2],
    /// Times of its channels, where they are not all the same.
    channels: Vec<ChannelTimes>,
}

/// Reads such a file.
///
/// # Errors
/// No names, no rows, ragged rows, units at no channel, one column of times per channel whose times cannot be brought together.
pub(crate) fn sheet<'a>(file: &str, text: &'a str, map: &RecordingMap) -> Result<Sheet<'a>, CsvError> {
    let separator = map.separator.unwrap_or(match value_of(text, "Separator") {
        Some("Comma") => Separator::Comma,
        _ => Separator::Tab,
    });
    let decimal = map.decimal.unwrap_or(match value_of(text, "Decimal_Separator") {
        Some(",") => Decimal::Comma,
        _ => Decimal::Point,
    });
    let clocks = match value_of(text, "Time_Pref") {
        Some("Absolute") => Clocks::Aside,
        _ => Clocks::Counted,
    };
    let grammar = Grammar { separator, comments: Comments::No };
    let mut walk = Rows::with(text.as_bytes(), grammar);
    let (mut cells, mut rows): (_, Vec<Row<'a>>) = (Vec::new(), Vec::new());
    let mut head = Head::default();
    let mut channel_rows = ChannelRows::default();
    let (mut in_head, mut segment, mut segments) = (true, Segment::default(), Vec::new());
    // The line behind a segment's head has the names, whatever stands over the times: nothing does where the file has none.
    let (mut of_segment, mut names_follow) = (false, false);
    while let Some((line, row)) = next(file, &mut walk, &mut cells)? {
        if in_head {
            channel_rows.take(line, &row);
        }
        let first = row.first().map_or("", AsRef::as_ref);
        let are_names = names_follow && filled(&row) > 0 && row.iter().all(|cell| !is_data(cell, decimal));
        names_follow = false;
        match first {
            MAGIC | "Channels" => {
                in_head = true;
                of_segment = first != MAGIC;
            }
            "X0" | "Delta_X" | "Date" | "Time" if in_head => {
                segment.takes(first, row.get(1).map_or("", AsRef::as_ref), decimal);
            }
            END_OF_HEADER => names_follow = in_head && of_segment,
            _ if first == TIME || are_names => {
                in_head = false;
                segment.line = line;
                segment.channels = channel_rows.times(file, &row, decimal, clocks)?;
                segments.push(segment.clone());
                let units = channel_rows.units(file, &row)?;
                if head.line.is_none() {
                    head.line = Some(line);
                    head.names = row.iter().map(ToString::to_string).collect();
                    head.units = units;
                } else if row.iter().map(AsRef::as_ref).ne(head.names.iter().map(String::as_str)) {
                    let names: Vec<&str> = head.names.iter().map(String::as_str).collect();
                    return Err(second_header::another(file, line, &row, &names));
                } else if units != head.units {
                    let first: Vec<&str> = head.units.iter().map(AsRef::as_ref).collect();
                    return Err(second_header::another(file, line, &units, &first));
                }
            }
            _ if !in_head => rows.push((line, row)),
            _ => {}
        }
    }
    if head.line.is_none() {
        return Err(CsvError::MissingColumn {
            file: file.to_owned(),
            line: None,
            column: TIME.to_owned(),
            found: "no names behind the heads of its segments; write the file with names, or as CSV".to_owned(),
        });
    }
    let has_times = head.names.first().is_some_and(|name| has_times(name));
    if let Some(name) = head.names.first_mut().filter(|name| name.is_empty()) {
        TIME.clone_into(name);
    }
    if has_times {
        // The units of the head are those of the channels.
        head.units.splice(..head.units.len().min(1), [Cow::Borrowed("s")]);
    }
    let mut sheet = Sheet {
        file: file.to_owned(),
        header_line: head.line,
        columns: Vec::new(),
        lines: Vec::new(),
        decimal,
        manner: vec!["the head of a LabVIEW measurement file".to_owned()],
        notes: Vec::new(),
    };
    if decimal == Decimal::Comma {
        sheet.manner.push("decimal commas".to_owned());
    }
    if segments.len() > 1 {
        sheet.manner.push(format!("{} segments", segments.len()));
    }
    let last = if text.ends_with('\n') { LastRow::Whole } else { LastRow::MayBeCut };
    fill(&mut sheet, (&head, &[]), &rows, last)?;
    if !has_times {
        let cells = Cells::Text(vec![Cow::Borrowed(""); sheet.rows()]);
        sheet.columns.insert(0, SheetColumn { unit: Some("s".to_owned()), ..SheetColumn::new(TIME, cells) });
    }
    timed(&mut sheet, &segments)?;
    Ok(sheet)
}

/// The value behind a key of the header.
fn value_of<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    text.lines()
        .take_while(|line| !line.starts_with(END_OF_HEADER))
        .find_map(|line| line.strip_prefix(key)?.strip_prefix(['\t', ',']).map(str::trim))
}

impl Segment {
    /// Takes a line of a head; a number that is none says nothing.
    fn takes(&mut self, key: &str, value: &str, decimal: Decimal) {
        let number = crate::recording::csv::numbers::parse(value, decimal);
        match (key, number) {
            ("X0", Some(number)) => self.first_s = number,
            ("Delta_X", Some(number)) => self.step_s = number,
            ("Date", _) => self.clock[0] = value.to_owned(),
            ("Time", _) => self.clock[1] = value.to_owned(),
            _ => {}
        }
    }
}

/// Times of the first rows of segments (s), which last so long.
fn begun_s(segments: &[Segment], lasts_s: &[f64]) -> Result<Vec<f64>, SetBack> {
    let first = segments.first().map_or(0.0, |segment| segment.first_s);
    if segments.iter().any(|segment| segment.first_s != first) {
        return Ok(segments.iter().map(|segment| segment.first_s).collect());
    }
    let clocks_s = clocks_s(segments);
    if clocks_s.windows(2).any(|pair| pair[0] != pair[1]) {
        let ends = clocks_s.iter().zip(lasts_s).map(|(begun, lasts)| begun + lasts);
        let early = ends.zip(clocks_s.iter().skip(1)).map(|(end, next)| end - next);
        if let Some(set_back) = early.zip(1..).find_map(|(early_s, next)| SetBack::of(next, early_s, &clocks_s)) {
            return Err(set_back);
        }
        let begun = clocks_s.first().copied().unwrap_or(0.0);
        return Ok(clocks_s.iter().map(|clock| first + clock - begun).collect());
    }
    let mut at = first;
    let each = lasts_s.iter().map(|lasts_s| {
        let begun = at;
        at += lasts_s;
        begun
    });
    Ok(each.collect())
}

/// When segments began by the clock in their heads (s); none where one of them is no time.
fn clocks_s(segments: &[Segment]) -> Vec<f64> {
    let clocks: Vec<String> = segments.iter().map(|segment| segment.clock.join(" ")).collect();
    let clocks: Vec<&str> = clocks.iter().map(String::as_str).collect();
    timestamps::moments_s(&clocks).unwrap_or_default()
}

/// The error of a segment whose clock was set back.
fn set_back(file: &str, segments: &[Segment], of: SetBack) -> CsvError {
    let segment = segments.get(of.segment);
    CsvError::SegmentClock {
        file: file.to_owned(),
        line: segment.map_or(1, |segment| segment.line),
        clock: segment.map_or_else(String::new, |segment| segment.clock.join(" ")),
        early_s: of.early_s,
        mend: if of.may_be_summer_time() { " (as at the end of summer time)" } else { "" },
    }
}

/// First rows of segments, and the number of all rows behind them.
fn bounds(lines: &[u64], segments: &[Segment]) -> Vec<usize> {
    let row_at = |segment: &Segment| lines.partition_point(|line| *line < segment.line);
    segments.iter().map(row_at).chain([lines.len()]).collect()
}

/// Times by row where the file has no column of them (s): those of the first channel.
fn steps_of(sheet: &Sheet<'_>, segments: &[Segment], bounds: &[usize]) -> Result<Vec<f64>, SetBack> {
    let spans = || bounds.windows(2).map(|pair| pair[0]..pair[1]);
    let lasts_s: Vec<f64> = (segments.iter().zip(spans()))
        .map(|(segment, rows)| labview_channels::lasts_s(sheet, rows, segment.step_s, &segment.channels))
        .collect();
    let begun = begun_s(segments, &lasts_s)?;
    let of = |((segment, begun), rows): ((&Segment, f64), Range<usize>)| {
        (0..rows.len()).map(move |row| begun + segment.step_s * row as f64).collect::<Vec<_>>()
    };
    Ok(segments.iter().zip(begun).zip(spans()).flat_map(of).collect())
}

/// Makes the one column of times: from `X0` and `Delta_X` where it is empty; the first of several that are alike; the finest where
/// channels have rates of their own.
fn timed(sheet: &mut Sheet<'_>, segments: &[Segment]) -> Result<(), CsvError> {
    let times_of = |sheet: &Sheet<'_>| -> Vec<usize> {
        let is_time = |at: &usize| sheet.columns.get(*at).is_some_and(|column| column.title == TIME);
        (0..sheet.columns.len()).filter(is_time).collect()
    };
    let mut times = times_of(sheet);
    let Some(first) = times.first().copied() else { return Ok(()) };
    let empty = |column: &SheetColumn<'_>| match &column.cells {
        Cells::Text(texts) => texts.iter().all(|text| text.is_empty()),
        Cells::Numbers(_) => false,
    };
    let bounds = bounds(&sheet.lines, segments);
    if sheet.columns.get(first).is_some_and(empty) {
        let step_s = segments.first().map_or(0.0, |segment| segment.step_s);
        let numbers = steps_of(sheet, segments, &bounds).map_err(|of| set_back(&sheet.file, segments, of))?;
        if let Some(column) = sheet.columns.get_mut(first) {
            column.cells = Cells::Numbers(numbers);
        }
        sheet.manner.push(format!("times from X0 and Delta_X = {step_s} s"));
    } else {
        labview_segments::put_in_order(sheet, &times, &bounds, &clocks_s(segments))
            .map_err(|of| set_back(&sheet.file, segments, of))?;
    }
    let spans = || bounds.windows(2).map(|pair| pair[0]..pair[1]);
    let has_one = times.len() == 1;
    if segments.iter().any(|segment| !segment.channels.is_empty()) {
        sheet.manner.push("times of each channel as its own head says".to_owned());
        if has_one {
            let channels = segments.iter().map(|segment| segment.channels.as_slice());
            *sheet = labview_channels::with_times(sheet, &spans().zip(channels).collect::<Vec<_>>());
            times = times_of(sheet);
        } else {
            for (segment, rows) in segments.iter().zip(spans()) {
                labview_channels::by_clocks(sheet, &times, rows, &segment.channels);
            }
        }
    }
    let cells = |at: usize| sheet.columns.get(at).map(|column| &column.cells);
    let others: Vec<usize> = times.iter().copied().skip(1).filter(|other| cells(*other) != cells(first)).collect();
    if let Some(other) = others.first() {
        // The columns of times that heads made are not in the file: its channel is.
        let made = times.iter().position(|at| at == other).filter(|_| has_one);
        return match own_clocks::joined(sheet, &times) {
            Some(joined) => {
                *sheet = joined;
                Ok(())
            }
            None => Err(CsvError::SeveralTimes {
                file: sheet.file.clone(),
                line: sheet.header_line.unwrap_or(1),
                position: made.map_or(other + 1, |before| other + 2 - before),
            }),
        };
    }
    for other in times.into_iter().skip(1).rev() {
        sheet.columns.remove(other);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file of two segments of three rows, without a column of times.
    fn begins(x0: [f64; 2], clock: [&str; 2]) -> Vec<f64> {
        let head = "LabVIEW Measurement\t\nSeparator\tTab\nX_Columns\tNo\nDate\t2026/03/29\nTime\t01:59:59.98\n***End_of_Header***\t\n\t\n";
        let segment = |at: usize| {
            let (x0, clock) = (x0[at], clock[at]);
            format!(
                "Channels\t1\nSamples\t3\nDate\t2026/03/29\nTime\t{clock}\nX0\t{x0}\nDelta_X\t0.02\n***End_of_Header***\t\n\
                 X_Value\tp\tComment\n\t1.0\n\t2.0\n\t3.0\n"
            )
        };
        let text = format!("{head}{}{}", segment(0), segment(1));
        let sheet = sheet("a.lvm", &text, &RecordingMap::default()).unwrap();
        sheet.numbers(0).unwrap()
    }

    #[test]
    fn segments_begin_when_they_say() {
        let same = ["10:00:00.00", "10:00:00.00"];
        let near = |found: Vec<f64>, expected: [f64; 2]| {
            let expected: Vec<f64> = expected.iter().flat_map(|at| [*at, at + 0.02, at + 0.04]).collect();
            assert!(found.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-9), "{found:?} {expected:?}");
            assert_eq!(found.len(), expected.len());
        };
        // X0 goes on; the clock does; neither does.
        near(begins([1.0, 4.5], same), [1.0, 4.5]);
        near(begins([0.0, 0.0], ["10:00:00.00", "10:00:07.50"]), [0.0, 7.5]);
        near(begins([0.0, 0.0], same), [0.0, 0.06]);
    }

    #[test]
    fn names_without_one_for_the_times_are_names() {
        let head = "LabVIEW Measurement\t\nSeparator\tTab\nX_Columns\tNo\n***End_of_Header***\t\n\t\n\
                    Channels\t2\nSamples\t3\t3\nX0\t1.5\t1.5\nDelta_X\t0.02\t0.02\n***End_of_Header***\t\t\n";
        for rows in
            ["\tu\tp\tComment\n\t0.5\t1.0\n\t0.5\t2.0\n\t0.5\t3.0\n", "u\tp\tComment\n0.5\t1.0\n0.5\t2.0\n0.5\t3.0\n"]
        {
            let text = format!("{head}{rows}");
            let sheet = sheet("a.lvm", &text, &RecordingMap::default()).unwrap();
            let at = |name: &str| sheet.numbers(sheet.find(name).unwrap().unwrap()).unwrap();
            assert_eq!((at("X_Value"), at("u"), at("p")), (vec![1.5, 1.52, 1.54], vec![0.5; 3], vec![1.0, 2.0, 3.0]));
        }
    }
}
