//! Recordings in which the pump starts: whoever starts logger and pump at once has a sound recording, and whoever starts the logger first
//! is told what it lacks.

// What fails here fails the test, helper functions included.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod program;

use program::{Csv, Folder, json, refused, run, sound};

const NAMES: [&str; 4] = ["u_pos", "u_neg", "p_pos_kpa", "p_neg_kpa"];

/// The paper's rig from rest under holds of one to five seconds that differ with `seed`, with 0.05 kPa of noise; by column.
fn from_rest(folder: &Folder, seed: u64, rows: usize) -> Vec<Vec<f64>> {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let mut draw = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / f64::from(1u32 << 31)
    };
    let mut duties = [Vec::new(), Vec::new()];
    for duty in &mut duties {
        duty.resize(50, 1.0);
        while duty.len() < rows {
            let (level, hold) = (0.65 + 0.3 * draw(), 50 + (200.0 * draw()) as usize);
            duty.resize(duty.len() + hold, level);
        }
        duty.truncate(rows);
    }
    let lines: String =
        (0..rows).map(|k| format!("{:.2},{},{},0,0\n", 0.02 * k as f64, duties[0][k], duties[1][k])).collect();
    let inputs = folder.with("inputs.csv", format!("time_s,{}\n{lines}", NAMES.join(",")));
    let out = folder.path("out.csv");
    sound(["simulate", "--inputs", &inputs, "--out", &out]);
    let csv = Csv::read(out);
    let mut columns: Vec<Vec<f64>> = NAMES.iter().map(|name| csv.numbers(name)).collect();
    // Sums of twelve even numbers have variance 1.
    for kpa in columns.iter_mut().skip(2).flatten() {
        *kpa += 0.05 * ((0..12).map(|_| draw()).sum::<f64>() - 6.0);
    }
    columns
}

fn written(folder: &Folder, name: &str, columns: &[Vec<f64>]) -> String {
    let row = |k: usize| {
        let cells: Vec<String> = columns.iter().map(|column| format!("{:.5}", column[k])).collect();
        format!("{:.2},{}\n", 0.02 * k as f64, cells.join(","))
    };
    let rows: String = (0..columns[0].len()).map(row).collect();
    folder.with(name, format!("time_s,{}\n{rows}", NAMES.join(",")))
}

/// The error of an averaged pump in the first strokes into empty chambers was taken for another volume, or a delay.
#[test]
fn a_sound_rig_that_starts_with_the_recording_lacks_nothing() {
    let folder = Folder::new("starts");
    let files = [1, 2].map(|seed| written(&folder, &format!("run{seed}.csv"), &from_rest(&folder, seed, 2000)));
    let out = folder.path("found");
    let said = json(&["diagnose", "--quick", "--json", &files[0], &files[1], "--out", &out]);
    assert_eq!((&said["verdict"], said["rivals"].as_array().map(Vec::len)), (&"adequate".into(), Some(0)), "{said:#}");
    assert!(said["notes"].to_string().contains("no motor starts at once"), "{said:#}");
}

#[test]
fn a_pump_that_starts_after_the_logger_is_told_with_its_time_and_the_column_that_says_so() {
    let folder = Folder::new("late");
    let mut columns = from_rest(&folder, 3, 1500);
    for (at, column) in columns.iter_mut().enumerate() {
        // Both vents open; sensors at the atmosphere scatter by some hundredths of a kPa.
        let before = |k: i32| if at < 2 { 1.0 } else { 0.05 * f64::from(k * k + at as i32).sin() };
        column.splice(0..0, (0..150).map(before));
    }
    let late = written(&folder, "late.csv", &columns);
    let words = |said: &str| {
        for word in ["late.csv", "from 0.00 to ", "was the pump off", "pump_on", "leave these rows out"] {
            assert!(said.contains(word), "`{word}` is not in {said}");
        }
    };
    words(&refused(["identify", &late, "--out", &folder.path("lab.toml")]));
    words(&refused(["diagnose", "--quick", &late, "--out", &folder.path("found")]));
    let said = run(["validate", &late]);
    assert_eq!(said.status, 1, "{}", said.err);
    words(&said.err);
    // The same with the relay in it, and with these rows cut off.
    let text = std::fs::read_to_string(&late).unwrap();
    let relay = text.lines().enumerate().map(|(k, line)| match k {
        0 => format!("{line},pump_on\n"),
        1..=150 => format!("{line},0\n"),
        _ => format!("{line},1\n"),
    });
    let relay = folder.with("relay.csv", relay.collect::<String>());
    let cut: String =
        text.lines().enumerate().filter(|(k, _)| *k == 0 || *k > 150).map(|(_, line)| format!("{line}\n")).collect();
    let cut = folder.with("cut.csv", cut);
    for sound_one in [relay, cut] {
        let said = run(["validate", &sound_one]);
        assert_eq!(said.status, 0, "{}", said.err);
    }
}
