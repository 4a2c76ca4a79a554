//! LabVIEW channels that were sampled at times of their own: each has its own `X0` and `Delta_X`, and its own `Date` and `Time` when it began.
//!
//! Most files give all channels the same. Where two devices or two rates were written together they differ, and the nth cell of a channel
//! was measured at another time than the nth cell of its neighbour in the same row. Without a column of times, and with one, which LabVIEW
//! writes for the first channel alone, each channel's times then come from its head. With a column of times for each (`X_Columns  Multi`)
//! only the clocks do. [`super::own_clocks`] brings the channels together.

use std::borrow::Cow;
use std::ops::Range;

use model::rig::Decimal;

use super::labview::TIME;
use super::labview_units::{ChannelRows, Columns};
use super::logger_text::filled;
use super::sheet::{Cells, Sheet, SheetColumn};
use crate::recording::csv::numbers::parse;
use crate::recording::csv::{CsvError, shown};
use crate::recording::times::timestamps;

/// Share of a step by which channels may begin apart and count as begun together, as devices do that one trigger starts.
const TOGETHER: f64 = 0.01;
/// Time by which they may where no step is said (s): a hundredth of a tick.
const TOGETHER_S: f64 = 2e-4;

/// Place of the clocks in the heads of channels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Clocks {
    /// Times are counted from them (`Time_Pref  Relative`).
    Counted,
    /// Times are counted from an instant of their own (`Time_Pref  Absolute`).
    Aside,
}

/// Times of one channel of a segment as its head says them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ChannelTimes {
    /// Column of the channel in a sheet that begins with one of times.
    column: usize,
    /// Time by which it began later than the first channel, by `X0` and by its clock (s).
    later_s: f64,
    /// `Delta_X` (s).
    step_s: f64,
}

impl<'a> ChannelRows<'a> {
    /// Times of the channels of these names; nothing where they all have the same.
    ///
    /// # Errors
    /// Differing cells of which it is not sure to which channel they belong, or that are no numbers.
    pub(crate) fn times(
        &self,
        file: &str,
        names: &[Cow<'a, str>],
        decimal: Decimal,
        clocks: Clocks,
    ) -> Result<Vec<ChannelTimes>, CsvError> {
        let columns = Columns::of(names);
        let nothing = || vec![0.0; columns.channels.len()];
        let (mut firsts_s, mut steps_s) = (nothing(), nothing());
        if names.iter().filter(|name| *name == TIME).count() < 2 {
            firsts_s = self.numbers(file, "X0", &columns, decimal)?;
            steps_s = self.numbers(file, "Delta_X", &columns, decimal)?;
        }
        let clocks_s = match clocks {
            Clocks::Counted => self.clocks_s(file, &columns)?.unwrap_or_else(nothing),
            Clocks::Aside => nothing(),
        };
        let begun_s: Vec<f64> = firsts_s.iter().zip(clocks_s).map(|(first_s, clock_s)| first_s + clock_s).collect();
        let (Some(begun_first_s), Some(step_first_s)) = (begun_s.first(), steps_s.first()) else {
            return Ok(Vec::new());
        };
        let channels: Vec<ChannelTimes> = (columns.channels.iter().zip(&begun_s).zip(&steps_s))
            .map(|((column, begun_s), step_s)| ChannelTimes {
                column: column + 1 - columns.first,
                later_s: begun_s - begun_first_s,
                step_s: *step_s,
            })
            .collect();
        let together_s = if *step_first_s > 0.0 { TOGETHER * step_first_s } else { TOGETHER_S };
        let is_like_first = |of: &ChannelTimes| of.later_s.abs() <= together_s && of.step_s == *step_first_s;
        Ok(if channels.iter().all(is_like_first) { Vec::new() } else { channels })
    }

    /// Numbers of a row by channel: one that stands alone, or in every cell, is that of all channels, and where nothing readable does, they are
    /// 0.
    fn numbers(&self, file: &str, key: &str, columns: &Columns<'_>, decimal: Decimal) -> Result<Vec<f64>, CsvError> {
        let cells = self.of_channels(file, key, columns)?;
        let numbers: Option<Vec<f64>> = cells.iter().map(|cell| parse(cell, decimal)).collect();
        let unlike = cells.windows(2).any(|pair| pair[0] != pair[1]);
        match (numbers, self.row(key)) {
            (Some(numbers), Some(_)) => Ok(numbers),
            (None, Some((line, row))) if unlike => {
                let none = cells.iter().find(|cell| parse(cell, decimal).is_none()).map_or("", AsRef::as_ref);
                Err(columns.refused(file, *line, row, format!("{} is no number", shown(none))))
            }
            _ => Ok(vec![0.0; columns.channels.len()]),
        }
    }

    /// Times of the clocks of the channels, counted from a common instant (s); `None` where they are no times.
    fn clocks_s(&self, file: &str, columns: &Columns<'_>) -> Result<Option<Vec<f64>>, CsvError> {
        let (dates, times) = (self.of_channels(file, "Date", columns)?, self.of_channels(file, "Time", columns)?);
        let moments: Vec<String> = if dates.is_empty() {
            times.iter().map(ToString::to_string).collect()
        } else {
            dates.iter().zip(&times).map(|(date, time)| format!("{date} {time}")).collect()
        };
        let moments: Vec<&str> = moments.iter().map(String::as_str).collect();
        Ok(timestamps::moments_s(&moments).ok().filter(|times_s| times_s.len() == columns.channels.len()))
    }

    /// Cells of a row by channel: one that stands alone, or in every cell, is that of all channels; none where nothing stands in the row.
    fn of_channels(&self, file: &str, key: &str, columns: &Columns<'_>) -> Result<Vec<Cow<'a, str>>, CsvError> {
        let Some((line, row)) = self.row(key) else { return Ok(Vec::new()) };
        let mut filled = row.iter().skip(1).filter(|cell| !cell.is_empty());
        if let Some(first) = filled.next()
            && filled.all(|cell| cell == first)
        {
            return Ok(vec![first.clone(); columns.channels.len()]);
        }
        let by_column = self.cells(file, key, columns)?.unwrap_or_default();
        let of = |channel: &usize| by_column.get(*channel).filter(|cell| !cell.is_empty()).cloned();
        let cells: Option<Vec<Cow<'a, str>>> = columns.channels.iter().map(of).collect();
        cells.ok_or_else(|| columns.refused(file, *line, row, "not every channel has one".to_owned()))
    }
}

/// Time that a segment of these rows lasts (s), whose first channel has such a step and whose others have times of their own.
pub(crate) fn lasts_s(sheet: &Sheet<'_>, rows: Range<usize>, step_s: f64, channels: &[ChannelTimes]) -> f64 {
    let lasts = |of: &ChannelTimes| of.later_s + of.step_s * samples(sheet, of.column, rows.clone()) as f64;
    channels.iter().map(lasts).reduce(f64::max).unwrap_or(step_s * rows.len() as f64)
}

/// Number of rows up to the last in which a column holds anything.
fn samples(sheet: &Sheet<'_>, column: usize, rows: Range<usize>) -> usize {
    match sheet.columns.get(column).map(|column| &column.cells) {
        Some(Cells::Text(texts)) => texts.get(rows).map_or(0, filled),
        _ => rows.len(),
    }
}

/// Adds to the columns of times, at `times`, how much later the clocks say that the channels behind them began.
pub(crate) fn by_clocks(sheet: &mut Sheet<'_>, times: &[usize], rows: Range<usize>, channels: &[ChannelTimes]) {
    for (at, end) in times.iter().zip(times.iter().skip(1).chain([&usize::MAX])) {
        let Some(channel) = channels.iter().find(|channel| (*at..*end).contains(&channel.column)) else { continue };
        let decimal = sheet.decimal;
        let Some(Cells::Text(texts)) = sheet.columns.get_mut(*at).map(|column| &mut column.cells) else { continue };
        for text in texts.get_mut(rows.clone()).unwrap_or_default() {
            if let Some(time_s) = parse(text, decimal) {
                *text = written(time_s + channel.later_s, decimal);
            }
        }
    }
}

/// A sheet with a column of times before each channel, of one whose first column has those of the first channel alone; each segment has these
/// rows.
pub(crate) fn with_times<'a>(sheet: &Sheet<'a>, segments: &[(Range<usize>, &[ChannelTimes])]) -> Sheet<'a> {
    let Some((first, others)) = sheet.columns.split_first() else { return sheet.clone() };
    let first_s: Vec<Option<f64>> = match &first.cells {
        Cells::Text(texts) => texts.iter().map(|text| parse(text, sheet.decimal)).collect(),
        Cells::Numbers(numbers) => numbers.iter().copied().map(Some).collect(),
    };
    let is_channel = |column: usize| segments.iter().any(|(_, channels)| channels.iter().any(|of| of.column == column));
    let mut columns = Vec::new();
    for (column, of) in (1..).zip(others) {
        if is_channel(column) {
            let mut texts = vec![Cow::Borrowed(""); sheet.rows()];
            for (rows, channels) in segments {
                let filled = samples(sheet, column, rows.clone());
                let times_s = first_s.get(rows.clone()).unwrap_or_default();
                let channel = channels.iter().find(|of| of.column == column);
                for (row, text) in texts.get_mut(rows.clone()).unwrap_or_default().iter_mut().enumerate().take(filled) {
                    if let Some(time_s) = time_s(times_s, row, channel, channels.first()) {
                        *text = written(time_s, sheet.decimal);
                    }
                }
            }
            columns.push(SheetColumn { cells: Cells::Text(texts), ..first.clone() });
        }
        columns.push(of.clone());
    }
    Sheet { columns, ..sheet.clone() }
}

/// Time of a row of a segment (s), whose first channel has these times, for one of its channels.
fn time_s(
    times_s: &[Option<f64>],
    row: usize,
    channel: Option<&ChannelTimes>,
    first: Option<&ChannelTimes>,
) -> Option<f64> {
    let (Some(channel), Some(first)) = (channel, first) else { return *times_s.get(row)? };
    if channel.step_s == first.step_s {
        return times_s.get(row)?.map(|time_s| time_s + channel.later_s);
    }
    let (known, time_s) = times_s.iter().enumerate().find_map(|(row, time_s)| time_s.map(|time_s| (row, time_s)))?;
    Some(time_s - first.step_s * known as f64 + channel.later_s + channel.step_s * row as f64)
}

/// A time as the file's numbers are written.
fn written(time_s: f64, decimal: Decimal) -> Cow<'static, str> {
    let text = time_s.to_string();
    Cow::Owned(if decimal == Decimal::Comma { text.replace('.', ",") } else { text })
}
