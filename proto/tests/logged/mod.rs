//! A table as a logger writes it, and the reading of it, for the tests of files that other programs wrote.

// Each test program uses its own part of this.
#![allow(dead_code, unreachable_pub, clippy::unwrap_used)]

use model::rig::Rig;
use proto::recording::{Recording, RecordingError};

/// Names of the columns as the daemon has them.
pub const HEADER: &str = "time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa";
/// Rows of a table.
pub const ROWS: usize = 60;

/// A number that moves and repeats itself nowhere, with four digits.
pub fn wave(row: usize, speed: f64) -> f64 {
    ((row as f64 * speed).sin() * 1e4).round() / 1e4
}

/// Duties and pressures of a row.
pub fn row(k: usize) -> [f64; 4] {
    [0.7 + 0.1 * wave(k, 0.3), 0.8 + 0.1 * wave(k, 0.2), 90.0 + wave(k, 0.7), -66.0 + wave(k, 0.9)]
}

/// Cells of these numbers, with five digits.
pub fn cells(k: usize) -> [String; 4] {
    row(k).map(|x| format!("{x:.5}"))
}

/// A table of all rows, with its head, the time before a row's four numbers, and what stands between them and behind.
pub fn table(head: &str, time: impl Fn(usize) -> String, separator: &str, decimal: &str, end: &str) -> String {
    let mut text = head.to_owned();
    for k in 0..ROWS {
        let cells = cells(k).map(|cell| cell.replace('.', decimal));
        text.push_str(&format!("{}{separator}{}{end}\n", time(k), cells.join(separator)));
    }
    text
}

/// Time of a row (s).
pub fn seconds(k: usize) -> String {
    format!("{:.2}", 0.02 * k as f64)
}

/// The paper's rig.
pub fn paper() -> Rig {
    Rig::builtin("dual_pressure").unwrap()
}

/// The paper's rig with a `[recording]` table.
pub fn with(table: &str) -> Rig {
    Rig::from_toml(&format!("{}\n[recording]\n{table}\n", paper().to_toml().unwrap())).unwrap()
}

/// Reads a file for a rig.
pub fn read(bytes: impl AsRef<[u8]>, rig: &Rig) -> Result<Recording, RecordingError> {
    Recording::parse_for("x.csv", bytes.as_ref(), rig)
}

/// The line that a file is refused with.
pub fn refused(bytes: impl AsRef<[u8]>, rig: &Rig) -> String {
    let said = read(bytes, rig).unwrap_err().to_string();
    assert!(said.starts_with("x.csv: ") && !said.contains('\n'), "{said}");
    said
}

/// Checks that every row is there, bit for bit what five digits say.
#[track_caller]
pub fn assert_whole(recording: &Recording, what: &str) {
    assert_eq!((recording.rows(), recording.segments().len()), (ROWS, 1), "{what}: {:?}", recording.notes());
    assert_eq!(recording.measured(), None, "{what}");
    let columns = recording.require(["u_pos", "u_neg", "p_pos_kpa", "p_neg_kpa"]).unwrap();
    for k in 0..ROWS {
        for (column, expected) in columns.iter().zip(row(k)) {
            assert!((column[k] - expected).abs() < 6e-6, "{what}: row {k}: {} for {expected}", column[k]);
        }
        assert!((recording.time_s()[k] - recording.time_s()[0] - 0.02 * k as f64).abs() < 2e-6, "{what}: row {k}");
    }
}
