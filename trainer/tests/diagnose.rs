//! `trainer diagnose`, end to end: its files, its refusals. Whether its answers are right is asked in the crate
//! `diagnose`, and of the hidden rig's recordings.

// What fails here fails the test, helper functions included.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod program;

use program::paper_run::Dice;
use program::{Csv, Folder, json, refused, sound};

/// A recording that the paper's model made, with noise of 0.06 kPa (uniform, from a fixed sequence) on its readings.
fn recorded(folder: &Folder, name: &str, mut seed: u64) -> String {
    let mut random = || {
        // Knuth's MMIX generator; the upper bits are good enough for holds and noise.
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 40) as f64 / f64::from(1_u32 << 24)
    };
    let mut text = String::from("time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa\n");
    let (mut u_pos, mut u_neg) = (0.8, 0.8);
    for row in 0..1200 {
        if row % 40 == 0 {
            u_pos = 0.68 + 0.28 * random();
        }
        if row % 55 == 0 {
            u_neg = 0.68 + 0.28 * random();
        }
        text.push_str(&format!("{},{u_pos:.4},{u_neg:.4},90,-65\n", f64::from(row) * 0.02));
    }
    let (commands, out) = (folder.with("commands.csv", text), folder.path("simulated.csv"));
    sound(["simulate", "--inputs", &commands, "--out", &out]);
    let csv = Csv::read(&out);
    let (pos, neg) = (csv.numbers("p_pos_kpa"), csv.numbers("p_neg_kpa"));
    let mut text = csv.header.join(",") + "\n";
    for (row, cells) in csv.rows.iter().enumerate() {
        let [p, n] = [pos[row], neg[row]].map(|p| p + 0.2 * (random() - 0.5));
        text.push_str(&format!("{},{},{},{p:.3},{n:.3}\n", cells[0], cells[1], cells[2]));
    }
    folder.with(name, text)
}

#[test]
fn a_rig_that_is_as_stated_is_adequate_and_every_file_is_there() {
    let folder = Folder::new("diagnose");
    let [a, b] = [recorded(&folder, "a.csv", 1), recorded(&folder, "b.csv", 2)];
    let out = folder.path("found");
    // An older answer was undecided; its experiment must not be played for this one.
    std::fs::create_dir_all(&out).unwrap();
    std::fs::write(format!("{out}/next_experiment.csv"), "older").unwrap();
    let said = sound(["diagnose", "--quick", "--json", "--out", &out, &a, &b]);
    let said: serde_json::Value = serde_json::from_str(&said).unwrap();
    assert_eq!(said["verdict"], "adequate", "{said:#}");
    assert_eq!((said["mechanisms"].as_array().unwrap().len(), &said["next_experiment"]), (0, &serde_json::Value::Null));
    for rig in ["nominal", "reidentified", "extended"] {
        for channel in ["pos", "neg"] {
            // Uniform noise of 0.2 kPa from end to end has a standard deviation of 0.058 kPa; 5 % for a fifth of 48 s.
            let rmse = said["fit"][rig][format!("{channel}_rmse_kpa")].as_f64().unwrap();
            assert!((0.05..0.068).contains(&rmse), "{rig} {channel} {rmse}");
            assert!(said["fit"][rig][format!("{channel}_accuracy")].as_f64().unwrap() > 0.99);
        }
    }
    assert_eq!((&said["rig"]["name"], &said["rig"]["kind"]), (&"dual_pressure".into(), &"as_given".into()));
    let left = said["unexplained"].as_array().unwrap();
    assert!(left.len() == 2 && left.iter().all(|u| u["times_noise"].as_f64().unwrap() < 1.0), "{said:#}");
    let file = |name: &str| std::fs::read_to_string(format!("{out}/{name}")).unwrap();
    let written: serde_json::Value = serde_json::from_str(&file("diagnosis.json")).unwrap();
    assert_eq!(written, said);
    let page = file("report.html");
    assert!(page.starts_with("<!DOCTYPE html>") && page.contains("Nothing is missing") && page.contains("<svg"));
    assert!(!std::path::Path::new(&out).join("next_experiment.csv").exists());
    // The rig that comes out runs, and as before.
    let again = folder.path("again.csv");
    sound(["simulate", "--rig", &format!("{out}/rig.toml"), "--inputs", &a, "--out", &again]);
    assert_eq!(Csv::read(&again).rows.len(), 1200);
}

#[test]
fn bad_input_is_refused_in_a_line() {
    let folder = Folder::new("diagnose-bad");
    let out = folder.path("found");
    let lame = folder.with("lame.csv", "time_s,u_pos,u_neg,p_pos_kpa\n0,0.8,0.8,90\n0.02,0.8,0.8,90\n");
    assert!(refused(["diagnose", "--out", &out, &lame]).contains("p_neg_kpa"));
    assert!(refused(["diagnose", "--out", &out, "nowhere.csv"]).contains("nowhere.csv"));
    let rows: String = (0..300).map(|k| format!("{},0.8,0.8,90.1,-65.2\n", f64::from(k) * 0.02)).collect();
    let short = folder.with("short.csv", format!("time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa\n{rows}"));
    let said = refused(["diagnose", "--out", &out, &short]);
    assert!(said.len() > 30, "{said}");
    // Nothing is left behind by what was refused.
    assert!(!std::path::Path::new(&out).exists());
}

/// A pressure-decay test of a chamber that does not leak: that it holds is the answer, and no recording without steps.
#[test]
fn a_chamber_that_holds_its_pressure_lacks_nothing() {
    let folder = Folder::new("holds");
    let rig = folder.with(
        "chamber.toml",
        "format = 1\nname = \"chamber\"\n[gas]\ngas_constant_j_per_kg_k = 287.0\nheat_capacity_ratio = 1.4\n\
         [atmosphere]\npressure_kpa_abs = 101.325\ntemperature_k = 293.15\n\
         [volumes.chamber]\nvolume_l = 0.5\ntemperature_k = 293.15\n\
         [sensors.gauge]\nvolume = \"chamber\"\ncolumn = \"p_kpa\"\nrange_kpa_gauge = [0.0, 400.0]\nrange_v = [0.0, 5.0]\n",
    );
    let file = |name: &str, level_kpa: f64| {
        let mut dice = Dice(5);
        let line = |k: usize| format!("{:.2},{:.4}\n", 0.02 * k as f64, level_kpa + 0.2 * (dice.throw() - 0.5));
        folder.with(name, format!("time_s,p_kpa\n{}", (0..2000).map(line).collect::<String>()))
    };
    let (held, out) = (file("held.csv", 200.0), folder.path("found"));
    let said = json(&["diagnose", "--quick", "--json", "--rig", &rig, &held, "--out", &out]);
    assert_eq!(said["verdict"], "adequate", "{said:#}");
    assert!(said["notes"].to_string().contains("stands at 200."), "{said:#}");
    // At the open air there is nothing to hold.
    let said = refused(["diagnose", "--quick", "--rig", &rig, &file("open.csv", 0.0), "--out", &out]);
    assert!(said.contains("no pressure moves"), "{said}");
}
