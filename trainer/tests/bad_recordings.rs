//! Recordings that are sound files and wrong all the same: columns exchanged, other units, dead sensors. Each must be
//! refused before anything is fitted, with the plain word for what is wrong; a fit would name physics instead.

// What fails here fails the test, helper functions included.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod program;

use fit::data::quality::Quality;
use fit::data::{Records, noise};
use model::rig::Rig;
use program::paper_run::{ROWS, Row, Spoil, absolute, csv, scaled, sound, told_key};
use program::{Folder, refused, run};
use proto::recording::Recording;

#[test]
fn each_gets_its_plain_word_and_status_2() {
    let folder = Folder::new("bad-recordings");
    let good = sound();
    let cases: [(&str, Spoil, &[&str]); 29] = [
        ("bar", |r| scaled(r, 0.01), &["p_pos_kpa: reads", "in bar", "unit = \"bar\""]),
        ("atm", |r| scaled(r, 1.0 / 101.325), &["p_pos_kpa: reads", "atm"]),
        ("mpa", |r| scaled(r, 0.001), &["p_pos_kpa: reads", "in MPa"]),
        ("psi", |r| scaled(r, 0.145_038), &["p_pos_kpa: reads", "in psi"]),
        ("water", |r| scaled(r, 0.101_972), &["p_pos_kpa: reads", "in m of water"]),
        ("inhg", |r| scaled(r, 0.295_3), &["p_pos_kpa: reads", "in inHg"]),
        ("pa", |r| scaled(r, 1e3), &["line 2, column 5 (p_neg_kpa)", "gauge kPa, and this seems to be Pa"]),
        ("mbar", |r| scaled(r, 10.0), &["line 2, column 5 (p_neg_kpa)", "mbar, hPa or mmHg"]),
        ("mmhg", |r| scaled(r, 7.500_62), &["line 2, column 5 (p_neg_kpa)", "mbar, hPa or mmHg"]),
        ("absolute", |r| absolute(r, 1.0), &["p_pos_kpa: reads", "absolute; subtract the atmosphere's 101.3 kPa"]),
        ("absolute_bar", |r| absolute(r, 0.01), &["p_pos_kpa: reads", "absolute, in bar"]),
        ("absolute_pa", |r| absolute(r, 1e3), &["p_pos_kpa: reads", "absolute, in Pa"]),
        ("absolute_psi", |r| absolute(r, 0.145_038), &["p_pos_kpa: reads", "absolute, in psi"]),
        ("one_absolute", |r| r[4] += 101.325, &["p_neg_kpa: reads", "absolute; subtract"]),
        ("one_bar", |r| r[3] *= 0.01, &["p_pos_kpa: reads", "in bar"]),
        ("one_psi", |r| r[4] *= 0.145_038, &["p_neg_kpa: reads", "in psi"]),
        (
            "volts",
            |r| (r[3], r[4]) = (1.0 + 0.004 * r[3], 1.0 - 4.0 / 101.0 * r[4]),
            &["p_pos_kpa: reads", "the sensor's volts", "1 … 5 V are 0 … 1000 kPa"],
        ),
        ("unsigned", |r| r[4] = -r[4], &["p_neg_kpa: reads", "the sign seems to be lost"]),
        ("pressures", |r| r.swap(3, 4), &["p_pos_kpa, p_neg_kpa", "two columns seem to be swapped"]),
        ("duties", |r| r.swap(1, 2), &["u_pos, u_neg", "seem to be swapped"]),
        ("inverted", |r| r[2] = 1.0 - r[2], &["u_neg", "inverted (1 is open)"]),
        ("percent", |r| (r[1], r[2]) = (100.0 * r[1], 100.0 * r[2]), &["line 2, column 2 (u_pos)", "not a percentage"]),
        ("twice", |r| (r[1], r[2]) = (0.01 * r[1], 0.01 * r[2]), &["u_pos: never above 0.0", "divided once too often"]),
        ("dead", |r| r[3] = 90.0, &["p_pos_kpa: flat: 90.00 kPa throughout", "check the sensor"]),
        ("unmoved", |r| (r[1], r[2]) = (0.8, 0.8), &["u_pos, u_neg: no command moves", "the commands that were sent"]),
        ("ms", |r| r[0] *= 1e3, &["rows are 20000 ms apart", "in milliseconds: divide it by 1000"]),
        ("us", |r| r[0] *= 1e6, &["in microseconds"]),
        ("minutes", |r| r[0] /= 60.0, &["in minutes"]),
        ("rows", |r| r[0] = (r[0] / 0.02).round(), &["seems to count rows"]),
    ];
    for (name, spoil, words) in cases {
        let mut rows = good.clone();
        rows.iter_mut().for_each(spoil);
        check(&folder, name, &csv(&rows), words);
    }
}

#[test]
fn torn_short_and_clipped_ones_as_well() {
    let folder = Folder::new("torn-recordings");
    let good = sound();
    check(&folder, "short", &csv(&good[..500]), &["too short: 10.0 s", "record at least 20 s"]);
    check(&folder, "tiny", &csv(&good[..2]), &["too short: 0.0 s"]);
    let torn: Vec<Row> = good.iter().enumerate().filter(|(k, _)| k % 100 < 80).map(|(_, row)| *row).collect();
    check(&folder, "torn", &csv(&torn), &["24 gaps, the first before 2.00 s", "lost packets"]);
    // A limit that four fifths of the readings are above, and one that a third is.
    let mut sorted: Vec<f64> = good.iter().map(|row| row[3]).collect();
    sorted.sort_by(f64::total_cmp);
    for (name, share) in [("clipped_most", 0.2), ("clipped_some", 0.67)] {
        let limit = sorted[(share * ROWS as f64) as usize];
        let clipped: Vec<Row> = good.iter().map(|[t, a, b, p, n]| [*t, *a, *b, p.min(limit), *n]).collect();
        check(&folder, name, &csv(&clipped), &["p_pos_kpa: clipped: ", "readings (", "Keep the pressure within"]);
    }
    // The same trouble in several files is told once.
    let paths: Vec<String> = [("a", 0.0), ("b", 0.1), ("c", 0.2)]
        .iter()
        .map(|(name, off)| {
            folder.with(
                &format!("{name}.csv"),
                csv(&good.iter().map(|r| [r[0], r[1], r[2], 90.0, r[4] - off]).collect::<Vec<_>>()),
            )
        })
        .collect();
    let out = folder.path("out");
    let mut arguments = vec!["diagnose", "--quick", "--out", &out];
    arguments.extend(paths.iter().map(String::as_str));
    let said = refused(arguments);
    assert!(
        said.matches("flat").count() == 1 && said.contains("a.csv: p_pos_kpa: flat") && said.contains("2 more"),
        "{said}"
    );
}

/// One reading in seven is zero among some 100 kPa: dropouts, and neither a limit nor the noise of the rest.
#[test]
fn dropouts_are_refused_as_what_they_are() {
    let folder = Folder::new("dropouts");
    let mut rows = sound();
    rows.iter_mut().skip(3).step_by(7).for_each(|row| row[3] = 0.0);
    check(&folder, "dropouts", &csv(&rows), &["p_pos_kpa: 357 wild readings", "loose contact"]);
    let said = run(["validate", "--rig", "dual_pressure", &folder.path("dropouts.csv")]);
    assert!(said.status == 1 && !said.err.contains("clipped"), "{}", said.err);
}

/// A sensor that is powered after the logger reads zero at first: no run begins there, whether it is a few rows or many.
#[test]
fn no_run_begins_before_a_sensor_has_power() {
    let folder = Folder::new("late-sensor");
    let good = sound();
    let rmse = |name: &str, rows: &[Row]| {
        let said = run(["validate", "--json", "--rig", "dual_pressure", &folder.with(name, csv(rows))]);
        assert_eq!(said.status, 0, "{name}: {}", said.err);
        let value: serde_json::Value = serde_json::from_str(&said.out).unwrap();
        (["pos_rmse_kpa", "neg_rmse_kpa"].map(|key| value["overall"][key].as_f64().unwrap()), said.err)
    };
    let (whole, _) = rmse("whole.csv", &good);
    for (count, columns) in [(1, 3..4), (2, 3..5), (3, 3..4), (3, 3..5), (12, 3..5), (30, 3..4), (30, 3..5)] {
        let mut rows = good.clone();
        rows.iter_mut().take(count).for_each(|row| row[columns.clone()].fill(0.0));
        let name = format!("{count}_{}.csv", columns.len());
        let (late, told) = rmse(&name, &rows);
        assert!(late.iter().zip(whole).all(|(late, whole)| *late < 1.5 * whole), "{name}: {late:?} {whole:?}");
        let reading = if count == 1 { "reading" } else { "readings" };
        assert!(told.contains(&format!("p_pos_kpa: {count} wild {reading}, up to ")), "{name}: {told}");
        assert_eq!(told.contains("power the sensor"), count > 3, "{name}: {told}");
        let recording = Recording::parse_csv(&name, csv(&rows).as_bytes()).unwrap();
        let rig = Rig::builtin("dual_pressure").unwrap();
        let records = Records::new(&rig, &[recording]).unwrap();
        let quality = Quality::of(&rig, &records, &noise(&records)).unwrap();
        assert_eq!(quality.refusal(), None, "{name}");
        let (quality, records) = quality.sound(records);
        // A few are bridged by the first sound reading, more are left out.
        let rows_left = if count > 3 { ROWS - count } else { ROWS };
        assert_eq!((records.rows(), quality.usable.len()), (rows_left, 2 * rows_left), "{name}");
        assert!(records.channel_kpa(0, 0)[0] > 20.0, "{name}");
    }
}

/// Refused by `diagnose` and by `identify` with these words, and nothing is left behind.
fn check(folder: &Folder, name: &str, text: &str, words: &[&str]) {
    let (path, out) = (folder.with(&format!("{name}.csv"), text), folder.path(&format!("{name}.out")));
    let said = last_line(&refused(["diagnose", "--quick", &path, "--out", &out]));
    for word in words {
        assert!(said.contains(word), "{name}: `{word}` is not in: {said}");
    }
    assert!(!std::path::Path::new(&out).join("diagnosis.json").exists(), "{name}");
    let rig = folder.path(&format!("{name}.toml"));
    assert_eq!(last_line(&refused(["identify", &path, "--out", &rig])), said, "{name}");
    assert!(!std::path::Path::new(&rig).exists(), "{name}");
}

/// Line that says what is wrong; a line of progress may stand before it.
fn last_line(said: &str) -> String {
    said.lines().last().unwrap_or_default().to_owned()
}

#[test]
fn a_sound_one_is_not_refused_nor_one_of_a_rig_somewhat_off() {
    let good = Recording::parse_csv("good.csv", csv(&sound()).as_bytes()).unwrap();
    let mut off = Rig::builtin("dual_pressure").unwrap();
    for valve in off.valves.values_mut() {
        valve.input_area_mm2 *= 1.06;
    }
    off.volumes.values_mut().for_each(|volume| volume.volume_l *= 0.9);
    for rig in [Rig::builtin("dual_pressure").unwrap(), off, Rig::builtin("bench").unwrap()] {
        let records = Records::new(&rig, std::slice::from_ref(&good)).unwrap();
        let quality = Quality::of(&rig, &records, &noise(&records)).unwrap();
        assert_eq!(quality.refusal(), None, "{}", rig.name);
    }
}

/// A pipe that nobody writes to, a folder, a device without an end: refused at once by every command that reads a recording.
#[test]
fn what_is_no_file_is_refused_and_never_waited_for() {
    let folder = Folder::new("no-file");
    let fifo = folder.path("fifo.csv");
    assert!(std::process::Command::new("mkfifo").arg(&fifo).status().unwrap().success());
    let out = folder.path("out");
    for (what, word) in [(fifo.as_str(), "named pipe"), ("/dev/zero", "device"), (out.as_str(), "folder")] {
        std::fs::create_dir_all(&out).unwrap();
        for command in ["validate", "identify", "diagnose", "simulate"] {
            let to = folder.path("to");
            let args: Vec<&str> = match command {
                "validate" => vec![command, what],
                "simulate" => vec![command, "--inputs", what, "--out", &to],
                _ => vec![command, what, "--out", &to],
            };
            let line = refused(args);
            assert!(line.contains(what) && line.contains(word), "{command}: {line}");
        }
    }
}

/// `validate` refuses what no sensor can read with the reason that all columns together tell, and says of the rest what it seems to be.
#[test]
fn validate_says_what_readings_are_taken_for() {
    let folder = Folder::new("validated-recordings");
    let good = sound();
    let refusals: [(&str, Spoil, &str); 4] = [
        ("absolute", |r| (r[3], r[4]) = (r[3] + 101.325, r[4] + 101.325), "seems to be absolute"),
        ("unsigned", |r| r[4] = -r[4], "the sign seems to be lost"),
        ("exchanged", |r| r.swap(3, 4), "seem to be swapped"),
        ("hpa", |r| (r[3], r[4]) = (10.0 * r[3] + 1013.25, 10.0 * r[4] + 1013.25), "absolute, in mbar, hPa"),
    ];
    for (name, spoil, words) in refusals {
        let mut rows = good.clone();
        rows.iter_mut().for_each(spoil);
        let file = folder.with(&format!("{name}.csv"), csv(&rows));
        let said = refused(["validate", "--rig", "dual_pressure", &file]);
        assert!(said.contains(words), "{name}: {said}");
    }
    let told: [(&str, Spoil, &str); 4] = [
        ("psi", |r| (r[3], r[4]) = (0.145_038 * r[3], 0.145_038 * r[4]), "in psi"),
        ("bar", |r| (r[3], r[4]) = (0.01 * r[3], 0.01 * r[4]), "in bar"),
        ("duties", |r| r.swap(1, 2), "seem to be swapped"),
        ("inverted", |r| r[2] = 1.0 - r[2], "inverted"),
    ];
    for (name, spoil, words) in told {
        let mut rows = good.clone();
        rows.iter_mut().for_each(spoil);
        let file = folder.with(&format!("{name}.csv"), csv(&rows));
        let said = run(["validate", "--rig", "dual_pressure", &file]);
        assert!(said.status == 1 && said.err.contains(words), "{name}: {}", said.err);
    }
    let file = folder.with("good.csv", csv(&good));
    let said = run(["validate", "--rig", "dual_pressure", &file]);
    assert!(!said.err.contains("seem"), "{}", said.err);
}

/// The key that a complaint gives, pasted into the rig file, is all that the recording needs.
#[test]
fn the_key_that_is_told_mends_it() {
    let folder = Folder::new("mended-recordings");
    let good = sound();
    let cases: [(&str, Spoil); 6] = [
        ("pressures", |r| r.swap(3, 4)),
        ("duties", |r| r.swap(1, 2)),
        ("inverted", |r| r[2] = 1.0 - r[2]),
        ("one_absolute", |r| r[4] += 101.325),
        ("one_psi", |r| r[4] *= 0.145_038),
        ("unsigned", |r| r[4] = -r[4]),
    ];
    let rig = model::rig::DUAL_PRESSURE;
    for (name, spoil) in cases {
        let mut rows = good.clone();
        rows.iter_mut().for_each(spoil);
        let file = folder.with(&format!("{name}.csv"), csv(&rows));
        let said = run(["validate", "--rig", "dual_pressure", &file]);
        let key = told_key(&said.err).replace(" and ", "\n");
        let mended = folder.with(&format!("{name}.toml"), format!("{rig}\n[recording]\n{key}\n"));
        let said = run(["validate", "--rig", &mended, &file]);
        assert!(said.status == 0 && !said.err.contains("seem"), "{name}: {key}: {}", said.err);
    }
}

/// A logger was told of another unit than it measures: numbers in kPa under another name. One unit is larger than what a sensor can tell,
/// one smaller; one is near to a third (mbar, and metres of water over kPa), which it is not taken for.
#[test]
fn a_unit_over_the_wrong_numbers_is_told_by_its_name() {
    let folder = Folder::new("wrong-headers");
    let rig = model::rig::DUAL_PRESSURE;
    for unit in ["bar", "psi", "mbar", "mmHg"] {
        let text = csv(&sound()).replacen("p_pos_kpa,p_neg_kpa", &format!("p_pos_kpa [{unit}],p_neg_kpa [{unit}]"), 1);
        let file = folder.with(&format!("{unit}.csv"), text);
        let mut map = String::new();
        // A key for each of the two columns.
        for _ in 0..2 {
            let with = folder.with("with.toml", format!("{rig}\n[recording]\n{map}"));
            let said = run(["validate", "--rig", &with, &file]);
            let names = format!("the file says {unit}, and the numbers seem to be kPa as they stand");
            assert!(said.status != 0 && said.err.contains(&names), "{unit}, {map}: {}", said.err);
            map += &format!("{}\n", told_key(&said.err));
        }
        let mended = folder.with("mended.toml", format!("{rig}\n[recording]\n{map}"));
        let said = run(["validate", "--rig", &mended, &file]);
        assert!(said.status == 0 && !said.err.contains("seem"), "{unit}: {map}: {}", said.err);
    }
}
