//! Channels of different rates in one file, files whose rate changes, and files that were compressed to be mailed.

#![allow(clippy::unwrap_used, clippy::panic, reason = "the helpers of a test fail by panicking, as the test does")]

use model::rig::Rig;
use proto::recording::{Recording, RecordingError};
use ruzstd::encoding::{CompressionLevel, compress_to_vec};

const HEADER: &str = "time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa";

fn read(bytes: impl AsRef<[u8]>) -> Result<Recording, RecordingError> {
    Recording::parse_for("x.csv", bytes.as_ref(), &Rig::builtin("dual_pressure").unwrap())
}

/// A parabola: what straight lines between its samples leave out is known.
fn pressure(time_s: f64) -> f64 {
    90.0 + 0.5 * time_s * time_s
}

/// Rows `period_ms` apart, a duty that steps in every row, and pressures in one row of `every`, the others `blank`.
fn table(rows: usize, period_ms: f64, every: usize, blank: &str) -> String {
    let line = |k: usize| {
        let t = 1e-3 * period_ms * k as f64;
        let reading = |p: f64| if k.is_multiple_of(every) { format!("{p:.6}") } else { blank.to_owned() };
        let duty = 0.5 + 0.01 * (k % 7) as f64;
        format!("{t:.4},{duty},0.8,{},{}\n", reading(pressure(t)), reading(-pressure(t) + 20.0))
    };
    format!("{HEADER}\n{}", (0..rows).map(line).collect::<String>())
}

#[test]
fn a_sensor_that_is_read_less_often_than_rows_are_written_has_readings_where_it_was_read() {
    for blank in ["", "NaN", "-", "#N/A"] {
        let recording = read(table(400, 20.0, 4, blank)).unwrap_or_else(|error| panic!("{blank:?}: {error}"));
        let [duty, p] = recording.require(["u_pos", "p_pos_kpa"]).unwrap();
        // The last reading stands in row 396.
        assert_eq!((recording.rows(), recording.segments().len()), (397, 1));
        let measured = recording.measured().unwrap();
        for (row, t) in recording.time_s().iter().enumerate() {
            assert_eq!(measured[row], row % 4 == 0, "{row}");
            assert!((duty[row] - 0.5 - 0.01 * (row % 7) as f64).abs() < 1e-9, "commands are those of every row");
            // h²/8 · p'' with h = 80 ms.
            assert!((p[row] - pressure(*t)).abs() < 0.08_f64.powi(2) / 8.0 + 1e-5, "{row}");
        }
        assert!((recording.sampling_s() - 0.08).abs() < 1e-9, "{}", recording.sampling_s());
        let notes = recording.notes().join(" ");
        assert!(notes.contains("read every 80 ms") && notes.contains("nothing faster"), "{notes}");
    }
    // At 100 Hz, rows of 20 ms are made; readings every 50 ms.
    let recording = read(table(1000, 10.0, 5, "")).unwrap();
    let measured = recording.measured().unwrap().iter().filter(|measured| **measured).count();
    assert!((195..=201).contains(&measured), "{measured} of 200 readings");
    assert!((recording.sampling_s() - 0.05).abs() < 1e-9);
}

#[test]
fn a_cell_without_a_number_is_told_and_readings_in_halves_are_an_error() {
    let whole = table(60, 20.0, 1, "");
    let line = whole.lines().nth(5).unwrap();
    for blank in ["", "NaN", "n/a"] {
        let cells: Vec<&str> = line.split(',').collect();
        let without = [cells[0], cells[1], cells[2], blank, cells[4]].join(",");
        let told = read(whole.replace(line, &without)).unwrap().notes().join(" ");
        assert!(told.contains("1 reading of p_pos_kpa is missing (in line 6)"), "{blank}: {told}");
        assert!(told.contains("straight line"), "{blank}: {told}");
    }
    // A sensor that is read in another half of the file than the other is none that a run begins with.
    let halves: String =
        (0..80).map(|k| format!("{},1,1,{}\n", 0.02 * f64::from(k), if k < 40 { "90," } else { ",-70" })).collect();
    let said = read(format!("{HEADER}\n{halves}")).unwrap_err().to_string();
    assert!(said.contains("in other rows than the other sensors"), "{said}");
}

/// 50 Hz, then 10 Hz with the jitter of a tenth of a millisecond: nothing is a gap.
#[test]
fn a_file_whose_rate_falls_to_ten_a_second_is_one_run() {
    let mut text = format!("{HEADER}\n");
    let mut t = 0.0;
    for k in 0..800 {
        let jitter = 1e-4 * f64::from(k % 3);
        text.push_str(&format!("{:.4},0.8,0.8,{:.6},-66\n", t + jitter, pressure(t + jitter)));
        t += if k < 500 { 0.02 } else { 0.1 };
    }
    let recording = read(text).unwrap();
    assert_eq!(recording.segments().len(), 1, "{:?}", recording.notes());
    assert!(recording.notes().join(" ").contains("bridged"), "{:?}", recording.notes());
}

/// One part of a gzip file, with a name in its head.
fn gzip(content: &[u8]) -> Vec<u8> {
    let mut part = b"\x1f\x8b\x08\x08\0\0\0\0\0\x03run.csv\0".to_vec();
    part.extend(miniz_oxide::deflate::compress_to_vec(content, 6));
    part.extend(crc32fast::hash(content).to_le_bytes());
    part.extend((content.len() as u32).to_le_bytes());
    part
}

#[test]
fn compressed_files_are_read_as_what_is_in_them() {
    let text = table(600, 20.0, 1, "");
    let plain = read(&text).unwrap();
    let whole = gzip(text.as_bytes());
    // As logs that are appended to have them, and filled up with zeros.
    let (head, tail) = text.split_at(text.len() / 3);
    let parts = [gzip(head.as_bytes()), gzip(tail.as_bytes()), vec![0; 512]].concat();
    let zstd = compress_to_vec(text.as_bytes(), CompressionLevel::Fastest);
    for (name, bytes) in [("gzip", &whole), ("gzip", &parts), ("zstd", &zstd)] {
        let recording = read(bytes).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(recording.column("p_pos_kpa"), plain.column("p_pos_kpa"), "{name}");
        for cut in [bytes.len() / 2, 40] {
            let said = read(&bytes[..cut]).unwrap_err().to_string();
            assert!(said.contains(name) && said.contains("cut off"), "{cut}: {said}");
        }
    }
    let mut damaged = whole.clone();
    damaged[whole.len() / 2] ^= 0x10;
    assert!(read(&damaged).unwrap_err().to_string().contains("damaged"));
    let others = [(&b"BZh91AY&SY"[..], "bunzip2"), (b"\xfd7zXZ\0\0\x04", "unxz"), (b"\x04\x22\x4d\x18d@", "unlz4")];
    for (magic, tool) in others {
        let said = read(magic).unwrap_err().to_string();
        assert!(said.contains(tool), "{said}");
    }
}
