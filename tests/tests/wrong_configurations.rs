//! What `run` would refuse `check` finds, and both end with status 2, so that a service is not started again and again.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::process::Command;

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
