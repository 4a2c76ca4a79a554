//! The program from outside: usage, exit status, and one line for what is wrong.

#![allow(clippy::unwrap_used)] // a test's own set-up; clippy knows tests only by their attribute

use std::path::PathBuf;
use std::process::{Command, Output};

fn controller(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_controller")).args(arguments).output().unwrap()
}

fn said(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

/// A file that is gone when the test is over.
struct Scratch(PathBuf);

impl Scratch {
    fn new(name: &str, text: &str) -> Self {
        let path = std::env::temp_dir().join(format!("controller-{}-{name}", std::process::id()));
        std::fs::write(&path, text).unwrap();
        Scratch(path)
    }

    fn path(&self) -> &str {
        self.0.to_str().unwrap()
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

#[test]
fn every_command_has_help() {
    for command in ["demo", "run", "experiment", "check", "check-policy", "status", "arm", "disarm", "reference"] {
        let output = controller(&[command, "--help"]);
        assert!(output.status.success(), "{command}");
        assert!(String::from_utf8_lossy(&output.stdout).contains("Usage:"), "{command}");
    }
}

/// A result that nobody could keep is no success; a reader that has seen enough is none of the program's troubles.
#[test]
fn results_that_cannot_be_written_are_no_success() {
    let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_controller")).arg("--help").stdout(full).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(said(&output).contains("standard output cannot be written"), "{}", said(&output));
    let mut command = Command::new(env!("CARGO_BIN_EXE_controller"));
    command.arg("--help").stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped());
    let mut child = command.spawn().unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!((output.status.code(), said(&output).as_str()), (Some(0), ""));
}

#[test]
fn export_makes_tables_of_recordings_and_not_of_tables() {
    let table = Scratch::new("100hz.csv", "time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa\n0,1,1,0,0\n0.01,1,1,0,0\n");
    let output = controller(&["export", table.path(), "--csv"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(said(&output).contains("no recording of the daemon (MCAP)"), "{}", said(&output));
    let output = controller(&["replay", table.path()]);
    assert_eq!(output.status.code(), Some(2));
    assert!(said(&output).contains("no recording of the daemon (MCAP); a table"), "{}", said(&output));
}

/// A place that cannot hold the result is refused before a recording is read or a rig is moved.
#[test]
fn results_have_a_place_before_the_work() {
    let table = Scratch::new("place.csv", "time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa\n0,1,1,0,0\n0.02,1,1,0,0\n");
    let taken = Scratch::new("taken.mcap", "a file");
    let under = format!("{}/x", taken.path());
    let config = Scratch::new("place.toml", "[link]\naddress = \"127.0.0.1:1\"\n");
    let commands = Scratch::new("commands.csv", "time_s,u_pos,u_neg,pump_on\n0,1,1,0\n0.02,1,1,0\n");
    for (arguments, words) in [
        (vec!["report", table.path(), "--out", &under], "--out"),
        (vec!["report", table.path(), "--out", "/proc/none/page.html"], "--out"),
        (vec!["experiment", commands.path(), "--config", config.path(), "--out", taken.path()], "never written over"),
        (vec!["experiment", commands.path(), "--config", config.path(), "--out", &under], "--out"),
    ] {
        let output = controller(&arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", said(&output));
        assert!(said(&output).contains(words), "{}", said(&output));
    }
    assert_eq!(std::fs::read_to_string(taken.path()).unwrap(), "a file");
}

#[test]
fn help_fits_a_terminal_and_wrong_use_is_two_lines() {
    let mut commands = vec![vec!["--help"], vec!["help"]];
    let top = controller(&["--help"]);
    let text = String::from_utf8_lossy(&top.stdout).into_owned();
    let list = text.split("Commands:").nth(1).unwrap().split("Options:").next().unwrap().to_owned();
    let names: Vec<&str> = list
        .lines()
        .filter(|l| l.starts_with("  ") && !l.starts_with("   "))
        .filter_map(|l| l.split_whitespace().next())
        .collect();
    assert!(names.len() >= 12, "{names:?}");
    // `help` is itself the help of the program.
    commands.extend(names.iter().filter(|name| **name != "help").map(|name| vec![*name, "--help"]));
    for arguments in commands {
        let output = controller(&arguments);
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.status.success() && text.contains("Usage:"), "{arguments:?}: {text}");
        for line in text.lines() {
            assert!(line.chars().count() <= 80, "{arguments:?}: {line}");
        }
    }
    for arguments in [&["fly"][..], &["run"], &["run", "--config", "x", "--speed", "3"], &[]] {
        let output = controller(arguments);
        let said = said(&output);
        assert_eq!((output.status.code(), said.lines().count()), (Some(2), 2), "{arguments:?}: {said}");
        assert!(said.contains("see controller"), "{said}");
    }
}

#[test]
fn bad_input_is_status_2_and_one_line() {
    let unknown = Scratch::new("unknown.toml", "[link]\naddress = \"127.0.0.1:1\"\nspeed = 1\n");
    let no_rig = Scratch::new("norig.toml", "[link]\naddress = \"127.0.0.1:1\"\n[rig]\nfile = \"nowhere.toml\"\n");
    let no_policy = Scratch::new("nopolicy.toml", "[link]\naddress = \"127.0.0.1:1\"\n[policy]\nactive = \"best\"\n");
    let no_onnx = Scratch::new("text.onnx", "this is no policy");
    for (arguments, words) in [
        (vec!["check", "--config", unknown.path()], vec!["line 3", "speed"]),
        (vec!["check", "--config", no_rig.path()], vec!["nowhere.toml"]),
        (vec!["run", "--config", no_policy.path()], vec!["best.onnx", "fallback"]),
        (vec!["run", "--config", "/nowhere/controller.toml"], vec!["/nowhere/controller.toml"]),
        (vec!["check-policy", no_onnx.path()], vec!["text.onnx"]),
        (vec!["demo", "--seconds", "-1"], vec!["--seconds -1"]),
        (vec!["demo", "--rig", "no_such_rig"], vec!["no_such_rig", "bench"]),
    ] {
        let output = controller(&arguments);
        let said = said(&output);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        assert_eq!(said.trim_end().lines().count(), 1, "{arguments:?}: {said}");
        for word in words {
            assert!(said.contains(word), "{arguments:?}: `{word}` is not in: {said}");
        }
    }
}

#[test]
fn talking_to_nobody_is_status_1_and_says_so() {
    let output = controller(&["status", "--socket", "/nowhere/controller.sock"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(said(&output).contains("no controller answers"), "{}", said(&output));
}

#[test]
fn a_reference_out_of_reach_is_told() {
    let reference = Scratch::new("low.csv", "time_s,ref_pos_kpa,ref_neg_kpa\n0,40,-60\n10,40,-60\n");
    let config = Scratch::new(
        "low.toml",
        &format!("[link]\naddress = \"127.0.0.1:1\"\n[reference]\nfile = {:?}\n", reference.path()),
    );
    let output = controller(&["check", "--config", config.path()]);
    // It vents on its own model, which is no wrong use and not good.
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    assert!(
        said(&output).contains("out of the rig's reach") && said(&output).contains("not good"),
        "{}",
        said(&output)
    );
}

/// `controller demo | head` must not lose the flight.
#[test]
fn a_closed_standard_output_does_not_end_the_flight() {
    let out = std::env::temp_dir().join(format!("controller-{}-closed", std::process::id()));
    let mut child = Command::new(env!("CARGO_BIN_EXE_controller"))
        .args(["demo", "--fast", "--seconds", "3", "--out", out.to_str().unwrap()])
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let status = child.wait().unwrap();
    let recorded = out.join("flight.mcap").is_file();
    let _ = std::fs::remove_dir_all(&out);
    assert!(status.success() && recorded, "{status}");
}

/// The folder for recordings is a file: the start fails after its sockets were made.
#[test]
fn a_start_that_fails_leaves_no_socket_behind() {
    let folder = std::env::temp_dir().join(format!("failed-start-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("runs"), "no folder").unwrap();
    let config = folder.join("controller.toml");
    let text = "[link]\naddress = \"127.0.0.1:9\"\n[realtime]\nenforce = false\n[record]\ndirectory = \"runs\"\n[control]\nsocket = \"s\"\n";
    std::fs::write(&config, text).unwrap();
    let ended = controller(&["run", "--config", config.to_str().unwrap()]);
    assert!(matches!(ended.status.code(), Some(1 | 2)) && said(&ended).contains("runs"), "{}", said(&ended));
    let mut left: Vec<_> = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    left.sort();
    assert_eq!(left, ["controller.toml", "runs"], "{}", said(&ended));
    std::fs::remove_dir_all(&folder).unwrap();
}
