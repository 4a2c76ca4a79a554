//! Tests of the audit record: lines that wait, are lost, and hold together.

use std::sync::mpsc::channel;

use super::*;

/// Generous: how long a line may take on a machine that does other things as well.
const SOON: Duration = Duration::from_secs(60);

fn until(mut done: impl FnMut() -> bool) {
    let end = Instant::now() + SOON;
    while !done() {
        assert!(Instant::now() < end, "not in time");
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn waiting(audit: &Audit) -> usize {
    locked(&audit.handle.shared.queue).waiting.len()
}

fn folder(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("audit-{name}-{}", std::process::id()));
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir(&folder).unwrap();
    folder
}

/// All lines, each of which must name the one before it.
fn chained(file: &Path) -> Vec<String> {
    let text = std::fs::read_to_string(file).unwrap();
    let (mut before, mut who) = (String::new(), Vec::new());
    for line in text.lines() {
        if let Ok(object) = serde_json::from_str::<serde_json::Value>(line) {
            assert_eq!(object["previous"], before.as_str(), "{text}");
            who.push(object["who"].as_str().unwrap().to_owned());
        }
        before = policy::hash(line.as_bytes()).to_string();
    }
    who
}

#[test]
fn what_could_not_be_written_is_told_and_written_once_that_goes() {
    let folder = folder("owed");
    let file = folder.join("none/audit.jsonl");
    let audit = Audit::start(file.clone()).unwrap();
    audit.note("alice", "swap", "a", "ff", "");
    audit.note("bob", "swap", "b", "ee", "");
    until(|| audit.problem().is_some_and(|problem| problem.contains("audit.jsonl") && problem.contains("2 lines")));
    std::fs::create_dir(folder.join("none")).unwrap();
    until(|| waiting(&audit) == 0 && audit.problem().is_none());
    audit.note("carol", "rollback", "a", "ff", "");
    until(|| waiting(&audit) == 0);
    assert_eq!(chained(&file), ["alice", "bob", "carol"]);
    std::fs::remove_dir_all(&folder).unwrap();
}

/// A pipe that nobody reads in place of the file, from the start.
#[test]
fn what_is_no_file_is_refused_at_once() {
    let folder = folder("pipe");
    let file = folder.join("audit.jsonl");
    assert!(std::process::Command::new("mkfifo").arg(&file).status().unwrap().success());
    let audit = Audit::start(file.clone()).unwrap();
    audit.note("alice", "swap", "a", "ff", "");
    until(|| audit.problem().is_some_and(|problem| problem.contains("not a regular file; move it away")));
    std::fs::remove_file(&file).unwrap();
    until(|| waiting(&audit) == 0);
    assert_eq!(chained(&file), ["alice"]);
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_disk_that_does_not_answer_holds_nobody_and_is_told() {
    let (answer, disk) = channel::<()>();
    let audit = Audit::start_writing("audit.jsonl".into(), move |_| {
        disk.recv().map_err(|_| io::Error::other("the disk is gone"))
    })
    .unwrap();
    // Were one of these to wait for the disk, the test would not end.
    (0..MOST_WAITING + 7).for_each(|k| audit.note("alice", "swap", &k.to_string(), "ff", ""));
    until(|| audit.problem().is_some_and(|problem| problem.contains("does not answer")));
    assert!(audit.problem().unwrap().contains("7 more are lost"), "{:?}", audit.problem());
    (0..2).for_each(|_| answer.send(()).unwrap());
    until(|| waiting(&audit) == MOST_WAITING - 2);
    audit.note("bob", "swap", "b", "ee", "");
    let tail: Vec<String> =
        locked(&audit.handle.shared.queue).waiting.iter().rev().take(2).map(|note| note.detail.clone()).collect();
    assert!(tail[1].starts_with("7 lines found no room"), "{tail:?}");
}

#[test]
fn before_the_end_all_is_written_and_what_found_no_room_is_told() {
    let (answer, disk) = channel::<()>();
    let (said, written) = channel();
    let audit = Audit::start_writing("audit.jsonl".into(), move |note| {
        // Until it answers nothing is written; from then on all is.
        let _ = disk.recv();
        let _ = said.send(note.detail.clone());
        Ok(())
    })
    .unwrap();
    (0..MOST_WAITING + 7).for_each(|_| audit.note("alice", "swap", "a", "ff", ""));
    audit.settle(Duration::from_millis(20));
    assert!(waiting(&audit) > MOST_WAITING, "the disk does not answer, and nobody waits for it for long");
    drop(answer);
    audit.settle(SOON);
    let written: Vec<String> = written.try_iter().collect();
    assert_eq!(written.len(), MOST_WAITING + 1);
    assert!(written.last().is_some_and(|line| line.starts_with("7 lines found no room")), "{written:?}");
}

#[test]
fn each_line_names_the_one_before_it_also_after_a_restart_and_behind_an_unfinished_one() {
    let folder = folder("chain");
    let file = folder.join("audit.jsonl");
    let note = |who: &str, detail: &str| {
        let audit = Audit::start(file.clone()).unwrap();
        audit.note(who, "swap", "a", "ff", detail);
        until(|| waiting(&audit) == 0);
    };
    note("alice (uid 1000, pid 1)", "");
    note("bob", "\"quoted\"\nand broken");
    OpenOptions::new().append(true).open(&file).unwrap().write_all(b"{\"time\":\"2026-\xff").unwrap();
    note("carol", "");
    note("dave", "");
    let text = String::from_utf8_lossy(&std::fs::read(&file).unwrap()).into_owned();
    let lines: Vec<&str> = text.lines().collect();
    assert!(lines.len() == 5 && lines[2].starts_with("{\"time\":\"2026-"), "{text}");
    let bytes = std::fs::read(&file).unwrap();
    let mut before = String::new();
    for (number, line) in bytes.split(|byte| *byte == b'\n').take(5).enumerate() {
        if number != 2 {
            let object: serde_json::Value = serde_json::from_slice(line).unwrap();
            assert_eq!(object["previous"], before.as_str(), "{text}");
        }
        before = policy::hash(line).to_string();
    }
    std::fs::remove_dir_all(&folder).unwrap();
}
