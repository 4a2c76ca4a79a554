//! `trainer simulate`, end to end: against traces of other implementations and closed forms, and the file it writes.

// What fails here fails the test, helper functions included.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod program;

use std::path::{Path, PathBuf};

use program::{Csv, Folder, elsewhere, refused, run, sound};

/// Error that users are promised; free runs at the default `--refine` are converged to a fifth of it.
const TOLERANCE_KPA: f64 = 0.01;

fn traces_in(folder: &Path) -> Vec<PathBuf> {
    let mut found: Vec<PathBuf> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|end| end == "csv"))
        .collect();
    found.sort();
    found
}

/// Simulates a trace from its commands and its first row, and compares every row.
fn compare(rig: &str, trace: &Path) {
    let folder = Folder::new(&format!("golden-{}", trace.file_stem().unwrap().display()));
    let out = folder.path("out.csv");
    sound(["simulate", "--rig", rig, "--inputs", trace.to_str().unwrap(), "--out", &out]);
    let (golden, simulated) = (Csv::read(trace), Csv::read(&out));
    assert_eq!(golden.rows.len(), simulated.rows.len());
    assert_eq!(golden.numbers("time_s"), simulated.numbers("time_s"));
    let mut worst = 0.0_f64;
    for column in ["p_pos_kpa", "p_neg_kpa"] {
        for (row, (expected, found)) in golden.numbers(column).iter().zip(simulated.numbers(column)).enumerate() {
            let off = (expected - found).abs();
            assert!(off <= TOLERANCE_KPA, "{}: row {row}: {found} against {expected} kPa", trace.display());
            worst = worst.max(off);
        }
    }
    println!("{}: {} rows, at most {worst:.5} kPa off", trace.display(), golden.rows.len());
}

#[test]
fn free_runs_follow_the_independent_implementation() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../model/tests/golden");
    let rigs = Folder::new("golden-rigs");
    let slow = model::rig::DUAL_PRESSURE.replace("speed_rpm = 3000.0", "speed_rpm = 2917.0");
    let slow = rigs.with("slip.toml", slow);
    let traces = traces_in(&folder);
    assert!(!traces.is_empty());
    for trace in traces {
        let rig = if trace.file_stem().unwrap() == "slip" { slow.as_str() } else { "dual_pressure" };
        compare(rig, &trace);
    }
}

#[test]
fn free_runs_follow_converged_traces_from_elsewhere() {
    let Some(folder) = elsewhere("GOLDEN_DIR", "shared/golden") else { return };
    let traces = traces_in(&folder);
    assert!(!traces.is_empty(), "no trace in {}", folder.display());
    for trace in traces {
        compare("dual_pressure", &trace);
    }
}

/// Twelve rows with references, a text column, columns in another order, and the pump off at the end.
fn recording(gap_after: Option<i32>) -> String {
    let mut text = String::from("p_neg_kpa,ref_pos_kpa,time_s,note,u_pos,p_pos_kpa,u_neg,pump_on\n");
    for row in 0..12_i32 {
        let late = if gap_after.is_some_and(|last| row > last) { 5.0 } else { 0.0 };
        let time = (f64::from(row) * 0.02 + late) as f32;
        let on = u8::from(row < 9);
        text.push_str(&format!("{},81.5,{time},row {row},0.8,{},0.75,{on}\n", -60 - row, 90 + row));
    }
    text
}

#[test]
fn the_file_has_the_same_rows_and_keeps_the_other_columns() {
    let folder = Folder::new("columns");
    let (inputs, out) = (folder.with("in.csv", recording(None)), folder.path("out.csv"));
    let said = sound(["simulate", "--inputs", &inputs, "--out", &out]);
    assert_eq!(said, format!("{out}: 12 rows of dual_pressure, started running\n"));
    let (given, written) = (Csv::read(&inputs), Csv::read(&out));
    assert_eq!(written.header.join(","), "time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa,ref_pos_kpa,note,pump_on");
    for column in ["time_s", "u_pos", "u_neg", "ref_pos_kpa", "pump_on"] {
        assert_eq!(given.numbers(column), written.numbers(column), "{column}");
    }
    assert_eq!(given.texts("note"), written.texts("note"));
    // The first row is the start; from then on the recorded pressures do not count.
    assert_eq!((written.numbers("p_pos_kpa")[0], written.numbers("p_neg_kpa")[0]), (90.0, -60.0));
    let other = folder.with("other.csv", recording(None).replace("-61,", "-99,").replace(",0.8,91,", ",0.8,7,"));
    let again = folder.path("again.csv");
    sound(["simulate", "--inputs", &other, "--out", &again]);
    assert_eq!(written.rows, Csv::read(&again).rows);
}

#[test]
fn the_pumps_switch_is_obeyed() {
    let folder = Folder::new("pump");
    let (inputs, out) = (folder.with("in.csv", recording(None)), folder.path("out.csv"));
    sound(["simulate", "--inputs", &inputs, "--out", &out]);
    let negative = Csv::read(&out).numbers("p_neg_kpa");
    // With the pump standing the open valve lets the negative chamber rise in every tick.
    assert!(negative[9..].windows(2).all(|pair| pair[1] > pair[0] + 0.1), "{negative:?}");
}

#[test]
fn a_gap_starts_the_run_anew_from_its_next_row() {
    let folder = Folder::new("gap");
    let (inputs, out) = (folder.with("in.csv", recording(Some(4))), folder.path("out.csv"));
    let said = sound(["simulate", "--inputs", &inputs, "--out", &out]);
    assert!(said.contains("12 rows") && said.contains("started anew after a gap"), "{said}");
    let written = Csv::read(&out);
    // Row 5 is 95 and −65 kPa in the recording.
    assert_eq!((written.numbers("p_pos_kpa")[5], written.numbers("p_neg_kpa")[5]), (95.0, -65.0));
    assert_eq!(written.numbers("time_s"), Csv::read(&inputs).numbers("time_s"));
    // From there it is what a recording of its own gives.
    let text = recording(Some(4));
    let second: Vec<&str> = text.lines().take(1).chain(text.lines().skip(6)).collect();
    let alone = folder.with("alone.csv", second.join("\n"));
    let alone_out = folder.path("alone_out.csv");
    sound(["simulate", "--inputs", &alone, "--out", &alone_out]);
    assert_eq!(written.rows[5..], Csv::read(&alone_out).rows);
}

#[test]
fn commands_without_pressures_start_at_rest_and_say_so() {
    let folder = Folder::new("rest");
    let mut text = String::from("time_s,u_pos,u_neg,pump_on\n");
    (0..5).for_each(|row| text.push_str(&format!("{},0,0,1\n", f64::from(row) * 0.02)));
    let (inputs, out) = (folder.with("next.csv", text), folder.path("out.csv"));
    let said = run(["simulate", "--inputs", &inputs, "--out", &out]);
    assert_eq!((said.status, said.err.lines().count()), (0, 1), "{}", said.err);
    assert!(said.err.contains("no column p_pos_kpa or p_neg_kpa; starting at rest"), "{}", said.err);
    let written = Csv::read(&out);
    assert_eq!(written.header.join(","), "time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa,pump_on");
    // Second row of a converged trace with both valves shut.
    let (pos, neg) = (written.numbers("p_pos_kpa")[1], written.numbers("p_neg_kpa")[1]);
    assert!((pos - 4.7115972).abs() < TOLERANCE_KPA && (neg + 19.6512318).abs() < TOLERANCE_KPA, "{pos} {neg}");
}

/// One chamber, evacuated by a pump of a given volume flow through nothing else: P = P₀ exp(−∫ u Q dt / V).
const TANK: &str = r#"
format = 1
name = "tank"
[gas]
gas_constant_j_per_kg_k = 287.0
heat_capacity_ratio = 1.4
[atmosphere]
pressure_kpa_abs = 101.325
temperature_k = 293.15
[volumes.tank]
volume_l = 0.3
temperature_k = 293.15
[pumps.pump]
kind = "flow"
inlet = "tank"
outlet = "atmosphere"
command = "pump_share"
flow_l_per_min = 6.0
[sensors.gauge]
volume = "tank"
column = "tank_kpa"
range_kpa_gauge = [0.0, -101.0]
range_v = [1.0, 5.0]
"#;

#[test]
fn another_rig_has_its_own_columns_and_closed_form() {
    let folder = Folder::new("tank");
    let rig = folder.with("tank.toml", TANK);
    let mut text = String::from("time_s,pump_share,tank_kpa\n");
    let share = |row: u32| if row < 50 { 1.0 } else { 0.5 };
    (0..100).for_each(|row| text.push_str(&format!("{},{},-10\n", f64::from(row) * 0.02, share(row))));
    let (inputs, out) = (folder.with("in.csv", text), folder.path("out.csv"));
    sound(["simulate", "--rig", &rig, "--inputs", &inputs, "--out", &out]);
    let mut pumped_l = 0.0;
    for (row, found) in Csv::read(&out).numbers("tank_kpa").into_iter().enumerate() {
        let expected = (101.325 - 10.0) * f64::exp(-pumped_l / 0.3) - 101.325;
        // RK4 at 0.025 ms on a time constant of 3 s: rounding, and the file's seven digits.
        assert!((found - expected).abs() < 1e-6, "row {row}: {found} against {expected}");
        pumped_l += share(row as u32) * 0.1 * 0.02;
    }
}

#[test]
fn refining_leads_to_the_same_pressures() {
    let folder = Folder::new("refine");
    let inputs = folder.with("in.csv", recording(None));
    let [coarse, fine] = ["1", "16"].map(|refine| {
        let out = folder.path(&format!("{refine}.csv"));
        sound(["simulate", "--refine", refine, "--inputs", &inputs, "--out", &out]);
        Csv::read(&out).numbers("p_neg_kpa")
    });
    assert_ne!(coarse, fine, "--refine does nothing");
    // Steps of 0.1 ms are off by 0.015 kPa at most after 20 s; these are 0.2 s.
    assert!(coarse.iter().zip(&fine).all(|(coarse, fine)| (coarse - fine).abs() < 0.01), "{coarse:?} {fine:?}");
}

#[test]
fn json_is_one_object_and_nothing_else() {
    let folder = Folder::new("json");
    let (inputs, out) = (folder.with("in.csv", recording(Some(4))), folder.path("out.csv"));
    let said = sound(["simulate", "--json", "--inputs", &inputs, "--out", &out]);
    let value: serde_json::Value = serde_json::from_str(&said).unwrap();
    assert_eq!((&value["rows"], &value["segments"], &value["start"]), (&12.into(), &2.into(), &"running".into()));
}

/// `-` is standard output, and no file of that name.
#[test]
fn a_dash_is_standard_output() {
    let folder = Folder::new("simulate-dash");
    let (inputs, out) = (folder.with("in.csv", recording(Some(4))), folder.path("out.csv"));
    let said = run(["simulate", "--inputs", &inputs, "--out", "-"]);
    assert_eq!(said.status, 0, "{}", said.err);
    sound(["simulate", "--inputs", &inputs, "--out", &out]);
    assert_eq!(said.out, std::fs::read_to_string(out).unwrap());
    assert!(!Path::new("-").exists());
    let both = refused(["simulate", "--inputs", &inputs, "--out", "-", "--json"]);
    assert!(both.contains("leave out one of the two"), "{both}");
}
