//! Words for live viewers where there are no ticks: the link is gone, the daemon is gone. Neither what an operator asks for nor
//! anything else but data makes the data young again.
//!
//! In lockstep, so that nothing hangs on how busy the machine is.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use tests::laboratory::{Plan, RECORDINGS};
use tests::live_viewer::{get, picture, sample, start, wait_for};

const PRESSURE: &str = "controller_pressure_kpa{channel=\"positive\"}";
const AGE: &str = "controller_data_age_seconds";

/// The metrics' line for the state, or nothing where it is left out.
fn state(address: &str) -> String {
    let text = get(address, address, "GET /metrics");
    text.lines().find(|line| line.starts_with("controller_state{")).unwrap_or_default().to_owned()
}

#[test]
fn a_lost_link_and_a_lost_daemon_are_what_viewers_are_told() {
    let laboratory = Plan::new("policy.active = \"fallback\"").start();
    laboratory.arm();
    let (_live, address) = start(&laboratory);
    wait_for("a run with pressures", || {
        state(&address) == "controller_state{state=\"run\"} 1" && sample(&address, PRESSURE).is_some()
    });

    laboratory.rig.signal("KILL");
    wait_for("connecting", || state(&address).starts_with("controller_state{state=\"connecting\"}"));
    assert_eq!(sample(&address, "controller_up"), Some(1.0));
    assert!(sample(&address, "controller_fault{fault=\"link lost\"}").is_some_and(|code| code > 0.0));
    for plant in [PRESSURE, "controller_duty{channel=\"positive\"}", "controller_tick"] {
        assert_eq!(sample(&address, plant), None, "{plant} of a rig that says nothing");
    }
    wait_for("data that ages", || sample(&address, AGE).is_some_and(|age| age > 1.0));
    // What operators ask for is no data.
    let mut before = sample(&address, AGE).unwrap();
    for _ in 0..3 {
        assert_eq!(laboratory.ask(&["arm"]).status, Some(1));
        let age = sample(&address, AGE).unwrap();
        assert!(age > before, "{age} s after {before} s");
        before = age;
    }
    let page = picture(&address);
    assert_eq!((&page["daemon"]["state"], &page["current"]), (&"connecting".into(), &false.into()), "{page}");
    assert!(page["daemon"]["fault"] == "link lost" && page["age_s"].as_f64().unwrap() >= before, "{page}");
    // The same as an operator is told.
    let status = laboratory.status();
    assert_eq!((&status["state"], &status["status"]["fault"]), (&"connecting".into(), &"link_lost".into()), "{status}");

    laboratory.daemon.signal("KILL");
    wait_for("the end of the stream", || sample(&address, "controller_up") == Some(0.0));
    assert_eq!(state(&address), "", "the state of a daemon that is gone");
    assert_eq!(sample(&address, PRESSURE), None);
    assert!(sample(&address, AGE).unwrap() >= before);
    assert_eq!(picture(&address)["daemon"]["up"], false);
}

/// Whoever watches by Prometheus or the page alone learns that a run goes on unrecorded, and that it no longer does.
#[test]
fn a_run_that_is_not_recorded_is_what_viewers_are_told() {
    const RECORDING: &str = "controller_recording";
    let laboratory = Plan::new("policy.active = \"fallback\"").start();
    laboratory.arm();
    let (_live, address) = start(&laboratory);
    wait_for("a run that is recorded", || sample(&address, RECORDING) == Some(1.0));
    assert_eq!(picture(&address)["daemon"]["recording_problem"], "");
    // The room is the disk's own, up to what others write to it meanwhile.
    let told = sample(&address, "controller_recording_free_bytes").unwrap();
    let free = flight::disk::free_bytes(&laboratory.folder.join(RECORDINGS)).unwrap() as f64;
    assert!((told / free - 1.0).abs() < 0.2, "{told} of {free}");
    assert!(picture(&address)["daemon"]["recording_free_bytes"].is_u64());
    // From now on no disk has room enough.
    let text = std::fs::read_to_string(&laboratory.config).unwrap();
    let without_room = text.replace("record.min_free_mib = 16", "record.min_free_mib = 1048576");
    assert_ne!(without_room, text);
    std::fs::write(&laboratory.config, without_room).unwrap();
    laboratory.daemon.signal("HUP");
    wait_for("a run that is not recorded", || sample(&address, RECORDING) == Some(0.0));
    let told = picture(&address)["daemon"]["recording_problem"].as_str().unwrap_or_default().to_owned();
    assert!(told.contains("MiB free"), "{told}");
    // There is room again.
    std::fs::write(&laboratory.config, text).unwrap();
    laboratory.daemon.signal("HUP");
    wait_for("a run that is recorded again", || sample(&address, RECORDING) == Some(1.0));
    laboratory.close();
}

/// Whoever begins to watch while there is no tick is told the state, and the age of data that it never saw.
#[test]
fn a_viewer_that_comes_too_late_for_the_ticks_is_told_how_old_the_data_is() {
    let laboratory = Plan::new("policy.active = \"fallback\"").start();
    laboratory.stand_by();
    laboratory.rig.signal("KILL");
    let aged = |reply: &serde_json::Value| reply["state"] == "connecting" && reply["age_ms"].as_u64() > Some(1_500);
    laboratory.wait_for("without a session for a while", aged);
    let (_live, address) = start(&laboratory);
    wait_for("connecting", || state(&address).starts_with("controller_state{state=\"connecting\"}"));
    assert!(sample(&address, AGE).unwrap() > 1.5 && sample(&address, PRESSURE).is_none());
    laboratory.daemon.terminate();
}
