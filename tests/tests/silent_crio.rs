//! A cRIO that opens a session and then says nothing: the daemon waits, answers operators and goes on, in real time.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::process::Command;
use std::time::{Duration, Instant};

use tests::Stream::Err;
use tests::raw_crio::{Answer, RawCrio};
use tests::{Folder, Running, alone, finish, program};

const SOON: Duration = Duration::from_secs(60);
const TICK: Duration = Duration::from_millis(20);
/// Longer than a tick may hang before the guard ends the process (1 s), shorter than the daemon waits for a first frame (5 s).
const SILENCE: Duration = Duration::from_millis(2500);

#[test]
fn a_session_without_a_frame_ends_no_daemon() {
    let _alone = alone();
    let mut crio = RawCrio::new("dual_pressure");
    let folder = Folder::new();
    let config = folder.write(
        "controller.toml",
        format!(
            "link.address = \"{}\"\nrecord.min_free_mib = 16\ncontrol.socket = \"s\"\nrealtime.enforce = false\n",
            crio.address()
        ),
    );
    let daemon = Running::start(Command::new(program("controller")).args(["run", "--config"]).arg(&config));
    crio.open();
    std::thread::sleep(SILENCE);
    let status = finish(Command::new(program("controller")).args(["status", "--config"]).arg(&config));
    assert_eq!(status.status, Some(0), "{status:?} {}", daemon.said(Err));
    // It speaks in the end, and is answered.
    let begun = Instant::now();
    let answered = (0..20).filter(|k| {
        std::thread::sleep((TICK * *k).saturating_sub(begun.elapsed()));
        matches!(crio.step(|_| ()), Answer::Command(_))
    });
    assert!(answered.count() >= 15, "{}", daemon.said(Err));
    daemon.terminate();
    let ended = daemon.wait(SOON);
    assert_eq!(ended.status, Some(0), "{ended:?}");
    assert!(!ended.stderr.contains("has been silent"), "{ended:?}");
}
