//! Other writings of loggers that are not plain: current loops, commands written where they change, rows that stand twice, times of writing,
//! markers for no reading.

#![allow(clippy::unwrap_used, reason = "the helpers of a test fail by panicking, as the test does")]

use model::rig::Rig;
use proto::recording::{Recording, RecordingError};

const RIG: &str = r#"
format = 1
name = "line"
[gas]
gas_constant_j_per_kg_k = 287.0
heat_capacity_ratio = 1.4
[atmosphere]
pressure_kpa_abs = 101.325
temperature_k = 293.15
[volumes.line]
volume_l = 0.1
temperature_k = 293.15
[pumps.pump]
kind = "flow"
outlet = "line"
command = "u"
flow_l_per_min = 2.0
[sources.meter]
kind = "flow"
to = "line"
flow_l_per_min = 1.0
signal = "q"
[sensors.sensor]
volume = "line"
column = "p_kpa"
range_kpa_gauge = [0.0, 100.0]
range_v = [0.0, 5.0]
"#;

/// Reads a text with a map of these lines.
fn read_with(map: &str, text: &str) -> Result<Recording, RecordingError> {
    let rig = Rig::from_toml(&format!("{}[recording]\n{map}", RIG)).unwrap();
    Recording::parse_for("x.csv", text.as_bytes(), &rig)
}

#[test]
fn current_loops_and_units_behind_strokes_are_read() {
    let text = "time / ms,u / %,q,p_kpa in mA\n0,50,1,4\n20,50,1,12\n40,50,1,20\n";
    let recording = read_with("", text).unwrap();
    assert_eq!(recording.column("p_kpa").unwrap(), [0.0, 50.0, 100.0]);
    assert_eq!(recording.column("u").unwrap(), [0.5; 3]);
    assert!((recording.time_s()[2] - 0.04).abs() < 1e-12);
}

#[test]
fn commands_are_held_where_their_cells_are_blank() {
    let rows: String = (0..60)
        .map(|k| format!("{},{},1,5\n", 0.02 * f64::from(k), if k % 20 == 3 { k.to_string() } else { String::new() }))
        .collect();
    let recording =
        read_with("columns.u = { from = \"u\", scale = 0.01 }", &format!("time_s,u,q,p_kpa\n{rows}")).unwrap();
    let u = recording.column("u").unwrap();
    assert_eq!([u[0], u[3], u[22], u[23], u[59]], [0.03, 0.03, 0.03, 0.23, 0.43]);
    assert!(recording.notes().iter().any(|note| note.contains("u held where")), "{:?}", recording.notes());
}

#[test]
fn rows_that_stand_twice_are_passed_over_and_told() {
    let row = |k: u32| format!("{},0.5,1,{}\n", 0.02 * f64::from(k), 5 + k % 3);
    let twice: String = (0..40).map(|k| row(k) + &row(k)).collect();
    let recording = read_with("", &format!("time_s,u,q,p_kpa\n{twice}")).unwrap();
    assert_eq!(recording.rows(), 40);
    assert!(recording.notes()[0].contains("40 rows are the row before") && recording.notes()[0].contains("line 3"));
    // Without a column that counts on, alike rows are readings that stand still.
    let still = format!("u,q,p_kpa\n{}", "0.5,1,5\n".repeat(40));
    assert_eq!(read_with("period_ms = 20.0", &still).unwrap().rows(), 40);
}

/// A logger that sends a block again, at once or later, and a file that was appended to itself.
#[test]
fn rows_that_stand_above_are_passed_over_and_told() {
    let row = |k: u32| format!("{},0.5,1,{}\n", 0.02 * f64::from(k), 5 + k % 3);
    let rows = |of: std::ops::Range<u32>| of.map(row).collect::<String>();
    for (text, said) in [
        (rows(0..30) + &rows(20..30) + &rows(30..60), "10 rows are a row above in every cell, the first in line 32"),
        (rows(0..50) + &rows(10..30) + &rows(50..60), "20 rows are a row above in every cell, the first in line 52"),
        (rows(0..60) + &rows(0..60), "60 rows are a row above in every cell, the first in line 62"),
    ] {
        let recording = read_with("", &format!("time_s,u,q,p_kpa\n{text}")).unwrap();
        assert_eq!((recording.rows(), recording.segments().len()), (60, 1));
        assert!(recording.notes()[0].contains(said), "{:?}", recording.notes());
    }
    // Without a time in the file a command that comes back is no row again.
    let back = [0, 1, 2, 3, 4, 5, 4, 3, 2, 1, 0].map(|k| format!("{},1\n", 0.1 * f64::from(k))).concat();
    assert_eq!(read_with("period_ms = 20.0", &format!("u,q\n{back}")).unwrap().rows(), 11);
    // Another reading at a time that was: another run, or a clock that was set.
    let other = format!("time_s,u,q,p_kpa\n{}{}", rows(0..30), rows(20..60).replace(",1,5", ",1,9"));
    assert!(read_with("", &other).unwrap_err().to_string().contains("does not come after"));
}

/// A tool that writes a byte-order mark before one that is there, and a file that was joined with another.
#[test]
fn byte_order_marks_anywhere_are_no_letters() {
    const MARK: char = '\u{feff}';
    let rows = |of: std::ops::Range<u32>| {
        of.map(|k| format!("{},0.5,1,{}\n", 0.02 * f64::from(k), 5 + k % 3)).collect::<String>()
    };
    let header = "time_s,u,q,p_kpa\n";
    let rig = Rig::from_toml(RIG).unwrap();
    for text in [
        format!("{MARK}{MARK}{header}{}", rows(0..60)),
        format!("{MARK}{header}{}{MARK}{header}{}", rows(0..30), rows(30..60)),
    ] {
        let wide = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
        for bytes in [text.clone().into_bytes(), text.replace('\n', "\r").into_bytes(), wide] {
            let recording = Recording::parse_for("x.csv", &bytes, &rig).unwrap();
            assert_eq!((recording.rows(), recording.segments().len()), (60, 1));
        }
    }
}

/// A disk that loses power while a file grows leaves zeros where lines were.
#[test]
fn lines_with_zero_bytes_are_left_out_and_told() {
    let row = |k: u32| format!("{},0.5,1,{}\n", 0.02 * f64::from(k), 5 + k % 3);
    let mut text = format!("time_s,u,q,p_kpa\n{}", (0..60).map(row).collect::<String>());
    let at = text.find("\n0.6,").unwrap() + 4;
    text.replace_range(at..at + 20, &"\0".repeat(4096));
    let recording = read_with("", &text).unwrap();
    assert_eq!((recording.rows(), recording.segments().len()), (60, 1));
    let told = |note: &String| note.contains("1 line with zero bytes") && note.contains("the first line 32");
    assert!(recording.notes().iter().any(told), "{:?}", recording.notes());
    let is_lost: Vec<usize> = (0..60).filter(|row| recording.measured().is_some_and(|of| !of[*row])).collect();
    assert_eq!(is_lost, [30, 31]);
}

/// A program in C that writes the zero at the end of its texts, and a file of a fixed size that was not filled.
#[test]
fn zero_bytes_that_end_a_text_or_the_file_are_no_lost_lines() {
    let row = |k: u32| {
        let zero = if k.is_multiple_of(20) { "\0" } else { "" };
        format!(
            "{},0.5,1,{}{zero},the run goes on as it should and says so in every line: OK\0\n",
            0.02 * f64::from(k),
            5 + k % 3
        )
    };
    let text = format!("time_s,u,q,p_kpa,state\n{}", (0..60).map(row).collect::<String>());
    for text in [text.clone(), format!("{text}{}", "\0".repeat(6000))] {
        let recording = read_with("", &text).unwrap();
        assert_eq!((recording.rows(), recording.segments().len()), (60, 1));
        assert_eq!(recording.column("p_kpa").unwrap()[..4], [5.0, 6.0, 7.0, 5.0]);
        assert!(recording.notes().iter().all(|note| !note.contains("zero bytes")), "{:?}", recording.notes());
    }
}

/// The number of a run that looks like a date, and a column beside the milliseconds that is called like microseconds.
#[test]
fn columns_that_look_like_times_beside_the_time_are_none() {
    let second = |k: u32| format!("2026-03-29 01:59:{:02}", k / 50);
    let rows: String = (0..120).map(|k| format!("20260329015900,{}.{:03},0.5,1,5\n", second(k), k % 50 * 20)).collect();
    let recording = read_with("", &format!("run_id,when,u,q,p_kpa\n{rows}")).unwrap();
    assert_eq!((recording.rows(), recording.segments().len()), (120, 1));
    let alone: String = (0..60).map(|k| format!("20260329015900,0.5,1,{}\n", 5 + k % 3)).collect();
    let said = read_with("", &format!("run_id,u,q,p_kpa\n{alone}")).unwrap_err().to_string();
    assert!(said.contains("column time_s is missing") && said.contains("period_ms"), "{said}");
    assert_eq!(read_with("period_ms = 20.0", &format!("run_id,u,q,p_kpa\n{alone}")).unwrap().rows(), 60);
    // Digits that go on are a date, where nothing else is.
    let dated: String = (0..50).map(|k| format!("20260329015900{:03},0.5,1,5\n", 20 * k)).collect();
    let recording = read_with("", &format!("made,u,q,p_kpa\n{dated}")).unwrap();
    assert!((recording.time_s()[49] - 0.98).abs() < 1e-6, "{:?}", recording.notes());

    let rows: String = (0..120).map(|k| format!("{},{},{},0.5,1,5\n", second(k), k % 50 * 20, k % 4)).collect();
    let recording = read_with("", &format!("when,ms,Us,u,q,p_kpa\n{rows}")).unwrap();
    assert_eq!((recording.rows(), recording.segments().len()), (120, 1));
    let told = |note: &String| note.contains("milliseconds from ms");
    assert!(recording.notes().iter().any(told), "{:?}", recording.notes());
}

/// The line that helps names seconds and nanoseconds by every name that is known of them.
#[test]
fn two_columns_of_one_stamp_are_named_with_the_key_that_helps() {
    let text = "at.second,at.nanos,u,q,p_kpa\n1,0,0.5,1,5\n1,20000000,0.5,1,5\n";
    let said = read_with("", text).unwrap_err().to_string();
    assert!(said.contains("at.second") && said.contains("{ from = \"at.nanos\", scale = 1e-9 }"), "{said}");
}

/// Arrays as long as a run might last, and zeros where it ended before.
#[test]
fn rows_that_were_not_filled_are_left_out_and_told() {
    let rows: String = (1..61).map(|k| format!("{:.2},0.5,1,{}\n", 0.02 * f64::from(k), 5 + k % 3)).collect();
    let recording = read_with("", &format!("time_s,u,q,p_kpa\n{rows}{}", "0.00,0,0,0\n".repeat(40))).unwrap();
    assert_eq!((recording.rows(), recording.segments().len()), (60, 1));
    let told = "40 rows are zero in every column at the end, from line 62 on";
    assert!(recording.notes()[0].contains(told), "{:?}", recording.notes());
    // A rig that stands still at the end is one all the same.
    let still: String = (61..101).map(|k| format!("{:.2},0,0,0\n", 0.02 * f64::from(k))).collect();
    assert_eq!(read_with("", &format!("time_s,u,q,p_kpa\n{rows}{still}")).unwrap().rows(), 100);
    // So is one without a time in the file, whose command rose up to there.
    let risen: String = (1..61).map(|k| format!("{},1,5\n", 0.01 * f64::from(k))).collect();
    let rested = format!("u,q,p_kpa\n{risen}{}", "0,0,0\n".repeat(500));
    assert_eq!(read_with("period_ms = 20.0", &rested).unwrap().rows(), 560);
}

#[test]
fn times_of_writing_are_refused_with_the_key_that_helps() {
    let time = |k: u32| 0.2 * f64::from(k / 10) + 0.0005 * f64::from(k % 10);
    let rows: String = (0..400).map(|k| format!("{},0.5,1,{k}\n", time(k))).collect();
    let text = format!("time_s,u,q,p_kpa\n{rows}");
    let said = read_with("", &text).unwrap_err().to_string();
    assert!(said.contains("10 at a time") && said.contains("period_ms = 20.0"), "{said}");
    let recording = read_with("period_ms = 20.0", &text).unwrap();
    assert_eq!((recording.rows(), recording.segments().len()), (400, 1));
    let said = read_with("", "time_s,u,q,p_kpa\nnow,0.5,1,5\nthen,0.5,1,5\n").unwrap_err().to_string();
    assert!(said.contains("line 2") && said.contains("period_ms"), "{said}");
}

#[test]
fn readings_below_any_vacuum_get_the_likely_reason() {
    let said = |range: &str, readings: [f64; 3]| {
        let rows: String =
            readings.iter().enumerate().map(|(k, p)| format!("{},0.5,1,{p}\n", 0.02 * k as f64)).collect();
        let rig = RIG.replace("[0.0, 100.0]", range);
        let text = format!("time_s,u,q,p_kpa\n{rows}");
        Recording::parse_for("x.csv", text.as_bytes(), &Rig::from_toml(&rig).unwrap()).unwrap_err().to_string()
    };
    assert!(said("[0.0, 2000.0]", [-300.0, -1200.0, 0.5]).contains("scale = -1.0"));
    assert!(said("[0.0, 2000.0]", [-440.0, 9e5, 1.8e6]).contains("unit = \"Pa\""));
    assert!(said("[0.0, 2000.0]", [300.0, -9999.0, 310.0]).contains("no reading"));
    assert!(said("[-100.0, 0.0]", [-750.0, -400.0, -100.0]).contains("mbar, hPa or mmHg"));
}

/// Bytes that are no text are called that, whether they happen to be UTF-8 or not; a file of a fixed size with zeros at its end is read.
#[test]
fn binary_files_are_called_that() {
    let random = |k: u32| (k.wrapping_mul(2_654_435_761) >> 13) as u8;
    let low: Vec<u8> = (0..3000).map(|k| random(k) & 0x1f).collect();
    let any: Vec<u8> = (0..3000).map(|k| random(k).max(1)).collect();
    for bytes in [low, any] {
        let error = Recording::parse_for("x.csv", &bytes, &Rig::from_toml(RIG).unwrap()).unwrap_err().to_string();
        assert!(error.contains("binary file") && error.contains("as CSV"), "{error}");
    }
    let padded = format!("time_s,u,q,p_kpa\n0,1,1,5\n0.02,1,1,6\n0.04,1,1,5\n{}", "\0".repeat(6000));
    assert_eq!(read_with("", &padded).unwrap().column("p_kpa").unwrap(), [5.0, 6.0, 5.0]);
}
