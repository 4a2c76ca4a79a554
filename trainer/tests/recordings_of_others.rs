//! Recordings of the kinds that people publish, made here, through the built program: each is read as what it is or refused for the
//! right reason. Those that were handed over have a file of their own (`handed_recordings.rs`).

// What fails here fails the test, helper functions included.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod program;

use model::rig::Rig;
use program::{Folder, json, refused, run, sound};
use serde_json::Value;

/// A pump that drives a leaking box of 0.1 L: `p' = (q u − p/(R C)) / C'` worked out here in steps of 1 ms, with 0.02 kPa of noise.
const BOX: &str = r#"
format = 1
name = "box"
[gas]
gas_constant_j_per_kg_k = 287.0
heat_capacity_ratio = 1.4
[atmosphere]
pressure_kpa_abs = 101.325
temperature_k = 293.15
[volumes.box]
volume_l = 0.1
temperature_k = 293.15
[pumps.pump]
kind = "flow"
outlet = "box"
command = "u_pump"
flow_l_per_min = 0.5
[lines.leak]
kind = "laminar"
from = "box"
to = "atmosphere"
resistance_kpa_s_per_l = 200.0
[sensors.gauge]
volume = "box"
column = "p_box_kpa"
range_kpa_gauge = [-5.0, 20.0]
range_v = [0.0, 5.0]
[recording]
time = "t"
columns.u_pump = "duty"
columns.p_box_kpa = "kPa"
"#;

/// Time, duty and gauge pressure of the box, every `step_ms`.
fn boxed(step_ms: usize, seconds: usize) -> Vec<[f64; 3]> {
    let (r, t, v, pa) = (287.0, 293.15, 1e-4, 101_325.0);
    let (mut p, mut u, mut seed) = (pa, 0.0, 5_u64);
    let mut dice = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 11) as f64 / (1_u64 << 53) as f64
    };
    let mut rows = Vec::new();
    for ms in 0..1000 * seconds {
        if ms % 2000 == 0 {
            u = [0.0, 0.3, 0.5, 0.7, 1.0][(5.0 * dice()) as usize];
        }
        if ms % step_ms == 0 {
            // Sum of twelve even numbers less six: variance 1.
            let noise = 0.02 * ((0..12).map(|_| dice()).sum::<f64>() - 6.0);
            rows.push([1e-3 * ms as f64, u, (p - pa) / 1e3 + noise]);
        }
        let into = u * 0.5 / 60_000.0 * pa / (r * t);
        let out = (p * p - pa * pa) / (2.0 * pa) / 200e6 * pa / (r * t);
        p += 1e-3 * r * t / v * (into - out);
    }
    rows
}

fn csv(header: &str, rows: &[[f64; 3]], of: impl Fn(&[f64; 3]) -> [f64; 3]) -> String {
    let line = |row: &[f64; 3]| {
        let [t, u, p] = of(row);
        format!("{t:.3},{u},{p:.4}\n")
    };
    format!("{header}\n") + &rows.iter().map(line).collect::<String>()
}

#[test]
fn absolute_pressures_and_scaled_commands_are_refused_on_any_rig() {
    let folder = Folder::new("any-rig");
    let rig = folder.with("box.toml", BOX);
    let rows = boxed(20, 60);
    let sound_file = folder.with("sound.csv", csv("t,duty,kPa", &rows, |row| *row));
    sound(["validate", "--rig", &rig, &sound_file]);
    #[allow(clippy::type_complexity)] // a table of cases
    let cases: [(&str, [f64; 2], [f64; 2], &[&str]); 5] = [
        ("absolute", [1.0, 0.0], [1.0, 101.325], &["absolute", "101.3"]),
        ("absolute_hpa", [1.0, 0.0], [10.0, 1013.25], &["absolute"]),
        ("pa", [1.0, 0.0], [1000.0, 0.0], &["Pa"]),
        ("pwm", [255.0, 0.0], [1.0, 0.0], &["outside 0 … 1", "u_pump", "reaches 255", "scale = 0.00392157"]),
        ("percent", [100.0, 0.0], [1.0, 0.0], &["(duty)", "percentage", "scale = 0.01"]),
    ];
    for (name, duty, kpa, words) in cases {
        let line = |[scale, offset]: [f64; 2], x: f64| scale * x + offset;
        let file = folder
            .with(&format!("{name}.csv"), csv("t,duty,kPa", &rows, |[t, u, p]| [*t, line(duty, *u), line(kpa, *p)]));
        let (out, fitted) = (folder.path("out"), folder.path("fitted.toml"));
        for said in [
            refused(["diagnose", "--quick", "--rig", &rig, &file, "--out", &out]),
            refused(["identify", "--rig", &rig, &file, "--out", &fitted]),
            refused(["validate", "--rig", &rig, &file]),
        ] {
            let said = said.lines().last().unwrap_or_default();
            for word in words {
                assert!(said.contains(word), "{name}: `{word}` is not in: {said}");
            }
        }
    }
    // Driving the pump must not lower the pressure.
    let file = folder.with("inverted.csv", csv("t,duty,kPa", &rows, |[t, u, p]| [*t, 1.0 - u, *p]));
    let said = refused(["identify", "--rig", &rig, &file, "--out", &folder.path("fitted.toml")]);
    assert!(said.contains("u_pump") && said.contains("driving the pump") && said.contains("inverted"), "{said}");
    // Where the sensor's range is so narrow that the box counts as empty between two drives, that is no pump that stands.
    let narrow = folder.with("narrow.toml", BOX.replace("[-5.0, 20.0]", "[-1.0, 3.0]"));
    sound(["validate", "--rig", &narrow, &sound_file]);
    let said = refused(["identify", "--rig", &narrow, &file, "--out", &folder.path("fitted.toml")]);
    assert!(said.contains("inverted") && !said.contains("was the pump off"), "{said}");
}

/// The paper's rig as a logger without scales writes it, through a converter of 12 bits over 5 V and one of 16 over 10 V.
#[test]
fn raw_counts_of_a_converter_get_the_key_that_scales_them() {
    let folder = Folder::new("counts");
    let rows: Vec<Vec<f64>> = paper(&folder)
        .iter()
        .skip(1)
        .map(|line| line.split(',').take(5).map(|cell| cell.parse().unwrap()).collect())
        .collect();
    for (full, volts) in [(4095.0, 5.0), (65_535.0, 10.0)] {
        // 1 … 5 V are 0 … 1000 kPa and 0 … -101 kPa.
        let count = |kpa: f64, range_kpa: f64| ((1.0 + 4.0 * kpa / range_kpa) / volts * full).round();
        let line = |row: &Vec<f64>| {
            format!("{},{},{},{},{}\n", row[0], row[1], row[2], count(row[3], 1000.0), count(row[4], -101.0))
        };
        let text = format!("time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa\n{}", rows.iter().map(line).collect::<String>());
        let file = folder.with("counts.csv", text);
        let said = refused(["identify", &file, "--out", &folder.path("fitted.toml")]);
        assert!(said.contains("raw counts of a converter"), "{said}");
        let scale = |range_kpa: f64| range_kpa * volts / (4.0 * full);
        let key = said.split("columns.p_pos_kpa = ").nth(1).unwrap().trim();
        let named: f64 = key.split("scale = ").nth(1).unwrap().split(',').next().unwrap().parse().unwrap();
        // Two converters may have one scale to a few parts in ten thousand: 13 bits over 10 V are 12 bits over 5 V.
        assert!((named / scale(1000.0) - 1.0).abs() < 1e-3 && key.contains("offset = -250.0"), "{key}");
        let map = format!(
            "[recording]\ncolumns.p_pos_kpa = {key}\ncolumns.p_neg_kpa = {{ from = \"p_neg_kpa\", scale = {}, offset = 25.25 }}\n",
            scale(-101.0)
        );
        let rig = folder.with("scaled.toml", format!("{}\n{map}", Rig::builtin_text("dual_pressure").unwrap()));
        sound(["validate", "--rig", &rig, &file]);
    }
}

/// A rig that reaches 1.7 kPa behind a sensor of −5 … 20: what is wrong lies inside the sensor's range, and the fit would take it
/// up by moving the rig's parameters.
#[test]
fn wrong_units_signs_and_commands_of_a_rig_of_low_pressures_are_told() {
    let folder = Folder::new("low-pressures");
    let rig = folder.with("box.toml", BOX);
    let rows = boxed(20, 60);
    // A second file whose pump rests for its first 20 s.
    let late: Vec<[f64; 3]> = (0..1000).map(|k| [0.02 * f64::from(k), 0.0, 0.01 * f64::from(k % 3 - 1)]).collect();
    let late = late.into_iter().chain(rows.iter().map(|[t, u, p]| [t + 20.0, *u, *p])).collect::<Vec<_>>();
    let said_of = |name: &str, rows: &[[f64; 3]], of: &dyn Fn(&[f64; 3]) -> [f64; 3]| {
        let file = folder.with(&format!("{name}.csv"), csv("t,duty,kPa", rows, of));
        let said = refused(["diagnose", "--quick", "--rig", &rig, &file, "--out", &folder.path("out")]);
        said.lines().last().unwrap_or_default().to_owned()
    };
    #[allow(clippy::type_complexity)] // a table of cases
    let cases: [(&str, &dyn Fn(&[f64; 3]) -> [f64; 3], &[&str]); 9] = [
        (
            "psi",
            &|[t, u, p]| [*t, *u, 0.145_038 * p],
            &["p_box_kpa", "psi", "columns.p_box_kpa = { from = \"kPa\", unit = \"psi\" }"],
        ),
        // 0 … 5 V and 4 … 20 mA over −5 … 20 kPa.
        ("millivolts", &|[t, u, p]| [*t, *u, 200.0 * (p + 5.0)], &["millivolts", "unit = \"mV\""]),
        ("loop", &|[t, u, p]| [*t, *u, 4.0 + 0.64 * (p + 5.0)], &["current loop", "unit = \"mA\""]),
        // Within the sensor's range, and where a gauge pressure may be.
        ("absolute_bar", &|[t, u, p]| [*t, *u, 0.01 * p + 1.013_25], &["absolute, in bar", "unit = \"bar abs\""]),
        ("bar", &|[t, u, p]| [*t, *u, 0.01 * p], &["p_box_kpa", "bar"]),
        ("mmhg", &|[t, u, p]| [*t, *u, 7.500_62 * p], &["p_box_kpa", "mmHg"]),
        ("turned", &|[t, u, p]| [*t, *u, -p], &["p_box_kpa", "sign", "turned round"]),
        ("unmoved", &|[t, _, p]| [*t, 0.5, *p], &["u_pump stands still", "[recording] columns"]),
        ("idle", &|[t, _, p]| [*t, 0.0, *p], &["u_pump stands still", "the command that was sent"]),
    ];
    for (name, of, words) in cases {
        for (rows, when) in [(&rows, "at once"), (&late, "late")] {
            let said = said_of(name, rows, of);
            for word in words {
                assert!(said.contains(word), "{name}, {when}: `{word}` is not in: {said}");
            }
            // A comparison is made all the same, where there is one to make, and is not good.
            let compared = run(["validate", "--rig", &rig, &folder.path(&format!("{name}.csv"))]);
            assert_ne!(compared.status, 0, "{name}, {when}: {}", compared.err);
            if compared.status == 1 {
                assert!(
                    compared.out.contains("RMSE") && compared.err.contains("trainer: not good: "),
                    "{}",
                    compared.err
                );
            }
        }
    }
    for rows in [&rows, &late] {
        let file = folder.with("sound.csv", csv("t,duty,kPa", rows, |row| *row));
        sound(["identify", "--rig", &rig, &file, "--out", &folder.path("fitted.toml")]);
    }
}

/// Readings that the rig would have, outside the range that its file states: the range is wrong, not the unit.
#[test]
fn a_range_that_is_stated_too_narrow_is_told() {
    let folder = Folder::new("narrow");
    let rig = folder.with("box.toml", BOX.replace("[-5.0, 20.0]", "[-0.5, 0.5]"));
    let file = folder.with("run.csv", csv("t,duty,kPa", &boxed(20, 60), |row| *row));
    for said in [
        refused(["identify", "--rig", &rig, &file, "--out", &folder.path("fitted.toml")]),
        refused(["validate", "--rig", &rig, &file]),
    ] {
        assert!(said.contains("the rig would go there") && said.contains("range_kpa_gauge"), "{said}");
    }
}

/// `validate` leaves out what it says: a sensor that stands still, and a reading that is no pressure.
#[test]
fn validate_leaves_out_what_it_says() {
    let folder = Folder::new("left-out");
    let rig = folder.with("box.toml", BOX);
    let mut rows = boxed(20, 60);
    let whole =
        json(&["validate", "--json", "--rig", &rig, &folder.with("sound.csv", csv("t,duty,kPa", &rows, |row| *row))]);
    let held = rows[2500][2];
    rows.iter_mut().skip(2500).for_each(|row| row[2] = held);
    rows[700][2] = 1e20;
    let file = folder.with("held.csv", csv("t,duty,kPa", &rows, |row| *row));
    let said = run(["validate", "--rig", &rig, &file]);
    assert!(said.err.contains("stuck") && said.err.contains("1 wild reading"), "{}", said.err);
    let left = json(&["validate", "--json", "--rig", &rig, &file]);
    let of = |value: &Value, key: &str| value["overall"][format!("box_{key}")].as_f64().unwrap();
    assert!(of(&left, "rows") < of(&whole, "rows") - 400.0, "{left}");
    assert!(of(&left, "rmse_kpa") < 1.2 * of(&whole, "rmse_kpa"), "{left} {whole}");
    // Below 5 kPa throughout there is a percentage all the same.
    assert!(of(&whole, "accuracy") > 0.9, "{whole}");
}

/// Two readings of a loose contact, 1.5 kPa off on a rig that reaches 1.7, are told and left out.
#[test]
fn wild_readings_of_a_rig_of_low_pressures_are_left_out() {
    let folder = Folder::new("loose-contact");
    let rig = folder.with("box.toml", BOX);
    let mut rows = boxed(20, 60);
    let file = folder.with("sound.csv", csv("t,duty,kPa", &rows, |row| *row));
    let fitted = folder.path("fitted.toml");
    let before = json(&["identify", "--json", "--rig", &rig, &file, "--out", &fitted]);
    assert!(!before.to_string().contains("wild"), "{before}");
    rows[740][2] += 1.5;
    rows[2260][2] -= 1.5;
    let file = folder.with("wild.csv", csv("t,duty,kPa", &rows, |row| *row));
    let said = json(&["identify", "--json", "--rig", &rig, &file, "--out", &fitted]).to_string();
    assert!(said.contains("2 wild readings"), "{said}");
}

/// The paper's rig under steps, every 20 ms.
fn paper(folder: &Folder) -> Vec<String> {
    let mut commands = String::from("time_s,u_pos,u_neg\n");
    for k in 0..1500 {
        commands.push_str(&format!(
            "{:.2},{},{}\n",
            0.02 * f64::from(k),
            0.7 + 0.1 * f64::from(k / 100 % 3),
            0.75 + 0.05 * f64::from(k / 130 % 4)
        ));
    }
    let (inputs, out) = (folder.with("commands.csv", commands), folder.path("whole.csv"));
    sound(["simulate", "--rig", "bench", "--refine", "1", "--inputs", &inputs, "--out", &out]);
    std::fs::read_to_string(out).unwrap().lines().map(str::to_owned).collect()
}

/// One row of twenty lost changes no figure by much, and is told; gaps begin the simulation anew, and that is told, too.
#[test]
fn lost_rows_do_not_flatter() {
    let folder = Folder::new("lost-rows");
    let lines = paper(&folder);
    let file = |name: &str, keep: &dyn Fn(usize) -> bool| {
        let kept: Vec<&str> =
            lines.iter().enumerate().filter(|(k, _)| *k == 0 || keep(*k)).map(|(_, l)| l.as_str()).collect();
        folder.with(name, kept.join("\n") + "\n")
    };
    let rmse = |file: &str| {
        let said = json(&["validate", "--json", "--rig", "dual_pressure", "--refine", "1", file]);
        (said["overall"]["pos_rmse_kpa"].as_f64().unwrap(), said["overall"]["began_anew"].as_u64().unwrap(), said)
    };
    let (whole, _, _) = rmse(&file("all.csv", &|_| true));
    let lost = file("lost.csv", &|k| k % 20 != 7);
    let (bridged, anew, said) = rmse(&lost);
    assert!(whole > 0.2 && (bridged / whole - 1.0).abs() < 0.05, "{whole} {bridged}");
    assert_eq!((anew, &said["overall"]["rows_without_sample"]), (0, &75.into()), "{said:#}");
    // A cell without a reading loses that reading alone: commands and the other sensor are those of the whole file.
    let blank: Vec<String> = lines
        .iter()
        .enumerate()
        .map(|(k, line)| match line.rsplit_once(',') {
            Some((rest, _)) if k > 0 && k % 20 == 7 => format!("{rest},"),
            _ => line.clone(),
        })
        .collect();
    let blank = folder.with("blank.csv", blank.join("\n") + "\n");
    let (of_blank, anew, said) = rmse(&blank);
    assert_eq!((of_blank, anew, &said["overall"]["rows_without_sample"]), (whole, 0, &0.into()), "{said:#}");
    let rows = |channel: &str| said["overall"][format!("{channel}_rows")].as_u64().unwrap();
    assert_eq!(rows("pos") - rows("neg"), 75, "{said:#}");
    let told = run(["validate", "--refine", "1", &blank]);
    assert!(told.err.contains("75 readings of p_neg_kpa are missing"), "{}", told.err);
    let told = run(["validate", "--refine", "1", &lost]);
    assert!(told.err.contains("75 rows lost in 75 places") && told.out.contains("anew"), "{}{}", told.out, told.err);
    let torn = run(["validate", "--refine", "1", &file("torn.csv", &|k| k % 100 > 25)]);
    assert!(torn.err.contains("began anew 14 times") && torn.err.contains("gaps of up to 0.5"), "{}", torn.err);
}

#[test]
fn a_rig_that_nothing_can_move_is_refused_and_a_leak_test_is_not() {
    let folder = Folder::new("unmoved");
    let closed = BOX
        .replace("[pumps.pump]\nkind = \"flow\"\noutlet = \"box\"\ncommand = \"u_pump\"\nflow_l_per_min = 0.5\n", "")
        .replace("columns.u_pump = \"duty\"\n", "")
        .replace("[-5.0, 20.0]", "[-5.0, 50.0]");
    let rig = folder.with("closed.toml", closed);
    let rows = |p: &dyn Fn(f64) -> f64| -> String {
        let line = |k: u32| {
            let t = 0.1 * f64::from(k);
            format!("{t:.1},{:.3}\n", p(t) + 0.02 * (37.0 * t).sin())
        };
        "t,kPa\n".to_owned() + &(0..360).map(line).collect::<String>()
    };
    let pumped = folder
        .with("cuff.csv", rows(&|t| 30.0 * if t < 6.0 { t / 6.0 } else { 1.03 / (1.0 + ((t - 20.0) / 4.0).exp()) }));
    for said in [
        refused(["diagnose", "--quick", "--rig", &rig, &pumped, "--out", &folder.path("out")]),
        refused(["identify", "--rig", &rig, &pumped, "--out", &folder.path("fitted.toml")]),
    ] {
        assert!(said.contains("nothing in this rig can move a pressure"), "{said}");
    }
    let leak = folder.with("leak.csv", rows(&|t| 40.0 * (-t / 20.0).exp()));
    let said = run(["identify", "--rig", &rig, &leak, "--out", &folder.path("leak.toml")]);
    assert!(!said.err.contains("nothing in this rig"), "{}", said.err);
}

/// Tests of the thorough tier (docs/testing.md).
mod thorough {
    use super::*;

    /// Noise, fits and verdicts come from samples: at 10 and at 2 Hz a sound rig is a sound rig.
    #[test]
    #[ignore = "thorough: docs/testing.md"]
    fn sparse_samples_are_all_the_evidence_there_is() {
        let folder = Folder::new("sparse");
        let rig = folder.with("box.toml", BOX);
        for (step_ms, seconds, most_noise) in [(20, 60, 0.024), (100, 120, 0.03), (500, 240, 0.05)] {
            let file = folder.with("run.csv", csv("t,duty,kPa", &boxed(step_ms, seconds), |row| *row));
            let said = json(&["identify", "--json", "--rig", &rig, &file, "--out", &folder.path("fitted.toml")]);
            let noise =
                said["noise"]["p_box_kpa_sigma_kpa"].as_f64().or(said["noise"]["box_sigma_kpa"].as_f64()).unwrap();
            assert!((0.015..most_noise).contains(&noise), "{step_ms} ms: {noise} kPa for 0.02");
            let left = &said["after"]["free"];
            let rmse = left
                .as_object()
                .unwrap()
                .iter()
                .find(|(key, _)| key.ends_with("rmse_kpa"))
                .unwrap()
                .1
                .as_f64()
                .unwrap();
            assert!(rmse < 0.03, "{step_ms} ms: {rmse} kPa are left of 0.02: {said:#}");
            assert!(!said["remarks"].to_string().contains("times the noise"), "{said:#}");
        }
        let file = folder.with("run.csv", csv("t,duty,kPa", &boxed(500, 240), |row| *row));
        let said = json(&["diagnose", "--quick", "--json", "--rig", &rig, &file, "--out", &folder.path("found")]);
        assert_eq!(said["mechanisms"].as_array().map(Vec::len), Some(0), "{said:#}");
    }
}
