//! Recordings in CSV: every bad file gets its one line, every good one comes back bit for bit.

#![allow(clippy::unwrap_used, reason = "the helpers of a test fail by panicking, as the test does")]

use proptest::prelude::*;
use proto::recording::csv::{Column, ColumnData};
use proto::recording::{Recording, RecordingError};

const HEADER: &str = "time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa";

fn parse(text: impl AsRef<[u8]>) -> Result<Recording, RecordingError> {
    Recording::parse_csv("rec.csv", text.as_ref())
}

/// The error of a bad file; always one line that begins with the file's name.
fn error(text: impl AsRef<[u8]>) -> String {
    let message = parse(text).unwrap_err().to_string();
    assert!(message.starts_with("rec.csv: ") && !message.contains('\n'), "{message}");
    message
}

/// First and one-past-last row of every segment.
fn bounds(recording: &Recording) -> Vec<(usize, usize)> {
    recording.segments().iter().map(|rows| (rows.start, rows.end)).collect()
}

fn with_rows(rows: &[&str]) -> String {
    format!("{HEADER}\n{}\n", rows.join("\n"))
}

#[test]
fn a_plain_file_is_read() {
    let recording = parse(with_rows(&["0.00,0.7,0.8,88.5,-71", "0.02,0.71,0.81,88.6,-71.5"])).unwrap();
    assert_eq!(recording.rows(), 2);
    assert_eq!(recording.time_s(), [0.0, 0.02]);
    let [p_neg, u_pos] = recording.require(["p_neg_kpa", "u_pos"]).unwrap();
    assert_eq!((p_neg, u_pos), (&[-71.0, -71.5][..], &[0.7, 0.71][..]));
    assert_eq!(bounds(&recording), [(0, 2)]);
    assert!(recording.notes().is_empty());
}

#[test]
fn byte_order_mark_crlf_quotes_blanks_and_blank_lines_are_fine() {
    let plain = parse(with_rows(&["0,0.7,0.8,88,-71", "0.02,0.7,0.8,88,-71"])).unwrap();
    for text in [
        format!("\u{feff}{HEADER}\r\n0,0.7,0.8,88,-71\r\n0.02,0.7,0.8,88,-71\r\n"),
        format!("{HEADER}\n\n0 , 0.7,\"0.8\", 88 ,-71\n\n0.02,0.7,0.8,88,-7.1e1\n\n"),
        format!("{HEADER}\n0,0.7,0.8,88,-71\n0.02,0.7,0.8,88,-71"),
        " time_s , \"u_pos\",u_neg,p_pos_kpa,p_neg_kpa\n0,+0.7,.8,88,-71\n0.02,0.7,0.8,88.,-71\n".to_owned(),
    ] {
        assert_eq!(parse(&text).unwrap(), plain, "{text:?}");
    }
}

#[test]
fn columns_are_found_by_name_and_all_others_are_kept() {
    let text = "note,p_pos_kpa,time_s,ambient_c,u_pos\nstart,88,0,21.5,0.7\n\"a, \"\"b\"\"\",89,0.02,21.6,0.8\n";
    let recording = parse(text).unwrap();
    assert_eq!(recording.names().collect::<Vec<_>>(), ["note", "p_pos_kpa", "ambient_c", "u_pos"]);
    assert_eq!(recording.column("ambient_c").unwrap(), [21.5, 21.6]);
    assert_eq!(recording.text_column("note").unwrap(), ["start", "a, \"b\""]);
    assert!(recording.column("note").is_none() && recording.text_column("u_pos").is_none());
    assert_eq!(parse(recording.to_csv()).unwrap(), recording);
    let message = recording.require(["note"]).unwrap_err().to_string();
    assert_eq!(message, "rec.csv: column note holds text; numbers are needed");
    let message = recording.require(["u_neg"]).unwrap_err().to_string();
    assert_eq!(message, "rec.csv: line 1: column u_neg is missing; there are time_s,note,p_pos_kpa,ambient_c,u_pos");
    let made = Recording::new("run 7", vec![0.0], vec![]).unwrap();
    let message = made.require(["u_neg"]).unwrap_err().to_string();
    assert_eq!(message, "run 7: column u_neg is missing; there are time_s");
    assert_eq!(recording.require_all(["u_pos", "ambient_c"]).unwrap(), [&[0.7, 0.8], &[21.5, 21.6]]);
}

#[test]
fn every_bad_file_gets_its_one_line() {
    let good = "0,0.7,0.8,88,-71";
    for (text, expected) in [
        (String::new(), "the file is empty; it needs a header line beginning with time_s, then one row per tick"),
        (
            "\u{feff} \r\n\n".to_owned(),
            "the file is empty; it needs a header line beginning with time_s, then one row per tick",
        ),
        (format!("{HEADER}\n\n"), "there is a header line but no row of data below it"),
        (
            "0,0.7,0.8,88,-71\n".to_owned(),
            "line 1: \"0\" is a number; the first line must name the columns, beginning with time_s",
        ),
        ("time,u_pos\n0,1\n".to_owned(), "line 1: column time_s is missing; there are time,u_pos"),
        (
            "time_s;u_pos;u_neg\n0;1;1\n".to_owned(),
            "line 1: columns are separated by semicolons; use commas (and points in numbers)",
        ),
        (
            "time_s\tu_pos\n0\t1\n".to_owned(),
            "line 1: columns are separated by tabs; use commas (and points in numbers)",
        ),
        (
            "time_s,u_pos,u_pos\n0,1,1\n".to_owned(),
            "line 1, column 3: u_pos stands here a second time; every column needs a name of its own",
        ),
        ("time_s,,u_pos\n0,1,1\n".to_owned(), "line 1, column 2: the column has no name"),
        (with_rows(&[good, "0.02,0.7,0.8,88"]), "line 3: 4 cells where the header has 5 columns"),
        (with_rows(&[good, "", "0.02,0.7,0.8,88,-71,"]), "line 4: 6 cells where the header has 5 columns"),
        (
            with_rows(&["0,0,0,7,0,8,88,5,-71,0"]),
            "line 2: 10 cells where the header has 5 columns; write numbers with a point, not a comma",
        ),
        (
            with_rows(&[good, "0.02;0.7;0.8;88;-71"]),
            "line 3: 1 cells where the header has 5 columns; separate cells by commas",
        ),
        (with_rows(&[good, "0.02,0.7,0.8,88,abc"]), "line 3, column 5 (p_neg_kpa): \"abc\" is not a number"),
        (
            with_rows(&[good, "0.02,0.7,,88,-71"]),
            "line 3, column 3 (u_neg): \"\" is not a number; leave out rows without a reading",
        ),
        (
            with_rows(&[good, "0.02,0.7,0.8,NaN,-71"]),
            "line 3, column 4 (p_pos_kpa): NaN is not a finite number; leave out rows without a reading",
        ),
        (
            with_rows(&["0,0.7,0.8,-inf,-71"]),
            "line 2, column 4 (p_pos_kpa): -inf is not a finite number; leave out rows without a reading",
        ),
        (
            with_rows(&["0,0.7,0.8,1e999,-71"]),
            "line 2, column 4 (p_pos_kpa): 1e999 is not a finite number; leave out rows without a reading",
        ),
        (
            with_rows(&["nan,0.7,0.8,88,-71"]),
            "line 2, column 1 (time_s): nan is not a finite number; leave out rows without a reading",
        ),
        (
            with_rows(&[good, "0.02,0.7,0.8,88,-71", "0.01,0.7,0.8,88,-71"]),
            "line 4, column 1 (time_s): 0.01 s does not come after 0.02 s in the row before; sort the rows and leave out repeated ones",
        ),
        (
            with_rows(&[good, good]),
            "line 3, column 1 (time_s): 0 s does not come after 0 s in the row before; sort the rows and leave out repeated ones",
        ),
        (
            with_rows(&[good, "0.02,0.7,80,88,-71"]),
            "line 3, column 3 (u_neg): 80 is outside 0 … 1; a duty is a share, not a percentage",
        ),
        (
            with_rows(&["0,-0.001,0.8,88,-71"]),
            "line 2, column 2 (u_pos): -0.001 is outside 0 … 1; a duty is a share, not a percentage",
        ),
        (
            "time_s,pump_on\n0,0.5\n".to_owned(),
            "line 2, column 2 (pump_on): 0.5 is outside 0 … 1; the pump is on (1) or off (0)",
        ),
        (
            with_rows(&[good, "0.01,0.7,0.8,88,-71", "0.02,0.7,0.8,88,-71"]),
            "rows are 10 ms apart (median of time_s); a recording has a row every 20 ms; resample it to 50 Hz",
        ),
        (
            with_rows(&[good, "20,0.7,0.8,88,-71", "40,0.7,0.8,88,-71"]),
            "rows are 20000 ms apart (median of time_s); a recording has a row every 20 ms; time_s seems to be in milliseconds: divide it by 1000",
        ),
    ] {
        assert_eq!(error(&text), format!("rec.csv: {expected}"), "{text:?}");
    }
    // A line that rings reads a little below vacuum.
    assert!(parse(with_rows(&["0,0.7,0.8,88,-102.6", "0.02,0.7,0.8,88,-71"])).is_ok());
    // A pressure far below vacuum is an absolute pressure's sign gone wrong, or another unit.
    assert!(error(with_rows(&["0,0.7,0.8,88,-7100"])).contains("column 5 (p_neg_kpa): -7100 is outside -200"));
    let not_utf8 = [HEADER.as_bytes(), b"\n0,0.7,0.8,88,-71\n0.02,0.7,\xff,88,-71\n"].concat();
    assert_eq!(error(not_utf8), "rec.csv: line 3, column 3: not UTF-8 text; save the file as UTF-8 CSV");
    let utf16: Vec<u8> = HEADER.encode_utf16().flat_map(u16::to_le_bytes).collect();
    assert!(!error(utf16).is_empty());
}

#[test]
fn an_extra_column_that_began_with_a_number_must_go_on_with_numbers() {
    let message = error("time_s,ambient_c\n0,21\n0.02,n/a\n");
    assert_eq!(
        message,
        "rec.csv: line 3, column 2 (ambient_c): \"n/a\" is not a number; leave out rows without a reading"
    );
    let message = error("time_s,ambient_c\n0,nan\n");
    assert!(message.contains("line 2, column 2 (ambient_c): nan is not a finite number"), "{message}");
}

#[test]
fn line_numbers_count_blank_lines_and_quoted_line_breaks() {
    let text = "time_s,note,u_pos\n\n0,\"two\nlines\",0.5\r\n\r\n0.02,x,oops\n";
    assert_eq!(error(text), "rec.csv: line 6, column 3 (u_pos): \"oops\" is not a number");
}

#[test]
fn a_gap_splits_and_jitter_does_not() {
    let text = |times: &[f64]| {
        let rows: Vec<String> = times.iter().map(|t| format!("{t},0.7,0.8,88,-71")).collect();
        format!("{HEADER}\n{}\n", rows.join("\n"))
    };
    let segments = |times: &[f64]| bounds(&parse(text(times)).unwrap());
    // Half a period of jitter either way is one segment; the nominal step stays the median.
    assert_eq!(segments(&[0.0, 0.02, 0.05, 0.06, 0.08, 0.10]), [(0, 6)]);
    // One lost row is a gap of 40 ms, and so is anything above 30 ms.
    assert_eq!(segments(&[0.0, 0.02, 0.06, 0.08, 0.10, 0.12]), [(0, 2), (2, 6)]);
    assert_eq!(segments(&[0.0, 0.02, 0.0501, 0.07, 0.09, 0.11]), [(0, 2), (2, 6)]);
    assert_eq!(segments(&[0.0, 0.02, 5.0, 5.02, 9.0, 9.02, 9.04, 9.06]), [(0, 2), (2, 4), (4, 8)]);
    assert_eq!(segments(&[7.5]), [(0, 1)]);
}

#[test]
fn recordings_put_together_in_memory_are_checked_the_same_way() {
    let column =
        |name: &str, numbers: &[f64]| Column { name: name.to_owned(), data: ColumnData::Numbers(numbers.to_vec()) };
    let error = |time_s: &[f64], columns: Vec<Column>| {
        Recording::new("memory", time_s.to_vec(), columns).unwrap_err().to_string()
    };
    assert_eq!(error(&[], vec![]), "memory: there is a header line but no row of data below it");
    let short = error(&[0.0, 0.02], vec![column("u_pos", &[0.5])]);
    assert_eq!(short, "memory: column u_pos has 1 rows, time_s has 2");
    let twice = error(&[0.0], vec![column("a", &[1.0]), column("a", &[1.0])]);
    assert!(twice.contains("column 3: a stands here a second time"), "{twice}");
    let again = error(&[0.0], vec![column("time_s", &[1.0])]);
    assert!(again.contains("time_s stands here a second time"), "{again}");
    let nan = error(&[0.0, 0.02], vec![column("a", &[1.0, f64::NAN])]);
    assert!(nan.contains("line 3, column 2 (a): NaN is not a finite number"), "{nan}");
}

#[test]
fn files_are_told_apart_by_their_first_bytes_and_a_missing_one_is_named() {
    let folder = std::env::temp_dir().join(format!("recording-csv-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("no_ending");
    std::fs::write(&path, with_rows(&["0,0.7,0.8,88,-71"])).unwrap();
    assert_eq!(Recording::read(&path).unwrap().rows(), 1);
    let path = folder.join("text.mcap");
    std::fs::write(&path, with_rows(&["0,0.7,0.8,88,-71"])).unwrap();
    assert!(Recording::read(&path).unwrap_err().to_string().contains("not an MCAP file"));
    let missing = Recording::read(&folder.join("missing.csv")).unwrap_err().to_string();
    assert!(missing.contains("missing.csv: cannot read the recording: No such file"), "{missing}");
    std::fs::remove_dir_all(folder).unwrap();
}

fn finite() -> impl Strategy<Value = f64> {
    any::<u64>().prop_map(f64::from_bits).prop_filter("finite", |x| x.is_finite())
}

proptest! {
    #[test]
    fn numbers_come_back_bit_for_bit(values in proptest::collection::vec((finite(), finite()), 1..40)) {
        let time_s: Vec<f64> = (0..values.len()).map(|k| k as f64 / 50.0).collect();
        let (a, b): (Vec<f64>, Vec<f64>) = values.into_iter().unzip();
        let columns = [("a", &a), ("b, \"c\"", &b)]
            .map(|(name, numbers)| Column { name: name.to_owned(), data: ColumnData::Numbers(numbers.clone()) });
        let recording = Recording::new("rec.csv", time_s.clone(), columns.to_vec()).unwrap();
        let back = parse(recording.to_csv()).unwrap();
        let bits = |numbers: &[f64]| numbers.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        prop_assert_eq!(bits(back.time_s()), bits(&time_s));
        prop_assert_eq!(bits(back.column("a").unwrap()), bits(&a));
        prop_assert_eq!(bits(back.column("b, \"c\"").unwrap()), bits(&b));
    }

    #[test]
    fn no_bytes_make_it_panic(bytes: Vec<u8>) {
        let _ = parse(&bytes);
    }

    #[test]
    fn no_damaged_recording_makes_it_panic(place in 0_usize..200, byte: u8) {
        let mut text = with_rows(&["0,0.7,0.8,88,-71", "0.02,0.7,0.8,88,-71", "0.04,0.7,0.8,88,-71"]).into_bytes();
        let place = place % text.len();
        text[place] = byte;
        let _ = parse(&text);
    }
}
