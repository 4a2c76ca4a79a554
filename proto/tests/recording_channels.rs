//! Channels of different rates in one file, files whose rate changes, and files that were compressed to be mailed.

#![allow(clippy::unwrap_used, clippy::panic, reason = "the helpers of a test fail by panicking, as the test does")]

use model::rig::Rig;
use proto::recording::{Recording, RecordingError};
use ruzstd::encoding::{CompressionLevel, compress_to_vec};

const HEADER: &str = "time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa";

fn paper() -> Rig {
    Rig::builtin("dual_pressure").unwrap()
}

fn read(bytes: impl AsRef<[u8]>) -> Result<Recording, RecordingError> {
    Recording::parse_for("x.csv", bytes.as_ref(), &paper())
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
        let said = read(&bytes[..24]).unwrap_err().to_string();
        assert!(said.contains(name) && said.contains("cut off near its beginning"), "{said}");
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

/// A disk that was full, a transfer that broke off: rows up to there, each as it was written, and a line that says so.
#[test]
fn a_compressed_file_that_is_cut_off_gives_its_whole_rows() {
    // Several blocks of zstd, which is cut between them: 128 KiB each.
    const ROWS: usize = 20_000;
    let line = |k: usize| {
        let (t, x) = (0.02 * k as f64, (0.1 * k as f64).sin());
        format!("{t:.2},{:.3},0.8,{:.4},{:.4}\n", 0.5 + 0.01 * (k % 7) as f64, 90.0 + x, -60.0 - x)
    };
    let text = format!("{HEADER}\n{}", (0..ROWS).map(line).collect::<String>());
    let plain = read(&text).unwrap();
    let (head, tail) = text.split_at(text.len() / 3);
    let zstd = |text: &str| compress_to_vec(text.as_bytes(), CompressionLevel::Fastest);
    let (gzip_parts, zstd_parts) = ([gzip(head.as_bytes()), gzip(tail.as_bytes())], [zstd(head), zstd(tail)]);
    let utf16: Vec<u8> = "\u{feff}".encode_utf16().chain(text.encode_utf16()).flat_map(u16::to_le_bytes).collect();
    // Each with a further cut within the head of its second part, where it has one.
    let files = [
        ("gzip", gzip(text.as_bytes()), None),
        ("gzip", gzip_parts.concat(), Some(gzip_parts[0].len() + 2)),
        ("gzip", gzip(&utf16), None),
        ("zstd", zstd(&text), None),
        ("zstd", zstd_parts.concat(), Some(zstd_parts[0].len() + 2)),
    ];
    for (number, (name, bytes, within_head)) in files.iter().enumerate() {
        let said = format!("x.csv: compressed with {name} and cut off; what is in it up to there is read");
        let mut rows_before = 0;
        // Also within what stands behind the last block.
        let mut cuts = vec![bytes.len() * 6 / 10, bytes.len() * 7 / 10, bytes.len() * 8 / 10 + 1, bytes.len() - 3];
        cuts.extend(within_head);
        cuts.sort_unstable();
        for cut in cuts {
            let recording = read(&bytes[..cut]).unwrap_or_else(|error| panic!("{name} {number}, {cut}: {error}"));
            assert_eq!(recording.notes()[0], said, "{number}, {cut}");
            let rows = recording.rows();
            assert!(rows > ROWS / 4 && rows >= rows_before, "{name} {number}, {cut}: {rows} rows behind {rows_before}");
            let pressures = |of: &Recording| of.column("p_pos_kpa").unwrap()[..rows].to_vec();
            assert_eq!(pressures(&recording), pressures(&plain), "{name} {number}, {cut}");
            rows_before = rows;
        }
        // Of gzip the last cut is within the length behind the checksum, and every row is there. Of zstd the last block is lost with its
        // last byte: 128 KiB at 30 bytes a row or so, less than 5000 rows.
        let least = if *name == "zstd" { ROWS - 5_000 } else { ROWS };
        assert!((least..=ROWS).contains(&rows_before), "{name} {number}: {rows_before} rows");
        assert_eq!(read(bytes).unwrap().notes(), plain.notes(), "{name} {number}: a whole one says nothing of it");
    }
}

/// Frames one behind the other, as `zstd` appends and `pzstd` writes them, with frames that hold nothing of the content before each.
#[test]
fn all_frames_of_a_zstd_file_are_read() {
    let text = table(600, 20.0, 1, "");
    let (head, tail) = text.split_at(text.len() / 3);
    let parts = [head, tail].map(|text| compress_to_vec(text.as_bytes(), CompressionLevel::Fastest));
    let skippable = [&b"\x50\x2a\x4d\x18\x04\0\0\0"[..], b"size"].concat();
    let plain = read(&text).unwrap();
    for bytes in [parts.concat(), [&skippable, &parts[0], &skippable, &parts[1]].map(Vec::as_slice).concat()] {
        let recording = read(&bytes).unwrap();
        assert_eq!(recording.column("p_pos_kpa"), plain.column("p_pos_kpa"));
    }
    let mut damaged = parts.concat();
    // The kind of a block that there is none of, in the second frame's first block.
    let at = parts[0].len() + 4 + 2;
    damaged.splice(at.., [0xFF; 40]);
    assert!(read(&damaged).is_err());
}

/// Moments of the two loggers of [`side_by_side`] (s): commands at 50 Hz, pressures at 10 Hz or so.
fn command_s(k: usize) -> f64 {
    0.02 * k as f64
}
const COMMANDS: usize = 1500;

fn duty(k: usize) -> f64 {
    0.5 + 0.01 * (k % 7) as f64
}

/// Two tables of unequal length beside each other: times as `time` writes those of the first (0) and of the second (1), pressures every
/// `step_s`, in columns of these names.
fn side_by_side(names: &str, step_s: f64, time: impl Fn(usize, f64) -> String) -> String {
    let readings = (command_s(COMMANDS) / step_s) as usize;
    let line = |k: usize| {
        let commands =
            if k < COMMANDS { format!("{},{},0.8", time(0, command_s(k)), duty(k)) } else { ",,".to_owned() };
        let t = step_s * k as f64;
        let pressures = format!("{},{:.6},{:.6}", time(1, t), pressure(t), -0.1 * pressure(t));
        format!("{commands},{}\n", if k < readings { pressures } else { ",,".to_owned() })
    };
    format!("{names}\n{}", (0..COMMANDS.max(readings)).map(line).collect::<String>())
}

fn plain(_: usize, time_s: f64) -> String {
    format!("{time_s:.4}")
}

/// Paired row by row, a pressure would stand beside the command of another second.
#[test]
fn two_clocks_side_by_side_are_brought_together() {
    let names = "time_s,u_pos,u_neg,t_p,p_pos_kpa,p_neg_kpa";
    for (name, text, step_s) in [
        ("called a time", side_by_side(names, 0.1, plain), 0.1),
        ("called nothing", side_by_side(&names.replace("t_p", "x2"), 0.1, plain), 0.1),
        ("not much slower", side_by_side(names, 0.024, plain), 0.024),
        ("hardly slower", side_by_side(names, 0.0203, plain), 0.0203),
        ("quicker", side_by_side(names, 0.01, plain), 0.01),
        ("since 1970", side_by_side(names, 0.1, |_, time_s| format!("{:.4}", 1.774e9 + time_s)), 0.1),
    ] {
        let of = read(&text).unwrap_or_else(|error| panic!("{name}: {error}"));
        let told = of.notes().join("\n");
        assert!(told.contains("2 columns of times (time_s, ") && told.contains("1 of them slower"), "{name}: {told}");
        assert!(of.time_s().last().unwrap() > &(command_s(COMMANDS) - 0.2), "{name}: {told}");
        let [u, p] = of.require(["u_pos", "p_pos_kpa"]).unwrap();
        // Where the last row lacks a reading no line leads to it.
        for (row, t) in of.time_s().iter().enumerate().take(of.rows() - 1).skip(2) {
            let k = (t / 0.02).round() as usize;
            assert!((u[row] - duty(k)).abs() < 0.07, "{name}: {row}");
            // A reading goes to the nearest row, half a row of 20 ms off at most, where the pressure moves by t kPa/s;
            // a line between readings 0.1 s apart is off by h²/8.
            assert!((p[row] - pressure(*t)).abs() < 0.0101 * t + 0.1 * 0.1 / 8.0 + 0.02, "{name}: {row} {}", p[row]);
        }
        if step_s == 0.1 {
            // Every fifth row has a reading of its own moment, to the digit.
            assert!(of.time_s().iter().zip(p).step_by(5).all(|(t, p)| (p - pressure(*t)).abs() < 1e-5), "{name}");
            let measured = of.measured().unwrap();
            assert!(measured.iter().enumerate().all(|(row, read)| *read == row.is_multiple_of(5)), "{name}");
        }
    }
}

#[test]
fn two_clocks_that_cannot_be_brought_together_are_refused_by_name() {
    let names = "time_s,u_pos,u_neg,t_p,p_pos_kpa,p_neg_kpa";
    let in_ms = |of: usize, time_s: f64| if of == 0 { plain(0, time_s) } else { format!("{:.1}", 1e3 * time_s) };
    let later = |of: usize, time_s: f64| plain(0, if of == 0 { time_s } else { 500.0 + time_s });
    let dated = |of: usize, time_s: f64| {
        if of == 0 { plain(0, time_s) } else { format!("2026-03-04 10:00:{time_s:06.3}") }
    };
    for (name, text, column) in [
        ("ms", side_by_side(names, 0.1, in_ms), "column 4 (t_p)"),
        ("later", side_by_side(names, 0.1, later), "column 4 (t_p)"),
        ("dates", side_by_side(names, 0.1, dated), "column 4 (t_p)"),
    ] {
        let said = read(&text).map(|of| of.notes().to_vec()).unwrap_err().to_string();
        assert!(said.contains(column) && said.contains("second clock"), "{name}: {said}");
        assert!(said.contains("fill 300 rows") && said.contains("make a file of each clock"), "{name}: {said}");
    }
    // Values to the left of their clock.
    let turned: String = side_by_side(names, 0.1, plain)
        .lines()
        .map(|line| {
            let cells: Vec<&str> = line.split(',').collect();
            format!("{},{},{},{},{},{}\n", cells[0], cells[1], cells[2], cells[4], cells[5], cells[3])
        })
        .collect();
    let said = read(turned).map(|of| of.notes().to_vec()).unwrap_err().to_string();
    assert!(said.contains("column 6 (t_p)") && said.contains("to the right of it"), "{said}");
}

/// The time of the commands in two or three columns: a pressure must not stand beside the command of its row either.
#[test]
fn a_second_clock_beside_a_time_in_several_columns_is_refused_by_name() {
    let dated = |of: usize, time_s: f64| {
        let clock = format!("10:00:{time_s:06.3}");
        if of == 0 { format!("2026-03-04,{clock}") } else { format!("2026-03-04 {clock}") }
    };
    let beside_seconds = |of: usize, time_s: f64| if of == 0 { dated(0, time_s) } else { plain(1, time_s) };
    let thousandths = |time_s: f64| (1e3 * time_s).round() as u64;
    let with_ms = |of: usize, time_s: f64| {
        let ms = thousandths(time_s);
        if of == 0 { format!("2026-03-04,10:00:{:02},{}", ms / 1000, ms % 1000) } else { plain(1, time_s) }
    };
    let stamp = |of: usize, time_s: f64| {
        let ms = thousandths(time_s);
        if of == 0 { format!("{},{}", ms / 1000, ms % 1000 * 1_000_000) } else { plain(1, time_s) }
    };
    let of_map = "[recording]\ntime = [{ from = \"sec\" }, { from = \"nanosec\", scale = 1e-9 }]\n";
    let stamped = Rig::from_toml(&format!("{}\n{of_map}", paper().to_toml().unwrap())).unwrap();
    let several = "the time stands in more than one column";
    let another = "the two do not cover the same time in the same unit";
    let cases: [(&str, &dyn Fn(usize, f64) -> String, Rig, &str); 4] = [
        ("Date,Time", &dated, paper(), several),
        ("Date,Time", &beside_seconds, paper(), another),
        ("Date,Time,ms", &with_ms, paper(), another),
        ("sec,nanosec", &stamp, stamped, several),
    ];
    for (names, time, rig, why) in cases {
        let text = side_by_side(&format!("{names},u_pos,u_neg,t_p,p_pos_kpa,p_neg_kpa"), 0.1, time);
        let said = Recording::parse_for("x.csv", text.as_bytes(), &rig).map(|of| of.notes().to_vec());
        let said = said.unwrap_err().to_string();
        let first = format!("fill 300 rows and {}, the time, fills 1500", names.replace(',', " and "));
        assert!(said.contains("(t_p): a second clock") && said.contains(&first), "{names}: {said}");
        assert!(said.contains(why) && said.contains("make a file of each clock"), "{names}: {said}");
    }
}

/// A counter, a second time in another unit and a sensor's own stamp go on with the rows: they are no clock of other rows, also where the
/// sensor came off before the end.
#[test]
fn what_goes_on_with_the_rows_is_no_second_clock() {
    let beside = |name: &str, of: &dyn Fn(usize) -> String, until: usize| {
        let line = |k: usize| {
            let t = command_s(k);
            let sensor = if k < until {
                format!("{},{:.6},{:.6}", of(k), pressure(t), -0.1 * pressure(t))
            } else {
                ",,".to_owned()
            };
            format!("{t:.2},{},0.8,{sensor}\n", duty(k))
        };
        let rows: String = (0..COMMANDS).map(line).collect();
        read(format!("time_s,u_pos,u_neg,{name},p_pos_kpa,p_neg_kpa\n{rows}")).unwrap()
    };
    let stamped = |k: usize| format!("{:.4}", command_s(k) + 0.003 + 0.004 * (k % 5) as f64 / 5.0);
    let columns: [(&str, &dyn Fn(usize) -> String); 7] = [
        ("tick", &|k| k.to_string()),
        ("time_tick", &|k| (2 * k).to_string()),
        ("t_ms", &|k| (20 * k).to_string()),
        ("time_min", &|k| format!("{:.7}", command_s(k) / 60.0)),
        ("t_p", &stamped),
        ("stamp_ns", &|k| (1_774_000_000_000_000_000 + 20_000_000 * k as u64).to_string()),
        ("t_amb", &|k| format!("{:.3}", 21.0 + 0.01 * (0.01 * k as f64).sin())),
    ];
    for (name, of) in columns {
        for until in [COMMANDS, 1450, 1000] {
            let read = beside(name, of, until);
            let told = read.notes().join("\n");
            assert!(!told.contains("columns of times"), "{name} until {until}: {told}");
            assert!((read.column("p_pos_kpa").unwrap()[700] - pressure(command_s(700))).abs() < 1e-5, "{name} {until}");
        }
    }
}
