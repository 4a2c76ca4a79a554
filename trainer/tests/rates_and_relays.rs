//! Recordings whose sensors are read at rates of their own, and whose relay is logged the other way round: what is read is what the rig
//! did, and what cannot be is told with the key that mends it.

// What fails here fails the test, helper functions included.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod program;

use std::fmt::Write as _;

use model::predict::DualPressureRig;
use model::rig::Rig;
use program::paper_run::{Dice, ROWS, csv, sound, told_key};
use program::{Folder, json, run};

/// Root mean square errors of both channels, and their readings.
fn validated(file: &str) -> [[f64; 2]; 2] {
    let said = json(&["validate", "--json", "--rig", "dual_pressure", file]);
    ["pos", "neg"].map(|of| ["rmse_kpa", "rows"].map(|key| said["overall"][format!("{of}_{key}")].as_f64().unwrap()))
}

/// Each sensor held for rows of its own, or blank between, has the error that it has where all its readings are there.
#[test]
fn sensors_of_several_rates_have_the_errors_of_their_readings() {
    let folder = Folder::new("several-rates");
    let rows = sound();
    let whole = validated(&folder.with("whole.csv", csv(&rows)));
    for every in [[10, 7], [5, 1]] {
        let mut held = rows.clone();
        for (k, row) in held.iter_mut().enumerate() {
            (row[3], row[4]) = (rows[k / every[0] * every[0]][3], rows[k / every[1] * every[1]][4]);
        }
        let mut blank = "time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa\n".to_owned();
        for (k, [t, pos, neg, p, n]) in rows.iter().enumerate() {
            let cell = |kpa: &f64, every: usize| if k.is_multiple_of(every) { kpa.to_string() } else { String::new() };
            writeln!(blank, "{t},{pos:.5},{neg:.5},{},{}", cell(p, every[0]), cell(n, every[1])).unwrap();
        }
        for (name, text) in [("held.csv", csv(&held)), ("blank.csv", blank)] {
            let of = validated(&folder.with(name, text));
            for (channel, every) in every.into_iter().enumerate() {
                let [[rmse_kpa, count], [whole_kpa, _]] = [of[channel], whole[channel]];
                // 250 readings tell a root mean square to 5 %; a held one is off by what a pressure does in 0.1 s, some kPa.
                assert!((rmse_kpa / whole_kpa - 1.0).abs() < 0.2, "{name} {every}: {rmse_kpa} {whole_kpa}");
                assert!(count <= (ROWS / every + 1) as f64, "{name} {every}: {count}");
            }
        }
    }
}

/// A run from rest whose pump is off twice, with the relay's column as `logged` makes it of the truth.
fn switched(logged: impl Fn(u8) -> u8) -> String {
    let mut rig = DualPressureRig::new(&Rig::builtin("dual_pressure").unwrap()).unwrap();
    let (mut dice, mut duty) = (Dice(5), [0.8, 0.8]);
    let mut text = "time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa,pump_on\n".to_owned();
    for row in 0..2500 {
        if row % 50 == 0 {
            duty = duty.map(|_| 0.66 + 0.32 * dice.throw());
        }
        let is_on = !(700..1000).contains(&row) && !(1800..2200).contains(&row);
        let [pos, neg] = rig.readings_kpa().map(|kpa| kpa + 0.2 * (dice.throw() - 0.5));
        let time_s = 0.02 * f64::from(row);
        let [u_pos, u_neg] = duty;
        writeln!(text, "{time_s:.2},{u_pos:.5},{u_neg:.5},{pos:.4},{neg:.4},{}", logged(u8::from(is_on))).unwrap();
        rig.tick(duty, is_on);
    }
    text
}

/// Switched the other way round, or never on: pressures rise all the same, and the key that is told mends it where it can.
#[test]
fn a_relay_that_is_logged_the_other_way_round_is_told() {
    let folder = Folder::new("relay");
    let key = "columns.pump_on = { from = \"pump_on\", scale = -1.0, offset = 1.0 }";
    let ok = run(["validate", "--rig", "dual_pressure", &folder.with("right.csv", switched(|on| on))]);
    assert_eq!(ok.status, 0, "{}", ok.err);
    // The peak where the pump is switched off is what the rig did.
    assert!(!ok.err.contains("relay") && !ok.err.contains("wild"), "{}", ok.err);
    let inverted = folder.with("inverted.csv", switched(|on| 1 - on));
    for file in [&inverted, &folder.with("never.csv", switched(|_| 0))] {
        let said = run(["validate", "--rig", "dual_pressure", file]);
        assert!(
            said.status == 1 && said.err.contains("the relay seems to be inverted (1 is on)"),
            "{file}: {}",
            said.err
        );
        assert!(said.err.contains("while it says that the pump is off") && told_key(&said.err) == key, "{}", said.err);
        let said = run(["identify", "--rig", "dual_pressure", file, "--out", &folder.path("fitted.toml")]);
        assert!(said.status == 2 && said.err.contains(key), "{file}: {}", said.err);
    }
    let mended = folder.with("mended.toml", format!("{}\n[recording]\n{key}\n", model::rig::DUAL_PRESSURE));
    let said = run(["validate", "--rig", &mended, &inverted]);
    assert!(said.status == 0 && !said.err.contains("relay"), "{}", said.err);
}
