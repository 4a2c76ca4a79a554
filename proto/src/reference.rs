//! Reference files: where the pressures are to go, over time.
//!
//! CSV with the header `time_s,ref_pos_kpa,ref_neg_kpa` (gauge kPa); other columns are ignored, so
//! a recording that holds references can be flown again. Between rows the reference runs straight
//! from one to the next, so a coarse file is a ramp and not a staircase. A step is two rows with
//! the same time: up to that time the first counts, from it on the second. Before the first row
//! the first holds, after the last row the last.
//!
//! Left out: splines (they overshoot what the file says) and repetition (the file ends, its last
//! row holds).

use std::path::Path;

use crate::fnv1a::fnv1a;
use crate::recording::csv::{self, Column, ColumnData, CsvError, Table};
use crate::regular_file;

/// The largest reference file that is read, in bytes: an hour at 50 Hz is 5 MB.
pub const MOST_BYTES: u64 = 32 << 20;
/// The columns of a reference file, besides `time_s`.
const COLUMNS: [&str; 2] = ["ref_pos_kpa", "ref_neg_kpa"];
/// Absolute vacuum as gauge pressure (kPa): no reference lies below it.
const VACUUM_KPA: f64 = -101.325;
/// No sensor of this rig reads higher (kPa gauge).
const SENSOR_TOP_KPA: f64 = 1000.0;

/// A reference for both channels over time.
#[derive(Debug, Clone, PartialEq)]
pub struct Reference {
    time_s: Vec<f64>,
    // Positive and negative side by side: one lookup reads both.
    kpa: Vec<[f64; 2]>,
    identity: u64,
}

/// Problem of a reference.
#[derive(Debug, thiserror::Error)]
pub enum ReferenceError {
    /// The file cannot be read.
    #[error("{file}: cannot read the reference: {source}")]
    Read {
        /// The file.
        file: String,
        /// Error of the system.
        source: std::io::Error,
    },
    /// The file's content is wrong.
    #[error(transparent)]
    Csv(#[from] CsvError),
    /// More than two rows share a time.
    #[error(
        "{file}: line {line}, column {position} (time_s): {time_s} s stands a third time; two rows with one time are a step, three are a mistake"
    )]
    TripleTime {
        /// The file.
        file: String,
        /// Line, from 1.
        line: u64,
        /// Column, from 1.
        position: usize,
        /// The repeated time (s).
        time_s: f64,
    },
}

impl Reference {
    /// Reads a reference file.
    ///
    /// # Errors
    /// The file cannot be read, or its content is wrong: see [`Reference::parse`].
    pub fn read(path: &Path) -> Result<Self, ReferenceError> {
        let file = path.display().to_string();
        let bytes = regular_file::read(path, MOST_BYTES)
            .map_err(|source| ReferenceError::Read { file: file.clone(), source })?;
        Self::parse(&file, &bytes)
    }

    /// Parses the bytes of a reference file; `file` is the name that errors carry.
    ///
    /// # Errors
    /// A missing column, NaN, text, ragged rows, an empty file, time going back or standing at one
    /// value for more than two rows, a pressure below vacuum or above 1,000 kPa.
    pub fn parse(file: &str, bytes: &[u8]) -> Result<Self, ReferenceError> {
        let table = Table::parse(file, bytes, &COLUMNS)?;
        let [pos, neg] = COLUMNS.map(|name| table.numbers(name));
        let (Some(pos), Some(neg)) = (pos, neg) else {
            let column = if pos.is_none() { COLUMNS[0] } else { COLUMNS[1] };
            let names = table.columns.iter().map(|column| column.name.as_str());
            return Err(CsvError::MissingColumn {
                file: file.to_owned(),
                line: Some(1),
                column: column.to_owned(),
                found: csv::listed(std::iter::once(csv::TIME_COLUMN).chain(names)),
            }
            .into());
        };
        check_times(file, &table)?;
        for (name, values) in COLUMNS.iter().zip([pos, neg]) {
            for (value, line) in values.iter().zip(&table.lines) {
                if !(VACUUM_KPA..=SENSOR_TOP_KPA).contains(value) {
                    return Err(CsvError::OutOfRange {
                        file: file.to_owned(),
                        line: *line,
                        position: table.position(name).unwrap_or(0),
                        column: (*name).to_owned(),
                        value: *value,
                        low: VACUUM_KPA,
                        high: SENSOR_TOP_KPA,
                        hint: " kPa; references are gauge pressures".to_owned(),
                    }
                    .into());
                }
            }
        }
        let kpa = pos.iter().zip(neg).map(|(pos, neg)| [*pos, *neg]).collect();
        Ok(Self::of(table.time_s, kpa))
    }

    /// The paper's test reference: 60 s in 20 ms rows.
    ///
    /// ```text
    /// positive:  80 + 20 t/60 + 6 sin(2π t/8)    kPa
    /// negative: −70 −  5 t/60 + 3 sin(2π t/10)   kPa
    /// ```
    pub fn paper() -> Self {
        use std::f64::consts::TAU;
        const ROWS: u32 = 3_001;
        const LENGTH_S: f64 = 60.0;
        // k / 50 rounds once; k · 0.02 would carry the error of 0.02 and read 0.06 as 0.060000…5.
        let time_s: Vec<f64> = (0..ROWS).map(|k| f64::from(k) / 50.0).collect();
        let kpa = time_s
            .iter()
            .map(|t| {
                [
                    80.0 + 20.0 * t / LENGTH_S + 6.0 * (TAU * t / 8.0).sin(),
                    -70.0 - 5.0 * t / LENGTH_S + 3.0 * (TAU * t / 10.0).sin(),
                ]
            })
            .collect();
        Self::of(time_s, kpa)
    }

    /// A reference that never moves.
    pub fn constant(pos_kpa: f64, neg_kpa: f64) -> Self {
        Self::of(vec![0.0], vec![[pos_kpa, neg_kpa]])
    }

    fn of(time_s: Vec<f64>, kpa: Vec<[f64; 2]>) -> Self {
        let numbers = time_s.iter().chain(kpa.as_flattened());
        let bytes = numbers.flat_map(|number| number.to_bits().to_le_bytes());
        let identity = fnv1a(bytes.map(u64::from));
        Self { time_s, kpa, identity }
    }

    /// Number that a reference with the same rows has as well: FNV-1a of 64 bits (Fowler, Noll, Vo) over all of them.
    ///
    /// # Real-time
    /// Was worked out when the reference was made; may run in the tick.
    pub fn identity(&self) -> u64 {
        self.identity
    }

    /// Positive and negative reference at a time since the reference started (kPa gauge).
    ///
    /// Straight lines between rows; the first row before it, the last row after it; a NaN time
    /// reads the first row.
    ///
    /// # Real-time
    /// Allocates nothing; a binary search, 12 steps for the paper's 3,001 rows.
    pub fn at(&self, time_s: f64) -> [f64; 2] {
        // Rows at or before now. `<=` makes a step count from its own time on.
        let passed = self.time_s.partition_point(|row| *row <= time_s);
        let before = passed.checked_sub(1).and_then(|row| self.row(row));
        match (before, self.row(passed)) {
            (Some((t0, a)), Some((t1, b))) => {
                let share = (time_s - t0) / (t1 - t0);
                [a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])]
            }
            (Some((_, row)), None) | (None, Some((_, row))) => row,
            // A reference has at least one row: every constructor sees to it.
            (None, None) => [f64::NAN; 2],
        }
    }

    /// Time of the last row (s): from here on the reference holds.
    pub fn end_s(&self) -> f64 {
        self.time_s.last().copied().unwrap_or(0.0)
    }

    /// Least and largest value per channel: `[[pos low, pos high], [neg low, neg high]]` (kPa gauge).
    pub fn range_kpa(&self) -> [[f64; 2]; 2] {
        let mut range = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        for row in &self.kpa {
            for (range, value) in range.iter_mut().zip(row) {
                *range = [range[0].min(*value), range[1].max(*value)];
            }
        }
        range
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.time_s.len()
    }

    /// The reference as a file that [`Reference::parse`] reads back bit for bit.
    pub fn to_csv(&self) -> String {
        let column = |name: &str, index: usize| Column {
            name: name.to_owned(),
            data: ColumnData::Numbers(self.kpa.iter().filter_map(|row| row.get(index)).copied().collect()),
        };
        csv::to_csv(&self.time_s, &[column(COLUMNS[0], 0), column(COLUMNS[1], 1)])
    }

    fn row(&self, index: usize) -> Option<(f64, [f64; 2])> {
        Some((*self.time_s.get(index)?, *self.kpa.get(index)?))
    }
}

/// Time goes forward, or stands for exactly two rows.
fn check_times(file: &str, table: &Table) -> Result<(), ReferenceError> {
    let rows = table.time_s.iter().zip(&table.lines);
    let mut previous: Option<f64> = None;
    let mut standing = 0;
    for (time, line) in rows {
        match previous {
            Some(before) if *time < before => {
                return Err(CsvError::TimeNotForward {
                    file: file.to_owned(),
                    line: *line,
                    position: table.time_position,
                    column: csv::TIME_COLUMN.to_owned(),
                    value: *time,
                    previous: before,
                }
                .into());
            }
            Some(before) if *time == before => standing += 1,
            _ => standing = 0,
        }
        if standing > 1 {
            return Err(ReferenceError::TripleTime {
                file: file.to_owned(),
                line: *line,
                position: table.time_position,
                time_s: *time,
            });
        }
        previous = Some(*time);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn parse(text: &str) -> Result<Reference, ReferenceError> {
        Reference::parse("ref.csv", text.as_bytes())
    }

    fn error(text: &str) -> String {
        let message = parse(text).unwrap_err().to_string();
        assert!(message.starts_with("ref.csv: ") && !message.contains('\n'), "{message}");
        message
    }

    #[test]
    fn the_same_rows_have_the_same_identity() {
        let paper = Reference::paper();
        let read_back = Reference::parse("paper.csv", paper.to_csv().as_bytes()).unwrap();
        assert_eq!(paper.identity(), read_back.identity());
        let constants =
            [(85.0, -71.0), (85.0, -71.1), (-71.0, 85.0)].map(|(pos, neg)| Reference::constant(pos, neg).identity());
        assert!(constants.iter().all(|identity| *identity != paper.identity()));
        assert!(constants[0] != constants[1] && constants[0] != constants[2], "{constants:?}");
    }

    #[test]
    fn it_runs_straight_between_rows_and_holds_at_both_ends() {
        let reference = parse("time_s,ref_pos_kpa,ref_neg_kpa\n1,80,-70\n3,100,-74\n").unwrap();
        assert_eq!(reference.at(-5.0), [80.0, -70.0]);
        assert_eq!(reference.at(1.0), [80.0, -70.0]);
        assert_eq!(reference.at(1.5), [85.0, -71.0]);
        assert_eq!(reference.at(3.0), [100.0, -74.0]);
        assert_eq!(reference.at(1e9), [100.0, -74.0]);
        assert_eq!(reference.at(f64::INFINITY), [100.0, -74.0]);
        assert_eq!(reference.at(f64::NAN), [80.0, -70.0]);
        assert_eq!((reference.end_s(), reference.rows()), (3.0, 2));
        assert_eq!(reference.range_kpa(), [[80.0, 100.0], [-74.0, -70.0]]);
    }

    #[test]
    fn two_rows_with_one_time_are_a_step() {
        let text = "time_s,ref_pos_kpa,ref_neg_kpa\n0,80,-70\n5,80,-70\n5,100,-75\n9,100,-75\n";
        let reference = parse(text).unwrap();
        assert_eq!(reference.at(4.999), [80.0, -70.0]);
        assert_eq!(reference.at(5.0), [100.0, -75.0]);
        assert_eq!(reference.at(5.001), [100.0, -75.0]);
    }

    #[test]
    fn bad_files_are_named_with_line_and_column() {
        let header = "time_s,ref_pos_kpa,ref_neg_kpa";
        assert_eq!(
            error("time_s,ref_pos_kpa\n0,80\n"),
            "ref.csv: line 1: column ref_neg_kpa is missing; there are time_s,ref_pos_kpa"
        );
        assert_eq!(
            error(&format!("{header}\n0,80,-70\n1,x,-70\n")),
            "ref.csv: line 3, column 2 (ref_pos_kpa): \"x\" is not a number"
        );
        assert!(error(&format!("{header}\n0,80,-70\n2,80,-70\n1,80,-70\n")).contains("line 4, column 1 (time_s): 1 s"));
        assert!(
            error(&format!("{header}\n1,80,-70\n1,81,-70\n1,82,-70\n"))
                .contains("line 4, column 1 (time_s): 1 s stands a third time")
        );
        assert_eq!(
            error(&format!("{header}\n0,80,-7000\n")),
            "ref.csv: line 2, column 3 (ref_neg_kpa): -7000 is outside -101.325 … 1000 kPa; references are gauge pressures"
        );
        let missing = Reference::read(Path::new("no/such.csv")).unwrap_err().to_string();
        assert!(missing.starts_with("no/such.csv: cannot read the reference: "), "{missing}");
    }

    #[test]
    fn other_columns_are_ignored_so_a_recording_can_be_flown_again() {
        let text = "time_s,u_pos,ref_neg_kpa,note,ref_pos_kpa\n0,2,-70,hello,80\n";
        assert_eq!(parse(text).unwrap().at(0.0), [80.0, -70.0]);
    }

    #[test]
    fn the_papers_reference_is_what_the_paper_says() {
        let paper = Reference::paper();
        assert_eq!((paper.rows(), paper.end_s()), (3_001, 60.0));
        let near = |at: f64, pos: f64, neg: f64| {
            let [p, n] = paper.at(at);
            // Formula and table agree to rounding; the pressures are of order 100.
            assert!((p - pos).abs() < 1e-9 && (n - neg).abs() < 1e-9, "{at}: {p} {n}");
        };
        near(0.0, 80.0, -70.0);
        // A quarter of 8 s: the sine is 1; 2 s of 60 of the ramp.
        let s = (std::f64::consts::TAU * 0.2).sin();
        near(2.0, 80.0 + 20.0 / 30.0 + 6.0, -70.0 - 5.0 / 30.0 + 3.0 * s);
        // 60 s are 7.5 periods of 8 s and 6 of 10 s: both sines are 0.
        near(60.0, 100.0, -75.0);
        near(75.0, 100.0, -75.0);
    }

    #[test]
    fn the_file_form_comes_back_bit_for_bit() {
        let paper = Reference::paper();
        let text = paper.to_csv();
        assert!(text.starts_with("time_s,ref_pos_kpa,ref_neg_kpa\n0,80,-70\n0.02,"));
        assert_eq!(parse(&text).unwrap(), paper);
    }

    proptest! {
        #[test]
        fn it_never_leaves_the_range_of_its_rows(
            steps in proptest::collection::vec((0.0_f64..3.0, -100.0_f64..900.0, -100.0_f64..900.0), 1..20),
            at in -1.0_f64..60.0,
        ) {
            let mut text = String::from("time_s,ref_pos_kpa,ref_neg_kpa\n");
            let mut time_s = 0.0;
            for (step, pos, neg) in steps {
                // Never zero, so that no time stands three times.
                time_s += step + 1e-6;
                text.push_str(&format!("{time_s},{pos},{neg}\n"));
            }
            let reference = parse(&text).unwrap();
            for (value, [low, high]) in reference.at(at).into_iter().zip(reference.range_kpa()) {
                // Interpolation rounds: one part in 2^52 of values below 1,000.
                prop_assert!(value >= low - 1e-9 && value <= high + 1e-9, "{value} {low} {high}");
            }
        }
    }
}
