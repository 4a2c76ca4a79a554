//! Tables that say something of themselves in an odd place: units in a row that begins with a per cent, names of rows, a row per channel, whole seconds.

#![allow(clippy::unwrap_used, reason = "the helpers of a test fail by panicking, as the test does")]

use model::rig::Rig;
use proto::recording::Recording;

const ROWS: usize = 60;
const NAMES: [&str; 5] = ["time_s", "u_pos", "u_neg", "p_pos_kpa", "p_neg_kpa"];

fn read_with(map: &str, text: &str) -> Result<Recording, String> {
    let rig = Rig::from_toml(&format!("{}\n[recording]\n{map}", model::rig::DUAL_PRESSURE)).unwrap();
    Recording::parse_for("x.csv", text.as_bytes(), &rig).map_err(|error| error.to_string())
}

/// Rows `step_s` apart from `begin_s` on.
fn rows(begin_s: f64, step_s: f64, separator: &str) -> String {
    let line = |k: usize| {
        let x = k as f64;
        let cells = [begin_s + step_s * x, 0.5 + 0.001 * x, 0.6, 90.0 + (0.7 * x).sin(), -60.0 - (0.9 * x).cos()];
        cells.map(|cell| format!("{cell:.4}")).join(separator) + "\n"
    };
    (0..ROWS).map(line).collect()
}

fn table(head: &str, separator: &str) -> String {
    format!("{}\n{}", head.replace(',', separator), rows(0.0, 0.02, separator))
}

/// Reads a table whose duties are said to be in per cent and whose pressures in hPa.
#[track_caller]
fn assert_in_units(text: &str) -> Recording {
    let of = read_with("", text).unwrap();
    assert_eq!((of.rows(), of.segments().len()), (ROWS, 1), "{:?}", of.notes());
    let first = |name: &str| of.column(name).unwrap()[0];
    assert!((first("u_pos") - 0.005).abs() < 1e-9, "{text}");
    assert!((first("p_pos_kpa") - 9.0).abs() < 1e-9 && (first("p_neg_kpa") + 6.1).abs() < 1e-9, "{text}");
    of
}

#[test]
fn a_row_of_units_may_begin_with_a_per_cent_or_a_blank() {
    let names = NAMES.join(",");
    assert_in_units(&table(&format!("{names}\n,%,%,hPa,hPa"), "\t"));
    assert_in_units(&table(&format!("{names}\ns,%,%,hPa,hPa"), ";"));
    let moved = |line: &str| line.split(',').map(str::to_owned).collect::<Vec<_>>();
    let turned: String = table(&format!("{names}\ns,%,%,hPa,hPa"), ",")
        .lines()
        .map(|line| {
            let mut cells = moved(line);
            cells.rotate_left(1);
            cells.join(",") + "\n"
        })
        .collect();
    assert!(turned.contains("\n%,%,hPa,hPa,s\n"));
    assert_in_units(&turned);
    // Fewer cells than there are names, or none that is a unit, is a comment still.
    for comment in ["% kPa, hPa", "% rig 3, 4, run, 5, 6", "%"] {
        let of = read_with("", &table(&format!("{names}\n{comment}"), ",")).unwrap();
        assert!((of.column("p_pos_kpa").unwrap()[0] - 90.0).abs() < 1e-9, "{comment}");
    }
    // Units of the pressures alone, under blanks: the row is none of the data, and no row is lost.
    let of = read_with("", &table(&format!("{names}\n,,,hPa,hPa"), ";")).unwrap();
    assert!((of.column("p_pos_kpa").unwrap()[0] - 9.0).abs() < 1e-9);
    assert!(of.rows() == ROWS && of.notes().iter().all(|note| !note.contains("lost")), "{:?}", of.notes());
}

#[test]
fn units_behind_a_stroke_need_no_blanks() {
    let of = assert_in_units(&table("Time/s,u_pos/%,u_neg/%,p_pos_kpa/hPa,p_neg_kpa/hPa", ","));
    assert!((of.time_s()[50] - 1.0).abs() < 1e-9);
}

#[test]
fn names_of_rows_are_left_out_and_told() {
    let quoted = NAMES.map(|name| format!("\"{name}\"")).join(" ");
    let named = |first: &dyn Fn(usize) -> String| {
        let lines = rows(0.0, 0.02, " ");
        let lines = lines.lines().enumerate().map(|(k, line)| format!("{} {line}\n", first(k)));
        format!("{quoted}\n{}", lines.collect::<String>())
    };
    let of = read_with("", &named(&|k| format!("\"{}\"", k + 1))).unwrap();
    assert_eq!((of.rows(), of.column("u_neg").unwrap()[7]), (ROWS, 0.6));
    assert!(of.notes()[0].contains("row names in the first column"), "{:?}", of.notes());
    // Anything else in front may be a column whose name is missing.
    assert!(read_with("", &named(&|k| format!("{:.1}", 20.0 - k as f64 / 8.0))).unwrap_err().contains("6 cells"));
}

#[test]
fn a_row_per_channel_is_told_with_what_pivots_it() {
    let channels = ["drive", "suck", "tank", "cup"];
    let line = |k: usize| channels.map(|name| format!("{:.2},{name},0.{k}\n", 0.02 * k as f64)).concat();
    let said =
        read_with("", &format!("time_s,channel,value\n{}", (0..ROWS).map(line).collect::<String>())).unwrap_err();
    for words in [
        "u_pos, ",
        "p_neg_kpa",
        "one row per channel",
        "(cup, drive, suck, tank)",
        "pivot(index='time_s', columns='channel', values='value')",
    ] {
        assert!(said.contains(words), "`{words}` is not in: {said}");
    }
    // A state beside columns of other names is no channel.
    let wide = table("t,a,b,c,d", ",");
    let wide = wide.lines().enumerate().map(|(k, line)| match k {
        0 => format!("{line},state\n"),
        _ => format!("{line},{}\n", if k < 30 { "idle" } else { "run" }),
    });
    assert!(read_with("", &wide.collect::<String>()).unwrap_err().contains("column u_pos is missing"));
}

#[test]
fn words_of_c_and_of_fortran_for_no_number_are_known() {
    for word in ["-nan(ind)", "-nan", "1.#INF", "-1.#IND00", "<NA>", "***", "******", "?", "#OVF"] {
        let text = table(&NAMES.join(","), ",").replacen("90.6442", word, 1);
        assert!(text.contains(word));
        let of = read_with("", &text).unwrap();
        assert_eq!(of.segments().len(), 1, "{word}");
        assert!(
            of.notes().iter().any(|note| note.contains("p_pos_kpa") && note.contains("line 3")),
            "{word}: {:?}",
            of.notes()
        );
    }
}

#[test]
fn a_wrong_unit_of_time_is_refused_with_the_key() {
    let names = NAMES.join(",");
    let key = "time = { from = \"time_s\", unit = \"s\" }";
    let said = read_with("", &table(&names.replacen("time_s", "time_s [ms]", 1), ",")).unwrap_err();
    assert!(said.contains(&format!("[recording] {key}")), "{said}");
    let of = read_with(key, &table(&names.replacen("time_s", "time_s [ms]", 1), ",")).unwrap();
    assert_eq!(of.rows(), ROWS);
    let said = read_with("time = { from = \"time_s\", unit = \"ms\" }", &table(&names, ",")).unwrap_err();
    assert!(said.contains(&format!("[recording] {key}")), "{said}");
}

#[test]
fn whole_seconds_are_seconds_by_their_name_and_a_count_without_one() {
    let names = NAMES.join(",");
    let seconds =
        |first: &str, begin_s: f64| format!("{}\n{}", names.replacen("time_s", first, 1), rows(begin_s, 1.0, ","));
    let of = read_with("", &seconds("time_s", 0.0)).unwrap();
    assert!(of.may_count_rows() && (of.sampling_s() - 1.0).abs() < 1e-9);
    let told = |of: &Recording| of.notes().iter().any(|note| note.contains("taken as 1 s a row; if they count rows"));
    assert!(told(&of), "{:?}", of.notes());
    // What is said is no matter of doubt.
    let of = read_with("time = { from = \"time_s\", unit = \"s\" }", &seconds("time_s", 0.0)).unwrap();
    assert!(!of.may_count_rows() && !told(&of), "{:?}", of.notes());
    let of = read_with("", &seconds("time_s", 0.37)).unwrap();
    assert!(!of.may_count_rows() && !told(&of), "{:?}", of.notes());
    let said = read_with("", &seconds("t", 0.0)).unwrap_err();
    assert!(said.contains("seems to count rows") && said.contains("scale = 0.02"), "{said}");
    assert!(read_with("", &seconds("t", 0.37)).is_ok());
}

#[test]
fn a_period_that_the_times_contradict_is_told_to_be_unused() {
    let text = table(&NAMES.join(","), ",");
    let of = read_with("period_ms = 40.0", &text).unwrap();
    assert!((of.time_s()[50] - 1.0).abs() < 1e-9);
    assert!(of.notes().iter().any(|note| note.contains("20.0 ms apart by time_s") && note.contains("period_ms = 40")));
    assert!(read_with("period_ms = 20.0", &text).unwrap().notes().is_empty());
}

#[test]
fn bytes_of_numbers_are_called_a_binary_file() {
    let mut npy = b"\x93NUMPY\x01\x00v\x00{'descr': '<f8', 'fortran_order': False, 'shape': (2000, 5), }".to_vec();
    npy.resize(128, b' ');
    npy.extend((0..2000).flat_map(|k| (0.02 * f64::from(k)).to_le_bytes()));
    let mut sqlite = b"SQLite format 3\0".to_vec();
    sqlite.extend([0x10, 0, 1, 1, 0, 0x40, 0x20, 0x20, 0, 0, 0, 0x85, 0, 0, 0, 2]);
    sqlite.resize(4096, 0);
    sqlite.extend([0xff, 0x0d, 3]);
    for bytes in [npy, sqlite] {
        let rig = Rig::builtin("dual_pressure").unwrap();
        let said = Recording::parse_for("x.bin", &bytes, &rig).unwrap_err().to_string();
        assert!(said.contains("a binary file of a kind that is not read") && !said.contains("UTF-8"), "{said}");
    }
}
