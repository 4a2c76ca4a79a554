//! Times that do not go forward, and what helps: sorting where each row has a time of its own, and nothing else where sorted rows of
//! different moments would be mixed.

use crate::recording::csv::numbers::figures;
use crate::recording::csv::{CsvError, TIME_COLUMN};
use crate::recording::logger_file::sheet::Sheet;
use crate::recording::rows::resample::median_step;

/// Share of the rows that have the time of the row before from which times are rounded, and not rows doubled here and there.
const COARSE: f64 = 0.25;
/// Share of the usual step by which sorted rows are apart at least where they are one run.
const APART: f64 = 0.5;

/// Refuses times that do not go forward.
///
/// # Errors
/// The first row whose time is not after that of the row before, with its line and what helps.
pub(super) fn forward(sheet: &Sheet<'_>, column: usize, time_s: &[f64]) -> Result<(), CsvError> {
    let steps = || time_s.windows(2).zip(sheet.lines.iter().skip(1));
    let Some((pair, line)) = steps().find(|(pair, _)| pair[1] <= pair[0]) else { return Ok(()) };
    let (file, position) = (sheet.file.clone(), column + 1);
    let column = sheet.columns.get(column).map_or_else(|| TIME_COLUMN.to_owned(), |column| column.title.clone());
    let repeats = time_s.windows(2).filter(|pair| pair[1] == pair[0]).count();
    if repeats as f64 > COARSE * time_s.len() as f64 {
        return Err(CsvError::CoarseTimes { file, line: *line, position, column, repeats });
    }
    let Some((back, of)) = steps().find(|(pair, _)| pair[1] < pair[0]) else {
        let (value, previous) = (pair[1], pair[0]);
        return Err(CsvError::TimeNotForward { file, line: *line, position, column, value, previous });
    };
    let (line, value, previous) = (*of, back[1], back[0]);
    let mut sorted = time_s.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    let least_s = APART * median_step(&sorted).unwrap_or(0.0);
    if sorted.windows(2).all(|pair| pair[1] - pair[0] > least_s) {
        return Err(CsvError::OutOfOrder { file, line, position, column, value, previous });
    }
    let places = time_s.windows(2).filter(|pair| pair[1] < pair[0]).count();
    let period_ms = figures(1e3 * median_step(time_s).unwrap_or(0.0), 4);
    // Most rows go back: no distance of rows can be told from such times.
    if period_ms <= 0.0 {
        return Err(CsvError::TimeNotForward { file, line, position, column, value, previous });
    }
    Err(CsvError::ClockSetBack { file, line, position, column, value, previous, places, period_ms })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::logger_file::sheet::{Cells, SheetColumn};
    use model::rig::Decimal;

    fn said(time_s: Vec<f64>) -> String {
        let sheet = Sheet {
            file: "a.csv".to_owned(),
            header_line: Some(1),
            lines: (2..).take(time_s.len()).collect(),
            columns: vec![SheetColumn::new("t", Cells::Numbers(time_s.clone()))],
            decimal: Decimal::Point,
            manner: Vec::new(),
            notes: Vec::new(),
        };
        forward(&sheet, 0, &time_s).unwrap_err().to_string()
    }

    #[test]
    fn only_rows_that_are_one_run_when_sorted_are_to_be_sorted() {
        let run = |rows: u32| (0..rows).map(|k| 0.02 * f64::from(k));
        let pairs: Vec<f64> =
            run(100).map(|t| if (t / 0.02).round() % 2.0 == 0.0 { t + 0.02 } else { t - 0.02 }).collect();
        assert!(said(pairs).contains("sort them by t"));
        let second_first: Vec<f64> = run(100).map(|t| t + 50.0).chain(run(100)).collect();
        assert!(said(second_first).contains("sort them by t"));
        // Half a second back, a second run, sixty segments that begin anew.
        let set_back: Vec<f64> = run(200).map(|t| if t < 2.0 { t } else { t - 0.507 }).collect();
        for (times, more) in [
            (set_back, "the row before: the clock"),
            (run(100).chain(run(100)).collect(), "the row before: the clock"),
            ((0..60).flat_map(|_| run(25)).collect(), "and so in 58 further rows"),
        ] {
            let said = said(times);
            assert!(said.contains("period_ms = 20.0") && said.contains(more) && !said.contains("sort"), "{said}");
        }
        let noisy: Vec<f64> = run(100).map(|t| t + 1.9e-8).chain(run(100)).collect();
        assert!(said(noisy).contains("0 s does not come after 1.98 s"));
    }
}
