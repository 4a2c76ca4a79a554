//! Notes that people write into a recording beside its numbers: a note changes no number around it, and is told.

#![allow(clippy::unwrap_used, clippy::panic)] // what fails here fails the test

use model::rig::Rig;
use proto::recording::Recording;

const ROWS: usize = 400;
/// Row that somebody wrote something to, and its line below a header.
const AT: usize = 200;
const LINE: usize = AT + 2;

/// Cells of a row as a logger writes them: a ramp in each column, so that a row that went lost or moved shows.
fn row(k: usize) -> String {
    format!(
        "{:.2},{:.3},0.5,{:.2},{:.2}",
        0.02 * k as f64,
        0.2 + 0.001 * k as f64,
        20.0 + 0.1 * k as f64,
        -0.1 * k as f64
    )
}

/// A file of these rows under a header with `names` behind the rig's own, each row as `write` has it.
fn read(names: &str, write: &dyn Fn(usize) -> String) -> Result<Recording, String> {
    let rows: String = (0..ROWS).map(|k| write(k) + "\n").collect();
    let text = format!("time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa{names}\n{rows}");
    let rig = Rig::builtin("dual_pressure").unwrap();
    Recording::parse_for("run.csv", text.as_bytes(), &rig).map_err(|e| e.to_string())
}

/// The file read with `at` in place of the row that was written to, all others as they are but for `tail` behind them.
fn noted(names: &str, tail: &str, at: &str) -> Recording {
    let write = |k: usize| if k == AT { at.to_owned() } else { row(k) + tail };
    read(names, &write).unwrap()
}

/// Checks that every row stands there with its own numbers.
fn assert_whole(recording: &Recording) {
    assert_eq!(recording.rows(), ROWS);
    for (name, of) in [("p_pos_kpa", [20.0, 0.1]), ("p_neg_kpa", [0.0, -0.1]), ("u_pos", [0.2, 0.001])] {
        let values = recording.column(name).unwrap();
        let off = values.iter().enumerate().map(|(k, x)| (x - of[0] - of[1] * k as f64).abs()).fold(0.0, f64::max);
        // In a lost row readings are on a straight line, which these are, and a command is still that of the row before.
        let held = if name == "u_pos" { of[1] } else { 0.0 };
        assert!(off < held + 1e-9, "{name}: {off}");
    }
}

fn assert_told(recording: &Recording, words: &[&str]) {
    let told = recording.notes().join("\n");
    assert!(words.iter().all(|word| told.contains(word)), "{words:?} are not in: {told}");
}

#[test]
fn a_note_beside_a_row_or_between_rows_changes_nothing() {
    let line = format!("line {LINE}");
    let behind = noted("", "", &(row(AT) + ",touched the hose"));
    assert_whole(&behind);
    assert_told(&behind, &["1 row has text behind the last column", "touched the hose", &line]);
    let with_a_comma = noted("", "", &(row(AT) + ",touched the hose, twice"));
    assert_whole(&with_a_comma);
    // A column of notes that only the row with a note has; one that every row has is nobody's business.
    assert_whole(&noted(",note", "", &(row(AT) + ",touched the hose")));
    assert_whole(&noted(",note", ",", &(row(AT) + ",touched the hose")));
    for between in [",,,,,touched the hose", ",,,touched the hose,", "3.995,touched the hose", "touched the hose,,,,"] {
        let between = noted("", "", &format!("{}\n{between}", row(AT)));
        assert_whole(&between);
        assert_told(&between, &["1 line of text", "touched the hose", &format!("line {}", LINE + 1)]);
    }
}

#[test]
fn a_word_over_a_number_loses_its_row_or_its_reading_alone() {
    let recording = noted("", "", "4.00,touched the hose,,,");
    assert_whole(&recording);
    assert_told(&recording, &["1 row has no number", &format!("line {LINE}")]);
    assert!(recording.measured().is_some_and(|measured| !measured[AT] && measured[AT - 1] && measured[AT + 1]));
    for (over, sensor) in
        [("4.00,0.400,0.5,valve stuck,-20.00", "p_pos_kpa"), ("4.00,0.400,0.5,40.00,see notebook 3", "p_neg_kpa")]
    {
        let recording = noted("", "", over);
        assert_whole(&recording);
        assert_eq!((recording.measured(), recording.column("u_pos").unwrap()[AT]), (None, 0.4));
        assert_told(&recording, &[&format!("1 reading of {sensor} is missing"), &format!("line {LINE}")]);
        assert!(recording.missing(sensor).is_some_and(|missing| missing[AT] && !missing[AT - 1] && !missing[AT + 1]));
    }
    // A number gone wrong is told with its line, and so are words in many rows.
    let wrong = |at: &'static str| read("", &move |k| if k == AT { at.to_owned() } else { row(k) });
    for at in ["4.00,0.400,0.5,4O.00,-20.00", "4.00,0.400,0.5,40.00 kPa ?,-20.00"] {
        assert!(wrong(at).is_err_and(|text| text.contains(&format!("line {LINE}")) && text.contains("not a number")));
    }
    let often = read("", &|k| if k % 20 == 7 { format!("{:.2},fault,0.5,1.0,1.0", 0.02 * k as f64) } else { row(k) });
    assert!(often.is_err_and(|text| text.contains("line 9") && text.contains("fault")));
}

/// Text that may be a column without a name is no note: every number behind it would stand under another name.
#[test]
fn a_column_that_the_header_lacks_is_refused() {
    let number = read("", &|k| if k == AT { row(k) + ",7" } else { row(k) });
    assert!(number.is_err_and(|text| text.contains(&format!("line {LINE}")) && text.contains("6 cells")));
    let always = read("", &|k| row(k) + ",ok");
    assert!(always.is_err_and(|text| text.contains("6 cells")));
}

/// A logger that was asked twice writes a time twice; what was read at the first is kept.
#[test]
fn a_second_row_at_one_time_is_passed_over() {
    let twice = noted("", "", &format!("{}\n4.00,0.9,0.5,99.0,-99.0", row(AT)));
    assert_whole(&twice);
    assert_told(&twice, &["1 row has the time of the row before", &format!("line {}", LINE + 1)]);
    // Times that are rounded are no such rows.
    let rounded = read("", &|k| format!("{:.1}{}", 0.02 * k as f64, &row(k)[4..]));
    assert!(rounded.is_err_and(|text| text.contains("the times are rounded")));
}

/// German loggers write `Datum` and months by name, Lord Howe Island sets its clocks by half an hour.
#[test]
fn dates_with_months_by_name_and_clocks_set_by_half_an_hour_are_read() {
    let rig = Rig::builtin("dual_pressure").unwrap();
    let read = |heading: &str, at: &dyn Fn(usize) -> String| {
        let rows: String =
            (0..ROWS).map(|k| format!("{};{}\n", at(k), row(k).split_once(',').unwrap().1.replace(',', ";"))).collect();
        let text = format!("{heading};u_pos;u_neg;p_pos_kpa;p_neg_kpa\n{rows}");
        Recording::parse_for("run.csv", text.as_bytes(), &rig).unwrap()
    };
    let clock =
        |ms: usize| format!("{:02}:{:02}:{:02}.{:03}", ms / 3_600_000, ms / 60_000 % 60, ms / 1000 % 60, ms % 1000);
    // Two seconds before two in the night.
    let from_ms = 7_198_000;
    assert_whole(&read("Datum", &|k| format!("29. März 2026 {}", clock(from_ms + 20 * k))));
    assert_whole(&read("Datum", &|k| format!("04-Okt-2026 {}", clock(from_ms + 20 * k))));
    for (date, set_ms) in [("2026-04-05", -1_800_000_i64), ("2026-10-04", 1_800_000)] {
        let set = read("Date", &|k| {
            let set_ms = if k < 100 { 0 } else { set_ms };
            format!("{date} {}", clock((from_ms as i64 + set_ms + 20 * k as i64) as usize))
        });
        assert_whole(&set);
        assert_eq!(set.segments().len(), 1, "{date}");
    }
}

const NAMES: &str = "time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa";

/// A file to which a second session was appended: this head, 40 s later the rows of the other half.
fn appended(first: &str, second: &str) -> Result<Recording, String> {
    let rows = |from: usize, to: usize, later_s: f64| -> String {
        let late = |k: usize| {
            let line = row(k);
            let (time, rest) = line.split_once(',').unwrap();
            format!("{:.2},{rest}\n", time.parse::<f64>().unwrap() + later_s)
        };
        (from..to).map(late).collect()
    };
    let text = format!("{first}\n{}{second}\n{}", rows(0, AT, 0.0), rows(AT, ROWS, 40.0));
    let rig = Rig::builtin("dual_pressure").unwrap();
    Recording::parse_for("run.csv", text.as_bytes(), &rig).map_err(|e| e.to_string())
}

#[test]
fn a_head_that_stands_again_is_passed_over_with_its_units() {
    for head in [
        NAMES.to_owned(),
        format!("{NAMES}\ns,-,-,kPa,kPa"),
        format!("{NAMES}\n,%,%,kPa,kPa"),
        format!("# logger\n{NAMES}\ns,-,-,kPa,kPa"),
        format!("Logger 3.2,,,,\n{NAMES}\ns,-,-,kPa,kPa\nraw,raw,raw,mean,mean"),
        format!("# {NAMES}"),
    ] {
        let of = appended(&head, &head).unwrap_or_else(|said| panic!("{head}: {said}"));
        assert_eq!((of.rows(), of.segments().len()), (ROWS, 2), "{head}: {:?}", of.notes());
        // The hole is that of the times, and no number is another's.
        assert!((of.time_s()[AT] - of.time_s()[AT - 1] - 40.02).abs() < 1e-6, "{head}");
        for (name, of_row, line) in [("p_pos_kpa", AT, 20.0 + 0.1 * AT as f64), ("p_neg_kpa", ROWS - 1, -0.1 * 399.0)] {
            assert!((of.column(name).unwrap()[of_row] - line).abs() < 1e-9, "{head}");
        }
    }
}

#[test]
fn a_head_of_another_kind_is_refused_with_what_differs() {
    let with_units = format!("{NAMES}\ns,-,-,kPa,kPa");
    let swapped = NAMES.replace("u_pos,u_neg", "u_neg,u_pos");
    let in_brackets = |unit: &str| NAMES.replace("p_pos_kpa", &format!("p_pos_kpa [{unit}]"));
    let order = "u_neg,u_pos where the first has u_pos,u_neg";
    for (first, second, line, words) in [
        (NAMES.to_owned(), swapped.clone(), AT + 2, order),
        (format!("# {NAMES}"), format!("# {swapped}"), AT + 2, order),
        (in_brackets("kPa"), in_brackets("mbar"), AT + 2, "p_pos_kpa [mbar] where the first has p_pos_kpa [kPa]"),
        (with_units.clone(), with_units.replace("kPa,kPa", "mbar,kPa"), AT + 4, "mbar where the first has kPa"),
        (NAMES.to_owned(), format!("{NAMES},note"), AT + 2, "note where the first has"),
    ] {
        let said = appended(&first, &second).unwrap_err();
        let place = format!("line {line}: another header begins here");
        assert!(said.contains(&place) && said.contains(words), "{second}: {said}");
        assert!(said.contains("make a file of each") && !said.contains("period_ms"), "{said}");
    }
}
