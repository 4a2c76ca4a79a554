//! Recordings that were handed over, through the built program: they lie beside the repository (`shared/faults/inputs`, or where
//! `FAULT_INPUTS` says), and these tests say so and end where they are not there.

// What fails here fails the test, helper functions included.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod program;

use std::path::PathBuf;

use program::{Folder, elsewhere, json, refused};

fn handed(name: &str) -> Option<PathBuf> {
    Some(elsewhere("FAULT_INPUTS", "shared/faults/inputs")?.join(name))
}

fn text(path: PathBuf) -> String {
    path.to_str().unwrap().to_owned()
}

#[test]
fn handed_logger_formats_are_read() {
    let Some(folder) = handed("11_logger_formats") else { return };
    for name in [
        "a01_labview.lvm",
        "a02_tabs.csv",
        "a03_semicolon_decimal_comma.csv",
        "a05_units_row.csv",
        "a13_trailing_comma.csv",
        "a14_hash_comments.csv",
        "a16_datetime.csv",
    ] {
        let said = json(&["validate", "--json", "--refine", "1", "--rig", "dual_pressure", &text(folder.join(name))]);
        assert!(said["overall"]["pos_rows"].as_u64().unwrap() > 20, "{name}: {said:#}");
    }
    // Its columns are those of another rig, and the header is found below the block of settings.
    let said = refused(["validate", "--rig", "dual_pressure", &text(folder.join("header_block.csv"))]);
    assert!(said.contains("unit = \"ms\"") && said.contains("[recording]"), "{said}");
}

#[test]
fn handed_files_under_own_names_are_read_at_any_rate_with_nan_and_lost_rows() {
    let (Some(nan), Some(rate), Some(gaps), Some(lost)) = (
        handed("07_nan_in_unused_column"),
        handed("08_rate_own_names"),
        handed("09_gaps_flatter_validate"),
        handed("15_lost_rows_refused"),
    ) else {
        return;
    };
    let figures = |rig: &str, file: PathBuf| {
        json(&["validate", "--json", "--refine", "1", "--rig", rig, &text(file)])["overall"].clone()
    };
    assert!(figures("dual_pressure", nan.join("run.csv"))["pos_rows"].as_u64().unwrap() > 1000);
    assert!(figures(&text(rate.join("rig.toml")), rate.join("run_100hz.csv"))["pos_rows"].as_u64().unwrap() > 150);
    // The whole file comes to 16.43 kPa.
    let of = figures("dual_pressure", gaps.join("lost_5_percent.csv"));
    let rmse = of["pos_rmse_kpa"].as_f64().unwrap();
    assert!((rmse / 16.43 - 1.0).abs() < 0.05 && of["began_anew"] == 0, "{of:#}");
    for (rig, file) in [("dual_pressure", "jitter.csv"), ("dual_pressure", "lost.csv")] {
        assert_eq!(figures(rig, lost.join(file))["began_anew"], 0, "{file}");
    }
    let [own, other] =
        [("dual_pressure".to_owned(), "jitter.csv"), (text(lost.join("foreign.toml")), "jitter_foreign_names.csv")]
            .map(|(rig, file)| figures(&rig, lost.join(file))["pos_rmse_kpa"].as_f64().unwrap());
    assert!((own / other - 1.0).abs() < 1e-6, "one rule for both: {own} {other}");
}

#[test]
fn handed_recordings_of_something_else_are_refused() {
    let folder = Folder::new("handed-refused");
    let out = folder.path("out");
    let refuse = |case: &str, rig: &str, file: &str, words: &[&str]| {
        let Some(case) = handed(case) else { return };
        let (rig, file) = (text(case.join(rig)), text(case.join(file)));
        let said = refused(["diagnose", "--quick", "--rig", &rig, &file, "--out", &out]);
        for word in words {
            assert!(said.contains(word), "`{word}` is not in: {said}");
        }
    };
    refuse("03_absolute_pressure_foreign", "rig.toml", "abs_hpa.csv", &["absolute", "101.3"]);
    refuse("03_absolute_pressure_foreign", "rig_gauge.toml", "pwm255.csv", &["outside 0 … 1", "0.00392157"]);
    refuse("04_command_scale_forgotten", "rig.toml", "pwm255.csv", &["outside 0 … 1", "0.00392157"]);
    refuse("14_rig_without_inputs", "rig.toml", "cuff.csv", &["nothing in this rig can move a pressure"]);
}

#[test]
#[ignore = "slow: twelve seconds, and the sparse recordings made here are in the suite"]
fn handed_sparse_recordings_of_a_sound_rig_name_nothing() {
    let (Some(sparse), Some(rig)) =
        (handed("05_sparse_rows_noise"), handed("03_absolute_pressure_foreign/rig_gauge.toml"))
    else {
        return;
    };
    let (folder, rig) = (Folder::new("handed-sparse"), text(rig));
    // `r32j.csv` (32 Hz with jitter) is not among them: `identify` still calls its rounding 1.3 times the noise.
    for name in ["r50.csv", "r10.csv", "r2.csv"] {
        let file = text(sparse.join(name));
        let said = json(&["diagnose", "--quick", "--json", "--rig", &rig, &file, "--out", &folder.path("found")]);
        assert_eq!(said["mechanisms"].as_array().map(Vec::len), Some(0), "{name}: {said:#}");
        let fitted = json(&["identify", "--json", "--rig", &rig, &file, "--out", &folder.path("fitted.toml")]);
        assert!(!fitted["remarks"].to_string().contains("times the noise"), "{name}: {fitted:#}");
    }
}
