//! The demo's tick stands below a daemon's: a person may run it on the PC that has a rig under control.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::process::Command;
use std::time::{Duration, Instant};

use controller::config::Realtime;
use controller::machine::realtime::make_realtime;
use tests::task::fifo_priority;
use tests::{Folder, Running, program};

/// Priority of a demo's tick in real time; a daemon's is 80.
const DEMO: u8 = 20;

/// Priorities of the tick's thread in 50 looks at a demo with these arguments, one every 10 ms.
fn looked_at(arguments: &[&str]) -> Vec<u64> {
    let folder = Folder::new();
    let mut command = Command::new(program("controller"));
    command.args(["demo", "--json", "--out"]).arg(folder.join("out")).args(arguments);
    let demo = Running::start(&mut command);
    let until = Instant::now() + Duration::from_secs(60);
    // The thread has its name before it asks for anything, so it is looked at for a while.
    let mut seen = Vec::new();
    while seen.len() < 50 {
        assert!(Instant::now() < until, "no thread called tick");
        seen.extend(fifo_priority(demo.pid(), "tick"));
        std::thread::sleep(Duration::from_millis(10));
    }
    demo.terminate();
    let ended = demo.wait(Duration::from_secs(60));
    assert_eq!(ended.status, Some(143), "{}", ended.stderr);
    seen
}

/// A tick in lockstep never waits: with the priority of another daemon's tick it would keep that from its CPU.
#[test]
fn a_demo_in_lockstep_has_no_priority_over_others() {
    let seen = looked_at(&["--fast", "--seconds", "80000"]);
    assert!(seen.iter().all(|priority| *priority == 0), "{seen:?}");
}

#[test]
fn a_demo_in_real_time_gives_way_to_a_daemon() {
    let settings = Realtime { priority: DEMO, ..Realtime::default() };
    let refused = std::thread::spawn(move || make_realtime(&settings)).join().unwrap();
    if let Some(line) = refused.iter().find(|line| line.contains("SCHED_FIFO")) {
        println!("SKIPPED: {line}");
        return;
    }
    let seen = looked_at(&["--seconds", "600"]);
    assert_eq!(seen.last(), Some(&u64::from(DEMO)), "{seen:?}");
    assert!(seen.iter().all(|priority| *priority <= u64::from(DEMO)), "{seen:?}");
}
