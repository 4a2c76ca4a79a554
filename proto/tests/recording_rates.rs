//! Sensors of one file that are read at rates of their own: the last number stands in the rows between, or nothing does. Each sensor's
//! readings count in the rows in which it was read, and nowhere else.

#![allow(clippy::unwrap_used, clippy::panic, reason = "the helpers of a test fail by panicking, as the test does")]

use model::rig::Rig;
use proto::recording::Recording;

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

/// The same with nothing between; the second sensor is read `late` rows later.
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
