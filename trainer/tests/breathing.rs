//! A lung of three chambers that breathes every four seconds: no pressure stands anywhere, so that only a run of the rig tells with
//! what sign and under which commands it was recorded.

// What fails here fails the test, helper functions included.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod program;

use program::paper_run::{Dice, told_key};
use program::{Csv, Folder, refused, run, sound};

const LUNG: &str = r#"
format = 1
name = "lung"
[gas]
gas_constant_j_per_kg_k = 287.0
heat_capacity_ratio = 1.4
[atmosphere]
pressure_kpa_abs = 101.325
temperature_k = 293.15
[integrator]
step_ms = 0.4
tick_ms = 20.0
[volumes.airway]
volume_l = 1.0
temperature_k = 293.15
[volumes.bronchi]
volume_l = 0.5
temperature_k = 293.15
[volumes.alveoli]
volume_l = 0.3
temperature_k = 293.15
[sources.wall]
kind = "pressure"
pressure_kpa_gauge = 50.0
temperature_k = 293.15
[valves.inhale]
from = "wall"
to = "airway"
command = "insp"
input_area_mm2 = 1.0
pressure_area_mm2_per_n = 0.0
spring_area_mm2 = 0.0
nozzle_diameter_mm = 1.6
[valves.exhale]
from = "alveoli"
to = "atmosphere"
command = "exp"
input_area_mm2 = 2.0
pressure_area_mm2_per_n = 0.0
spring_area_mm2 = 0.0
nozzle_diameter_mm = 1.6
[lines.trachea]
kind = "laminar"
from = "airway"
to = "bronchi"
resistance_kpa_s_per_l = 0.8
[lines.bronchioles]
kind = "laminar"
from = "bronchi"
to = "alveoli"
resistance_kpa_s_per_l = 0.5
[lines.leak]
kind = "laminar"
from = "bronchi"
to = "atmosphere"
resistance_kpa_s_per_l = 20.0
"#;

const COLUMNS: [&str; 5] = ["insp", "exp", "p_airway", "p_bronchi", "p_alveoli"];

/// The lung's rig file, its sensors of −2 … 12 kPa, its columns called as in the file.
fn lung() -> String {
    let sensor = |chamber: &str| {
        format!(
            "[sensors.{chamber}]\nvolume = \"{chamber}\"\ncolumn = \"p_{chamber}\"\nrange_kpa_gauge = [-2.0, 12.0]\nrange_v = [0.0, 5.0]\n"
        )
    };
    LUNG.to_owned() + &["airway", "bronchi", "alveoli"].map(sensor).concat()
}

/// Fifteen breaths, by row: commands and pressures with 0.01 kPa of noise.
fn breaths(folder: &Folder, rig: &str) -> Vec<[f64; 5]> {
    let line = |k: usize| {
        let [insp, exp] = if k % 200 < 75 { [0.25, 0.02] } else { [0.03, 0.8] };
        format!("{:.2},{insp},{exp},0,0,0\n", 0.02 * k as f64)
    };
    let rows: String = (0..3000).map(line).collect();
    let inputs = folder.with("inputs.csv", format!("time_s,{}\n{rows}", COLUMNS.join(",")));
    let out = folder.path("out.csv");
    sound(["simulate", "--rig", rig, "--refine", "1", "--inputs", &inputs, "--out", &out]);
    let csv = Csv::read(out);
    let mut dice = Dice(3);
    let columns = COLUMNS.map(|name| csv.numbers(name));
    let noisy = |at: usize, x: f64, dice: &mut Dice| if at < 2 { x } else { x + 0.035 * (dice.throw() - 0.5) };
    (0..csv.rows.len()).map(|k| std::array::from_fn(|at| noisy(at, columns[at][k], &mut dice))).collect()
}

/// Change that is made to every row.
type Spoil = fn(&mut [f64; 5]);

#[test]
fn signs_and_commands_of_a_rig_that_never_stands_are_told_with_the_keys_that_mend_them() {
    let folder = Folder::new("breathing");
    let rig = folder.with("lung.toml", lung());
    let rows = breaths(&folder, &rig);
    let file = |name: &str, spoil: Spoil| {
        let line = |(k, row): (usize, &[f64; 5])| {
            let mut row = *row;
            spoil(&mut row);
            format!("{:.2},{}\n", 0.02 * k as f64, row.map(|x| format!("{x:.5}")).join(","))
        };
        let text: String = rows.iter().enumerate().map(line).collect();
        folder.with(&format!("{name}.csv"), format!("time_s,{}\n{text}", COLUMNS.join(",")))
    };
    sound(["validate", "--rig", &rig, &file("good", |_| {})]);
    let cases: [(&str, Spoil, &[&str]); 2] = [
        ("turned", |row| row.iter_mut().skip(2).for_each(|p| *p = -*p), &["p_airway", "sign seems to be turned round"]),
        ("one_turned", |row| row[3] = -row[3], &["p_bronchi", "sign seems to be turned round"]),
    ];
    for (name, spoil, words) in cases {
        let spoilt = file(name, spoil);
        let said = run(["validate", "--rig", &rig, &spoilt]);
        assert_eq!(said.status, 1, "{name}: {}", said.err);
        words.iter().for_each(|word| assert!(said.err.contains(word), "{name}: `{word}` is not in {}", said.err));
        // Every key that is told, in one map: then nothing is wrong.
        let keys = said.err.split("[recording] ").skip(1).map(|rest| format!("[recording] {rest}"));
        let map: String = keys.map(|key| format!("{}\n", told_key(&key))).collect();
        let mended = folder.with("mended.toml", format!("{}\n[recording]\n{map}", lung()));
        sound(["validate", "--rig", &mended, &spoilt]);
    }
    let swapped = file("swapped", |row| row.swap(0, 1));
    let said = refused(["identify", "--rig", &rig, &swapped, "--out", &folder.path("fitted.toml")]);
    assert!(said.contains("insp and exp seem to be swapped") && !said.contains("bar"), "{said}");
}
