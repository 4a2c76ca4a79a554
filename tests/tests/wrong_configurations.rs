//! Configurations that `run` would refuse `check` finds, and both end with status 2, so that a service is not started again and again.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::process::Command;

use tests::programme::{csv, programme};
use tests::{Folder, finish, program};

/// Checks and runs a configuration that has these lines; both must refuse it with these words.
fn check_refused(folder: &Folder, lines: &str, words: &str) {
    let config = folder.write("c.toml", format!("realtime.enforce = false\n{lines}\n"));
    for command in ["check", "run"] {
        let mut controller = Command::new(program("controller"));
        let ended = finish(controller.args([command, "--config"]).arg(&config));
        assert_eq!(ended.status, Some(2), "{command} with {lines}: {ended:?}");
        let line = ended.stderr.lines().last().unwrap_or_default();
        assert!(line.contains(words), "{command}: `{words}` is not in: {line}");
    }
}

const LINK: &str = "link.address = \"127.0.0.1:1\"";

#[test]
fn a_key_of_signatures_that_is_none_is_refused() {
    let folder = Folder::new();
    let policy = "policy.require_signature = true\npolicy.active = \"fallback\"";
    check_refused(&folder, &format!("{LINK}\n{policy}\npolicy.public_key = \"RWQabc\""), "policy.public_key: `RWQabc`");
}

/// The socket for live viewers lies beside the operators', with five bytes more.
#[test]
fn both_sockets_need_a_path_that_is_short_enough_and_free() {
    let folder = Folder::new();
    let room = 103 - folder.join("").as_os_str().len() - ".sock".len();
    let name = format!("{}.sock", "x".repeat(room));
    assert_eq!(folder.join(&name).as_os_str().len(), 103);
    check_refused(&folder, &format!("{LINK}\ncontrol.socket = \"{name}\""), "choose a shorter control.socket");
    let fifo = folder.join("s.live.sock");
    assert!(Command::new("mkfifo").arg(&fifo).status().unwrap().success());
    check_refused(&folder, &format!("{LINK}\ncontrol.socket = \"s.sock\""), "s.live.sock: this is no socket");
    assert!(fifo.exists(), "it is somebody's");
}

#[test]
fn a_folder_in_the_place_of_a_socket_is_refused_before_it_is_made() {
    let folder = Folder::new();
    let lines = format!("{LINK}\ncontrol.socket = \"same\"\nrecord.directory = \"same\"");
    check_refused(&folder, &lines, "record.directory: ");
    assert!(!folder.join("same").exists());
    check_refused(&folder, &format!("{LINK}\nrecord.directory = \"{}\"", "x".repeat(300)), "record.directory");
}

/// A rig file with the built-in rig's text in which one passage is another.
fn rig_with(folder: &Folder, passage: &str, other: &str) {
    let text = model::rig::DUAL_PRESSURE;
    assert!(text.contains(passage), "{passage}");
    folder.write("r.toml", text.replacen(passage, other, 1));
}

/// Both would vent at the first tick, or never.
#[test]
fn sensors_that_the_wire_or_the_limits_do_not_go_with_are_refused() {
    let folder = Folder::new();
    let lines = format!("{LINK}\npolicy.active = \"fallback\"\nrig.file = \"r.toml\"");
    rig_with(&folder, "range_v = [1.0, 5.0]", "range_v = [0.0, 10.0]");
    check_refused(&folder, &lines, "r.toml: sensors.sensor_pos.range_v: [0, 10] V puts 0 kPa at 0 V");
    rig_with(&folder, "range_v = [1.0, 5.0]", "range_v = [0.5, 4.5]");
    check_refused(&folder, &lines, "0.8 … 5.2 V");
    rig_with(&folder, "range_kpa_gauge = [0.0, 1000.0]", "range_kpa_gauge = [0.0, 110.0]");
    check_refused(&folder, &lines, "r.toml: safety.max_pos_kpa = 160 kPa");
    check_refused(&folder, &lines, "write a safety.max_pos_kpa below 110 kPa in the configuration");
}

/// At the lowest voltage the converter's noise alone makes a broken sensor of it: a fault from the first frames on, and no tick to time.
#[test]
fn a_check_that_never_comes_under_control_names_the_condition_and_no_time_of_a_tick() {
    let folder = Folder::new();
    rig_with(&folder, "range_v = [1.0, 5.0]", "range_v = [0.8, 5.2]");
    let lines = format!("{LINK}\npolicy.active = \"fallback\"\nrig.file = \"r.toml\"\nrealtime.enforce = false\n");
    let config = folder.write("c.toml", lines);
    let check =
        |more: &[&str]| finish(Command::new(program("controller")).args(["check", "--config"]).arg(&config).args(more));
    let ended = check(&[]);
    assert!(ended.status == Some(1) && ended.stderr.contains("(positive sensor broken)"), "{ended:?}");
    assert!(!ended.stdout.contains("a tick takes") && !ended.stdout.contains("0 ticks"), "{ended:?}");
    let ended = check(&["--json"]);
    assert!(ended.stdout.contains("\"sensor_positive\"") && !ended.stdout.contains("p50_ms"), "{ended:?}");
}

#[test]
fn what_an_experiment_is_asked_of_is_told_by_its_file() {
    let folder = Folder::new();
    rig_with(&folder, "range_v = [1.0, 5.0]", "range_v = [0.0, 10.0]");
    let config = folder.write("c.toml", format!("{LINK}\nrig.file = \"r.toml\"\ncontrol.socket = \"s\"\n"));
    let csv = folder.write("e.csv", csv(&programme(300)));
    let rig = folder.join("r.toml");
    let mut experiment = Command::new(program("controller"));
    experiment.arg("experiment").arg(&csv).arg("--config").arg(&config);
    // Before any daemon is asked: none is there.
    let mut model = Command::new(program("controller"));
    model.arg("model").arg(&rig).arg("--config").arg(&config);
    for (command, words) in [(&mut experiment, "r.toml (rig.file): sensors."), (&mut model, "r.toml: sensors.")] {
        let ended = finish(command);
        assert!(ended.status == Some(2) && ended.stderr.contains(words), "{ended:?}");
    }
}

#[test]
fn an_address_that_nothing_can_have_is_refused() {
    let folder = Folder::new();
    for address in ["127.0.0.1:0", "127.0.0.1:+5", "a b:1"] {
        check_refused(&folder, &format!("link.address = \"{address}\""), "link.address: ");
    }
}

/// Rights prove nothing there: the superuser has them, too.
#[test]
fn a_place_in_which_nothing_can_be_made_is_refused() {
    let folder = Folder::new();
    check_refused(
        &folder,
        &format!("{LINK}\ncontrol.socket = \"s\"\nrecord.directory = \"/proc/x\""),
        "record.directory",
    );
    check_refused(&folder, &format!("{LINK}\ncontrol.socket = \"/proc/y.sock\""), "control.socket");
}

#[test]
fn an_empty_path_of_a_file_is_refused_with_its_key() {
    let folder = Folder::new();
    for key in ["control.socket", "reference.file", "rig.file"] {
        check_refused(&folder, &format!("{LINK}\n{key} = \"\""), &format!("c.toml: {key}: it is empty"));
    }
}

/// `check` found a place for the socket `x/`, and `run` none.
#[test]
fn a_path_of_a_file_that_ends_as_a_folder_is_refused_with_its_key() {
    let folder = Folder::new();
    for key in ["control.socket", "reference.file", "rig.file"] {
        check_refused(&folder, &format!("{LINK}\n{key} = \"x/\""), &format!("c.toml: {key}: it ends with `/`"));
    }
}
