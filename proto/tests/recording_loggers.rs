//! Files as loggers write them: each is read as what it is, or refused with the key that would help.

#![allow(clippy::unwrap_used, clippy::panic, reason = "the helpers of a test fail by panicking, as the test does")]

mod logged;

use logged::{HEADER, ROWS, assert_whole, paper, read, refused, row, seconds, table, with};
use model::rig::Rig;

#[test]
fn separators_decimal_marks_heads_and_ends_are_found_out() {
    let plain = table(&format!("{HEADER}\n"), seconds, ",", ".", "");
    let with_head = |head: &str| table(&format!("{head}{HEADER}\n"), seconds, ",", ".", "");
    let semicolons = HEADER.replace(',', ";");
    let tabs = HEADER.replace(',', "\t");
    let day = |k: usize| format!("2026-03-29 01:59:{:06.3}", 58.5 + 0.02 * k as f64);
    let zone = |k: usize| format!("2026-03-29T23:59:{:06.3}+02:00", 58.5 + 0.02 * k as f64);
    let stamped = HEADER.replace("time_s", "Timestamp");
    let cases: Vec<(&str, String, &str)> = vec![
        ("plain", plain.clone(), ""),
        ("tabs", table(&format!("{tabs}\n"), seconds, "\t", ".", ""), "tabs"),
        (
            "semicolons",
            table(&format!("{semicolons}\n"), |k| seconds(k).replace('.', ","), ";", ",", ""),
            "decimal commas",
        ),
        ("semicolons and points", table(&format!("{semicolons}\n"), seconds, ";", ".", ""), "semicolons"),
        (
            "tabs and commas",
            table(&format!("{tabs}\n"), |k| seconds(k).replace('.', ","), "\t", ",", ""),
            "decimal commas",
        ),
        ("blanks", table(&format!("{}\n", HEADER.replace(',', "   ")), seconds, "  ", ".", " "), "blanks"),
        ("trailing", table(&format!("{HEADER},\n"), seconds, ",", ".", ","), ""),
        ("trailing in rows", table(&format!("{HEADER}\n"), seconds, ",", ".", ","), ""),
        ("comments", with_head("# rig 3, \"run\n% 5\" tube\n// gauge\n"), ""),
        ("comment header", table(&format!("# run 7\n# {HEADER}\n"), seconds, ",", ".", ""), "comment line"),
        (
            "head",
            with_head(
                "Settings:\nfilename,run_1.csv\nTraj times,0.00,100.00,1500.00,1600.00,3000.00\nKP,0.7,1,2,3\nData:\n",
            ),
            "5 lines before",
        ),
        ("units", with_head("").replacen('\n', "\ns,-,-,kPa,kPa\n", 1), "units taken: u_pos in -"),
        (
            "units in names",
            plain.replace("p_pos_kpa", "p_pos_kpa [kPa]").replace("time_s", "time_s (s)"),
            "p_pos_kpa in kPa",
        ),
        (
            "pandas",
            plain
                .lines()
                .enumerate()
                .map(|(k, l)| if k == 0 { format!(",{l}\n") } else { format!("{k},{l}\n") })
                .collect(),
            "",
        ),
        ("date", table(&format!("{stamped}\n"), day, ",", ".", ""), "Timestamp as date"),
        ("zone", table(&format!("{stamped}\n"), zone, ",", ".", ""), "Timestamp as date"),
        (
            "epoch",
            table(&format!("{stamped}\n"), |k| format!("{}", 1_774_749_540_000_u64 + 20 * k as u64), ",", ".", ""),
            "since 1970 in ms",
        ),
        (
            "ms",
            table(&format!("{}\n", HEADER.replace("time_s", "time_ms")), |k| (20 * k).to_string(), ",", ".", ""),
            "time_ms in ms",
        ),
        (
            "date and time",
            table(
                &format!("Date,Time,{}\n", &HEADER[7..]),
                |k| format!("29.03.2026,10:00:{:06.3}", 0.02 * k as f64),
                ",",
                ".",
                "",
            ),
            "as date",
        ),
        ("crlf and a byte-order mark", format!("\u{feff}{}", plain.replace('\n', "\r\n")), ""),
        ("text behind", format!("{plain}End of data\n"), "1 line of text among the data or behind"),
        (
            "header again",
            format!("{}{}", plain.replacen("0.60,", &format!("{HEADER}\n0.60,"), 1), ""),
            "stands here again",
        ),
        (
            "other columns",
            plain
                .lines()
                .enumerate()
                .map(|(k, l)| if k == 0 { format!("{l},ambient_c,note\n") } else { format!("{l},NaN,caf\u{e9}\n") })
                .collect(),
            "",
        ),
    ];
    for (name, text, told) in cases {
        let recording = read(&text, &paper()).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_whole(&recording, name);
        let notes = recording.notes().join("\n");
        assert!(notes.contains(told) && (told.is_empty() == notes.is_empty()), "{name}: {notes}");
    }
    // UTF-16, as a spreadsheet's "Unicode text"; Latin-1 in a name that nobody asks for.
    let wide = |bytes: fn(u16) -> [u8; 2], mark: [u8; 2]| {
        [mark.to_vec(), plain.encode_utf16().flat_map(bytes).collect::<Vec<u8>>()].concat()
    };
    assert_whole(&read(wide(u16::to_le_bytes, [0xFF, 0xFE]), &paper()).unwrap(), "UTF-16 LE");
    assert_whole(&read(wide(u16::to_be_bytes, [0xFE, 0xFF]), &paper()).unwrap(), "UTF-16 BE");
    let degrees: Vec<u8> = plain
        .lines()
        .enumerate()
        .flat_map(|(k, l)| [l.as_bytes(), if k == 0 { b",T \xB0C\n" } else { b",21\n" }].concat())
        .collect();
    assert_whole(&read(degrees, &paper()).unwrap(), "Latin-1");
}

/// A number with a mark between thousands.
fn grouped(number: f64, mark: &str) -> String {
    let size = number.abs();
    let thousands = (size / 1e3).floor();
    let (sign, rest) = (if number < 0.0 { "-" } else { "" }, size - 1e3 * thousands);
    if thousands > 0.0 { format!("{sign}{thousands}{mark}{rest:07.3}") } else { format!("{sign}{rest:.3}") }
}

#[test]
fn numbers_as_other_countries_write_them_are_read() {
    let in_pa = |of: fn(f64) -> String, separator: &str| {
        let rows = (0..ROWS).map(|k| {
            let [a, b, p, n] = row(k);
            [seconds(k), a.to_string(), b.to_string(), of(1e3 * p), of(1e3 * n)].join(separator) + "\n"
        });
        let head = HEADER.replace("p_pos_kpa", "p_pos_kpa [Pa]").replace("p_neg_kpa", "p_neg_kpa [Pa]");
        head.replace(',', separator) + "\n" + &rows.collect::<String>()
    };
    let cases: [(&str, String); 6] = [
        ("commas", in_pa(|x| format!("\"{}\"", grouped(x, ",")), ",")),
        ("apostrophes", in_pa(|x| grouped(x, "'"), ";")),
        ("blanks that do not break", in_pa(|x| grouped(x, "\u{a0}"), "\t")),
        ("a typographic minus", in_pa(|x| format!("{x:.3}").replace('-', "\u{2212}"), ",")),
        ("exponents of Fortran", in_pa(|x| format!("{x:e}").replace('e', "D"), ",")),
        (
            "quoted decimal commas",
            table(&format!("{HEADER}\n"), |k| format!("\"{}\"", seconds(k).replace('.', ",")), ",", ".", "")
                .lines()
                .enumerate()
                .map(|(k, line)| match (k, line.split_once("\",")) {
                    (0, _) | (_, None) => format!("{line}\n"),
                    (_, Some((time, rest))) => {
                        let cells: Vec<String> =
                            rest.split(',').map(|c| format!("\"{}\"", c.replace('.', ","))).collect();
                        format!("{time}\",{}\n", cells.join(","))
                    }
                })
                .collect(),
        ),
    ];
    for (name, text) in cases {
        assert_whole(&read(text, &paper()).unwrap_or_else(|error| panic!("{name}: {error}")), name);
    }
}

#[test]
fn times_of_spreadsheets_and_rounded_times_are_what_they_are() {
    let stamped = HEADER.replace("time_s", "Timestamp");
    let days = |k: usize| format!("{:.12}", 46_086.583_217 + 0.02 * k as f64 / 86_400.0);
    let recording = read(table(&format!("{stamped}\n"), days, ",", ".", ""), &paper()).unwrap();
    assert!(recording.notes().join(" ").contains("Timestamp in days"), "{:?}", recording.notes());
    assert_eq!(recording.rows(), ROWS);
    assert!((recording.time_s()[ROWS - 1] - recording.time_s()[0] - 0.02 * (ROWS - 1) as f64).abs() < 1e-3);
    // Days without a calendar's size are no calendar's: the unit is asked for.
    let bare = table(&format!("{stamped}\n"), |k| format!("{:.12}", 0.02 * k as f64 / 86_400.0), ",", ".", "");
    let said = refused(bare, &paper());
    assert!(said.contains("seems to be in days") && said.contains("unit = \"days\""), "{said}");
    // A date beside a time of day, whatever the two are called.
    let clock = |k: usize| {
        format!("05.03.2026;13:59:{:06.3}", 10.0 + 0.02 * k as f64).replace('.', ",").replace("05,03,", "05.03.")
    };
    let named = stamped.replace("Timestamp", "Datum,Uhrzeit").replace(',', ";");
    assert_whole(&read(table(&format!("{named}\n"), clock, ";", ",", ""), &paper()).unwrap(), "Datum, Uhrzeit");
    // Times in whole seconds tell no rows apart, and sorting them is no help; the key that is named is.
    let coarse = table(&format!("{HEADER}\n"), |k| (k / 50).to_string(), ",", ".", "");
    let said = refused(&coarse, &paper());
    assert!(said.contains("the times are rounded") && said.contains("period_ms"), "{said}");
    assert_whole(&read(coarse, &with("period_ms = 20.0")).unwrap(), "period_ms");
    let again = table(&format!("{HEADER}\n"), |k| seconds(k % 55), ",", ".", "");
    let said = refused(again, &paper());
    assert!(said.contains("line 57") && said.contains("make a file of each"), "{said}");
}

#[test]
fn text_among_the_data_is_passed_over_and_what_is_no_table_is_called_that() {
    let plain = table(&format!("{HEADER}\n"), seconds, ",", ".", "");
    let recording = read(plain.replacen("0.60,", "Event: valve touched\n0.60,", 1) + "Total,60\n", &paper()).unwrap();
    assert_whole(&recording, "text among the data");
    let notes = recording.notes().join(" ");
    assert!(notes.contains("2 lines of text") && notes.contains("\"Event: valve touched\" in line 32"), "{notes}");
    for (name, text) in [
        ("CR", plain.replace('\n', "\r").into_bytes()),
        ("UTF-16", plain.encode_utf16().flat_map(u16::to_le_bytes).collect()),
    ] {
        assert_whole(&read(text, &paper()).unwrap_or_else(|error| panic!("{name}: {error}")), name);
    }
    let over = plain.replacen(&plain.lines().nth(1).unwrap().split(',').nth(3).unwrap().to_owned(), "OVERRANGE", 1);
    let mat4 = [0_u32, 3, 1, 0, 2]
        .iter()
        .flat_map(|word| word.to_le_bytes())
        .chain(*b"t\0")
        .chain([0; 24])
        .collect::<Vec<u8>>();
    for (bytes, words) in [
        (over.into_bytes(), ["\"OVERRANGE\" in line 2", "leave out rows"]),
        (b"{\"time_s\": [0, 0.02]}".to_vec(), ["JSON", "as CSV"]),
        (b" [{\"time_s\": 0}]".to_vec(), ["JSON", "as CSV"]),
        (b"<!DOCTYPE html><html></html>".to_vec(), ["HTML", "as CSV"]),
        (mat4, ["MATLAB 4", "-v7"]),
    ] {
        let said = refused(bytes, &paper());
        assert!(words.iter().all(|word| said.contains(word)), "{said}");
    }
    // A block of settings in brackets is no JSON.
    assert_whole(&read(format!("[Header]\nrig=3\n{plain}"), &paper()).unwrap(), "settings");
}

#[test]
fn a_row_that_was_cut_off_is_left_out_and_said() {
    let text = table(&format!("{HEADER}\n"), seconds, ",", ".", "") + "1.20,0.7,0.8,9";
    let recording = read(text, &paper()).unwrap();
    assert_whole(&recording, "cut");
    assert!(recording.notes()[0].contains("line 62: the last row is cut off"), "{:?}", recording.notes());
}

#[test]
fn units_are_brought_to_the_rigs() {
    let volts = |k: usize| {
        let [a, b, p, n] = row(k);
        // 1 … 5 V are 0 … 1000 and 0 … −101 kPa.
        format!("{},{},{},{},{}\n", seconds(k), 100.0 * a, b, 1.0 + 0.004 * p, 1.0 - 4.0 / 101.0 * n)
    };
    let text = format!("{HEADER}\ns,%,-,V,V\n") + &(0..ROWS).map(volts).collect::<String>();
    assert_whole(&read(text, &paper()).unwrap(), "volts and per cent");
    let absolute = |k: usize| {
        let [a, b, p, n] = row(k);
        format!("{};{a};{b};{};{}\n", 20 * k, 10.0 * (p + 101.325), (n + 101.325) / 6.894_757_293_168)
    };
    let text = "t [ms];a;b;P1 (hPa abs);P2\n".to_owned() + &(0..ROWS).map(absolute).collect::<String>();
    let map = "time = \"t\"\ncolumns.u_pos = \"a\"\ncolumns.u_neg = \"b\"\ncolumns.p_pos_kpa = \"P1\"\n\
               columns.p_neg_kpa = { from = \"P2\", unit = \"psia\" }";
    assert_whole(&read(text, &with(map)).unwrap(), "absolute");
    // An explicit scale is of the file's own numbers, whatever unit stands beside them.
    let scaled = |k: usize| {
        let [a, b, p, n] = row(k);
        format!("{},{a},{b},{},{n}\n", seconds(k), 10.0 * p)
    };
    let text = format!("{}\n", HEADER.replace("p_pos_kpa", "P [mbar]")) + &(0..ROWS).map(scaled).collect::<String>();
    assert_whole(&read(&text, &with("columns.p_pos_kpa = { from = \"P\", scale = 0.1 }")).unwrap(), "scale");
    assert_whole(&read(&text, &with("columns.p_pos_kpa = \"P\"")).unwrap(), "the file's unit");
}

/// Bars between cells, names in another case, and units that stand behind each number instead of above them.
#[test]
fn bars_names_in_another_case_and_units_in_every_cell_are_read() {
    let bars = HEADER.replace(',', "|");
    let recording = read(table(&format!("{bars}\n"), seconds, "|", ".", ""), &paper()).unwrap();
    assert_whole(&recording, "bars");
    assert!(recording.notes()[0].contains("bars between cells"), "{:?}", recording.notes());
    let shouted = HEADER.to_ascii_uppercase();
    let recording = read(table(&format!("{shouted}\n"), seconds, ",", ".", ""), &paper()).unwrap();
    assert_whole(&recording, "another case");
    assert_eq!(recording.names().count(), 4, "{:?}", recording.names().collect::<Vec<_>>());
    // Where both are there, the exact name is meant; it is one column of two.
    let both = table(&format!("{HEADER},P_POS_KPA\n"), seconds, ",", ".", ",7");
    assert_whole(&read(both, &paper()).unwrap(), "both cases");

    let with_units = |separator: &str, decimal: &str, blank: &str, kpa: [f64; 2], pressures: [&str; 2]| {
        let mut text = HEADER.replace(',', separator) + "\n";
        for k in 0..ROWS {
            let [u, v, p, n] = row(k);
            let cells = [
                format!("{:.3}{blank}s", 0.02 * k as f64),
                format!("{:.5}{blank}%", 100.0 * u),
                format!("{v:.6}"),
                format!("{:.6}{blank}{}", p * kpa[0], pressures[0]),
                format!(
                    "{:.6}{blank}{}",
                    n * kpa[1] + if pressures[1].ends_with("abs") { 101.325 } else { 0.0 },
                    pressures[1]
                ),
            ];
            text.push_str(&(cells.map(|cell| cell.replace('.', decimal)).join(separator) + "\n"));
        }
        text
    };
    for (name, text) in [
        ("apart", with_units(",", ".", " ", [1.0, 1.0], ["kPa", "kPa"])),
        ("joined", with_units(",", ".", "", [10.0, 1.0], ["mbar", "kPa"])),
        ("absolute", with_units(";", ",", " ", [0.01, 1.0], ["bar", "kPa abs"])),
    ] {
        let recording = read(&text, &paper()).unwrap();
        assert_whole(&recording, name);
        assert!(recording.notes()[0].contains("u_pos in %"), "{:?}", recording.notes());
    }
    // Units that change from row to row cannot be one column's.
    let mixed = with_units(",", ".", " ", [1.0, 1.0], ["kPa", "kPa"]).replacen("kPa", "Pa", 3);
    let said = refused(mixed, &paper());
    assert!(said.contains("line 4, column 4 (p_pos_kpa): units change in this line (Pa, kPa)"), "{said}");
    let bare = with_units(",", ".", " ", [1.0, 1.0], ["kPa", "kPa"]).replacen(" kPa", "", 3);
    assert!(refused(bare, &paper()).contains("p_pos_kpa"));
    // Of cells with units the one that is none is named, and one without a reading is one reading.
    let with = |cell: &str| {
        let text = with_units(",", ".", " ", [1.0, 1.0], ["kPa", "kPa"]);
        let line = text.lines().nth(30).unwrap();
        let cells: Vec<&str> = line.split(',').collect();
        text.replace(line, &line.replace(cells[3], cell))
    };
    assert!(refused(with("89.O12 kPa"), &paper()).contains("line 31, column 4 (p_pos_kpa): \"89.O12 kPa\""));
    let lacking = read(with("NaN"), &paper()).unwrap();
    assert_eq!(lacking.rows(), ROWS);
    assert!(lacking.notes().join(" ").contains("line 31"), "{:?}", lacking.notes());
}

#[test]
fn what_cannot_be_found_out_can_be_said() {
    let bare = table("", |k| k.to_string(), ",", ".", "");
    let said = refused(&bare, &paper());
    assert!(said.contains("[recording] names"), "{said}");
    let names = "names = [\"k\", \"u_pos\", \"u_neg\", \"p_pos_kpa\", \"p_neg_kpa\"]";
    let said = refused(&bare, &with(names));
    assert!(said.contains("period_ms"), "{said}");
    assert_whole(&read(&bare, &with(&format!("{names}\nperiod_ms = 20.0"))).unwrap(), "names and period");
    // Numbers for names, which only `header_line` tells from data.
    let numbered = table("9,1,2,3,4\n", seconds, ",", ".", "");
    let map = "header_line = 1\ntime = \"9\"\ncolumns.u_pos = \"1\"\ncolumns.u_neg = \"2\"\ncolumns.p_pos_kpa = \"3\"\ncolumns.p_neg_kpa = \"4\"";
    assert_whole(&read(numbered, &with(map)).unwrap(), "header_line");
    let piped = table(&format!("{}\n", HEADER.replace(',', ";")), |k| seconds(k).replace('.', ","), ";", ",", "");
    assert_whole(&read(piped, &with("separator = \";\"\ndecimal = \",\"")).unwrap(), "told");
}

#[test]
fn every_refusal_names_the_key_that_helps() {
    let rows = table("", seconds, ",", ".", "");
    let headed = |header: &str| format!("{header}\n{rows}");
    let hot = format!("{HEADER}\n0,77,1,1,-1\n0.02,0.5,1,1,-1\n");
    let cases: [(&str, String, Rig, &[&str]); 9] = [
        (
            "no time",
            headed("a,u_pos,u_neg,p_pos_kpa,p_neg_kpa"),
            paper(),
            &["column time_s is missing", "[recording] time", "period_ms"],
        ),
        (
            "no command",
            headed("t,duty,u_neg,p_pos_kpa,p_neg_kpa"),
            paper(),
            &["line 1: column u_pos is missing", "[recording] columns.u_pos"],
        ),
        (
            "mapped away",
            headed("t,a,u_neg,p_pos_kpa,p_neg_kpa"),
            with("time = \"t\"\ncolumns.u_pos = \"duty\""),
            &["column duty is missing", "columns.u_pos asks for it"],
        ),
        ("scale", hot, paper(), &["line ", "(u_pos)", "outside 0 … 1", "scale = 0.01"]),
        (
            "eight bits",
            format!("{HEADER}\n0,255,1,1,-1\n0.02,0,1,1,-1\n"),
            paper(),
            &["reaches 255", "scale = 0.00392157"],
        ),
        (
            "ms",
            format!("{HEADER}\n0,1,1,0,0\n20,1,1,0,0\n40,1,1,0,0\n"),
            paper(),
            &["rows are 20000 ms apart", "milliseconds", "unit = \"ms\""],
        ),
        ("odd ms", format!("{HEADER}\n0,1,1,0,0\n33,1,1,0,0\n66,1,1,0,0\n"), paper(), &["33 s apart", "unit = \"ms\""]),
        (
            "other unit",
            format!("{}\n0,1,1,0,0\n0.02,1,1,0,0\n", HEADER.replace("p_pos_kpa", "p_pos_kpa [L/min]")),
            paper(),
            &["its unit is L/min", "scale = …"],
        ),
        (
            "unknown unit",
            headed(HEADER),
            with("columns.u_pos = { from = \"u_pos\", unit = \"furlong\" }"),
            &["furlong", "no unit known"],
        ),
    ];
    for (name, text, rig, words) in cases {
        let said = refused(text, &rig);
        for word in words {
            assert!(said.contains(word), "{name}: `{word}` is not in: {said}");
        }
    }
    for (bytes, word) in [
        (&b"MATLAB 7.3 MAT-file, Platform: GLNXA64"[..], "'-v7'"),
        (b"\x89HDF\r\n\x1a\n", "an HDF5 file, damaged or cut off"),
        (b"PAR1....", "read_parquet"),
        (b"PK\x03\x04....", "save the sheet as CSV"),
        (b"\x1f\x8b\x08", "gunzip"),
    ] {
        let said = refused(bytes, &paper());
        assert!(said.contains(word), "{said}");
    }
}

/// The key that a refusal says to write into the rig file is the one that makes the file readable.
#[test]
fn the_key_that_a_refusal_names_helps() {
    let percent = |k: usize| {
        let [a, b, p, n] = row(k);
        format!("{},{},{b},{},{n}\n", 20 * k, 100.0 * a, p + 101.325)
    };
    let text = format!("{HEADER}\n") + &(0..ROWS).map(percent).collect::<String>();
    let map = "time = { from = \"time_s\", unit = \"ms\" }\ncolumns.u_pos = { from = \"u_pos\", scale = 0.01 }\n\
               columns.p_pos_kpa = { from = \"p_pos_kpa\", unit = \"kPa abs\" }";
    assert_whole(&read(text, &with(map)).unwrap(), "own names, other units");
}

/// A column that a rig asks for must hold numbers; any other is nobody's business.
#[test]
fn nan_matters_only_where_it_is_asked_for() {
    let text = format!("{HEADER},ambient_c,v\n0,1,1,0,0,21,1.5\n0.02,1,1,0,0,NaN,-\n0.04,1,1,0,0,,inf\n");
    for rig in [paper(), with("columns.p_pos_kpa = \"p_pos_kpa\"")] {
        let recording = read(&text, &rig).unwrap();
        assert_eq!(recording.text_column("ambient_c").unwrap(), ["21", "NaN", ""]);
        assert_eq!(recording.names().last(), Some("v"));
    }
    let said = refused(text.replace("0.04,1,1,0,0", "0.04,1,1,NaN,0"), &paper());
    assert!(said.contains("line 4, column 4 (p_pos_kpa): NaN is not a finite number"), "{said}");
}
