//! Files that a run leaves behind, worked with as a person would: replayed, reported, compared, exported.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use proto::recording::{LogTime, Recording, RecordingInfo, RecordingWriter, TickInput, read_mcap};
use serde_json::Value;
use tests::laboratory::{Plan, SOON};
use tests::{Folder, RunStatus, Running, finish, program};

/// A wire that is broken for 40 ms after ten seconds: the rig is vented, and a person has to arm it again.
const FAULTS: &str = "
[[fault]]
kind = \"sensor\"
sensor = \"positive\"
effect = \"broken_wire\"
ticks = [500, 501]
";

fn demo(folder: &Folder, name: &str, arguments: &[&str]) -> (RunStatus, PathBuf) {
    let out = folder.join(name);
    let mut command = Command::new(program("controller"));
    command.args(["demo", "--fast", "--out"]).arg(&out).args(arguments);
    // A demo that waits for a person would be here for ever.
    (Running::start(&mut command).wait(Duration::from_secs(60)), out.join("flight.mcap"))
}

fn controller(arguments: &[&str]) -> RunStatus {
    finish(Command::new(program("controller")).args(arguments))
}

fn replayed(recording: &Path) -> (RunStatus, Value) {
    let ended = controller(&["replay", "--json", recording.to_str().unwrap()]);
    let found = serde_json::from_str(&ended.stdout).unwrap_or_else(|e| panic!("{e}: {ended:?}"));
    (ended, found)
}

#[test]
fn a_demo_whose_rig_stands_by_still_ends_with_table_recording_and_report() {
    let folder = Folder::new();
    let faults = folder.write("faults.toml", FAULTS);
    let (ended, recording) = demo(&folder, "out", &["--seconds", "10", "--faults", faults.to_str().unwrap()]);
    assert_eq!(ended.status, Some(1), "{ended:?}");
    for words in ["Verdict: not good", "vented for", "recording  ", "report     "] {
        assert!(ended.stdout.contains(words), "{words} is not in {}", ended.stdout);
    }
    assert!(ended.stderr.contains("the run was not good"), "{}", ended.stderr);
    let content = read_mcap(&recording).unwrap();
    let faulty = content.ticks.iter().filter(|tick| tick.fault != 0).count();
    // Ten seconds and the second before them, whatever happened in them.
    assert!(faulty > 0 && (500..=560).contains(&content.ticks.len()), "{faulty} of {}", content.ticks.len());
    assert!(recording.with_file_name("report.html").is_file());
    let (ended, found) = replayed(&recording);
    assert_eq!((ended.status, &found["ticks_differing"]), (Some(0), &Value::from(0)), "across the fault: {found}");
}

/// As a shell sorts them where a file was full within the second in which it was begun: `run-…-2.mcap` before `run-….mcap`.
#[test]
fn the_parts_of_a_run_are_replayed_in_their_order_whatever_theirs_is_on_the_command_line() {
    let laboratory = Plan::new("control.auto_arm = true\npolicy.active = \"fallback\"\nrecord.max_mib = 1").start();
    let until = Instant::now() + SOON;
    while laboratory.recordings("run-").len() < 3 {
        assert!(Instant::now() < until, "{:?}", laboratory.recordings("run-"));
        std::thread::sleep(Duration::from_millis(20));
    }
    let closed = laboratory.close();
    let mut files = closed.recordings("run-");
    files.reverse();
    let ended = finish(Command::new(program("controller")).args(["replay", "--json"]).args(&files));
    assert_eq!((ended.status, ended.stderr.as_str()), (Some(0), ""), "{ended:?}");
    let found: Value = serde_json::from_str(&ended.stdout).unwrap();
    assert_eq!((&found["ticks"], &found["ticks_differing"]), (&closed.ticks().len().into(), &0.into()), "{found}");
    // One that is missing in the middle is missed.
    files.sort_by_key(|file| read_mcap(file).unwrap().ticks[0].tick);
    let second = std::fs::read(files.remove(1)).unwrap();
    let ended = finish(Command::new(program("controller")).arg("replay").args(&files));
    assert_eq!(ended.status, Some(2), "{ended:?}");
    // Where the disk was full as it was begun, the run is compared up to it.
    let first = read_mcap(&files[0]).unwrap().ticks.len();
    let empty = closed.folder.write("empty.mcap", &second[..8_192]);
    let ended = finish(Command::new(program("controller")).args(["replay", "--json"]).args(&files).arg(&empty));
    assert!(ended.status == Some(1) && ended.stderr.contains("empty.mcap: the recording holds no tick"), "{ended:?}");
    let found: Value = serde_json::from_str(&ended.stdout).unwrap();
    assert_eq!((&found["ticks"], &found["ticks_differing"]), (&first.into(), &0.into()), "{found}");
}

#[test]
fn a_run_is_replayed_bit_for_bit_and_a_changed_bit_is_found() {
    let folder = Folder::new();
    let (ended, recording) = demo(&folder, "out", &["--seconds", "12"]);
    assert_eq!(ended.status, Some(0), "{ended:?}");
    let (ended, found) = replayed(&recording);
    assert_eq!(ended.status, Some(0), "{ended:?}");
    let ticks = read_mcap(&recording).unwrap().ticks;
    assert_eq!((&found["ticks"], &found["ticks_differing"]), (&Value::from(ticks.len()), &Value::from(0)));

    // Kept or mailed as people do, it is the same run.
    let packed = finish(Command::new("gzip").arg("--keep").arg(&recording));
    assert_eq!(packed.status, Some(0), "{packed:?}");
    let packed = folder.join("out/flight.mcap.gz");
    assert_eq!(replayed(&packed).1["ticks"], found["ticks"]);
    for arguments in [&["report"][..], &["export", "--csv"]] {
        let ended = controller(&[arguments, &[packed.to_str().unwrap()]].concat());
        assert_eq!(ended.status, Some(0), "{arguments:?}: {ended:?}");
    }

    // The last bit of one term of the law in one tick: found, with its tick and stage.
    let content = read_mcap(&recording).unwrap();
    let mut info = RecordingInfo::new("test", 0);
    info.extra = content.metadata.clone();
    info.policy = Some((content.metadata["policy_name"].clone(), content.metadata["policy_sha256"].clone()));
    info.log_time = LogTime::Tick;
    let other = folder.join("other.mcap");
    let mut writer = RecordingWriter::create(&other, &info, &content.attachments).unwrap();
    for (index, mut tick) in content.ticks.iter().copied().enumerate() {
        if index == 300 {
            tick.law_neg.integral = f64::from_bits(tick.law_neg.integral.to_bits() ^ 1);
        }
        writer.write(&tick).unwrap();
    }
    writer.finish().unwrap();
    let (ended, found) = replayed(&other);
    assert_eq!((ended.status, &found["ticks_differing"]), (Some(1), &Value::from(1)), "{found}");
    let first = &found["first_difference"];
    assert_eq!((&first["tick"], &first["stage"]), (&Value::from(ticks[300].tick), &Value::from("control law")));
    let inputs: Vec<TickInput> = TickInput::of(ticks[0].inputs).collect();
    assert_eq!(inputs, [TickInput::SessionOpened]);
    // Twice the same ticks are no longer run.
    let twice = controller(&["replay", recording.to_str().unwrap(), recording.to_str().unwrap()]);
    assert!(twice.status == Some(2) && twice.stderr.contains("give each recording once"), "{twice:?}");
}

#[test]
fn any_run_gets_the_demos_report_and_several_are_compared() {
    let folder = Folder::new();
    let (_, policy) = demo(&folder, "policy", &["--seconds", "12"]);
    let (_, fallback) = demo(&folder, "fallback", &["--seconds", "12", "--policy", "fallback"]);
    let ended = controller(&["report", policy.to_str().unwrap(), "--json"]);
    assert_eq!(ended.status, Some(0), "{ended:?}");
    let told: Value = serde_json::from_str(&ended.stdout).unwrap();
    assert!(policy.with_extension("html").is_file());
    // The fallback's own run is what the yardstick says, to the last digit: same rig, seed, reference and law.
    let measured = controller(&["report", fallback.to_str().unwrap(), "--json"]);
    let measured: Value = serde_json::from_str(&measured.stdout).unwrap();
    for channel in ["pos", "neg"] {
        let yardstick = told["runs"][0][format!("fallback_rmse_{channel}_kpa")].as_f64().unwrap();
        let flown = measured["runs"][0][format!("rmse_{channel}_kpa")].as_f64().unwrap();
        // Another first noise: the emulated cRIO draws once more before the first tick.
        assert!((yardstick / flown - 1.0).abs() < 0.15, "{channel}: {yardstick} {flown}");
    }
    let page = folder.join("both.html");
    let both = ["report", policy.to_str().unwrap(), fallback.to_str().unwrap(), "--out", page.to_str().unwrap()];
    let ended = controller(&both);
    assert_eq!(ended.status, Some(0), "{ended:?}");
    let html = std::fs::read_to_string(page).unwrap();
    for name in ["policy/flight.mcap", "fallback/flight.mcap", "Runs over each other"] {
        assert!(html.contains(name), "{name}");
    }
    // A page in the place of the recording would be the end of it.
    let bytes = std::fs::read(&policy).unwrap();
    let over = [fallback.to_str().unwrap(), policy.to_str().unwrap(), "--out", policy.to_str().unwrap()];
    let ended = controller(&[&["report"], &over[..]].concat());
    assert_eq!((ended.status, ended.stderr.contains("would be lost")), (Some(2), true), "{ended:?}");
    assert_eq!(std::fs::read(&policy).unwrap(), bytes);
    let ended = controller(&["report", folder.join("nowhere.mcap").to_str().unwrap()]);
    assert_eq!((ended.status, ended.stderr.contains("nowhere.mcap")), (Some(2), true), "{ended:?}");
}

#[test]
fn a_table_holds_what_the_recording_does() {
    let folder = Folder::new();
    let (_, recording) = demo(&folder, "out", &["--seconds", "8"]);
    let ended = controller(&["export", recording.to_str().unwrap(), "--csv"]);
    assert_eq!(ended.status, Some(0), "{ended:?}");
    let table = Recording::read(&recording.with_extension("csv")).unwrap();
    let content = read_mcap(&recording).unwrap();
    let steered: Vec<_> = content.ticks.iter().filter(|tick| tick.ref_pos_kpa.is_finite()).collect();
    assert_eq!(table.rows(), steered.len());
    for (name, of) in [
        ("p_pos_kpa", (|tick| tick.p_pos_kpa) as fn(&proto::recording::TickRecord) -> f64),
        ("u_neg", |tick| tick.u_neg),
        ("ref_neg_kpa", |tick| tick.ref_neg_kpa),
    ] {
        let column = table.column(name).unwrap();
        assert!(column.iter().zip(&steered).all(|(cell, tick)| cell.to_bits() == of(tick).to_bits()), "{name}");
    }
    let all = folder.join("all.csv");
    let ended = controller(&["export", recording.to_str().unwrap(), "--csv", "--all", "--out", all.to_str().unwrap()]);
    assert_eq!(ended.status, Some(0), "{ended:?}");
    let text = std::fs::read_to_string(all).unwrap();
    assert_eq!(text.lines().count(), 1 + content.ticks.len());
    let header = text.lines().next().unwrap();
    for name in ["policy_output_12", "predicted_pos_kpa_5", "law_neg_integral", "findings", "compute_ns"] {
        assert!(header.split(',').any(|column| column == name), "{name} is not in {header}");
    }
}
