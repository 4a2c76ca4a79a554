//! Data loggers, serial monitors and counters: tables whose head, cells or clock are of another kind.

#![allow(clippy::unwrap_used, reason = "the helpers of a test fail by panicking, as the test does")]

use model::rig::Rig;
use proto::recording::{Recording, RecordingError};

const ROWS: usize = 60;

fn read(text: &str) -> Result<Recording, RecordingError> {
    Recording::parse_for("x.csv", text.as_bytes(), &Rig::builtin("dual_pressure").unwrap())
}

/// Commands and pressures of a row.
fn numbers(k: usize) -> [String; 4] {
    let x = k as f64;
    [0.5 + 0.001 * x, 0.6, 90.0 + (0.7 * x).sin(), -60.0 - (0.9 * x).cos()].map(|number| format!("{number:.4}"))
}

/// Reads a text of rows; all of them are there, 20 ms apart, with their numbers.
fn assert_read(text: &str) -> Recording {
    let of = read(text).unwrap();
    assert_eq!((of.rows(), of.segments().len()), (ROWS, 1), "{:?}", of.notes());
    for (at, name) in ["u_pos", "u_neg", "p_pos_kpa", "p_neg_kpa"].into_iter().enumerate() {
        let expected: Vec<f64> = (0..ROWS).map(|k| numbers(k)[at].parse().unwrap()).collect();
        assert_eq!(of.column(name).unwrap(), expected, "{name}");
    }
    let time_s = of.time_s();
    assert!(time_s[0].abs() < 1e-6 && (time_s[50] - 1.0).abs() < 1e-6, "{} {}", time_s[0], time_s[50]);
    of
}

fn rows(line: impl Fn(usize, [String; 4]) -> String) -> String {
    (0..ROWS).map(|k| line(k, numbers(k)) + "\n").collect()
}

fn clock(k: usize) -> String {
    format!("13:59:{:06.3}", 59.0 + 0.02 * k as f64).replace("13:59:60.", "14:00:00.")
}

#[test]
fn heads_of_data_loggers_are_read() {
    let stamp = |k: usize| format!("\"2026-03-29 12:00:{:05.2}\",{k}", 0.02 * k as f64);
    let of = assert_read(
        &("\"TOA5\",\"CR1000X\",\"rig\",\"1\",\"std\",\"prog\",\"1234\",\"data\"\n\
           \"TIMESTAMP\",\"RECORD\",\"u_pos\",\"u_neg\",\"p_pos_kpa\",\"p_neg_kpa\"\n\
           \"TS\",\"RN\",\"\",\"\",\"kPa\",\"kPa\"\n\"\",\"\",\"Smp\",\"Smp\",\"Smp\",\"Smp\"\n"
            .to_owned()
            + &rows(|k, n| format!("{},{}", stamp(k), n.join(",")))),
    );
    assert!(of.notes()[0].contains("TIMESTAMP as date and time"), "{:?}", of.notes());
    assert_read(
        &("| time_s | u_pos | u_neg | p_pos_kpa | p_neg_kpa |\n|---|---|---|---|---|\n".to_owned()
            + &rows(|k, n| format!("| {:.2} | {} |", 0.02 * k as f64, n.join(" | ")))),
    );
    assert_read(
        &("sample,rosbagTimestamp,u_pos (),u_neg [],p_pos_kpa (kPa),p_neg_kpa (kPa)\n".to_owned()
            + &rows(|k, n| format!("{k},{},{}", 1_774_749_590_000_000_000_u64 + 20_000_000 * k as u64, n.join(",")))),
    );
}

#[test]
fn what_a_logger_adds_up_below_is_passed_over() {
    let table = "time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa\n".to_owned()
        + &rows(|k, n| format!("{:.2},{}", 0.02 * k as f64, n.join(",")))
        + "Mean,0.5,0.6,90.0,-60.0\nMax,0.6,0.6,91.0,-59.0\n";
    let of = assert_read(&table);
    assert!(of.notes()[0].contains("2 lines of text behind the data, from line 62 on"), "{:?}", of.notes());
}

#[test]
fn serial_monitors_are_read() {
    let names = ["u_pos", "u_neg", "p_pos_kpa", "p_neg_kpa"];
    let pairs = |n: &[String; 4]| {
        names.iter().zip(n).map(|(name, number)| format!("{name}:{number}")).collect::<Vec<_>>().join(",")
    };
    let header = format!("13:59:58.900 -> {}\n", names.join(","));
    assert_read(&(header + &rows(|k, n| format!("{} -> {}", clock(k), n.join(",")))));
    assert_read(&rows(|k, n| format!("{} -> {}", clock(k), pairs(&n))));
    assert_read(&rows(|k, n| format!("time_s:{:.2},{}", 0.02 * k as f64, pairs(&n))));
}

#[test]
fn counters_go_over_their_ends() {
    for (name, begin, step, bits) in [("ms", 65_000_u64, 20_u64, 16), ("micros", 4_294_900_000, 20_000, 32)] {
        let of = read(
            &(format!("{name},u_pos,u_neg,p_pos_kpa,p_neg_kpa\n")
                + &rows(|k, n| format!("{},{}", (begin + step * k as u64) % (1_u64 << bits), n.join(",")))),
        )
        .unwrap();
        assert_eq!((of.rows(), of.segments().len()), (ROWS, 1), "{name}");
        assert!(of.notes()[0].contains(&format!("a counter of {bits} bits that began anew once")), "{:?}", of.notes());
    }
}

#[test]
fn words_for_relays_and_numbers_for_nothing_are_known() {
    let header = "time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa,pump_on\n";
    let on = |k: usize| if k < 40 { "ON" } else { "off" };
    let table = |change: &dyn Fn(usize, &mut [String; 4])| {
        header.to_owned()
            + &rows(|k, mut n| {
                change(k, &mut n);
                format!("{:.2},{},{}", 0.02 * k as f64, n.join(","), on(k))
            })
    };
    let of = assert_read(&table(&|_, _| {}));
    assert_eq!((of.column("pump_on").unwrap()[39], of.column("pump_on").unwrap()[40]), (1.0, 0.0));
    for word in ["-9999", "Inf", "-999.0", "1e999"] {
        let of = read(&table(&|k, n| {
            if k == 30 {
                n[2] = word.to_owned();
            }
        }))
        .unwrap();
        assert_eq!((of.rows(), of.segments().len()), (ROWS, 1), "{word}");
        assert_eq!(of.missing("p_pos_kpa").unwrap().iter().filter(|missing| **missing).count(), 1, "{word}");
        assert!(
            of.notes().iter().any(|note| note.contains("1 reading of p_pos_kpa is missing (in line 32)")),
            "{word}"
        );
    }
    // Beyond any pressure, and no logger's number for nothing.
    let said = read(&table(&|k, n| {
        if k == 30 {
            n[2] = "-321.5".to_owned();
        }
    }));
    assert!(said.unwrap_err().to_string().contains("line 32"));
}

/// A run over midnight whose date and time of day stand in two columns, or whose date is that of the day on which the file was begun.
#[test]
fn a_date_beside_a_time_of_day_passes_midnight_once() {
    let clock = |k: usize| format!("23:59:{:06.3}", 59.5 + 0.02 * k as f64).replace("23:59:60.", "00:00:00.");
    let day = |k: usize| if k < 25 { "2026-03-01" } else { "2026-03-02" };
    let head = "u_pos,u_neg,p_pos_kpa,p_neg_kpa\n";
    let two = format!("Date,Time,{head}");
    assert_read(&(two.clone() + &rows(|k, n| format!("{},{},{}", day(k), clock(k), n.join(",")))));
    assert_read(&(two.clone() + &rows(|k, n| format!("2026-03-01,{},{}", clock(k), n.join(",")))));
    let german = |k: usize| if k < 25 { "01.03.2026" } else { "02.03.2026" };
    assert_read(&(two + &rows(|k, n| format!("{},{},{}", german(k), clock(k), n.join(",")))));
    let one = format!("stamp,{head}");
    assert_read(&(one.clone() + &rows(|k, n| format!("{} {},{}", day(k), clock(k), n.join(",")))));
    assert_read(&(one + &rows(|k, n| format!("2026-03-01 {},{}", clock(k), n.join(",")))));
}

#[test]
fn milliseconds_may_stand_in_a_column_of_their_own() {
    let clock = |k: usize| format!("13:59:{:02}", 57 + k / 50);
    let ms = |k: usize| 20 * k % 1000;
    assert_read(
        &("date,clock,ms,u_pos,u_neg,p_pos_kpa,p_neg_kpa\n".to_owned()
            + &rows(|k, n| format!("2026-03-29,{},{},{}", clock(k), ms(k), n.join(",")))),
    );
    let of = assert_read(
        &("timestamp;Millisekunden;u_pos;u_neg;p_pos_kpa;p_neg_kpa\n".to_owned()
            + &rows(|k, n| format!("29.03.2026 {};{};{}", clock(k), ms(k), n.join(";")))),
    );
    assert!(of.notes()[0].contains("milliseconds from Millisekunden"), "{:?}", of.notes());
    // A count of packets is none.
    let counted = "timestamp,ms,u_pos,u_neg,p_pos_kpa,p_neg_kpa\n".to_owned()
        + &rows(|k, n| format!("2026-03-29 {},{},{}", clock(k), 990 + k, n.join(",")));
    assert!(read(&counted).unwrap_err().to_string().contains("rounded"));
}

/// A LabVIEW file whose commands are written at 10 Hz and whose pressures at 50 Hz, each channel with times of its own.
#[test]
fn labview_channels_with_rates_of_their_own_are_brought_together() {
    let command = |k: usize| if (k / 10).is_multiple_of(2) { "0.5" } else { "0.7" };
    let mut text =
        "LabVIEW Measurement\t\nSeparator\tTab\nMulti_Headings\tYes\nX_Columns\tMulti\n***End_of_Header***\t\n\t\n\
                    Channels\t4\nY_Unit_Label\tVolts\t\tVolts\t\tkPa\t\tkPa\n***End_of_Header***\t\n\
                    X_Value\tu_pos\tX_Value\tu_neg\tX_Value\tp_pos_kpa\tX_Value\tp_neg_kpa\tComment\n"
            .to_owned();
    for k in 0..ROWS {
        // The fifth sample of a command is that of the twentieth row.
        let slow = if 5 * k < ROWS { format!("{:.2}\t{}", 0.1 * k as f64, command(5 * k)) } else { "\t".to_owned() };
        let (time_s, [.., p_pos, p_neg]) = (0.02 * k as f64, numbers(k));
        text += &format!("{slow}\t{slow}\t{time_s:.2}\t{p_pos}\t{time_s:.2}\t{p_neg}\n");
    }
    let of = read(&text).unwrap();
    assert_eq!((of.rows(), of.measured()), (ROWS, None), "{:?}", of.notes());
    for (at, name) in [(2, "p_pos_kpa"), (3, "p_neg_kpa")] {
        let expected: Vec<f64> = (0..ROWS).map(|k| numbers(k)[at].parse().unwrap()).collect();
        assert_eq!(of.column(name).unwrap(), expected, "{name}");
    }
    for name in ["u_pos", "u_neg"] {
        let expected: Vec<f64> = (0..ROWS).map(|k| command(k).parse().unwrap()).collect();
        assert_eq!(of.column(name).unwrap(), expected, "{name}");
    }
    assert!(of.notes().join("\n").contains("4 columns of times, 2 of them slower"), "{:?}", of.notes());
}

/// A LabVIEW file of two segments that began at these clocks, with times of their own or with a first time and a step alone; the rows of
/// the second are those of a file that goes on.
fn segments(columns: &str, clocks: [&str; 2]) -> String {
    let mut text = format!("LabVIEW Measurement\t\nSeparator\tTab\nX_Columns\t{columns}\n***End_of_Header***\t\n\t\n");
    for (segment, clock) in clocks.into_iter().enumerate() {
        let (date, time) = clock.split_once(' ').unwrap();
        text += &format!(
            "Channels\t4\nDate\t{date}\nTime\t{time}\nY_Unit_Label\t-\t-\tkPa\tkPa\nX0\t0.0\nDelta_X\t0.02\n\
             ***End_of_Header***\t\nX_Value\tu_pos\tu_neg\tp_pos_kpa\tp_neg_kpa\tComment\n"
        );
        for k in 0..ROWS {
            let time = if columns == "One" { format!("{:.2}", 0.02 * k as f64) } else { String::new() };
            text += &format!("{time}\t{}\n", numbers(segment * ROWS + k).join("\t"));
        }
    }
    text
}

/// Heads say when a program began to write, which may well be an hour later to the second: an hour between them is an hour.
#[test]
fn labview_segments_an_hour_apart_are_an_hour_apart() {
    for columns in ["One", "No"] {
        for (clock, apart_s) in [("11:00:00.0", 3600.0), ("10:59:59.3", 3599.3), ("11:00:07.0", 3607.0)] {
            let of = read(&segments(columns, ["2026/03/04 10:00:00.0", &format!("2026/03/04 {clock}")])).unwrap();
            assert_eq!((of.rows(), of.segments().len()), (2 * ROWS, 2), "{columns} {clock}: {:?}", of.notes());
            // The second segment may stand up to 1 ms beside its clock, on the grid of the rows.
            let found = of.time_s()[ROWS] - of.time_s()[0];
            assert!((found - apart_s).abs() < 2e-3, "{columns} {clock}: {found}");
            assert_eq!(of.column("p_pos_kpa").unwrap()[ROWS], numbers(ROWS)[2].parse::<f64>().unwrap());
        }
        // At the end of summer time the clock of a segment that began behind the other is before it.
        let said =
            read(&segments(columns, ["2026/10/25 02:59:30.0", "2026/10/25 02:00:10.0"])).unwrap_err().to_string();
        assert!(
            said.contains("set back") && said.contains("summer time") && said.contains("2026/10/25 02:00:10.0"),
            "{said}"
        );
        assert!(said.contains("line 81") && said.contains("make a file of each"), "{columns}: {said}");
        assert!(!said.contains("period_ms"), "rows would be one run by it: {said}");
    }
}

/// Numbers under the names and units of the first head would be those of other columns.
#[test]
fn a_labview_segment_of_other_channels_is_refused() {
    let text = segments("One", ["2026/03/04 10:00:00.0", "2026/03/04 11:00:00.0"]);
    for (from, to, words) in [
        ("u_pos\tu_neg", "u_neg\tu_pos", "u_neg,u_pos where the first has u_pos,u_neg"),
        ("kPa\tkPa", "mbar\tkPa", "mbar where the first has kPa"),
    ] {
        let (first, second) = text.split_at(text.rfind("Channels").unwrap());
        let said = read(&format!("{first}{}", second.replace(from, to))).unwrap_err().to_string();
        assert!(said.contains("line 81: another header") && said.contains(words), "{said}");
    }
}
