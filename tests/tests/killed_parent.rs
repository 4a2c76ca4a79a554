//! A rehearsal whose `trainer adapt` is killed leaves nothing running: rig, daemon and whatever it had begun end with it.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use tests::{Folder, alone, program};

/// The rig and the daemon.
const REHEARSED: usize = 2;

/// Children of a process, by the numbers in `/proc`.
fn children(of: u32) -> Vec<u32> {
    let parent = |id: &u32| {
        let stat = std::fs::read_to_string(format!("/proc/{id}/stat")).ok()?;
        // Name in brackets, state, parent.
        stat.rsplit_once(')')?.1.split_whitespace().nth(1)?.parse::<u32>().ok()
    };
    let ids = std::fs::read_dir("/proc").unwrap().filter_map(|entry| entry.ok()?.file_name().to_str()?.parse().ok());
    ids.filter(|id| parent(id) == Some(of)).collect()
}

/// Tells whether a process is there and has not ended.
fn is_running(id: u32) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/{id}/stat")).unwrap_or_default();
    stat.rsplit_once(')').is_some_and(|(_, rest)| !rest.trim_start().starts_with(['Z', 'X']))
}

fn wait_for(what: &str, most: Duration, is_there: impl Fn() -> bool) {
    let begun = Instant::now();
    while !is_there() {
        assert!(begun.elapsed() < most, "{what} has not come in {most:?}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

#[test]
fn what_a_rehearsal_started_ends_when_it_is_killed() {
    let _alone = alone();
    let folder = Folder::new();
    let out = folder.join("out");
    let mut adapt = Command::new(program("trainer"))
        .args(["adapt", "--rehearse", "--seed", "1", "--out"])
        .arg(&out)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let begins = || Path::new(&out).join("rehearsal/s").exists() && children(adapt.id()).len() >= REHEARSED;
    wait_for("the rehearsal", Duration::from_secs(60), begins);
    let started = children(adapt.id());
    // SIGKILL, which no program can see coming.
    adapt.kill().unwrap();
    adapt.wait().unwrap();
    wait_for("the end of all", Duration::from_secs(10), || !started.iter().any(|id| is_running(*id)));
}
