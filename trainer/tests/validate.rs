//! `trainer validate`, end to end: figures that are known beforehand.

// What fails here fails the test, helper functions included.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod program;

use model::rig::Rig;
use program::{Csv, Folder, refused, run, sound};

/// A recording that the model itself made: from 90 and −60 kPa along steps of both duties.
fn simulated(folder: &Folder) -> String {
    let mut text = String::from("time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa\n");
    for row in 0..100 {
        let (u_pos, u_neg) = (0.7 + 0.1 * f64::from(row / 25), 0.9 - 0.1 * f64::from(row / 40));
        text.push_str(&format!("{},{u_pos},{u_neg},90,-60\n", f64::from(row) * 0.02));
    }
    let (inputs, out) = (folder.with("commands.csv", text), folder.path("simulated.csv"));
    sound(["simulate", "--inputs", &inputs, "--out", &out]);
    out
}

/// A reading that is missing where commands change costs that reading: the run follows the commands that stand in the file.
#[test]
fn commands_beside_a_missing_reading_are_used() {
    let folder = Folder::new("missing-readings");
    let path = simulated(&folder);
    let mut table = Csv::read(&path);
    let at = table.header.iter().position(|name| name == "p_neg_kpa").unwrap();
    let changes = [25, 26, 40, 50, 51, 75, 80];
    changes.into_iter().for_each(|row: usize| table.rows[row][at] = "NaN".to_owned());
    let lines = std::iter::once(&table.header).chain(&table.rows).map(|cells| cells.join(",") + "\n");
    let file = folder.with("missing.csv", lines.collect::<String>());
    let value = json(&[&file]);
    for (channel, rows) in [("pos", 100), ("neg", 93)] {
        let figure = |key: &str| value["overall"][format!("{channel}_{key}")].as_f64().unwrap();
        assert!(figure("rmse_kpa") < 5e-8 && figure("rows") == f64::from(rows), "{value:#}");
    }
    let told = run(["validate", &file]).err;
    assert!(told.contains("7 readings of p_neg_kpa are missing"), "{told}");
}

fn json(args: &[&str]) -> serde_json::Value {
    program::json(&[&["validate", "--json"], args].concat())
}

#[test]
fn a_simulated_recording_is_all_right() {
    let folder = Folder::new("perfect");
    let path = simulated(&folder);
    let value = json(&[&path]);
    for channel in ["pos", "neg"] {
        let figure = |key: &str| value["overall"][format!("{channel}_{key}")].as_f64().unwrap();
        // The file's seven digits: errors up to 5e-8 kPa, on pressures of some ten.
        assert!(figure("accuracy") > 1.0 - 1e-8, "{value:#}");
        assert!(figure("rmse_kpa") < 5e-8 && figure("max_error_kpa") <= 5.1e-8, "{value:#}");
        assert_eq!((figure("rows"), figure("rows_near_zero")), (100.0, 0.0), "{value:#}");
    }
    let table = sound(["validate", &path]);
    assert_eq!((table.lines().count(), table.matches("100.00 %").count()), (3, 2), "{table}");
}

/// Readings 2 % above the simulation from the second row on, and 1 kPa below it.
#[test]
fn known_errors_give_known_figures() {
    let folder = Folder::new("known");
    let csv = Csv::read(simulated(&folder));
    let (pos, neg) = (csv.numbers("p_pos_kpa"), csv.numbers("p_neg_kpa"));
    let mut text = csv.header.join(",") + "\n";
    let mut shares = 0.0;
    for (row, cells) in csv.rows.iter().enumerate() {
        let (p, n) = if row == 0 { (pos[0], neg[0]) } else { (pos[row] * 1.02, neg[row] - 1.0) };
        shares += (n - neg[row]).abs() / n.abs();
        text.push_str(&format!("{},{},{},{p:?},{n:?}\n", cells[0], cells[1], cells[2]));
    }
    let value = json(&[&folder.with("known.csv", text)]);
    let figure = |key: &str| value["overall"][key].as_f64().unwrap();
    // |s − p|/p is 0.02/1.02 in 99 of 100 rows. Tolerances: seven digits in the simulated file.
    assert!((figure("pos_accuracy") - (1.0 - 0.99 * 0.02 / 1.02)).abs() < 1e-8, "{value:#}");
    assert!((figure("neg_accuracy") - (1.0 - shares / 100.0)).abs() < 1e-8, "{value:#}");
    assert!((figure("neg_rmse_kpa") - 0.99_f64.sqrt()).abs() < 1e-6, "{value:#}");
    assert!((figure("neg_max_error_kpa") - 1.0).abs() < 1e-6, "{value:#}");
}

#[test]
fn rows_near_the_atmosphere_are_counted_and_left_out() {
    let folder = Folder::new("near");
    let header = "time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa\n";
    // At rest with the pump off nothing moves: recorded 0.3 and 40 kPa are errors of all they are.
    let rows: String = [(0.0, 0), (0.3, 0), (40.0, 0)]
        .iter()
        .enumerate()
        .map(|(k, (p, n))| format!("{},1,1,{p},{n},0\n", k as f64 * 0.02))
        .collect();
    let path = folder.with("near.csv", header.replace("kpa\n", "kpa,pump_on\n") + &rows);
    let overall = json(&[&path])["overall"].clone();
    assert_eq!((&overall["pos_rows"], &overall["pos_rows_near_zero"]), (&3.into(), &2.into()), "{overall:#}");
    assert_eq!((overall["pos_accuracy"].as_f64(), &overall["neg_accuracy"]), (Some(0.0), &serde_json::Value::Null));
    // With no least pressure the row at 0.3 kPa counts, the one at 0 never can.
    let overall = json(&["--least-kpa", "0", &path])["overall"].clone();
    assert_eq!(overall["pos_rows_near_zero"], 1, "{overall:#}");
}

#[test]
fn several_recordings_get_a_line_each_and_one_for_all() {
    let folder = Folder::new("several");
    let path = simulated(&folder);
    let text = std::fs::read_to_string(&path).unwrap();
    // The same rig from its 41st row on is another run.
    let later: Vec<&str> = text.lines().enumerate().filter(|(k, _)| *k == 0 || *k > 40).map(|(_, line)| line).collect();
    let later = folder.with("later.csv", later.join("\n") + "\n");
    let table = sound(["validate", &path, &later]);
    assert_eq!(table.lines().count(), 1 + 3 * 2, "{table}");
    assert!(table.lines().nth(5).is_some_and(|line| line.starts_with("all ")), "{table}");
    let value = json(&[&path, &later]);
    assert_eq!((value["recordings"].as_array().map(Vec::len), &value["overall"]["pos_rows"]), (Some(2), &160.into()));
}

/// A file that is given twice, and a copy of it under another name, are no more evidence.
#[test]
fn a_recording_that_is_given_twice_counts_once() {
    let folder = Folder::new("twice");
    let path = simulated(&folder);
    let copy = folder.with("copy.csv", std::fs::read(&path).unwrap());
    let said = run(["validate", &path, &path, &copy]);
    assert_eq!((said.status, said.out.lines().count()), (0, 1 + 2), "{}{}", said.out, said.err);
    assert!(said.err.contains("simulated.csv: is given more than once, and counts once"), "{}", said.err);
    assert!(said.err.contains("copy.csv: holds the same rows as "), "{}", said.err);
    let value = json(&[&path, &copy]);
    assert_eq!((value["recordings"].as_array().map(Vec::len), &value["overall"]["pos_rows"]), (Some(1), &100.into()));
    assert!(value["doubts"].to_string().contains("holds the same rows"), "{value:#}");
}

#[test]
fn without_recorded_pressures_there_is_nothing_to_compare() {
    let folder = Folder::new("missing");
    let path = folder.with("commands.csv", "time_s,u_pos,u_neg\n0,1,1\n0.02,1,1\n");
    let said = refused(["validate", &path]);
    assert!(said.contains("column p_pos_kpa is missing"), "{said}");
}

/// A recording of a valve with play that goes up to a duty of 0.9 and then down by less than the play, which moves nothing;
/// what begins at `row` of it, and the rig.
fn with_play(folder: &Folder, row: usize) -> (String, String) {
    let builtin = Rig::builtin("dual_pressure").unwrap().to_toml().unwrap();
    let play = "[[mechanisms]]\nid = 'valve_hysteresis'\ncomponent = 'valve_pos'\nhalf_width_duty = 0.04\n";
    let rig = folder.with("play.toml", format!("{builtin}\n{play}"));
    let mut text = String::from("time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa\n");
    for row in 0..2000 {
        let u_pos = if row < 400 { 0.7 + 0.2 * f64::from(row) / 400.0 } else { 0.83 + 0.02 * f64::from(row / 50 % 2) };
        text.push_str(&format!("{},{u_pos},0.8,90,-60\n", f64::from(row) * 0.02));
    }
    let (inputs, whole) = (folder.with("commands.csv", text), folder.path("whole.csv"));
    sound(["simulate", "--rig", &rig, "--inputs", &inputs, "--out", &whole]);
    let text = std::fs::read_to_string(&whole).unwrap();
    let lines: Vec<&str> = text.lines().take(1).chain(text.lines().skip(1 + row)).collect();
    (rig, folder.with("cut.csv", lines.join("\n") + "\n"))
}

/// Root mean square by which a free run from the first row of a recording is off the positive pressure, in kPa.
fn simulated_off_by_kpa(folder: &Folder, rig: &str, recording: &str) -> f64 {
    let again = folder.path("again.csv");
    sound(["simulate", "--rig", rig, "--inputs", recording, "--out", &again]);
    let [truth, again] = [recording, &again].map(|path| Csv::read(path).numbers("p_pos_kpa"));
    let squares: f64 = truth.iter().zip(&again).map(|(t, s)| (t - s).powi(2)).sum();
    (squares / truth.len() as f64).sqrt()
}

/// Pressures that had settled tell where the flapper lies, whatever is commanded now. Duties are told from pressures averaged
/// over a revolution, from which the first row is off by half the ripple, 0.4 kPa; the middle of the play would be 4.6 kPa off.
#[test]
fn a_flapper_lies_where_pressures_had_settled() {
    let folder = Folder::new("settled");
    let (rig, cut) = with_play(&folder, 1000);
    let off_kpa = simulated_off_by_kpa(&folder, &rig, &cut);
    assert!(off_kpa < 0.6, "{off_kpa}");
}

/// On the way up no pressure has settled: `simulate`, which knows the first row alone, is off, and `validate` finds the place.
#[test]
fn a_flapper_may_lie_anywhere_in_its_play_when_a_recording_begins() {
    let folder = Folder::new("moving");
    let (rig, cut) = with_play(&folder, 403);
    let without_kpa = simulated_off_by_kpa(&folder, &rig, &cut);
    let value = json(&["--rig", &rig, &cut]);
    let with_kpa = value["overall"]["pos_rmse_kpa"].as_f64().unwrap();
    assert!(without_kpa > 0.5 && with_kpa < 0.1, "{with_kpa} {without_kpa} {value:#}");
    assert!(value["recordings"][0]["flappers_began_at"][0]["play:valve_pos"].as_f64().is_some(), "{value:#}");
}

/// Pressures that go up and down while both duties stand still are no figure of the model's.
#[test]
fn pressures_that_no_recorded_command_moves_are_told() {
    let folder = Folder::new("still-duties");
    let mut text = String::from("time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa\n");
    for row in 0..2000 {
        let time_s = f64::from(row) * 0.02;
        // Steps of a converter, so that there is a noise to hold them against.
        let wave =
            |kpa: f64, period_s: f64| (100.0 * kpa * (std::f64::consts::TAU * time_s / period_s).sin()).round() / 100.0;
        text.push_str(&format!("{time_s:.2},0.85,0.9,{},{}\n", 100.0 + wave(12.0, 10.0), -65.0 + wave(3.0, 8.0)));
    }
    let said = run(["validate", &folder.with("still.csv", text)]);
    assert_eq!(said.status, 1, "{}", said.err);
    assert!(said.err.contains("goes up and down") && said.err.contains("u_pos, u_neg"), "{}", said.err);
}

/// Two rows between two gaps, both wild in one sensor: the run of that stretch begins at what was read before and after.
#[test]
fn no_run_begins_at_a_stretch_that_is_wild_throughout() {
    let folder = Folder::new("wild-stretch");
    let mut text = String::from("time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa\n");
    for row in 0..1000 {
        let u_pos = if row < 600 { 0.8 } else { 0.85 };
        text.push_str(&format!("{:.2},{u_pos},0.9,90,-60\n", f64::from(row) * 0.02));
    }
    let (inputs, out) = (folder.with("commands.csv", text), folder.path("simulated.csv"));
    sound(["simulate", "--inputs", &inputs, "--out", &out]);
    let csv = Csv::read(out);
    let p_pos = csv.header.iter().position(|name| name == "p_pos_kpa").unwrap();
    let mut text = csv.header.join(",") + "\n";
    for (row, cells) in
        csv.rows.iter().enumerate().filter(|(row, _)| !(300..450).contains(row) || matches!(row, 400 | 401))
    {
        let mut cells = cells.clone();
        if matches!(row, 400 | 401) {
            cells[p_pos] = "5000".to_owned();
        }
        text += &(cells.join(",") + "\n");
    }
    let value = json(&[&folder.with("wild.csv", text)]);
    // The rig rests there, and the other chamber is moved by the pump that both share.
    for channel in ["pos", "neg"] {
        let off_kpa = value["overall"][format!("{channel}_max_error_kpa")].as_f64().unwrap();
        assert!(off_kpa < 0.05, "{channel}: {value:#}");
    }
}
