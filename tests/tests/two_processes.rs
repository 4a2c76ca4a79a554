//! The daemon, the emulated cRIO of `trainer rig`, and the operator: three processes on one machine.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::path::Path;
use std::process::Command;

use proto::recording::read_mcap;
use serde_json::Value;
use tests::laboratory::{Closed, Plan, RECORDINGS, SOCKET};
use tests::{Folder, RunStatus, finish, program};

fn controller(arguments: &[&str], file: Option<&Path>) -> Command {
    let mut command = Command::new(program("controller"));
    command.args(arguments).args(file);
    command
}

/// One plain line on standard error that names what is wrong, and exit status 2.
fn check_refused(ended: &RunStatus, words: &[&str]) {
    assert_eq!(ended.status, Some(2), "{ended:?}");
    assert_eq!(ended.stderr.trim_end().lines().count(), 1, "{ended:?}");
    for word in words {
        assert!(ended.stderr.contains(word), "`{word}` is not in: {}", ended.stderr);
    }
}

#[test]
fn an_operator_flies_the_emulated_rig() {
    let laboratory = Plan::new("").start();

    // Without auto_arm nothing moves until somebody says so.
    let reply = laboratory.wait_for("armable", |r| r["status"]["can_arm"] == true);
    assert_eq!((&reply["state"], &reply["status"]["duty"]), (&"standby".into(), &serde_json::json!([1.0, 1.0])));
    let text = laboratory.ask(&["status"]);
    assert!(text.stdout.contains("state      standby") && text.stdout.contains("can be armed"), "{text:?}");

    let armed = laboratory.ask(&["arm"]);
    assert_eq!((armed.status, armed.stdout.trim()), (Some(0), "armed"), "{armed:?}");
    let (reply, status) = laboratory.ask_json(&["arm"]);
    assert_eq!((status, &reply["ok"]), (Some(1), &false.into()));
    assert!(reply["error"].as_str().unwrap().contains("armed already"), "{reply}");

    // It flies: both pressures come within 2 kPa of the reference (its RMSE on this rig is below 0.6 kPa).
    laboratory.wait_for("flying", |r| {
        let of = |key: &str, c: usize| r["status"][key][c].as_f64().unwrap();
        r["state"] == "run" && (0..2).all(|c| (of("pressures_kpa", c) - of("reference_kpa", c)).abs() < 2.0)
    });

    // Another reference is followed, a bad one refused by line.
    let hold = laboratory.folder.write("hold.csv", "time_s,ref_pos_kpa,ref_neg_kpa\n0,85,-72\n1,85,-72\n");
    let sent = laboratory.ask(&["reference", hold.to_str().unwrap()]);
    assert_eq!(sent.status, Some(0), "{sent:?}");
    laboratory.wait_for("at 85/-72 kPa", |r| {
        let p = |c: usize| r["status"]["pressures_kpa"][c].as_f64().unwrap();
        (p(0) - 85.0).abs() < 2.0 && (p(1) + 72.0).abs() < 2.0
    });
    let wild = laboratory.folder.write("wild.csv", "time_s,ref_pos_kpa,ref_neg_kpa\n0,70,-65\n1,170,-65\n");
    let refused = laboratory.ask(&["reference", wild.to_str().unwrap()]);
    assert!(refused.status == Some(2) && refused.stderr.contains("safety envelope"), "{refused:?}");

    let (reply, status) = laboratory.ask_json(&["disarm"]);
    assert_eq!((status, &reply["ok"], &reply["state"]), (Some(0), &true.into(), &"standby".into()), "{reply}");
    let reply = laboratory.wait_for("vented", |r| r["status"]["pressures_kpa"][0].as_f64().unwrap() < 5.0);
    assert_eq!(reply["status"]["duty"], serde_json::json!([1.0, 1.0]));

    let Closed { daemon, rig, folder } = laboratory.close();
    assert_eq!(rig.status, Some(0), "{rig:?}");
    assert!(!folder.join(SOCKET).exists(), "the socket is left behind");
    let names = folder.names(RECORDINGS);
    assert!(names.len() == 1 && names[0].ends_with(".mcap"), "{names:?}");
    let content = read_mcap(&folder.join(RECORDINGS).join(&names[0])).unwrap();
    assert!(content.complete, "{:?}", content.notes);
    assert!(
        content.ticks.iter().any(|t| t.state == 1) && content.ticks.iter().all(|t| t.fault == 0),
        "{}",
        daemon.stderr
    );
}

#[test]
fn a_second_daemon_on_the_same_socket_is_refused_and_disturbs_nothing() {
    let laboratory = Plan::new("").start();
    let second = laboratory.ask(&["run"]);
    assert_eq!(second.status, Some(1), "{second:?}");
    assert!(second.stderr.contains("another controller answers on this socket"), "{second:?}");
    // The first is still there.
    laboratory.status();
    let Closed { rig, folder, .. } = laboratory.close();
    assert_eq!(rig.status, Some(0), "{rig:?}");
    // The one that could not start leaves no recording behind.
    let names = folder.names(RECORDINGS);
    assert!(names.len() == 1 && names[0].ends_with(".mcap"), "{names:?}");
}

#[test]
fn nobody_at_home_is_told_in_one_line() {
    let folder = Folder::new();
    let config = folder.write("c.toml", "[link]\naddress = \"127.0.0.1:1\"\n[control]\nsocket = \"nobody\"\n");
    for question in ["status", "arm", "disarm"] {
        let ended = finish(&mut controller(&[question, "--config"], Some(&config)));
        assert_eq!((ended.status, ended.stderr.lines().count()), (Some(1), 1), "{ended:?}");
        assert!(ended.stderr.contains("nobody: no controller answers there"), "{ended:?}");
    }
}

#[test]
fn configurations_are_checked() {
    let folder = Folder::new();
    let link = "[link]\naddress = \"127.0.0.1:50500\"\n";
    let good = folder.write("good.toml", link);
    let ended = finish(&mut controller(&["check", "--config"], Some(&good)));
    assert_eq!(ended.status, Some(0), "{ended:?}");
    assert!(ended.stdout.contains("sound"), "{ended:?}");
    let ended = finish(controller(&["check", "--json", "--config"], Some(&good)).current_dir(folder.join("")));
    let object: Value = serde_json::from_str(&ended.stdout).unwrap();
    assert_eq!(object["sound"], true);

    folder.write("ragged.csv", "time_s,ref_pos_kpa,ref_neg_kpa\n0,80,-70\n1,80\n");
    folder.write("far.csv", "time_s,ref_pos_kpa,ref_neg_kpa\n0,80,-99\n");
    folder.write("rig.toml", "[volumes.pos]\nvolum_l = 1.0\n");
    folder.write("junk.onnx", b"this is no model");
    for (text, words) in [
        ("", vec!["link"]),
        ("[link]\naddress = \"nowhere\"\n", vec!["link.address", "host:port"]),
        ("[link]\naddress = 5\n", vec!["line 2"]),
        (&format!("{link}[safty]\nx = 1\n"), vec!["line 3", "safty"]),
        (&format!("{link}[safety]\nmax_pos_kpa = 999.0\n"), vec!["safety.max_pos_kpa", "999"]),
        (&format!("{link}[reference]\nfile = \"ragged.csv\"\n"), vec!["ragged.csv", "line 3"]),
        (&format!("{link}[reference]\nfile = \"absent.csv\"\n"), vec!["absent.csv"]),
        (&format!("{link}[reference]\nfile = \"far.csv\"\n"), vec!["far.csv", "safety.min_neg_kpa"]),
        (&format!("{link}[rig]\nfile = \"rig.toml\"\n"), vec!["rig.toml"]),
        (&format!("{link}[rig]\nfile = \"absent_rig\"\n"), vec!["absent_rig"]),
        (&format!("{link}[policy]\nactive = \"absent\"\n"), vec!["absent.onnx", "policy.active", "fallback"]),
        (&format!("{link}[policy]\ndirectory = \".\"\nactive = \"junk\"\n"), vec!["junk.onnx"]),
    ] {
        let bad = folder.write("bad.toml", text);
        check_refused(&finish(&mut controller(&["check", "--config"], Some(&bad))), &words);
        // The daemon itself says the same before it touches the rig.
        check_refused(&finish(&mut controller(&["run", "--config"], Some(&bad))), &words);
    }
    check_refused(&finish(&mut controller(&["check", "--config"], Some(&folder.join("gone.toml")))), &["gone.toml"]);
    assert!(folder.names("recordings").is_empty(), "nothing was recorded");
}

#[test]
fn policies_are_checked() {
    let folder = Folder::new();
    for (name, content) in
        [("empty.onnx", &b""[..]), ("text.onnx", b"this is no model"), ("cut.onnx", b"\x08\x07\x12\x03")]
    {
        let file = folder.write(name, content);
        let ended = finish(&mut controller(&["check-policy"], Some(&file)));
        check_refused(&ended, &[name]);
        let ended = finish(&mut controller(&["check-policy", "--json"], Some(&file)));
        let object: Value = serde_json::from_str(&ended.stdout).unwrap();
        assert_eq!((ended.status, &object["sound"]), (Some(2), &false.into()));
        assert!(object["error"].as_str().unwrap().contains(name), "{object}");
    }
    check_refused(&finish(&mut controller(&["check-policy"], Some(&folder.join("gone.onnx")))), &["gone.onnx"]);
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../controller/policies/default.onnx");
    let ended = finish(&mut controller(&["check-policy", "--json"], Some(&shipped)));
    let object: Value = serde_json::from_str(&ended.stdout).unwrap();
    let told = ["sound", "contract", "inputs", "outputs"].map(|key| object[key].clone());
    assert_eq!(told, [Value::from(true), Value::from(2), Value::from(124), Value::from(12)]);
}

#[test]
fn wrong_usage_has_status_2_and_help_0() {
    for arguments in [&["fly"][..], &["run"], &["check"], &["run", "--config", "x", "--speed", "3"]] {
        assert_eq!(finish(&mut controller(arguments, None)).status, Some(2), "{arguments:?}");
    }
    for subcommand in ["demo", "run", "experiment", "check", "check-policy", "status", "arm", "disarm", "reference"] {
        let ended = finish(&mut controller(&[subcommand, "--help"], None));
        assert!(ended.status == Some(0) && ended.stdout.contains("Usage"), "{subcommand}: {ended:?}");
    }
}
