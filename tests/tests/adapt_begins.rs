//! Refusals of `trainer adapt` before it begins: a folder that is taken, wrong usage, a daemon that is not there.
//! Nothing is started, written or made then.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::process::Command;

use tests::{Folder, finish, program};

#[test]
fn a_folder_that_is_taken_is_refused_before_anything_is_started_or_written() {
    let folder = Folder::new();
    for (name, file, told) in
        [("old", "journal.json", "holds an adaptation already"), ("foreign", "notes.txt", "is not empty")]
    {
        let out = folder.join(name);
        std::fs::create_dir_all(out.join("rehearsal")).unwrap();
        std::fs::write(out.join(file), "{}").unwrap();
        std::fs::write(out.join("rehearsal/concealed_rig.toml"), "as it was").unwrap();
        let ended = finish(Command::new(program("trainer")).args(["adapt", "--rehearse", "--out"]).arg(&out));
        assert_eq!(ended.status, Some(2), "{ended:?}");
        assert!(ended.stderr.contains(told), "{}", ended.stderr);
        assert_eq!(std::fs::read_to_string(out.join("rehearsal/concealed_rig.toml")).unwrap(), "as it was");
        assert_eq!(folder.names(&format!("{name}/rehearsal")), ["concealed_rig.toml"]);
    }
}

#[test]
fn wrong_usage_is_told_and_nothing_made() {
    let folder = Folder::new();
    let config = folder.write("c.toml", "[link]\naddress = \"127.0.0.1:1\"\n[control]\nsocket = \"s\"\n");
    for (arguments, told) in [
        (["--rig", "bench"], "--rig"),
        (["--controller", "/nope/controller"], "/nope/controller: is no program"),
        (["--run-seconds", "20"], "30..=600"),
    ] {
        let mut command = Command::new(program("trainer"));
        command.args(["adapt", "--config"]).arg(&config).arg("--out").arg(folder.join("out")).args(arguments);
        let ended = finish(&mut command);
        assert_eq!(ended.status, Some(2), "{arguments:?}: {ended:?}");
        assert!(ended.stderr.contains(told), "{told}: {}", ended.stderr);
        assert!(!folder.join("out").exists(), "{arguments:?}");
    }
}

#[test]
fn a_daemon_that_is_not_there_is_told_and_nothing_made() {
    let folder = Folder::new();
    let config = folder.write("c.toml", "[link]\naddress = \"127.0.0.1:1\"\n[control]\nsocket = \"s\"\n");
    let mut command = Command::new(program("trainer"));
    command.args(["adapt", "--out"]).arg(folder.join("out")).arg("--config").arg(&config);
    let ended = finish(command.arg("--controller").arg(program("controller")));
    assert_eq!(ended.status, Some(1), "{ended:?}");
    for words in ["no controller answers there", "give the same command again"] {
        assert!(ended.stderr.contains(words), "{words}: {}", ended.stderr);
    }
    assert!(!ended.stderr.contains("--resume"), "there is nothing to go on with: {}", ended.stderr);
    assert!(!folder.join("out").exists());
}
