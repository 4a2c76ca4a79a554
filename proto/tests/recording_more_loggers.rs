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
    for word in
        ["-9999", "Inf", "-999.0", "1e999", "9.9E37", "9.91E+37", "1E30", "-3.4e38", "n.d.", "Over", "---.--", "-∞"]
    {
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

/// Taken for µs, as they seem to be by their distance alone, rows would stand ten times too far apart.
#[test]
fn steps_of_100_ns_are_those_of_windows_and_of_net() {
    for (first, words) in [(134_000_000_000_000_000_u64, "since 1601"), (639_000_000_000_000_000, "since the year 1")] {
        let text = "time,u_pos,u_neg,p_pos_kpa,p_neg_kpa\n".to_owned()
            + &rows(|k, n| format!("{},{}", first + 200_000 * k as u64, n.join(",")));
        let of = assert_read(&text);
        assert_eq!(of.segments().len(), 1, "{words}");
        // Between numbers as large as those of .NET lie 128 such steps, so that one is off by half of that, 6.4 µs, at most.
        assert!((of.time_s()[ROWS - 1] - of.time_s()[0] - 0.02 * (ROWS - 1) as f64).abs() < 7e-6, "{words}");
        assert!(of.notes().join(" ").contains(words), "{words}: {:?}", of.notes());
    }
}
