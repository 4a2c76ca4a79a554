//! Tables joined, end to end, from those that the project has made; places that cannot hold one, and signals.

// What fails here fails the test, helper functions included.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod program;

use std::process::Stdio;
use std::time::{Duration, Instant};

use program::{Folder, refused, sound, trainer};

fn table(name: &str) -> String {
    format!("{}/../docs/runs/{name}/table.json", env!("CARGO_MANIFEST_DIR"))
}

/// A table that was made without the optimum gets its multiples from a table that has it.
#[test]
fn a_comparison_and_the_optimum_are_one_table() {
    let folder = Folder::new("join");
    let out = folder.path("joined");
    // The committed comparison has been joined already: it is taken apart again.
    let text = std::fs::read_to_string(table("comparison")).unwrap();
    let mut flown: serde_json::Value = serde_json::from_str(&text).unwrap();
    flown["rows"].as_array_mut().unwrap().retain(|row| !row["entrant"].as_str().unwrap().starts_with("limit"));
    flown["provenance"] = serde_json::json!([]);
    let flown = folder.with("flown.json", flown.to_string());
    sound(["evaluate", "join", &flown, &table("limit"), "--out", &out]);
    let text = std::fs::read_to_string(format!("{out}/table.md")).unwrap();
    let row = |name: &str| text.lines().find(|line| line.starts_with(&format!("| {name}"))).unwrap().to_owned();
    assert!(row("RL both").matches('×').count() == 6, "two channels of three columns: {}", row("RL both"));
    // The committed tables have the names that older programs gave.
    assert!(!row("clairvoyant optimum").contains('×'));
    assert!(text.contains("RL both (layout v2, 512000 steps, randomised around dual_pressure)"), "{text}");
    assert!(!text.contains("limit (rig") && !text.contains("drawn around"), "{text}");
    assert!(text.contains("limit/table.json: command"), "both are told");
}

#[test]
fn what_cannot_be_joined_is_said() {
    let folder = Folder::new("join-bad");
    let out = folder.path("joined");
    let other = refused(["evaluate", "join", &table("comparison"), &table("loads"), "--out", &out]);
    assert!(other.contains("loads/table.json: its columns are bench, 0 kg"), "{other}");
    let none = folder.with("table.json", "{\"title\": \"t\"}");
    let unread = refused(["evaluate", "join", &table("comparison"), &none, "--out", &out]);
    assert!(unread.contains("is no table of `trainer evaluate`"), "{unread}");
    assert!(!std::path::Path::new(&out).exists(), "nothing is left");
}

/// The line begins with the file, once, whatever is wrong with it.
#[test]
fn a_reference_that_cannot_be_followed_is_named_once() {
    let folder = Folder::new("evaluate-reference");
    let head = "time_s,ref_pos_kpa,ref_neg_kpa\n";
    for (name, text) in [("none.csv", head.to_owned()), ("text.csv", format!("{head}0,80,low\n"))] {
        let reference = folder.with(name, text);
        let out = folder.path("tables");
        let said = refused(["evaluate", "comparison", "--reference", &reference, "--seeds", "1", "--out", &out]);
        assert_eq!(said.matches(&reference).count(), 1, "{said}");
    }
    let said =
        refused(["evaluate", "comparison", "--reference", "nowhere.csv", "--seeds", "1", "--out", &folder.path("t")]);
    assert_eq!(said.matches("nowhere.csv").count(), 1, "{said}");
}

#[test]
fn a_table_that_could_not_be_written_is_refused_before_anything_is_run() {
    let folder = Folder::new("evaluate-out");
    let file = folder.with("taken", "a file");
    let begun = Instant::now();
    for out in [file.clone(), format!("{file}/tables"), "/proc/none/tables".to_owned()] {
        let said = refused(["evaluate", "comparison", "--seeds", "1", "--randomised", "8", "--out", &out]);
        assert!(said.contains("--out"), "{said}");
    }
    // Eight rigs with their optimum would take minutes.
    assert!(begun.elapsed() < Duration::from_secs(20), "{:?}", begun.elapsed());
    assert_eq!(std::fs::read_to_string(&file).unwrap(), "a file");
}

/// Ctrl-C, twice as well, and SIGTERM: over within two seconds, and an older table stays as it was.
#[test]
fn a_comparison_that_is_stopped_leaves_the_older_table_as_it_was() {
    let folder = Folder::new("evaluate-stopped");
    let older = folder.with("table.json", "older");
    let out = std::path::Path::new(&older).parent().unwrap().to_owned();
    for (signals, status) in [(&["-INT"][..], 130), (&["-TERM"], 143), (&["-INT", "-INT"], 130)] {
        let mut child = trainer()
            .args(["evaluate", "comparison", "--seeds", "2", "--randomised", "8", "--out"])
            .arg(&out)
            .stderr(Stdio::null())
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_millis(1500));
        assert!(child.try_wait().unwrap().is_none(), "the comparison was over before it could be stopped");
        let told = Instant::now();
        for signal in signals {
            // The second one may find nobody.
            let _ = std::process::Command::new("kill")
                .args([*signal, child.id().to_string().as_str()])
                .stderr(Stdio::null())
                .status();
        }
        assert_eq!(child.wait().unwrap().code(), Some(status));
        assert!(told.elapsed() < Duration::from_secs(2), "{:?}", told.elapsed());
    }
    let left: Vec<_> = std::fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(left, ["table.json"]);
    assert_eq!(std::fs::read_to_string(older).unwrap(), "older");
}

/// Refused before the work, by the option's name; nothing is left.
#[test]
fn lengths_and_counts_that_make_no_table_are_refused() {
    let folder = Folder::new("evaluate-range");
    let out = folder.path("table");
    for (option, value) in [
        ("--seconds", "1e9"),
        ("--seconds", "inf"),
        ("--seconds", "nan"),
        ("--seconds", "-1"),
        ("--seconds", "5"),
        ("--seeds", "0"),
        ("--seeds", "100000000000"),
        ("--randomised", "100000000000"),
    ] {
        for table in ["comparison", "ablation", "loads"] {
            let value = format!("{option}={value}");
            let said = refused(["evaluate", table, &value, "--out", &out]);
            assert!(said.contains(option), "{value}: {said}");
        }
    }
    // Payloads hang on the rigs that are named, and on none that are drawn.
    for option in ["--randomised=3", "--randomised-seed=3"] {
        let said = refused(["evaluate", "loads", option, "--out", &out]);
        assert!(said.contains("unexpected argument '--randomised"), "{said}");
    }
    assert!(!std::path::Path::new(&out).exists());
}
