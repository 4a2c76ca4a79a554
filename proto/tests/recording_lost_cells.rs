//! Rows that a logger had nothing for, and clocks that do not count seconds.

#![allow(clippy::unwrap_used, reason = "the helpers of a test fail by panicking, as the test does")]

use model::rig::Rig;
use proto::recording::{Recording, RecordingError};

const HEADER: &str = "time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa";
const ROWS: usize = 100;

fn with(map: &str) -> Rig {
    let paper = Rig::builtin("dual_pressure").unwrap().to_toml().unwrap();
    Rig::from_toml(&format!("{paper}\n[recording]\n{map}\n")).unwrap()
}

fn read(text: &str, map: &str) -> Result<Recording, RecordingError> {
    Recording::parse_for("x.csv", text.as_bytes(), &with(map))
}

fn cells(k: usize) -> [String; 5] {
    let x = k as f64;
    let numbers =
        [0.02 * x, 0.5 + 0.001 * (k % 100) as f64, 0.6, 90.0 + 0.1 * (0.7 * x).sin(), -60.0 - 0.1 * (0.9 * x).cos()];
    numbers.map(|number| format!("{number:.4}"))
}

/// The table with some cells changed, and some rows left out.
fn table(change: impl Fn(usize, &mut [String; 5]), keep: impl Fn(usize) -> bool) -> String {
    let mut text = format!("{HEADER}\n");
    for k in (0..ROWS).filter(|k| keep(*k)) {
        let mut row = cells(k);
        change(k, &mut row);
        text.push_str(&(row.join(",") + "\n"));
    }
    text
}

/// A blank time or command loses its row, and nothing else; the words are those of lost rows.
#[test]
fn a_blank_cell_is_a_lost_row() {
    let is_lost = |k: usize| matches!(k, 17 | 40 | 41 | 77);
    let lost = read(&table(|_, _| {}, |k| !is_lost(k)), "").unwrap();
    let told = lost.notes().last().unwrap().clone();
    assert!(told.contains("4 rows lost in 3 places (after 0.32, 0.78, 1.52 s) and bridged"), "{told}");
    for column in 0..3 {
        // A line that begins with `#` is a comment.
        for word in ["", "NaN", "---", "n/a", "OL", "#DIV/0!"].into_iter().take(if column == 0 { 5 } else { 6 }) {
            let blank = |k: usize, row: &mut [String; 5]| {
                if is_lost(k) {
                    row[column] = word.to_owned();
                }
            };
            let of = read(&table(blank, |_| true), "").unwrap();
            let names = || lost.names();
            assert!(names().eq(of.names()), "{column} {word}");
            for name in names() {
                assert_eq!(of.column(name), lost.column(name), "{name}: column {column} is `{word}`");
            }
            assert_eq!((of.time_s(), of.measured()), (lost.time_s(), lost.measured()), "{column} {word}");
            assert_eq!(of.notes().last(), Some(&told));
            let name = HEADER.split(',').nth(column).unwrap();
            let first = format!("4 rows have no number in {name} (the first in line 19) and count as lost");
            assert!(of.notes().iter().any(|note| note.contains(&first)), "{:?}", of.notes());
        }
    }
}

/// A blank reading is one reading: what else stands in its row is used, commands first of all, and the cell alone is marked.
#[test]
fn a_blank_reading_is_one_reading_and_no_row() {
    let is_lost = |k: usize| matches!(k, 17 | 40 | 41 | 77);
    let whole = read(&table(|_, _| {}, |_| true), "").unwrap();
    for (column, other) in [(3, 4), (4, 3)] {
        for word in ["", "NaN", "---", "n/a", "OL", "#VALUE!"] {
            let blank = |k: usize, row: &mut [String; 5]| {
                if is_lost(k) {
                    row[column] = word.to_owned();
                }
            };
            let of = read(&table(blank, |_| true), "").unwrap();
            let [name, beside] = [column, other].map(|at| HEADER.split(',').nth(at).unwrap());
            for same in ["u_pos", "u_neg", beside] {
                assert_eq!(of.column(same), whole.column(same), "{same}: {name} is `{word}`");
            }
            assert_eq!((of.time_s(), of.measured(), of.missing(beside)), (whole.time_s(), None, None), "{name} {word}");
            let missing = of.missing(name).unwrap();
            let [values, there] = [&of, &whole].map(|of| of.column(name).unwrap());
            for k in 0..ROWS {
                assert_eq!(missing[k], is_lost(k), "{name} {word} {k}");
                assert!(is_lost(k) || values[k] == there[k], "{name} {word} {k}");
            }
            let third = (values[42] - values[39]) / 3.0;
            assert!((values[40] - values[39] - third).abs() < 1e-9 && (values[41] - values[40] - third).abs() < 1e-9);
            let told = format!("4 readings of {name} are missing (the first in line 19)");
            assert!(of.notes().iter().any(|note| note.contains(&told)), "{:?}", of.notes());
        }
    }
}

/// No run begins at a reading that is not there: the rows before it go, at the beginning and behind a gap.
#[test]
fn a_run_begins_where_every_sensor_was_read() {
    let blank = |k: usize, row: &mut [String; 5]| {
        if k < 12 || (60..63).contains(&k) {
            row[4] = "NaN".to_owned();
        }
    };
    let of = read(&table(blank, |k| !(45..60).contains(&k)), "").unwrap();
    assert_eq!((of.rows(), of.segments()), (70, &[0..33, 33..70][..]));
    let at = |row: usize| (of.time_s()[row] / 0.02).round();
    assert_eq!((at(0), at(33), of.missing("p_neg_kpa")), (12.0, 63.0, None));
    let told = of.notes().join("\n");
    assert!(told.contains("15 readings of p_neg_kpa are missing") && told.contains("15 rows left out"), "{told}");
}

/// A word that does not mean nothing is an error of the file still; a blank stretch is a gap like any other.
#[test]
fn other_text_is_refused_and_a_long_blank_is_a_gap() {
    let typed = |k: usize, row: &mut [String; 5]| {
        if k == 30 {
            row[3] = "9O.1".to_owned();
        }
    };
    let said = read(&table(typed, |_| true), "").unwrap_err().to_string();
    assert!(said.contains("line 32, column 4 (p_pos_kpa): \"9O.1\" is not a number"), "{said}");
    // Without commands a run cannot go on; without one of the readings it can.
    for (column, segments) in [(1, 2), (4, 1)] {
        let blank = |k: usize, row: &mut [String; 5]| {
            if (30..50).contains(&k) {
                row[column] = String::new();
            }
        };
        assert_eq!(read(&table(blank, |_| true), "").unwrap().segments().len(), segments, "{column}");
    }
}

/// Rows at a distance that the map says keep their places where one is blank.
#[test]
fn a_blank_row_keeps_its_time_where_rows_are_counted() {
    let blank = |k: usize, row: &mut [String; 5]| {
        if k == 30 {
            row[4] = "-".to_owned();
        }
    };
    let timed = table(blank, |_| true);
    let text: String = timed.lines().map(|line| line.split_once(',').unwrap().1.to_owned() + "\n").collect();
    let of = read(&text, "period_ms = 20.0").unwrap();
    assert_eq!((of.rows(), of.segments().len()), (ROWS, 1));
    assert!((of.column("u_pos").unwrap()[60] - 0.56).abs() < 1e-9);
}

/// Those rows with a clock of another unit and name.
fn clocked(name: &str, per_s: f64, step_s: f64, rows: usize) -> String {
    let mut text = HEADER.replace("time_s", name) + "\n";
    for k in 0..rows {
        let rest = cells(k)[1..].join(",");
        let time = (1e9 * k as f64 * step_s * per_s).round() / 1e9;
        text.push_str(&format!("{time},{rest}\n"));
    }
    text
}

#[test]
fn the_name_of_a_clock_says_its_unit() {
    for (name, per_s) in [
        ("t [min]", 1.0 / 60.0),
        ("t_min", 1.0 / 60.0),
        ("elapsed_ms", 1e3),
        ("Time (h)", 1.0 / 3600.0),
        ("timestamp_us", 1e6),
    ] {
        let bare = name.split(" [").next().unwrap().split(" (").next().unwrap();
        for map in [String::new(), format!("time = \"{bare}\"")] {
            let of = read(&clocked(name, per_s, 0.02, ROWS), &map).unwrap();
            assert_eq!(of.rows(), ROWS, "{name}, {map}");
            assert!((of.time_s()[50] - 1.0).abs() < 1e-6, "{name}, {map}: {}", of.time_s()[50]);
        }
    }
}

/// A map that names the column without a unit says seconds; where they cannot be, the refusal names the key.
#[test]
fn a_clock_that_does_not_count_seconds_is_refused_with_the_key() {
    for (per_s, step_s, rows, unit) in [
        (1.0 / 60.0, 0.02, 1000, "min"),
        (1.0 / 60.0, 0.1, 600, "min"),
        (1.0 / 60.0, 0.01, 3000, "min"),
        (1.0 / 3600.0, 0.02, 1000, "h"),
        (1e3, 0.02, 1000, "ms"),
        (1e3, 0.001, 8000, "ms"),
        (1e6, 0.02, 1000, "us"),
    ] {
        let text = clocked("t", per_s, step_s, rows);
        let said = read(&text, "time = \"t\"").err().map(|error| error.to_string()).unwrap_or_default();
        let key = format!("[recording] time = {{ from = \"t\", unit = \"{unit}\" }}");
        assert!(said.contains(&key), "{per_s} {step_s}: {said}");
        let of = read(&text, &format!("time = {{ from = \"t\", unit = \"{unit}\" }}")).unwrap();
        let lasts_s = of.time_s().last().unwrap() - of.time_s()[0];
        assert!((lasts_s - step_s * (rows - 1) as f64).abs() < 0.03, "{unit}: {lasts_s}");
    }
    // Seconds at rates that loggers have are seconds.
    for step_s in [0.0001, 0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.1, 0.5, 1.0, 2.0] {
        read(&clocked("t", 1.0, step_s, 1000), "time = \"t\"").unwrap();
    }
}
