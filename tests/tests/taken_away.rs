//! A running daemon from which something is taken away, or to which it was never given: its socket, its policies' folder, the files that its configuration names,
//! the CPU. It is told in a line, and what can be had back is.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::process::Command;
use std::time::Duration;

use serde_json::Value;
use tests::Stream::Err;
use tests::laboratory::{Laboratory, Plan, SOCKET, SOON};
use tests::{Folder, alone, finish, program};

/// The daemon reads its configuration again, with these lines behind it.
fn reread(laboratory: &Laboratory, lines: &str, answer: &str, nth: usize) -> String {
    let before = std::fs::read_to_string(&laboratory.config).unwrap();
    std::fs::write(&laboratory.config, format!("{before}{lines}\n")).unwrap();
    laboratory.daemon.signal("HUP");
    let line = laboratory.daemon.lines(Err, answer, nth, SOON);
    std::fs::write(&laboratory.config, before).unwrap();
    line
}

#[test]
fn a_socket_that_is_removed_is_made_again_and_the_rig_can_be_disarmed() {
    let laboratory = Plan::new("").start();
    laboratory.arm();
    std::fs::remove_file(laboratory.folder.join(SOCKET)).unwrap();
    laboratory.daemon.line(Err, "it is made again", SOON);
    let ended = laboratory.ask(&["disarm"]);
    assert_eq!(ended.status, Some(0), "{ended:?}");
    assert_eq!(laboratory.status()["state"], "standby");
    laboratory.close();
}

#[test]
fn what_a_restart_would_not_find_is_named_when_the_configuration_is_read_again() {
    let laboratory = Plan::new("reference.file = \"r.csv\"");
    laboratory.folder.write("r.csv", "time_s,ref_pos_kpa,ref_neg_kpa\n0,80,-70\n1,80,-70\n");
    let laboratory = laboratory.start();
    laboratory.arm();
    for (lines, words) in [
        ("rig.file = \"none.toml\"", "none.toml"),
        ("policy.active = \"none\"", "none.onnx: no such policy"),
        ("reference.file = \"none.csv\"", "none.csv"),
    ] {
        // The tables of the configuration that it replaces.
        let text = std::fs::read_to_string(&laboratory.config).unwrap();
        let key = lines.split(" = ").next().unwrap();
        let without: Vec<&str> = text.lines().filter(|line| !line.starts_with(key)).collect();
        std::fs::write(&laboratory.config, without.join("\n") + "\n").unwrap();
        let line = reread(&laboratory, lines, words, 1);
        std::fs::write(&laboratory.config, text).unwrap();
        assert!(line.contains("stays as it was"), "{line}");
    }
    // Nothing has changed, so there is nothing to be said of the reference.
    reread(&laboratory, "", "configuration read again", 1);
    let said = laboratory.daemon.said(Err);
    assert!(!said.contains("not taken over"), "{said}");
    // Another reference is named while the rig is controlled.
    laboratory.folder.write("r.csv", "time_s,ref_pos_kpa,ref_neg_kpa\n0,82,-70\n1,82,-70\n");
    reread(&laboratory, "", "not taken over", 1);
    laboratory.close();
}

#[test]
fn a_folder_of_policies_that_is_gone_or_another_is_told() {
    let plan = Plan::new("policy.directory = \"policies\"");
    let policies = plan.folder.join("policies");
    std::fs::create_dir(&policies).unwrap();
    let laboratory = plan.start();
    laboratory.stand_by();
    let problem = |words: &str| {
        laboratory.daemon.line(Err, words, SOON);
        laboratory.ask_json(&["policies"]).0["policies_problem"].as_str().map(str::to_owned)
    };
    // Once it has been read.
    std::thread::sleep(Duration::from_secs(2));
    std::fs::remove_dir(&policies).unwrap();
    assert!(problem("the folder is gone").is_some_and(|told| told.contains("make it again")));
    std::os::unix::fs::symlink("/", &policies).unwrap();
    laboratory.daemon.line(Err, "another folder than before", SOON);
    assert_eq!(problem("can be read again"), None);
    laboratory.close();
}

/// Stopped for 0.3 s while it waits for a frame: the frames lie in its buffer meanwhile.
#[test]
fn a_deadline_that_is_missed_because_the_daemon_stood_still_is_not_the_links() {
    let _alone = alone();
    let laboratory = Plan::new("realtime.enforce = false").in_real_time().start();
    laboratory.stand_by();
    let missed = |laboratory: &Laboratory| laboratory.daemon.said(Err).matches("deadline missed").count();
    let before = missed(&laboratory);
    laboratory.daemon.signal("STOP");
    std::thread::sleep(Duration::from_millis(300));
    laboratory.daemon.signal("CONT");
    let line = laboratory.daemon.lines(Err, "deadline missed", before + 1, SOON);
    assert!(line.contains("this machine did not give it a CPU") || line.contains("stolen time"), "{line}");
    laboratory.close();
}

#[test]
fn a_model_that_is_no_file_is_refused_at_once() {
    let folder = Folder::new();
    let fifo = folder.join("fifo.toml");
    assert!(Command::new("mkfifo").arg(&fifo).status().unwrap().success());
    // Nobody needs to answer on that socket: what is no file is not sent there.
    let mut command = Command::new(program("controller"));
    let ended = finish(command.arg("model").arg(&fifo).arg("--socket").arg(folder.join("s")));
    assert!(ended.status == Some(2) && ended.stderr.contains("named pipe"), "{ended:?}");
}

/// Another start would end alike, so the service is not to try it.
#[test]
fn a_place_that_cannot_be_used_is_a_wrong_configuration_also_for_run() {
    let folder = Folder::new();
    folder.write("file", "mine");
    for (lines, words) in [
        ("control.socket = \"file\"", "this is no socket"),
        ("control.socket = \"none/s\"", "control.socket"),
        ("control.socket = \"s\"\nrecord.directory = \"file\"", "record.directory"),
    ] {
        let config =
            folder.write("c.toml", format!("link.address = \"127.0.0.1:1\"\nrealtime.enforce = false\n{lines}\n"));
        for command in ["check", "run"] {
            let mut controller = Command::new(program("controller"));
            let ended = finish(controller.args([command, "--config"]).arg(&config));
            assert_eq!(ended.status, Some(2), "{command} with {lines}: {ended:?}");
            assert!(ended.stderr.contains(words), "{ended:?}");
        }
        assert_eq!(std::fs::read_to_string(folder.join("file")).unwrap(), "mine");
    }
}

/// Real-time rights that are asked for and refused are told to whoever arms, and to whoever asks for the status.
#[test]
fn what_bars_arming_is_told_to_whoever_asks() {
    let _alone = alone();
    // No machine has as many CPUs, so pinning is refused to anybody.
    let laboratory = Plan::new("realtime.cpu = 1000").in_real_time().start();
    let barred = |status: &Value| status["status"]["bars_arming"] == "not_realtime";
    laboratory.wait_for("barred", barred);
    let refused = laboratory.ask(&["arm"]);
    assert!(refused.status == Some(1) && refused.stderr.contains("real-time rights are missing"), "{refused:?}");
    let status = laboratory.ask(&["status"]);
    assert!(status.stdout.contains("not armed  real-time rights are missing"), "{status:?}");
    laboratory.close();
}
