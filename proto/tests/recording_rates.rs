//! Sensors of one file that are read at rates of their own: the last number stands in the rows between, or nothing does. Each sensor's
//! readings count in the rows in which it was read, and nowhere else.

#![allow(clippy::unwrap_used, clippy::panic, reason = "the helpers of a test fail by panicking, as the test does")]

mod recorded;

use model::rig::Rig;
use proto::recording::{Recording, TickRecord};
use recorded::{Folder, run, write};

const ROWS: usize = 700;

fn read(text: &str) -> Recording {
    let rig = Rig::builtin("dual_pressure").unwrap();
    Recording::parse_for("x.csv", text.as_bytes(), &rig).unwrap_or_else(|error| panic!("{error}"))
}

/// Pressures that no two rows have alike, with four digits.
fn pressures(row: usize) -> [f64; 2] {
    let wave = |speed: f64| ((row as f64 * speed).sin() * 1e5).round() / 1e4;
    [90.0 + wave(0.037), -60.0 + wave(0.053)]
}

fn duty(row: usize) -> f64 {
    0.5 + 0.05 * (row % 9) as f64
}

/// A table of rows `step_s` apart with a command in each, and two cells made of its number.
fn table(step_s: f64, rows: impl Iterator<Item = usize>, cells: impl Fn(usize) -> [String; 2]) -> String {
    let line = |k: usize| format!("{:.3},{:.2},0.8,{}\n", step_s * k as f64, duty(k), cells(k).join(","));
    "time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa\n".to_owned() + &rows.map(line).collect::<String>()
}

/// The reading of a sensor as a logger writes it that holds it for so many rows.
fn held(every: [usize; 2]) -> impl Fn(usize) -> [String; 2] {
    move |k| std::array::from_fn(|of| format!("{:.4}", pressures(k / every[of] * every[of])[of]))
}

/// Reading of one rate with nothing between; the second sensor is read `late` rows later.
fn blank(every: [usize; 2], late: usize) -> impl Fn(usize) -> [String; 2] {
    move |k| {
        let is_read = [k.is_multiple_of(every[0]), k % every[1] == late];
        std::array::from_fn(|of| if is_read[of] { format!("{:.4}", pressures(k)[of]) } else { String::new() })
    }
}

/// Each sensor's readings are in its own rows, with their numbers, and nothing else is one.
#[track_caller]
fn assert_own_rows(of: &Recording, first: usize, is_read: impl Fn(usize) -> [bool; 2]) {
    for (at, name) in ["p_pos_kpa", "p_neg_kpa"].into_iter().enumerate() {
        for (row, kpa) in of.column(name).unwrap().iter().enumerate() {
            let k = row + first;
            let measured = of.measured().is_none_or(|measured| measured[row]);
            let there = measured && !of.missing(name).is_some_and(|missing| missing[row]);
            assert_eq!(there, is_read(k)[at], "{name}, row {k}");
            assert!(!there || (kpa - pressures(k)[at]).abs() < 1e-9, "{name}, row {k}: {kpa}");
        }
    }
    for (row, u) in of.column("u_pos").unwrap().iter().enumerate() {
        assert!((u - duty(row + first)).abs() < 1e-9, "commands count in every row: {row}");
    }
}

#[test]
fn a_held_sensor_is_read_where_its_number_changes() {
    for every in [[5, 1], [1, 6], [10, 7], [10, 5], [4, 2]] {
        let of = read(&table(0.02, 0..ROWS, held(every)));
        assert_own_rows(&of, 0, |k| every.map(|every| k.is_multiple_of(every)));
        let slowest = every[0].max(every[1]);
        assert!((of.sampling_s() - 0.02 * slowest as f64).abs() < 1e-9, "{every:?}: {}", of.sampling_s());
        let notes = of.notes().join("\n");
        for (name, every) in ["p_pos_kpa", "p_neg_kpa"].into_iter().zip(every) {
            let told = format!("{name} was read every {} ms (each reading stands there {every} times)", 20 * every);
            assert_eq!(notes.contains(&told), every > 1, "{notes}");
        }
        assert!(notes.contains(&format!("nothing faster than {} ms", 20 * slowest)), "{notes}");
    }
    // A logger of 100 Hz and sensors of 10 Hz: rows of 20 ms, one of five with a reading.
    let of = read(&table(0.01, 0..2 * ROWS, held([10, 10])));
    let missing = of.missing("p_pos_kpa").unwrap();
    assert!((0..of.rows()).all(|row| missing[row] != row.is_multiple_of(5)), "{:?}", of.notes());
    assert!((of.sampling_s() - 0.1).abs() < 1e-9);
}

/// A recording of the daemon with a cRIO that holds readings counts them once, as any other file does.
#[test]
fn a_daemon_records_held_readings_and_they_count_once() {
    let folder = Folder::new("held");
    let path = folder.join("run.mcap");
    let ticks = |every: [usize; 2]| -> Vec<TickRecord> {
        let held = |k: usize, of: usize| pressures(k / every[of] * every[of])[of];
        let of = |(k, tick): (usize, TickRecord)| TickRecord {
            p_pos_kpa: held(k, 0),
            p_neg_kpa: held(k, 1),
            u_pos: duty(k),
            u_neg: 0.8,
            ..tick
        };
        run(ROWS as u32).into_iter().enumerate().map(of).collect()
    };
    let rig = Rig::builtin("dual_pressure").unwrap();
    let read = |ticks: &[TickRecord]| {
        let _ = std::fs::remove_file(&path);
        write(&path, ticks, 50);
        Recording::read_for(&path, &rig).unwrap()
    };
    for every in [[5, 1], [10, 7], [4, 2], [5, 5]] {
        let of = read(&ticks(every));
        assert_own_rows(&of, 0, |k| every.map(|every| k.is_multiple_of(every)));
        let slowest = every[0].max(every[1]);
        assert!((of.sampling_s() - 0.02 * slowest as f64).abs() < 1e-9, "{every:?}: {}", of.sampling_s());
        let notes = of.notes().join("\n");
        assert!(notes.contains("counts as one") || notes.contains("only the first of each"), "{notes}");
        // What nobody asked for goes with its rows.
        assert_eq!(of.column("mode").unwrap(), vec![1.0; ROWS]);
    }
    // Behind a gap each sensor begins again.
    let parted = |every: [usize; 2]| {
        let mut ticks = ticks(every);
        ticks.drain(303..341);
        read(&ticks)
    };
    let of = parted([5, 1]);
    // What stands in its first rows was read in the gap.
    assert_eq!(of.segments(), &[0..303, 303..303 + ROWS - 345][..], "{:?}", of.notes());
    // Sensors that are read together keep these rows, as rows without a reading.
    let of = parted([5, 5]);
    let read_in: Vec<usize> = (0..of.rows()).filter(|row| of.measured().unwrap()[*row]).collect();
    let fives = (0..303).step_by(5).chain((345..ROWS).step_by(5).map(|k| k - 38));
    assert_eq!(read_in, fives.collect::<Vec<_>>(), "{:?}", of.notes());
    // So does a file that begins inside a reading.
    assert_own_rows(&read(&ticks([5, 5])[3..]), 3, |k| [k.is_multiple_of(5); 2]);
    // A rig that reads in every row is as it was.
    let of = read(&ticks([1, 1]));
    assert_eq!((of.measured(), of.missing("p_pos_kpa"), of.rows()), (None, None, ROWS));
    assert_eq!(of.notes(), Recording::read(&path).unwrap().notes());
}

#[test]
fn sensors_that_are_never_read_together_are_read_all_the_same() {
    for (every, late) in [([5, 7], 0), ([5, 7], 3), ([2, 2], 1), ([3, 9], 4)] {
        let of = read(&table(0.02, 0..ROWS, blank(every, late)));
        // A run begins where both have been read.
        assert_own_rows(&of, late, |k| [k.is_multiple_of(every[0]), k % every[1] == late]);
        assert_eq!((of.rows(), of.segments().len()), (ROWS - late, 1), "{every:?} {late}");
        let slowest = every[0].max(every[1]);
        assert!((of.sampling_s() - 0.02 * slowest as f64).abs() < 1e-9, "{every:?}: {}", of.sampling_s());
        let notes = of.notes().join("\n");
        assert!(notes.contains(&format!("(a number in one row of {})", every[1])), "{notes}");
    }
    // Behind a gap each begins again, and no line goes across it.
    let of = read(&table(0.02, (0..303).chain(341..ROWS), blank([5, 7], 3)));
    assert_eq!(of.segments(), &[0..300, 300..300 + ROWS - 346][..], "{:?}", of.notes());
    let [[before, _], [after, _]] = [pressures(345), pressures(350)];
    assert!((of.column("p_pos_kpa").unwrap()[300] - before - (after - before) / 5.0).abs() < 1e-9);
}

/// Number between -1 and 1 that goes with a number, without rhythm: splitmix64.
fn scatter(k: usize) -> f64 {
    let mut z = (k as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}

/// Rows of 50 Hz with sensors of rates that do not go into it, noise and a converter's steps of 0.05 kPa.
#[test]
fn a_rate_that_does_not_go_into_that_of_the_rows_is_found() {
    // The number of the reading that stands in a row; the second sensor is read 7 ms late.
    let reading = |k: usize, hz: f64, late_s: f64| ((0.02 * k as f64 - late_s) * hz + 1e-6).floor().max(-1.0);
    let cell = |reading: f64, hz: f64, kpa: f64, key: usize| {
        let t = reading / hz;
        let kpa = kpa + 10.0 * (1.9 * t).sin() + 0.2 * scatter(key + (reading + 1.0) as usize);
        format!("{:.2}", (kpa / 0.05).round() * 0.05)
    };
    for [one, other] in [[20.0, 20.0], [30.0, 12.5], [20.0, 30.0], [22.5, 50.0]] {
        let readings = move |k: usize| [reading(k, one, 0.0), reading(k, other, 0.007)];
        let cells = |k: usize| {
            let [a, b] = readings(k);
            [cell(a, one, 90.0, 1), cell(b, other, -60.0, 100_000)]
        };
        let rows = 3 * ROWS;
        let of = read(&table(0.02, 0..rows, cells));
        let first = rows - of.rows();
        let slowest = f64::min(one, other);
        assert!((of.sampling_s() * slowest - 1.0).abs() < 2e-3, "{one} {other}: {}", of.sampling_s());
        let notes = of.notes().join("\n");
        for (name, (at, hz)) in ["p_pos_kpa", "p_neg_kpa"].into_iter().zip([one, other].into_iter().enumerate()) {
            let there = |row: usize| {
                of.measured().is_none_or(|measured| measured[row])
                    && !of.missing(name).is_some_and(|missing| missing[row])
            };
            let is_new = |k: usize| k > 0 && readings(k)[at] > readings(k - 1)[at];
            let wrong = (1..of.rows()).filter(|row| there(*row) != is_new(row + first)).count();
            // A reading that came out as the one before may be told in a neighbouring row.
            assert!(wrong * 100 <= rows, "{one} {other}, {name}: {wrong}");
            let every = if (hz - 50.0).abs() < 1e-9 { None } else { Some(1e3 / hz) };
            let told = every.map(|ms| format!("{name} was read every {}", &format!("{ms:.1}").replace(".0", "")));
            assert!(told.is_none_or(|told| notes.contains(&told)), "{one} {other}, {name}: {notes}");
            assert_eq!(notes.contains(&format!("{name} was read")), every.is_some(), "{notes}");
        }
        let is_twice_or_thrice = [one, other].iter().any(|hz| 50.0 / 3.0 < *hz && *hz < 25.0);
        assert_eq!(is_twice_or_thrice, notes.contains("each reading stands there 2 or 3 times"), "{notes}");
    }
}

/// A sensor that comes off, and another one that is plugged in before: from where both have been read on each counts where it is there.
#[test]
fn sensors_of_two_parts_of_a_file_count_where_they_are() {
    let parts = |until: usize, from: usize| {
        move |k: usize| {
            let [one, other] = pressures(k).map(|kpa| format!("{kpa:.4}"));
            [if k < until { one } else { String::new() }, if k >= from { other } else { String::new() }]
        }
    };
    let of = read(&table(0.02, 0..ROWS, parts(450, 250)));
    assert_own_rows(&of, 250, |k| [k < 450, true]);
    assert_eq!((of.rows(), of.segments().len()), (ROWS - 250, 1));
    assert!((of.sampling_s() - 0.02).abs() < 1e-9);
    let notes = of.notes().join("\n");
    assert!(notes.contains("p_pos_kpa from 0.00 to 8.98 s, p_neg_kpa from 5.00 to 13.98 s"), "{notes}");
    assert!(notes.contains("250 rows left out before the first reading of every sensor"), "{notes}");
    // One that comes off in the middle of a file that the other one is whole in.
    let of = read(&table(0.02, 0..ROWS, parts(350, 0)));
    assert_own_rows(&of, 0, |k| [k < 350, true]);
    assert!(of.notes().join("\n").contains("p_pos_kpa from 0.00 to 6.98 s"), "{:?}", of.notes());
    // Rows are lost behind its last reading: the run that begins there is evidence on the other one.
    let of = read(&table(0.02, (0..ROWS).filter(|k| !(500..510).contains(k)), parts(350, 0)));
    assert_eq!(of.segments().len(), 2, "{:?}", of.notes());
    let row_of = |k: usize| of.time_s().iter().position(|time_s| (time_s - 0.02 * k as f64).abs() < 1e-6).unwrap();
    let there = |name: &str, row: usize| {
        of.measured().is_none_or(|measured| measured[row]) && !of.missing(name).is_some_and(|missing| missing[row])
    };
    for k in 510..ROWS {
        let row = row_of(k);
        let kpa = of.column("p_neg_kpa").unwrap()[row];
        assert!((kpa - pressures(k)[1]).abs() < 1e-9, "row {k}: {kpa}");
        assert!(there("p_neg_kpa", row) && !there("p_pos_kpa", row), "row {k}");
        assert!(of.column("p_pos_kpa").unwrap()[row].is_finite(), "row {k}");
    }
    // Never both: no run can begin, and what is there and what would help is told.
    let rig = Rig::builtin("dual_pressure").unwrap();
    let text = table(0.02, 0..ROWS, parts(350, 350));
    let said = Recording::parse_for("x.csv", text.as_bytes(), &rig).unwrap_err().to_string();
    for part in ["x.csv: ", "p_pos_kpa from 0.00 to 6.98 s, p_neg_kpa from 7.00 to 13.98 s", "[recording] columns.p_"] {
        assert!(said.contains(part), "{said}");
    }
}

/// A chamber at rest and a coarse converter repeat their readings, too, and are read in every row.
#[test]
fn what_stands_by_itself_is_not_held() {
    let noise = |k: usize| ((k * 7919 % 1000) as f64 / 1000.0 * 37.0).sin();
    let step = |kpa: f64| format!("{:.1}", (kpa * 2.0).round() / 2.0);
    let resting = |k: usize| [step(90.0), step(-60.0 + 0.3 * noise(k))];
    let ramp = |k: usize| [step(90.0 + 0.1 * k as f64), step(-60.0 + (k as f64 * 0.02).sin() + 0.1 * noise(k))];
    for text in [table(0.02, 0..ROWS, resting), table(0.02, 0..ROWS, ramp)] {
        let of = read(&text);
        assert_eq!((of.measured(), of.missing("p_pos_kpa"), of.missing("p_neg_kpa")), (None, None, None));
        assert!(
            (of.sampling_s() - 0.02).abs() < 1e-9 && !of.notes().join("\n").contains("was read"),
            "{:?}",
            of.notes()
        );
    }
}
