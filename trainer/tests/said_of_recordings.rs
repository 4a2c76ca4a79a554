//! Recordings that say something wrong of themselves, or nothing of what they are: units over other numbers, seconds that may count rows.
//! The rig tells what they are, and the key that is told mends it.

// What fails here fails the test, helper functions included.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod program;

use model::predict::DualPressureRig;
use model::rig::Rig;
use program::paper_run::{Dice, Spoil, absolute, csv, scaled, sound, told_key};
use program::{Folder, run};

/// Numbers tell what they are whatever unit is said of them: what they seem to be, and a key a column that makes them so.
#[test]
fn a_unit_that_is_said_of_numbers_in_another_is_told_with_the_key_that_mends_it() {
    let folder = Folder::new("said-units");
    let rig = model::rig::DUAL_PRESSURE;
    let cases: [(&str, [&str; 2], Spoil, &str); 10] = [
        ("gauge", ["kPa abs", "kPa abs"], |_| {}, "the file says kPa abs, and the numbers seem to be gauge kPa"),
        ("one_gauge", ["kPa", "kPa abs"], |_| {}, "the file says kPa abs, and the numbers seem to be gauge kPa"),
        ("bar_abs", ["bar abs", "bar abs"], |_| {}, "the file says bar abs, and the numbers seem to be gauge kPa"),
        ("volts", ["V", "V"], |_| {}, "the file says V, and the numbers seem to be gauge kPa"),
        ("loop", ["mA", "mA"], |_| {}, "the file says mA, and the numbers seem to be gauge kPa"),
        (
            "mbar",
            ["mbar abs", "mbar abs"],
            |r| scaled(r, 10.0),
            "the file says mbar abs, and the numbers seem to be mbar",
        ),
        (
            "kpa_abs",
            ["psi", "psi"],
            |r| absolute(r, 1.0),
            "the file says psi, and the numbers seem to be absolute, in kPa",
        ),
        ("mmhg", ["psi", "psi"], |r| scaled(r, 7.500_62), "the file says psi, and the numbers seem to be mmHg"),
        (
            "bar",
            ["kPa a", "kPa a"],
            |r| absolute(r, 0.01),
            "the file says kPa a, and the numbers seem to be absolute, in bar",
        ),
        ("psi", ["bar", "bar"], |r| scaled(r, 0.145_038), "the file says bar, and the numbers seem to be psi"),
    ];
    for (name, [pos, neg], spoil, words) in cases {
        let mut rows = sound();
        rows.iter_mut().for_each(spoil);
        let header = format!("p_pos_kpa [{pos}],p_neg_kpa [{neg}]");
        let file = folder.with(&format!("{name}.csv"), csv(&rows).replacen("p_pos_kpa,p_neg_kpa", &header, 1));
        let mut map = String::new();
        for keys in 0..=2 {
            let with = folder.with("said.toml", format!("{rig}\n[recording]\n{map}"));
            let said = run(["validate", "--rig", &with, &file]);
            if keys > 0 && said.status == 0 {
                assert!(!said.err.contains("seem"), "{name}: {map}: {}", said.err);
                break;
            }
            assert!(keys < 2 && said.err.contains(words), "{name}, {map}: {}", said.err);
            map += &format!("{}\n", told_key(&said.err));
        }
    }
    // A map says it as wrongly as a file.
    let file = folder.with("map.csv", csv(&sound()));
    let map = |unit: &str| {
        let map = format!("columns.p_pos_kpa = {{ from = \"p_pos_kpa\", unit = \"{unit}\" }}");
        folder.with("map.toml", format!("{rig}\n[recording]\n{map}\n"))
    };
    let said = run(["validate", "--rig", &map("kPa abs"), &file]);
    let words = "the rig file says kPa abs, and the numbers seem to be gauge kPa";
    assert!(said.status != 0 && said.err.contains(words) && said.err.contains("unit = \"kPa\" }"), "{}", said.err);
    assert_eq!(run(["validate", "--rig", &map("kPa"), &file]).status, 0);
}

/// `time_s` that goes on by one is a row a second where the rig follows the commands so, and a line says what it was taken for.
#[test]
fn a_row_a_second_is_read_and_told() {
    let folder = Folder::new("row-a-second");
    let mut rig = DualPressureRig::new(&Rig::builtin("dual_pressure").unwrap()).unwrap();
    let (mut dice, mut duty) = (Dice(11), [0.8, 0.8]);
    let mut rows = Vec::new();
    for second in 0..160 {
        if second % 4 == 0 {
            duty = duty.map(|_| 0.66 + 0.32 * dice.throw());
        }
        if second >= 10 {
            let [pos, neg] = rig.readings_kpa().map(|kpa| kpa + 0.2 * (dice.throw() - 0.5));
            rows.push([f64::from(second - 10), duty[0], duty[1], pos, neg]);
        }
        (0..50).for_each(|_| {
            rig.tick(duty, true);
        });
    }
    let note = "taken as 1 s a row; if they count rows: [recording] time = { from = \"time_s\", scale = 0.02 }";
    let file = folder.with("seconds.csv", csv(&rows));
    let said = run(["validate", "--rig", "dual_pressure", &file]);
    assert!(said.status == 0 && said.err.contains(note), "{}", said.err);
    // Half a row later, or with a clock that jitters, they count nothing.
    for (name, shift) in [("later", 0.37), ("jitter", 0.004)] {
        let mut others = rows.clone();
        others
            .iter_mut()
            .enumerate()
            .for_each(|(k, r)| r[0] += if name == "later" || k % 2 == 1 { shift } else { 0.0 });
        let said = run(["validate", "--rig", "dual_pressure", &folder.with(&format!("{name}.csv"), csv(&others))]);
        assert!(said.status == 0 && !said.err.contains("count rows"), "{name}: {}", said.err);
    }
}

/// A unit of commands that the file says wrongly gets the key that takes its place.
#[test]
fn shares_under_a_per_cent_get_their_key() {
    let folder = Folder::new("said-per-cent");
    let text = csv(&sound()).replacen("u_pos,u_neg", "u_pos [%],u_neg [%]", 1);
    let file = folder.with("percent.csv", text);
    let said = run(["validate", "--rig", "dual_pressure", &file]);
    for column in ["u_pos", "u_neg"] {
        let key = format!("[recording] columns.{column} = {{ from = \"{column}\", unit = \"1\" }}");
        assert!(said.status != 0 && said.err.contains("the file says %") && said.err.contains(&key), "{}", said.err);
    }
    let map = ["u_pos", "u_neg"].map(|of| format!("columns.{of} = {{ from = \"{of}\", unit = \"1\" }}\n")).concat();
    let mended = folder.with("percent.toml", format!("{}\n[recording]\n{map}", model::rig::DUAL_PRESSURE));
    assert_eq!(run(["validate", "--rig", &mended, &file]).status, 0);
}
