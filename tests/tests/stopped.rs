//! One rule of exit statuses: what Ctrl-C (SIGINT) or SIGTERM stops before it is done ends with 128 and the signal's number, whatever it
//! leaves; what has no end of its own is done when it is stopped. Training, `adapt`, `experiment` and `rt-test` have theirs beside
//! their other tests.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::process::Command;
use std::time::{Duration, Instant};

use proto::recording::{read_mcap, unfinished_path};
use serde_json::Value;
use tests::{Folder, Running, Stream, program};

const SOON: Duration = Duration::from_secs(30);

/// A run that is stopped leaves its recording, its report and its figures, and says that it is not all.
#[test]
fn a_demo_that_is_stopped_within_its_run_leaves_all_it_has() {
    for (signal, status) in [("INT", 130), ("TERM", 143)] {
        let folder = Folder::new();
        let mut command = Command::new(program("controller"));
        command.args(["demo", "--seconds", "3000", "--policy", "fallback", "--out"]).arg(folder.join("out"));
        let demo = Running::start(&mut command);
        // Live lines are written over, on standard error: a recording without a tick would have no report.
        let begun = unfinished_path(&folder.join("out/flight.mcap"));
        let until = Instant::now() + SOON;
        while read_mcap(&begun).map_or(0, |content| content.ticks.len()) == 0 {
            assert!(Instant::now() < until, "{}: no tick recorded within {SOON:?}", begun.display());
            std::thread::sleep(Duration::from_millis(20));
        }
        demo.signal(signal);
        let ended = demo.wait(SOON);
        assert_eq!(ended.status, Some(status), "{ended:?}");
        assert!(ended.stdout.contains("recording  ") && ended.stdout.contains("report     "), "{ended:?}");
        assert!(ended.stderr.contains("stopped before its 3000 s were over"), "{ended:?}");
        assert!(folder.join("out/flight.mcap").is_file() && folder.join("out/report.html").is_file());
    }
}

/// Once a run is whole and recorded, a signal has nothing to stop: the report is written, and the status is the run's own.
#[test]
fn a_signal_that_comes_while_the_report_is_written_leaves_the_status_of_the_run() {
    for signal in ["INT", "TERM"] {
        let folder = Folder::new();
        let mut command = Command::new(program("controller"));
        command.args(["demo", "--fast", "--seconds", "120", "--policy", "fallback", "--out"]).arg(folder.join("out"));
        let demo = Running::start(&mut command);
        // The recording gets this name when its last tick is in it. On a machine that has written the report by the next look the
        // program has ended, which changes nothing in what is asserted.
        let until = Instant::now() + SOON;
        while !folder.join("out/flight.mcap").is_file() {
            assert!(Instant::now() < until, "no whole recording within {SOON:?}");
            std::thread::sleep(Duration::from_millis(1));
        }
        demo.signal(signal);
        let ended = demo.wait(SOON);
        assert_eq!(ended.status, Some(0), "{ended:?}");
        assert!(ended.stdout.contains("report     ") && folder.join("out/report.html").is_file(), "{ended:?}");
    }
}

#[test]
fn what_has_no_end_of_its_own_is_done_when_it_is_stopped() {
    let folder = Folder::new();
    let socket = folder.join("controller.sock");
    for signal in ["INT", "TERM"] {
        let mut live = Command::new(program("controller"));
        live.args(["live", "--listen", "127.0.0.1:0", "--socket"]).arg(&socket);
        let live = Running::start(&mut live);
        live.line(Stream::Out, "http://", SOON);
        live.signal(signal);
        let ended = live.wait(SOON);
        assert_eq!(ended.status, Some(0), "{ended:?}");

        let mut rig = Command::new(program("trainer"));
        rig.args(["rig", "--listen", "127.0.0.1:0", "--json"]);
        let rig = Running::start(&mut rig);
        rig.line(Stream::Err, "listening on", SOON);
        rig.signal(signal);
        let ended = rig.wait(SOON);
        assert_eq!(ended.status, Some(0), "{ended:?}");
        assert!(serde_json::from_str::<Value>(&ended.stdout).is_ok(), "{ended:?}");
    }
}
