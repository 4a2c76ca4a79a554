//! Channels with rates of their own: a column of times before each, as LabVIEW writes with `X_Columns  Multi`, or as two loggers' columns that
//! somebody put side by side.
//!
//! The times of the fastest channel become those of the rows. A sample of a slower one goes into the row that is nearest to it, and the
//! other rows have blank cells there, as a logger writes a sensor that it reads less often: what that means for a command and for a reading
//! is then decided as for any other file ([`crate::recording::rows::slower`]).

use std::borrow::Cow;

use super::sheet::{Cells, Sheet, SheetColumn};
use crate::recording::csv::numbers::{parse, says_nothing};

/// A column of times, and the places of the columns that belong to it: those behind it up to the next, and those before the first.
struct Channel {
    /// Line by line where there is one: its row in the file and its time (s).
    samples: Vec<(usize, f64)>,
    columns: std::ops::Range<usize>,
}

/// The sheet with the times of its fastest channel alone, under the name of the first. `None` where a cell of a time is no number or
/// times do not go forward, so that no row is nearest; where the fastest channel has fewer than two rows; and where a column holds numbers
/// ([`Cells::Numbers`]) and no text.
pub(crate) fn joined<'a>(sheet: &Sheet<'a>, times: &[usize]) -> Option<Sheet<'a>> {
    let ends = times.iter().copied().skip(1).chain([sheet.columns.len()]);
    let channels: Option<Vec<Channel>> =
        times.iter().zip(ends).map(|(at, end)| Channel::of(sheet, *at, at + 1..end)).collect();
    let channels = channels?;
    let first = sheet.columns.get(*times.first()?)?;
    // Of several that are as fast the first.
    let fastest = channels.iter().enumerate().max_by_key(|(at, of)| (of.samples.len(), std::cmp::Reverse(*at)))?.0;
    let rows = &channels.get(fastest)?.samples;
    if rows.len() < 2 {
        return None;
    }
    let mut joined = Sheet { columns: Vec::new(), ..sheet.clone() };
    joined.lines = rows.iter().filter_map(|(row, _)| sheet.lines.get(*row)).copied().collect();
    for column in sheet.columns.get(..*times.first()?).unwrap_or_default() {
        joined.columns.push(channels.first()?.brought(column, rows)?);
    }
    for (channel, at) in channels.iter().zip(times) {
        if *at == *times.get(fastest)? {
            let cells = Cells::Numbers(rows.iter().map(|(_, time_s)| *time_s).collect());
            joined.columns.push(SheetColumn { cells, ..first.clone() });
        }
        for column in sheet.columns.get(channel.columns.clone()).unwrap_or_default() {
            joined.columns.push(channel.brought(column, rows)?);
        }
    }
    let rates = channels.iter().filter(|channel| channel.samples.len() < rows.len()).count();
    let titles: Vec<&str> = times.iter().filter_map(|at| sheet.columns.get(*at)).map(|of| of.title.as_str()).collect();
    let differ = titles.windows(2).any(|pair| pair[0] != pair[1]);
    let named = if differ { format!(" ({})", titles.join(", ")) } else { String::new() };
    joined.manner.push(format!(
        "{} columns of times{named}, {rates} of them slower, whose samples go to the nearest row of the fastest",
        times.len()
    ));
    Some(joined)
}

impl Channel {
    fn of(sheet: &Sheet<'_>, at: usize, columns: std::ops::Range<usize>) -> Option<Self> {
        let Cells::Text(texts) = &sheet.columns.get(at)?.cells else { return None };
        let filled = texts.iter().enumerate().filter(|(_, text)| !says_nothing(text));
        let samples: Option<Vec<(usize, f64)>> = filled
            .map(|(row, text)| Some((row, parse(text, sheet.decimal).filter(|time_s| time_s.is_finite())?)))
            .collect();
        let samples = samples.filter(|samples| samples.windows(2).all(|pair| pair[1].1 > pair[0].1))?;
        Some(Channel { samples, columns })
    }

    /// A column of this channel, each of its samples in the row of these that is nearest to it.
    fn brought<'a>(&self, column: &SheetColumn<'a>, rows: &[(usize, f64)]) -> Option<SheetColumn<'a>> {
        let Cells::Text(texts) = &column.cells else { return None };
        let mut brought = vec![Cow::Borrowed(""); rows.len()];
        for (row, time_s) in &self.samples {
            if let Some(slot) = nearest(rows, *time_s).and_then(|at| brought.get_mut(at)) {
                slot.clone_from(texts.get(*row)?);
            }
        }
        Some(SheetColumn { cells: Cells::Text(brought), ..column.clone() })
    }
}

/// The row nearest to a time; `None` for a time further outside all rows than half the step at that end, for which a further row would be
/// the nearest, and for one within a pause that is further from both its ends than rows are apart.
fn nearest(rows: &[(usize, f64)], time_s: f64) -> Option<usize> {
    let at = |row: usize| rows.get(row).map(|(_, time_s)| *time_s);
    let last = rows.len().checked_sub(1)?;
    let behind = rows.partition_point(|(_, of)| *of < time_s);
    let off = |row: usize| at(row).map_or(f64::INFINITY, |of| (of - time_s).abs());
    let nearest = behind.checked_sub(1).filter(|before| off(*before) <= off(behind)).unwrap_or(behind);
    let most = if time_s < at(0)? {
        (at(1)? - at(0)?) / 2.0
    } else if time_s > at(last)? {
        (at(last)? - at(last.checked_sub(1)?)?) / 2.0
    } else {
        (at(last)? - at(0)?) / last as f64
    };
    (off(nearest) <= most).then_some(nearest)
}

#[cfg(test)]
mod tests {
    use crate::recording::logger_file::labview;
    use model::rig::RecordingMap;

    /// A pressure every 20 ms, a command every 100 ms, and times of the second that lie beside the first's.
    #[test]
    fn channels_of_two_rates_stand_in_the_rows_of_the_faster() {
        let mut text = "LabVIEW Measurement\t\nSeparator\tTab\nX_Columns\tMulti\n***End_of_Header***\t\n\t\n\
                        Channels\t2\nY_Unit_Label\tVolts\t\tkPa\n***End_of_Header***\t\n\
                        X_Value\tu\tX_Value\tp\tComment\n"
            .to_owned();
        for k in 0..100 {
            let command =
                if k < 20 { format!("{:.3}\t{}", 0.1 * f64::from(k) + 0.004, k % 2) } else { "\t".to_owned() };
            text += &format!("{command}\t{:.2}\t{k}.5\n", 0.02 * f64::from(k));
        }
        let sheet = labview::sheet("a.lvm", &text, &RecordingMap::default()).unwrap();
        let names: Vec<&str> = sheet.columns.iter().map(|column| column.name.as_str()).collect();
        assert_eq!(names, ["u", "X_Value", "p", "Comment"]);
        assert_eq!(sheet.columns[2].unit.as_deref(), Some("kPa"));
        assert_eq!(sheet.numbers(1).unwrap()[99], 1.98);
        assert_eq!(sheet.numbers(2).unwrap()[99], 99.5);
        let super::Cells::Text(commands) = &sheet.columns[0].cells else { panic!("{sheet:?}") };
        let written: Vec<usize> = (0..100).filter(|row| !commands[*row].is_empty()).collect();
        assert_eq!(written, (0..20).map(|k| 5 * k).collect::<Vec<_>>());
        assert_eq!((&*commands[0], &*commands[5]), ("0", "1"));
        // Times that go back say of no row when it was.
        assert!(labview::sheet("a.lvm", &text.replace("1.98\t99.5", "0.50\t99.5"), &RecordingMap::default()).is_err());
    }

    /// Two clocks of one step, the second of which begins a step before the first and ends a step behind it: for its first and last sample the
    /// first clock has no row, and they must not take the place of what was read at its ends. Half a step outside is still nearest to
    /// an end.
    #[test]
    fn a_sample_a_step_outside_the_other_clock_belongs_to_none_of_its_rows() {
        let brought = |shift_s: f64| {
            let mut text = "LabVIEW Measurement\t\nSeparator\tTab\nX_Columns\tMulti\n***End_of_Header***\t\n\t\n\
                            Channels\t2\n***End_of_Header***\t\nX_Value\tp\tX_Value\tu\tComment\n"
                .to_owned();
            for k in 0..60 {
                // 40 samples every 20 ms, from 8 to 8.8 s; the first clock has 60 rows, from 8.02 to 9.2 s.
                let second =
                    if k < 40 { format!("{:.3}\t{k}", 8.0 + shift_s + 0.02 * f64::from(k)) } else { "\t".into() };
                text += &format!("{:.3}\t5\t{second}\n", 8.02 + 0.02 * f64::from(k));
            }
            let sheet = labview::sheet("a.lvm", &text, &RecordingMap::default()).unwrap();
            let at = sheet.find("u").unwrap().unwrap();
            let super::Cells::Text(texts) = &sheet.columns[at].cells else { panic!("{sheet:?}") };
            texts.iter().map(ToString::to_string).collect::<Vec<_>>()
        };
        assert_eq!(brought(0.0)[..3], ["1", "2", "3"], "its first sample is a step before the first row");
        assert_eq!(brought(0.012)[..3], ["0", "1", "2"], "8 ms before the first row, nearer to it than to any other");
        // The last three samples are 0, 20 and 40 ms behind the last row.
        let behind = brought(0.46);
        assert_eq!(behind[59], "37", "{behind:?}");
    }
}
