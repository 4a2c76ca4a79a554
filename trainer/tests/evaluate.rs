//! Tables joined, end to end, from those that the project has flown.

// What fails here fails the test, helper functions included.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod program;

use program::{Folder, refused, sound};

fn table(name: &str) -> String {
    format!("{}/../docs/runs/{name}/table.json", env!("CARGO_MANIFEST_DIR"))
}

/// What was flown without the limit gets its multiples from a table that has it.
#[test]
fn a_comparison_and_the_limit_are_one_table() {
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
    assert!(!row("limit").contains('×'));
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
